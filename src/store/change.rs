//! Changes to a world that stands: all new bytes go into new files, and the manifest that names them comes last.

use super::additions::{self, PackFile, ZoneFiles, index_path, pack_path};
use super::error::StoreError;
use super::index;
use super::manifest::{CollectionInfo, Manifest, SourceInfo};
use super::remote::Address;
use super::world::{MANIFEST_FILE, World};
use super::writer::{PackWriter, write_file};
use crate::forest::Zone;
use crate::forest::index::{IndexForest, IndexTree, Place};
use std::collections::BTreeMap;
use std::fs::{self, File, TryLockError};
use std::path::{Path, PathBuf};

/// Locked by the one change that is under way. The lock goes with its process, whatever becomes of it; the file stays,
/// since who removed it could take it from under another's lock.
const LOCK_FILE: &str = "into.lock";
/// The manifest before it gets its name.
const NEW_MANIFEST_FILE: &str = "world.json.new";

/// A change to a world. Until [`WorldChange::finish`] renames the manifest into place the world is the old one, for
/// readers that have it open and for those that open it; then it is the new one. What is dropped or killed before
/// leaves files that nothing names, which the next change removes. The old index files stay until then too, for
/// readers that opened the old manifest.
pub struct WorldChange {
    dir: PathBuf,
    world: World,
    index: IndexForest,
    generation: u32,
    packs: BTreeMap<Zone, PackWriter>,
    /// Checksums and lengths of the index files written.
    indexes: BTreeMap<Zone, (String, u64)>,
    made: Vec<PathBuf>,
    /// Held, and let go with the rest.
    _lock: File,
    finished: bool,
}

/// What becomes of one collection.
#[derive(Clone, Debug, PartialEq)]
pub struct CollectionChange {
    /// Its number in the manifest; the count of those there are for a new one.
    pub number: u8,
    pub info: CollectionInfo,
    pub source: SourceInfo,
}

impl WorldChange {
    /// Takes the world for this change alone, and removes what earlier ones left that were broken off.
    pub fn begin(dir: &Path) -> Result<Self, StoreError> {
        if Address::of(dir).is_some() {
            return Err(StoreError::ReadOnly(dir.to_owned()));
        }
        if !dir.join(MANIFEST_FILE).exists() {
            return Err(StoreError::NotAWorld(dir.to_owned()));
        }
        let dir = fs::canonicalize(dir).map_err(|error| StoreError::io(dir, error))?;
        let lock = lock(&dir)?;
        let world = World::open_whole(&dir)?;
        clear(&dir, world.manifest())?;
        let index = world.index().clone();
        let told = world.manifest().additions.generation;
        let generation = told.checked_add(1).ok_or_else(|| StoreError::Manifest {
            file: dir.join(MANIFEST_FILE),
            cause: "it was changed too often".to_owned(),
        })?;
        Ok(Self {
            dir,
            world,
            index,
            generation,
            packs: BTreeMap::new(),
            indexes: BTreeMap::new(),
            made: Vec::new(),
            _lock: lock,
            finished: false,
        })
    }

    /// The world as it was, its index whole.
    pub fn world(&self) -> &World {
        &self.world
    }

    /// Puts an encoded page behind all others of a zone.
    pub fn append(&mut self, zone: Zone, page: &[u8]) -> Result<Place, StoreError> {
        if !self.packs.contains_key(&zone) {
            let start = self.old_packs(zone)?.iter().map(|pack| pack.bytes).sum();
            let path = pack_path(&self.dir, zone, self.generation);
            self.made.push(path.clone());
            self.packs.insert(zone, PackWriter::create(path, zone, start)?);
        }
        match self.packs.get_mut(&zone) {
            Some(pack) => pack.append(page),
            None => Err(StoreError::NotAWorld(self.dir.clone())),
        }
    }

    /// Brings a zone's new pages to the disk, and writes its new index.
    pub fn put_index(&mut self, tree: IndexTree) -> Result<(), StoreError> {
        let zone = tree.zone();
        if let Some(pack) = self.packs.get_mut(&zone) {
            pack.sync()?;
        }
        let path = index_path(&self.dir, zone, self.generation);
        let file = index::write(&tree);
        let checksum = index::checksum(&file).unwrap_or_default();
        self.made.push(path.clone());
        write_file(&path, &file)?;
        self.indexes.insert(zone, (checksum, file.len() as u64));
        self.index.insert(tree);
        Ok(())
    }

    /// Names the new files. `unused_bytes`: of the pages that the new index has no more. Of the manifest all else that
    /// the change touches is set here.
    pub fn finish(
        mut self,
        mut manifest: Manifest,
        collections: Vec<CollectionChange>,
        unused_bytes: u64,
    ) -> Result<Manifest, StoreError> {
        self.packs.values_mut().try_for_each(PackWriter::sync)?;
        manifest.version = Manifest::CHANGED_VERSION;
        for change in collections {
            put_collection(&mut manifest, change);
        }
        self.put_files(&mut manifest)?;
        manifest.additions.unused_bytes += unused_bytes;
        for folder in ["packs", "index"] {
            sync_folder(&self.dir.join(folder));
        }
        let new = self.dir.join(NEW_MANIFEST_FILE);
        self.made.push(new.clone());
        write_file(&new, &manifest.to_bytes())?;
        let named = self.dir.join(MANIFEST_FILE);
        fs::rename(&new, &named).map_err(|error| StoreError::io(&named, error))?;
        self.finished = true;
        sync_folder(&self.dir);
        Ok(manifest)
    }

    fn put_files(&self, manifest: &mut Manifest) -> Result<(), StoreError> {
        let mut zones: BTreeMap<u8, ZoneFiles> =
            manifest.additions.zones.drain(..).map(|files| (files.zone, files)).collect();
        for (&zone, (checksum, len)) in &self.indexes {
            let mut packs = self.old_packs(zone)?;
            if let Some(pack) = self.packs.get(&zone) {
                packs.push(PackFile { generation: self.generation, bytes: pack.len() });
                manifest.pack_bytes += pack.len();
            }
            let number = zone.index() as u8;
            let old_len = if manifest.zones.contains(&number) { self.world.source().index_len(zone)? } else { 0 };
            manifest.index_bytes = (manifest.index_bytes + len).saturating_sub(old_len);
            zones.insert(
                number,
                ZoneFiles { zone: number, index: self.generation, index_checksum: checksum.clone(), packs },
            );
            if !manifest.zones.contains(&number) {
                manifest.zones.push(number);
                manifest.zones.sort_unstable();
            }
        }
        manifest.additions.zones = zones.into_values().collect();
        manifest.additions.generation = self.generation;
        Ok(())
    }

    /// The packs that a zone has without this change.
    fn old_packs(&self, zone: Zone) -> Result<Vec<PackFile>, StoreError> {
        let manifest = self.world.manifest();
        if let Some(files) = manifest.additions.of(zone) {
            return Ok(files.packs.clone());
        }
        if !manifest.zones.contains(&(zone.index() as u8)) {
            return Ok(Vec::new());
        }
        Ok(vec![PackFile { generation: 0, bytes: self.world.source().pack_len(zone)? }])
    }
}

impl Drop for WorldChange {
    fn drop(&mut self) {
        if !self.finished {
            self.packs.clear();
            // Nobody is left to tell, and what stays is removed by the next change.
            self.made.iter().for_each(|path| drop(fs::remove_file(path)));
        }
    }
}

/// A new collection goes behind the last, and its source behind all sources; a known one is replaced, and so is its
/// source: those of the collections are the last, in their order.
fn put_collection(manifest: &mut Manifest, change: CollectionChange) {
    let number = usize::from(change.number);
    let first = manifest.sources.len().saturating_sub(manifest.collections.len());
    match (manifest.collections.get_mut(number), manifest.sources.get_mut(first + number)) {
        (Some(info), Some(source)) => (*info, *source) = (change.info, change.source),
        (Some(info), None) => *info = change.info,
        (None, _) => {
            manifest.collections.push(change.info);
            manifest.sources.push(change.source);
        }
    }
}

fn lock(dir: &Path) -> Result<File, StoreError> {
    let path = dir.join(LOCK_FILE);
    let io = |error| StoreError::io(&path, error);
    let file = File::options().create(true).truncate(false).write(true).open(&path).map_err(io)?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(TryLockError::WouldBlock) => Err(StoreError::Busy(dir.to_owned())),
        Err(TryLockError::Error(error)) => Err(io(error)),
    }
}

/// Removes files that bear the names of packs and index files and that the manifest does not name.
fn clear(dir: &Path, manifest: &Manifest) -> Result<(), StoreError> {
    let mut named = Vec::new();
    for zone in Zone::all() {
        match manifest.additions.of(zone) {
            None => named.extend([pack_path(dir, zone, 0), index_path(dir, zone, 0)]),
            Some(files) => {
                named.push(index_path(dir, zone, files.index));
                named.extend(files.packs.iter().map(|pack| pack_path(dir, zone, pack.generation)));
            }
        }
    }
    for folder in ["packs", "index"] {
        let folder = dir.join(folder);
        let io = |error| StoreError::io(&folder, error);
        for entry in fs::read_dir(&folder).map_err(io)? {
            let path = entry.map_err(io)?.path();
            let is_ours = path.file_name().and_then(|name| name.to_str()).is_some_and(additions::is_ours);
            if is_ours && !named.contains(&path) {
                fs::remove_file(&path).map_err(|error| StoreError::io(&path, error))?;
            }
        }
    }
    Ok(())
}

/// Names reach the disk with their folder. Where folders cannot be opened as files, the system sees to it.
fn sync_folder(folder: &Path) {
    if let Ok(folder) = File::open(folder) {
        drop(folder.sync_all());
    }
}
