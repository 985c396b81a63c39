//! Resident pages in the order in which they are dropped.
//!
//! Varadhan & Manocha 2002, §4.3 keep one list: the front at its head, then what was prefetched by priority, then, from
//! the pointer *StartTail* on, what no frame asks for any more, the longest unused last; replacement takes from the end.
//! Funkhouser 1996, §4.3 drops what left the observer's lookahead longest ago first, before he loads. Both are one order
//! here: the tail behind StartTail is kept in it, page by page as they leave the demands; what is demanded (the part
//! before StartTail) is in the order of the demands themselves, anew in every update, and needs no list of its own.

use crate::content::PageId;
use std::collections::{BTreeSet, HashMap};

#[derive(Clone, Copy, Debug, PartialEq)]
struct Resident {
    bytes: u64,
    /// The update in which it left the demands; `None` while it is demanded.
    left: Option<u64>,
}

#[derive(Debug, Default)]
pub(super) struct Residents {
    pages: HashMap<PageId, Resident>,
    /// From StartTail to the end, the first to drop first.
    tail: BTreeSet<(u64, PageId)>,
    bytes: u64,
}

impl Residents {
    pub fn contains(&self, page: PageId) -> bool {
        self.pages.contains_key(&page)
    }

    pub fn bytes_of(&self, page: PageId) -> Option<u64> {
        self.pages.get(&page).map(|resident| resident.bytes)
    }

    pub fn len(&self) -> usize {
        self.pages.len()
    }

    /// Of all pages.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// In no order.
    pub fn pages(&self) -> impl Iterator<Item = PageId> {
        self.pages.keys().copied()
    }

    /// Adds a page that is demanded, or left the demands in an update.
    pub fn insert(&mut self, page: PageId, bytes: u64, left: Option<u64>) {
        self.remove(page);
        self.pages.insert(page, Resident { bytes, left });
        self.tail.extend(left.map(|update| (update, page)));
        self.bytes += bytes;
    }

    /// False when it was not there.
    pub fn remove(&mut self, page: PageId) -> bool {
        let Some(resident) = self.pages.remove(&page) else { return false };
        if let Some(update) = resident.left {
            self.tail.remove(&(update, page));
        }
        self.bytes -= resident.bytes;
        true
    }

    /// A page is demanded: it stands before StartTail.
    pub fn want(&mut self, page: PageId) {
        if let Some(update) = self.pages.get_mut(&page).and_then(|resident| resident.left.take()) {
            self.tail.remove(&(update, page));
        }
    }

    /// A page is not demanded any more since an update: it begins the tail.
    pub fn leave(&mut self, page: PageId, update: u64) {
        if let Some(resident) = self.pages.get_mut(&page)
            && resident.left.is_none()
        {
            resident.left = Some(update);
            self.tail.insert((update, page));
        }
    }

    /// The end of the tail: what left the demands longest ago.
    pub fn least_recent(&self) -> Option<PageId> {
        self.tail.first().map(|&(_, page)| page)
    }
}
