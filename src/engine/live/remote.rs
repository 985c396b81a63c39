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
    /// Of removed pages that lists before a number may still draw from.
    leaving: VecDeque<Leaving>,
    /// What the arenas held when last looked at.
    allocated_bytes: u64,
}

struct Leaving {
    number: u64,
    gpu_bytes: u64,
    memory_bytes: u64,
}

impl Remote {
    pub fn new(shared: Arc<Shared>, uploads: Sender<Upload>, uploaded: Receiver<Uploaded>) -> Self {
        Self {
            shared,
            uploads,
            uploaded,
            published: 0,
            changes: VecDeque::new(),
            leaving: VecDeque::new(),
            allocated_bytes: 0,
        }
    }

    /// The number of the next list, and the changes that it must bring.
    pub fn publish(&mut self) -> (u64, Vec<(u64, Change)>) {
        self.confirm();
        self.published += 1;
        (self.published, self.changes.iter().cloned().collect())
    }

    /// Forgets what the render thread has done since; true when removed pages or chunks have gone, so that there is room
    /// again.
    pub fn confirm(&mut self) -> bool {
        let applied = self.shared.applied.load(Ordering::Acquire);
        let before = self.leaving.len();
        self.changes.retain(|&(number, _)| number > applied);
        self.leaving.retain(|page| page.number > applied);
        let allocated_bytes = self.shared.allocated_bytes.load(Ordering::Relaxed);
        let shrank = allocated_bytes < std::mem::replace(&mut self.allocated_bytes, allocated_bytes);
        self.leaving.len() < before || shrank
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

    fn remove(&mut self, page: PageId, gpu_bytes: u64, memory_bytes: u64) {
        let next = self.next();
        self.changes.retain(|(_, change)| !matches!(change, Change::Lift(lifted, _) if *lifted == page));
        self.changes.push_back((next, Change::Remove(page)));
        self.leaving.push_back(Leaving { number: next, gpu_bytes, memory_bytes });
    }

    fn set_lifts(&mut self, page: PageId, lifts_m: &[f32]) {
        let next = self.next();
        self.changes.retain(|(_, change)| !matches!(change, Change::Lift(lifted, _) if *lifted == page));
        self.changes.push_back((next, Change::Lift(page, lifts_m.into())));
    }

    fn usage(&self) -> SinkUsage {
        // Read before what is allocated, which was told before it.
        let applied = self.shared.applied.load(Ordering::Acquire);
        let leaving = || self.leaving.iter().filter(|page| page.number > applied);
        let lent = leaving().map(|page| page.memory_bytes).sum();
        SinkUsage {
            allocated: self.shared.allocated_bytes.load(Ordering::Relaxed),
            meshes: self.shared.mesh_bytes.load(Ordering::Relaxed),
            lent,
            leaving: lent + leaving().map(|page| page.gpu_bytes).sum::<u64>(),
        }
    }

    fn flush(&mut self) {}
}
