//! Storage as a model: how long reads take on a disk or over a network, and what goes wrong there.
//!
//! [`Disk`] is a queueing model over times that its user tells: it reads no clock, file or thread, and the same
//! requests at the same times give the same arrivals to the bit. Virtual runs ask it directly; live runs are held back by it.

mod disk;
mod fates;
mod faults;
mod model;
mod service;

pub use disk::{Counters, Disk, QUEUE_MAX};
pub use fates::ATTEMPTS_MAX;
pub use faults::{DEAD_TIMEOUT_SECS, Faults, FaultsError};
pub use model::{PARALLEL_MAX, ReadLimits, StorageModel, StorageModelError};

/// Largest request, bytes: 1 MiB. Who asks cuts longer runs; only a page that is larger by itself, and a run of a
/// single-seek layout, may be longer.
pub const REQUEST_BYTES_MAX: u64 = 1 << 20;

/// A transfer can be given up at the ends of blocks of this size, counted from the request's start: 64 KiB. Varadhan &
/// Manocha 2002 pre-empt reads between blocks.
pub const BLOCK_BYTES: u64 = 64 << 10;

/// One contiguous range of one file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Request {
    /// Names the request in [`Arrival`] and [`Disk::cancel`]; no two in flight have the same.
    pub id: u64,
    pub file: u32,
    /// Where the range starts in its file, bytes.
    pub offset: u64,
    /// Where its parts end, bytes from `offset`; ascending, above 0, at least one. The last one ends the range; bytes
    /// between parts that nobody wants are read all the same.
    pub parts: Vec<u64>,
}

impl Request {
    /// Bytes of the whole range.
    pub fn len_bytes(&self) -> u64 {
        self.parts.last().copied().unwrap_or(0)
    }

    fn end(&self) -> Position {
        Position { file: self.file, offset: self.offset.saturating_add(self.len_bytes()) }
    }
}

/// A place in a file: where a range starts or ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Position {
    file: u32,
    offset: u64,
}

/// How the reading of a part ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PartOutcome {
    Ok,
    /// This attempt failed; another one may succeed.
    Failed,
    /// What is stored is wrong and stays so.
    Corrupt,
}

/// A part's last byte is there, or will not come.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arrival {
    pub id: u64,
    /// Which of the request's parts, from 0.
    pub part: usize,
    pub at_s: f64,
    pub outcome: PartOutcome,
}
