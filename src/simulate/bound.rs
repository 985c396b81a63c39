//! The debt that no policy can fall below (design: lower bound of debt).
//!
//! At a time no more bytes can have come than the storage model gives, and no more decoded bytes can be held than the
//! footprint takes. Within each of the two the best front is sought, with more freedom than any policy has: pages may be
//! held in parts, and the bytes of a page are shared among the regions of the view under it, by their weights. For any
//! set of pages that is really held, each region is served by its finest page; the shares of those pages' bytes that
//! fall to the regions sum up to no more than the pages' bytes. So the best choice of one page for each region, within
//! the sum of such shares, is no worse than any real one, and where pages may be held in parts, that choice is the
//! fractional multiple-choice knapsack: along the convex hull of each region, by the fall of debt per byte (Sinha &
//! Zoltners 1979, §2). The larger of the two bounds is the bound.

use crate::camera::View;
use crate::cells::LiveTree;
use crate::content::{PageId, PageKind};
use crate::forest::index::{IndexForest, Node};
use crate::paging::least_held_bytes;
use crate::select::{FrontRegion, LAYERS, STAND_IN_LEVELS, SelectParams, layer_of, survey};
use crate::storage::{REQUEST_BYTES_MAX, StorageModel};
use std::collections::HashMap;

/// Bytes that a model can have given by a time since its first request, seconds.
pub fn bytes_by(storage: &StorageModel, since_s: f64) -> f64 {
    let by_rate = storage.bytes_per_sec * (since_s - storage.latency_secs).max(0.0);
    if storage.seek_only || storage.latency_secs <= 0.0 {
        // One long run pays one latency.
        return by_rate;
    }
    // A rounding error must not take a turn away.
    let turns = (since_s / storage.latency_secs + 1e-9).floor();
    by_rate.min(storage.parallel as f64 * REQUEST_BYTES_MAX as f64 * turns)
}

/// What a policy has at most at a moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Budget {
    /// Stored bytes that can have come beside the pinned pages.
    pub read_bytes: f64,
    /// Decoded bytes that can be held.
    pub held_bytes: u64,
}

/// A way to lower the debt: so many bytes for so many pixels of debt.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Step {
    bytes: f64,
    fall_px: f64,
}

/// The least debt of a view by bytes: convex, falling.
#[derive(Clone, Debug, Default)]
struct Curve {
    /// Debt with all pages, px.
    least_px: f64,
    /// By falling ratio.
    steps: Vec<Step>,
    /// Debt before each step, px. Summed up from the last one, so that large falls leave no rounding errors behind.
    before_px: Vec<f64>,
}

impl Curve {
    fn debt_px(&self, bytes: f64) -> f64 {
        let mut left = bytes.max(0.0);
        for (at, (step, before_px)) in self.steps.iter().zip(&self.before_px).enumerate() {
            if step.bytes > left {
                let after_px = self.before_px.get(at + 1).unwrap_or(&self.least_px);
                let share = left / step.bytes;
                return share * after_px + (1.0 - share) * before_px;
            }
            left -= step.bytes;
        }
        self.least_px
    }
}

/// Least debts of one view.
#[derive(Clone, Debug, Default)]
pub struct FrameBound {
    read: Curve,
    held: Curve,
}

/// A page that would leave an excess in a region.
struct Choice {
    /// `None`: nothing but the region itself would pay for it.
    page: Option<PageId>,
    stored_bytes: f64,
    held_bytes: f64,
    left_px: f64,
}

/// A layer of a region, with its choices, coarse to fine.
struct Region {
    layer: usize,
    share: f64,
    most_px: f64,
    choices: Vec<Choice>,
}

impl FrameBound {
    /// Of a view at the tolerance asked for. `index` must be whole.
    pub fn new(index: &IndexForest, view: &View, params: &SelectParams) -> Self {
        let regions = regions(index, view, params);
        let mut shares = [0.0; LAYERS];
        let mut served: HashMap<PageId, f64> = HashMap::new();
        for region in &regions {
            shares[region.layer] += region.share;
            for page in region.choices.iter().filter_map(|choice| choice.page) {
                *served.entry(page).or_default() += region.share;
            }
        }
        let mut bound = Self::default();
        for region in regions.iter().filter(|region| region.share > 0.0) {
            let weight = region.share / shares[region.layer];
            let part = |choice: &Choice| choice.page.map_or(1.0, |page| region.share / served[&page]);
            let points = |bytes: fn(&Choice) -> f64| {
                region.choices.iter().map(move |choice| (part(choice) * bytes(choice), choice.left_px))
            };
            bound.read.add(weight, region.most_px, points(|choice| choice.stored_bytes));
            bound.held.add(weight, region.most_px, points(|choice| choice.held_bytes));
        }
        bound.read.finish();
        bound.held.finish();
        bound
    }

    /// The debt that no policy can fall below within a budget, px.
    pub fn debt_px(&self, budget: &Budget) -> f64 {
        self.read.debt_px(budget.read_bytes).max(self.held.debt_px(budget.held_bytes as f64))
    }
}

impl Curve {
    /// Adds a region: its debt without anything, and for each choice its bytes and the excess it leaves.
    fn add(&mut self, weight: f64, most_px: f64, points: impl Iterator<Item = (f64, f64)>) {
        let mut points: Vec<(f64, f64)> = points.collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
        let hull = convex_hull(most_px, &points);
        self.least_px += weight * hull.last().map_or(most_px, |(_, to)| to.1);
        for (from, to) in hull {
            self.steps.push(Step { bytes: to.0 - from.0, fall_px: weight * (from.1 - to.1) });
        }
    }

    fn finish(&mut self) {
        let ratio = |step: &Step| step.fall_px / step.bytes.max(1e-9);
        self.steps.sort_by(|a, b| ratio(b).total_cmp(&ratio(a)));
        let mut debt_px = self.least_px;
        self.before_px = self
            .steps
            .iter()
            .rev()
            .map(|step| {
                debt_px += step.fall_px;
                debt_px
            })
            .collect();
        self.before_px.reverse();
    }
}

/// The lower convex hull of points (bytes, excess), from (0, `most_px`) down: its edges from left to right. `points` are
/// ascending by bytes.
fn convex_hull(most_px: f64, points: &[(f64, f64)]) -> Vec<((f64, f64), (f64, f64))> {
    let mut hull = vec![(0.0, most_px)];
    for &point in points {
        if hull.last().is_some_and(|last| point.1 >= last.1) {
            continue;
        }
        while let [.., before, last] = hull[..]
            && (last.1 - before.1) * (point.0 - before.0) >= (point.1 - before.1) * (last.0 - before.0)
        {
            hull.pop();
        }
        hull.push(point);
    }
    hull.windows(2).map(|pair| (pair[0], pair[1])).collect()
}

/// The view's regions with all that could serve them; pinned pages cost nothing.
fn regions(index: &IndexForest, view: &View, params: &SelectParams) -> Vec<Region> {
    let mut covers: HashMap<PageId, (f64, f64)> = HashMap::new();
    let mut regions = Vec::new();
    survey(index, &LiveTree::default(), view, params, params.tolerance_px, |region| {
        if let Some(layer) = layer_of(region.kind) {
            regions.push(choices(index, region, layer, params.tolerance_px, &mut covers));
        }
    });
    regions
}

fn choices(
    index: &IndexForest,
    region: &FrontRegion<'_>,
    layer: usize,
    asked_px: f64,
    covers: &mut HashMap<PageId, (f64, f64)>,
) -> Region {
    let excess_px = |at: Option<usize>| region.excess_px(region.error_px(at), asked_px);
    let is_layer = matches!(region.kind, PageKind::Terrain | PageKind::Imagery);
    let pinned = usize::from(region.kind == PageKind::Terrain);
    let mut choices: Vec<Choice> = (pinned..region.chain.len())
        .map(|at| {
            let rep = &region.chain[at];
            Choice {
                page: Some(rep.page()),
                stored_bytes: f64::from(rep.place.len),
                held_bytes: least_held_bytes(rep.kind, rep.place) as f64,
                left_px: excess_px(Some(at)),
            }
        })
        .collect();
    if is_layer && let Some(node) = index.find(region.cell) {
        let (stored_bytes, held_bytes) = cover(&node, region.kind, STAND_IN_LEVELS, covers);
        if stored_bytes.is_finite() {
            choices.push(Choice { page: None, stored_bytes, held_bytes, left_px: excess_px(Some(region.front)) });
        }
    }
    choices.extend(finer_objects(index, region, excess_px(Some(region.front))));
    let most_px = excess_px((pinned > 0).then_some(0));
    Region { layer, share: region.share, most_px, choices }
}

/// Finer pages in the place of groups: all of them together are at least as large as the smallest at the region's own
/// cell, since one of those is always among them.
fn finer_objects(index: &IndexForest, region: &FrontRegion<'_>, left_px: f64) -> Option<Choice> {
    let PageKind::Objects { collection, .. } = region.kind else { return None };
    let is_in_chain = |rep: u8| {
        let kind = PageKind::Objects { collection, rep };
        region.chain.iter().any(|known| known.page() == PageId { cell: region.cell, kind })
    };
    let node = index.find(region.cell)?;
    let entries = node.objects().filter(|entry| entry.collection == collection && !is_in_chain(entry.rep));
    let place = entries.map(|entry| entry.place).min_by_key(|place| place.len)?;
    let held_bytes = least_held_bytes(region.kind, place) as f64;
    Some(Choice { page: None, stored_bytes: f64::from(place.len), held_bytes, left_px })
}

/// The fewest bytes, stored and held, of pages below a node that cover all of it; infinite where none do.
fn cover(node: &Node<'_>, kind: PageKind, levels: u8, known: &mut HashMap<PageId, (f64, f64)>) -> (f64, f64) {
    let id = PageId { cell: node.cell(), kind };
    if levels == STAND_IN_LEVELS
        && let Some(known) = known.get(&id)
    {
        return *known;
    }
    let mut sum = (0.0, 0.0);
    for cell in node.cell().children() {
        let child = cell.quadrant().and_then(|quadrant| node.child(quadrant));
        let own = child.and_then(|child| match kind {
            PageKind::Terrain => child.terrain().map(|entry| entry.place),
            _ => child.imagery(),
        });
        let own = own.map_or((f64::INFINITY, f64::INFINITY), |place| {
            (f64::from(place.len), least_held_bytes(kind, place) as f64)
        });
        let below = match child {
            Some(child) if levels > 1 => cover(&child, kind, levels - 1, known),
            _ => (f64::INFINITY, f64::INFINITY),
        };
        sum = (sum.0 + own.0.min(below.0), sum.1 + own.1.min(below.1));
    }
    if levels == STAND_IN_LEVELS {
        known.insert(id, sum);
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hull_leaves_out_what_is_no_bargain() {
        let points = [(1.0, 9.0), (2.0, 4.0), (3.0, 3.9), (6.0, 0.0)];
        let edges = convex_hull(10.0, &points);
        assert_eq!(edges, [((0.0, 10.0), (2.0, 4.0)), ((2.0, 4.0), (6.0, 0.0))]);
        assert!(convex_hull(1.0, &[(1.0, 1.0), (2.0, 3.0)]).is_empty());
    }

    #[test]
    fn debt_falls_along_the_best_bargains_and_in_parts() {
        let mut curve = Curve::default();
        curve.add(0.5, 8.0, [(100.0, 4.0), (300.0, 0.0)].into_iter());
        curve.add(0.5, 2.0, [(1000.0, 0.0)].into_iter());
        curve.finish();
        let debts = [0.0, 50.0, 100.0, 200.0, 300.0, 800.0, 1300.0, 5000.0].map(|bytes| curve.debt_px(bytes));
        assert_eq!(debts, [5.0, 4.0, 3.0, 2.0, 1.0, 0.5, 0.0, 0.0]);
    }

    #[test]
    fn the_bytes_of_a_model_come_in_turns_and_no_faster_than_its_rate() {
        assert_eq!(bytes_by(&StorageModel::WAN, 0.05), 0.0);
        assert!((bytes_by(&StorageModel::WAN, 1.06) - 5e6).abs() < 1.0);
        assert!((bytes_by(&StorageModel::HDD, 0.02) - 1.2e6).abs() < 1.0);
        assert_eq!(bytes_by(&StorageModel::LAN, 0.0019), 0.0);
    }
}
