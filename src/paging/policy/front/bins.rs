//! Candidates by how near they are to being needed, first in first out (Varadhan & Manocha 2002, §4.2: a linear-time
//! stand-in for a priority queue).

use super::super::classes::predicted;
use super::candidates::Candidate;
use crate::content::PageId;
use crate::select::Demand;
use std::collections::HashMap;

/// More bins tell nothing more.
const BINS_MAX: u32 = 64;

#[derive(Clone, Copy, Debug, PartialEq)]
struct Slot {
    bin: u32,
    /// When it entered the bin, counted in entries.
    entered: u64,
}

/// Which bin each candidate is in, and since when.
#[derive(Clone, Debug)]
pub struct Bins {
    count: u32,
    slots: HashMap<PageId, Slot>,
    entries: u64,
}

impl Bins {
    pub fn new(count: u32) -> Self {
        Self { count: count.clamp(1, BINS_MAX), slots: HashMap::new(), entries: 0 }
    }

    fn bin(&self, distance: f64) -> u32 {
        if distance.is_nan() {
            return self.count - 1;
        }
        // Beyond the interval is the last bin.
        ((distance * f64::from(self.count)) as u32).min(self.count - 1)
    }

    /// Sorts all candidates anew; each page once. Who stays in its bin keeps its place there, who is no candidate any
    /// more is forgotten. The demands are in the order of service.
    pub fn fill(&mut self, candidates: Vec<Candidate>) -> Vec<Demand> {
        let before = std::mem::take(&mut self.slots);
        let mut queue: Vec<(Slot, Candidate)> = Vec::with_capacity(candidates.len());
        for candidate in candidates {
            let bin = self.bin(candidate.distance);
            let slot = before.get(&candidate.page).copied().filter(|slot| slot.bin == bin).unwrap_or_else(|| {
                self.entries += 1;
                Slot { bin, entered: self.entries }
            });
            self.slots.insert(candidate.page, slot);
            queue.push((slot, candidate));
        }
        queue.sort_by_key(|(slot, _)| (slot.bin, slot.entered));
        predicted(queue.into_iter().map(|(slot, candidate)| (slot.bin, candidate.page, candidate.place)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::content::PageKind;
    use crate::forest::index::Place;
    use crate::forest::{CellId, Zone};
    use crate::select::Urgency;

    fn candidate(n: u32, distance: f64) -> Candidate {
        let cell = CellId::new(Zone::new(18).unwrap(), 10, n, 0).unwrap();
        let place = Place::new(u64::from(n) * 100, 100).unwrap();
        Candidate { page: PageId { cell, kind: PageKind::Terrain }, place, distance }
    }

    fn order(demands: &[Demand]) -> Vec<u32> {
        assert!(demands.windows(2).all(|pair| pair[0].gain > pair[1].gain), "gains fall in the order of service");
        assert!(demands.iter().all(|demand| demand.urgency == Urgency::Predicted));
        demands.iter().map(|demand| demand.page.cell.xy().0).collect()
    }

    #[test]
    fn bins_come_first_and_arrival_second() {
        let mut bins = Bins::new(4);
        let bin_of = |distance| bins.bin(distance);
        assert_eq!([0.0, 0.24, 0.25, 0.74, 0.75, 1.0, 9.0].map(bin_of), [0, 0, 1, 2, 3, 3, 3]);
        let fill = |bins: &mut Bins, all: &[(u32, f64)]| {
            order(&bins.fill(all.iter().map(|&(n, distance)| candidate(n, distance)).collect()))
        };
        assert_eq!(fill(&mut bins, &[(1, 0.3), (2, 0.1), (3, 0.26), (4, 0.9)]), [2, 1, 3, 4]);
        // 3 comes nearer than 1 inside its bin, which changes nothing; 4 enters that bin and stands at its end, and 5
        // that comes to the first bin stands behind 2.
        assert_eq!(fill(&mut bins, &[(5, 0.0), (4, 0.27), (3, 0.25), (2, 0.2), (1, 0.49)]), [2, 5, 1, 3, 4]);
        // Who left has lost its place.
        assert_eq!(fill(&mut bins, &[(5, 0.0), (4, 0.27), (3, 0.25), (1, 0.49)]), [5, 1, 3, 4]);
        assert_eq!(fill(&mut bins, &[(2, 0.2), (5, 0.0), (4, 0.27), (3, 0.25), (1, 0.49)]), [5, 2, 1, 3, 4]);
        assert_eq!(bins.slots.len(), 5);
    }

    #[test]
    fn a_better_bin_drives_out_a_poorer_one_and_none_its_like() {
        let many = (0..100).map(|n| candidate(n, f64::from(n % 4) / 4.0)).collect();
        let demands = Bins::new(4).fill(many);
        for (at, a) in demands.iter().enumerate() {
            for (other, b) in demands.iter().enumerate().skip(at) {
                let drives_out = a.gain > 2.0 * b.gain;
                assert_eq!(drives_out, at / 25 < other / 25, "{at} {other}");
            }
        }
    }
}
