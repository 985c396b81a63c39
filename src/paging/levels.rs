//! How often the drawn level changes.

use crate::forest::CellId;
use std::collections::BTreeSet;

/// The cells drawn in a frame, to compare with the next frame's.
#[derive(Debug, Default)]
pub struct DrawnLevels {
    cells: BTreeSet<CellId>,
}

impl DrawnLevels {
    /// Takes the cells of a frame and counts those that lie where the frame before drew another level.
    pub fn switch(&mut self, cells: impl IntoIterator<Item = CellId>) -> u32 {
        let now: BTreeSet<CellId> = cells.into_iter().collect();
        let switched = now.iter().filter(|&&cell| self.covers_otherwise(cell)).count();
        self.cells = now;
        switched as u32
    }

    fn covers_otherwise(&self, cell: CellId) -> bool {
        !self.cells.contains(&cell)
            && (cell.ancestors().any(|ancestor| self.cells.contains(&ancestor))
                || self.cells.range(cell.subtree()).next().is_some())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::forest::Zone;

    #[test]
    fn counts_cells_split_and_joined_but_not_new_ones() {
        let root = Zone::new(12).unwrap().root();
        let children: Vec<_> = root.children().collect();
        let mut levels = DrawnLevels::default();
        assert_eq!(levels.switch([root]), 0);
        assert_eq!(levels.switch(children.clone()), 4);
        assert_eq!(levels.switch(children), 0);
        assert_eq!(levels.switch([root, Zone::new(13).unwrap().root()]), 1);
    }
}
