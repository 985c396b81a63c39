//! The index of a zone with one collection put in or taken out: what the cells above tell of the objects below them is
//! brought up to date, all else stays.

use super::assemble::{Range, add_objects, union};
use super::buildings::ObjectsPage;
use super::pipeline::BuildError;
use super::world_ground::WorldGround;
use crate::content::{Page, PageId, PageKind};
use crate::forest::index::{IndexTree, NodeInfo, ObjectsEntry, Place, mark_alone};
use crate::forest::{CellId, Zone};
use crate::store::World;
use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet, HashMap};

/// A zone's cells while they are changed.
pub(super) struct Graft {
    zone: Zone,
    nodes: BTreeMap<CellId, NodeInfo>,
    /// Cells whose subtree lost or got a page.
    touched: BTreeSet<CellId>,
    /// Bounds of pages that were put in: the world that is read has no such pages yet.
    sizes: HashMap<Place, Size>,
    /// Bytes of the pages that were taken out.
    pub unused_bytes: u64,
}

/// What the cells above a page of objects are to know.
#[derive(Clone, Copy, Debug)]
struct Size {
    range_m: Range,
    dimension_m: f64,
    reach_m: f64,
}

impl Graft {
    /// `tree`: the zone's, whole; `None` where the world has nothing there.
    pub fn new(zone: Zone, tree: Option<&IndexTree>) -> Self {
        let nodes = tree.into_iter().flat_map(IndexTree::nodes);
        let nodes = nodes.map(|node| {
            let info = NodeInfo {
                terrain: node.terrain(),
                imagery: node.imagery(),
                height_range_m: node.height_range_m(),
                dimension_m: node.dimension_m(),
                reach_m: node.reach_m(),
                objects: node.objects().collect(),
                below: node.objects_below().collect(),
            };
            (node.cell(), info)
        });
        Self {
            zone,
            nodes: nodes.collect(),
            touched: BTreeSet::from([zone.root()]),
            sizes: HashMap::new(),
            unused_bytes: 0,
        }
    }

    /// Takes out the pages of a collection, all reps.
    pub fn remove(&mut self, collection: u8) {
        for (cell, node) in &mut self.nodes {
            let count = node.objects.len();
            let bytes = |node: &NodeInfo| node.objects.iter().map(|entry| u64::from(entry.place.len)).sum::<u64>();
            let before = bytes(node);
            node.objects.retain(|entry| entry.collection != collection);
            node.below.retain(|below| below.collection != collection);
            if node.objects.len() < count {
                self.unused_bytes += before - bytes(node);
                self.touched.extend(cell.ancestors());
            }
        }
    }

    /// Puts in a page that was written to a place.
    pub fn add(&mut self, collection: u8, page: &ObjectsPage, place: Place) {
        add_objects(&mut self.nodes, page, collection, place);
        // Groups are no objects: they count by their heights alone.
        let (dimension_m, reach_m) = if page.rep == 0 { (page.dimension_m, page.reach_m) } else { (0.0, 0.0) };
        let size = Size { range_m: page.height_range_m, dimension_m, reach_m };
        self.sizes.insert(place, size);
        self.touched.extend(page.root.ancestors());
    }

    /// The tree of what is there now. Other collections' pages in the cells touched are read for their bounds, and
    /// terrain for the ground.
    pub fn finish(mut self, world: &World, ground: &WorldGround) -> Result<IndexTree, BuildError> {
        // Children come after their parents in the order of cells.
        for cell in std::mem::take(&mut self.touched).into_iter().rev() {
            let children: Vec<CellId> = cell.children().filter(|child| self.nodes.contains_key(child)).collect();
            if self.is_bare(cell) && children.is_empty() {
                self.nodes.remove(&cell);
                continue;
            }
            let size = self.size_of(cell, &children, world, ground)?;
            if let Some(node) = self.nodes.get_mut(&cell) {
                node.height_range_m = size.range_m;
                (node.dimension_m, node.reach_m) = (size.dimension_m, size.reach_m);
                // As a world that is made in one go has them.
                node.objects.sort_by_key(|entry| (entry.collection, Reverse(entry.rep)));
                node.below.sort_by_key(|below| below.collection);
            }
        }
        mark_alone(&mut self.nodes);
        Ok(IndexTree::build(self.zone, &self.nodes)?)
    }

    /// A cell below the root that was there for objects alone.
    fn is_bare(&self, cell: CellId) -> bool {
        let holds_nothing =
            |node: &NodeInfo| node.terrain.is_none() && node.imagery.is_none() && node.objects.is_empty();
        cell.level() > 0 && self.nodes.get(&cell).is_none_or(holds_nothing)
    }

    fn size_of(
        &self,
        cell: CellId,
        children: &[CellId],
        world: &World,
        ground: &WorldGround,
    ) -> Result<Size, BuildError> {
        let mut size = Size { range_m: self.ground_m(cell, ground)?, dimension_m: 0.0, reach_m: 0.0 };
        for entry in self.nodes.get(&cell).into_iter().flat_map(|node| &node.objects) {
            size = size.with(match self.sizes.get(&entry.place) {
                Some(&known) => known,
                None => stored_size(world, cell, entry)?,
            });
        }
        for node in children.iter().filter_map(|child| self.nodes.get(child)) {
            let (dimension_m, reach_m) = (node.dimension_m, node.reach_m);
            size = size.with(Size { range_m: node.height_range_m, dimension_m, reach_m });
        }
        Ok(size)
    }

    /// Lowest and highest ground of the page that is drawn in a cell: its own or that of the nearest cell above.
    fn ground_m(&self, cell: CellId, ground: &WorldGround) -> Result<Range, BuildError> {
        let above = || cell.ancestors().find_map(|cell| Some((cell, self.nodes.get(&cell)?.terrain?)));
        let Some((cell, terrain)) = above() else { return Ok((0.0, 0.0)) };
        let page = ground.page(cell, terrain)?;
        let heights = page.posts.iter().map(|post| f64::from(post.height_m));
        Ok(heights.fold((f64::INFINITY, f64::NEG_INFINITY), |range, height_m| union(range, (height_m, height_m))))
    }
}

impl Size {
    fn with(self, other: Self) -> Self {
        Self {
            range_m: union(self.range_m, other.range_m),
            dimension_m: self.dimension_m.max(other.dimension_m),
            reach_m: self.reach_m.max(other.reach_m),
        }
    }
}

/// Of a page of the world that is there.
fn stored_size(world: &World, cell: CellId, entry: &ObjectsEntry) -> Result<Size, BuildError> {
    let id = PageId { cell, kind: PageKind::Objects { collection: entry.collection, rep: entry.rep } };
    let nothing = Size { range_m: (f64::INFINITY, f64::NEG_INFINITY), dimension_m: entry.dimension_m, reach_m: 0.0 };
    let bytes = world.read(id, entry.place)?;
    let Page::Objects(..) = world.decode(id, entry.place, &bytes)? else { return Ok(nothing) };
    let prisms = world.prisms(id, entry.place, &bytes)?.prisms;
    Ok(prisms.iter().fold(nothing, |size, prism| {
        size.with(Size {
            range_m: (f64::from(prism.base_m) - f64::from(prism.foundation_m), f64::from(prism.top_m)),
            dimension_m: 0.0,
            reach_m: if entry.rep == 0 { prism.reach_m() } else { 0.0 },
        })
    }))
}
