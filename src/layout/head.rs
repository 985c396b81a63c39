//! What a layout's file tells of itself: where cells lie, what they need, where each run begins.

use super::choice::CurvePoint;
use super::grid::{Direction, NavCell, NavGrid};
use super::packed::{PackedSets, difference};
use super::sets::Hidden;
use super::survey::LayoutParams;
use crate::content::{PageId, PageKind};
use crate::forest::CellId;
use crate::forest::index::Place;
use crate::store::{LAYOUT_BLOCK_BYTES, layout_place};
use serde::{Deserialize, Serialize};

/// No run: there is no such neighbour, or nothing to be read for it.
pub const NO_BLOCK: u32 = u32::MAX;

#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum LayoutError {
    #[error("the layout's head makes no sense: {0}; prepare the layout again, or fly without --layout")]
    Malformed(String),
}

/// A page as the file names it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct PageEntry {
    cell: u64,
    /// 0 terrain, 1 imagery, 2 objects, 3 a segment of the index.
    kind: u8,
    collection: u8,
    rep: u8,
    len: u32,
}

/// An open layout.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Layout {
    pub params: LayoutParams,
    pub grid: NavGrid,
    /// How the side was chosen: what it would have cost at others.
    pub curve: Vec<CurvePoint>,
    pub hidden: Hidden,
    pages: Vec<PageEntry>,
    sets: PackedSets,
    /// First block of the run to each neighbour, by cell and direction.
    runs: Vec<u32>,
    /// Cells with a run of all of their set, and its first block; ascending.
    entries: Vec<(u32, u32)>,
}

impl PageEntry {
    fn of(page: PageId, len: u32) -> Self {
        let (kind, collection, rep) = match page.kind {
            PageKind::Terrain => (0, 0, 0),
            PageKind::Imagery => (1, 0, 0),
            PageKind::Objects { collection, rep } => (2, collection, rep),
            PageKind::Segment => (3, 0, 0),
        };
        Self { cell: page.cell.to_u64(), kind, collection, rep, len }
    }

    fn page(&self) -> Option<PageId> {
        let kind = match self.kind {
            0 => PageKind::Terrain,
            1 => PageKind::Imagery,
            2 => PageKind::Objects { collection: self.collection, rep: self.rep },
            3 => PageKind::Segment,
            _ => return None,
        };
        Some(PageId { cell: CellId::from_u64(self.cell)?, kind })
    }
}

/// Lays runs one behind the other.
pub struct Assembly {
    layout: Layout,
    next_block: u64,
}

impl Assembly {
    pub fn new(layout: Header, pages: &[(PageId, Place)]) -> Self {
        let Header { params, grid, curve, hidden } = layout;
        let runs = vec![NO_BLOCK; grid.cell_count() * Direction::ALL.len()];
        let pages = pages.iter().map(|(page, place)| PageEntry::of(*page, place.len)).collect();
        let (sets, entries) = (PackedSets::default(), Vec::new());
        Self { layout: Layout { params, grid, curve, hidden, pages, sets, runs, entries }, next_block: 0 }
    }

    /// In the order of their numbers.
    pub fn push_set(&mut self, set: &[u32]) {
        self.layout.sets.push(set);
    }

    /// The run to a neighbour; false where there is nothing in it, or no room for more.
    pub fn push_run(&mut self, cell: usize, direction: Direction, bytes: u64) -> bool {
        let Some(block) = self.block(bytes) else { return false };
        self.layout.runs[cell * Direction::ALL.len() + direction as usize] = block;
        true
    }

    /// The run of all that a cell needs; cells ascend.
    pub fn push_entry(&mut self, cell: usize, bytes: u64) -> bool {
        let Some(block) = self.block(bytes) else { return false };
        self.layout.entries.push((cell as u32, block));
        true
    }

    fn block(&mut self, bytes: u64) -> Option<u32> {
        let block = u32::try_from(self.next_block).ok().filter(|&block| block != NO_BLOCK && bytes > 0)?;
        self.next_block += crate::store::layout_blocks(bytes);
        Some(block)
    }

    pub fn finish(self) -> Layout {
        self.layout
    }
}

/// What a layout is made for.
pub struct Header {
    pub params: LayoutParams,
    pub grid: NavGrid,
    pub curve: Vec<CurvePoint>,
    pub hidden: Hidden,
}

impl Layout {
    pub fn to_bytes(&self) -> Result<Vec<u8>, LayoutError> {
        postcard::to_stdvec(self).map_err(|error| LayoutError::Malformed(error.to_string()))
    }

    /// Reads and checks a head: whatever its bytes, no look into it fails later.
    pub fn parse(bytes: &[u8]) -> Result<Self, LayoutError> {
        let malformed = |what: &str| LayoutError::Malformed(what.to_owned());
        let layout: Self = postcard::from_bytes(bytes).map_err(|error| LayoutError::Malformed(error.to_string()))?;
        let cells = if layout.grid.is_sound() { layout.grid.cell_count() } else { 0 };
        let params = [layout.params.tolerance_px, layout.params.threshold_px, layout.params.focal_px];
        if cells == 0 || !params.iter().all(|number| number.is_finite() && *number > 0.0) {
            return Err(malformed("its grid or its parameters"));
        }
        if layout.pages.iter().any(|entry| entry.page().is_none()) {
            return Err(malformed("a page that cannot be"));
        }
        let is_whole = layout.sets.len() == cells && layout.sets.is_sound(layout.pages.len() as u32);
        let are_cells = layout.entries.iter().all(|(cell, _)| (*cell as usize) < cells);
        if !is_whole || layout.runs.len() != cells * Direction::ALL.len() || !are_cells {
            return Err(malformed("its sets or runs"));
        }
        Ok(layout)
    }

    /// Pages that a cell needs.
    pub fn set(&self, cell: NavCell) -> Vec<PageId> {
        self.sets.get(self.grid.number(cell)).iter().filter_map(|&number| self.page(number)).collect()
    }

    fn page(&self, number: u32) -> Option<PageId> {
        self.pages[number as usize].page()
    }

    /// The pages that a crossing adds, with their places in the file, one behind the other; none where nothing is
    /// needed, or the cells are not adjacent.
    pub fn run(&self, from: NavCell, to: NavCell) -> Vec<(PageId, Place)> {
        let Some(direction) = self.grid.direction(from, to) else { return Vec::new() };
        let cell = self.grid.number(from);
        let block = self.runs[cell * Direction::ALL.len() + direction as usize];
        let added = difference(&self.sets.get(self.grid.number(to)), &self.sets.get(cell));
        self.places(&added, block)
    }

    /// All pages of a cell in one run, where it has one: for flights that enter there.
    pub fn entry(&self, cell: NavCell) -> Option<Vec<(PageId, Place)>> {
        let number = self.grid.number(cell);
        let at = self.entries.binary_search_by_key(&(number as u32), |entry| entry.0).ok()?;
        Some(self.places(&self.sets.get(number), self.entries[at].1))
    }

    fn places(&self, numbers: &[u32], block: u32) -> Vec<(PageId, Place)> {
        if block == NO_BLOCK {
            return Vec::new();
        }
        let mut offset = u64::from(block) * LAYOUT_BLOCK_BYTES;
        let place = |&number: &u32| {
            let len = self.pages[number as usize].len;
            let place = layout_place(offset, len);
            offset += u64::from(len);
            Some((self.page(number)?, place))
        };
        numbers.iter().filter_map(place).collect()
    }

    /// Bytes that it takes in memory.
    pub fn byte_len(&self) -> usize {
        self.pages.len() * size_of::<PageEntry>()
            + self.sets.byte_len()
            + 4 * self.runs.len()
            + 8 * self.entries.len()
            + self.grid.byte_len()
    }
}
