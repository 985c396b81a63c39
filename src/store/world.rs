//! A prepared world, open for reading.

use super::error::StoreError;
use super::index::{self, IndexFault};
use super::manifest::Manifest;
use super::pack::{LocalPacks, MemoryPacks, PageSource, index_path};
use super::{PrismPage, decode_attributes, decode_page, decode_prisms, map};
use crate::content::{Page, PageId, PageKind};
use crate::forest::Zone;
use crate::forest::index::{IndexForest, IndexTree, Place};
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// The name of the manifest in a world's directory.
pub const MANIFEST_FILE: &str = "world.json";

/// A world: manifest and index in memory, pages where their source has them. Readable from any thread at once.
pub struct World {
    name: PathBuf,
    manifest: Manifest,
    index: IndexForest,
    source: Box<dyn PageSource>,
}

impl World {
    /// Opens a directory that `stoop-prepare` wrote. Manifest and index are checked, packs as they are read.
    pub fn open(dir: &Path) -> Result<Self, StoreError> {
        let manifest_file = dir.join(MANIFEST_FILE);
        let text = fs::read(&manifest_file).map_err(|error| match error.kind() {
            io::ErrorKind::NotFound | io::ErrorKind::NotADirectory => StoreError::NotAWorld(dir.to_owned()),
            _ => StoreError::io(&manifest_file, error),
        })?;
        let manifest = Manifest::parse(&text, &manifest_file)?;
        let mut index = IndexForest::default();
        for &zone in &manifest.zones {
            let zone = Zone::new(zone).ok_or_else(|| StoreError::Manifest {
                file: manifest_file.clone(),
                cause: format!("{zone} is no zone"),
            })?;
            index.insert(open_index(&index_path(dir, zone), zone)?);
        }
        Ok(Self { name: dir.to_owned(), manifest, index, source: Box::new(LocalPacks::new(dir)) })
    }

    /// A world of trees and of packs by zone (headers included), all in memory; see [`super::MemoryWriter`].
    pub(super) fn from_memory(manifest: Manifest, trees: Vec<IndexTree>, packs: Vec<Vec<u8>>) -> Self {
        let mut index = IndexForest::default();
        trees.into_iter().for_each(|tree| index.insert(tree));
        Self { name: "memory".into(), manifest, index, source: Box::new(MemoryPacks(packs)) }
    }

    /// The same world read from elsewhere, for instance through a slow or a faulty source.
    pub fn with_source(self, wrap: impl FnOnce(Box<dyn PageSource>) -> Box<dyn PageSource>) -> Self {
        Self { source: wrap(self.source), ..self }
    }

    /// The directory, for messages.
    pub fn name(&self) -> &Path {
        &self.name
    }

    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    pub fn index(&self) -> &IndexForest {
        &self.index
    }

    pub(super) fn source(&self) -> &dyn PageSource {
        &*self.source
    }

    /// Where a page lies; `None` when the world has no such page.
    pub fn place(&self, page: PageId) -> Option<Place> {
        let node = self.index.find(page.cell)?;
        match page.kind {
            PageKind::Terrain => Some(node.terrain()?.place),
            PageKind::Imagery => node.imagery(),
            PageKind::Objects { collection, rep } => {
                node.objects().find(|entry| entry.collection == collection && entry.rep == rep).map(|entry| entry.place)
            }
        }
    }

    /// The stored bytes of a page: one read, unchecked; [`World::decode`] checks them.
    pub fn read(&self, page: PageId, place: Place) -> Result<Vec<u8>, StoreError> {
        self.source.read(page.cell.zone(), place)
    }

    /// Checks and decodes the bytes of a page.
    pub fn decode(&self, page: PageId, bytes: &[u8]) -> Result<Page, StoreError> {
        decode_page(page, bytes).map_err(|fault| self.page_error(page, fault))
    }

    /// Reads and decodes.
    pub fn load(&self, page: PageId, place: Place) -> Result<Page, StoreError> {
        self.decode(page, &self.read(page, place)?)
    }

    /// The prisms of a page of objects as stored.
    pub fn prisms(&self, page: PageId, bytes: &[u8]) -> Result<PrismPage, StoreError> {
        decode_prisms(bytes).map_err(|fault| self.page_error(page, fault))
    }

    /// The attributes of a page's objects, as JSON texts in the order of the decoded page; none when the collection
    /// has none.
    pub fn attributes(&self, page: PageId, bytes: &[u8]) -> Result<Vec<String>, StoreError> {
        decode_attributes(bytes).map_err(|fault| self.page_error(page, fault))
    }

    pub(super) fn page_error(&self, page: PageId, fault: super::PageFault) -> StoreError {
        StoreError::Page {
            file: self.source.pack_name(page.cell.zone()),
            page,
            offset: self.place(page).map_or(0, |place| place.offset),
            fault,
        }
    }
}

fn open_index(path: &Path, zone: Zone) -> Result<IndexTree, StoreError> {
    index::read(zone, map::map(path)?).map_err(|fault| match fault {
        IndexFault::FutureVersion(found) => {
            StoreError::FutureVersion { file: path.to_owned(), found, supported: index::VERSION }
        }
        IndexFault::Other(cause) => StoreError::Index { file: path.to_owned(), cause },
    })
}
