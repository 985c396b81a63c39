//! How the footprint is divided, so that its sum is a hard limit.
//!
//! index + world image + scratch + meshes + slack are set aside; the rest is the pool of the request manager, which
//! accounts decoded pages in memory, their GPU parts and reads under way, in one sum over all layers. GPU arenas grow in chunks: what
//! they have allocated beyond the pages in them is fragmentation, which is taken out of the pool as it comes
//! ([`Partition::pool_bytes`]).

use super::{EngineError, Mode, PICK_MESH_BYTES_MAX, Source};
use crate::forest::index::IndexForest;
use crate::paging::least_footprint_bytes;
use crate::render::{GpuLimits, Renderer};
use crate::storage::{ReadLimits, StorageModel};
use crate::units::ByteSize;

/// Encoded bytes and decoder's workspace of one server, bytes.
pub const SCRATCH_PER_SERVER_BYTES: u64 = 2 << 20;
/// The terrain meshes' share of the footprint: 1/8, and no less than this.
pub const MESH_MIN_BYTES: u64 = 2 << 20;
pub(super) const MESH_SHARE: u64 = 8;
/// Set aside for one chunk of each arena that is only begun, bytes.
pub const SLACK_BYTES: u64 = 4 << 20;
/// Uploaded bytes after which the driver is made to let go of its copies, where that may be waited for.
pub const FLUSH_BYTES: u64 = 4 << 20;
/// Stored bytes that one frame in lock-step starts to read: 60 MiB a second at 60 frames.
pub const READ_BYTES_PER_FRAME: u64 = 1 << 20;
/// Ranges under way at most on a disk of unknown kind, and pages in them.
pub const IN_FLIGHT_MAX: usize = 32;
pub const PAGES_IN_FLIGHT_MAX: usize = 1024;
/// Pages on such a disk that lie together are read at once up to this length, and over gaps up to this one: reading on
/// costs it less than another call.
pub const RUN_BYTES: u32 = 128 << 10;
pub const GAP_BYTES: u32 = 4 << 10;
/// Threads that serve each of the three layers in live runs, and so many of worlds behind addresses: there a thread waits
/// for answers nearly all of the time.
pub const THREADS_PER_LAYER: usize = 1;
pub const REMOTE_THREADS_PER_LAYER: usize = 4;
/// What a network is taken for as long as nothing is known of it, but for its bandwidth: of that as much is hoped for as
/// [`REMOTE_BYTES_IN_FLIGHT`] in a latency.
pub const REMOTE_MODEL: StorageModel = StorageModel::WAN;
pub const REMOTE_BYTES_IN_FLIGHT: u64 = 1 << 20;
const LAYERS: u64 = 3;

/// How a run reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reading {
    pub mode: Mode,
    /// Whether reads go over a network.
    pub is_remote: bool,
    /// What the layout that is flown by takes in memory.
    pub layout_bytes: u64,
}

impl Reading {
    pub fn of(mode: Mode, source: &Source) -> Self {
        let layout_bytes = source.layout.as_ref().map_or(0, |layout| layout.byte_len() as u64);
        Self { mode, is_remote: source.reader.is_remote(), layout_bytes }
    }

    pub fn threads_per_layer(self) -> usize {
        if self.is_remote { REMOTE_THREADS_PER_LAYER } else { THREADS_PER_LAYER }
    }

    /// What is read at once of storage of which no more is known; `step_s`: how often pages are asked for, seconds. In
    /// lock-step, near and far worlds are read alike, so that figures are the same.
    pub fn limits(self, step_s: f64) -> ReadLimits {
        if self.is_remote && self.mode != Mode::LockStep {
            return ReadLimits { bytes_in_flight: REMOTE_BYTES_IN_FLIGHT, ..REMOTE_MODEL.reads(step_s) };
        }
        ReadLimits { in_flight: IN_FLIGHT_MAX, bytes_in_flight: u64::MAX, run_bytes: RUN_BYTES, gap_bytes: GAP_BYTES }
    }
}

/// Shares of a footprint, bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Partition {
    pub footprint: u64,
    pub index: u64,
    pub world_image: u64,
    pub scratch: u64,
    pub mesh: u64,
}

impl Partition {
    /// Fails where the footprint is below the least that can work with the world.
    pub fn new(footprint: ByteSize, reading: Reading, index: &IndexForest) -> Result<Self, EngineError> {
        let (index_bytes, world_image, scratch) =
            (index.bytes().fixed() as u64, world_image_bytes(index), scratch_bytes(reading));
        let least = Self::least(reading, index).0;
        let Some(spare) = footprint.0.checked_sub(least) else {
            return Err(EngineError::FootprintTooSmall { asked: footprint, least: ByteSize(least) });
        };
        let mesh = (footprint.0 / MESH_SHARE).clamp(MESH_MIN_BYTES, MESH_MIN_BYTES + spare);
        Ok(Self { footprint: footprint.0, index: index_bytes, world_image, scratch, mesh })
    }

    /// The least footprint that can work with a world.
    pub fn least(reading: Reading, index: &IndexForest) -> ByteSize {
        let fixed = index.bytes().fixed() as u64
            + world_image_bytes(index)
            + scratch_bytes(reading)
            + MESH_MIN_BYTES
            + SLACK_BYTES;
        ByteSize(fixed + least_footprint_bytes(index))
    }

    /// What is set aside for anything but pages and their arenas.
    pub fn fixed_bytes(&self) -> u64 {
        self.index + self.world_image + self.scratch + self.mesh
    }

    /// The request manager's pool while the arenas hold `fragmented` bytes beyond their pages.
    pub fn pool_bytes(&self, fragmented: u64) -> u64 {
        (self.footprint - self.fixed_bytes()).saturating_sub(fragmented.max(SLACK_BYTES))
    }

    /// Either arena may take the whole pool; the request manager holds their sum below it.
    pub fn gpu_limits(&self) -> GpuLimits {
        let arenas = self.footprint - self.fixed_bytes();
        GpuLimits { imagery_bytes: arenas, mesh_bytes: self.mesh, objects_bytes: arenas }
    }
}

/// The world image, where the world has pictures.
fn world_image_bytes(index: &IndexForest) -> u64 {
    let has_pictures = index.trees().any(|tree| tree.root().imagery().is_some());
    if has_pictures { Renderer::world_image_bytes() } else { 0 }
}

/// Decoders' workspace, in live runs what picking keeps, and the layout that is flown by.
fn scratch_bytes(reading: Reading) -> u64 {
    let servers = LAYERS * reading.threads_per_layer() as u64;
    let scratch = match reading.mode {
        Mode::Live => servers * SCRATCH_PER_SERVER_BYTES + PICK_MESH_BYTES_MAX as u64,
        Mode::LockStep | Mode::Settled => SCRATCH_PER_SERVER_BYTES,
    };
    scratch + reading.layout_bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::paging::RUNS_AT_ONCE;
    use crate::storage::REQUEST_BYTES_MAX;

    #[test]
    fn shares_add_up_and_the_least_footprint_is_the_least() {
        let index = IndexForest::default();
        for is_remote in [false, true] {
            let reading = Reading { mode: Mode::Live, is_remote, layout_bytes: 0 };
            let least = match Partition::new(ByteSize(1 << 20), reading, &index) {
                Err(EngineError::FootprintTooSmall { least, .. }) => least,
                other => panic!("{other:?}"),
            };
            assert!(Partition::new(ByteSize(least.0 - 1), reading, &index).is_err());
            for footprint in [least.0, least.0 + 1, 64 << 20, 256 << 20, 8 << 30] {
                let shares = Partition::new(ByteSize(footprint), reading, &index).unwrap();
                assert!(shares.pool_bytes(0) >= least_footprint_bytes(&index));
                assert_eq!(shares.pool_bytes(0) + shares.fixed_bytes() + SLACK_BYTES, footprint);
            }
        }
    }

    #[test]
    fn no_run_is_longer_than_a_request_or_a_servers_scratch() {
        for (mode, is_remote) in [(Mode::Live, true), (Mode::Settled, true), (Mode::Live, false)] {
            let limits = Reading { mode, is_remote, layout_bytes: 0 }.limits(1.0 / 60.0);
            let longest = u64::from(limits.run_bytes).min(limits.bytes_in_flight);
            assert!(longest <= REQUEST_BYTES_MAX && 2 * longest <= SCRATCH_PER_SERVER_BYTES, "{limits:?}");
            let together = if mode == Mode::Settled { RUNS_AT_ONCE as u64 * longest } else { longest };
            assert!(together <= SCRATCH_PER_SERVER_BYTES, "{limits:?}");
        }
    }
}
