//! The index tree of a zone: its directory, and those of its segments that are resident.

use super::directory::{Directory, SegmentRef};
use super::node::{Node, NodeRef};
use super::segment::{SEGMENT_LEVELS, Segment};
use super::{IndexBytes, IndexError};
use crate::forest::{CellId, Zone};
use std::collections::BTreeMap;
use std::sync::Arc;

/// How long a segment stays.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stay {
    /// As long as its tree.
    Pinned,
    /// Until it is removed.
    Paged,
}

#[derive(Clone)]
struct Resident {
    segment: Segment,
    stay: Stay,
}

/// The index tree of one zone. The root's segment is always resident; what other segments hold is there while they
/// are. Cheap to clone; a clone may be changed without changing the other.
#[derive(Clone)]
pub struct IndexTree {
    directory: Arc<Directory>,
    top: Segment,
    /// By number, the first left out.
    resident: Arc<BTreeMap<u32, Resident>>,
    pinned_bytes: usize,
    paged_bytes: usize,
}

impl IndexTree {
    /// Takes all segments as read, the zone's root first, and keeps them. Checks every link, so that traversal cannot
    /// fail.
    pub fn from_segments(zone: Zone, segments: Vec<Segment>) -> Result<Self, IndexError> {
        Self::whole(Directory::of(zone, &segments)?, segments)
    }

    /// The same with a directory, in whose order the segments are.
    pub fn whole(directory: Directory, segments: Vec<Segment>) -> Result<Self, IndexError> {
        let mut segments = segments.into_iter();
        let top = segments.next().ok_or(IndexError::Missing(directory.zone().root()))?;
        let mut tree = Self::paged(directory, top)?;
        for segment in segments {
            tree.insert(segment, Stay::Pinned)?;
        }
        let absent = tree.absent_segments().next();
        absent.map_or(Ok(tree), |absent| Err(IndexError::Missing(absent.root)))
    }

    /// A tree of which only the root's segment is resident, for good.
    pub fn paged(directory: Directory, top: Segment) -> Result<Self, IndexError> {
        let root = directory.zone().root();
        if top.root() != root {
            return Err(IndexError::Missing(root));
        }
        let pinned_bytes = top.byte_len();
        let resident = Arc::default();
        let tree = Self { directory: Arc::new(directory), top, resident, pinned_bytes, paged_bytes: 0 };
        tree.check_segment(&tree.top)?;
        Ok(tree)
    }

    pub fn zone(&self) -> Zone {
        self.directory.zone()
    }

    pub fn directory(&self) -> &Directory {
        &self.directory
    }

    /// Makes a segment resident until it is removed. Checks every link of it. One that is resident already stays.
    pub fn insert_segment(&mut self, segment: Segment) -> Result<(), IndexError> {
        self.insert(segment, Stay::Paged)
    }

    /// Drops a segment that was inserted; false when it was not resident, or stays for good. What is resident below
    /// it cannot be reached until it comes back.
    pub fn remove_segment(&mut self, root: CellId) -> bool {
        let Some(number) = self.directory.find(root) else { return false };
        if self.resident.get(&number).is_none_or(|found| found.stay == Stay::Pinned) {
            return false;
        }
        if let Some(removed) = Arc::make_mut(&mut self.resident).remove(&number) {
            self.paged_bytes -= removed.segment.byte_len();
        }
        true
    }

    fn insert(&mut self, segment: Segment, stay: Stay) -> Result<(), IndexError> {
        let number = self.check_segment(&segment)?;
        if self.segment(number).is_some() {
            return Ok(());
        }
        match stay {
            Stay::Pinned => self.pinned_bytes += segment.byte_len(),
            Stay::Paged => self.paged_bytes += segment.byte_len(),
        }
        Arc::make_mut(&mut self.resident).insert(number, Resident { segment, stay });
        Ok(())
    }

    /// Checks that a segment is the one that the directory tells, that its links hold, and that they lead to those
    /// segments that the directory has below it; gives its number.
    pub fn check_segment(&self, segment: &Segment) -> Result<u32, IndexError> {
        let root = segment.root();
        let malformed = |what| IndexError::Malformed { segment: root, what };
        let number = self.directory.find(root).ok_or_else(|| malformed("the directory does not name it"))?;
        let told = self.directory.get(number).map(|entry| (entry.nodes as usize, entry.objects as usize));
        if told != Some((segment.nodes().len(), segment.objects().len())) {
            return Err(malformed("another number of nodes or objects than the directory tells"));
        }
        let below = self.directory.below(root);
        let links = segment.check(below.start).map_err(malformed)?;
        let told = below.filter_map(|number| self.directory.get(number)).map(|entry| entry.root);
        if !links.into_iter().eq(told) {
            return Err(malformed("other segments below it than the directory tells"));
        }
        Ok(number)
    }

    pub fn is_resident(&self, root: CellId) -> bool {
        self.directory.find(root).is_some_and(|number| self.segment(number).is_some())
    }

    /// Whether all segments are resident.
    pub fn is_whole(&self) -> bool {
        self.resident.len() + 1 == self.directory.entries().len()
    }

    /// Segments that are not resident.
    pub fn absent_segments(&self) -> impl Iterator<Item = SegmentRef> + '_ {
        let numbered = self.directory.entries().iter().zip(0..);
        numbered.filter(|(_, number)| self.segment(*number).is_none()).map(|(entry, _)| entry.reference())
    }

    /// Resident segments, breadth first; those below an absent one too.
    pub fn segments(&self) -> impl Iterator<Item = &Segment> {
        std::iter::once(&self.top).chain(self.resident.values().map(|resident| &resident.segment))
    }

    pub(super) fn segment(&self, number: u32) -> Option<&Segment> {
        if number == 0 { Some(&self.top) } else { self.resident.get(&number).map(|resident| &resident.segment) }
    }

    pub(super) fn is_paged(&self, number: u32) -> bool {
        self.resident.get(&number).is_some_and(|resident| resident.stay == Stay::Paged)
    }

    pub fn bytes(&self) -> IndexBytes {
        IndexBytes {
            directory: self.directory.byte_len(),
            pinned: self.pinned_bytes,
            paged: self.paged_bytes,
            absent: self.directory.segments_bytes() - self.pinned_bytes - self.paged_bytes,
        }
    }

    pub fn root(&self) -> Node<'_> {
        Node::new(self, &self.top, NodeRef { segment: 0, node: 0 }, self.zone().root())
    }

    /// The node of a cell; `None` when the world has nothing there, or its segment is not resident.
    pub fn find(&self, cell: CellId) -> Option<Node<'_>> {
        let deepest = (cell.zone() == self.zone()).then(|| self.find_deepest(cell))?;
        (deepest.cell() == cell).then_some(deepest)
    }

    /// The deepest resident node on the way to a cell, the cell itself included.
    pub fn find_deepest(&self, cell: CellId) -> Node<'_> {
        let mut node = self.root();
        for level in 1..=cell.level() {
            let next = cell.ancestor(level).and_then(CellId::quadrant).and_then(|quadrant| node.child(quadrant));
            match next {
                Some(child) => node = child,
                None => break,
            }
        }
        node
    }

    /// All nodes that are resident and can be reached, parents before children.
    pub fn nodes(&self) -> impl Iterator<Item = Node<'_>> {
        let mut stack = vec![self.root()];
        std::iter::from_fn(move || {
            let node = stack.pop()?;
            stack.extend(node.children().collect::<Vec<_>>().into_iter().rev());
            Some(node)
        })
    }

    /// The segments on the way to a cell that exist by the directory, below the zone's root.
    pub fn segments_towards(&self, cell: CellId) -> impl Iterator<Item = SegmentRef> + '_ {
        let levels = (SEGMENT_LEVELS..=cell.level()).step_by(usize::from(SEGMENT_LEVELS));
        let numbers = levels.filter_map(move |level| self.directory.find(cell.ancestor(level)?));
        numbers.filter_map(|number| Some(self.directory.get(number)?.reference()))
    }
}
