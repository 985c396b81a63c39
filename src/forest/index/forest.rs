//! The index trees of a world.

use super::{CellId, IndexBytes, IndexError, IndexTree, Node, Segment, SegmentRef, Zone};

/// The index trees of a world. Cheap to clone; a clone may be changed without changing the other.
#[derive(Clone, Default)]
pub struct IndexForest {
    trees: [Option<IndexTree>; Zone::COUNT],
}

impl IndexForest {
    pub fn insert(&mut self, tree: IndexTree) {
        let at = tree.zone().index();
        self.trees[at] = Some(tree);
    }

    pub fn tree(&self, zone: Zone) -> Option<&IndexTree> {
        self.trees[zone.index()].as_ref()
    }

    pub fn trees(&self) -> impl Iterator<Item = &IndexTree> {
        self.trees.iter().flatten()
    }

    /// Makes a segment resident; see [`IndexTree::insert_segment`].
    pub fn insert_segment(&mut self, segment: Segment) -> Result<(), IndexError> {
        let root = segment.root();
        let tree = self.trees[root.zone().index()].as_mut();
        tree.ok_or(IndexError::Malformed { segment: root, what: "its zone has no index" })?.insert_segment(segment)
    }

    /// Drops a segment; see [`IndexTree::remove_segment`].
    pub fn remove_segment(&mut self, root: CellId) -> bool {
        self.trees[root.zone().index()].as_mut().is_some_and(|tree| tree.remove_segment(root))
    }

    /// What the directory tells of the segment that begins with `root`, resident or not.
    pub fn segment(&self, root: CellId) -> Option<SegmentRef> {
        let directory = self.tree(root.zone())?.directory();
        Some(directory.get(directory.find(root)?)?.reference())
    }

    pub fn find(&self, cell: CellId) -> Option<Node<'_>> {
        self.tree(cell.zone())?.find(cell)
    }

    pub fn find_deepest(&self, cell: CellId) -> Option<Node<'_>> {
        Some(self.tree(cell.zone())?.find_deepest(cell))
    }

    /// Whether all segments of all trees are resident.
    pub fn is_whole(&self) -> bool {
        self.trees().all(IndexTree::is_whole)
    }

    pub fn bytes(&self) -> IndexBytes {
        self.trees().map(IndexTree::bytes).sum()
    }

    /// Bytes in memory: segments and directories.
    pub fn byte_len(&self) -> usize {
        self.bytes().resident()
    }

    /// Nodes of the whole index.
    pub fn node_count(&self) -> u64 {
        self.trees().map(|tree| tree.directory().node_count()).sum()
    }
}
