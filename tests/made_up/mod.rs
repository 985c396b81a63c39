//! Made-up worlds for tests of selection and paging: an index and pages, no files.
#![allow(dead_code, reason = "each test binary uses a part")]

pub mod flights;
pub mod random;

use std::collections::BTreeMap;
use std::sync::Arc;
use stoop::camera::{Pose, View};
use stoop::cells::LiveTree;
use stoop::content::{
    CellObjects, ImageryPage, Object, ObjectMesh, ObjectPage, Page, PageId, PageKind, TerrainPage, TerrainPost,
};
use stoop::forest::index::{IndexForest, IndexTree, NodeInfo, ObjectsEntry, Place, TerrainEntry};
use stoop::forest::{CellId, Zone};
use stoop::geodesy::{Geodetic, SEMI_MAJOR_M};
use stoop::paging::{Delivery, Outcome, ReadError};

/// Lengths of stored pages, bytes.
pub const TERRAIN_LEN: u32 = 3_000;
pub const IMAGERY_LEN: u32 = 20_000;
pub const OBJECTS_LEN: u32 = 30_000;
/// Heights of the made-up ground and of what stands on it, metres.
pub const HEIGHTS_M: (f64, f64) = (0.0, 120.0);

/// Which cells a world has: by layer, whether a cell has children with pages.
pub struct Plan<T, I> {
    pub terrain_refines: T,
    pub imagery_refines: I,
    /// Cells that root a page of objects.
    pub object_roots: Vec<CellId>,
}

/// Error of terrain by level: halves from level to level.
pub fn error_m(level: u8) -> f32 {
    4000.0 * 0.5f32.powi(level.into())
}

pub fn build<T: Fn(CellId) -> bool, I: Fn(CellId) -> bool>(plan: &Plan<T, I>) -> IndexForest {
    let mut forest = IndexForest::default();
    for zone in Zone::all() {
        let mut cells = BTreeMap::new();
        let mut offset = 64;
        add(plan, zone.root(), (true, true), &mut offset, &mut cells);
        for &root in plan.object_roots.iter().filter(|root| root.zone() == zone) {
            for above in root.ancestors() {
                let info = cells.entry(above).or_insert_with(|| bare(above));
                info.dimension_m = 60.0;
                info.reach_m = 40.0;
            }
            let place = Place::new(offset, OBJECTS_LEN).unwrap();
            offset += u64::from(OBJECTS_LEN);
            let entry = ObjectsEntry { collection: 0, rep: 0, place, dimension_m: 60.0, error_m: 0.0 };
            cells.get_mut(&root).unwrap().objects.push(entry);
        }
        forest.insert(IndexTree::build(zone, &cells).unwrap());
    }
    forest
}

fn bare(_cell: CellId) -> NodeInfo {
    NodeInfo { height_range_m: HEIGHTS_M, ..NodeInfo::default() }
}

fn add<T: Fn(CellId) -> bool, I: Fn(CellId) -> bool>(
    plan: &Plan<T, I>,
    cell: CellId,
    (terrain, imagery): (bool, bool),
    offset: &mut u64,
    cells: &mut BTreeMap<CellId, NodeInfo>,
) {
    let mut place = |len: u32| {
        let place = Place::new(*offset, len).unwrap();
        *offset += u64::from(len);
        place
    };
    let mut info = bare(cell);
    info.terrain = terrain.then(|| TerrainEntry { place: place(TERRAIN_LEN), error_m: error_m(cell.level()) });
    info.imagery = imagery.then(|| place(IMAGERY_LEN));
    cells.insert(cell, info);
    let below = (terrain && (plan.terrain_refines)(cell), imagery && (plan.imagery_refines)(cell));
    if below.0 || below.1 {
        for child in cell.children() {
            add(plan, child, below, offset, cells);
        }
    }
}

/// Whether a cell is near a place: within two of its sides, so that a disc round the place is refined at each level.
pub fn is_near(cell: CellId, lat_deg: f64, lon_deg: f64) -> bool {
    let bounds = cell.bounds();
    let center = bounds.center();
    let place = Geodetic::from_degrees(lat_deg, lon_deg, 0.0);
    let apart_m = center.to_ecef().distance_m(place.to_ecef());
    apart_m < 2.0 * bounds.height_rad() * SEMI_MAJOR_M
}

/// Terrain to `terrain` and imagery to `imagery` levels round a place, to level 3 elsewhere.
pub fn dive_world(lat_deg: f64, lon_deg: f64, terrain: u8, imagery: u8) -> IndexForest {
    build(&Plan {
        terrain_refines: |cell: CellId| cell.level() < 3 || (cell.level() < terrain && is_near(cell, lat_deg, lon_deg)),
        imagery_refines: |cell: CellId| cell.level() < 3 || (cell.level() < imagery && is_near(cell, lat_deg, lon_deg)),
        object_roots: Vec::new(),
    })
}

/// Terrain and pictures round a place, and pages of objects at it.
pub fn town_world(lat_deg: f64, lon_deg: f64) -> IndexForest {
    let refines =
        |finest: u8| move |cell: CellId| cell.level() < 2 || (cell.level() < finest && is_near(cell, lat_deg, lon_deg));
    let middle = CellId::containing(lat_deg.to_radians(), lon_deg.to_radians(), 13);
    let around =
        (0..25).filter_map(|n| CellId::new(middle.zone(), 13, middle.xy().0 + n % 5 - 2, middle.xy().1 + n / 5));
    build(&Plan { terrain_refines: refines(14), imagery_refines: refines(13), object_roots: around.collect() })
}

/// A flat page of four posts.
pub fn terrain_page(cell: CellId, height_m: f32, parent_height_m: f32) -> Page {
    let posts = [(0, 0), (64, 0), (0, 64), (64, 64)].map(|(column, row)| TerrainPost {
        column,
        row,
        height_m,
        parent_height_m,
        slope: [0, 0],
    });
    Page::Terrain(Arc::new(TerrainPage::from_posts(cell, error_m(cell.level()), posts.to_vec()).unwrap()))
}

/// A page of `count` objects in each cell of `level` below the root, in the middle of the cell.
pub fn object_page(root: CellId, level: u8, count: u32) -> Page {
    let mut cells_of = vec![root];
    for _ in root.level()..level {
        cells_of = cells_of.iter().flat_map(|cell| cell.children()).collect();
    }
    let (mut objects, mut cells) = (Vec::new(), Vec::new());
    for cell in cells_of {
        let start = objects.len() as u32;
        for n in 0..count {
            let bounds = cell.bounds();
            let place = bounds.at(0.1 + 0.8 * f64::from(n) / f64::from(count), 0.5, 10.0);
            objects.push(object(objects.len() as u32, cell, place, 5.0 + 55.0 * (n % 7) as f32 / 6.0));
        }
        cells.push(CellObjects {
            cell,
            objects: start..objects.len() as u32,
            height_range_m: (10.0, 70.0),
            dimension_m: 60.0,
        });
    }
    let page = ObjectPage {
        root,
        collection: 0,
        rep: 0,
        error_m: 0.0,
        origin: root.bounds().center().to_ecef(),
        objects,
        cells,
        footprints: Default::default(),
        looks: Vec::new(),
    };
    Page::Objects(Arc::new(page), Arc::new(ObjectMesh::default()))
}

fn object(id: u32, cell: CellId, place: Geodetic, dimension_m: f32) -> Object {
    Object {
        id,
        cell,
        place: place.to_ecef(),
        lat_rad: place.lat_rad,
        lon_rad: place.lon_rad,
        base_m: 10.0,
        top_m: 10.0 + dimension_m,
        dimension_m,
        reach_m: dimension_m.min(40.0),
        wall_color: [0; 3],
        roof_color: [0; 3],
        indices: id * 6..id * 6 + 6,
    }
}

/// The page that a made-up world has under a name.
pub fn page(id: PageId) -> Page {
    match id.kind {
        PageKind::Terrain => terrain_page(id.cell, 10.0, 12.0),
        PageKind::Imagery => Page::Imagery(Arc::new(ImageryPage { cell: id.cell, mips: Vec::new() })),
        PageKind::Objects { .. } => object_page(id.cell, id.cell.level() + 2, 9),
        PageKind::Segment => panic!("the index is all there"),
    }
}

/// The index without its lower segments.
pub fn tops(whole: &IndexForest) -> IndexForest {
    let mut index = IndexForest::default();
    for tree in whole.trees() {
        let top = tree.segments().next().unwrap().clone();
        index.insert(IndexTree::paged(tree.directory().clone(), top).unwrap());
    }
    index
}

/// The zones' coarsest terrain is resident.
pub fn with_roots(index: &IndexForest) -> LiveTree {
    let mut cells = LiveTree::default();
    for tree in index.trees() {
        cells.insert(&page(PageId { cell: tree.root().cell(), kind: PageKind::Terrain }));
    }
    cells
}

pub fn view(lat_deg: f64, lon_deg: f64, height_m: f64, heading_deg: f64, pitch_deg: f64) -> View {
    let eye = Geodetic::from_degrees(lat_deg, lon_deg, height_m);
    let pose = Pose { eye, heading_rad: heading_deg.to_radians(), pitch_rad: pitch_deg.to_radians() };
    View::new(pose, 60f64.to_radians(), [640, 360])
}

/// What became of a page, in a word; a page that came is the one asked for.
pub fn outcome(delivery: &Delivery) -> &'static str {
    match &delivery.outcome {
        Outcome::Loaded(page) => {
            assert_eq!(page.id(), delivery.page);
            "loaded"
        }
        Outcome::Failed(ReadError::Failed(_)) => "failed",
        Outcome::Failed(ReadError::Broken(_)) => "broken",
        Outcome::Cancelled => "cancelled",
    }
}
