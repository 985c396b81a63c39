//! Index trees against the maps they were built from, and against bytes that no tree wrote.

use proptest::prelude::*;
use std::collections::BTreeMap;
use std::sync::Arc;
use stoop::forest::index::{
    IndexError, IndexTree, NodeInfo, NodeRecord, ObjectsEntry, ObjectsRecord, Place, Segment, TerrainEntry,
};
use stoop::forest::{CellId, Quadrant, Zone};

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
        |(collection, rep, offset, len, eighths)| ObjectsEntry {
            collection,
            rep,
            place: Place { offset, len },
            dimension_m: f64::from(eighths) / 8.0,
        },
    );
    let objects = prop::collection::vec(object, 0..4);
    (0..1u64 << 39, 0..1u32 << 20, 0..1u32 << 20, 0f32..1e4, -500i16..9000, objects).prop_map(
        |(offset, terrain, imagery, error_m, low, objects)| NodeInfo {
            terrain: (terrain > 0).then_some(TerrainEntry { place: Place { offset, len: terrain }, error_m }),
            imagery: (imagery > 0).then_some(Place { offset: offset + u64::from(terrain), len: imagery }),
            height_range_m: (f64::from(low), f64::from(low) + 100.0),
            dimension_m: 12.5,
            reach_m: 7.125,
            objects,
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
            let children: Vec<_> = cell.children().filter(|child| cells.contains_key(child)).collect();
            prop_assert_eq!(node.children().map(|child| child.cell()).collect::<Vec<_>>(), children.clone());
            prop_assert_eq!(node.has_children(), !children.is_empty());
            for child in cell.children().filter(|child| !cells.contains_key(child)) {
                prop_assert!(tree.find(child).is_none());
                prop_assert_eq!(tree.find_deepest(child).cell(), cell);
            }
        }
        let objects: usize = cells.values().map(|info| info.objects.len()).sum();
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
    let entry = ObjectsEntry { collection: 0, rep: 0, place: Place { offset: 0, len: 1 }, dimension_m: 1.0 };
    let many = NodeInfo { objects: vec![entry; 256], ..NodeInfo::default() };
    assert_eq!(build(many), Err(IndexError::TooManyObjects(zone.root())));
    let child = zone.root().child(Quadrant::SouthWest).expect("level 1 exists");
    let orphan = Cells::from([(child, NodeInfo::default())]);
    assert!(matches!(IndexTree::build(zone, &orphan), Err(IndexError::Orphan(_))));
    let none = IndexTree::from_segments(zone, Vec::new());
    assert!(matches!(none, Err(IndexError::Malformed { .. })));
}
