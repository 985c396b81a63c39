//! A made-up Earth for flights: waves of ground everywhere, fine levels round one place, a few houses there.
//! Pages come from formulas; nothing is stored.

#![allow(dead_code, reason = "each test program uses its own part")]

use std::collections::{BTreeMap, HashMap, HashSet};
use std::path::Path;
use std::sync::Arc;
use stoop::camera::{Pose, View};
use stoop::content::rtin::SIDE;
use stoop::content::{
    IMAGERY_STORED_PX, ImageryPage, ObjectPage, Page, PageId, PageKind, Prism, TerrainPage, TerrainPost,
};
use stoop::engine::Source;
use stoop::forest::index::{IndexForest, IndexTree, NodeInfo, ObjectsEntry, Place, TerrainEntry};
use stoop::forest::{CellId, LEVEL_MAX, Zone};
use stoop::geodesy::{Geodetic, SEMI_MAJOR_M};
use stoop::paging::{PageReader, ReadError};
use stoop::store::{
    CollectionInfo, Existing, Manifest, PrismPage, WorldWriter, encode_imagery, encode_objects, encode_terrain,
};

pub const LAT_DEG: f64 = 33.75;
pub const LON_DEG: f64 = -84.39;
/// Terrain and imagery go down to here round the place.
pub const FINEST: u8 = 14;
/// And down to here everywhere.
const EVERYWHERE: u8 = 2;
/// Every eighth post of a page is drawn.
const STRIDE: usize = 8;
const HOUSES_LEVEL: u8 = 12;
pub const HOUSE_M: f64 = 40.0;

/// Amplitude in metres and waves per radian.
const WAVES: [(f64, f64); 2] = [(400.0, 40.0), (20.0, 4000.0)];

pub fn ground_m(lat_rad: f64, lon_rad: f64) -> f64 {
    500.0 + WAVES.iter().map(|(metres, k)| metres * (k * lat_rad).sin() * (k * lon_rad).cos()).sum::<f64>()
}

/// Bounds what linear pieces between drawn posts of a level miss, the Earth's curvature included.
fn error_m(level: u8) -> f64 {
    let spacing_rad = std::f64::consts::FRAC_PI_4 / (SIDE / STRIDE) as f64 / f64::from(1u32 << level);
    let waves: f64 = WAVES.iter().map(|(metres, k)| metres * (k * spacing_rad).powi(2).min(2.0)).sum();
    waves + SEMI_MAJOR_M * spacing_rad * spacing_rad / 2.0
}

fn target() -> Geodetic {
    Geodetic::from_degrees(LAT_DEG, LON_DEG, 0.0)
}

/// The cells of the world: a parent's children come together.
fn cells() -> Vec<CellId> {
    let place = CellId::containing(target().lat_rad, target().lon_rad, LEVEL_MAX);
    let mut cells: Vec<CellId> = Zone::all().map(Zone::root).collect();
    let mut at = 0;
    while at < cells.len() {
        let cell = cells[at];
        at += 1;
        if cell.level() < EVERYWHERE || (cell.level() < FINEST && cell.contains(place)) {
            cells.extend(cell.children());
        }
    }
    cells
}

fn houses_root() -> CellId {
    CellId::containing(target().lat_rad, target().lon_rad, HOUSES_LEVEL)
}

/// Houses of 20 m by 20 m in a row that runs east from the place.
pub fn houses() -> Vec<Prism> {
    let metre_rad = 1.0 / SEMI_MAJOR_M;
    (0..12)
        .map(|number| {
            let (lat, lon) = (target().lat_rad, target().lon_rad + f64::from(number) * 60.0 * metre_rad);
            let half = 10.0 * metre_rad;
            let base_m = ground_m(lat, lon) as f32;
            Prism {
                id: number,
                cell: CellId::containing(lat, lon, FINEST),
                rings: vec![vec![
                    [lon - half, lat - half],
                    [lon + half, lat - half],
                    [lon + half, lat + half],
                    [lon - half, lat + half],
                ]],
                roof: vec![[0, 1, 2], [0, 2, 3]],
                base_m,
                top_m: base_m + HOUSE_M as f32,
                foundation_m: 5.0,
                wall_color: [200, 180, 160],
                roof_color: [150, 60, 50],
                detail: None,
            }
        })
        .filter(|house| houses_root().contains(house.cell))
        .collect()
}

/// The index; `place` puts pages away, terrain and imagery of a cell one after the other.
fn trees(mut place: impl FnMut(PageId) -> Place) -> Vec<IndexTree> {
    let mut zones: BTreeMap<Zone, BTreeMap<CellId, NodeInfo>> = BTreeMap::new();
    for cell in cells() {
        let terrain = place(PageId { cell, kind: PageKind::Terrain });
        let mut node = NodeInfo {
            terrain: Some(TerrainEntry { place: terrain, error_m: error_m(cell.level()) as f32 }),
            imagery: Some(place(PageId { cell, kind: PageKind::Imagery })),
            height_range_m: (0.0, 1000.0),
            ..NodeInfo::default()
        };
        if cell.contains(houses_root()) {
            (node.dimension_m, node.reach_m) = (HOUSE_M, 20.0);
        }
        if cell == houses_root() {
            let place = place(houses_page());
            node.objects.push(ObjectsEntry { collection: 0, rep: 0, place, dimension_m: HOUSE_M, error_m: 0.0 });
        }
        zones.entry(cell.zone()).or_default().insert(cell, node);
    }
    zones.iter().map(|(zone, nodes)| IndexTree::build(*zone, nodes).unwrap()).collect()
}

fn manifest() -> Manifest {
    let collection = CollectionInfo {
        name: "houses".into(),
        objects: houses().len() as u64,
        pages: 1,
        bytes: 0,
        changeover_level: FINEST,
        vgis_level: FINEST,
        cost_curve: Vec::new(),
        large_objects: 0,
        set_aside: BTreeMap::new(),
        repaired: BTreeMap::new(),
        bounds_deg: [LON_DEG - 0.01, LAT_DEG - 0.01, LON_DEG + 0.01, LAT_DEG + 0.01],
        attributes: Vec::new(),
        reps: Vec::new(),
    };
    Manifest {
        version: 1,
        name: "made up".into(),
        datum: "WGS84 ellipsoidal".into(),
        recipe_hash: "0".into(),
        terrain: None,
        imagery: None,
        collections: vec![collection],
        sources: Vec::new(),
        height_range_m: (0.0, 1000.0),
        zones: (0..32).collect(),
        index_bytes: 0,
        pack_bytes: 0,
        views: vec![],
        additions: Default::default(),
    }
}

/// Writes the same Earth as a world on disk.
pub fn write(folder: &Path) {
    let mut writer = WorldWriter::create(folder, Existing::Refuse).unwrap();
    let mut picture_of_level = HashMap::new();
    let trees = trees(|page| {
        let bytes = match page.kind {
            PageKind::Terrain => encode_terrain(&terrain(page.cell), 0.01).unwrap(),
            PageKind::Imagery => {
                let rgb: &Vec<u8> = picture_of_level.entry(page.cell.level()).or_insert_with(|| {
                    imagery(page.cell).mips[0]
                        .chunks_exact(4)
                        .flat_map(|texel| [texel[0], texel[1], texel[2]])
                        .collect()
                });
                encode_imagery(page.cell, rgb, 85).unwrap()
            }
            PageKind::Objects { collection, rep } => {
                let page = PrismPage { root: page.cell, collection, rep, error_m: 0.1, prisms: houses(), atlas: None };
                encode_objects(&page, &[]).unwrap()
            }
            PageKind::Segment => panic!("a page of a pack"),
        };
        writer.append(page.cell.zone(), &bytes).unwrap()
    });
    writer.finish(manifest(), &trees).unwrap();
}

/// Makes pages as they are asked for.
#[derive(Default)]
pub struct Formulas {
    /// Pages that turn out broken.
    pub broken: HashSet<PageId>,
}

impl PageReader for Formulas {
    fn load(&self, page: PageId, _place: Place) -> Result<Page, ReadError> {
        if self.broken.contains(&page) {
            return Err(ReadError::Broken(format!("made-up pack: page {page:?} is broken; it was meant to be")));
        }
        Ok(match page.kind {
            PageKind::Terrain => Page::Terrain(Arc::new(terrain(page.cell))),
            PageKind::Imagery => Page::Imagery(Arc::new(imagery(page.cell))),
            PageKind::Objects { .. } => {
                let (objects, mesh) = ObjectPage::from_prisms(page.cell, 0, 0, 0.1, houses());
                Page::Objects(Arc::new(objects), Arc::new(mesh))
            }
            PageKind::Segment => return Err(ReadError::Broken("the index is all there".into())),
        })
    }
}

fn terrain(cell: CellId) -> TerrainPage {
    let own = |lat_rad, lon_rad| ground_m(lat_rad, lon_rad);
    let Some(parent) = cell.parent() else { return surface(cell, &own, &own) };
    let above = surface(parent, &own, &own);
    surface(cell, &own, &|lat_rad, lon_rad| above.surface_height_m(lat_rad, lon_rad, 1.0).unwrap())
}

fn surface(cell: CellId, own_m: &dyn Fn(f64, f64) -> f64, parent_m: &dyn Fn(f64, f64) -> f64) -> TerrainPage {
    let (bounds, above) = (cell.bounds(), cell.parent().unwrap_or(cell).bounds());
    let mut posts = Vec::new();
    for row in (0..=SIDE).step_by(STRIDE) {
        for column in (0..=SIDE).step_by(STRIDE) {
            let place = bounds.at(column as f64 / SIDE as f64, row as f64 / SIDE as f64, 0.0);
            // Rounding must not put a border post outside the parent.
            let lat_rad = place.lat_rad.clamp(above.south_rad, above.north_rad);
            let lon_rad = place.lon_rad.clamp(above.west_rad, above.east_rad);
            posts.push(TerrainPost {
                column: column as u8,
                row: row as u8,
                height_m: own_m(lat_rad, lon_rad) as f32,
                parent_height_m: parent_m(lat_rad, lon_rad) as f32,
                slope: [0, 0],
            });
        }
    }
    TerrainPage::from_posts(cell, error_m(cell.level()) as f32, posts).unwrap()
}

/// A plain colour that tells the level.
fn imagery(cell: CellId) -> ImageryPage {
    let shade = 60 + 12 * cell.level();
    let mips = (0..=IMAGERY_STORED_PX.ilog2())
        .map(|level| [shade, 255 - shade, 90, 255].repeat((IMAGERY_STORED_PX >> level).max(1).pow(2) as usize))
        .collect();
    ImageryPage { cell, mips }
}

pub fn source(reader: Formulas) -> Source {
    let mut offset = 64;
    let mut index = IndexForest::default();
    let trees = trees(|page| {
        let len = if page.kind == PageKind::Terrain { 1000 } else { 9000 };
        offset += u64::from(len);
        Place::new(offset - u64::from(len), len).unwrap()
    });
    trees.into_iter().for_each(|tree| index.insert(tree));
    Source { manifest: Arc::new(manifest()), index, reader: Arc::new(reader), layout: None }
}

/// The dive as a flight path of two seconds at 30 frames a second, and a second of hovering.
pub fn path_json(low_m: f64) -> String {
    let columns = r#"["t_s", "lon_deg", "lat_deg", "height_m", "heading_deg", "pitch_deg"]"#;
    let sample = |number: u32| {
        let pose = dive(f64::from(number.min(20)) / 20.0, low_m, [1, 1]).pose;
        let (heading_deg, pitch_deg) = (pose.heading_rad.to_degrees(), pose.pitch_rad.to_degrees());
        let t_s = f64::from(number) / 10.0;
        format!("[{t_s}, {LON_DEG}, {LAT_DEG}, {}, {heading_deg}, {pitch_deg}]", pose.eye.height_m)
    };
    let samples: Vec<String> = (0..=30).map(sample).collect();
    format!(r#"{{"fovy_deg": 60, "hz": 30, "columns": {columns}, "samples": [{}]}}"#, samples.join(","))
}

/// A dive over the place from 10,000 km to `low_m` above its ground: the view at 0 to 1 of the way.
pub fn dive(way: f64, low_m: f64, size_px: [u32; 2]) -> View {
    let above_m = (1e7f64.ln() * (1.0 - way) + low_m.ln() * way).exp();
    let pitch_deg = -90.0 + 80.0 * ((way - 0.7) / 0.3).max(0.0);
    let eye = target().at_height(ground_m(target().lat_rad, target().lon_rad) + above_m);
    let pose = Pose { eye, heading_rad: 80f64.to_radians(), pitch_rad: pitch_deg.to_radians() };
    View::new(pose, 60f64.to_radians(), size_px)
}

/// A page that a dive needs on its way.
pub fn page_under_the_dive(level: u8, kind: PageKind) -> PageId {
    PageId { cell: CellId::containing(target().lat_rad, target().lon_rad, level), kind }
}

pub fn houses_page() -> PageId {
    PageId { cell: houses_root(), kind: PageKind::Objects { collection: 0, rep: 0 } }
}
