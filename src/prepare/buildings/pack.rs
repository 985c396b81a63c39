//! Small cells packed by subtree into pages, greedily from below.
//!
//! A page rooted at a cell holds all objects below it that no page rooted further below holds. So the objects of a
//! cell are in the page of the nearest root at or above it, and no two pages have the same root.

use crate::forest::CellId;

/// Pages larger than this are split where the tree can be; bytes as stored. Half of the format's 128 KiB, so that a
/// page that comes out larger than planned still fits.
pub const PAGE_BYTES_MAX: u64 = 64 << 10;

/// A page to be made.
#[derive(Clone, Debug, PartialEq)]
pub struct PagePlan {
    pub root: CellId,
    /// Indices of its cells in the list that was planned for, ascending.
    pub cells: Vec<usize>,
    pub bytes: u64,
}

/// Plans pages of at most `bytes_max` where cells allow it. Cells must be ascending, without doubles.
pub fn plan(cells: &[(CellId, u64)], bytes_max: u64) -> Vec<PagePlan> {
    let mut pages = Vec::new();
    let mut rest: Vec<usize> = (0..cells.len()).collect();
    while let Some(&first) = rest.first() {
        let zone = cells[first].0.zone();
        let end = rest.partition_point(|&at| cells[at].0.zone() <= zone);
        let of_zone: Vec<usize> = rest.drain(..end).collect();
        pages.extend(remainder(cells, of_zone, bytes_max).finish());
    }
    pages.sort_by_key(|page| page.root);
    pages
}

/// Pages made below a cell, and what is left for a page above.
struct Below {
    made: Vec<PagePlan>,
    left: PagePlan,
}

impl Below {
    fn finish(mut self) -> Vec<PagePlan> {
        self.made.push(self.left);
        self.made
    }
}

/// Plans for the cells of one zone; they must not be empty.
fn remainder(cells: &[(CellId, u64)], members: Vec<usize>, bytes_max: u64) -> Below {
    let root = common_ancestor(cells[members[0]].0, cells[members[members.len() - 1]].0);
    let own_end = members.partition_point(|&at| cells[at].0 == root);
    let mut left = PagePlan { root, cells: members[..own_end].to_vec(), bytes: 0 };
    left.bytes = left.cells.iter().map(|&at| cells[at].1).sum();
    let mut made = Vec::new();
    let mut below: Vec<PagePlan> = Vec::new();
    let mut rest = &members[own_end..];
    while let Some(&first) = rest.first() {
        let child = cells[first].0.ancestor(root.level() + 1);
        let end = rest.partition_point(|&at| cells[at].0.ancestor(root.level() + 1) <= child);
        let branch = remainder(cells, rest[..end].to_vec(), bytes_max);
        made.extend(branch.made);
        below.push(branch.left);
        rest = &rest[end..];
    }
    below.sort_by_key(|page| page.bytes);
    let mut total = left.bytes + below.iter().map(|page| page.bytes).sum::<u64>();
    while total > bytes_max {
        let Some(largest) = below.pop() else { break };
        total -= largest.bytes;
        made.push(largest);
    }
    for page in below {
        left.cells.extend(page.cells);
    }
    left.bytes = total;
    left.cells.sort_unstable();
    Below { made, left }
}

/// The deepest cell that holds both, which must be of one zone.
fn common_ancestor(a: CellId, b: CellId) -> CellId {
    a.ancestors().find(|ancestor| ancestor.contains(b)).unwrap_or(a.zone().root())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::{BTreeMap, HashSet};

    proptest! {
        #[test]
        fn every_cell_is_in_the_page_of_its_nearest_root(
            places in prop::collection::vec((-0.3f64..0.3, -0.3f64..0.3, 8u8..18, 10u64..20_000), 1..300),
        ) {
            let mut cells: BTreeMap<CellId, u64> = BTreeMap::new();
            for (lat, lon, level, bytes) in places {
                *cells.entry(CellId::containing(lat, lon, level)).or_default() += bytes;
            }
            let cells: Vec<_> = cells.into_iter().collect();
            let pages = plan(&cells, PAGE_BYTES_MAX);
            let roots: HashSet<CellId> = pages.iter().map(|page| page.root).collect();
            prop_assert_eq!(roots.len(), pages.len());
            let mut seen = 0;
            for page in &pages {
                seen += page.cells.len();
                prop_assert_eq!(page.bytes, page.cells.iter().map(|&at| cells[at].1).sum::<u64>());
                for &at in &page.cells {
                    let nearest = cells[at].0.ancestors().find(|ancestor| roots.contains(ancestor));
                    prop_assert_eq!(nearest, Some(page.root));
                }
                let own = page.cells.iter().filter(|&&at| cells[at].0 == page.root).count();
                prop_assert!(page.bytes <= PAGE_BYTES_MAX || own == page.cells.len());
            }
            prop_assert_eq!(seen, cells.len());
        }
    }

    #[test]
    fn pages_are_neither_tiny_nor_huge_where_the_tree_allows() {
        let mut cells: Vec<_> = (0..100_000u32)
            .map(|at| CellId::containing(0.1 + f64::from(at % 317) * 6e-6, 0.2 + f64::from(at / 317) * 6e-6, 17))
            .collect();
        cells.sort_unstable();
        cells.dedup();
        let cells: Vec<_> = cells.into_iter().map(|cell| (cell, 300)).collect();
        let pages = plan(&cells, PAGE_BYTES_MAX);
        let small = pages.iter().filter(|page| page.bytes < 16 << 10).count();
        assert!(pages.iter().all(|page| page.bytes <= PAGE_BYTES_MAX));
        assert!(small <= 2, "{small} of {}", pages.len());
    }
}
