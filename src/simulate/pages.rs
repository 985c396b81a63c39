//! Pages for simulated runs, decoded once and shared by all of them.

use super::run::FIXED_BYTES;
use crate::content::{ImageryPage, LAYOUT_AT, ObjectMesh, ObjectPage, Page, PageId, PageKind, TerrainPage};
use crate::forest::CellId;
use crate::forest::index::{IndexError, IndexForest, Place};
use crate::layout::{Layout, LinearOrder, reordered};
use crate::paging::{PageReader, ReadError};
use crate::select::{StoredMeshes, StoredPages};
use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

/// Decoded bytes kept between runs; what goes beyond is decoded again whenever it is needed.
pub const CACHE_BYTES_MAX: usize = 2 << 30;

/// A world to be flown over by virtual clocks, on several threads at once.
pub struct Library {
    pub index: IndexForest,
    /// What is flown by.
    pub layout: Option<Arc<Layout>>,
    /// The index by which pages are read, where they are told to lie elsewhere.
    stored: Option<IndexForest>,
    reader: Arc<dyn PageReader>,
    cache: Mutex<Cache>,
}

#[derive(Default)]
struct Cache {
    pages: HashMap<PageId, Page>,
    bytes: usize,
}

impl Library {
    /// `index` as it is when the clock starts.
    pub fn new(index: IndexForest, reader: Arc<dyn PageReader>) -> Self {
        Self { index, layout: None, stored: None, reader, cache: Mutex::default() }
    }

    /// The same, its pages in another order on the storage.
    pub fn in_order(self, order: &LinearOrder) -> Result<Self, IndexError> {
        let index = reordered(&self.index, order)?;
        Ok(Self { stored: Some(self.index), index, ..self })
    }

    /// The same, flown by a layout.
    pub fn with_layout(self, layout: Option<Arc<Layout>>) -> Self {
        Self { layout, ..self }
    }

    /// What is set aside of the footprint, bytes: index, layout, a decoder's workspace.
    pub fn fixed_bytes(&self) -> u64 {
        let layout = self.layout.as_ref().map_or(0, |layout| layout.byte_len() as u64);
        FIXED_BYTES + self.index.bytes().fixed() as u64 + layout
    }

    /// A page as it would be after its arrival. Of pictures only their place is told: nothing asks for their texels.
    pub fn page(&self, page: PageId, place: Place) -> Result<Page, ReadError> {
        if page.kind == PageKind::Imagery {
            return Ok(Page::Imagery(Arc::new(ImageryPage { cell: page.cell, mips: Vec::new() })));
        }
        if let Some(known) = self.lock().pages.get(&page) {
            return Ok(known.clone());
        }
        // Wherever it is told to lie, simulated flights take it from its pack.
        let stored = self.stored.as_ref().unwrap_or(&self.index);
        let moved = place.offset >= LAYOUT_AT || self.stored.is_some();
        let place = if moved { page.place(stored).unwrap_or(place) } else { place };
        let loaded = self.reader.load(page, place)?;
        let mut cache = self.lock();
        if cache.bytes + loaded.byte_len() <= CACHE_BYTES_MAX && cache.pages.insert(page, loaded.clone()).is_none() {
            cache.bytes += loaded.byte_len();
        }
        Ok(loaded)
    }

    /// The cache stays meaningful whatever a holder of the lock did.
    fn lock(&self) -> std::sync::MutexGuard<'_, Cache> {
        self.cache.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl StoredPages for Library {
    fn terrain(&self, cell: CellId, place: Place) -> Option<Arc<TerrainPage>> {
        match self.page(PageId { cell, kind: PageKind::Terrain }, place) {
            Ok(Page::Terrain(page)) => Some(page),
            _ => None,
        }
    }

    fn objects(&self, page: PageId, place: Place) -> Option<Arc<ObjectPage>> {
        match self.page(page, place) {
            Ok(Page::Objects(page, _)) => Some(page),
            _ => None,
        }
    }
}

impl StoredMeshes for Library {
    fn mesh(&self, page: PageId, place: Place) -> Option<Arc<ObjectMesh>> {
        match self.page(page, place) {
            Ok(Page::Objects(_, mesh)) => Some(mesh),
            _ => None,
        }
    }
}
