//! What was read and whether it was ever drawn.

use crate::content::{PageId, PageKind};
use crate::select::{Selection, Urgency};
use std::collections::HashMap;

/// Follows every read until it is drawn or dropped.
#[derive(Debug, Default)]
pub struct Usage {
    resident: HashMap<PageId, Read>,
    wasted_bytes: u64,
    drawn_bytes: u64,
}

#[derive(Debug)]
struct Read {
    bytes: u64,
    drawn: bool,
}

impl Usage {
    /// A page was read; `bytes` as stored.
    pub fn loaded(&mut self, page: PageId, bytes: u64) {
        self.dropped(page);
        self.resident.insert(page, Read { bytes, drawn: false });
    }

    /// Bytes were read that never became a page.
    pub fn failed(&mut self, bytes: u64) {
        self.wasted_bytes += bytes;
    }

    pub fn dropped(&mut self, page: PageId) {
        if let Some(read) = self.resident.remove(&page)
            && !read.drawn
        {
            self.wasted_bytes += read.bytes;
        }
    }

    pub fn drawn(&mut self, selection: &Selection) {
        // A segment is of use where the view's own walk, not only a prediction, passed through it.
        let demands = selection.demands.iter().filter(|demand| demand.urgency > Urgency::Predicted);
        let segments = demands.map(|demand| demand.page).filter(|page| page.kind == PageKind::Segment);
        for page in drawn_pages(selection).chain(segments) {
            if let Some(read) = self.resident.get_mut(&page)
                && !read.drawn
            {
                read.drawn = true;
                self.drawn_bytes += read.bytes;
            }
        }
    }

    /// Stored bytes of the pages that were read and are still held.
    pub fn resident_bytes(&self) -> u64 {
        self.resident.values().map(|read| read.bytes).sum()
    }

    /// Bytes of reads that were drawn at least once, so far.
    pub fn drawn_bytes(&self) -> u64 {
        self.drawn_bytes
    }

    /// Bytes read and never drawn, were the flight to end now.
    pub fn wasted_bytes(&self) -> u64 {
        self.wasted_bytes + self.resident.values().filter(|read| !read.drawn).map(|read| read.bytes).sum::<u64>()
    }
}

/// The pages that a selection draws from; some more than once.
pub fn drawn_pages(selection: &Selection) -> impl Iterator<Item = PageId> {
    let terrain = selection.pieces.iter().map(|piece| PageId { cell: piece.terrain.cell, kind: PageKind::Terrain });
    let imagery = selection.pieces.iter().filter_map(|piece| piece.imagery);
    let objects = selection.objects.iter().map(|drawn| {
        let (collection, rep) = (drawn.page.collection, drawn.page.rep);
        PageId { cell: drawn.page.root, kind: PageKind::Objects { collection, rep } }
    });
    terrain.chain(imagery.map(|cell| PageId { cell, kind: PageKind::Imagery })).chain(objects)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::forest::Zone;

    #[test]
    fn bytes_dropped_undrawn_are_wasted_once() {
        let root = Zone::new(3).unwrap().root();
        let page = PageId { cell: root, kind: PageKind::Imagery };
        let mut usage = Usage::default();
        usage.loaded(page, 7);
        assert_eq!(usage.wasted_bytes(), 7);
        usage.dropped(page);
        usage.dropped(page);
        assert_eq!(usage.wasted_bytes(), 7);
        usage.loaded(page, 7);
        assert_eq!(usage.wasted_bytes(), 14);
    }
}
