//! The lookahead set, and the order in which it is read (Funkhouser 1996, §4.2 and §4.3).

use super::super::Situation;
use super::super::classes::predicted;
use super::RangeParams;
use super::surveys::Want;
use crate::content::PageId;
use crate::forest::index::Place;
use crate::paging::RequestManager;
use crate::paging::estimate::Estimator;
use crate::select::Demand;
use std::collections::HashMap;
use std::collections::hash_map::Entry;

/// Wants looked at in a plan at most.
const WANTS_MAX: usize = 30_000;

#[derive(Clone, Copy, Debug)]
struct Ahead {
    place: Place,
    /// As in [`Want`], the most over all cells.
    coarser: u32,
    /// Until it can be seen.
    frames: f64,
}

/// A set that is filled in the order in which observers come to see what is in it.
pub struct Lookahead<'a> {
    manager: &'a RequestManager,
    pages: HashMap<PageId, Ahead>,
    /// What may still be read, and held; bytes.
    read_left: f64,
    held_left: f64,
    wants_left: usize,
}

impl<'a> Lookahead<'a> {
    /// Closed by what can be read in N frames, and by memory.
    pub fn new(params: &RangeParams, situation: &Situation<'a>) -> Self {
        let manager = situation.frame.manager;
        let reading_s = f64::from(params.frames.max(1)) * situation.frame.step_s;
        Self {
            manager,
            pages: HashMap::new(),
            read_left: params.bytes_factor.max(0.0) * reading_s * manager.pace().bytes_per_sec(),
            held_left: params.memory_share.max(0.0) * manager.limits().footprint_bytes as f64,
            wants_left: WANTS_MAX,
        }
    }

    /// Adds what is seen from a cell that is entered after `frames`, coarse to fine. False when the set is closed.
    pub fn add(&mut self, wants: &[Want], frames: f64) -> bool {
        wants.iter().all(|want| self.add_page(want, frames))
    }

    fn add_page(&mut self, want: &Want, frames: f64) -> bool {
        self.wants_left = self.wants_left.saturating_sub(1);
        if self.wants_left == 0 || self.read_left <= 0.0 || self.held_left <= 0.0 {
            return false;
        }
        match self.pages.entry(want.page) {
            // Seen before from a nearer cell; as a coarser page of this one it may come earlier.
            Entry::Occupied(mut known) => known.get_mut().coarser = known.get().coarser.max(want.coarser),
            Entry::Vacant(slot) => {
                slot.insert(Ahead { place: want.place, coarser: want.coarser, frames });
                self.held_left -= Estimator::new().bytes(want.page.kind, want.place) as f64;
                if !self.manager.is_resident(want.page) {
                    self.read_left -= f64::from(want.place.len);
                }
            }
        }
        true
    }

    /// Coarse to fine, then by the time until they can be seen.
    pub fn into_demands(self) -> Vec<Demand> {
        let mut queue: Vec<(PageId, Ahead)> = self.pages.into_iter().collect();
        queue.sort_by(|(page_a, a), (page_b, b)| {
            b.coarser.cmp(&a.coarser).then(a.frames.total_cmp(&b.frames)).then(page_a.cmp(page_b))
        });
        let coarsest = queue.first().map_or(0, |(_, ahead)| ahead.coarser);
        predicted(queue.into_iter().map(|(page, ahead)| (coarsest - ahead.coarser, page, ahead.place)))
    }
}
