//! What the engine flies over: an index, a description, and pages behind a reader.

use crate::content::{Page, PageId};
use crate::forest::index::{IndexForest, Place};
use crate::layout::Layout;
use crate::paging::{OneByOne, PageReader, PageRun, RangeRead, ReadError};
use crate::store::{Manifest, PageRange, StoreError, World};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// A world as the engine sees it. The index is light to clone: its segments are shared.
#[derive(Clone)]
pub struct Source {
    pub manifest: Arc<Manifest>,
    pub index: IndexForest,
    pub reader: Arc<dyn PageReader>,
    /// What is flown by, where the world has it and it is open.
    pub layout: Option<Arc<Layout>>,
}

impl Source {
    pub fn of(world: World) -> Self {
        Self::shared(&Arc::new(world))
    }

    /// A world, flown by one of its single-seek layouts. A layout that is broken, or of another build of the world, costs
    /// nothing but what it would have gained: the packs serve, and the second value says why.
    pub fn with_layout(mut world: World, name: &str) -> (Self, Option<String>) {
        let opened = world.open_layout(name).map_err(|error| error.to_string());
        let layout = opened.and_then(|head| Layout::parse(&head).map_err(|error| error.to_string()));
        let source = Self::of(world);
        match layout {
            Ok(layout) => (Self { layout: Some(Arc::new(layout)), ..source }, None),
            Err(refused) => (source, Some(refused)),
        }
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
        Self { manifest, index, reader: Arc::new(WorldReader(world.clone())), layout: None }
    }
}

/// Reads, verifies and decodes pages of a world.
struct WorldReader(Arc<World>);

impl PageReader for WorldReader {
    fn load(&self, page: PageId, place: Place) -> Result<Page, ReadError> {
        self.0.load(page, place).map_err(|error| sort(&error))
    }

    fn read_run(&self, run: &RangeRead) -> Result<Option<Arc<dyn PageRun>>, ReadError> {
        let places = places(run);
        self.opened(run, self.0.read_range(&range(run, &places)))
    }

    fn read_runs(&self, runs: &[RangeRead]) -> Vec<Result<Option<Arc<dyn PageRun>>, ReadError>> {
        let places: Vec<Vec<Place>> = runs.iter().map(places).collect();
        let ranges: Vec<PageRange<'_>> = runs.iter().zip(&places).map(|(run, places)| range(run, places)).collect();
        runs.iter().zip(self.0.read_ranges(&ranges)).map(|(run, read)| self.opened(run, read)).collect()
    }

    fn is_remote(&self) -> bool {
        self.0.is_remote()
    }
}

impl WorldReader {
    fn opened(
        &self,
        run: &RangeRead,
        read: Result<Vec<u8>, StoreError>,
    ) -> Result<Option<Arc<dyn PageRun>>, ReadError> {
        let bytes = read.map_err(|error| sort(&error))?;
        Ok(Some(Arc::new(WorldRun { world: self.0.clone(), offset: run.offset, bytes })))
    }
}

fn places(run: &RangeRead) -> Vec<Place> {
    run.pages.iter().map(|page| page.1).collect()
}

fn range<'a>(run: &RangeRead, pages: &'a [Place]) -> PageRange<'a> {
    PageRange { zone: run.zone, file: run.file, place: Place { offset: run.offset, len: run.len }, pages }
}

/// The bytes of a run, from an offset on.
struct WorldRun {
    world: Arc<World>,
    offset: u64,
    bytes: Vec<u8>,
}

impl PageRun for WorldRun {
    fn page(&self, page: PageId, place: Place) -> Result<Page, ReadError> {
        let start = place.offset.checked_sub(self.offset).and_then(|start| usize::try_from(start).ok());
        let bytes = start.and_then(|start| self.bytes.get(start..)?.get(..place.len as usize));
        // A reader gives what it was asked for; a page beside that ends too early, as its decoder says.
        self.world.decode(page, place, bytes.unwrap_or_default()).map_err(|error| sort(&error))
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

    fn read_run(&self, run: &RangeRead) -> Result<Option<Arc<dyn PageRun>>, ReadError> {
        let inner = self.lock().clone();
        let read = inner.read_run(run)?;
        Ok(Some(read.unwrap_or_else(|| Arc::new(OneByOne(inner)))))
    }

    fn read_runs(&self, runs: &[RangeRead]) -> Vec<Result<Option<Arc<dyn PageRun>>, ReadError>> {
        let inner = self.lock().clone();
        let one_by_one = |run: Option<Arc<dyn PageRun>>| Some(run.unwrap_or_else(|| Arc::new(OneByOne(inner.clone()))));
        inner.read_runs(runs).into_iter().map(|read| read.map(one_by_one)).collect()
    }

    fn is_remote(&self) -> bool {
        self.lock().is_remote()
    }
}

/// A device that does not answer may do so later; stored bytes that are wrong stay wrong.
fn sort(error: &StoreError) -> ReadError {
    let message = error.to_string();
    if error.is_transient() { ReadError::Failed(message) } else { ReadError::Broken(message) }
}
