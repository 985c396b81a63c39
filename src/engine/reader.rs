//! What the engine flies over: an index, a description, and pages behind a reader.

use crate::content::{AtlasFormat, Page, PageId};
use crate::forest::index::{IndexForest, Place};
use crate::paging::{PageReader, ReadError};
use crate::store::{Manifest, StoreError, World};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// A world as the engine sees it. The index is light to clone: its segments are shared.
#[derive(Clone)]
pub struct Source {
    pub manifest: Arc<Manifest>,
    pub index: IndexForest,
    pub reader: Arc<dyn PageReader>,
}

impl Source {
    pub fn of(world: World) -> Self {
        Self::shared(&Arc::new(world))
    }

    /// Worlds over one another; see [`World::stack`].
    pub fn over(worlds: &[Arc<World>]) -> Result<Self, StoreError> {
        match worlds {
            [world] => Ok(Self::shared(world)),
            worlds => Ok(Self::of(World::stack(worlds)?)),
        }
    }

    /// The same over a world that others hold too.
    pub fn shared(world: &Arc<World>) -> Self {
        let (manifest, index) = (Arc::new(world.manifest().clone()), world.index().clone());
        Self { manifest, index, reader: Arc::new(WorldReader(world.clone())) }
    }
}

impl Source {
    /// The same with atlases as a renderer wants them.
    pub(super) fn with_atlases(self, format: AtlasFormat) -> Self {
        match format {
            AtlasFormat::Rgba8 => self,
            format => Self { reader: Arc::new(AtlasReader { inner: self.reader, format }), ..self },
        }
    }
}

/// Lays atlases out for the GPU, where pages are decoded.
struct AtlasReader {
    inner: Arc<dyn PageReader>,
    format: AtlasFormat,
}

impl PageReader for AtlasReader {
    fn load(&self, page: PageId, place: Place) -> Result<Page, ReadError> {
        let mut loaded = self.inner.load(page, place)?;
        if let Page::Objects(_, mesh) = &mut loaded
            && mesh.atlas.is_some()
        {
            Arc::make_mut(mesh).compress_atlas(self.format);
        }
        Ok(loaded)
    }
}

/// Reads, verifies and decodes pages of a world.
struct WorldReader(Arc<World>);

impl PageReader for WorldReader {
    fn load(&self, page: PageId, place: Place) -> Result<Page, ReadError> {
        self.0.load(page, place).map_err(|error| sort(&error))
    }
}

/// Reads from a source that may be changed for another one while reads go on; each of them ends where it began.
pub(super) struct SwitchReader {
    inner: Mutex<Arc<dyn PageReader>>,
}

impl SwitchReader {
    pub fn new(inner: Arc<dyn PageReader>) -> Self {
        Self { inner: Mutex::new(inner) }
    }

    pub fn set(&self, inner: Arc<dyn PageReader>) {
        *self.lock() = inner;
    }

    fn lock(&self) -> MutexGuard<'_, Arc<dyn PageReader>> {
        // It is held for a copy only, which cannot fail halfway.
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl PageReader for SwitchReader {
    fn load(&self, page: PageId, place: Place) -> Result<Page, ReadError> {
        let inner = self.lock().clone();
        inner.load(page, place)
    }
}

/// A device that does not answer may do so later; stored bytes that are wrong stay wrong.
fn sort(error: &StoreError) -> ReadError {
    let message = error.to_string();
    if error.is_transient() { ReadError::Failed(message) } else { ReadError::Broken(message) }
}
