//! Up to six levels of a zone's tree: bytes, and what they say by themselves.

use super::{NodeRecord, ObjectsRecord};
use crate::forest::{CellId, Quadrant};
use std::collections::VecDeque;
use std::fmt;
use std::ops::Range;
use std::sync::Arc;

/// Levels in a segment; a segment's root is at a multiple of it.
pub const SEGMENT_LEVELS: u8 = 6;
/// Nodes of a segment at most: all cells of six levels.
pub const SEGMENT_NODES_MAX: usize = ((1 << (2 * SEGMENT_LEVELS)) - 1) / 3;

/// Bytes that stay where and as they are.
pub type SharedBytes = Arc<dyn AsRef<[u8]> + Send + Sync>;

/// Up to six levels of a zone's tree, as bytes: records of nodes (breadth first), then of objects. Cheap to clone.
#[derive(Clone)]
pub struct Segment {
    root: CellId,
    bytes: SharedBytes,
    nodes: Range<usize>,
    objects: Range<usize>,
}

impl Segment {
    /// A view of `node_count` nodes at `at` in `bytes` and the objects entries behind them.
    /// The node records must be aligned to 8 bytes in memory.
    pub fn new(root: CellId, bytes: SharedBytes, at: usize, node_count: usize, objects_count: usize) -> Option<Self> {
        let nodes_end = at.checked_add(node_count.checked_mul(size_of::<NodeRecord>())?)?;
        let end = nodes_end.checked_add(objects_count.checked_mul(size_of::<ObjectsRecord>())?)?;
        let slice = (*bytes).as_ref().get(at..end)?;
        bytemuck::try_cast_slice::<u8, NodeRecord>(&slice[..nodes_end - at]).ok()?;
        bytemuck::try_cast_slice::<u8, ObjectsRecord>(&slice[nodes_end - at..]).ok()?;
        Some(Self { root, bytes, nodes: at..nodes_end, objects: nodes_end..end })
    }

    /// The same over a copy of bytes that begin with the node records, wherever they lie in memory.
    pub fn copied(root: CellId, bytes: &[u8], node_count: usize, objects_count: usize) -> Option<Self> {
        Self::new(root, aligned(bytes), 0, node_count, objects_count)
    }

    pub(super) fn of_records(root: CellId, nodes: &[NodeRecord], objects: &[ObjectsRecord]) -> Option<Self> {
        let mut bytes: Vec<u8> = bytemuck::cast_slice(nodes).to_vec();
        bytes.extend_from_slice(bytemuck::cast_slice(objects));
        Self::copied(root, &bytes, nodes.len(), objects.len())
    }

    pub fn root(&self) -> CellId {
        self.root
    }

    pub fn nodes(&self) -> &[NodeRecord] {
        bytemuck::cast_slice(&(*self.bytes).as_ref()[self.nodes.clone()])
    }

    pub fn objects(&self) -> &[ObjectsRecord] {
        bytemuck::cast_slice(&(*self.bytes).as_ref()[self.objects.clone()])
    }

    /// As it lies in a file: node records, then objects records.
    pub fn as_bytes(&self) -> &[u8] {
        &(*self.bytes).as_ref()[self.nodes.start..self.objects.end]
    }

    pub fn byte_len(&self) -> usize {
        self.nodes.len() + self.objects.len()
    }

    /// Follows the links breadth first, as they were written, and gives the cells that further segments begin with,
    /// in their order. `first_segment`: the number of the first of those.
    pub(super) fn check(&self, first_segment: u32) -> Result<Vec<CellId>, &'static str> {
        let last_level = self.root.level() + SEGMENT_LEVELS - 1;
        let mut next_node = 1;
        let mut below = Vec::new();
        let mut cells = VecDeque::from([self.root]);
        for record in self.nodes() {
            let cell = cells.pop_front().ok_or("more nodes than links")?;
            check_record(record, cell, self.objects().len())?;
            if record.children() == 0 {
                continue;
            }
            let children = quadrants(record.children()).filter_map(|quadrant| cell.child(quadrant));
            let first = if cell.level() == last_level {
                let first = first_segment.saturating_add(below.len() as u32);
                below.extend(children);
                first
            } else {
                let first = next_node;
                cells.extend(children);
                next_node += record.children().count_ones();
                first
            };
            if record.first_child() != first {
                return Err("a child link out of order");
            }
        }
        if next_node as usize != self.nodes().len() {
            return Err("fewer nodes than links");
        }
        Ok(below)
    }
}

impl fmt::Debug for Segment {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (nodes, objects) = (self.nodes().len(), self.objects().len());
        write!(f, "Segment {{ root: {}, nodes: {nodes}, objects: {objects} }}", self.root)
    }
}

/// A copy of bytes at a multiple of 8 in memory, as segments need them.
pub fn aligned(bytes: &[u8]) -> SharedBytes {
    let mut words = vec![0u64; bytes.len().div_ceil(size_of::<u64>())];
    bytemuck::cast_slice_mut::<u64, u8>(&mut words)[..bytes.len()].copy_from_slice(bytes);
    Arc::new(Aligned { words, len: bytes.len() })
}

struct Aligned {
    words: Vec<u64>,
    len: usize,
}

impl AsRef<[u8]> for Aligned {
    fn as_ref(&self) -> &[u8] {
        &bytemuck::cast_slice(&self.words)[..self.len]
    }
}

/// What a record says by itself.
fn check_record(record: &NodeRecord, cell: CellId, objects_count: usize) -> Result<(), &'static str> {
    if !record.is_error_a_length() {
        return Err("an error that is no length");
    }
    if record.objects().end > objects_count {
        return Err("an objects link beyond the end");
    }
    if record.children() > 15 {
        return Err("a child mask with unknown bits");
    }
    if quadrants(record.children()).any(|quadrant| cell.child(quadrant).is_none()) {
        return Err("a child that cannot exist");
    }
    Ok(())
}

pub(super) fn quadrants(mask: u32) -> impl Iterator<Item = Quadrant> {
    Quadrant::ALL.into_iter().filter(move |&quadrant| mask >> quadrant as u32 & 1 == 1)
}

/// How many children stand before `quadrant`.
pub(super) fn rank(mask: u32, quadrant: Quadrant) -> u32 {
    (mask & ((1 << quadrant as u32) - 1)).count_ones()
}
