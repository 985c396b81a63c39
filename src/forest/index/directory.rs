//! What is known of all segments of a zone, resident or not: a file's table.

use super::segment::{SEGMENT_LEVELS, SEGMENT_NODES_MAX, Segment};
use super::{IndexError, NodeRecord, ObjectsRecord, Place};
use crate::forest::{CellId, Zone};
use std::ops::Range;

/// Objects entries of a node at most.
const OBJECTS_PER_NODE_MAX: usize = 255;

/// What is known of a segment that need not be resident; 32 bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SegmentEntry {
    pub root: CellId,
    /// In the zone's index file, bytes.
    pub offset: u64,
    /// Node records, 1 to 1365.
    pub nodes: u32,
    /// Objects records.
    pub objects: u32,
    /// xxh3 of its bytes in the file; 0 in trees that were not read from one.
    pub checksum: u64,
}

const _: () = assert!(size_of::<SegmentEntry>() == 32);

impl SegmentEntry {
    /// Bytes of its records.
    pub fn byte_len(&self) -> usize {
        self.nodes as usize * size_of::<NodeRecord>() + self.objects as usize * size_of::<ObjectsRecord>()
    }

    fn place(&self) -> Option<Place> {
        Place::new(self.offset, u32::try_from(self.byte_len()).ok()?)
    }

    /// The order of segments: breadth first.
    fn key(&self) -> (u8, CellId) {
        (self.root.level(), self.root)
    }

    /// What a reader needs of it; `directory` entries have passed the check that makes the place sound.
    pub(super) fn reference(&self) -> SegmentRef {
        SegmentRef { root: self.root, place: Place { offset: self.offset, len: self.byte_len() as u32 } }
    }
}

/// A segment by name: its root, and where it lies in the zone's index file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct SegmentRef {
    pub root: CellId,
    /// Its length is that of the segment's records, in memory as in the file.
    pub place: Place,
}

/// All segments of a zone, breadth first: the root's first, then by level and by cell. So the segments below one are a
/// row of numbers.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Directory {
    zone: Zone,
    entries: Vec<SegmentEntry>,
    segments_bytes: usize,
}

impl Directory {
    /// Checks all that can be checked without a segment.
    pub fn new(zone: Zone, entries: Vec<SegmentEntry>) -> Result<Self, IndexError> {
        let segments_bytes = entries.iter().map(SegmentEntry::byte_len).fold(0, usize::saturating_add);
        let directory = Self { zone, entries, segments_bytes };
        directory.check()?;
        Ok(directory)
    }

    /// Of segments that lie end to end.
    pub(super) fn of(zone: Zone, segments: &[Segment]) -> Result<Self, IndexError> {
        let mut offset = 0;
        let entries = segments.iter().map(|segment| {
            let (nodes, objects) = (segment.nodes().len() as u32, segment.objects().len() as u32);
            let entry = SegmentEntry { root: segment.root(), offset, nodes, objects, checksum: 0 };
            offset += segment.byte_len().next_multiple_of(8) as u64;
            entry
        });
        Self::new(zone, entries.collect())
    }

    pub fn zone(&self) -> Zone {
        self.zone
    }

    pub fn entries(&self) -> &[SegmentEntry] {
        &self.entries
    }

    /// Bytes of memory that the directory holds.
    pub fn byte_len(&self) -> usize {
        size_of_val(&*self.entries)
    }

    /// Bytes of all segments together.
    pub fn segments_bytes(&self) -> usize {
        self.segments_bytes
    }

    /// Nodes of all segments together.
    pub fn node_count(&self) -> u64 {
        self.entries.iter().map(|entry| u64::from(entry.nodes)).sum()
    }

    /// The number of the segment that begins with `root`.
    pub fn find(&self, root: CellId) -> Option<u32> {
        let found = self.entries.binary_search_by_key(&(root.level(), root), SegmentEntry::key).ok()?;
        Some(found as u32)
    }

    pub fn get(&self, number: u32) -> Option<&SegmentEntry> {
        self.entries.get(number as usize)
    }

    /// The numbers of the segments right below that of `root`.
    pub(super) fn below(&self, root: CellId) -> Range<u32> {
        let level = root.level() + SEGMENT_LEVELS;
        let subtree = root.subtree();
        let before = |cell: &CellId| self.entries.partition_point(|entry| entry.key() < (level, *cell)) as u32;
        before(subtree.start())..self.entries.partition_point(|entry| entry.key() <= (level, *subtree.end())) as u32
    }

    fn check(&self) -> Result<(), IndexError> {
        let malformed = |segment, what| IndexError::Malformed { segment, what };
        if self.entries.first().map(|entry| entry.root) != Some(self.zone.root()) {
            return Err(malformed(self.zone.root(), "it is not the first"));
        }
        if u32::try_from(self.entries.len()).is_err() {
            return Err(malformed(self.zone.root(), "too many segments"));
        }
        if let Some(pair) = self.entries.windows(2).find(|pair| pair[0].key() >= pair[1].key()) {
            return Err(malformed(pair[1].root, "out of order"));
        }
        for entry in &self.entries {
            self.check_entry(entry).map_err(|what| malformed(entry.root, what))?;
        }
        Ok(())
    }

    fn check_entry(&self, entry: &SegmentEntry) -> Result<(), &'static str> {
        let level = entry.root.level();
        if !level.is_multiple_of(SEGMENT_LEVELS) || entry.root.zone() != self.zone {
            return Err("a wrong root");
        }
        let nodes = entry.nodes as usize;
        if nodes == 0 || nodes > SEGMENT_NODES_MAX || entry.objects as usize > nodes * OBJECTS_PER_NODE_MAX {
            return Err("a number of nodes or objects that cannot be");
        }
        if entry.place().is_none() {
            return Err("beyond 2⁴⁰ bytes");
        }
        let above = level.checked_sub(SEGMENT_LEVELS).and_then(|level| entry.root.ancestor(level));
        if above.is_some_and(|root| self.find(root).is_none()) {
            return Err("nothing links to it");
        }
        Ok(())
    }
}
