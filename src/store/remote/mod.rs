//! Worlds behind an address: each read is one range request, of one version of its file.
//!
//! The version of a file (its ETag, else the time of its last change; and its length) is that of its first read. Later
//! requests ask for it by If-Match, and every answer is compared with it before anything is done with its bytes: a file that
//! was changed gives [`StoreError::Changed`], never bytes of two versions. Nothing is ever listed: the manifest names
//! zones and files.

mod address;
mod client;
mod fault;
mod file;
mod packs;
mod pin;
mod shelf;

pub use address::{Address, SCHEMES};
pub use client::REQUEST_LIMIT;

use super::additions::Additions;
use super::cache::DiskCache;
use super::{MANIFEST_FILE, StoreError};
use client::{Answer, Client, Request};
pub(super) use packs::RemotePacks;
use pin::Pin;
use shelf::Shelf;
use std::sync::Arc;

/// A world on a server, of which its manifest is read.
pub(super) struct Remote {
    client: Arc<Client>,
    cache: Option<Arc<DiskCache>>,
}

/// A manifest, and where it comes from.
pub(super) struct RemoteManifest {
    pub bytes: Vec<u8>,
    /// Of the server; else the server does not answer, for this reason, and it comes from the cache.
    origin: Result<Pin, StoreError>,
}

impl Remote {
    pub fn new(address: Address, cache: Option<Arc<DiskCache>>) -> Result<Self, StoreError> {
        Ok(Self { client: Arc::new(Client::new(address)?), cache })
    }

    pub fn address(&self) -> &Address {
        self.client.address()
    }

    pub fn read_manifest(&self) -> Result<RemoteManifest, StoreError> {
        let address = self.address().shown();
        match self.client.get(Request { name: MANIFEST_FILE.to_owned(), range: None, pin: None }) {
            Ok(Answer { bytes, pin }) => Ok(RemoteManifest { bytes, origin: Ok(pin) }),
            Err(StoreError::Missing { .. }) => Err(StoreError::NoWorldThere(address.into())),
            Err(error) if error.is_transient() => {
                match self.cache.as_deref().and_then(|cache| shelf::manifest(cache, &self.client.full_address())) {
                    Some(bytes) => Ok(RemoteManifest { bytes, origin: Err(error) }),
                    None => Err(error),
                }
            }
            Err(error) => Err(error),
        }
    }

    /// The files that a manifest names.
    pub fn files(&self, manifest: RemoteManifest, additions: &Additions) -> RemotePacks {
        let shelf = self.cache.clone().map(|cache| Shelf::new(cache, &self.client.full_address(), &manifest.bytes));
        if let (Some(shelf), Ok(_)) = (&shelf, &manifest.origin) {
            shelf.keep_manifest(&manifest.bytes);
        }
        RemotePacks::new(self.client.clone(), shelf, manifest.origin, additions)
    }
}
