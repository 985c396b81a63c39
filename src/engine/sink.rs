//! Where decoded pages go to be drawn: into the renderer at once, or to the thread that has it.

use crate::content::{Page, PageId};
use crate::render::{ArenaFull, Renderer};

/// What became of a page that was handed over.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Handover {
    /// It is drawable and takes so many bytes of its arena, or it did not fit.
    Done(Result<u64, ArenaFull>),
    /// [`PageSink::poll`] will tell.
    Later,
}

/// What the arenas hold, bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SinkUsage {
    /// Allocated in all arenas.
    pub allocated: u64,
    /// Of it in the cache of terrain meshes.
    pub meshes: u64,
    /// In memory, of pages that were removed and may still be drawn from.
    pub lent: u64,
    /// All that removed pages hold until their removal is confirmed, here and in the arenas: it will come back.
    pub leaving: u64,
}

pub trait PageSink {
    fn upload(&mut self, page: &Page) -> Handover;
    /// The next page that became drawable, or did not fit, of those that were to come later.
    fn poll(&mut self) -> Option<(PageId, Result<u64, ArenaFull>)>;
    /// Drops a page that holds so many bytes on the GPU and beside it.
    fn remove(&mut self, page: PageId, gpu_bytes: u64, memory_bytes: u64);
    fn set_lifts(&mut self, page: PageId, lifts_m: &[f32]);
    fn usage(&self) -> SinkUsage;
    /// Waits until the driver lets go of its copies of what was uploaded, where that can be waited for.
    fn flush(&mut self);
}

impl PageSink for Renderer {
    fn upload(&mut self, page: &Page) -> Handover {
        Handover::Done(self.upload(page))
    }

    fn poll(&mut self) -> Option<(PageId, Result<u64, ArenaFull>)> {
        None
    }

    fn remove(&mut self, page: PageId, _gpu_bytes: u64, _memory_bytes: u64) {
        self.remove(page);
    }

    fn set_lifts(&mut self, page: PageId, lifts_m: &[f32]) {
        self.set_lifts(page, lifts_m);
    }

    fn usage(&self) -> SinkUsage {
        SinkUsage { allocated: self.allocated_bytes(), meshes: self.mesh_bytes(), lent: 0, leaving: 0 }
    }

    fn flush(&mut self) {
        self.flush_uploads();
    }
}
