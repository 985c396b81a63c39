//! From a world to a layout: curve, choice, sets, file.

use super::choice::{Choice, CurvePoint, Verdict, choose, verdict};
use super::classes::classes;
use super::compare::{Crossing, Delays, From, crossing_delays};
use super::grid::{CELLS_MAX, Direction, NavCell, NavGrid};
use super::head::{Assembly, Header, LayoutError};
use super::lemma::{Prediction, lemmas};
use super::order::{LinearOrder, hilbert_order};
use super::packed::difference;
use super::sets::{CellSet, Draft, Hidden, Survey};
use super::sight::Witness;
use super::survey::LayoutParams;
use crate::content::PageId;
use crate::forest::index::Place;
use crate::geodesy::{GeoBounds, Geodetic};
use crate::storage::StorageModel;
use crate::store::{GroundPages, INDEX_RESIDENT_MAX_BYTES, StoreError, World, layout_blocks, write_layout};
use std::borrow::Cow;
use std::collections::BTreeSet;
use std::path::PathBuf;

/// Decoded terrain that is kept while the ground at the corners of cells is asked for, bytes.
const GROUND_BYTES_MAX: u64 = 16 << 20;
/// Sides that are tried, as shares of the region's, each less than the one before by √2: a quarter of it to a thirty-second.
const SHARES: std::ops::RangeInclusive<i32> = 0..=6;
const FIRST_SHARE: f64 = 0.25;
/// No side is tried below this, metres.
const SIDE_MIN_M: f64 = 10.0;
/// Cells of each band that a point of the curve is made of, with the neighbours to the east, to the north and above.
const SAMPLES_PER_BAND: usize = 128;
/// The same where pictures are taken for them.
const SEEN_SAMPLES_PER_BAND: usize = 2;

#[derive(Debug, thiserror::Error)]
pub enum BuildError {
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error(transparent)]
    Layout(#[from] LayoutError),
    #[error("stopped; no layout was written")]
    Stopped,
    #[error("{0}")]
    Witness(String),
    #[error(
        "cells of {side_m} m would be {cells:.0}, more than the {CELLS_MAX} that a layout may have: take a larger side, or a smaller region"
    )]
    TooManyCells { side_m: f64, cells: f64 },
}

/// How far a build is: stage, done, of all; `false` stops it.
pub type Progress<'p> = dyn Fn(&str, usize, usize) -> bool + Sync + 'p;

/// A layout to be made of a world in a folder, whose index must be whole.
pub struct Builder<'w> {
    pub world: &'w World,
    pub name: String,
    pub params: LayoutParams,
    pub region: GeoBounds,
    /// Heights above ground at which bands end, ascending, metres.
    pub bands_m: Vec<f64>,
    pub storage: StorageModel,
    pub max_redundancy: f64,
    /// Chosen by hand; else by the curve.
    pub side_m: Option<f64>,
    /// Where flights begin: the cells there get a run of all of their set.
    pub starts: Vec<Geodetic>,
}

/// What became of it.
#[derive(Clone, Debug)]
pub struct Built {
    pub curve: Vec<CurvePoint>,
    /// Of the layout itself, exactly; `None` where none was written.
    pub point: Option<CurvePoint>,
    pub verdict: Option<Verdict>,
    /// The least redundancy that was found, where the limit cannot be met.
    pub least_redundancy: Option<f64>,
    /// What crossings take on each kind of storage, at the side that was taken.
    pub by_storage: Vec<ByStorage>,
    pub hidden: Hidden,
    pub file: Option<PathBuf>,
    pub file_bytes: u64,
    /// That it takes in memory when it is flown by.
    pub head_bytes: u64,
    pub entries: usize,
}

/// Crossings on a kind of storage, from a layout and from the linear orders.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct ByStorage {
    pub storage: &'static str,
    pub layout: Delays,
    pub packs: Delays,
    pub hilbert: Delays,
    pub verdict: Verdict,
}

/// Crossings of a draft on each kind of storage.
fn by_storage(draft: &Draft) -> Vec<ByStorage> {
    let (crossings, pages) = (crossings(draft), draft.pages.list());
    let (packs, hilbert) = (LinearOrder::packs(pages), hilbert_order(pages));
    let on = |storage: StorageModel| {
        let [layout, packs, hilbert] = [From::Layout, From::Linear(&packs), From::Linear(&hilbert)]
            .map(|from| crossing_delays(&crossings, from, storage));
        ByStorage { storage: storage.name, layout, packs, hilbert, verdict: verdict(&layout, &packs) }
    };
    StorageModel::ALL.map(on).into()
}

impl Builder<'_> {
    /// Chooses the side, finds the sets, and writes the file. Nothing is written where a layout of no side is within the
    /// limit, or where none pays; a side that was given by hand is taken whatever it costs.
    pub fn build(&self, witness: &mut Option<Box<dyn Witness>>, progress: &Progress<'_>) -> Result<Built, BuildError> {
        let mut built = Built {
            curve: Vec::new(),
            point: None,
            verdict: None,
            least_redundancy: None,
            by_storage: Vec::new(),
            hidden: Hidden::default(),
            file: None,
            file_bytes: 0,
            head_bytes: 0,
            entries: 0,
        };
        let mut sides_m = match self.side_m {
            Some(side_m) => vec![side_m],
            None => {
                built.curve = self.curve(witness, progress)?;
                match choose(&built.curve, self.max_redundancy) {
                    Choice::At(at) => built.curve[..=at].iter().map(|point| point.side_m).collect(),
                    Choice::None { least_redundancy } => {
                        built.least_redundancy = Some(least_redundancy);
                        return Ok(built);
                    }
                }
            }
        };
        // A point of the curve may be a sample: where the whole is beyond the limit, the next larger side is taken.
        while let Some(side_m) = sides_m.pop() {
            let draft = self.draft(side_m, None, witness, progress)?;
            let point = self.point(&draft);
            built.least_redundancy = Some(built.least_redundancy.unwrap_or(f64::INFINITY).min(point.redundancy));
            if self.side_m.is_none() && point.redundancy > self.max_redundancy {
                continue;
            }
            let judged = verdict(&point.layout, &point.packs);
            (built.point, built.verdict, built.hidden) = (Some(point), Some(judged), draft.hidden);
            built.by_storage = by_storage(&draft);
            if self.side_m.is_some() || matches!(judged, Verdict::Pays { .. }) {
                self.write(&draft, &mut built)?;
            }
            return Ok(built);
        }
        Ok(built)
    }

    fn survey(&self) -> Survey<'_> {
        let index = self.world.index();
        let paged_index = index.bytes().directory as u64 + index.byte_len() as u64 > INDEX_RESIDENT_MAX_BYTES;
        Survey { index, params: self.params, paged_index }
    }

    /// What sides would cost, the largest first.
    pub fn curve(
        &self,
        witness: &mut Option<Box<dyn Witness>>,
        progress: &Progress<'_>,
    ) -> Result<Vec<CurvePoint>, BuildError> {
        let whole = NavGrid::new::<BuildError>(&self.region, 1e3, &self.bands_m, |_, _| Ok(0.0))?;
        let (south, west) = whole.place(0.0, 0.0);
        let high_m = (self.region.north_rad - south) / (whole.place(0.0, 1.0).0 - south) * 1e3;
        let wide_m = (self.region.east_rad - west) / (whole.place(1.0, 0.0).1 - west) * 1e3;
        let region_m = (high_m * wide_m).sqrt();
        let sides_m = SHARES.map(|step| region_m * FIRST_SHARE * 0.5f64.powf(f64::from(step) / 2.0));
        let mut curve = Vec::new();
        for side_m in sides_m.filter(|&side_m| side_m >= SIDE_MIN_M) {
            let samples = if witness.is_some() { SEEN_SAMPLES_PER_BAND } else { SAMPLES_PER_BAND };
            let draft = self.draft(side_m, Some(samples), witness, progress)?;
            curve.push(self.point(&draft));
        }
        Ok(curve)
    }

    /// The sets of all cells; of as many of each band as are to be looked at, and of their neighbours.
    pub fn draft(
        &self,
        side_m: f64,
        samples: Option<usize>,
        witness: &mut Option<Box<dyn Witness>>,
        progress: &Progress<'_>,
    ) -> Result<Draft, BuildError> {
        let bands = self.bands_m.len() - 1;
        let cells = NavGrid::cells_for(&self.region, side_m, bands);
        if cells > CELLS_MAX as f64 {
            return Err(BuildError::TooManyCells { side_m, cells });
        }
        let ground = GroundPages::new(GROUND_BYTES_MAX);
        let ground_m = |lat_rad, lon_rad| -> Result<f64, BuildError> {
            Ok(ground.height_m(self.world, lat_rad, lon_rad)?.unwrap_or(0.0))
        };
        let grid = NavGrid::new(&self.region, side_m, &self.bands_m, ground_m)?;
        let cells = match samples {
            Some(samples) => sampled(&grid, samples),
            None => grid.cells().collect(),
        };
        let stopped = std::sync::atomic::AtomicBool::new(false);
        let watched = |what: &str, done: usize, of: usize| {
            let goes_on = progress(&format!("{what} of cells of {side_m:.0} m"), done, of);
            stopped.fetch_or(!goes_on, std::sync::atomic::Ordering::Relaxed);
            goes_on
        };
        Draft::new(&self.survey(), grid, &cells, witness, &watched).map_err(|cause| {
            if stopped.load(std::sync::atomic::Ordering::Relaxed) {
                BuildError::Stopped
            } else {
                BuildError::Witness(cause)
            }
        })
    }

    /// What a draft costs.
    pub fn point(&self, draft: &Draft) -> CurvePoint {
        let crossed = crossings(draft);
        let runs: Vec<u64> = crossed.iter().map(Crossing::bytes).collect();
        let (count, bytes) = (runs.len() as u64, runs.iter().sum());
        let stored = runs.iter().map(|&run| layout_blocks(run) * crate::store::LAYOUT_BLOCK_BYTES).sum();
        let packs = LinearOrder::packs(draft.pages.list());
        let mean = |sum: u64| sum as f64 / count.max(1) as f64;
        let crossings = crossing_count(&draft.grid) as f64;
        let entries: u64 = self.entries(draft).iter().map(|(_, set)| draft.pages.bytes(set)).sum();
        let layout_bytes = mean(stored) * crossings + entries as f64;
        let focal_px = self.params.focal_px / self.params.tolerance_px;
        let run_bytes = lemmas(&classes(self.world.index(), &draft.pages, focal_px), draft.grid.side_m()).run_bytes;
        let distinct = draft.distinct_bytes().max(1) as f64;
        CurvePoint {
            side_m: draft.grid.side_m(),
            cells: draft.grid.cell_count() as u64,
            crossings: count,
            redundancy: layout_bytes / distinct,
            layout_bytes,
            run_bytes_mean: mean(bytes),
            run_bytes_max: runs.iter().max().copied().unwrap_or(0) as f64,
            set_bytes_max: draft
                .cells()
                .filter_map(|cell| draft.set(cell))
                .map(|set| draft.pages.bytes(set))
                .max()
                .unwrap_or(0) as f64,
            layout: crossing_delays(&crossed, From::Layout, self.storage),
            packs: crossing_delays(&crossed, From::Linear(&packs), self.storage),
            // Of a region with borders: as many crossings as it has, over the pages that it needs, those around it too.
            predicted: Prediction { redundancy: run_bytes * crossings / distinct, run_bytes },
        }
    }

    /// Cells with a run of all that they need.
    fn entries(&self, draft: &Draft) -> Vec<(usize, CellSet)> {
        let grid = &draft.grid;
        let mut cells: BTreeSet<usize> =
            self.starts.iter().filter_map(|&eye| grid.locate(eye)).map(|cell| grid.number(cell)).collect();
        if cells.is_empty() {
            let band = grid.bands() as u32 - 1;
            cells.insert(grid.number(NavCell { band, row: grid.rows() / 2, column: grid.columns() / 2 }));
        }
        cells.into_iter().filter_map(|number| Some((number, draft.set(grid.cell(number))?.clone()))).collect()
    }

    fn write(&self, draft: &Draft, built: &mut Built) -> Result<(), BuildError> {
        let grid = &draft.grid;
        let header =
            Header { params: self.params, grid: grid.clone(), curve: built.curve.clone(), hidden: draft.hidden };
        let mut assembly = Assembly::new(header, draft.pages.list());
        let empty = CellSet::new();
        let sets: Vec<&CellSet> = grid.cells().map(|cell| draft.set(cell).unwrap_or(&empty)).collect();
        sets.iter().for_each(|set| assembly.push_set(set));
        // In the order of the file; each as the cells that it is the difference of.
        let mut runs: Vec<(Option<usize>, usize)> = Vec::new();
        for (number, cell) in grid.cells().enumerate() {
            for direction in Direction::ALL {
                let Some(next) = grid.neighbor(cell, direction).map(|next| grid.number(next)) else { continue };
                let bytes = draft.pages.bytes(&difference(sets[next], sets[number]));
                if assembly.push_run(number, direction, bytes) {
                    runs.push((Some(number), next));
                }
            }
        }
        for (number, set) in self.entries(draft) {
            if assembly.push_entry(number, draft.pages.bytes(&set)) {
                runs.push((None, number));
                built.entries += 1;
            }
        }
        let layout = assembly.finish();
        built.head_bytes = layout.byte_len() as u64;
        let pages = |&(from, to): &(Option<usize>, usize)| -> Cow<'static, [(PageId, Place)]> {
            let numbers = from.map_or_else(|| sets[to].clone(), |from| difference(sets[to], sets[from]));
            Cow::Owned(numbers.into_iter().map(|number| draft.pages.get(number)).collect())
        };
        built.file_bytes = write_layout(self.world, &self.name, &layout.to_bytes()?, runs.iter().map(pages))?;
        built.file = Some(self.world.name().join("layouts").join(format!("{}.seek", self.name)));
        Ok(())
    }
}

/// What the crossings of a draft read.
fn crossings(draft: &Draft) -> Vec<Crossing> {
    let crossing = |(from, to)| {
        let run = draft.run(from, to).unwrap_or_default();
        Crossing { pages: run.into_iter().map(|number| draft.pages.get(number)).collect() }
    };
    draft.crossings().map(crossing).collect()
}

/// Crossings between adjacent cells of a grid, both ways.
fn crossing_count(grid: &NavGrid) -> u64 {
    let (columns, rows, bands) = (u64::from(grid.columns()), u64::from(grid.rows()), grid.bands() as u64);
    2 * (((columns - 1) * rows + columns * (rows - 1)) * bands + columns * rows * (bands - 1))
}

/// Cells spread evenly over each band, with their neighbours to the east, to the north and above; all where they are few.
fn sampled(grid: &NavGrid, per_band: usize) -> Vec<NavCell> {
    let in_band = grid.cell_count() / grid.bands();
    if in_band <= 3 * per_band {
        return grid.cells().collect();
    }
    let mut cells = BTreeSet::new();
    // Steps of the golden section spread over both columns and rows, whatever their numbers.
    let golden = |at: usize, share: f64, end: u32| ((at as f64 * share).fract() * f64::from(end)) as u32;
    for band in 0..grid.bands() as u32 {
        for at in 1..=per_band {
            let column = golden(at, 0.754_877_666_246_692_7, grid.columns());
            let row = golden(at, 0.569_840_290_998_053_3, grid.rows());
            let cell = NavCell { band, row, column };
            cells.insert(cell);
            let next = [Direction::East, Direction::North, Direction::Up];
            cells.extend(next.into_iter().filter_map(|direction| grid.neighbor(cell, direction)));
        }
    }
    cells.into_iter().collect()
}
