//! Worlds of random shape: random refinement of each layer, random errors, and pages whose lengths say nothing of those
//! above and below them. Pages hold at least what the index lets one expect.

use super::{HEIGHTS_M, error_m, is_near, object_page};
use std::collections::BTreeMap;
use std::sync::Arc;
use stoop::content::{ImageryPage, Page, PageId, PageKind, TerrainPage, TerrainPost};
use stoop::forest::index::{IndexForest, IndexTree, NodeInfo, ObjectsEntry, Place, TerrainEntry};
use stoop::forest::{CellId, Zone};
use stoop::paging::{PageReader, ReadError};

/// A number that follows from a seed and another number alone (Steele, Lea & Flood 2014, fig. 15).
pub fn mixed(seed: u64, number: u64) -> u64 {
    let mut z = number.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ seed.wrapping_mul(0xd6e8_feb8_6659_fd93);
    z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ z >> 31
}

/// From 0 to below 1.
pub fn unit(seed: u64, number: u64) -> f64 {
    (mixed(seed, number) >> 11) as f64 / (1u64 << 53) as f64
}

/// The shape of a random world: refined round a place, ragged.
#[derive(Clone, Copy, Debug)]
pub struct Shape {
    pub seed: u64,
    pub lat_deg: f64,
    pub lon_deg: f64,
    pub finest: u8,
    /// Share of the cells near the place that are refined, for each layer.
    pub refined: f64,
    /// Share of the cells near the place that root a page of objects.
    pub objects: f64,
    /// Longest page, bytes; lengths are even on a logarithmic scale, from 40 on.
    pub longest: u32,
}

/// What is drawn for a cell; each has its own series of numbers.
#[derive(Clone, Copy)]
enum Draw {
    Terrain = 1,
    Imagery,
    Objects,
    TerrainLen,
    ImageryLen,
    ObjectsLen,
    Error,
    Dimension,
    Gap,
}

const SHORTEST: f64 = 40.0;

impl Shape {
    fn unit(&self, cell: CellId, draw: Draw) -> f64 {
        unit(self.seed ^ (draw as u64) << 56, cell.to_u64())
    }

    fn len(&self, cell: CellId, draw: Draw) -> u32 {
        (SHORTEST * (f64::from(self.longest) / SHORTEST).powf(self.unit(cell, draw))) as u32
    }

    fn refines(&self, cell: CellId, draw: Draw) -> bool {
        let share = match is_near(cell, self.lat_deg, self.lon_deg) {
            true if cell.level() < self.finest => self.refined,
            false if cell.level() < 2 => 0.4,
            _ => 0.0,
        };
        self.unit(cell, draw) < share
    }

    pub fn build(&self) -> IndexForest {
        let mut forest = IndexForest::default();
        for zone in Zone::all() {
            let mut cells = BTreeMap::new();
            self.add(zone.root(), [true, true], error_m(0), &mut 64, &mut cells);
            bound_objects(&mut cells);
            forest.insert(IndexTree::build(zone, &cells).unwrap());
        }
        forest
    }

    fn add(
        &self,
        cell: CellId,
        [terrain, imagery]: [bool; 2],
        error_m: f32,
        offset: &mut u64,
        cells: &mut BTreeMap<CellId, NodeInfo>,
    ) {
        // Pages lie apart now and then, so that gaps are read.
        if self.unit(cell, Draw::Gap) < 0.3 {
            *offset += (self.unit(cell, Draw::Gap) * 1e5) as u64;
        }
        let mut place = |draw| {
            let place = Place::new(*offset, self.len(cell, draw)).unwrap();
            *offset += u64::from(place.len);
            place
        };
        let terrain_entry = terrain.then(|| TerrainEntry { place: place(Draw::TerrainLen), error_m });
        let imagery_place = imagery.then(|| place(Draw::ImageryLen));
        let has_objects = cell.level() > 4
            && is_near(cell, self.lat_deg, self.lon_deg)
            && self.unit(cell, Draw::Objects) < self.objects;
        let objects = has_objects.then(|| {
            let dimension_m = 5.0 * 400f64.powf(self.unit(cell, Draw::Dimension));
            ObjectsEntry { collection: 0, rep: 0, place: place(Draw::ObjectsLen), dimension_m, error_m: 0.0 }
        });
        let info = NodeInfo {
            terrain: terrain_entry,
            imagery: imagery_place,
            height_range_m: HEIGHTS_M,
            objects: objects.into_iter().collect(),
            ..NodeInfo::default()
        };
        cells.insert(cell, info);
        let below = [terrain && self.refines(cell, Draw::Terrain), imagery && self.refines(cell, Draw::Imagery)];
        // A child's error is a fifth of its parent's, or as large, or anything between.
        let error_m = error_m * (0.2 + 0.8 * self.unit(cell, Draw::Error)) as f32;
        if below != [false; 2] {
            cell.children().for_each(|child| self.add(child, below, error_m, offset, cells));
        }
    }
}

/// Tells every cell of the largest object below it.
fn bound_objects(cells: &mut BTreeMap<CellId, NodeInfo>) {
    let roots: Vec<(CellId, f64)> = cells
        .iter()
        .flat_map(|(&cell, info)| info.objects.iter().map(move |entry| (cell, entry.dimension_m)))
        .collect();
    for (root, dimension_m) in roots {
        for above in root.ancestors() {
            let info = cells.get_mut(&above).unwrap();
            info.dimension_m = info.dimension_m.max(dimension_m);
            info.reach_m = info.reach_m.max(dimension_m.min(100.0));
        }
    }
}

/// All pages of an index that is whole, but those of the zones' roots, which are pinned.
pub fn pages_of(index: &IndexForest) -> Vec<(PageId, Place)> {
    let mut pages = Vec::new();
    for node in index.trees().flat_map(|tree| tree.nodes()) {
        let cell = node.cell();
        if cell.level() > 0 {
            pages.extend(node.terrain().map(|entry| (PageId { cell, kind: PageKind::Terrain }, entry.place)));
        }
        pages.extend(node.imagery().map(|place| (PageId { cell, kind: PageKind::Imagery }, place)));
        pages.extend(node.objects().map(|entry| {
            let kind = PageKind::Objects { collection: entry.collection, rep: entry.rep };
            (PageId { cell, kind }, entry.place)
        }));
    }
    pages
}

/// A page that holds no less than it takes as stored.
pub fn page_as_stored(id: PageId, place: Place) -> Page {
    match id.kind {
        PageKind::Terrain => terrain_page(id.cell, place.len as usize),
        PageKind::Imagery => Page::Imagery(Arc::new(ImageryPage { cell: id.cell, mips: Vec::new() })),
        PageKind::Objects { .. } => object_page(id.cell, id.cell.level() + 1, place.len / 256 + 1),
        PageKind::Segment => panic!("the index is all there"),
    }
}

/// A flat page over a grid whose posts take at least `bytes`.
fn terrain_page(cell: CellId, bytes: usize) -> Page {
    let spacing = (0..=6).rev().map(|shift| 1u8 << shift).find(|&spacing| {
        let side = 64 / usize::from(spacing) + 1;
        side * side * size_of::<TerrainPost>() >= bytes
    });
    let steps = || (0..=64u8).step_by(usize::from(spacing.unwrap_or(1)));
    let posts = steps().flat_map(|row| steps().map(move |column| (row, column))).map(|(row, column)| TerrainPost {
        column,
        row,
        height_m: 10.0,
        parent_height_m: 12.0,
        slope: [0, 0],
    });
    Page::Terrain(Arc::new(TerrainPage::from_posts(cell, error_m(cell.level()), posts.collect()).unwrap()))
}

/// Gives every page that it is asked for.
pub struct AnyPage;

impl PageReader for AnyPage {
    fn load(&self, page: PageId, place: Place) -> Result<Page, ReadError> {
        Ok(page_as_stored(page, place))
    }
}
