//! Linear orders of pages, without redundancy, to compare layouts with.

use crate::content::{PageId, PageKind};
use crate::forest::index::{IndexError, IndexForest, IndexTree, Node, NodeInfo, ObjectsEntry, Place, TerrainEntry};
use crate::forest::{CellId, LEVEL_MAX};
use std::collections::{BTreeMap, HashMap};

/// Where pages lie that are stored once each, by page: file and place.
#[derive(Clone, Debug, Default)]
pub struct LinearOrder(pub HashMap<PageId, (u32, Place)>);

impl LinearOrder {
    /// As the packs have them: a file for each zone.
    pub fn packs(pages: &[(PageId, Place)]) -> Self {
        Self(pages.iter().map(|&(page, place)| (page, (page.cell.zone().index() as u32, place))).collect())
    }
}

/// Pages along a Hilbert curve through places and levels: one file, so ordered that what is near in the world, and of
/// about the same fineness, is near in the file at every scale (Yoon & Lindstrom 2006 call such orders cache-oblivious).
pub fn hilbert_order(pages: &[(PageId, Place)]) -> LinearOrder {
    let mut keyed: Vec<(u64, PageId, u32)> = pages.iter().map(|&(page, place)| (key(page), page, place.len)).collect();
    keyed.sort();
    let mut offset = 0;
    let place = |(_, page, len): (u64, PageId, u32)| {
        let place = Place { offset, len };
        offset += u64::from(len);
        (page, (0, place))
    };
    LinearOrder(keyed.into_iter().map(place).collect())
}

/// All pages that an index in memory tells of, those of packs alone.
pub fn pages_of(index: &IndexForest) -> Vec<(PageId, Place)> {
    index.trees().flat_map(IndexTree::nodes).flat_map(|node| pages_at(&node)).collect()
}

fn pages_at(node: &Node<'_>) -> Vec<(PageId, Place)> {
    let page = |kind| PageId { cell: node.cell(), kind };
    let terrain = node.terrain().map(|entry| (page(PageKind::Terrain), entry.place));
    let imagery = node.imagery().map(|place| (page(PageKind::Imagery), place));
    let objects = node
        .objects()
        .map(|entry| (page(PageKind::Objects { collection: entry.collection, rep: entry.rep }), entry.place));
    terrain.into_iter().chain(imagery).chain(objects).collect()
}

/// The same index, whole in memory, over pages in another order.
pub fn reordered(index: &IndexForest, order: &LinearOrder) -> Result<IndexForest, IndexError> {
    let place = |cell, kind, old: Place| order.0.get(&PageId { cell, kind }).map_or(old, |(_, place)| *place);
    let mut moved = IndexForest::default();
    for tree in index.trees() {
        let info = |node: Node<'_>| {
            let cell = node.cell();
            let objects = |entry: ObjectsEntry| {
                let kind = PageKind::Objects { collection: entry.collection, rep: entry.rep };
                ObjectsEntry { place: place(cell, kind, entry.place), ..entry }
            };
            let terrain =
                |entry: TerrainEntry| TerrainEntry { place: place(cell, PageKind::Terrain, entry.place), ..entry };
            let info = NodeInfo {
                terrain: node.terrain().map(terrain),
                imagery: node.imagery().map(|old| place(cell, PageKind::Imagery, old)),
                height_range_m: node.height_range_m(),
                dimension_m: node.dimension_m(),
                reach_m: node.reach_m(),
                objects: node.objects().map(objects).collect(),
                below: node.objects_below().collect(),
            };
            (cell, info)
        };
        let nodes: BTreeMap<CellId, NodeInfo> = tree.nodes().map(info).collect();
        moved.insert(IndexTree::build(tree.zone(), &nodes)?);
    }
    Ok(moved)
}

/// Bits of each coordinate.
const BITS: u32 = 20;

/// The middle of the cell on the whole Earth, and its level, as a number along the curve.
fn key(page: PageId) -> u64 {
    let middle = page.cell.bounds().center();
    let end = f64::from(1u32 << BITS) - 1.0;
    let turn = std::f64::consts::TAU;
    let x = ((middle.lon_rad / turn + 0.5) * end).clamp(0.0, end) as u32;
    let y = ((middle.lat_rad / turn + 0.5) * end).clamp(0.0, end) as u32;
    let level = (f64::from(page.cell.level()) / f64::from(LEVEL_MAX) * end) as u32;
    hilbert([x, y, level])
}

/// Distance along the Hilbert curve of three dimensions (Skilling 2004, *Programming the Hilbert curve*).
fn hilbert(mut x: [u32; 3]) -> u64 {
    let mut q = 1 << (BITS - 1);
    while q > 1 {
        let p = q - 1;
        for i in 0..3 {
            if x[i] & q != 0 {
                x[0] ^= p;
            } else {
                let t = (x[0] ^ x[i]) & p;
                x[0] ^= t;
                x[i] ^= t;
            }
        }
        q >>= 1;
    }
    for i in 1..3 {
        x[i] ^= x[i - 1];
    }
    let (mut t, mut q) = (0, 1 << (BITS - 1));
    while q > 1 {
        if x[2] & q != 0 {
            t ^= q - 1;
        }
        q >>= 1;
    }
    let x = x.map(|word| word ^ t);
    let bits = (0..BITS).rev().flat_map(|bit| x.map(|word| u64::from(word >> bit & 1)));
    bits.fold(0, |along, bit| along << 1 | bit)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbors_along_the_curve_are_neighbors_in_space() {
        let side = 8u32;
        let shift = BITS - 3;
        let all = (0..side).flat_map(|x| (0..side).flat_map(move |y| (0..side).map(move |z| [x, y, z])));
        let mut along: Vec<(u64, [u32; 3])> = all.map(|at| (hilbert(at.map(|word| word << shift)), at)).collect();
        along.sort();
        for pair in along.windows(2) {
            let apart: u32 = (0..3).map(|axis| pair[0].1[axis].abs_diff(pair[1].1[axis])).sum();
            assert_eq!(apart, 1, "{pair:?}");
        }
    }
}
