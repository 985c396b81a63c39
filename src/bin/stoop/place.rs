//! What a world has at a place: its ground, its imagery, the objects that stand there.

use serde::Serialize;
use stoop::content::{Page, PageId, PageKind, Prism};
use stoop::forest::CellId;
use stoop::forest::index::{Node, ObjectsEntry};
use stoop::geodesy::Geodetic;
use stoop::store::{StoreError, World};

/// The finest surface at a place.
pub struct Ground {
    pub cell: CellId,
    pub error_m: f32,
    /// Above the ellipsoid, metres.
    pub height_m: f64,
}

/// An object whose footprint holds a place.
#[derive(Serialize)]
pub struct Standing {
    pub collection: String,
    pub id: u32,
    pub cell: String,
    pub base_m: f32,
    pub top_m: f32,
    pub attributes: serde_json::Value,
}

/// The nodes from the finest at a place up to its zone's root.
fn nodes_at(world: &World, place: Geodetic) -> Vec<Node<'_>> {
    let finest = CellId::containing(place.lat_rad, place.lon_rad, stoop::forest::LEVEL_MAX);
    let Some(deepest) = world.index().find_deepest(finest) else {
        return Vec::new();
    };
    deepest.cell().ancestors().filter_map(|cell| world.index().find(cell)).collect()
}

pub fn ground(world: &World, place: Geodetic) -> Result<Option<Ground>, StoreError> {
    for node in nodes_at(world, place) {
        let Some(entry) = node.terrain() else { continue };
        let id = PageId { cell: node.cell(), kind: PageKind::Terrain };
        if let Page::Terrain(page) = world.load(id, entry.place)? {
            let height_m = page.surface_height_m(place.lat_rad, place.lon_rad, 1.0);
            return Ok(height_m.map(|height_m| Ground { cell: node.cell(), error_m: entry.error_m, height_m }));
        }
    }
    Ok(None)
}

/// The cell of the finest picture at a place, and the size of its texels along the meridian, metres.
pub fn finest_imagery(world: &World, place: Geodetic) -> Option<(CellId, f64)> {
    let node = nodes_at(world, place).into_iter().find(|node| node.imagery().is_some())?;
    Some((node.cell(), node.cell().sides_m().height_m / f64::from(stoop::content::IMAGERY_PX)))
}

/// Every page of objects that `wanted` says may matter, with the node's cell; reaches over cell borders are `wanted`'s.
pub fn for_each_objects_page(
    world: &World,
    wanted: &dyn Fn(&Node<'_>) -> bool,
    visit: &mut dyn FnMut(CellId, ObjectsEntry) -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    for tree in world.index().trees() {
        let mut open = vec![tree.root()];
        while let Some(node) = open.pop() {
            if node.dimension_m() == 0.0 || !wanted(&node) {
                continue;
            }
            for entry in node.objects() {
                visit(node.cell(), entry)?;
            }
            open.extend(node.children());
        }
    }
    Ok(())
}

/// Whether objects of a subtree may reach a place: its bounds, widened by half the largest reach.
fn may_reach(node: &Node<'_>, place: Geodetic) -> bool {
    const EARTH_M: f64 = 6.35e6;
    let bounds = node.cell().bounds();
    let margin_rad = node.reach_m() / 2.0 / EARTH_M;
    let across_rad = margin_rad / place.lat_rad.cos().max(1e-6);
    let off_center = place.lon_rad - bounds.center().lon_rad;
    let lon_off = (off_center + std::f64::consts::PI).rem_euclid(std::f64::consts::TAU) - std::f64::consts::PI;
    (bounds.south_rad - margin_rad..=bounds.north_rad + margin_rad).contains(&place.lat_rad)
        && lon_off.abs() <= bounds.width_rad() / 2.0 + across_rad
}

pub fn objects_at(world: &World, place: Geodetic) -> anyhow::Result<Vec<Standing>> {
    let mut standing = Vec::new();
    for_each_objects_page(world, &|node| may_reach(node, place), &mut |root, entry| {
        let id = PageId { cell: root, kind: PageKind::Objects { collection: entry.collection, rep: entry.rep } };
        let bytes = world.read(id, entry.place)?;
        let prisms = world.prisms(id, entry.place, &bytes)?.prisms;
        let mut attributes = None;
        for (at, prism) in prisms.iter().enumerate().filter(|(_, prism)| covers(prism, place)) {
            if attributes.is_none() {
                attributes = Some(world.attributes(id, entry.place, &bytes)?);
            }
            let text = attributes.as_ref().and_then(|all| all.get(at)).map_or("{}", String::as_str);
            let name = world.manifest().collections.get(usize::from(entry.collection));
            standing.push(Standing {
                collection: name.map_or_else(|| entry.collection.to_string(), |info| info.name.clone()),
                id: prism.id,
                cell: prism.cell.to_string(),
                base_m: prism.base_m,
                top_m: prism.top_m,
                attributes: serde_json::from_str(text).unwrap_or_default(),
            });
        }
        Ok(())
    })?;
    Ok(standing)
}

fn covers(prism: &Prism, place: Geodetic) -> bool {
    use geo::{Contains, LineString, Point, Polygon};
    let line = |ring: &Vec<[f64; 2]>| LineString::from(ring.clone());
    let Some(outer) = prism.rings.first() else { return false };
    let polygon = Polygon::new(line(outer), prism.rings[1..].iter().map(line).collect());
    polygon.contains(&Point::new(place.lon_rad, place.lat_rad))
}
