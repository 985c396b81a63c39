//! Index trees: all that is needed to decide, and no payload (Davis et al. 1999, §III; Varadhan & Manocha 2002, §3.2,
//! *skeleton*). Per zone, cut into segments of six levels.
//!
//! A node takes 32 bytes, an entry for the objects of a collection 12; traversal needs no page.

pub use super::record::{NodeInfo, NodeRecord, ObjectsEntry, ObjectsRecord, Place, TerrainEntry};
use super::{CellId, Quadrant, Zone};
use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

/// Levels in a segment; a segment's root is at a multiple of it.
pub const SEGMENT_LEVELS: u8 = 6;
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
    #[error("segment {segment}: {what}")]
    Malformed { segment: u32, what: &'static str },
}

/// Up to six levels of a zone's tree, as bytes: records of nodes (breadth first), then of objects.
#[derive(Clone)]
pub struct Segment {
    root: CellId,
    bytes: Arc<dyn AsRef<[u8]> + Send + Sync>,
    nodes: std::ops::Range<usize>,
    objects: std::ops::Range<usize>,
}

impl Segment {
    /// A view of `node_count` nodes at `at` in `bytes` and the objects entries behind them.
    /// The node records must be aligned to 8 bytes in memory.
    pub fn new(
        root: CellId,
        bytes: Arc<dyn AsRef<[u8]> + Send + Sync>,
        at: usize,
        node_count: usize,
        objects_count: usize,
    ) -> Option<Self> {
        let nodes_end = at.checked_add(node_count.checked_mul(size_of::<NodeRecord>())?)?;
        let end = nodes_end.checked_add(objects_count.checked_mul(size_of::<ObjectsRecord>())?)?;
        let slice = (*bytes).as_ref().get(at..end)?;
        bytemuck::try_cast_slice::<u8, NodeRecord>(&slice[..nodes_end - at]).ok()?;
        bytemuck::try_cast_slice::<u8, ObjectsRecord>(&slice[nodes_end - at..]).ok()?;
        Some(Self { root, bytes, nodes: at..nodes_end, objects: nodes_end..end })
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

    pub fn byte_len(&self) -> usize {
        self.nodes.len() + self.objects.len()
    }
}

/// A node's place in a tree; as light as an index.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct NodeRef {
    segment: u32,
    node: u32,
}

/// The index tree of one zone.
#[derive(Clone)]
pub struct IndexTree {
    zone: Zone,
    segments: Vec<Segment>,
}

impl IndexTree {
    /// Takes segments as read: the first is the zone's root. Checks every link, so that traversal cannot fail.
    pub fn from_segments(zone: Zone, segments: Vec<Segment>) -> Result<Self, IndexError> {
        let tree = Self { zone, segments };
        tree.check()?;
        Ok(tree)
    }

    /// Builds the tree; every cell but the root needs its parent among the cells.
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
        let mut segment_count = 1;
        let mut segments = Vec::new();
        while let Some(root) = roots.pop_front() {
            segments.push(build_segment(root, cells, &mut roots, &mut segment_count)?);
        }
        Self::from_segments(zone, segments)
    }

    pub fn zone(&self) -> Zone {
        self.zone
    }

    pub fn segments(&self) -> &[Segment] {
        &self.segments
    }

    pub fn byte_len(&self) -> usize {
        self.segments.iter().map(Segment::byte_len).sum()
    }

    pub fn root(&self) -> Node<'_> {
        Node { tree: self, at: NodeRef { segment: 0, node: 0 }, cell: self.zone.root() }
    }

    /// The node of a cell; `None` when the world has nothing there.
    pub fn find(&self, cell: CellId) -> Option<Node<'_>> {
        let mut node = (cell.zone() == self.zone).then(|| self.root())?;
        for level in 1..=cell.level() {
            node = node.child(cell.ancestor(level)?.quadrant()?)?;
        }
        Some(node)
    }

    /// The deepest node on the way to a cell, the cell itself included.
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

    /// All nodes, parents before children.
    pub fn nodes(&self) -> impl Iterator<Item = Node<'_>> {
        let mut stack = vec![self.root()];
        std::iter::from_fn(move || {
            let node = stack.pop()?;
            stack.extend(node.children().collect::<Vec<_>>().into_iter().rev());
            Some(node)
        })
    }

    fn check(&self) -> Result<(), IndexError> {
        let mut roots_seen = 1;
        for (at, segment) in self.segments.iter().enumerate() {
            let malformed = |what| IndexError::Malformed { segment: at as u32, what };
            if segment.root.level() % SEGMENT_LEVELS != 0
                || segment.root.zone() != self.zone
                || segment.nodes().is_empty()
            {
                return Err(malformed("a wrong root or no node"));
            }
            if at == 0 && segment.root != self.zone.root() {
                return Err(malformed("the first segment is not the zone's root"));
            }
            self.check_segment(segment, &mut roots_seen).map_err(malformed)?;
        }
        if roots_seen as usize != self.segments.len() {
            return Err(IndexError::Malformed { segment: roots_seen, what: "a segment that nothing links to" });
        }
        Ok(())
    }

    /// Follows the links breadth first, as they were written. `roots_seen` counts the segments linked to so far.
    fn check_segment(&self, segment: &Segment, roots_seen: &mut u32) -> Result<(), &'static str> {
        let last_level = segment.root.level() + SEGMENT_LEVELS - 1;
        let mut next_node = 1;
        let mut cells = VecDeque::from([segment.root]);
        for record in segment.nodes() {
            let cell = cells.pop_front().ok_or("more nodes than links")?;
            check_record(record, cell, segment.objects().len())?;
            if record.children() == 0 {
                continue;
            }
            let is_last = cell.level() == last_level;
            let next = if is_last { &mut *roots_seen } else { &mut next_node };
            if record.first_child() != *next {
                return Err("a child link out of order");
            }
            for child in quadrants(record.children()).filter_map(|quadrant| cell.child(quadrant)) {
                if !is_last {
                    cells.push_back(child);
                } else if self.segments.get(*next as usize).map(Segment::root) != Some(child) {
                    return Err("a child segment is missing");
                }
                *next += 1;
            }
        }
        if next_node as usize != segment.nodes().len() {
            return Err("fewer nodes than links");
        }
        Ok(())
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

fn quadrants(mask: u32) -> impl Iterator<Item = Quadrant> {
    Quadrant::ALL.into_iter().filter(move |&quadrant| mask >> quadrant as u32 & 1 == 1)
}

/// How many children stand before `quadrant`.
fn rank(mask: u32, quadrant: Quadrant) -> u32 {
    (mask & ((1 << quadrant as u32) - 1)).count_ones()
}

fn build_segment(
    root: CellId,
    cells: &BTreeMap<CellId, NodeInfo>,
    roots: &mut VecDeque<CellId>,
    segment_count: &mut u32,
) -> Result<Segment, IndexError> {
    let last_level = root.level() + SEGMENT_LEVELS - 1;
    let (mut nodes, mut objects) = (Vec::new(), Vec::new());
    let mut queue = VecDeque::from([root]);
    let mut node_count = 1u32;
    while let Some(cell) = queue.pop_front() {
        let info = &cells[&cell];
        let children: Vec<_> = cell.children().filter(|child| cells.contains_key(child)).collect();
        let mask = children.iter().filter_map(|child| child.quadrant()).fold(0, |mask, q| mask | 1u32 << q as u32);
        let counter = if cell.level() == last_level { &mut *segment_count } else { &mut node_count };
        let first_child = if children.is_empty() { 0 } else { *counter };
        *counter += children.len() as u32;
        if cell.level() == last_level {
            roots.extend(children);
        } else {
            queue.extend(children);
        }
        nodes.push(NodeRecord::pack(cell, info, mask, first_child, objects.len())?);
        objects.extend(info.objects.iter().map(ObjectsRecord::pack));
    }
    let mut bytes: Vec<u8> = bytemuck::cast_slice(&nodes).to_vec();
    bytes.extend_from_slice(bytemuck::cast_slice(&objects));
    // Words keep the alignment that the records need.
    bytes.resize(bytes.len().next_multiple_of(8), 0);
    let words: Vec<u64> = bytes.chunks_exact(8).map(bytemuck::pod_read_unaligned).collect();
    Segment::new(root, Arc::new(Words(words)), 0, nodes.len(), objects.len())
        .ok_or(IndexError::Malformed { segment: 0, what: "records are not aligned" })
}

struct Words(Vec<u64>);

impl AsRef<[u8]> for Words {
    fn as_ref(&self) -> &[u8] {
        bytemuck::cast_slice(&self.0)
    }
}

/// A node of an index tree, with its cell.
#[derive(Clone, Copy)]
pub struct Node<'a> {
    tree: &'a IndexTree,
    at: NodeRef,
    cell: CellId,
}

impl<'a> Node<'a> {
    fn segment(&self) -> &'a Segment {
        &self.tree.segments[self.at.segment as usize]
    }

    fn record(&self) -> &'a NodeRecord {
        &self.segment().nodes()[self.at.node as usize]
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
        self.segment().objects()[self.record().objects()].iter().map(ObjectsRecord::unpack)
    }

    pub fn has_children(&self) -> bool {
        self.record().children() != 0
    }

    pub fn child(&self, quadrant: Quadrant) -> Option<Node<'a>> {
        let record = self.record();
        let mask = record.children();
        if mask >> quadrant as u32 & 1 == 0 {
            return None;
        }
        let cell = self.cell.child(quadrant)?;
        let next = record.first_child() + rank(mask, quadrant);
        let at = if cell.level() % SEGMENT_LEVELS == 0 {
            NodeRef { segment: next, node: 0 }
        } else {
            NodeRef { segment: self.at.segment, node: next }
        };
        Some(Node { tree: self.tree, at, cell })
    }

    pub fn children(&self) -> impl Iterator<Item = Node<'a>> + use<'a> {
        let node = *self;
        Quadrant::ALL.into_iter().filter_map(move |quadrant| node.child(quadrant))
    }
}

/// The index trees of a world.
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

    pub fn find(&self, cell: CellId) -> Option<Node<'_>> {
        self.tree(cell.zone())?.find(cell)
    }

    pub fn find_deepest(&self, cell: CellId) -> Option<Node<'_>> {
        Some(self.tree(cell.zone())?.find_deepest(cell))
    }

    pub fn byte_len(&self) -> usize {
        self.trees().map(IndexTree::byte_len).sum()
    }
}
