//! Live runs held back to a storage model: what is read passes a virtual disk in real time first, and only what has
//! arrived there goes on to the server that really reads.

use super::footprint::PAGES_IN_FLIGHT_MAX;
use crate::content::PageId;
use crate::forest::index::Place;
use crate::paging::{Delivery, Outcome, PageServer, RangeRead, ReadError};
use crate::storage::{Arrival, Disk, PartOutcome, Request};
use std::collections::{BTreeMap, VecDeque};
use std::time::Instant;

/// Seconds since a start of its own; never falls.
pub type ClockSecs = Box<dyn FnMut() -> f64 + Send>;

/// A page that is read.
type Read = (PageId, Place);

/// Another server's pages, no sooner than a virtual disk has them. What fails or is corrupt there is never read.
///
/// At most [`PAGES_IN_FLIGHT_MAX`] pages are under way, here and at the other server.
pub struct ThrottledServer {
    disk: Disk,
    inner: Box<dyn PageServer>,
    now_secs: ClockSecs,
    next_id: u64,
    /// By request at the disk: the pages of its parts; `None` where one has arrived or was cancelled.
    reading: BTreeMap<u64, Vec<Option<Read>>>,
    /// There, and not yet taken by the other server.
    arrived: VecDeque<Read>,
    /// Of pages that will not come.
    lost: VecDeque<Delivery>,
}

impl ThrottledServer {
    /// The disk's time runs from the first call on, which is the first frame's, however long opening a renderer takes.
    pub fn new(inner: Box<dyn PageServer>, disk: Disk) -> Self {
        let mut start = None;
        let now_secs = move || start.get_or_insert_with(Instant::now).elapsed().as_secs_f64();
        Self::with_clock(inner, disk, Box::new(now_secs))
    }

    pub fn with_clock(inner: Box<dyn PageServer>, disk: Disk, now_secs: ClockSecs) -> Self {
        Self {
            disk,
            inner,
            now_secs,
            next_id: 0,
            reading: BTreeMap::new(),
            arrived: VecDeque::new(),
            lost: VecDeque::new(),
        }
    }

    fn reading_count(&self) -> usize {
        self.reading.values().flatten().flatten().count()
    }

    fn take_in(&mut self, arrival: Arrival) {
        let Some((page, place)) = self.take_page(arrival.id, arrival.part) else { return };
        let error = match arrival.outcome {
            PartOutcome::Ok => return self.arrived.push_back((page, place)),
            PartOutcome::Failed => ReadError::Failed(told(page, "the storage failed")),
            PartOutcome::Corrupt => ReadError::Broken(told(page, "what is stored is corrupt")),
        };
        let read_bytes = place.len.into();
        self.lost.push_back(Delivery { page, place, outcome: Outcome::Failed(error), read_bytes });
    }

    /// Takes a page off its request; the request with the last one.
    fn take_page(&mut self, id: u64, part: usize) -> Option<Read> {
        let pages = self.reading.get_mut(&id)?;
        let page = pages.get_mut(part)?.take();
        if pages.iter().all(Option::is_none) {
            self.reading.remove(&id);
        }
        page
    }

    /// Hands on what has arrived, as far as it is taken.
    fn pass_on(&mut self) {
        while let Some(&(page, place)) = self.arrived.front() {
            if !self.inner.start(RangeRead::of_page(self.next_id, page, place)) {
                return;
            }
            self.next_id += 1;
            self.arrived.pop_front();
        }
    }

    /// The request and part that a page is.
    fn find(&self, page: PageId) -> Option<(u64, usize)> {
        let is_page = |read: &Option<Read>| read.is_some_and(|read| read.0 == page);
        self.reading.iter().find_map(|(&id, pages)| Some((id, pages.iter().position(is_page)?)))
    }

    fn give_up(&mut self, (page, place): Read) {
        self.lost.push_back(Delivery { page, place, outcome: Outcome::Cancelled, read_bytes: 0 });
    }
}

fn told(page: PageId, what: &str) -> String {
    format!("page {:?} of cell {}: {what}, as asked for by --faults", page.kind, page.cell)
}

/// The request that stands for a range: packs are files of their zones.
fn request(id: u64, read: &RangeRead) -> Request {
    let parts = read.pages.iter().map(|(_, place)| place.offset.saturating_sub(read.offset) + u64::from(place.len));
    Request { id, file: read.file_number(), offset: read.offset, parts: parts.collect() }
}

impl PageServer for ThrottledServer {
    fn start(&mut self, read: RangeRead) -> bool {
        let id = self.next_id;
        if self.in_flight() + read.pages.len() > PAGES_IN_FLIGHT_MAX {
            return false;
        }
        let now_s = (self.now_secs)();
        if !self.disk.start(request(id, &read), now_s) {
            return false;
        }
        self.next_id += 1;
        self.reading.insert(id, read.pages.into_iter().map(Some).collect());
        true
    }

    /// A range of which nothing is awaited any more makes place at the disk.
    fn cancel(&mut self, page: PageId) {
        if let Some((id, part)) = self.find(page) {
            let read = self.take_page(id, part);
            if !self.reading.contains_key(&id) {
                let now_s = (self.now_secs)();
                self.disk.cancel(id, now_s);
            }
            read.into_iter().for_each(|read| self.give_up(read));
        } else if let Some(at) = self.arrived.iter().position(|read| read.0 == page) {
            self.arrived.remove(at).into_iter().for_each(|read| self.give_up(read));
        } else if !self.lost.iter().any(|delivery| delivery.page == page) {
            self.inner.cancel(page);
        }
    }

    fn poll(&mut self) -> Option<Delivery> {
        let now_s = (self.now_secs)();
        for arrival in self.disk.advance(now_s) {
            self.take_in(arrival);
        }
        self.pass_on();
        self.lost.pop_front().or_else(|| self.inner.poll())
    }

    fn in_flight(&self) -> usize {
        self.reading_count() + self.arrived.len() + self.lost.len() + self.inner.in_flight()
    }
}
