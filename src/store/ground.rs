//! The ground of a prepared world: the surfaces of its finest terrain pages, asked for place by place.

use super::error::StoreError;
use super::world::World;
use crate::content::{Page, PageId, PageKind, TerrainPage};
use crate::forest::index::{IndexForest, TerrainEntry};
use crate::forest::{CellId, LEVEL_MAX};
use std::collections::{BTreeMap, HashMap};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Reads terrain pages as places ask for them, and keeps those asked for last, up to a limit in bytes. Thread-safe.
pub struct GroundPages {
    limit_bytes: u64,
    kept: Mutex<Kept>,
}

#[derive(Default)]
struct Kept {
    pages: HashMap<CellId, (Arc<TerrainPage>, u64)>,
    /// By the time of the last use.
    by_use: BTreeMap<u64, CellId>,
    clock: u64,
    bytes: u64,
}

impl GroundPages {
    pub fn new(limit_bytes: u64) -> Self {
        Self { limit_bytes, kept: Mutex::default() }
    }

    /// Above the ellipsoid, metres; `None` where the world, whose index must be whole, has no terrain.
    pub fn height_m(&self, world: &World, lat_rad: f64, lon_rad: f64) -> Result<Option<f64>, StoreError> {
        match finest_terrain(world.index(), lat_rad, lon_rad) {
            None => Ok(None),
            Some((cell, terrain)) => Ok(self.page(world, cell, terrain)?.surface_height_m(lat_rad, lon_rad, 1.0)),
        }
    }

    /// The page of a cell of the world.
    pub fn page(&self, world: &World, cell: CellId, terrain: TerrainEntry) -> Result<Arc<TerrainPage>, StoreError> {
        if let Some(page) = self.lock().find(cell) {
            return Ok(page);
        }
        let id = PageId { cell, kind: PageKind::Terrain };
        match world.load(id, terrain.place)? {
            Page::Terrain(page) => {
                self.lock().keep(cell, &page, self.limit_bytes);
                Ok(page)
            }
            // Pages are of the kind that was asked for; see `decode_page`.
            _ => Err(StoreError::NotAWorld(world.name().to_owned())),
        }
    }

    fn lock(&self) -> MutexGuard<'_, Kept> {
        // What a thread that failed left is whole: every change below is.
        self.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The finest cell with terrain at a place, as far as the index is in memory.
pub fn finest_terrain(index: &IndexForest, lat_rad: f64, lon_rad: f64) -> Option<(CellId, TerrainEntry)> {
    let path = CellId::containing(lat_rad, lon_rad, LEVEL_MAX);
    let mut node = index.tree(path.zone())?.root();
    let mut finest = node.terrain().map(|terrain| (node.cell(), terrain));
    for level in 1..=LEVEL_MAX {
        let quadrant = path.ancestor(level).and_then(CellId::quadrant);
        let Some(child) = quadrant.and_then(|quadrant| node.child(quadrant)) else { break };
        node = child;
        finest = node.terrain().map(|terrain| (node.cell(), terrain)).or(finest);
    }
    finest
}

impl Kept {
    fn find(&mut self, cell: CellId) -> Option<Arc<TerrainPage>> {
        let (page, used) = self.pages.get_mut(&cell)?;
        self.clock += 1;
        self.by_use.remove(used);
        self.by_use.insert(self.clock, cell);
        *used = self.clock;
        Some(page.clone())
    }

    fn keep(&mut self, cell: CellId, page: &Arc<TerrainPage>, limit_bytes: u64) {
        if self.pages.contains_key(&cell) {
            return;
        }
        self.clock += 1;
        self.bytes += page.byte_len() as u64;
        self.pages.insert(cell, (page.clone(), self.clock));
        self.by_use.insert(self.clock, cell);
        // The newest stays, however small the limit.
        while self.bytes > limit_bytes && self.pages.len() > 1 {
            let Some((_, oldest)) = self.by_use.pop_first() else { break };
            if let Some((gone, _)) = self.pages.remove(&oldest) {
                self.bytes -= gone.byte_len() as u64;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::content::TerrainPost;

    fn page(cell: CellId) -> Arc<TerrainPage> {
        let corner = |column, row| TerrainPost { column, row, height_m: 1.0, parent_height_m: 1.0, slope: [0; 2] };
        let posts = vec![corner(0, 0), corner(64, 0), corner(0, 64), corner(64, 64)];
        Arc::new(TerrainPage::from_posts(cell, 1.0, posts).unwrap())
    }

    #[test]
    fn what_was_used_last_stays_within_the_limit() {
        let cells: Vec<CellId> = (0..5).map(|at| CellId::containing(0.1, 0.01 * f64::from(at), 12)).collect();
        let len = page(cells[0]).byte_len() as u64;
        let mut kept = Kept::default();
        for &cell in &cells[..3] {
            kept.keep(cell, &page(cell), 3 * len);
        }
        assert!(kept.find(cells[0]).is_some());
        for &cell in &cells[3..] {
            kept.keep(cell, &page(cell), 3 * len);
            assert!(kept.bytes <= 3 * len && kept.pages.len() == kept.by_use.len());
        }
        let there: Vec<bool> = cells.iter().map(|cell| kept.pages.contains_key(cell)).collect();
        assert_eq!(there, [true, false, false, true, true]);
        kept.keep(cells[1], &page(cells[1]), 0);
        assert_eq!(kept.pages.len(), 1);
    }
}
