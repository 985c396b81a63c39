//! Objects: pages in view above the threshold are demanded, and of the resident ones the cells and objects above it are
//! drawn (Davis et al. 1999, §V). One metric for paging and drawing: the projected bounding dimension.
//!
//! Cells know their objects by centre; an object reaches at most half its reach beyond its cell, so bounds grow by that.

use super::front::Purpose;
use super::layer::Rep;
use super::region::{FrontRegion, SeenSegment, VisitRegion};
use super::sight::Sight;
use super::{CollectionSet, DrawObjects, ObjectsMode, SelectParams, SelectStats};
use crate::cells::LiveTree;
use crate::content::{CellObjects, ObjectPage, PageKind};
use crate::forest::index::{IndexForest, Node, ObjectsEntry, SegmentRef};
use crate::geodesy::{GeoBounds, OrientedBox, SEMI_MAJOR_M};
use glam::DVec3;
use std::f64::consts::{FRAC_PI_4, SQRT_2};
use std::ops::Range;

/// Dimensions beyond this count as this; the index stores "larger than 8 km" as infinite.
const DIMENSION_MAX_M: f64 = 1e5;
/// Pages wider than this are culled by the horizon cell by cell.
const HORIZON_BY_CELL_M: f64 = 20_000.0;

struct Walk<'a, 'b> {
    cells: &'a LiveTree,
    sight: &'a Sight<'a>,
    /// Threshold asked for: what debt counts from; 0 where all objects are drawn.
    asked_px: f64,
    /// Threshold drawn, raised like the tolerance where memory or time lack.
    drawn_px: f64,
    hidden: CollectionSet,
    purpose: Purpose,
    visit_region: &'b mut VisitRegion<'b>,
    stats: &'b mut SelectStats,
    drawn: Vec<DrawObjects>,
}

/// Shows each page of objects in view as a region of its own, and gives what is drawn of the resident ones.
pub fn walk<'b>(
    index: &IndexForest,
    cells: &LiveTree,
    sight: &Sight<'_>,
    params: &SelectParams,
    purpose: Purpose,
    visit_region: &'b mut VisitRegion<'b>,
    stats: &'b mut SelectStats,
) -> Vec<DrawObjects> {
    let raised = sight.tolerance.drawn_px / sight.tolerance.asked_px;
    let (asked_px, drawn_px) = match params.objects {
        ObjectsMode::Off => return Default::default(),
        ObjectsMode::Flat => (0.0, params.threshold_px * (raised - 1.0)),
        // Worlds have no groups yet: each object stands for itself.
        ObjectsMode::Cells | ObjectsMode::Groups => (params.threshold_px, params.threshold_px * raised),
    };
    let hidden = params.hidden;
    let mut walk = Walk { cells, sight, asked_px, drawn_px, hidden, purpose, visit_region, stats, drawn: Vec::new() };
    for tree in index.trees() {
        walk.visit(&tree.root());
    }
    walk.drawn
}

/// A node's place in the view.
struct Place<'n, 'i> {
    node: &'n Node<'i>,
    bounds: GeoBounds,
    around: OrientedBox,
    distance_m: f64,
}

impl Walk<'_, '_> {
    fn visit(&mut self, node: &Node<'_>) {
        if node.dimension_m() <= 0.0 {
            return;
        }
        let bounds = node.cell().bounds();
        let (low_m, high_m) = node.height_range_m();
        let mut around = OrientedBox::around(&bounds, low_m, high_m);
        around.half_m += DVec3::splat(node.reach_m().min(DIMENSION_MAX_M) / 2.0);
        if !self.sight.sees(&around) {
            return;
        }
        let distance_m = around.distance_m(self.sight.eye);
        if self.sight.view.projected_px(node.dimension_m(), distance_m) < self.asked_px {
            return;
        }
        let place = Place { node, bounds, around, distance_m };
        if let Some(segment) = node.paged_segment() {
            self.segment(&place, segment, true);
        }
        for entry in node.objects().filter(|entry| entry.rep == 0) {
            if self.hidden.contains(entry.collection) {
                continue;
            }
            self.page(&place, &entry);
        }
        for child in node.children() {
            self.visit(&child);
        }
        for segment in node.absent_children() {
            self.absent(&place, segment);
        }
    }

    /// Objects in a segment that is not resident: no larger than the node above tells, and somewhere in its cell.
    fn absent(&mut self, above: &Place<'_, '_>, segment: SegmentRef) {
        let bounds = segment.root.bounds();
        let (low_m, high_m) = above.node.height_range_m();
        let mut around = OrientedBox::around(&bounds, low_m, high_m);
        around.half_m += DVec3::splat(above.node.reach_m().min(DIMENSION_MAX_M) / 2.0);
        if self.sight.sees(&around) {
            let distance_m = around.distance_m(self.sight.eye);
            self.segment(&Place { node: above.node, bounds, around, distance_m }, segment, false);
        }
    }

    /// A segment whose objects may be above the threshold drawn.
    fn segment(&mut self, place: &Place<'_, '_>, segment: SegmentRef, resident: bool) {
        let dimension_m = place.node.dimension_m().min(DIMENSION_MAX_M);
        if self.is_above_threshold(dimension_m, place.distance_m) {
            let share = self.sight.screen_share(&place.bounds, place.node.height_range_m().0);
            let absent_px = self.sight.view.projected_px(dimension_m, place.distance_m);
            SeenSegment { segment, resident, share, absent_px, open: !resident }.show(self.visit_region);
        }
    }

    fn is_above_threshold(&self, dimension_m: f64, distance_m: f64) -> bool {
        self.sight.view.projected_px(dimension_m, distance_m) >= self.drawn_px
    }

    fn page(&mut self, place: &Place<'_, '_>, entry: &ObjectsEntry) {
        let error_px = self.sight.view.projected_px(entry.dimension_m.min(DIMENSION_MAX_M), place.distance_m);
        if error_px < self.asked_px {
            return;
        }
        let (cell, kind) = (place.node.cell(), PageKind::Objects { collection: entry.collection, rep: entry.rep });
        let wanted = self.is_above_threshold(entry.dimension_m, place.distance_m);
        let resident = self.cells.objects(cell, entry.collection, entry.rep).filter(|_| wanted);
        let page = Rep { cell, place: entry.place, error_m: 0.0, parent_error_m: 0.0 };
        (self.visit_region)(&FrontRegion {
            kind,
            cell,
            share: self.sight.screen_share(&place.bounds, place.node.height_range_m().0),
            chain: &[page],
            px_per_m: self.sight.view.projected_px(1.0, place.distance_m),
            absent_px: error_px,
            drawn_px: if resident.is_some() { 0.0 } else { error_px },
            // Below the threshold drawn the page is left out: nothing of the chain is wanted.
            front: usize::from(!wanted),
            best: 0,
            drawn: resident.map(|_| 0),
            open: false,
        });
        if let Some(page) = resident
            && self.purpose != Purpose::Survey
        {
            let objects = self.objects_of(page, place);
            if !objects.is_empty() {
                self.drawn.push(DrawObjects { page: page.clone(), objects });
            }
        }
    }

    /// Ranges of the page's objects that are in view and above the threshold.
    fn objects_of(&mut self, page: &ObjectPage, place: &Place<'_, '_>) -> Vec<Range<u32>> {
        let mut ranges = Vec::new();
        let reach_m = place.node.reach_m().min(DIMENSION_MAX_M);
        let by_horizon = place.around.half_m.max_element() > HORIZON_BY_CELL_M;
        for cell in &page.cells {
            let in_view = self.cell_is_in_view(page, cell, reach_m, by_horizon);
            let drawn = if in_view { self.objects_above_threshold(page, cell, &mut ranges) } else { 0 };
            let count = cell.objects.end - cell.objects.start;
            self.stats.objects_tested += count;
            self.stats.objects_drawn += drawn;
            self.stats.objects_culled += count - drawn;
        }
        ranges
    }

    fn cell_is_in_view(&self, page: &ObjectPage, cell: &CellObjects, reach_m: f64, by_horizon: bool) -> bool {
        let Some(first) = page.objects.get(cell.objects.start as usize) else {
            return false;
        };
        // A ball round any of the cell's objects that holds the cell; no cell is wider than high.
        let side_m = SEMI_MAJOR_M * 1.01 * FRAC_PI_4 / f64::from(1u32 << cell.cell.level());
        let (low_m, high_m) = cell.height_range_m;
        let radius_m = SQRT_2 * side_m + reach_m / 2.0 + f64::from(high_m - low_m).max(0.0);
        if !self.sight.frustum.meets_ball(first.place, radius_m) {
            return false;
        }
        let distance_m = self.sight.eye.distance_m(first.place) - radius_m;
        if !self.is_above_threshold(f64::from(cell.dimension_m), distance_m) {
            return false;
        }
        let ball =
            OrientedBox { center: first.place, axes: [DVec3::X, DVec3::Y, DVec3::Z], half_m: DVec3::splat(radius_m) };
        !(by_horizon && self.sight.horizon.hides_box(&ball))
    }

    fn objects_above_threshold(&self, page: &ObjectPage, cell: &CellObjects, ranges: &mut Vec<Range<u32>>) -> u32 {
        let mut drawn = 0;
        for at in cell.objects.clone() {
            let Some(object) = page.objects.get(at as usize) else {
                break;
            };
            if self.is_above_threshold(f64::from(object.dimension_m), self.sight.eye.distance_m(object.place)) {
                drawn += 1;
                push(ranges, at);
            }
        }
        drawn
    }
}

fn push(ranges: &mut Vec<Range<u32>>, at: u32) {
    match ranges.last_mut() {
        Some(last) if last.end == at => last.end = at + 1,
        _ => ranges.push(at..at + 1),
    }
}
