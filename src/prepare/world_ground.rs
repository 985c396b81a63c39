//! The ground of a world that stands: the surfaces of its own finest terrain pages, which is what is drawn there.

use super::buildings::Ground;
use crate::content::{Page, PageId, PageKind, TerrainPage};
use crate::forest::index::TerrainEntry;
use crate::forest::{CellId, LEVEL_MAX};
use crate::store::{StoreError, World};
use crate::units::ByteSize;
use std::collections::{BTreeMap, HashMap};
use std::sync::{Arc, Mutex, PoisonError};

/// Reads terrain pages as places ask for them, and keeps those asked for last, up to a limit in bytes.
pub(super) struct WorldGround<'a> {
    world: &'a World,
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
    failure: Option<StoreError>,
}

impl<'a> WorldGround<'a> {
    /// `world`: with its whole index.
    pub fn new(world: &'a World, limit: ByteSize) -> Self {
        Self { world, limit_bytes: limit.0, kept: Mutex::default() }
    }

    /// Runs `with` this ground. A page that could not be read is told afterwards, by [`WorldGround::failure`].
    pub fn with<T>(&self, with: impl FnOnce(&Ground<'_>) -> T) -> T {
        with(&Ground {
            height_m: &|lat_rad, lon_rad| self.height_m(lat_rad, lon_rad),
            error_m: &|lat_rad, lon_rad| {
                self.finest(lat_rad, lon_rad).map_or(0.0, |(_, terrain)| f64::from(terrain.error_m))
            },
        })
    }

    /// The first failure of reading.
    pub fn failure(&self) -> Option<StoreError> {
        self.lock().failure.take()
    }

    /// The page of a cell.
    pub fn page(&self, cell: CellId, terrain: TerrainEntry) -> Result<Arc<TerrainPage>, StoreError> {
        if let Some(page) = self.lock().find(cell) {
            return Ok(page);
        }
        let id = PageId { cell, kind: PageKind::Terrain };
        match self.world.load(id, terrain.place)? {
            Page::Terrain(page) => {
                self.lock().keep(cell, &page, self.limit_bytes);
                Ok(page)
            }
            // Pages are of the kind that was asked for; see `store::decode_page`.
            _ => Err(StoreError::NotAWorld(self.world.name().to_owned())),
        }
    }

    /// Above the ellipsoid, metres; 0 where the world has no terrain.
    fn height_m(&self, lat_rad: f64, lon_rad: f64) -> f64 {
        let Some((cell, terrain)) = self.finest(lat_rad, lon_rad) else { return 0.0 };
        match self.page(cell, terrain) {
            Ok(page) => page.surface_height_m(lat_rad, lon_rad, 1.0).unwrap_or(0.0),
            Err(error) => {
                self.lock().failure.get_or_insert(error);
                0.0
            }
        }
    }

    /// The finest cell with terrain at a place.
    fn finest(&self, lat_rad: f64, lon_rad: f64) -> Option<(CellId, TerrainEntry)> {
        let path = CellId::containing(lat_rad, lon_rad, LEVEL_MAX);
        let mut node = self.world.index().tree(path.zone())?.root();
        let mut finest = node.terrain().map(|terrain| (node.cell(), terrain));
        for level in 1..=LEVEL_MAX {
            let Some(child) = path.ancestor(level).and_then(CellId::quadrant).and_then(|at| node.child(at)) else {
                break;
            };
            node = child;
            finest = node.terrain().map(|terrain| (node.cell(), terrain)).or(finest);
        }
        finest
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, Kept> {
        // What a thread that failed left is whole: every change below is.
        self.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }
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
        let corner = |column, row| TerrainPost { column, row, height_m: 1.0, parent_height_m: 1.0 };
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
