//! Pages that lie together in a pack are read as one range: one seek, or one request, for all of them.

use super::Limits;
use crate::content::{PageFile, PageId};
use crate::forest::Zone;
use crate::forest::index::Place;
use crate::select::Demand;

/// One contiguous range of a zone's file, and the pages in it.
#[derive(Clone, Debug, PartialEq)]
pub struct RangeRead {
    /// Counted from 0 by the request manager.
    pub id: u64,
    pub zone: Zone,
    pub file: PageFile,
    pub offset: u64,
    /// With the unwanted bytes between the pages.
    pub len: u32,
    /// Ascending by offset, apart from one another; at least one.
    pub pages: Vec<(PageId, Place)>,
}

impl RangeRead {
    /// `run` is ascending by offset and not empty.
    pub(super) fn new(id: u64, run: &[Demand]) -> Self {
        let pages: Vec<(PageId, Place)> = run.iter().map(|demand| (demand.page, demand.place)).collect();
        let offset = pages.first().map_or(0, |page| page.1.offset);
        let end = pages.last().map_or(0, |page| end(page.1));
        let first = run[0].page;
        Self {
            id,
            zone: first.cell.zone(),
            file: first.kind.file_of(pages[0].1),
            offset,
            len: (end - offset) as u32,
            pages,
        }
    }

    /// The part of it that reaches from the first to the last of some of its pages; `None` where there are none.
    pub fn of_pages(&self, pages: Vec<(PageId, Place)>) -> Option<Self> {
        let (offset, end) = (pages.first()?.1.offset, end(pages.last()?.1));
        Some(Self { offset, len: (end - offset) as u32, pages, ..*self })
    }

    /// A number for the file that the range lies in: packs of the zones, then their indexes, then the layout.
    pub fn file_number(&self) -> u32 {
        match self.file {
            PageFile::Pack => self.zone.index() as u32,
            PageFile::Index => (Zone::COUNT + self.zone.index()) as u32,
            PageFile::Layout => 2 * Zone::COUNT as u32,
        }
    }

    /// A single page.
    pub fn of_page(id: u64, page: PageId, place: Place) -> Self {
        let (zone, file) = (page.cell.zone(), page.kind.file_of(place));
        Self { id, zone, file, offset: place.offset, len: place.len, pages: vec![(page, place)] }
    }
}

fn end(place: Place) -> u64 {
    place.offset + u64::from(place.len)
}

/// Which file a page lies in, then where; pages at the same place are apart all the same.
fn position(demand: &Demand) -> ((Zone, PageFile), u64, PageId) {
    ((demand.page.cell.zone(), demand.page.kind.file_of(demand.place)), demand.place.offset, demand.page)
}

/// What is due waits for what is read before it: that is no more than a run's length divided by this.
const LEAD_SHARE: u32 = 4;

/// Demands that may be started, in the order in which they lie.
pub(super) struct Waiting {
    demands: Vec<Demand>,
    taken: Vec<bool>,
}

impl Waiting {
    pub fn new(mut demands: Vec<Demand>) -> Self {
        demands.sort_by_key(position);
        let taken = vec![false; demands.len()];
        Self { demands, taken }
    }

    /// Takes a demand and those around it, as long as gaps and the whole stay within the limits and `fits` takes them.
    /// The nearer neighbour comes first, so that what is urgent waits for as little as possible.
    pub fn take_run(
        &mut self,
        demand: &Demand,
        limits: &Limits,
        mut fits: impl FnMut(PageId, Place) -> bool,
    ) -> Vec<Demand> {
        let Ok(at) = self.demands.binary_search_by_key(&position(demand), position) else {
            return vec![*demand];
        };
        fits(demand.page, demand.place);
        self.taken[at] = true;
        let (mut first, mut last) = (at, at);
        loop {
            let before = first.checked_sub(1).and_then(|next| Some((next, self.gap_bytes(next, first)?)));
            let after = self.gap_bytes(last, last + 1).map(|gap| (last + 1, gap));
            let nearer = [after, before].into_iter().flatten().min_by_key(|(_, gap)| *gap);
            let Some((next, gap)) = nearer.filter(|(_, gap)| *gap <= u64::from(limits.gap_bytes)) else { break };
            let (low, high) = (first.min(next), last.max(next));
            let len = end(self.demands[high].place) - self.demands[low].place.offset;
            let before = demand.place.offset - self.demands[low].place.offset;
            let Demand { page, place, .. } = self.demands[next];
            let is_short = len <= u64::from(limits.run_bytes) && before <= u64::from(limits.run_bytes / LEAD_SHARE);
            if !is_short || !fits(page, place) {
                break;
            }
            debug_assert!(gap <= len);
            self.taken[next] = true;
            (first, last) = (low, high);
        }
        self.demands[first..=last].to_vec()
    }

    /// Unwanted bytes between two neighbours; `None` where one does not exist, is taken, or lies in another file.
    fn gap_bytes(&self, low: usize, high: usize) -> Option<u64> {
        let (before, after) = (self.demands.get(low)?, self.demands.get(high)?);
        let (from, to) = (position(before), position(after));
        let apart = from.0 != to.0 || (self.taken[low] && self.taken[high]);
        if apart { None } else { to.1.checked_sub(end(before.place)) }
    }
}
