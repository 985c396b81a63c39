//! Demands as they come up in a selection: each page once, at its highest rank.

use super::region::FrontRegion;
use super::{Demand, Urgency};
use crate::content::{PageId, PageKind};
use crate::forest::CellId;
use crate::forest::index::{IndexForest, Node, Place, SegmentRef};
use std::cmp::Ordering;
use std::collections::HashMap;

/// Gain of the zones' coarsest terrain, before all else: with it there is never a hole.
const ROOT_TERRAIN_GAIN: f64 = 1e30;
/// Gain of the ground under the eye: the finest first, which alone makes the ground right.
const GROUND_GAIN: f64 = 1e20;
/// Gain of the segments under the eye: before the ground that they tell of.
const GROUND_SEGMENT_GAIN: f64 = 1e25;
/// What a segment's gain is above those of all pages: what is below it cannot even be asked for.
const SEGMENT_GAIN: f64 = 1e9;
/// Share of a page's full error that counts when it is drawn already or stood in for: keeps the order among them.
const KEEP_SHARE: f64 = 1e-6;
/// Errors beyond this count as this, so that gains stay finite.
const ERROR_MAX_PX: f64 = 1e6;
/// What a piece counts that is in view by its box and yet has no share of the screen.
pub const SHARE_MIN: f64 = 1e-9;

#[derive(Clone, Copy)]
struct Wish {
    place: Place,
    urgency: Urgency,
    gain: f64,
    missing: bool,
}

/// More urgent first; within a class larger gain first; then by page, so that the order is total.
pub fn service_order(a: &Demand, b: &Demand) -> Ordering {
    b.urgency.cmp(&a.urgency).then(b.gain.total_cmp(&a.gain)).then(a.page.cmp(&b.page))
}

#[derive(Default)]
pub struct DemandList {
    wishes: HashMap<PageId, Wish>,
}

impl DemandList {
    pub fn pin_roots(&mut self, index: &IndexForest) {
        for root in index.trees().map(|tree| tree.root()) {
            if let Some(terrain) = root.terrain() {
                self.raise(root.cell(), PageKind::Terrain, terrain.place, Urgency::Blocking, ROOT_TERRAIN_GAIN);
            }
        }
    }

    pub fn ground(&mut self, node: &Node<'_>) {
        if let Some(terrain) = node.terrain() {
            let gain = GROUND_GAIN + f64::from(node.cell().level()) * (GROUND_GAIN / 100.0);
            self.raise(node.cell(), PageKind::Terrain, terrain.place, Urgency::Blocking, gain);
        }
    }

    /// A segment under the eye.
    pub fn ground_segment(&mut self, segment: SegmentRef, missing: bool) {
        let (cell, kind) = (segment.root, PageKind::Segment);
        self.raise(cell, kind, segment.place, Urgency::Blocking, GROUND_SEGMENT_GAIN);
        if let Some(wish) = self.wishes.get_mut(&PageId { cell, kind }) {
            wish.missing = missing;
        }
    }

    fn raise(&mut self, cell: CellId, kind: PageKind, place: Place, urgency: Urgency, gain: f64) {
        let wish = self.wishes.entry(PageId { cell, kind }).or_insert(Wish { place, urgency, gain, missing: false });
        if wish.urgency <= urgency {
            wish.gain = if wish.urgency == urgency { wish.gain.max(gain) } else { gain };
            wish.urgency = urgency;
        }
    }

    /// The page of the front of a region; what its regions give adds up.
    pub fn region(&mut self, region: &FrontRegion<'_>, asked_px: f64) {
        let Some(front) = region.chain.get(region.front) else { return };
        let missing = region.drawn != Some(region.front);
        let wanted_px = region.error_px(Some(region.front)).max(asked_px);
        let fall_px = if missing { (region.drawn_px - wanted_px).max(0.0) } else { 0.0 };
        let error_px = if region.drawn.is_some() { region.drawn_px } else { region.absent_px };
        let worth_px = fall_px + KEEP_SHARE * error_px.min(ERROR_MAX_PX);
        let first = if region.kind == PageKind::Segment { SEGMENT_GAIN } else { 0.0 };
        let gain = first + (region.share + SHARE_MIN) * worth_px / f64::from(front.place.len.max(1));
        let page = front.page();
        let (place, urgency) = (front.place, Urgency::Visible);
        let wish = self.wishes.entry(page).or_insert(Wish { place, urgency, gain: 0.0, missing: false });
        wish.missing |= missing;
        if wish.urgency == Urgency::Visible {
            wish.gain += gain;
        }
    }

    /// Pages of the front that are not resident.
    pub fn missing(&self) -> usize {
        self.wishes.values().filter(|wish| wish.missing).count()
    }

    /// In the order of service.
    pub fn finish(self) -> Vec<Demand> {
        let mut demands: Vec<Demand> = self
            .wishes
            .into_iter()
            .map(|(page, Wish { place, urgency, gain, .. })| Demand { page, place, urgency, gain })
            .collect();
        demands.sort_by(service_order);
        demands
    }
}
