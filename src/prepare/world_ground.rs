//! The ground of a world that stands, for objects that are put on it: what is drawn there, not the sources it was made of.

use super::buildings::Ground;
use crate::content::TerrainPage;
use crate::forest::CellId;
use crate::forest::index::TerrainEntry;
use crate::store::{GroundPages, StoreError, World, finest_terrain};
use crate::units::ByteSize;
use std::sync::{Arc, Mutex, PoisonError};

pub(super) struct WorldGround<'a> {
    world: &'a World,
    pages: GroundPages,
    failure: Mutex<Option<StoreError>>,
}

impl<'a> WorldGround<'a> {
    /// `world`: with its whole index; `limit`: of the pages kept.
    pub fn new(world: &'a World, limit: ByteSize) -> Self {
        Self { world, pages: GroundPages::new(limit.0), failure: Mutex::default() }
    }

    /// Runs `with` this ground. A page that could not be read is told afterwards, by [`WorldGround::failure`].
    pub fn with<T>(&self, with: impl FnOnce(&Ground<'_>) -> T) -> T {
        let index = self.world.index();
        with(&Ground {
            height_m: &|lat_rad, lon_rad| self.height_m(lat_rad, lon_rad),
            error_m: &|lat_rad, lon_rad| {
                finest_terrain(index, lat_rad, lon_rad).map_or(0.0, |(_, terrain)| f64::from(terrain.error_m))
            },
        })
    }

    /// The first failure of reading.
    pub fn failure(&self) -> Option<StoreError> {
        self.failure.lock().unwrap_or_else(PoisonError::into_inner).take()
    }

    /// The page of a cell.
    pub fn page(&self, cell: CellId, terrain: TerrainEntry) -> Result<Arc<TerrainPage>, StoreError> {
        self.pages.page(self.world, cell, terrain)
    }

    /// Above the ellipsoid, metres; 0 where the world has no terrain.
    fn height_m(&self, lat_rad: f64, lon_rad: f64) -> f64 {
        match self.pages.height_m(self.world, lat_rad, lon_rad) {
            Ok(height_m) => height_m.unwrap_or(0.0),
            Err(error) => {
                self.failure.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
                0.0
            }
        }
    }
}
