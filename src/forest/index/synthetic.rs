//! Worlds of up to 2·10⁸ cells without data: what the index tells is a function of the cell, so that only the
//! directories (32 bytes for some 1365 cells) and the zones' top segments take memory.
//!
//! The Earth has all its cells down to [`BASE_LEVEL`]. Round one place they go on, a square of cells at each level, as
//! round the place where a flight ends. On the other side of the Earth whole subtrees lie, as many as are asked for:
//! they change the size of the world and nothing of what is seen from that place.

use super::build::segment;
use super::{
    Directory, IndexError, IndexForest, IndexTree, NodeInfo, Place, SEGMENT_LEVELS, SEGMENT_NODES_MAX, Segment,
    SegmentEntry, TerrainEntry,
};
use crate::forest::{CellId, LEVEL_MAX, Zone};
use crate::geodesy::Geodetic;
use std::collections::BTreeMap;

/// All cells of the Earth exist down to here: the last level of the zones' top segments.
pub const BASE_LEVEL: u8 = SEGMENT_LEVELS - 1;
/// Cells of a world at most: beyond it the places of pages would leave a pack.
pub const NODES_MAX: u64 = 200_000_000;
/// Cells to each side of the place that exist at a level, at most.
pub const RADIUS_MAX_CELLS: u32 = 64;
/// The finest levels of far subtrees: the last level of a segment, so that segments are full, and less for the rest.
const FAR_FINEST_LEVELS: [u8; 7] = [17, 11, 10, 9, 8, 7, 6];
/// Level of the roots of far subtrees.
const FAR_ROOT_LEVEL: u8 = SEGMENT_LEVELS;
/// Far zones lie this many columns east of the place's, in the two rows along the equator, which are not thinned.
const FAR_COLUMNS: std::ops::RangeInclusive<u32> = 2..=6;

/// Error of a zone's page, metres; it halves with each level.
const ROOT_ERROR_M: f64 = 4000.0;
/// The middle of all ranges of heights, which reach as far from it as the error, metres.
const MEAN_HEIGHT_M: f64 = 300.0;
/// Stored bytes of pages: from the first, less than so many more.
const TERRAIN_LEN: (u32, u32) = (256, 3840);
const IMAGERY_LEN: (u32, u32) = (4096, 16_384);
/// What a cell's pages have room in.
const SLOT_BYTES: u64 = 32 << 10;
const PACK_HEADER_BYTES: u64 = 32;

/// The refined place.
#[derive(Clone, Copy, Debug)]
pub struct Near {
    /// Between 45°S and 45°N.
    pub place: Geodetic,
    /// 6 to 22.
    pub finest_level: u8,
    /// Cells to each side of the one that holds the place, 1 to 64, at each level; zones are not left.
    pub radius_cells: u32,
}

impl Near {
    fn cell(&self, level: u8) -> CellId {
        CellId::containing(self.place.lat_rad, self.place.lon_rad, level)
    }

    fn zone(&self) -> Zone {
        self.cell(0).zone()
    }

    fn has(&self, cell: CellId) -> bool {
        let level = cell.level();
        let ((x, y), (middle_x, middle_y)) = (cell.xy(), self.cell(level).xy());
        let near = |a: u32, b: u32| a.abs_diff(b) <= self.radius_cells;
        cell.zone() == self.zone() && level <= self.finest_level && near(x, middle_x) && near(y, middle_y)
    }

    /// Cells below the base.
    fn count(&self) -> u64 {
        let side = |middle: u32, level: u8| {
            u64::from((middle + self.radius_cells).min((1 << level) - 1) - middle.saturating_sub(self.radius_cells) + 1)
        };
        (BASE_LEVEL + 1..=self.finest_level)
            .map(|level| {
                let (x, y) = self.cell(level).xy();
                side(x, level) * side(y, level)
            })
            .sum()
    }

    fn is_sound(&self) -> bool {
        (BASE_LEVEL + 1..=LEVEL_MAX).contains(&self.finest_level)
            && (1..=RADIUS_MAX_CELLS).contains(&self.radius_cells)
            && is_unthinned(self.zone())
    }
}

fn is_unthinned(zone: Zone) -> bool {
    (1..=2).contains(&zone.row())
}

/// Cells of `levels` levels.
fn full(levels: u8) -> u64 {
    ((1 << (2 * levels)) - 1) / 3
}

/// A made-up world: its index, and any segment of it on demand.
#[derive(Clone)]
pub struct SyntheticForest {
    near: Near,
    /// Roots of far subtrees, with their finest levels.
    far: BTreeMap<CellId, u8>,
    index: IndexForest,
}

impl SyntheticForest {
    /// A world of exactly `node_count` cells. `None` where the place or its levels are out of range, or the count is
    /// below what base and place take (about 43,000 and (2 · radius + 1)² a level) or above [`NODES_MAX`].
    pub fn new(near: Near, node_count: u64) -> Option<Self> {
        if !near.is_sound() || node_count > NODES_MAX {
            return None;
        }
        let base: u64 = Zone::all().map(|zone| count_down(zone.root(), BASE_LEVEL, &|_| true)).sum();
        let far = far_subtrees(near.zone(), node_count.checked_sub(base + near.count())?)?;
        let mut forest = Self { near, far, index: IndexForest::default() };
        for zone in Zone::all() {
            let directory = forest.directory(zone)?;
            let top = forest.build(zone.root(), 0, &directory)?;
            forest.index.insert(IndexTree::paged(directory, top).ok()?);
        }
        Some(forest)
    }

    /// The index with the top segments resident; cheap to clone.
    pub fn index(&self) -> &IndexForest {
        &self.index
    }

    pub fn node_count(&self) -> u64 {
        self.index.node_count()
    }

    /// The segment that begins with `root`; `None` when there is none.
    pub fn segment(&self, root: CellId) -> Option<Segment> {
        let directory = self.index.tree(root.zone())?.directory();
        self.build(root, directory.find(root)?, directory)
    }

    /// Adds the segments on the way to a cell to an index of this forest.
    pub fn insert_towards(&self, index: &mut IndexForest, cell: CellId) -> Result<(), IndexError> {
        let Some(tree) = self.index.tree(cell.zone()) else { return Ok(()) };
        let mut on_the_way = tree.segments_towards(cell).filter_map(|segment| self.segment(segment.root));
        on_the_way.try_for_each(|segment| index.insert_segment(segment))
    }

    /// Whether the world has a cell.
    pub fn exists(&self, cell: CellId) -> bool {
        if cell.level() <= BASE_LEVEL {
            return true;
        }
        self.far_finest(cell).is_some_and(|finest| cell.level() <= finest) || self.near.has(cell)
    }

    /// The finest level of the far subtree that a cell lies in.
    fn far_finest(&self, cell: CellId) -> Option<u8> {
        self.far.get(&cell.ancestor(FAR_ROOT_LEVEL)?).copied()
    }

    fn build(&self, root: CellId, number: u32, directory: &Directory) -> Option<Segment> {
        let first_segment = directory.below(root).start;
        let info = |cell, node| info(cell, u64::from(number) * SEGMENT_NODES_MAX as u64 + u64::from(node));
        Some(segment(root, &|cell| self.exists(cell), &info, first_segment).ok()?.segment)
    }

    fn directory(&self, zone: Zone) -> Option<Directory> {
        let mut entries = Vec::new();
        let (mut roots, mut offset) = (vec![zone.root()], 0);
        while !roots.is_empty() {
            let mut below = Vec::new();
            for root in roots {
                let nodes = self.count_segment(root) as u32;
                let entry = SegmentEntry { root, offset, nodes, objects: 0, checksum: 0 };
                offset += entry.byte_len() as u64;
                entries.push(entry);
                let level = root.level() + SEGMENT_LEVELS;
                // What is full down to a coarser level need not be searched.
                if self.far_finest(root).is_none_or(|finest| level <= finest) {
                    self.collect(root, level, &mut below);
                }
            }
            roots = below;
        }
        Directory::new(zone, entries).ok()
    }

    fn count_segment(&self, root: CellId) -> u64 {
        match self.far_finest(root) {
            Some(finest) => full((finest - root.level() + 1).min(SEGMENT_LEVELS)),
            None => count_down(root, root.level() + SEGMENT_LEVELS - 1, &|cell| self.exists(cell)),
        }
    }

    /// The cells of a subtree at a level, in order.
    fn collect(&self, cell: CellId, level: u8, cells: &mut Vec<CellId>) {
        if cell.level() == level {
            cells.push(cell);
            return;
        }
        for child in cell.children().filter(|&child| self.exists(child)) {
            self.collect(child, level, cells);
        }
    }
}

/// Cells of a subtree that exist, down to a level.
fn count_down(cell: CellId, level: u8, exists: &dyn Fn(CellId) -> bool) -> u64 {
    if cell.level() == level {
        return 1;
    }
    1 + cell.children().filter(|&child| exists(child)).map(|child| count_down(child, level, exists)).sum::<u64>()
}

/// Subtrees that have `count` cells together: the largest first, dealt out to the far zones in turn. `None` when the
/// zones have too few cells to begin with.
fn far_subtrees(near: Zone, mut count: u64) -> Option<BTreeMap<CellId, u8>> {
    let zones: Vec<Zone> = Zone::all()
        .filter(|zone| is_unthinned(*zone) && FAR_COLUMNS.contains(&((zone.column() + 8 - near.column()) % 8)))
        .collect();
    let side = 1u32 << FAR_ROOT_LEVEL;
    let mut roots = (0..side * side).flat_map(|at| zones.iter().map(move |&zone| (zone, at)));
    let mut far = BTreeMap::new();
    for finest in FAR_FINEST_LEVELS {
        let size = full(finest - FAR_ROOT_LEVEL + 1);
        for _ in 0..count / size {
            let (zone, at) = roots.next()?;
            far.insert(CellId::new(zone, FAR_ROOT_LEVEL, at % side, at / side)?, finest);
        }
        count %= size;
    }
    Some(far)
}

/// What the index tells of a cell; `number` counts the places of its zone.
fn info(cell: CellId, number: u64) -> NodeInfo {
    let error_m = ROOT_ERROR_M * 0.5f64.powi(i32::from(cell.level()));
    let random = mixed(cell.to_u64());
    let len = |(least, span): (u32, u32), random: u64| least + (random % u64::from(span)) as u32;
    let offset = PACK_HEADER_BYTES + number * SLOT_BYTES;
    let terrain = Place { offset, len: len(TERRAIN_LEN, random & 0xffff_ffff) };
    let imagery = Place { offset: offset + u64::from(terrain.len), len: len(IMAGERY_LEN, random >> 32) };
    NodeInfo {
        terrain: Some(TerrainEntry { place: terrain, error_m: error_m as f32 }),
        imagery: Some(imagery),
        height_range_m: (MEAN_HEIGHT_M - error_m, MEAN_HEIGHT_M + error_m),
        ..NodeInfo::default()
    }
}

/// Steele, Lea & Flood 2014, *Fast Splittable Pseudorandom Number Generators*, fig. 15: neighbours share nothing.
fn mixed(bits: u64) -> u64 {
    let mut z = bits.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ z >> 31
}
