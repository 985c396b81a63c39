//! Writing worlds: into a directory of another name, which gets its own as the last step.

use super::additions::{index_path, pack_path};
use super::error::StoreError;
use super::index;
use super::manifest::{LayerInfo, Manifest};
use super::pack::{self, MemoryPacks};
use super::world::{MANIFEST_FILE, World};
use crate::forest::Zone;
use crate::forest::index::{IndexTree, Place};
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

/// What to do where a world stands already.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Existing {
    Refuse,
    Replace,
}

/// Writes a world. Until [`WorldWriter::finish`] nothing shows under the world's name, and a world that stands there
/// stays; a writer that is dropped before leaves nothing behind.
pub struct WorldWriter {
    dir: PathBuf,
    partial: PathBuf,
    packs: BTreeMap<Zone, PackWriter>,
    finished: bool,
}

pub(super) struct PackWriter {
    path: PathBuf,
    file: BufWriter<File>,
    /// Where its bytes begin in the zone's row of them.
    start: u64,
    len: u64,
}

impl WorldWriter {
    pub fn create(dir: &Path, existing: Existing) -> Result<Self, StoreError> {
        // A link stays a link: what it points to is replaced.
        let dir = fs::canonicalize(dir).unwrap_or_else(|_| dir.to_owned());
        let has_world = dir.join(MANIFEST_FILE).exists();
        if has_world && existing == Existing::Refuse {
            return Err(StoreError::Exists(dir));
        }
        if !has_world && dir.exists() && !is_empty_dir(&dir) {
            return Err(StoreError::Occupied(dir));
        }
        let partial = sibling(&dir, "new");
        let writer = Self { dir, partial, packs: BTreeMap::new(), finished: false };
        for part in ["packs", "index"] {
            let path = writer.partial.join(part);
            fs::create_dir_all(&path).map_err(|error| StoreError::io(&path, error))?;
        }
        Ok(writer)
    }

    /// Puts an encoded page at the end of a zone's pack.
    pub fn append(&mut self, zone: Zone, page: &[u8]) -> Result<Place, StoreError> {
        let pack = match self.packs.entry(zone) {
            std::collections::btree_map::Entry::Occupied(entry) => entry.into_mut(),
            std::collections::btree_map::Entry::Vacant(entry) => {
                entry.insert(PackWriter::create(pack_path(&self.partial, zone, 0), zone, 0)?)
            }
        };
        pack.append(page)
    }

    /// Brings all pages to the disk.
    pub fn sync(&mut self) -> Result<(), StoreError> {
        self.packs.values_mut().try_for_each(PackWriter::sync)
    }

    /// Writes index and manifest, and gives the world its name. Of the manifest, version, datum, zones, pages and
    /// bytes are set here.
    pub fn finish(mut self, mut manifest: Manifest, trees: &[IndexTree]) -> Result<(), StoreError> {
        for tree in trees {
            if let Some(absent) = tree.absent_segments().next() {
                let cause = format!("only a part of it is in memory: segment {} is missing", absent.root);
                return Err(StoreError::Index { file: index_path(&self.dir, tree.zone(), 0), cause });
            }
            // A zone without pages still has a pack.
            if !self.packs.contains_key(&tree.zone()) {
                let pack = PackWriter::create(pack_path(&self.partial, tree.zone(), 0), tree.zone(), 0)?;
                self.packs.insert(tree.zone(), pack);
            }
        }
        self.sync()?;
        let mut index_bytes = 0;
        for tree in trees {
            let file = index::write(tree);
            index_bytes += file.len() as u64;
            write_file(&index_path(&self.partial, tree.zone(), 0), &file)?;
        }
        describe(&mut manifest, trees, index_bytes, self.packs.values().map(|pack| pack.len).sum());
        write_file(&self.partial.join(MANIFEST_FILE), &manifest.to_bytes())?;
        self.packs.clear();
        self.give_name()?;
        self.finished = true;
        Ok(())
    }

    fn give_name(&self) -> Result<(), StoreError> {
        let io = |error| StoreError::io(&self.dir, error);
        if is_empty_dir(&self.dir) {
            fs::remove_dir(&self.dir).map_err(io)?;
        }
        if !self.dir.exists() {
            return fs::rename(&self.partial, &self.dir).map_err(io);
        }
        let old = sibling(&self.dir, "old");
        fs::rename(&self.dir, &old).map_err(io)?;
        if let Err(error) = fs::rename(&self.partial, &self.dir) {
            // The old world comes back; what went wrong first is what counts.
            let _ = fs::rename(&old, &self.dir);
            return Err(io(error));
        }
        fs::remove_dir_all(&old).map_err(|error| StoreError::io(&old, error))
    }
}

impl Drop for WorldWriter {
    fn drop(&mut self) {
        if !self.finished {
            self.packs.clear();
            // Nobody is left to tell, and the name says what it is.
            let _ = fs::remove_dir_all(&self.partial);
        }
    }
}

impl PackWriter {
    pub fn create(path: PathBuf, zone: Zone, start: u64) -> Result<Self, StoreError> {
        let file = File::create(&path).map_err(|error| StoreError::io(&path, error))?;
        let mut pack = Self { path, file: BufWriter::with_capacity(1 << 18, file), start, len: 0 };
        pack.write(&pack::header(zone))?;
        Ok(pack)
    }

    fn write(&mut self, bytes: &[u8]) -> Result<(), StoreError> {
        self.file.write_all(bytes).map_err(|error| StoreError::io(&self.path, error))?;
        self.len += bytes.len() as u64;
        Ok(())
    }

    /// Bytes written so far, the header's included.
    pub fn len(&self) -> u64 {
        self.len
    }

    pub fn append(&mut self, page: &[u8]) -> Result<Place, StoreError> {
        let too_large = || StoreError::TooLarge { file: self.path.clone(), offset: self.len, len: page.len() };
        let len = u32::try_from(page.len()).map_err(|_| too_large())?;
        let place = self.start.checked_add(self.len).and_then(|offset| Place::new(offset, len));
        let place = place.ok_or_else(too_large)?;
        self.write(page)?;
        Ok(place)
    }

    pub fn sync(&mut self) -> Result<(), StoreError> {
        let io = |error| StoreError::io(&self.path, error);
        self.file.flush().map_err(io)?;
        self.file.get_ref().sync_all().map_err(io)
    }
}

pub(super) fn write_file(path: &Path, bytes: &[u8]) -> Result<(), StoreError> {
    let io = |error| StoreError::io(path, error);
    let mut file = File::create(path).map_err(io)?;
    file.write_all(bytes).map_err(io)?;
    file.sync_all().map_err(io)
}

fn is_empty_dir(dir: &Path) -> bool {
    fs::read_dir(dir).is_ok_and(|mut entries| entries.next().is_none())
}

/// A hidden name beside a directory.
fn sibling(dir: &Path, what: &str) -> PathBuf {
    let name = dir.file_name().map_or_else(|| "world".into(), |name| name.to_string_lossy());
    dir.with_file_name(format!(".{name}.{what}-{}", std::process::id()))
}

/// Fills in what trees and files tell.
fn describe(manifest: &mut Manifest, trees: &[IndexTree], index_bytes: u64, pack_bytes: u64) {
    manifest.version = Manifest::VERSION;
    manifest.datum = Manifest::DATUM.to_owned();
    manifest.zones = trees.iter().map(|tree| tree.zone().index() as u8).collect();
    manifest.zones.sort_unstable();
    manifest.index_bytes = index_bytes;
    manifest.pack_bytes = pack_bytes;
    (manifest.terrain, manifest.imagery) = (layer(trees, Layer::Terrain), layer(trees, Layer::Imagery));
    for (at, collection) in manifest.collections.iter_mut().enumerate() {
        let pages = || {
            let nodes = trees.iter().flat_map(IndexTree::nodes);
            nodes.flat_map(|node| node.objects()).filter(|entry| usize::from(entry.collection) == at)
        };
        collection.pages = pages().count() as u64;
        collection.bytes = pages().map(|entry| u64::from(entry.place.len)).sum();
    }
}

#[derive(Clone, Copy)]
pub(super) enum Layer {
    Terrain,
    Imagery,
}

/// Pages and bytes by level.
pub(super) fn layer(trees: &[IndexTree], which: Layer) -> Option<LayerInfo> {
    let mut info = LayerInfo::default();
    for node in trees.iter().flat_map(IndexTree::nodes) {
        let place = match which {
            Layer::Terrain => node.terrain().map(|terrain| terrain.place),
            Layer::Imagery => node.imagery(),
        };
        let Some(place) = place else { continue };
        let level = usize::from(node.cell().level());
        if info.pages_by_level.len() <= level {
            info.pages_by_level.resize(level + 1, 0);
            info.bytes_by_level.resize(level + 1, 0);
        }
        info.pages_by_level[level] += 1;
        info.bytes_by_level[level] += u64::from(place.len);
    }
    info.level_max = info.pages_by_level.len().checked_sub(1)? as u8;
    Some(info)
}

/// Makes a world in memory.
#[derive(Default)]
pub struct MemoryWriter {
    packs: Vec<Vec<u8>>,
}

impl MemoryWriter {
    /// Puts an encoded page at the end of a zone's pack.
    pub fn append(&mut self, zone: Zone, page: &[u8]) -> Result<Place, StoreError> {
        self.packs.resize(Zone::COUNT, Vec::new());
        let pack = &mut self.packs[zone.index()];
        if pack.is_empty() {
            *pack = pack::header(zone);
        }
        let too_large = || StoreError::TooLarge { file: "memory".into(), offset: pack.len() as u64, len: page.len() };
        let len = u32::try_from(page.len()).map_err(|_| too_large())?;
        let place = Place::new(pack.len() as u64, len).ok_or_else(too_large)?;
        pack.extend_from_slice(page);
        Ok(place)
    }

    pub fn finish(mut self, mut manifest: Manifest, trees: Vec<IndexTree>) -> World {
        self.packs.resize(Zone::COUNT, Vec::new());
        let mut indexes = vec![Vec::new(); Zone::COUNT];
        for tree in &trees {
            let pack = &mut self.packs[tree.zone().index()];
            if pack.is_empty() {
                *pack = pack::header(tree.zone());
            }
            indexes[tree.zone().index()] = index::write(tree);
        }
        let index_bytes = indexes.iter().map(|index| index.len() as u64).sum();
        let pack_bytes = self.packs.iter().map(|pack| pack.len() as u64).sum();
        describe(&mut manifest, &trees, index_bytes, pack_bytes);
        World::from_memory(manifest, trees, MemoryPacks { packs: self.packs, indexes })
    }
}
