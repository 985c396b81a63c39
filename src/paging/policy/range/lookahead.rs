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
                self.held_left -= Estimator::new().held_bytes(want.page.kind, want.place) as f64;
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::content::PageKind;
    use crate::forest::{CellId, Zone};
    use crate::paging::{Completion, Event, Limits};

    const LIMITS: Limits = Limits {
        footprint_bytes: 64 << 20,
        in_flight: 8,
        pages_in_flight: 8,
        bytes_in_flight: 1 << 30,
        read_bytes_per_update: 1 << 20,
        run_bytes: 0,
        gap_bytes: 0,
    };

    fn want(n: u32, coarser: u32) -> Want {
        let cell = CellId::new(Zone::new(18).unwrap(), 10, n, 0).unwrap();
        let place = Place::new(u64::from(n) * 1000, 1000).unwrap();
        Want { page: PageId { cell, kind: PageKind::Terrain }, place, coarser }
    }

    fn lookahead(manager: &RequestManager, read_left: f64, held_left: f64) -> Lookahead<'_> {
        Lookahead { manager, pages: HashMap::new(), read_left, held_left, wants_left: WANTS_MAX }
    }

    fn order(lookahead: Lookahead<'_>) -> Vec<u32> {
        let demands = lookahead.into_demands();
        assert!(demands.windows(2).all(|pair| pair[0].gain > pair[1].gain));
        demands.iter().map(|demand| demand.page.cell.xy().0).collect()
    }

    #[test]
    fn coarse_comes_before_fine_and_then_what_is_seen_first() {
        let manager = RequestManager::new(LIMITS).unwrap();
        let mut set = lookahead(&manager, 1e9, 1e9);
        assert!(set.add(&[want(5, 1), want(3, 0), want(2, 0)], 0.0));
        assert!(set.add(&[want(9, 2), want(4, 1), want(3, 0), want(1, 0)], 7.0));
        // 2 turns out to be a coarser page of what is seen later: it comes earlier, among its like by its own time.
        assert!(set.add(&[want(2, 1), want(0, 0)], 12.0));
        assert_eq!(order(set), [9, 2, 5, 4, 3, 1, 0]);
    }

    #[test]
    fn what_is_there_takes_memory_but_need_not_be_read() {
        let mut manager = RequestManager::new(LIMITS).unwrap();
        let there = want(0, 0);
        let demands = [&there].map(|want| predicted([(0, want.page, want.place)].into_iter())[0]);
        assert_eq!(manager.update(&demands, 0.0).len(), 1);
        manager.complete(Event { page: there.page, completion: Completion::Loaded { bytes: 5000 } }, 0.1);
        let all = [there, want(1, 0), want(2, 0), want(3, 0)];
        // Two pages of 1,000 bytes use up 1,500; the third is not taken any more.
        let mut set = lookahead(&manager, 1500.0, 1e9);
        assert!(!set.add(&all, 0.0));
        assert_eq!(order(set), [0, 1, 2]);
        let each = Estimator::new().held_bytes(PageKind::Terrain, there.place) as f64;
        let mut set = lookahead(&manager, 1e9, 1.5 * each);
        assert!(!set.add(&all, 0.0));
        assert_eq!(order(set), [0, 1]);
    }
}
