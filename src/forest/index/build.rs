//! Segments and trees from what is known of cells.

use super::segment::{SEGMENT_LEVELS, Segment};
use super::tree::IndexTree;
use super::{IndexError, NodeInfo, NodeRecord, ObjectsRecord};
use crate::forest::{CellId, Zone};
use std::borrow::Borrow;
use std::collections::{BTreeMap, BTreeSet, VecDeque};

/// A segment, and the roots of those right below it.
pub(super) struct Built {
    pub segment: Segment,
    pub below: Vec<CellId>,
}

/// Builds the segment that begins with `root`. `info` is asked with the node's number in the segment; `first_segment`
/// is the number of the first segment below.
pub(super) fn segment<I: Borrow<NodeInfo>>(
    root: CellId,
    exists: &dyn Fn(CellId) -> bool,
    info: &dyn Fn(CellId, u32) -> I,
    first_segment: u32,
) -> Result<Built, IndexError> {
    let last_level = root.level() + SEGMENT_LEVELS - 1;
    let (mut nodes, mut objects, mut below) = (Vec::new(), Vec::new(), Vec::new());
    let mut queue = VecDeque::from([root]);
    let mut node_count = 1u32;
    while let Some(cell) = queue.pop_front() {
        let info = info(cell, nodes.len() as u32);
        let info = info.borrow();
        let children: Vec<_> = cell.children().filter(|&child| exists(child)).collect();
        let mask = children.iter().filter_map(|child| child.quadrant()).fold(0, |mask, q| mask | 1u32 << q as u32);
        let is_last = cell.level() == last_level;
        let next = if is_last { first_segment + below.len() as u32 } else { node_count };
        let first_child = if children.is_empty() { 0 } else { next };
        if is_last {
            below.extend(children);
        } else {
            node_count += children.len() as u32;
            queue.extend(children);
        }
        nodes.push(NodeRecord::pack(cell, info, mask, first_child, objects.len())?);
        objects.extend(ObjectsRecord::pack(info));
    }
    let segment = Segment::of_records(root, &nodes, &objects);
    let segment = segment.ok_or(IndexError::Malformed { segment: root, what: "records are not aligned" })?;
    Ok(Built { segment, below })
}

/// Tells the roots of pages below which there is one collection alone; call it before a tree is built of cells whose
/// objects changed.
pub fn mark_alone(cells: &mut BTreeMap<CellId, NodeInfo>) {
    let mut below: BTreeMap<CellId, BTreeSet<u8>> = BTreeMap::new();
    for (cell, info) in cells.iter().filter(|(_, info)| !info.objects.is_empty()) {
        let collections: BTreeSet<u8> = info.objects.iter().map(|entry| entry.collection).collect();
        for above in cell.ancestors() {
            below.entry(above).or_default().extend(&collections);
        }
    }
    for (cell, info) in cells {
        let alone = below.get(cell).is_some_and(|collections| collections.len() == 1);
        info.below.iter_mut().for_each(|below| below.alone = alone);
    }
}

impl IndexTree {
    /// Builds the tree, whole; every cell but the root needs its parent among the cells.
    pub fn build(zone: Zone, cells: &BTreeMap<CellId, NodeInfo>) -> Result<Self, IndexError> {
        if !cells.contains_key(&zone.root()) {
            return Err(IndexError::Orphan(zone.root()));
        }
        for &cell in cells.keys() {
            if cell.zone() != zone {
                return Err(IndexError::WrongZone(cell, zone));
            }
            if cell.parent().is_some_and(|parent| !cells.contains_key(&parent)) {
                return Err(IndexError::Orphan(cell));
            }
        }
        let mut roots = VecDeque::from([zone.root()]);
        let mut segments = Vec::new();
        while let Some(root) = roots.pop_front() {
            // Those in the queue come first, this one before them.
            let first_segment = (segments.len() + 1 + roots.len()) as u32;
            let built = segment(root, &|cell| cells.contains_key(&cell), &|cell, _| &cells[&cell], first_segment)?;
            roots.extend(built.below);
            segments.push(built.segment);
        }
        Self::from_segments(zone, segments)
    }
}
