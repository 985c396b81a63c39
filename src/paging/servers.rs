//! Servers: they read, verify and decode what they are told, and know no policy. Threads by layer for live runs; inline
//! for runs in lock-step, where reading happens in the order of the commands, inside the frame.
//!
//! Pages that lie together are read as one (see [`RangeRead`]) and decoded page by page, so that a broken one costs only
//! itself.

mod run;
mod threaded;

pub use threaded::{SHUTDOWN_WAIT, ServerError, ServerLimits, ThreadedServers};

use super::RangeRead;
use crate::content::{Page, PageId};
use crate::forest::index::Place;
use crossbeam_channel::after;
use run::{Fetched, Part};
use std::collections::{HashSet, VecDeque};
use std::sync::Arc;
use std::time::Duration;

/// A moment, for [`PageServer::poll_within`].
const LOOK_AGAIN: Duration = Duration::from_millis(1);

/// Why a page did not come.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ReadError {
    /// The storage did not answer; a later try may succeed.
    #[error("{0}")]
    Failed(String),
    /// What is stored is wrong and stays so.
    #[error("{0}")]
    Broken(String),
}

/// Reads and decodes pages; thread-safe.
pub trait PageReader: Send + Sync {
    /// A single page.
    fn load(&self, page: PageId, place: Place) -> Result<Page, ReadError>;

    /// Reads a run as one: one read, or one request, for all of its pages. `None` where nothing is gained by that: its
    /// pages are then loaded one by one.
    fn read_run(&self, _run: &RangeRead) -> Result<Option<Arc<dyn PageRun>>, ReadError> {
        Ok(None)
    }

    /// Several runs, at once where that is faster than one after the other; in their order.
    fn read_runs(&self, runs: &[RangeRead]) -> Vec<Result<Option<Arc<dyn PageRun>>, ReadError>> {
        runs.iter().map(|run| self.read_run(run)).collect()
    }

    /// Whether reads go over a network: then many small ones cost more than few large ones, and several at once less.
    fn is_remote(&self) -> bool {
        false
    }
}

/// A run that has been read. Its pages are checked and decoded when they are asked for, by any thread.
pub trait PageRun: Send + Sync {
    fn page(&self, page: PageId, place: Place) -> Result<Page, ReadError>;
}

/// A run that another reader loads page by page: for readers that hand on to one.
pub struct OneByOne(pub Arc<dyn PageReader>);

impl PageRun for OneByOne {
    fn page(&self, page: PageId, place: Place) -> Result<Page, ReadError> {
        self.0.load(page, place)
    }
}

/// What became of a started page.
#[derive(Clone, Debug)]
pub enum Outcome {
    Loaded(Page),
    Failed(ReadError),
    /// Cancelled before it was decoded.
    Cancelled,
}

#[derive(Clone, Debug)]
pub struct Delivery {
    pub page: PageId,
    pub place: Place,
    pub outcome: Outcome,
    /// Bytes that were read for it: its own and the unwanted ones before it in its run; 0 where nothing was.
    pub read_bytes: u64,
}

/// Takes commands, gives deliveries: exactly one for each started page, also for cancelled ones.
pub trait PageServer: Send {
    /// False when the queue has no room for all pages of the range; nothing is then started, and no delivery follows.
    fn start(&mut self, read: RangeRead) -> bool;
    /// Drops a started page if it is not decoded yet; its bytes are not read if those of no other page around it are.
    fn cancel(&mut self, page: PageId);
    /// The next delivery that is there; never waits.
    fn poll(&mut self) -> Option<Delivery>;
    /// The next delivery; where reads go on elsewhere, waits for it, but no longer than `at_most`. `None` may come
    /// sooner: a server that does not know when its next one comes looks again in a moment.
    fn poll_within(&mut self, at_most: Duration) -> Option<Delivery> {
        self.poll().or_else(|| {
            // A timer is a channel that gives one message.
            let _ = after(at_most.min(LOOK_AGAIN)).recv();
            self.poll()
        })
    }
    /// Starts without delivery so far.
    fn in_flight(&self) -> usize;
}

/// Runs that an [`InlineServer`] reads together over a network: while it waits for one, others may come too.
pub const RUNS_AT_ONCE: usize = 8;

/// Reads when polled.
pub struct InlineServer {
    reader: Arc<dyn PageReader>,
    queue: VecDeque<RangeRead>,
    /// Of the runs that were read last.
    open: VecDeque<(Fetched, Part)>,
    cancelled: HashSet<PageId>,
}

impl InlineServer {
    pub fn new(reader: Arc<dyn PageReader>) -> Self {
        Self { reader, queue: VecDeque::new(), open: VecDeque::new(), cancelled: HashSet::new() }
    }

    fn is_queued(&self, page: PageId) -> bool {
        let mut queued = self.queue.iter().flat_map(|read| &read.pages);
        queued.any(|known| known.0 == page) || self.open.iter().any(|(_, part)| part.page == page)
    }

    fn open_next(&mut self) -> Option<(Fetched, Part)> {
        let at_once = if self.reader.is_remote() { RUNS_AT_ONCE } else { 1 };
        let reads: Vec<RangeRead> = self.queue.drain(..at_once.min(self.queue.len())).collect();
        let cancelled = &mut self.cancelled;
        for (fetched, parts) in run::fetch_all(&*self.reader, reads, |page| cancelled.remove(&page)) {
            self.open.extend(parts.into_iter().map(|part| (fetched.clone(), part)));
        }
        self.open.pop_front()
    }
}

impl PageServer for InlineServer {
    fn start(&mut self, read: RangeRead) -> bool {
        self.queue.push_back(read);
        true
    }

    fn cancel(&mut self, page: PageId) {
        if self.is_queued(page) {
            self.cancelled.insert(page);
        }
    }

    fn poll(&mut self) -> Option<Delivery> {
        let (fetched, part) = self.open.pop_front().or_else(|| self.open_next())?;
        let is_cancelled = self.cancelled.remove(&part.page);
        Some(part.deliver(&*self.reader, &fetched, is_cancelled))
    }

    fn poll_within(&mut self, _at_most: Duration) -> Option<Delivery> {
        self.poll()
    }

    fn in_flight(&self) -> usize {
        self.open.len() + self.queue.iter().map(|read| read.pages.len()).sum::<usize>()
    }
}
