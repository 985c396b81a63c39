//! The terrain cells of a zone: which there are, which posts each uses, and how far what it draws is from the truth.
//!
//! Four passes over the tree, since a cell must know its children's errors to choose its target, its parent's posts
//! to keep them, and its final mesh to measure it:
//! 1. down: which cells exist, and the error of each with all posts in use;
//! 2. up: the target of each, and which triangles miss it;
//! 3. down: the posts in use, the parent's among them;
//! 4. up: the error of what is drawn, never less than the children's.

use super::measure::{Drawn, Flags, Positions};
use super::page::{self, quantized};
use super::truth::{Posts, Samples, Truth, post_index};
use crate::content::rtin::{Active, Diagonal};
use crate::content::{POSTS, TerrainPage, border_posts};
use crate::forest::{CellId, LEVEL_MAX, Zone};
use crate::prepare::task::{Stopped, Task};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Relaxation of the target over the error with all posts in use.
const SLACK: f64 = 1.25;
/// A cell with children need not be better than this part of its height.
const PARTS_OF_HEIGHT: f64 = 2048.0;
/// Chords on the border may leave their parallel by this part of the target, along the ground.
const CHORD_SHARE: f64 = 0.5;
/// Errors well below the target are declared anew with this margin, for the quantization changes with them,
const TIGHTER: f64 = 1.07;
/// where that gains at least this.
const WORTH_IT: f64 = 0.9;
/// Errors are declared with this margin, which stands for the rounding of decoded f32 heights.
const ROUNDING_M: f64 = 1e-3;

/// What is known of a terrain cell.
#[derive(Clone, Debug)]
pub struct CellPlan {
    pub active: Active,
    /// Of what is drawn, metres; never less than the children's. Heights are multiples of a step that follows from it.
    pub error_m: f32,
}

/// The terrain of a zone.
pub type ZonePlan = BTreeMap<CellId, CellPlan>;

/// Everything that the passes read.
pub struct Terrain<'a> {
    pub truth: &'a dyn Truth,
    pub task: &'a Task<'a>,
}

/// A cell on the way: its target and what misses it.
struct Draft {
    target_m: f64,
    exceeding: Flags,
}

impl Terrain<'_> {
    /// The plan of a zone.
    pub fn plan(&self, zone: Zone) -> Result<ZonePlan, Stopped> {
        let levels = self.grow(zone)?;
        let drafts = self.draft(&levels)?;
        let active = self.choose(&levels, &drafts)?;
        self.measure(&levels, &drafts, active)
    }

    /// Pass 1.
    fn grow(&self, zone: Zone) -> Result<Vec<Vec<(CellId, f64)>>, Stopped> {
        let mut levels = Vec::new();
        let mut cells = vec![zone.root()];
        while !cells.is_empty() {
            let level = self.for_each(&cells, |&cell| {
                let posts = Posts::of(self.truth, cell);
                let positions = Positions::new(cell, Diagonal::of(cell), &posts.heights_m);
                (cell, positions.full_deviation_m(&Samples::new(self.truth, cell, &posts)))
            })?;
            cells = level
                .iter()
                .filter(|(cell, error_m)| self.is_refined(*cell, *error_m))
                .flat_map(|(cell, _)| cell.children())
                .collect();
            levels.push(level);
        }
        Ok(levels)
    }

    fn is_refined(&self, cell: CellId, full_error_m: f64) -> bool {
        let bounds = cell.bounds();
        let Some(finest) = self.truth.finest_spacing_rad(&bounds).filter(|_| cell.level() < LEVEL_MAX) else {
            return false;
        };
        let goals = self.truth.goals(&bounds);
        // A hair of slack: spacings that are powers of two apart are computed by different ways.
        let spacing = bounds.height_rad() / (POSTS - 1) as f64 * (1.0 - 1e-6);
        let once_more = spacing * 2.0 > finest && goals.finest_error_m.is_some_and(|limit| full_error_m > limit);
        full_error_m > goals.prune_error_m && (spacing > finest || once_more)
    }

    /// Pass 2.
    fn draft(&self, levels: &[Vec<(CellId, f64)>]) -> Result<BTreeMap<CellId, Draft>, Stopped> {
        let mut drafts: BTreeMap<CellId, Draft> = BTreeMap::new();
        for level in levels.iter().rev() {
            let done = self.for_each(level, |&(cell, full_error_m)| {
                let target_m = self.target_m(cell, full_error_m, &drafts);
                let posts = Posts::of(self.truth, cell);
                let heights = quantized(&posts.heights_m, round_up(target_m));
                let samples = Samples::new(self.truth, cell, &posts);
                let exceeding = Positions::new(cell, Diagonal::of(cell), &heights).exceeding(target_m, &samples);
                (cell, Draft { target_m, exceeding })
            })?;
            drafts.extend(done);
        }
        Ok(drafts)
    }

    fn target_m(&self, cell: CellId, full_error_m: f64, drafts: &BTreeMap<CellId, Draft>) -> f64 {
        let children = cell.children().filter_map(|child| drafts.get(&child)).map(|child| child.target_m);
        let floor_m = match children.reduce(f64::max) {
            Some(worst_m) => worst_m.max(cell.sides_m().height_m / PARTS_OF_HEIGHT),
            None => self.truth.goals(&cell.bounds()).prune_error_m,
        };
        floor_m.max(SLACK * full_error_m)
    }

    /// Pass 3.
    fn choose(
        &self,
        levels: &[Vec<(CellId, f64)>],
        drafts: &BTreeMap<CellId, Draft>,
    ) -> Result<BTreeMap<CellId, Active>, Stopped> {
        let mut chosen: BTreeMap<CellId, Active> = BTreeMap::new();
        for level in levels {
            let done = self.for_each(level, |&(cell, _)| {
                let parent = cell.parent().and_then(|parent| chosen.get(&parent));
                let Draft { target_m, exceeding } = &drafts[&cell];
                let mut kept = parent.map_or_else(Active::corners, |parent| inherited(cell, parent));
                kept.extend(&border_posts(cell, target_m * CHORD_SHARE));
                (cell, kept.refine(Diagonal::of(cell), &|triangle| exceeding.get(triangle.index())))
            })?;
            chosen.extend(done);
        }
        Ok(chosen)
    }

    /// Pass 4.
    fn measure(
        &self,
        levels: &[Vec<(CellId, f64)>],
        drafts: &BTreeMap<CellId, Draft>,
        mut active: BTreeMap<CellId, Active>,
    ) -> Result<ZonePlan, Stopped> {
        let mut plan = ZonePlan::new();
        for level in levels.iter().rev() {
            let done = self.for_each(level, |&(cell, _)| {
                let children = cell.children().filter_map(|child| plan.get(&child));
                let least_m = children.map(|child| f64::from(child.error_m)).fold(0.0, f64::max);
                (cell, self.declared_m(cell, &active[&cell], drafts[&cell].target_m, least_m))
            })?;
            for (cell, error_m) in done {
                if let Some(active) = active.remove(&cell) {
                    plan.insert(cell, CellPlan { active, error_m });
                }
            }
        }
        Ok(plan)
    }

    /// The error that a cell declares: its quantization step follows from it, and what is drawn with that step keeps it.
    fn declared_m(&self, cell: CellId, active: &Active, target_m: f64, least_m: f64) -> f32 {
        let diagonal = Diagonal::of(cell);
        let posts = Posts::of(self.truth, cell);
        let samples = Samples::new(self.truth, cell, &posts);
        let drawn = Drawn::of(diagonal, active);
        let measured_m = |declared_m: f32| {
            let heights = quantized(&posts.heights_m, declared_m);
            let page = page::bare(cell, active, &heights);
            let positions = Positions::new(cell, diagonal, &heights);
            positions.surface_deviation_m(&drawn, &page, &samples) + ROUNDING_M
        };
        let mut declared = round_up(target_m.max(least_m));
        let mut error_m = measured_m(declared);
        while error_m > f64::from(declared) {
            declared = round_up(error_m * TIGHTER);
            error_m = measured_m(declared);
        }
        // Forced posts and loose targets leave errors well below the target: declare what is near the truth.
        for _ in 0..2 {
            let tighter = round_up((error_m * TIGHTER).max(least_m));
            if f64::from(tighter) > WORTH_IT * f64::from(declared) {
                break;
            }
            let tighter_error_m = measured_m(tighter);
            if tighter_error_m > f64::from(tighter) {
                break;
            }
            (declared, error_m) = (tighter, tighter_error_m);
        }
        declared
    }

    fn for_each<I: Sync, O: Send>(&self, items: &[I], work: impl Fn(&I) -> O + Sync + Send) -> Result<Vec<O>, Stopped> {
        items.par_iter().map(|item| self.task.step().map(|()| work(item))).collect()
    }
}

/// The largest vertical distance between a page's surface and the truth, over all source posts in its cell and its
/// own 65 × 65 posts; metres.
pub fn deviation_m(truth: &dyn Truth, page: &TerrainPage) -> f64 {
    let posts = Posts::of(truth, page.cell);
    let mut heights = posts.heights_m.clone();
    for post in &page.posts {
        heights[post_index(post.column.into(), post.row.into())] = f64::from(post.height_m);
    }
    let drawn = Drawn::of(page.diagonal, &page.active());
    let positions = Positions::new(page.cell, page.diagonal, &heights);
    positions.surface_deviation_m(&drawn, page, &Samples::new(truth, page.cell, &posts))
}

/// The next f32 that is not below.
fn round_up(metres: f64) -> f32 {
    let near = metres as f32;
    if f64::from(near) < metres { near.next_up() } else { near }
}

/// The parent's posts in a child that has its share of the parent's bintree; none where the row is thinned.
fn inherited(cell: CellId, parent: &Active) -> Active {
    let mut active = Active::corners();
    let (Some(quadrant), Some(above)) = (cell.quadrant(), cell.parent()) else {
        return active;
    };
    if above.child_row_is_thinned(quadrant.is_north()) {
        return active;
    }
    let half = (POSTS / 2) as u8;
    let (west, south) = (half * u8::from(quadrant.is_east()), half * u8::from(quadrant.is_north()));
    for (column, row) in parent.posts() {
        if (west..=west + half).contains(&column) && (south..=south + half).contains(&row) {
            active.insert(((column - west) * 2, (row - south) * 2));
        }
    }
    active
}
