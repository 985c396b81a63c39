//! One file on a server, read at one version.

use super::client::{Answer, Client, Request};
use super::fault;
use super::pin::Pin;
use super::shelf::Shelf;
use crate::forest::index::Place;
use crate::store::StoreError;
use crate::store::cache::Kind;
use std::ops::Range;
use std::path::PathBuf;
use std::sync::OnceLock;

pub(super) struct RemoteFile {
    /// As in `packs/07.pack`.
    pub name: String,
    /// Where its bytes begin in its zone's row of them.
    pub start: u64,
    /// Its length, where the manifest tells.
    told_len: Option<u64>,
    /// Of the first read.
    pin: OnceLock<Pin>,
}

/// Whom a file is asked of.
#[derive(Clone, Copy)]
pub(super) struct Server<'a> {
    pub client: &'a Client,
    pub shelf: Option<&'a Shelf>,
}

impl RemoteFile {
    pub fn new(name: String, start: u64, told_len: Option<u64>) -> Self {
        Self { name, start, told_len, pin: OnceLock::new() }
    }

    /// With its address.
    pub fn path(&self, server: Server<'_>) -> PathBuf {
        server.client.address().file(&self.name)
    }

    /// The version that is read, as far as it is known by now.
    pub fn pin(&self, server: Server<'_>) -> Option<&Pin> {
        if let Some(pin) = self.pin.get() {
            return Some(pin);
        }
        let kept = server.shelf?.pin(&self.name)?;
        Some(self.pin.get_or_init(|| kept))
    }

    /// What the cache has of some places; calls `found` with the number of the place.
    pub fn load(&self, server: Server<'_>, places: &[Place], found: impl FnMut(usize, &[u8])) {
        if let (Some(shelf), Some(pin)) = (server.shelf, self.pin(server)) {
            shelf.load(&self.name, pin, places, found);
        }
    }

    /// One request for a range, which is kept.
    pub fn fetch(&self, server: Server<'_>, kind: Kind, range: Range<u64>) -> Result<Vec<u8>, StoreError> {
        let answer = server.client.get(self.request(server, range.clone()));
        self.take_all(server, kind, range, answer)
    }

    /// Takes the answer to a request for a range, none of which may be missing.
    pub fn take_all(
        &self,
        server: Server<'_>,
        kind: Kind,
        range: Range<u64>,
        answer: Result<Answer, StoreError>,
    ) -> Result<Vec<u8>, StoreError> {
        let bytes = self.take(server, kind, range.start, answer)?;
        let is_whole = bytes.len() as u64 == range.end - range.start;
        if is_whole { Ok(bytes) } else { Err(fault::short(&self.path(server))) }
    }

    pub fn request(&self, server: Server<'_>, range: Range<u64>) -> Request {
        Request { name: self.name.clone(), range: Some(range), pin: self.pin(server).cloned() }
    }

    /// Pins the version at the first answer, and keeps its bytes; they may be fewer than asked for where the file ends.
    pub fn take(
        &self,
        server: Server<'_>,
        kind: Kind,
        offset: u64,
        answer: Result<Answer, StoreError>,
    ) -> Result<Vec<u8>, StoreError> {
        let Answer { bytes, pin } = answer.inspect_err(|error| {
            if let (StoreError::Changed { .. }, Some(shelf)) = (error, server.shelf) {
                shelf.forget_pins();
            }
        })?;
        if self.told_len.is_some_and(|told| told != pin.len) {
            let cause = format!("it has {} bytes, the manifest tells {}", pin.len, self.told_len.unwrap_or_default());
            return Err(StoreError::Pack { file: self.path(server), cause });
        }
        // Several threads may come first; they must have read the same.
        if *self.pin.get_or_init(|| pin.clone()) != pin {
            return Err(StoreError::Changed { file: self.path(server) });
        }
        if let Some(shelf) = server.shelf {
            shelf.keep_pin(&self.name, &pin);
            shelf.keep(kind, &self.name, &pin, offset, &bytes);
        }
        Ok(bytes)
    }

    /// Length of the file; a request where none was made yet.
    pub fn len(&self, server: Server<'_>) -> Result<u64, StoreError> {
        if let Some(len) = self.told_len.or_else(|| Some(self.pin(server)?.len)) {
            return Ok(len);
        }
        // Every file has a first byte, and some servers answer nothing but GET.
        let answer = server.client.get(self.request(server, 0..1));
        self.take(server, Kind::Index, 0, answer)?;
        Ok(self.pin.get().map_or(0, |pin| pin.len))
    }
}
