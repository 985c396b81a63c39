//! Resident pages by cell.

use crate::content::{ObjectPage, Page, PageId, PageKind, TerrainPage};
use crate::forest::{CellId, LEVEL_MAX};
use std::collections::HashMap;
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

/// What is resident at a cell and below it.
#[derive(Default)]
struct Entry {
    terrain: Option<Arc<TerrainPage>>,
    imagery: bool,
    /// Terrain and imagery pages strictly below.
    below: u32,
}

impl Entry {
    fn is_empty(&self) -> bool {
        self.terrain.is_none() && !self.imagery && self.below == 0
    }
}

/// The pages that can be drawn in this frame. Imagery and meshes of objects live in the GPU; here only their names
/// and what selection needs of them.
#[derive(Default)]
pub struct LiveTree {
    entries: HashMap<CellId, Entry>,
    objects: HashMap<PageId, Arc<ObjectPage>>,
}

impl LiveTree {
    /// Makes a page drawable; call it once its GPU part is uploaded.
    pub fn insert(&mut self, page: &Page) {
        match page {
            Page::Terrain(terrain) => {
                let old = self.entries.entry(terrain.cell).or_default().terrain.replace(terrain.clone());
                if old.is_none() {
                    self.count_below(terrain.cell, 1);
                }
            }
            Page::Imagery(imagery) => {
                let had = std::mem::replace(&mut self.entries.entry(imagery.cell).or_default().imagery, true);
                if !had {
                    self.count_below(imagery.cell, 1);
                }
            }
            Page::Objects(objects, _) => {
                self.objects.insert(page.id(), objects.clone());
            }
            // Nothing of the index is drawn.
            Page::Segment(_) => {}
        }
    }

    /// Makes a page undrawable; false when it was not resident.
    pub fn remove(&mut self, page: PageId) -> bool {
        match page.kind {
            PageKind::Objects { .. } => return self.objects.remove(&page).is_some(),
            PageKind::Segment => return false,
            PageKind::Terrain | PageKind::Imagery => {}
        }
        let Some(entry) = self.entries.get_mut(&page.cell) else {
            return false;
        };
        let had = match page.kind {
            PageKind::Terrain => entry.terrain.take().is_some(),
            _ => std::mem::replace(&mut entry.imagery, false),
        };
        if had {
            self.forget_if_empty(page.cell);
            self.count_below(page.cell, -1);
        }
        had
    }

    fn count_below(&mut self, cell: CellId, change: i32) {
        for ancestor in cell.ancestors().skip(1) {
            let entry = self.entries.entry(ancestor).or_default();
            entry.below = entry.below.saturating_add_signed(change);
            self.forget_if_empty(ancestor);
        }
    }

    fn forget_if_empty(&mut self, cell: CellId) {
        if self.entries.get(&cell).is_some_and(Entry::is_empty) {
            self.entries.remove(&cell);
        }
    }

    pub fn contains(&self, page: PageId) -> bool {
        match page.kind {
            PageKind::Terrain => self.has_terrain(page.cell),
            PageKind::Imagery => self.has_imagery(page.cell),
            PageKind::Objects { .. } => self.objects.contains_key(&page),
            PageKind::Segment => false,
        }
    }

    pub fn terrain(&self, cell: CellId) -> Option<&Arc<TerrainPage>> {
        self.entries.get(&cell)?.terrain.as_ref()
    }

    pub fn has_terrain(&self, cell: CellId) -> bool {
        self.terrain(cell).is_some()
    }

    pub fn has_imagery(&self, cell: CellId) -> bool {
        self.entries.get(&cell).is_some_and(|entry| entry.imagery)
    }

    pub fn objects(&self, root: CellId, collection: u8, rep: u8) -> Option<&Arc<ObjectPage>> {
        self.objects.get(&PageId { cell: root, kind: PageKind::Objects { collection, rep } })
    }

    /// The resident terrain page of the cell or of its nearest ancestor that has one.
    pub fn nearest_terrain(&self, cell: CellId) -> Option<&Arc<TerrainPage>> {
        cell.ancestors().find_map(|ancestor| self.terrain(ancestor))
    }

    pub fn nearest_imagery(&self, cell: CellId) -> Option<CellId> {
        cell.ancestors().find(|&ancestor| self.has_imagery(ancestor))
    }

    /// Whether any terrain or imagery page strictly below the cell is resident.
    pub fn has_finer(&self, cell: CellId) -> bool {
        self.entries.get(&cell).is_some_and(|entry| entry.below > 0)
    }

    /// Height of the finest resident terrain surface at a place, metres; `None` where nothing is resident.
    pub fn surface_height_m(&self, lat_rad: f64, lon_rad: f64) -> Option<f64> {
        // π and −π are the same meridian; cells know it as −π.
        let lon_rad = if lon_rad >= PI { lon_rad - TAU } else { lon_rad };
        let terrain = self.nearest_terrain(CellId::containing(lat_rad, lon_rad, LEVEL_MAX))?;
        terrain.surface_height_m(lat_rad, lon_rad, 1.0)
    }

    /// How many pages are resident, by kind: terrain, imagery, objects.
    pub fn page_counts(&self) -> [usize; 3] {
        let terrain = self.entries.values().filter(|entry| entry.terrain.is_some()).count();
        let imagery = self.entries.values().filter(|entry| entry.imagery).count();
        [terrain, imagery, self.objects.len()]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::content::ImageryPage;
    use crate::forest::{Quadrant, Zone};

    fn picture(cell: CellId) -> Page {
        Page::Imagery(Arc::new(ImageryPage { cell, mips: Vec::new() }))
    }

    fn imagery(cell: CellId) -> PageId {
        PageId { cell, kind: PageKind::Imagery }
    }

    #[test]
    fn counts_below_follow_insertion_and_removal() {
        let root = Zone::new(17).unwrap().root();
        let child = root.child(Quadrant::NorthEast).unwrap();
        let grandchild = child.child(Quadrant::SouthWest).unwrap();
        let mut tree = LiveTree::default();
        tree.insert(&picture(grandchild));
        tree.insert(&picture(grandchild));
        assert!(tree.has_finer(root) && tree.has_finer(child) && !tree.has_finer(grandchild));
        tree.insert(&picture(root));
        assert_eq!(tree.nearest_imagery(child), Some(root));
        assert_eq!(tree.nearest_imagery(grandchild), Some(grandchild));
        assert!(tree.remove(imagery(grandchild)) && !tree.remove(imagery(grandchild)));
        assert!(!tree.has_finer(root) && tree.contains(imagery(root)));
        assert!(tree.remove(imagery(root)) && tree.entries.is_empty());
    }
}
