//! Index trees: all that is needed to decide, and no payload (Davis et al. 1999, §III; Varadhan & Manocha 2002, §3.2,
//! *skeleton*). Per zone, cut into segments of six levels.
//!
//! A node takes 32 bytes, an entry for the objects of a collection 12, a segment's entry in the directory 32; traversal
//! needs no page. A tree need not have all its segments: where one is absent, the node above tells that there is more.

mod build;
mod directory;
mod forest;
mod node;
mod segment;
pub mod synthetic;
mod tree;

pub use super::record::{NodeInfo, NodeRecord, ObjectsBelow, ObjectsEntry, ObjectsRecord, Place, TerrainEntry};
pub use build::mark_alone;
pub use directory::{Directory, SegmentEntry, SegmentRef};
pub use forest::IndexForest;
pub use node::{Node, NodeRef};
pub use segment::{SEGMENT_LEVELS, SEGMENT_NODES_MAX, Segment, SharedBytes, aligned};
pub use tree::IndexTree;

use super::{CellId, Zone};

#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum IndexError {
    #[error("cell {0} has no parent in the index")]
    Orphan(CellId),
    #[error("cell {0} is not of zone {1:?}")]
    WrongZone(CellId, Zone),
    #[error("the imagery page of cell {0} does not follow its terrain page")]
    Apart(CellId),
    #[error("cell {0} has more than 255 object pages")]
    TooManyObjects(CellId),
    #[error("a page of cell {0} lies beyond 2⁴⁰ bytes or is longer than 2²⁴: cut the world into smaller pages")]
    TooLarge(CellId),
    #[error("the segment of cell {segment}: {what}")]
    Malformed { segment: CellId, what: &'static str },
    #[error("the segment of cell {0} is missing")]
    Missing(CellId),
}

/// Bytes of an index: what is in memory, and what is not.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct IndexBytes {
    pub directory: usize,
    /// Segments that stay.
    pub pinned: usize,
    /// Segments that were inserted and may be removed.
    pub paged: usize,
    /// Segments that are not in memory.
    pub absent: usize,
}

impl IndexBytes {
    /// What stays in memory whatever comes and goes.
    pub fn fixed(&self) -> usize {
        self.directory + self.pinned
    }

    pub fn resident(&self) -> usize {
        self.fixed() + self.paged
    }

    /// Of the whole index.
    pub fn total(&self) -> usize {
        self.resident() + self.absent
    }
}

impl std::iter::Sum for IndexBytes {
    fn sum<I: Iterator<Item = Self>>(parts: I) -> Self {
        parts.fold(Self::default(), |sum, part| Self {
            directory: sum.directory + part.directory,
            pinned: sum.pinned + part.pinned,
            paged: sum.paged + part.paged,
            absent: sum.absent + part.absent,
        })
    }
}
