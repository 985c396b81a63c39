//! What each navigation cell needs.

use super::grid::{Direction, NavCell, NavGrid};
use super::packed::difference;
use super::sight::{Seen, Witness};
use super::survey::{LayoutParams, Viewpoint, wanted};
use crate::content::{PageId, PageKind};
use crate::forest::index::{IndexForest, Node, Place};
use crate::geodesy::GeoBounds;
use crate::select::STAND_IN_LEVELS;
use rayon::prelude::*;
use std::collections::hash_map::Entry;
use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet};

/// Numbers of pages, ascending.
pub type CellSet = Vec<u32>;

/// In bands that end no higher than this, what is hidden is left out: metres above ground.
pub const SEEN_BELOW_M: f64 = 50.0;

/// The pages of a draft, coarse ones first: that is how runs are read.
#[derive(Clone, Debug, Default)]
pub struct Pages {
    list: Vec<(PageId, Place)>,
    numbers: HashMap<PageId, u32>,
}

impl Pages {
    fn new(pages: BTreeMap<PageId, Place>) -> Self {
        let mut list: Vec<(PageId, Place)> = pages.into_iter().collect();
        list.sort_by_key(|(page, _)| order(*page));
        let numbers = list.iter().zip(0..).map(|((page, _), number)| (*page, number)).collect();
        Self { list, numbers }
    }

    pub fn list(&self) -> &[(PageId, Place)] {
        &self.list
    }

    pub fn get(&self, number: u32) -> (PageId, Place) {
        self.list[number as usize]
    }

    pub fn number(&self, page: PageId) -> Option<u32> {
        self.numbers.get(&page).copied()
    }

    /// Stored bytes of a set.
    pub fn bytes(&self, set: &[u32]) -> u64 {
        set.iter().map(|&number| u64::from(self.get(number).1.len)).sum()
    }
}

/// Segments of the index before what they tell of, then by level, terrain before pictures before objects.
fn order(page: PageId) -> (bool, u8, PageKind, PageId) {
    (page.kind != PageKind::Segment, page.cell.level(), page.kind, page)
}

/// The sets of some or all cells of a grid.
#[derive(Clone, Debug)]
pub struct Draft {
    pub grid: NavGrid,
    pub pages: Pages,
    /// By number of the cell.
    sets: BTreeMap<usize, CellSet>,
    /// Pages left out of sets since nothing of them was seen, and their bytes, summed over the cells of bands in which that
    /// is asked; and what those cells' sets would have been with them.
    pub hidden: Hidden,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Hidden {
    pub pages: u64,
    pub bytes: u64,
    pub of_pages: u64,
    pub of_bytes: u64,
}

/// What is asked where.
pub struct Survey<'a> {
    pub index: &'a IndexForest,
    pub params: LayoutParams,
    /// Whether segments of the index are paged, and so are parts of sets.
    pub paged_index: bool,
}

/// A place by half columns and half rows, and a height above ground by band: its lower end, or its upper one.
type At = (u32, u32, u32, bool);

/// The five viewpoints of a cell: corners, and the middle.
fn places(cell: NavCell) -> [(u32, u32); 5] {
    let (west, south) = (2 * cell.column, 2 * cell.row);
    [(west, south), (west + 2, south), (west, south + 2), (west + 2, south + 2), (west + 1, south + 1)]
}

/// Those of a cell and of the eight round it. Between walls an eye sees along streets that none of its own cell's five
/// viewpoints looks into; some of its neighbours' do.
fn places_round(cell: NavCell) -> impl Iterator<Item = (u32, u32)> {
    let from = |at: u32| (2 * at).saturating_sub(2)..=2 * at + 4;
    from(cell.row).flat_map(move |y| from(cell.column).map(move |x| (x, y)))
}

/// Corners lie at the lower end of a band, where reps are finest; the middle at its upper end, from where horizons are
/// farthest.
fn viewpoints(cell: NavCell) -> [At; 5] {
    places(cell).map(|(x, y)| (x, y, cell.band, x % 2 == 1))
}

impl Draft {
    /// The sets of cells. Where `witness` is given, what it does not see from a cell's viewpoints is left out of those in
    /// bands that end at most [`SEEN_BELOW_M`] above ground. `progress` is told of what is being done, of steps done and of
    /// all, and stops the work with `false`.
    pub fn new(
        survey: &Survey<'_>,
        grid: NavGrid,
        cells: &[NavCell],
        witness: &mut Option<Box<dyn Witness>>,
        progress: &(dyn Fn(&str, usize, usize) -> bool + Sync),
    ) -> Result<Self, String> {
        let asked: BTreeSet<At> = cells.iter().flat_map(|&cell| viewpoints(cell)).collect();
        let done = std::sync::atomic::AtomicUsize::new(0);
        let surveyed: Option<HashMap<At, BTreeMap<PageId, Place>>> = asked
            .par_iter()
            .map(|&at| {
                let count = done.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
                progress("needs", count, asked.len())
                    .then(|| (at, wanted(survey.index, &survey.params, &viewpoint(&grid, at))))
            })
            .collect();
        let surveyed = surveyed.ok_or_else(|| "stopped".to_owned())?;
        let mut sets: BTreeMap<usize, BTreeMap<PageId, Place>> = BTreeMap::new();
        for &cell in cells {
            let mut set = BTreeMap::new();
            viewpoints(cell).iter().filter_map(|at| surveyed.get(at)).for_each(|pages| set.extend(pages));
            without_stood_in(&mut set);
            sets.insert(grid.number(cell), set);
        }
        let hidden = match witness {
            Some(witness) => leave_out_hidden(&grid, cells, &mut sets, &mut **witness, progress)?,
            None => Hidden::default(),
        };
        // Frames ask for the ground under the eye before all else, whatever they see of it.
        for &cell in cells {
            if let Some(set) = sets.get_mut(&grid.number(cell)) {
                add_ground(survey.index, &grid.bounds(cell), set);
            }
        }
        if survey.paged_index {
            sets.values_mut().for_each(|set| add_segments(survey.index, set));
        }
        let mut all = BTreeMap::new();
        sets.values().for_each(|set| all.extend(set));
        let pages = Pages::new(all);
        let number = |set: &BTreeMap<PageId, Place>| {
            let mut numbers: CellSet = set.keys().filter_map(|&page| pages.number(page)).collect();
            numbers.sort_unstable();
            numbers
        };
        let sets = sets.iter().map(|(&cell, set)| (cell, number(set))).collect();
        Ok(Self { grid, pages, sets, hidden })
    }

    /// `None` where it was not asked for.
    pub fn set(&self, cell: NavCell) -> Option<&CellSet> {
        self.sets.get(&self.grid.number(cell))
    }

    pub fn cells(&self) -> impl Iterator<Item = NavCell> + '_ {
        self.sets.keys().map(|&number| self.grid.cell(number))
    }

    /// What a cell needs that the one before does not.
    pub fn run(&self, from: NavCell, to: NavCell) -> Option<CellSet> {
        Some(difference(self.set(to)?, self.set(from)?))
    }

    /// All crossings between adjacent cells whose sets are known.
    pub fn crossings(&self) -> impl Iterator<Item = (NavCell, NavCell)> + '_ {
        self.cells().flat_map(move |from| {
            let next = Direction::ALL.into_iter().filter_map(move |direction| self.grid.neighbor(from, direction));
            next.filter(|&to| self.set(to).is_some()).map(move |to| (from, to))
        })
    }

    /// Bytes of all pages that are in some set.
    pub fn distinct_bytes(&self) -> u64 {
        self.pages.list().iter().map(|(_, place)| u64::from(place.len)).sum()
    }
}

fn viewpoint(grid: &NavGrid, (x, y, band, upper): At) -> Viewpoint {
    let (column, row) = (f64::from(x) / 2.0, f64::from(y) / 2.0);
    let (low_m, high_m) = grid.band_m(band);
    let eye = grid.eye(column, row, if upper { high_m } else { low_m });
    // No place in a square is further than half a side from the nearest of its corners and its middle.
    Viewpoint { eye, reach_m: (grid.side_m() / 2.0).hypot(grid.relief_m(column, row)) }
}

/// Leaves out what finer pages of the set stand in for: a viewpoint farther off wanted it coarser.
fn without_stood_in(set: &mut BTreeMap<PageId, Place>) {
    let known: HashSet<PageId> = set.keys().copied().collect();
    set.retain(|page, _| match page.kind {
        PageKind::Terrain | PageKind::Imagery => !covered(&known, *page, STAND_IN_LEVELS),
        PageKind::Objects { collection, rep } => {
            let finer = |rep| PageId { kind: PageKind::Objects { collection, rep }, ..*page };
            // Groups stand for more than the page that is rooted at their cell.
            let first = if rep < crate::content::FIRST_GROUPS { 0 } else { crate::content::FIRST_GROUPS };
            !(first..rep).any(|rep| known.contains(&finer(rep)))
        }
        PageKind::Segment => true,
    });
}

/// Whether finer pages of the same kind cover all of a page.
fn covered(known: &HashSet<PageId>, page: PageId, levels: u8) -> bool {
    levels > 0
        && page.cell.children().all(|cell| {
            let child = PageId { cell, ..page };
            known.contains(&child) || covered(known, child, levels - 1)
        })
}

fn leave_out_hidden(
    grid: &NavGrid,
    cells: &[NavCell],
    sets: &mut BTreeMap<usize, BTreeMap<PageId, Place>>,
    witness: &mut dyn Witness,
    progress: &(dyn Fn(&str, usize, usize) -> bool + Sync),
) -> Result<Hidden, String> {
    let (mut hidden, mut views) = (Hidden::default(), HashMap::<(u32, u32, u32), Seen>::new());
    let low: Vec<NavCell> = cells.iter().copied().filter(|cell| grid.band_m(cell.band).1 <= SEEN_BELOW_M).collect();
    for (done, &cell) in low.iter().enumerate() {
        if !progress("sights", done, low.len()) {
            return Err("stopped".to_owned());
        }
        for (x, y) in places(cell) {
            if let Entry::Vacant(none) = views.entry((x, y, cell.band)) {
                // From the upper end more is seen than from below it: what stands on the ground hides no less there.
                let eye = grid.eye(f64::from(x) / 2.0, f64::from(y) / 2.0, grid.band_m(cell.band).1);
                none.insert(witness.seen(eye)?);
            }
        }
    }
    for &cell in &low {
        let mut seen = Seen::default();
        places_round(cell).filter_map(|(x, y)| views.get(&(x, y, cell.band))).for_each(|view| seen.join(view));
        if let Some(set) = sets.get_mut(&grid.number(cell)) {
            let bytes = |set: &BTreeMap<PageId, Place>| set.values().map(|place| u64::from(place.len)).sum::<u64>();
            let (of_pages, of_bytes) = (set.len() as u64, bytes(set));
            set.retain(|page, _| seen.shows(*page));
            hidden.of_pages += of_pages;
            hidden.of_bytes += of_bytes;
            hidden.pages += of_pages - set.len() as u64;
            hidden.bytes += of_bytes - bytes(set);
        }
    }
    Ok(hidden)
}

/// All terrain over a cell, from the zone's root down.
fn add_ground(index: &IndexForest, bounds: &GeoBounds, set: &mut BTreeMap<PageId, Place>) {
    let mut open: Vec<Node<'_>> = index.trees().map(|tree| tree.root()).collect();
    while let Some(node) = open.pop() {
        let Some(terrain) = node.terrain().filter(|_| node.cell().bounds().intersects(bounds)) else { continue };
        set.insert(PageId { cell: node.cell(), kind: PageKind::Terrain }, terrain.place);
        open.extend(node.children());
    }
}

fn add_segments(index: &IndexForest, set: &mut BTreeMap<PageId, Place>) {
    let mut segments = BTreeMap::new();
    for page in set.keys() {
        let towards = index.tree(page.cell.zone()).into_iter().flat_map(|tree| tree.segments_towards(page.cell));
        segments.extend(towards.map(|segment| (PageId { cell: segment.root, kind: PageKind::Segment }, segment.place)));
    }
    set.extend(segments);
}
