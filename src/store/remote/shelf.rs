//! A world's part of a cache.
//!
//! The manifest is kept by its address. Versions of files are kept by address and manifest, so that they belong
//! together; bytes by address, file and version.

use super::pin::Pin;
use crate::forest::index::Place;
use crate::store::cache::{DiskCache, EntryName, Kind};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use xxhash_rust::xxh3::xxh3_128;

/// By name of the file.
type Pins = BTreeMap<String, Pin>;

pub(super) struct Shelf {
    cache: Arc<DiskCache>,
    /// Of the world.
    address: String,
    /// Where the versions are kept.
    pins_at: EntryName,
    pins: Mutex<Pins>,
}

/// Parts of a key are told apart by a sign that none of them has.
fn key(parts: &[&str]) -> u128 {
    xxh3_128(parts.join("\n").as_bytes())
}

fn manifest_at(address: &str) -> EntryName {
    EntryName::whole(Kind::Manifest, key(&["manifest", address]))
}

/// The manifest of a world as it was when it was last opened over the network.
pub(super) fn manifest(cache: &DiskCache, address: &str) -> Option<Vec<u8>> {
    cache.load(&manifest_at(address))
}

impl Shelf {
    pub fn new(cache: Arc<DiskCache>, address: &str, manifest: &[u8]) -> Self {
        let of_manifest = format!("{:032x}", xxh3_128(manifest));
        let pins_at = EntryName::whole(Kind::Pins, key(&["pins", address, &of_manifest]));
        let pins = read_pins(&cache, &pins_at);
        Self { cache, address: address.to_owned(), pins_at, pins: Mutex::new(pins) }
    }

    pub fn folder(&self) -> PathBuf {
        Path::to_owned(self.cache.folder())
    }

    pub fn keep_manifest(&self, manifest: &[u8]) {
        let at = manifest_at(&self.address);
        if self.cache.load(&at).as_deref() != Some(manifest) {
            self.cache.keep(&at, manifest);
        }
    }

    /// The version that a file was read at before.
    pub fn pin(&self, name: &str) -> Option<Pin> {
        self.lock().get(name).cloned()
    }

    pub fn keep_pin(&self, name: &str, pin: &Pin) {
        let mut pins = self.lock();
        if pins.insert(name.to_owned(), pin.clone()).as_ref() == Some(pin) {
            return;
        }
        // Another process may have read other files meanwhile.
        for (name, pin) in read_pins(&self.cache, &self.pins_at) {
            pins.entry(name).or_insert(pin);
        }
        if let Ok(text) = serde_json::to_vec(&*pins) {
            self.cache.keep(&self.pins_at, &text);
        }
    }

    /// What is kept is of no version that the server still has: whoever opens the world again must not begin with it.
    pub fn forget_pins(&self) {
        self.lock().clear();
        self.cache.forget(&self.pins_at);
    }

    /// The bytes of several places in a version of a file, each where all of them are kept. Calls `found` with the number
    /// of the place.
    pub fn load(&self, name: &str, pin: &Pin, places: &[Place], mut found: impl FnMut(usize, &[u8])) {
        let file = self.file(name, pin);
        let mut open: Option<(EntryName, Vec<u8>)> = None;
        for (number, place) in places.iter().enumerate() {
            if !open.as_ref().is_some_and(|(entry, _)| entry.covers(place.offset, place.len)) {
                let entry = self.cache.find(file, place.offset, place.len);
                open = entry.and_then(|entry| Some((entry, self.cache.load(&entry)?)));
            }
            let bytes = open.as_ref().and_then(|(entry, bytes)| {
                let start = usize::try_from(place.offset.checked_sub(entry.offset)?).ok()?;
                bytes.get(start..start.checked_add(place.len as usize)?)
            });
            if let Some(bytes) = bytes {
                found(number, bytes);
            }
        }
    }

    pub fn keep(&self, kind: Kind, name: &str, pin: &Pin, offset: u64, bytes: &[u8]) {
        if let Ok(len @ 1..) = u32::try_from(bytes.len()) {
            self.cache.keep(&EntryName { kind, file: self.file(name, pin), offset, len }, bytes);
        }
    }

    fn file(&self, name: &str, pin: &Pin) -> u128 {
        key(&["file", &self.address, name, &pin.text()])
    }

    fn lock(&self) -> MutexGuard<'_, Pins> {
        // Single entries come and go; what a thread that failed left is true.
        self.pins.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn read_pins(cache: &DiskCache, at: &EntryName) -> Pins {
    cache.load(at).and_then(|text| serde_json::from_slice(&text).ok()).unwrap_or_default()
}
