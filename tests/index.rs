//! Index trees against the maps they were built from, and against bytes that no tree wrote.

use proptest::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use stoop::forest::index::synthetic::{NODES_MAX, Near, SyntheticForest};
use stoop::forest::index::{
    Directory, IndexError, IndexForest, IndexTree, NodeInfo, NodeRecord, ObjectsBelow, ObjectsEntry, ObjectsRecord,
    Place, SEGMENT_LEVELS, Segment, TerrainEntry,
};
use stoop::forest::{CellId, Quadrant, Zone};
use stoop::geodesy::Geodetic;

type Cells = BTreeMap<CellId, NodeInfo>;

/// A few branches down to level 15, with all that is above them.
fn any_cells() -> impl Strategy<Value = (Zone, Cells)> {
    let zone = prop_oneof![Just(0u8), Just(12), Just(31)].prop_map(|at| Zone::new(at).expect("below 32"));
    let branches = prop::collection::vec((prop::collection::vec(0usize..4, 0..15), any_info()), 1..12);
    (zone, any_info(), branches).prop_map(|(zone, root, branches)| {
        let mut cells = Cells::from([(zone.root(), root)]);
        for (path, info) in branches {
            let mut cell = zone.root();
            for quadrant in path {
                // The eastern child of a thinned row does not exist; its western one stands for it.
                let quadrants = [Quadrant::ALL[quadrant], Quadrant::ALL[quadrant & 2]];
                if let Some(child) = quadrants.into_iter().find_map(|quadrant| cell.child(quadrant)) {
                    cells.entry(child).or_default();
                    cell = child;
                }
            }
            cells.insert(cell, info);
        }
        (zone, cells)
    })
}

fn any_info() -> impl Strategy<Value = NodeInfo> {
    let object = (any::<u8>(), 0..4u8, 0..1u64 << 40, 1..1u32 << 24, 0..8000u16).prop_map(
        |(collection, rep, offset, len, eighths)| {
            let size_m = f64::from(eighths) / 8.0;
            // What a page is by its rep: its largest object, or its error.
            let (dimension_m, error_m) = if rep == 0 { (size_m, 0.0) } else { (0.0, size_m) };
            ObjectsEntry { collection, rep, place: Place { offset, len }, dimension_m, error_m }
        },
    );
    let objects = prop::collection::vec(object, 0..4);
    let below = (any::<u8>(), 0..8000u16, any::<bool>()).prop_map(|(collection, eighths, alone)| ObjectsBelow {
        collection,
        dimension_m: f64::from(eighths) / 8.0,
        alone,
    });
    let below = prop::collection::vec(below, 0..3);
    (0..1u64 << 39, 0..1u32 << 20, 0..1u32 << 20, 0f32..1e4, -500i16..9000, objects, below).prop_map(
        |(offset, terrain, imagery, error_m, low, objects, below)| NodeInfo {
            terrain: (terrain > 0).then_some(TerrainEntry { place: Place { offset, len: terrain }, error_m }),
            imagery: (imagery > 0).then_some(Place { offset: offset + u64::from(terrain), len: imagery }),
            height_range_m: (f64::from(low), f64::from(low) + 100.0),
            dimension_m: 12.5,
            reach_m: 7.125,
            objects,
            below,
        },
    )
}

struct Words(Vec<u64>);

impl AsRef<[u8]> for Words {
    fn as_ref(&self) -> &[u8] {
        bytemuck::cast_slice(&self.0)
    }
}

/// A segment over other bytes than those that were built.
fn reread(segment: &Segment, change: impl FnOnce(&mut [u8])) -> Segment {
    let mut bytes: Vec<u8> = bytemuck::cast_slice(segment.nodes()).to_vec();
    bytes.extend_from_slice(bytemuck::cast_slice(segment.objects()));
    change(&mut bytes);
    bytes.resize(bytes.len().next_multiple_of(8), 0);
    let words = bytes.chunks_exact(8).map(bytemuck::pod_read_unaligned).collect();
    Segment::new(segment.root(), Arc::new(Words(words)), 0, segment.nodes().len(), segment.objects().len())
        .expect("as many bytes as before")
}

/// Asks everything that a traversal may ask; the number of nodes.
fn visit(tree: &IndexTree) -> usize {
    let mut count = 0;
    for node in tree.nodes() {
        let answers = (node.terrain(), node.imagery(), node.height_range_m(), node.dimension_m(), node.reach_m());
        std::hint::black_box((answers, node.objects().count(), node.children().count()));
        assert!(tree.find(node.cell()).is_some());
        count += 1;
    }
    count
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_tree_is_the_map_it_was_built_from((zone, cells) in any_cells()) {
        let tree = IndexTree::build(zone, &cells).expect("every cell has its parent");
        // Segments go breadth first, cells depth first: the same set.
        let mut seen: Vec<_> = tree.nodes().map(|node| node.cell()).collect();
        for (at, cell) in seen.iter().enumerate() {
            prop_assert!(cell.parent().is_none_or(|parent| seen[..at].contains(&parent)));
        }
        seen.sort();
        prop_assert!(seen.iter().eq(cells.keys()));
        for (&cell, info) in &cells {
            let node = tree.find(cell).expect("it was given");
            prop_assert_eq!(node.cell(), cell);
            prop_assert_eq!(node.terrain(), info.terrain);
            prop_assert_eq!(node.imagery(), info.imagery);
            prop_assert_eq!(node.height_range_m(), info.height_range_m);
            prop_assert_eq!((node.dimension_m(), node.reach_m()), (info.dimension_m, info.reach_m));
            prop_assert_eq!(node.objects().collect::<Vec<_>>(), info.objects.clone());
            prop_assert_eq!(node.objects_below().collect::<Vec<_>>(), info.below.clone());
            let children: Vec<_> = cell.children().filter(|child| cells.contains_key(child)).collect();
            prop_assert_eq!(node.children().map(|child| child.cell()).collect::<Vec<_>>(), children.clone());
            prop_assert_eq!(node.has_children(), !children.is_empty());
            for child in cell.children().filter(|child| !cells.contains_key(child)) {
                prop_assert!(tree.find(child).is_none());
                prop_assert_eq!(tree.find_deepest(child).cell(), cell);
            }
        }
        let objects: usize = cells.values().map(|info| info.objects.len() + info.below.len()).sum();
        let bytes = tree.bytes();
        prop_assert_eq!((bytes.pinned, bytes.paged, bytes.absent), (32 * cells.len() + 12 * objects, 0, 0));
        prop_assert_eq!(bytes.directory, 32 * tree.segments().count());
        prop_assert_eq!(tree.directory().node_count(), cells.len() as u64);
        prop_assert!(tree.is_whole());
    }

    #[test]
    fn changed_bytes_give_an_error_or_a_sound_tree(
        (zone, cells) in any_cells(), flips in prop::collection::vec((any::<usize>(), 0..8u32), 1..4), at in any::<usize>(),
    ) {
        let tree = IndexTree::build(zone, &cells).expect("every cell has its parent");
        let mut segments = tree.segments().cloned().collect::<Vec<_>>();
        let at = at % segments.len();
        segments[at] = reread(&segments[at], |bytes| {
            for (byte, bit) in flips {
                let byte = byte % bytes.len();
                bytes[byte] ^= 1 << bit;
            }
        });
        if let Ok(tree) = IndexTree::from_segments(zone, segments) {
            prop_assert!(visit(&tree) > 0);
        }
    }

    #[test]
    fn arbitrary_bytes_give_an_error_or_a_sound_tree((zone, cells) in any_cells(), seed in any::<u64>()) {
        let tree = IndexTree::build(zone, &cells).expect("every cell has its parent");
        let mut random = seed | 1;
        let segments = tree.segments().map(|segment| reread(segment, |bytes| bytes.fill_with(|| {
            random ^= random << 13;
            random ^= random >> 7;
            random ^= random << 17;
            random as u8
        })));
        if let Ok(tree) = IndexTree::from_segments(zone, segments.collect()) {
            visit(&tree);
        }
    }

    #[test]
    fn lost_or_swapped_segments_give_an_error((zone, cells) in any_cells(), at in any::<usize>()) {
        let tree = IndexTree::build(zone, &cells).expect("every cell has its parent");
        let mut lost = tree.segments().cloned().collect::<Vec<_>>();
        lost.remove(at % lost.len());
        let is_refused = IndexTree::from_segments(zone, lost).is_err();
        prop_assert!(is_refused);
        let mut swapped = tree.segments().cloned().collect::<Vec<_>>();
        let count = swapped.len();
        if count > 1 {
            swapped.swap(at % count, (at + 1) % count);
            prop_assert!(IndexTree::from_segments(zone, swapped).is_err());
        }
    }
}

#[test]
fn records_are_as_light_as_promised() {
    assert_eq!((size_of::<NodeRecord>(), size_of::<ObjectsRecord>()), (32, 12));
}

#[test]
fn what_cannot_be_stored_is_refused() {
    let zone = Zone::new(9).expect("below 32");
    let build = |info: NodeInfo| IndexTree::build(zone, &Cells::from([(zone.root(), info)])).map(|_| ());
    let place = Place { offset: 0, len: 1 << 24 };
    let too_long = NodeInfo { imagery: Some(place), ..NodeInfo::default() };
    assert_eq!(build(too_long), Err(IndexError::TooLarge(zone.root())));
    let terrain = Some(TerrainEntry { place: Place { offset: 0, len: 8 }, error_m: 1.0 });
    let apart = NodeInfo { terrain, imagery: Some(Place { offset: 9, len: 8 }), ..NodeInfo::default() };
    assert_eq!(build(apart), Err(IndexError::Apart(zone.root())));
    let entry =
        ObjectsEntry { collection: 0, rep: 0, place: Place { offset: 0, len: 1 }, dimension_m: 1.0, error_m: 0.0 };
    let many = NodeInfo { objects: vec![entry; 256], ..NodeInfo::default() };
    assert_eq!(build(many), Err(IndexError::TooManyObjects(zone.root())));
    let child = zone.root().child(Quadrant::SouthWest).expect("level 1 exists");
    let orphan = Cells::from([(child, NodeInfo::default())]);
    assert!(matches!(IndexTree::build(zone, &orphan), Err(IndexError::Orphan(_))));
    let none = IndexTree::from_segments(zone, Vec::new());
    assert!(matches!(none, Err(IndexError::Malformed { .. })));
}

// ---- Trees of which only a part is resident.

/// The same tree with its top alone.
fn top_of(tree: &IndexTree) -> IndexTree {
    let top = tree.segments().next().expect("a tree has a top").clone();
    IndexTree::paged(tree.directory().clone(), top).expect("the top of a sound tree")
}

fn segment_of(tree: &IndexTree, root: CellId) -> Segment {
    tree.segments().find(|segment| segment.root() == root).expect("a segment of the tree").clone()
}

/// Whether the segments that a cell's way leads through are all among the resident ones.
fn is_reached(cell: CellId, resident: &BTreeSet<CellId>) -> bool {
    (SEGMENT_LEVELS..=cell.level())
        .step_by(usize::from(SEGMENT_LEVELS))
        .filter_map(|level| cell.ancestor(level))
        .all(|root| resident.contains(&root))
}

/// A partial tree tells of what is resident exactly what the whole one does, and names what is not.
fn assert_same_where_resident(part: &IndexTree, whole: &IndexTree, cells: &Cells, resident: &BTreeSet<CellId>) {
    let mut reached = BTreeSet::new();
    for &cell in cells.keys() {
        let deepest = cell.ancestors().find(|&above| is_reached(above, resident)).expect("the root is");
        assert_eq!(part.find_deepest(cell).cell(), deepest);
        let Some(node) = part.find(cell) else {
            assert!(!is_reached(cell, resident), "{cell} is resident and not found");
            continue;
        };
        assert!(is_reached(cell, resident), "{cell} is found and not resident");
        reached.insert(cell);
        let same = whole.find(cell).expect("the whole tree has it");
        assert_eq!((node.at(), node.terrain(), node.imagery()), (same.at(), same.terrain(), same.imagery()));
        assert_eq!(node.height_range_m(), same.height_range_m());
        assert!(node.objects().eq(same.objects()));
        for quadrant in Quadrant::ALL {
            let exists = same.child(quadrant).is_some();
            assert_eq!((node.child_exists(quadrant), same.absent_child(quadrant)), (exists, None));
            let child = same.child(quadrant).map(|child| child.cell());
            let is_there = child.is_some_and(|child| is_reached(child, resident));
            assert_eq!(node.child(quadrant).map(|child| child.cell()), child.filter(|_| is_there));
            assert_eq!(node.absent_child(quadrant).map(|absent| absent.root), child.filter(|_| !is_there));
        }
        let begins_paged = cell.level() > 0 && cell.level().is_multiple_of(SEGMENT_LEVELS);
        assert_eq!(node.paged_segment().map(|segment| segment.root), begins_paged.then_some(cell));
        assert_eq!(same.paged_segment(), None);
    }
    assert_eq!(part.nodes().map(|node| node.cell()).collect::<BTreeSet<_>>(), reached);
    assert_eq!(part.absent_segments().count() + resident.len() + 1, whole.directory().entries().len());
    let (bytes, all) = (part.bytes(), whole.bytes());
    assert_eq!((bytes.total(), bytes.directory), (all.total(), all.directory));
    let paged: usize = resident.iter().map(|&root| segment_of(whole, root).byte_len()).sum();
    assert_eq!((bytes.paged, bytes.resident()), (paged, bytes.directory + bytes.pinned + paged));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_partial_tree_is_the_whole_one_down_to_what_is_resident(
        (zone, cells) in any_cells(), moves in prop::collection::vec((any::<usize>(), any::<bool>()), 0..24),
    ) {
        let whole = IndexTree::build(zone, &cells).expect("every cell has its parent");
        let roots: Vec<CellId> = whole.segments().map(Segment::root).collect();
        let (mut part, mut resident) = (top_of(&whole), BTreeSet::new());
        for (at, is_insertion) in moves {
            let root = roots[at % roots.len()];
            if is_insertion {
                part.insert_segment(segment_of(&whole, root)).expect("a segment of the same tree");
                // The top is there from the start and for good.
                resident.extend((root != zone.root()).then_some(root));
            } else {
                prop_assert_eq!(part.remove_segment(root), resident.remove(&root));
            }
            assert_same_where_resident(&part, &whole, &cells, &resident);
        }
        let absent: Vec<CellId> = part.absent_segments().map(|segment| segment.root).collect();
        for root in absent {
            part.insert_segment(segment_of(&whole, root)).expect("a segment of the same tree");
        }
        prop_assert!(part.is_whole());
        prop_assert_eq!(part.nodes().count(), cells.len());
    }

    #[test]
    fn a_changed_clone_leaves_the_other_as_it_was((zone, cells) in any_cells()) {
        let whole = IndexTree::build(zone, &cells).expect("every cell has its parent");
        let mut forest = IndexForest::default();
        forest.insert(top_of(&whole));
        let before = forest.clone();
        for segment in whole.segments() {
            forest.insert_segment(segment.clone()).expect("a segment of the same tree");
        }
        let full = forest.clone();
        for segment in whole.segments() {
            forest.remove_segment(segment.root());
        }
        prop_assert!(full.is_whole());
        prop_assert_eq!(forest.bytes(), before.bytes());
        prop_assert_eq!((before.bytes().paged, full.node_count()), (0, cells.len() as u64));
        for root in whole.segments().map(Segment::root).skip(1) {
            prop_assert_eq!((before.find(root).is_some(), full.find(root).is_some()), (false, true));
            prop_assert_eq!(before.segment(root), full.segment(root));
        }
    }

    #[test]
    fn a_hostile_segment_is_refused_or_sound(
        (zone, cells) in any_cells(), flips in prop::collection::vec((any::<usize>(), 0..8u32), 1..4), at in any::<usize>(),
    ) {
        let whole = IndexTree::build(zone, &cells).expect("every cell has its parent");
        let count = whole.segments().count();
        let target = whole.segments().nth(at % count).expect("below the count");
        let harmed = reread(target, |bytes| {
            for (byte, bit) in flips {
                let byte = byte % bytes.len();
                bytes[byte] ^= 1 << bit;
            }
        });
        let mut part = top_of(&whole);
        let accepted = part.insert_segment(harmed).is_ok();
        for other in whole.segments().filter(|other| other.root() != target.root()) {
            part.insert_segment(other.clone()).expect("a segment of the same tree");
        }
        prop_assert_eq!(part.is_whole(), accepted || target.root() == zone.root());
        visit(&part);
    }

    #[test]
    fn a_hostile_directory_is_refused_or_sound(
        (zone, cells) in any_cells(), at in any::<usize>(), word in 0..4u8, bits in any::<u64>(),
    ) {
        let whole = IndexTree::build(zone, &cells).expect("every cell has its parent");
        let mut entries = whole.directory().entries().to_vec();
        let at = at % entries.len();
        match word {
            0 => entries[at].root = CellId::from_u64(bits).unwrap_or(zone.root()),
            1 => entries[at].offset = bits,
            2 => entries[at].nodes = bits as u32 >> (bits >> 59),
            _ => entries[at].objects = bits as u32 >> (bits >> 59),
        }
        let Ok(directory) = Directory::new(zone, entries) else { return Ok(()) };
        prop_assert!(directory.entries().iter().all(|entry| entry.byte_len() < 1 << 24));
        let mut segments = whole.segments();
        let top = segments.next().expect("a tree has a top").clone();
        if let Ok(mut part) = IndexTree::paged(directory, top) {
            segments.for_each(|segment| _ = part.insert_segment(segment.clone()));
            visit(&part);
        }
    }
}

#[test]
fn segments_of_other_trees_are_refused() {
    let zone = Zone::new(9).expect("below 32");
    let chain = |quadrant: Quadrant, levels: u8| {
        let mut cells = Cells::from([(zone.root(), NodeInfo::default())]);
        let mut cell = zone.root();
        for _ in 0..levels {
            cell = cell.child(quadrant).expect("zone 9 is not thinned");
            cells.insert(cell, NodeInfo::default());
        }
        IndexTree::build(zone, &cells).expect("every cell has its parent")
    };
    let (west, east) = (chain(Quadrant::SouthWest, 14), chain(Quadrant::SouthEast, 14));
    let shorter = chain(Quadrant::SouthWest, 13);
    let last = |tree: &IndexTree| tree.segments().last().expect("three segments").clone();
    let mut tree = top_of(&west);
    assert!(matches!(tree.insert_segment(last(&east)), Err(IndexError::Malformed { .. })));
    let refused = tree.insert_segment(last(&shorter)).expect_err("fewer nodes than the directory tells");
    assert!(refused.to_string().contains(&last(&shorter).root().to_string()), "{refused}");
    assert!(IndexTree::paged(west.directory().clone(), last(&west)).is_err());
    assert!(IndexTree::paged(shorter.directory().clone(), west.segments().next().expect("a top").clone()).is_ok());
    // A middle segment that leads to one which the directory does not have, or lacks the link to one that it has.
    let only_two = chain(Quadrant::SouthWest, 11);
    let middle = |tree: &IndexTree| tree.segments().nth(1).expect("two segments").clone();
    assert!(top_of(&only_two).insert_segment(middle(&west)).is_err());
    assert!(top_of(&west).insert_segment(middle(&only_two)).is_err());
    assert!(IndexForest::default().insert_segment(last(&west)).is_err());
}

// ---- Made-up worlds of any size.

fn near_atlanta(finest_level: u8) -> Near {
    Near { place: Geodetic::from_degrees(33.755, -84.39, 0.0), finest_level, radius_cells: 4 }
}

fn whole_of(made_up: &SyntheticForest) -> IndexForest {
    let mut index = made_up.index().clone();
    for tree in made_up.index().trees() {
        for absent in tree.absent_segments() {
            let segment = made_up.segment(absent.root).expect("the directory names it");
            index.insert_segment(segment).expect("made for this directory");
        }
    }
    index
}

#[test]
fn a_made_up_world_has_as_many_cells_as_asked_for_and_all_laws_hold() {
    let made_up = SyntheticForest::new(near_atlanta(20), 100_000).expect("within its limits");
    assert_eq!(made_up.node_count(), 100_000);
    let index = whole_of(&made_up);
    assert!(index.is_whole());
    let mut places: Vec<(Zone, Place)> = Vec::new();
    let mut count = 0;
    for node in index.trees().flat_map(|tree| tree.nodes()) {
        count += 1;
        assert!(made_up.exists(node.cell()));
        let (terrain, imagery) = (node.terrain().expect("everywhere"), node.imagery().expect("everywhere"));
        places.extend([(node.cell().zone(), terrain.place), (node.cell().zone(), imagery)]);
        assert!(terrain.error_m > 0.0);
        for child in node.children() {
            assert_eq!(child.terrain().map(|child| child.error_m), Some(terrain.error_m / 2.0));
            assert!(child.height_range_m().0 >= node.height_range_m().0);
            assert!(child.height_range_m().1 <= node.height_range_m().1);
        }
        let missing = node.cell().children().filter(|&child| made_up.exists(child)).count();
        assert_eq!(node.children().count(), missing);
    }
    assert_eq!(count, 100_000);
    places.sort_unstable_by_key(|(zone, place)| (*zone, place.offset));
    for pair in places.windows(2).filter(|pair| pair[0].0 == pair[1].0) {
        assert!(pair[0].1.offset + u64::from(pair[0].1.len) <= pair[1].1.offset, "pages lie over one another");
    }
    assert!(places.iter().map(|(_, place)| place.len).collect::<BTreeSet<_>>().len() > 1000, "lengths vary");
    let finest = CellId::containing(33.755f64.to_radians(), -84.39f64.to_radians(), 20);
    assert!(index.find(finest).is_some() && finest.children().all(|child| index.find(child).is_none()));
}

#[test]
fn a_hundred_million_cells_take_three_megabytes_and_the_place_is_the_same() {
    let small = SyntheticForest::new(near_atlanta(20), 100_000).expect("within its limits");
    let large = SyntheticForest::new(near_atlanta(20), 100_000_000).expect("within its limits");
    assert_eq!(large.node_count(), 100_000_000);
    let bytes = large.index().bytes();
    assert!(bytes.directory < 3 << 20 && bytes.fixed() < 6 << 20 && bytes.total() > 3_200_000_000, "{bytes:?}");
    let cell = CellId::containing(33.755f64.to_radians(), -84.39f64.to_radians(), 20);
    let (mut one, mut other) = (small.index().clone(), large.index().clone());
    small.insert_towards(&mut one, cell).expect("made for this directory");
    large.insert_towards(&mut other, cell).expect("made for this directory");
    let (one, other) = (one.find(cell).expect("it is near"), other.find(cell).expect("it is near"));
    assert_eq!((one.terrain(), one.imagery(), one.at()), (other.terrain(), other.imagery(), other.at()));
    // Segments far away hold up as well: the largest, the last, and one in the middle.
    let mut index = large.index().clone();
    for tree in large.index().trees().filter(|tree| tree.directory().entries().len() > 1000) {
        let entries = tree.directory().entries();
        for entry in [entries[1], entries[entries.len() / 2], entries[entries.len() - 1]] {
            let segment = large.segment(entry.root).expect("the directory names it");
            index.insert_segment(segment).expect("made for this directory");
        }
    }
    assert!(index.bytes().paged > 20 * 40_000);
}

#[test]
fn made_up_worlds_out_of_range_are_refused() {
    let near = near_atlanta(20);
    for (near, count) in [
        (near, 1000),
        (near, NODES_MAX + 1),
        (Near { place: Geodetic::from_degrees(60.0, 0.0, 0.0), ..near }, 100_000),
        (Near { finest_level: 23, ..near }, 100_000),
        (Near { finest_level: 5, ..near }, 100_000),
        (Near { radius_cells: 0, ..near }, 100_000),
        (Near { radius_cells: 65, ..near }, 100_000_000),
    ] {
        assert!(SyntheticForest::new(near, count).is_none(), "{near:?} {count}");
    }
    let most = SyntheticForest::new(near, NODES_MAX).expect("within its limits");
    let last = most.index().trees().flat_map(|tree| tree.directory().entries().last()).map(|entry| entry.root);
    last.for_each(|root| assert!(most.segment(root).is_some(), "{root} lies beyond a pack"));
}
