//! Objects: pages in view above the threshold are demanded, and of the resident ones the cells and objects above it are
//! drawn (Davis et al. 1999, §V). One metric for paging and drawing: the projected bounding dimension.
//!
//! A collection's pages are a tree. At a page's root there may be groups too, which stand for all objects of the subtree
//! (Varadhan & Manocha 2002, §3.1: PAR, CHD); a page of groups has a part for each page tree below it and one for the
//! root's own objects. The walk goes down a collection until one of the groups has an error within the tolerance: that is
//! a region, drawn from its groups or from its part of the groups above. What is missing is stood in for by finer pages
//! that cover all of it, or by the part of the next coarser groups; where a page lacks both, all of its subtree is drawn
//! from the groups above. So children come in and their parent goes out in one frame, and nothing is drawn twice.
//!
//! Cells know their objects by centre; an object reaches at most half its reach beyond its cell, so bounds grow by that.

mod family;
mod parts;

use super::front::Purpose;
use super::region::{SeenSegment, VisitRegion};
use super::sight::Sight;
use super::{CollectionSet, DrawObjects, ObjectsMode, SelectParams, SelectStats};
use crate::cells::LiveTree;
use crate::forest::index::{IndexForest, Node, ObjectsEntry, SegmentRef};
use crate::geodesy::{GeoBounds, OrientedBox};
use family::{Families, Offer};
use glam::DVec3;
use parts::Parts;

/// Dimensions beyond this count as this; the index stores "larger than 8 km" as infinite.
const DIMENSION_MAX_M: f64 = 1e5;

/// What objects are held against.
#[derive(Clone, Copy)]
struct Thresholds {
    /// Projected dimension asked for, px: what debt counts from; 0 where all objects are drawn.
    asked_px: f64,
    /// The one drawn, raised like the tolerance where memory or time lack.
    drawn_px: f64,
    /// Whether groups stand for objects.
    groups: bool,
    /// From which projected dimension on single objects are drawn, asked for and drawn, px; by their errors without.
    single_px: Option<[f64; 2]>,
    hidden: CollectionSet,
}

impl Thresholds {
    /// `None` where no objects are drawn.
    fn new(params: &SelectParams, sight: &Sight<'_>) -> Option<Self> {
        let raised = sight.tolerance.drawn_px / sight.tolerance.asked_px;
        let (asked_px, drawn_px) = match params.objects {
            ObjectsMode::Off => return None,
            ObjectsMode::Flat => (0.0, params.threshold_px * (raised - 1.0)),
            ObjectsMode::Cells | ObjectsMode::Groups | ObjectsMode::Vgis { .. } => {
                (params.threshold_px, params.threshold_px * raised)
            }
        };
        let (groups, single_px) = match params.objects {
            ObjectsMode::Groups => (true, None),
            ObjectsMode::Vgis { single_px } => (true, Some([single_px, single_px * raised])),
            ObjectsMode::Off | ObjectsMode::Flat | ObjectsMode::Cells => (false, None),
        };
        Some(Self { asked_px, drawn_px, groups, single_px, hidden: params.hidden })
    }
}

struct Walk<'a, 'b> {
    sight: &'a Sight<'a>,
    thresholds: Thresholds,
    visit_region: &'b mut VisitRegion<'b>,
    families: Families<'a>,
}

/// Shows what each page tree in view wants, and gives what is drawn of the resident pages.
pub fn walk<'b>(
    index: &IndexForest,
    cells: &LiveTree,
    sight: &Sight<'_>,
    params: &SelectParams,
    purpose: Purpose,
    visit_region: &'b mut VisitRegion<'b>,
    stats: &'b mut SelectStats,
) -> Vec<DrawObjects> {
    let Some(thresholds) = Thresholds::new(params, sight) else {
        return Default::default();
    };
    let families = Families::new(cells, sight.tolerance, thresholds);
    let mut walk = Walk { sight, thresholds, visit_region, families };
    for tree in index.trees() {
        walk.visit(&tree.root());
    }
    let Walk { visit_region, families, .. } = walk;
    families.show(visit_region);
    if purpose == Purpose::Survey {
        return Vec::new();
    }
    let mut parts = Parts::new(sight, thresholds.drawn_px, stats);
    families.drawn().for_each(|draw| parts.add(draw));
    parts.finish()
}

/// Whether nothing begins at a node that is to be looked at for itself.
fn is_bare(node: &Node<'_>) -> bool {
    node.objects().next().is_none() && node.paged_segment().is_none() && node.absent_children().next().is_none()
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
        if self.is_far(node, &bounds) {
            return;
        }
        let eye = self.sight.view.pose.eye;
        if bounds.contains(eye.lat_rad, eye.lon_rad) && is_bare(node) {
            // The box of what the eye is over seldom tells more.
            return node.children().for_each(|child| self.visit(&child));
        }
        let (low_m, high_m) = node.height_range_m();
        let mut around = OrientedBox::around(&bounds, low_m, high_m);
        around.half_m += DVec3::splat(node.reach_m().min(DIMENSION_MAX_M) / 2.0);
        if !self.sight.sees(&around) {
            return;
        }
        let distance_m = around.distance_m(self.sight.eye);
        if distance_m > self.in_sight_m(node) {
            return;
        }
        let px_per_m = self.sight.view.projected_px(1.0, distance_m);
        let place = Place { node, bounds, around, distance_m };
        if let Some(segment) = node.paged_segment() {
            self.segment(&place, segment, true);
        }
        let (entered, done) = self.enter(&place, px_per_m);
        if !done {
            for child in node.children() {
                self.visit(&child);
            }
            for segment in node.absent_children() {
                self.absent(&place, segment);
            }
        }
        entered.into_iter().rev().for_each(|collection| self.families.leave(collection));
    }

    /// Up to which distance the largest object of the subtree is above the threshold asked for, metres.
    fn in_sight_m(&self, node: &Node<'_>) -> f64 {
        node.dimension_m() * self.sight.focal_px / self.thresholds.asked_px
    }

    /// Whether all objects of the subtree are below the threshold asked for, as far as can be told without a box.
    fn is_far(&self, node: &Node<'_>, bounds: &GeoBounds) -> bool {
        // Objects reach half their reach beyond the cell, east and north.
        let in_sight_m = self.in_sight_m(node);
        let beyond_m = node.reach_m().min(DIMENSION_MAX_M) * std::f64::consts::FRAC_1_SQRT_2;
        let above_m = self.sight.view.pose.eye.height_m - node.height_range_m().1;
        let enough_m = in_sight_m + beyond_m;
        above_m > in_sight_m || self.sight.viewpoint.at_least_m(bounds, enough_m) > enough_m
    }

    /// Offers each collection what it has at a node. Gives the collections to leave after the node's children, and
    /// whether there is nothing to be seen below.
    fn enter(&mut self, place: &Place<'_, '_>, px_per_m: f64) -> (Vec<u8>, bool) {
        // Without groups each object is drawn as it is.
        let is_wanted = |entry: &ObjectsEntry| {
            (self.thresholds.groups || entry.rep == 0) && !self.thresholds.hidden.contains(entry.collection)
        };
        let mut entries: Vec<ObjectsEntry> = place.node.objects().filter(is_wanted).collect();
        if entries.is_empty() {
            return (Vec::new(), false);
        }
        let share = self.sight.screen_share(&place.bounds, place.node.height_range_m().0);
        // Of a collection the coarsest first.
        entries.sort_by_key(|entry| (entry.collection, std::cmp::Reverse(entry.rep)));
        let (mut entered, mut done) = (Vec::new(), false);
        for of_one in entries.chunk_by(|a, b| a.collection == b.collection) {
            let collection = of_one[0].collection;
            let below = place.node.objects_below().find(|below| below.collection == collection);
            let below = below.filter(|_| self.thresholds.groups);
            let offer = Offer {
                cell: place.node.cell(),
                entries: of_one,
                dimension_m: below.map(|below| below.dimension_m.min(DIMENSION_MAX_M)),
                px_per_m,
                share,
                reach_m: place.node.reach_m().min(DIMENSION_MAX_M),
                widest_m: place.around.half_m.max_element(),
            };
            let goes_on = self.families.enter(collection, &offer);
            entered.push(collection);
            done |= !goes_on && below.is_some_and(|below| below.alone);
        }
        (entered, done)
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
        let absent_px = self.sight.view.projected_px(dimension_m, place.distance_m);
        if absent_px >= self.thresholds.drawn_px {
            let share = self.sight.screen_share(&place.bounds, place.node.height_range_m().0);
            SeenSegment { segment, resident, share, absent_px, open: !resident }.show(self.visit_region);
        }
    }
}
