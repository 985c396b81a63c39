//! The finest ground of a world, read beside the paging: for what is worked out before a flight.

use super::Source;
use crate::content::{Page, PageId, PageKind, TerrainPage};
use crate::forest::index::{IndexForest, SegmentRef};
use crate::forest::{CellId, LEVEL_MAX};
use std::cell::RefCell;
use std::sync::Arc;

/// Looks up ground heights; keeps the page of the last place.
pub struct GroundProbe<'a> {
    source: &'a Source,
    /// With the segments on the way to the last place.
    index: RefCell<IndexForest>,
    last: RefCell<Option<Arc<TerrainPage>>>,
}

impl<'a> GroundProbe<'a> {
    pub fn new(source: &'a Source) -> Self {
        Self { source, index: RefCell::new(source.index.clone()), last: RefCell::new(None) }
    }

    /// Height of the finest surface above the ellipsoid, metres; 0 where the world has none that can be read.
    pub fn height_m(&self, lat_rad: f64, lon_rad: f64) -> f64 {
        self.page_at(lat_rad, lon_rad).and_then(|page| page.surface_height_m(lat_rad, lon_rad, 1.0)).unwrap_or(0.0)
    }

    fn page_at(&self, lat_rad: f64, lon_rad: f64) -> Option<Arc<TerrainPage>> {
        let place = CellId::containing(lat_rad, lon_rad, LEVEL_MAX);
        self.bring_in(place);
        let index = self.index.borrow();
        let deepest = index.find_deepest(place)?.cell();
        let (cell, entry) = deepest.ancestors().find_map(|cell| Some((cell, index.find(cell)?.terrain()?)))?;
        if let Some(page) = self.last.borrow().as_ref().filter(|page| page.cell == cell) {
            return Some(page.clone());
        }
        let id = PageId { cell, kind: PageKind::Terrain };
        let Ok(Page::Terrain(page)) = self.source.reader.load(id, entry.place) else { return None };
        *self.last.borrow_mut() = Some(page.clone());
        Some(page)
    }

    /// Makes the way to a place resident, and nothing else of what the source leaves out. Segments that cannot be read
    /// leave the ground above them.
    fn bring_in(&self, place: CellId) {
        let mut index = self.index.borrow_mut();
        let way: Vec<SegmentRef> =
            index.tree(place.zone()).map(|tree| tree.segments_towards(place).collect()).unwrap_or_default();
        let is_there = |segment: &SegmentRef| index.find(segment.root).is_some();
        if way.iter().all(is_there) {
            return;
        }
        *index = self.source.index.clone();
        for SegmentRef { root: cell, place } in way {
            let id = PageId { cell, kind: PageKind::Segment };
            let is_absent = index.find(cell).is_none();
            if is_absent && let Ok(Page::Segment(segment)) = self.source.reader.load(id, place) {
                // One that does not fit its directory was refused when it was read.
                let _ = index.insert_segment(segment);
            }
        }
    }
}
