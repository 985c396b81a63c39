//! Pages for simulated runs, decoded once and shared by all of them.

use crate::content::{ImageryPage, ObjectPage, Page, PageId, PageKind, TerrainPage};
use crate::forest::CellId;
use crate::forest::index::{IndexForest, Place};
use crate::paging::{PageReader, ReadError};
use crate::select::StoredPages;
use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

/// Decoded bytes kept between runs; what goes beyond is decoded again whenever it is needed.
pub const CACHE_BYTES_MAX: usize = 2 << 30;

/// A world to be flown over by virtual clocks, on several threads at once.
pub struct Library {
    pub index: IndexForest,
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
        Self { index, reader, cache: Mutex::default() }
    }

    /// A page as it would be after its arrival. Of pictures only their place is told: nothing asks for their texels.
    pub fn page(&self, page: PageId, place: Place) -> Result<Page, ReadError> {
        if page.kind == PageKind::Imagery {
            return Ok(Page::Imagery(Arc::new(ImageryPage { cell: page.cell, mips: Vec::new() })));
        }
        if let Some(known) = self.lock().pages.get(&page) {
            return Ok(known.clone());
        }
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
