//! A world against the sources it was made of: does the drawn terrain keep its bounds, and how tight are they.

use super::against_buildings::{self, BuildingsReport};
use super::against_reps::RepReport;
use super::terrain;
use super::{Elevation, OnProgress, PrepareError, Progress, Recipe};
use crate::content::{Page, PageId, PageKind, TerrainPage};
use crate::forest::CellId;
use crate::forest::index::Node;
use crate::store::{StoreError, World};
use crate::units::ByteSize;
use rayon::prelude::*;
use serde::Serialize;
use std::collections::HashMap;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

/// Posts taken of one finest cell.
const POSTS_PER_CELL: usize = 32;
/// Vertices of the mesh taken beside them.
const VERTICES_PER_CELL: usize = 4;
/// Cells measured whole for tightness, and the most source posts that such a cell may hold.
const WHOLE_CELLS: usize = 1000;
const WHOLE_POSTS_MAX: f64 = 2e7;
/// Bounds are tight where the measured error is at least this part.
const TIGHT: f64 = 0.5;
/// Heights count as land above and below this, metres.
const SEA_M: f64 = 1e-3;
/// Pages of cells at levels up to this are kept.
const KEPT_LEVELS: u8 = 4;

#[derive(Debug, thiserror::Error)]
pub enum AgainstError {
    #[error(transparent)]
    Source(#[from] PrepareError),
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error("the world has no terrain to compare; prepare it with [[elevation]]")]
    NoTerrain,
}

/// A place where what is drawn is further from the truth than its cell declares.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Violation {
    pub cell: String,
    pub lat_deg: f64,
    pub lon_deg: f64,
    pub truth_m: f64,
    pub drawn_m: f64,
    pub error_m: f64,
}

/// All comparisons with cells of one level.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct LevelReport {
    pub level: u8,
    pub comparisons: u64,
    pub violations: u64,
    /// Largest |drawn − truth| ÷ `error_m`.
    pub worst_ratio: f64,
}

/// Measured error ÷ declared error of cells all of whose source posts were visited.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Tightness {
    pub land_cells: u64,
    /// Those whose bound is at most twice what was measured.
    pub tight_cells: u64,
    /// `tight_cells` ÷ `land_cells`; 0 without land.
    pub tight_share: f64,
    pub median_ratio: f64,
    pub worst_ratio: f64,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct AgainstReport {
    /// Places compared.
    pub samples: u64,
    /// Places × the cells over each, from the zone's root to the finest.
    pub comparisons: u64,
    pub violations: u64,
    /// The first few.
    pub examples: Vec<Violation>,
    /// Largest |drawn − truth| of finest cells, metres, and their mean.
    pub finest_worst_m: f64,
    pub finest_mean_m: f64,
    pub levels: Vec<LevelReport>,
    pub tightness: Tightness,
    /// The finest rep of each collection.
    pub buildings: Vec<BuildingsReport>,
    /// The coarser ones.
    pub reps: Vec<RepReport>,
}

const EXAMPLES_MAX: usize = 10;
const ROUNDS_MAX: u32 = 32;

/// Compares at about `samples` random source posts and mesh vertices; the same seed takes the same ones.
pub fn check_against(
    world: &World,
    recipe: &Recipe,
    root: Option<&Path>,
    samples: u64,
    seed: u64,
    on_progress: OnProgress<'_>,
) -> Result<AgainstReport, AgainstError> {
    let root = root.unwrap_or(recipe.root());
    let elevation = Elevation::open(recipe, root, ByteSize(1 << 30), on_progress)?;
    let cells: Vec<CellId> = world
        .index()
        .trees()
        .flat_map(|tree| tree.nodes())
        .filter(|node| node.terrain().is_some())
        .map(|node| node.cell())
        .collect();
    let is_leaf = |&cell: &CellId| {
        world.index().find(cell).is_some_and(|node| node.children().all(|child| child.terrain().is_none()))
    };
    let leaves: Vec<CellId> = cells.iter().copied().filter(is_leaf).collect();
    if leaves.is_empty() {
        return Err(AgainstError::NoTerrain);
    }
    let checker = Checker { world, elevation: &elevation, kept: Mutex::default() };
    let picks_of = |samples: u64| samples.div_ceil((POSTS_PER_CELL + VERTICES_PER_CELL) as u64);
    let done = AtomicU64::new(0);
    let total = picks_of(samples) + WHOLE_CELLS as u64;
    let count = || {
        let done = done.fetch_add(1, Ordering::Relaxed) + 1;
        on_progress(Progress { stage: "compare", item: "terrain", done, total: total.max(done) });
    };
    let mut sum = Part::default();
    let mut first = 0;
    // Cells with few posts give fewer samples than asked for: more cells are taken.
    for _ in 0..ROUNDS_MAX {
        let picks = picks_of(samples.saturating_sub(sum.samples));
        let parts: Vec<Part> = (first..first + picks)
            .into_par_iter()
            .map(|pick| {
                count();
                let mut random = Random::new(seed, pick);
                checker.compare(leaves[random.below(leaves.len())], &mut random)
            })
            .collect::<Result<_, _>>()?;
        sum = parts.into_iter().fold(sum, Part::merge);
        first += picks;
    }
    let mut report = sum.report();
    let mut random = Random::new(seed, u64::MAX);
    let wholes: Vec<CellId> = (0..WHOLE_CELLS).map(|_| cells[random.below(cells.len())]).collect();
    let ratios: Vec<Option<f64>> = wholes
        .par_iter()
        .map(|&cell| {
            count();
            checker.whole(cell)
        })
        .collect::<Result<_, _>>()?;
    report.tightness = tightness(ratios.into_iter().flatten().collect());
    (report.buildings, report.reps) = against_buildings::compare(world, recipe, root, &elevation, on_progress)?;
    Ok(report)
}

fn tightness(mut ratios: Vec<f64>) -> Tightness {
    ratios.sort_unstable_by(f64::total_cmp);
    let tight = ratios.iter().filter(|&&ratio| ratio >= TIGHT).count();
    Tightness {
        land_cells: ratios.len() as u64,
        tight_cells: tight as u64,
        tight_share: if ratios.is_empty() { 0.0 } else { tight as f64 / ratios.len() as f64 },
        median_ratio: ratios.get(ratios.len() / 2).copied().unwrap_or(0.0),
        worst_ratio: ratios.last().copied().unwrap_or(0.0),
    }
}

/// Counts of some of the comparisons.
#[derive(Default)]
struct Part {
    samples: u64,
    examples: Vec<Violation>,
    finest_worst_m: f64,
    finest_sum_m: f64,
    levels: Vec<LevelReport>,
}

impl Part {
    fn level(&mut self, level: u8) -> &mut LevelReport {
        while self.levels.len() <= usize::from(level) {
            self.levels.push(LevelReport { level: self.levels.len() as u8, ..LevelReport::default() });
        }
        &mut self.levels[usize::from(level)]
    }

    /// One comparison.
    fn add(&mut self, page: &TerrainPage, (lat_rad, lon_rad, truth_m): Place, drawn_m: f64, is_finest: bool) {
        let (miss_m, error_m) = ((drawn_m - truth_m).abs(), f64::from(page.error_m));
        if is_finest {
            self.samples += 1;
            self.finest_worst_m = self.finest_worst_m.max(miss_m);
            self.finest_sum_m += miss_m;
        }
        let level = self.level(page.cell.level());
        level.comparisons += 1;
        level.worst_ratio = level.worst_ratio.max(miss_m / error_m.max(1e-9));
        if miss_m > error_m {
            level.violations += 1;
            self.examples.push(Violation {
                cell: page.cell.to_string(),
                lat_deg: lat_rad.to_degrees(),
                lon_deg: lon_rad.to_degrees(),
                truth_m,
                drawn_m,
                error_m,
            });
        }
    }

    fn merge(mut self, other: Self) -> Self {
        self.samples += other.samples;
        self.finest_worst_m = self.finest_worst_m.max(other.finest_worst_m);
        self.finest_sum_m += other.finest_sum_m;
        for theirs in other.levels {
            let ours = self.level(theirs.level);
            ours.comparisons += theirs.comparisons;
            ours.violations += theirs.violations;
            ours.worst_ratio = ours.worst_ratio.max(theirs.worst_ratio);
        }
        self.examples.extend(other.examples);
        self.examples.truncate(EXAMPLES_MAX);
        self
    }

    fn report(self) -> AgainstReport {
        AgainstReport {
            samples: self.samples,
            comparisons: self.levels.iter().map(|level| level.comparisons).sum(),
            violations: self.levels.iter().map(|level| level.violations).sum(),
            examples: self.examples,
            finest_worst_m: self.finest_worst_m,
            finest_mean_m: self.finest_sum_m / (self.samples.max(1) as f64),
            levels: self.levels,
            tightness: Tightness::default(),
            buildings: Vec::new(),
            reps: Vec::new(),
        }
    }
}

struct Checker<'a> {
    world: &'a World,
    elevation: &'a Elevation,
    kept: Mutex<HashMap<CellId, Arc<TerrainPage>>>,
}

/// Latitude and longitude in radians, truth in metres.
type Place = (f64, f64, f64);

impl Checker<'_> {
    /// Random posts of a finest cell against it and all cells above.
    fn compare(&self, leaf: CellId, random: &mut Random) -> Result<Part, AgainstError> {
        let mut part = Part::default();
        let posts = self.random_posts(leaf, random);
        for cell in leaf.ancestors() {
            if self.world.index().find(cell).and_then(|node| node.terrain()).is_none() {
                continue;
            }
            let page = self.page(cell)?;
            let surface = page.surface(1.0);
            // Bounds hold at source posts and at a mesh's own vertices, not at those of finer meshes.
            let vertices = (0..VERTICES_PER_CELL).map(|_| self.vertex(&page, random));
            for (lat_rad, lon_rad, truth_m) in posts.iter().copied().chain(vertices) {
                if let Some(drawn_m) = surface.height_m(lat_rad, lon_rad) {
                    part.add(&page, (lat_rad, lon_rad, truth_m), drawn_m, cell == leaf);
                }
            }
        }
        part.examples.truncate(EXAMPLES_MAX);
        Ok(part)
    }

    /// A reservoir of the posts in a cell.
    fn random_posts(&self, cell: CellId, random: &mut Random) -> Vec<Place> {
        let mut places: Vec<Place> = Vec::with_capacity(POSTS_PER_CELL);
        let mut seen = 0;
        self.elevation.for_each_post(&cell.bounds(), &mut |lat_rad, lon_rad, truth_m| {
            seen += 1;
            if places.len() < POSTS_PER_CELL {
                places.push((lat_rad, lon_rad, truth_m));
            } else if let Some(place) = places.get_mut(random.below(seen)) {
                *place = (lat_rad, lon_rad, truth_m);
            }
        });
        places
    }

    fn vertex(&self, page: &TerrainPage, random: &mut Random) -> Place {
        let post = &page.posts[random.below(page.posts.len())];
        let place = page.cell.bounds().at(f64::from(post.column) / 64.0, f64::from(post.row) / 64.0, 0.0);
        (place.lat_rad, place.lon_rad, self.elevation.height_m(place.lat_rad, place.lon_rad))
    }

    /// Measured ÷ declared error over all source posts of a cell; `None` for the sea and for cells with too many.
    fn whole(&self, cell: CellId) -> Result<Option<f64>, AgainstError> {
        let bounds = cell.bounds();
        let per_side = self.elevation.finest_spacing_rad(&bounds).map_or(0.0, |spacing| bounds.height_rad() / spacing);
        if per_side * per_side > WHOLE_POSTS_MAX {
            return Ok(None);
        }
        let page = self.page(cell)?;
        if page.posts.iter().all(|post| f64::from(post.height_m).abs() < SEA_M) {
            return Ok(None);
        }
        let measured_m = terrain::deviation_m(self.elevation, &page);
        Ok(Some(measured_m / f64::from(page.error_m).max(1e-9)))
    }

    fn page(&self, cell: CellId) -> Result<Arc<TerrainPage>, AgainstError> {
        let kept = |cell| self.kept.lock().ok().and_then(|kept| kept.get(&cell).cloned());
        if let Some(page) = kept(cell) {
            return Ok(page);
        }
        let page = read_terrain(self.world, cell)?;
        if cell.level() <= KEPT_LEVELS
            && let Ok(mut kept) = self.kept.lock()
        {
            kept.insert(cell, Arc::clone(&page));
        }
        Ok(page)
    }
}

fn read_terrain(world: &World, cell: CellId) -> Result<Arc<TerrainPage>, AgainstError> {
    let node: Option<Node> = world.index().find(cell);
    let entry = node.and_then(|node| node.terrain()).ok_or(AgainstError::NoTerrain)?;
    let id = PageId { cell, kind: PageKind::Terrain };
    let bytes = world.read(id, entry.place)?;
    match world.decode(id, entry.place, &bytes)? {
        Page::Terrain(page) => Ok(page),
        _ => Err(AgainstError::NoTerrain),
    }
}

/// SplitMix64 (Steele, Lea, Flood 2014).
struct Random(u64);

impl Random {
    fn new(seed: u64, stream: u64) -> Self {
        let mut random = Self(seed ^ stream.wrapping_mul(0xd1b5_4a32_d192_ed03));
        random.next();
        random
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// 0 to `limit` − 1; `limit` above 0. The bias of the multiplication is below 2⁻³².
    fn below(&mut self, limit: usize) -> usize {
        ((u128::from(self.next()) * limit as u128) >> 64) as usize
    }
}
