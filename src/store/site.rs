//! Where a world lies: a folder, or an address.

use super::error::StoreError;
use super::manifest::Manifest;
use super::pack::{LocalPacks, PageSource};
use super::remote::{Address, Remote, RemoteManifest};
use super::world::{MANIFEST_FILE, OpenOptions};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::{fs, io};

pub(super) enum Site {
    Folder(PathBuf),
    Server(Arc<Remote>),
}

/// A manifest as it was read, and where.
pub(super) enum Told {
    Folder(PathBuf, Vec<u8>),
    Server(Arc<Remote>, RemoteManifest),
}

impl Site {
    pub fn of(world: &Path, options: &OpenOptions) -> Result<Self, StoreError> {
        match Address::of(world) {
            None => Ok(Self::Folder(world.to_owned())),
            Some(address) => Ok(Self::Server(Arc::new(Remote::new(address?, options.cache.clone())?))),
        }
    }

    pub fn name(&self) -> PathBuf {
        match self {
            Self::Folder(folder) => folder.clone(),
            Self::Server(remote) => remote.address().shown().into(),
        }
    }

    pub fn manifest_file(&self) -> PathBuf {
        match self {
            Self::Folder(folder) => folder.join(MANIFEST_FILE),
            Self::Server(remote) => remote.address().file(MANIFEST_FILE),
        }
    }

    pub fn read_manifest(&self) -> Result<Told, StoreError> {
        match self {
            Self::Server(remote) => Ok(Told::Server(remote.clone(), remote.read_manifest()?)),
            Self::Folder(folder) => {
                let file = self.manifest_file();
                let text = fs::read(&file).map_err(|error| match error.kind() {
                    io::ErrorKind::NotFound | io::ErrorKind::NotADirectory => StoreError::NotAWorld(folder.clone()),
                    _ => StoreError::io(&file, error),
                })?;
                Ok(Told::Folder(folder.clone(), text))
            }
        }
    }
}

impl Told {
    pub fn text(&self) -> &[u8] {
        match self {
            Self::Folder(_, text) => text,
            Self::Server(_, manifest) => &manifest.bytes,
        }
    }

    /// The files that it names, parsed.
    pub fn source(self, manifest: &Manifest) -> Box<dyn PageSource> {
        match self {
            Self::Folder(folder, _) => Box::new(LocalPacks::new(&folder, &manifest.additions)),
            Self::Server(remote, told) => Box::new(remote.files(told, &manifest.additions)),
        }
    }
}
