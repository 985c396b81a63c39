//! Resident pages by cell.

use crate::content::{ObjectPage, Page, PageId, TerrainPage};
use crate::forest::CellId;
use std::sync::Arc;

/// The pages that can be drawn in this frame. Imagery and meshes of objects live in the GPU; here only their names
/// and what selection needs of them.
#[derive(Default)]
pub struct LiveTree {}

impl LiveTree {
    /// Makes a page drawable; call it once its GPU part is uploaded.
    pub fn insert(&mut self, _page: &Page) {
        todo!()
    }

    /// Makes a page undrawable; false when it was not resident.
    pub fn remove(&mut self, _page: PageId) -> bool {
        todo!()
    }

    pub fn contains(&self, _page: PageId) -> bool {
        todo!()
    }

    pub fn terrain(&self, _cell: CellId) -> Option<&Arc<TerrainPage>> {
        todo!()
    }

    pub fn has_imagery(&self, _cell: CellId) -> bool {
        todo!()
    }

    pub fn objects(&self, _root: CellId, _collection: u8, _rep: u8) -> Option<&Arc<ObjectPage>> {
        todo!()
    }

    /// The resident terrain page of the cell or of its nearest ancestor that has one.
    pub fn nearest_terrain(&self, _cell: CellId) -> Option<&Arc<TerrainPage>> {
        todo!()
    }

    pub fn nearest_imagery(&self, _cell: CellId) -> Option<CellId> {
        todo!()
    }

    /// Whether any terrain or imagery page strictly below the cell is resident.
    pub fn has_finer(&self, _cell: CellId) -> bool {
        todo!()
    }

    /// Height of the finest resident terrain surface at a place, metres; `None` where nothing is resident.
    pub fn surface_height_m(&self, _lat_rad: f64, _lon_rad: f64) -> Option<f64> {
        todo!()
    }
}
