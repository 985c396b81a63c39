//! A node of an index tree.

use super::directory::SegmentRef;
use super::segment::{SEGMENT_LEVELS, Segment, quadrants, rank};
use super::tree::IndexTree;
use super::{NodeRecord, ObjectsBelow, ObjectsEntry, ObjectsRecord, Place, TerrainEntry};
use crate::forest::{CellId, Quadrant};

/// A node's place in a tree; as light as an index. The same whichever segments are resident.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct NodeRef {
    pub(super) segment: u32,
    pub(super) node: u32,
}

/// A node of an index tree, with its cell.
#[derive(Clone, Copy)]
pub struct Node<'a> {
    tree: &'a IndexTree,
    segment: &'a Segment,
    at: NodeRef,
    cell: CellId,
}

impl<'a> Node<'a> {
    pub(super) fn new(tree: &'a IndexTree, segment: &'a Segment, at: NodeRef, cell: CellId) -> Self {
        Self { tree, segment, at, cell }
    }

    fn record(&self) -> &'a NodeRecord {
        &self.segment.nodes()[self.at.node as usize]
    }

    pub fn cell(&self) -> CellId {
        self.cell
    }

    pub fn at(&self) -> NodeRef {
        self.at
    }

    pub fn terrain(&self) -> Option<TerrainEntry> {
        self.record().terrain()
    }

    pub fn imagery(&self) -> Option<Place> {
        self.record().imagery()
    }

    /// Lowest and highest drawn height in the subtree, objects included; metres.
    pub fn height_range_m(&self) -> (f64, f64) {
        self.record().height_range_m()
    }

    /// Largest bounding dimension of the objects in the subtree, metres; 0 when there are none.
    pub fn dimension_m(&self) -> f64 {
        self.record().dimension_m()
    }

    /// Largest reach of the objects in the subtree, metres; 0 when there are none.
    pub fn reach_m(&self) -> f64 {
        self.record().reach_m()
    }

    /// The pages of objects rooted at this cell.
    pub fn objects(&self) -> impl Iterator<Item = ObjectsEntry> + use<'a> {
        self.segment.objects()[self.record().objects()].iter().filter_map(ObjectsRecord::page)
    }

    /// What lies in the subtree, of each collection that has pages of groups rooted at this cell.
    pub fn objects_below(&self) -> impl Iterator<Item = ObjectsBelow> + use<'a> {
        self.segment.objects()[self.record().objects()].iter().filter_map(ObjectsRecord::below)
    }

    /// Whether the world has children of the cell, resident or not.
    pub fn has_children(&self) -> bool {
        self.record().children() != 0
    }

    /// Whether the world has a child in a quadrant, resident or not.
    pub fn child_exists(&self, quadrant: Quadrant) -> bool {
        self.record().children() >> quadrant as u32 & 1 == 1
    }

    /// The child in a quadrant; `None` where there is none, or its segment is not resident.
    pub fn child(&self, quadrant: Quadrant) -> Option<Node<'a>> {
        if !self.child_exists(quadrant) {
            return None;
        }
        let cell = self.cell.child(quadrant)?;
        let next = self.child_number(quadrant);
        if cell.level().is_multiple_of(SEGMENT_LEVELS) {
            let segment = self.tree.segment(next)?;
            return Some(Node::new(self.tree, segment, NodeRef { segment: next, node: 0 }, cell));
        }
        Some(Node { at: NodeRef { segment: self.at.segment, node: next }, cell, ..*self })
    }

    /// Its number in this segment; below the last level, that of its segment.
    fn child_number(&self, quadrant: Quadrant) -> u32 {
        let record = self.record();
        record.first_child() + rank(record.children(), quadrant)
    }

    /// Children that are there to be visited.
    pub fn children(&self) -> impl Iterator<Item = Node<'a>> + use<'a> {
        let node = *self;
        Quadrant::ALL.into_iter().filter_map(move |quadrant| node.child(quadrant))
    }

    /// The segment of the child in a quadrant, where the child exists and its segment is not resident.
    pub fn absent_child(&self, quadrant: Quadrant) -> Option<SegmentRef> {
        let cell = self.cell.child(quadrant)?;
        self.absent_children().find(|segment| segment.root == cell)
    }

    /// The segments of those children that exist and are not resident.
    pub fn absent_children(&self) -> impl Iterator<Item = SegmentRef> + use<'a> {
        let node = *self;
        let is_last = (self.cell.level() + 1).is_multiple_of(SEGMENT_LEVELS);
        let mask = if is_last { self.record().children() } else { 0 };
        let numbers = quadrants(mask).map(move |quadrant| node.child_number(quadrant));
        let absent = numbers.filter(move |&number| node.tree.segment(number).is_none());
        absent.filter_map(move |number| Some(node.tree.directory().get(number)?.reference()))
    }

    /// The segment that begins with this node, where it may be removed: neither within a segment nor pinned.
    pub fn paged_segment(&self) -> Option<SegmentRef> {
        let begins = self.at.node == 0 && self.tree.is_paged(self.at.segment);
        begins.then(|| self.tree.directory().get(self.at.segment)).flatten().map(|entry| entry.reference())
    }
}
