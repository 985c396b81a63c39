//! The request manager: a value. Demands in, commands out, completions in.

use crate::content::PageId;
use crate::forest::index::Place;
use crate::select::Demand;

/// Hard limits, each of which is named in the report.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// All bytes held: decoded pages, GPU parts, reads under way.
    pub footprint_bytes: u64,
    pub in_flight: usize,
    /// Bytes that one update may start to read.
    pub read_bytes_per_update: u64,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Command {
    Start { page: PageId, place: Place },
    Cancel(PageId),
    Evict(PageId),
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Completion {
    /// Resident now, with the bytes it holds in memory and on the GPU.
    Loaded { bytes: u64 },
    /// To be tried again after a while.
    Failed,
    /// Never to be tried again: the page is broken.
    Broken,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Event {
    pub page: PageId,
    pub completion: Completion,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct ManagerStats {
    pub started: u64,
    pub cancelled: u64,
    pub failed: u64,
    pub evicted: u64,
    pub resident_pages: u64,
    pub resident_bytes: u64,
    pub in_flight: u64,
}

#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ManagerError {
    #[error("a footprint of {asked} cannot work here: at least {least} are needed; raise --footprint")]
    FootprintTooSmall { asked: crate::units::ByteSize, least: crate::units::ByteSize },
}

pub struct RequestManager {}

impl RequestManager {
    pub fn new(_limits: Limits) -> Result<Self, ManagerError> {
        todo!()
    }

    /// Demands of the frame in any order, resident pages included; `now_secs` from any start.
    pub fn update(&mut self, _demands: &[Demand], _now_secs: f64) -> Vec<Command> {
        todo!()
    }

    pub fn complete(&mut self, _event: Event, _now_secs: f64) {
        todo!()
    }

    pub fn stats(&self) -> ManagerStats {
        todo!()
    }
}
