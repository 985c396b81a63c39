//! What is seen from a place: asked of whoever can draw.

use crate::content::{PageId, PageKind};
use crate::forest::CellId;
use crate::geodesy::Geodetic;
use std::collections::HashSet;

/// Looks around from places, and tells what is in sight there, hidden things left out.
pub trait Witness {
    /// Of all directions; an error is a line for the user.
    fn seen(&mut self, eye: Geodetic) -> Result<Seen, String>;
}

/// What pictures around a place show: cells of the ground, and roots of pages of objects.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Seen {
    ground: HashSet<CellId>,
    /// Cells above those.
    above_ground: HashSet<CellId>,
    objects: HashSet<(u8, CellId)>,
    above_objects: HashSet<(u8, CellId)>,
}

impl Seen {
    pub fn add_ground(&mut self, cell: CellId) {
        if self.ground.insert(cell) {
            self.above_ground.extend(cell.ancestors().skip(1));
        }
    }

    pub fn add_objects(&mut self, collection: u8, root: CellId) {
        if self.objects.insert((collection, root)) {
            self.above_objects.extend(root.ancestors().skip(1).map(|cell| (collection, cell)));
        }
    }

    /// The cells of the ground themselves.
    pub fn ground(&self) -> impl Iterator<Item = CellId> + '_ {
        self.ground.iter().copied()
    }

    pub fn join(&mut self, other: &Self) {
        self.ground.extend(&other.ground);
        self.above_ground.extend(&other.above_ground);
        self.objects.extend(&other.objects);
        self.above_objects.extend(&other.above_objects);
    }

    /// Whether something of what a page stands for was seen: by itself, or drawn from finer or coarser pages.
    pub fn shows(&self, page: PageId) -> bool {
        let cell = page.cell;
        match page.kind {
            PageKind::Terrain | PageKind::Imagery => {
                self.above_ground.contains(&cell) || cell.ancestors().any(|above| self.ground.contains(&above))
            }
            PageKind::Objects { collection, .. } => {
                self.above_objects.contains(&(collection, cell))
                    || cell.ancestors().any(|above| self.objects.contains(&(collection, above)))
            }
            // Without its segment a page cannot be asked for.
            PageKind::Segment => true,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_above_or_below_a_seen_cell_is_shown_and_what_is_beside_it_is_not() {
        let cell = CellId::containing(0.7, -2.1, 14);
        let mut seen = Seen::default();
        seen.add_ground(cell);
        seen.add_objects(3, cell);
        let page = |cell, kind| PageId { cell, kind };
        let related = [cell, cell.parent().unwrap(), cell.children().next().unwrap()];
        let beside = cell.parent().unwrap().children().find(|&other| other != cell).unwrap();
        for kind in [PageKind::Terrain, PageKind::Imagery, PageKind::Objects { collection: 3, rep: 5 }] {
            assert!(related.iter().all(|&cell| seen.shows(page(cell, kind))));
            assert!(!seen.shows(page(beside, kind)));
        }
        assert!(!seen.shows(page(cell, PageKind::Objects { collection: 2, rep: 0 })));
        let mut other = Seen::default();
        other.add_ground(beside);
        other.join(&seen);
        assert!(other.shows(page(beside, PageKind::Terrain)) && other.shows(page(cell, PageKind::Terrain)));
    }
}
