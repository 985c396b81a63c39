//! A prepared world, open for reading.

use super::error::StoreError;
use super::index::{self, Extent};
use super::manifest::Manifest;
use super::pack::{MemoryPacks, PageRange, PageSource};
use super::seek::SeekFile;
use super::site::{Site, Told};
use super::stack::{self, Stack, StackSource, Stacked};
use super::{DiskCache, PageFault, PrismPage, decode_attributes, decode_page, decode_prisms, frame};
use crate::content::{LAYOUT_AT, Page, PageFile, PageId, PageKind};
use crate::forest::index::{IndexForest, IndexTree, Place, Segment};
use crate::forest::{CellId, Zone};
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use xxhash_rust::xxh3::xxh3_64;

/// The name of the manifest in a world's directory.
pub const MANIFEST_FILE: &str = "world.json";

/// Worlds whose index files have no more bytes than this together are opened with all of their index in memory; of
/// larger ones only directories and top segments are, and the rest is paged. As much as 130,000 cells: a country at the
/// resolution of streets, or a few cities.
pub const INDEX_RESIDENT_MAX_BYTES: u64 = 4 << 20;

/// How often a world is opened anew that is changed meanwhile.
const OPEN_ATTEMPTS: u32 = 4;

/// A world: manifest and index in memory, pages where their source has them; of a large index no more than the top, the
/// rest being pages too. Readable from any thread at once.
pub struct World {
    name: PathBuf,
    manifest: Manifest,
    index: IndexForest,
    source: Box<dyn PageSource>,
    /// Of several worlds over one another: whose pages they are.
    stack: Option<Arc<Stack>>,
    /// xxh3 of the manifest's text: what was made for another build tells another one.
    build: u64,
    /// The layout that is open.
    pub(super) layout: Option<SeekFile>,
}

/// How a world is opened.
#[derive(Clone)]
pub struct OpenOptions {
    /// See [`INDEX_RESIDENT_MAX_BYTES`].
    pub resident_max_bytes: u64,
    /// Keeps what is read over a network.
    pub cache: Option<Arc<DiskCache>>,
}

impl Default for OpenOptions {
    fn default() -> Self {
        Self { resident_max_bytes: INDEX_RESIDENT_MAX_BYTES, cache: None }
    }
}

impl World {
    /// Opens a directory that `stoop-prepare` wrote, or an address where its files lie (`http://`, `https://`, `s3://`).
    /// Manifest and index are checked, packs as they are read; of an index beyond [`INDEX_RESIDENT_MAX_BYTES`] its
    /// directories and top segments, the other segments as they are read.
    pub fn open(world: &Path) -> Result<Self, StoreError> {
        Self::open_with(world, &OpenOptions::default())
    }

    /// The same with all of the index in memory (by memory map, where that is possible), whatever its size: for walks
    /// that must see everything.
    pub fn open_whole(world: &Path) -> Result<Self, StoreError> {
        Self::open_paged(world, u64::MAX)
    }

    /// The same with another limit than [`INDEX_RESIDENT_MAX_BYTES`].
    pub fn open_paged(world: &Path, resident_max_bytes: u64) -> Result<Self, StoreError> {
        Self::open_with(world, &OpenOptions { resident_max_bytes, ..OpenOptions::default() })
    }

    /// The same with all that can be asked for.
    pub fn open_with(world: &Path, options: &OpenOptions) -> Result<Self, StoreError> {
        let site = Site::of(world, options)?;
        // Between the manifest and the files that it names a change may have come and gone; then the manifest is
        // another one, and is followed.
        let mut manifest = site.read_manifest()?;
        for _ in 1..OPEN_ATTEMPTS {
            let told = manifest.text().to_owned();
            match Self::open_as_told(&site, manifest, options) {
                Ok(world) => return Ok(world),
                Err(error) => {
                    manifest = site.read_manifest()?;
                    if manifest.text() == told {
                        return Err(error);
                    }
                }
            }
        }
        Self::open_as_told(&site, manifest, options)
    }

    fn open_as_told(site: &Site, told: Told, options: &OpenOptions) -> Result<Self, StoreError> {
        let manifest_file = site.manifest_file();
        let manifest = Manifest::parse(told.text(), &manifest_file)?;
        let zones = zones(&manifest).map_err(|zone| StoreError::Manifest {
            file: manifest_file.clone(),
            cause: format!("{zone} is no zone"),
        })?;
        let build = xxh3_64(told.text());
        let source = told.source(&manifest);
        let index = open_index(&*source, &zones, options.resident_max_bytes)?;
        Ok(Self { name: site.name(), manifest, index, source, stack: None, build, layout: None })
    }

    /// A world of trees and of files by zone (headers included), all in memory; see [`super::MemoryWriter`].
    pub(super) fn from_memory(manifest: Manifest, trees: Vec<IndexTree>, files: MemoryPacks) -> Self {
        let mut index = IndexForest::default();
        trees.into_iter().for_each(|tree| index.insert(tree));
        let source = Box::new(files);
        Self { name: "memory".into(), manifest, index, source, stack: None, build: 0, layout: None }
    }

    /// Worlds over one another, as one. Each terrain page and picture is that of the first world that has it, and the
    /// sets of all are there, numbered on; so a world that is added behind the others changes none of their pages.
    /// Sets are set on the ground of the whole as they are decoded. Their indexes must be in memory whole.
    pub fn stack(worlds: &[Arc<Self>]) -> Result<Self, StoreError> {
        Self::stacked(worlds, None)
    }

    /// One world more behind all others. `worlds`: all of them; `self`: those before the last, over one another. What is
    /// being read of them meanwhile may be read from either.
    pub fn stack_further(&self, worlds: &[Arc<Self>]) -> Result<Self, StoreError> {
        Self::stacked(worlds, self.stack.as_deref())
    }

    fn stacked(worlds: &[Arc<Self>], before: Option<&Stack>) -> Result<Self, StoreError> {
        let Stacked { manifest, index, stack } = stack::stack(worlds, before)?;
        let stack = Arc::new(stack);
        let name = worlds.first().map_or_else(PathBuf::new, |world| world.name.clone());
        let source = Box::new(StackSource(stack.clone()));
        Ok(Self { name, manifest, index, source, stack: Some(stack), build: 0, layout: None })
    }

    /// The same world with its index opened anew: whole, if its files have no more bytes than this, else its top.
    pub fn paged(self, resident_max_bytes: u64) -> Result<Self, StoreError> {
        let zones: Vec<Zone> = self.index.trees().map(IndexTree::zone).collect();
        let index = open_index(&*self.source, &zones, resident_max_bytes)?;
        Ok(Self { index, ..self })
    }

    /// The same world read from elsewhere, for instance through a slow or a faulty source.
    pub fn with_source(self, wrap: impl FnOnce(Box<dyn PageSource>) -> Box<dyn PageSource>) -> Self {
        Self { source: wrap(self.source), ..self }
    }

    /// The directory or the address, for messages.
    pub fn name(&self) -> &Path {
        &self.name
    }

    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// As it was opened: segments that are read later become part of whoever's clone they are inserted into.
    pub fn index(&self) -> &IndexForest {
        &self.index
    }

    /// The whole index; what is not in memory is read.
    pub fn whole_index(&self) -> Result<IndexForest, StoreError> {
        if self.index.is_whole() {
            return Ok(self.index.clone());
        }
        let zones: Vec<Zone> = self.index.trees().map(IndexTree::zone).collect();
        open_index(&*self.source, &zones, u64::MAX)
    }

    /// Tells this build of the world from others.
    pub fn build(&self) -> u64 {
        self.build
    }

    pub(super) fn source(&self) -> &dyn PageSource {
        &*self.source
    }

    /// Where a page lies; `None` when the world has no such page, or its node is not in memory.
    pub fn place(&self, page: PageId) -> Option<Place> {
        page.place(&self.index)
    }

    /// The stored bytes of a page: one read, unchecked; [`World::decode`] checks them. Segments lie in the index files.
    pub fn read(&self, page: PageId, place: Place) -> Result<Vec<u8>, StoreError> {
        let zone = page.cell.zone();
        match page.kind.file_of(place) {
            PageFile::Index => self.source.read_index(zone, place),
            PageFile::Pack => self.source.read(zone, place),
            PageFile::Layout => self.read_layout(place),
        }
    }

    /// The stored bytes of a run of pages: one read, unchecked.
    pub fn read_range(&self, range: &PageRange<'_>) -> Result<Vec<u8>, StoreError> {
        if range.file == PageFile::Layout { self.read_layout(range.place) } else { self.source.read_range(range) }
    }

    fn read_layout(&self, place: Place) -> Result<Vec<u8>, StoreError> {
        let none = || StoreError::Layout { file: self.name.clone(), cause: "no layout is open".into() };
        self.layout.as_ref().ok_or_else(none)?.read(self, place)
    }

    /// Several runs, at once where that is faster than one after the other; in their order.
    pub fn read_ranges(&self, ranges: &[PageRange<'_>]) -> Vec<Result<Vec<u8>, StoreError>> {
        if ranges.iter().any(|range| range.file == PageFile::Layout) {
            return ranges.iter().map(|range| self.read_range(range)).collect();
        }
        self.source.read_ranges(ranges)
    }

    /// Whether reads go over a network.
    pub fn is_remote(&self) -> bool {
        self.source.is_remote()
    }

    /// What its user should know of how it was opened, a line.
    pub fn notice(&self) -> Option<String> {
        self.source.notice()
    }

    /// Checks and decodes the bytes of a page that was read from `place`.
    pub fn decode(&self, page: PageId, place: Place, bytes: &[u8]) -> Result<Page, StoreError> {
        if page.kind == PageKind::Segment {
            return Ok(Page::Segment(self.decode_segment(page.cell, bytes)?));
        }
        if let Some(stack) = &self.stack {
            return stack.decode(page, place, bytes);
        }
        decode_page(page, bytes).map_err(|fault| self.page_error(page, place, fault))
    }

    fn decode_segment(&self, root: CellId, bytes: &[u8]) -> Result<Segment, StoreError> {
        let zone = root.zone();
        let tree = self.index.tree(zone).ok_or_else(|| StoreError::Index {
            file: self.source.index_name(zone),
            cause: format!("the world has nothing in the zone of cell {root}"),
        })?;
        index::decode(&*self.source, tree, root, bytes)
    }

    /// Reads and decodes.
    pub fn load(&self, page: PageId, place: Place) -> Result<Page, StoreError> {
        self.decode(page, place, &self.read(page, place)?)
    }

    /// The prisms of a page of objects as stored.
    pub fn prisms(&self, page: PageId, place: Place, bytes: &[u8]) -> Result<PrismPage, StoreError> {
        if let Some(stack) = &self.stack {
            return stack.prisms(page, place, bytes);
        }
        decode_prisms(bytes).map_err(|fault| self.page_error(page, place, fault))
    }

    /// The attributes of a page's objects, as JSON texts in the order of the decoded page; none when the collection
    /// has none.
    pub fn attributes(&self, page: PageId, place: Place, bytes: &[u8]) -> Result<Vec<String>, StoreError> {
        if let Some(stack) = &self.stack {
            return stack.attributes(page, place, bytes);
        }
        decode_attributes(bytes).map_err(|fault| self.page_error(page, place, fault))
    }

    pub(super) fn page_error(&self, page: PageId, place: Place, fault: PageFault) -> StoreError {
        let (file, offset) = match &self.layout {
            Some(layout) if place.offset >= LAYOUT_AT => layout.locate(self, place),
            _ => self.source.file_of(page.cell.zone(), place),
        };
        if let PageFault::FutureVersion(found) = fault {
            return StoreError::FutureVersion { file, found: u32::from(found), supported: u32::from(frame::VERSION) };
        }
        StoreError::Page { file, page, offset, fault }
    }
}

/// The zones that a manifest names; the first number that is none.
fn zones(manifest: &Manifest) -> Result<Vec<Zone>, u8> {
    manifest.zones.iter().map(|&zone| Zone::new(zone).ok_or(zone)).collect()
}

fn open_index(source: &dyn PageSource, zones: &[Zone], resident_max_bytes: u64) -> Result<IndexForest, StoreError> {
    source.before_open(zones)?;
    let lens: Vec<u64> = zones.iter().map(|&zone| source.index_len(zone)).collect::<Result<_, _>>()?;
    let all_bytes = lens.into_iter().fold(0, u64::saturating_add);
    let extent = if all_bytes <= resident_max_bytes { Extent::Whole } else { Extent::Top };
    let open = |&zone: &Zone| index::open(source, zone, extent);
    let trees: Vec<IndexTree> = zones.par_iter().map(open).collect::<Result<_, _>>()?;
    let mut index = IndexForest::default();
    trees.into_iter().for_each(|tree| index.insert(tree));
    source.after_open()?;
    Ok(index)
}
