//! The arenas as the scene thread sees them: behind a queue of uploads and the changes in display lists.

use super::Shared;
use super::list::Change;
use crate::content::{Page, PageId};
use crate::engine::sink::{Handover, PageSink, SinkUsage};
use crate::render::ArenaFull;
use crossbeam_channel::{Receiver, Sender};
use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::Ordering;

/// A page to upload, once the list of that number is applied: an older page of the same name is removed by then.
pub(super) type Upload = (u64, Page);
pub(super) type Uploaded = (PageId, Result<u64, ArenaFull>);

pub(super) struct Remote {
    shared: Arc<Shared>,
    uploads: Sender<Upload>,
    uploaded: Receiver<Uploaded>,
    /// Number of the last list that was published.
    published: u64,
    /// Not yet confirmed.
    changes: VecDeque<(u64, Change)>,
    /// Memory of removed pages that lists up to a number may still draw from.
    lent: VecDeque<(u64, u64)>,
}

impl Remote {
    pub fn new(shared: Arc<Shared>, uploads: Sender<Upload>, uploaded: Receiver<Uploaded>) -> Self {
        Self { shared, uploads, uploaded, published: 0, changes: VecDeque::new(), lent: VecDeque::new() }
    }

    /// The number of the next list, and the changes that it must bring.
    pub fn publish(&mut self) -> (u64, Vec<(u64, Change)>) {
        let applied = self.shared.applied.load(Ordering::Acquire);
        self.changes.retain(|&(number, _)| number > applied);
        self.lent.retain(|&(number, _)| number > applied);
        self.published += 1;
        (self.published, self.changes.iter().cloned().collect())
    }

    fn next(&self) -> u64 {
        self.published + 1
    }
}

impl PageSink for Remote {
    fn upload(&mut self, page: &Page) -> Handover {
        // The queue holds as many as may be in flight. Where the render thread is gone, this one ends soon too.
        match self.uploads.try_send((self.published, page.clone())) {
            Ok(()) => Handover::Later,
            Err(_) => Handover::Done(Err(ArenaFull { needed_bytes: 0, limit_bytes: 0 })),
        }
    }

    fn poll(&mut self) -> Option<Uploaded> {
        self.uploaded.try_recv().ok()
    }

    fn remove(&mut self, page: PageId, memory_bytes: u64) {
        let next = self.next();
        self.changes.retain(|(_, change)| !matches!(change, Change::Lift(lifted, _) if *lifted == page));
        self.changes.push_back((next, Change::Remove(page)));
        self.lent.push_back((next, memory_bytes));
    }

    fn set_lifts(&mut self, page: PageId, lifts_m: &[f32]) {
        let next = self.next();
        self.changes.retain(|(_, change)| !matches!(change, Change::Lift(lifted, _) if *lifted == page));
        self.changes.push_back((next, Change::Lift(page, lifts_m.into())));
    }

    fn usage(&self) -> SinkUsage {
        SinkUsage {
            allocated: self.shared.allocated_bytes.load(Ordering::Relaxed),
            meshes: self.shared.mesh_bytes.load(Ordering::Relaxed),
            lent: self.lent.iter().map(|&(_, bytes)| bytes).sum(),
        }
    }

    fn flush(&mut self) {}
}
