//! A folder that keeps what was read over a network: so that it need not be read again, and can be read while the
//! server does not answer.
//!
//! Entries are files of their own, named by what they hold, checksummed, written under another name and renamed; a bad
//! one is removed and read anew. All entries together take no more than a limit on the disk, whichever processes share
//! the folder; the least recently used ones go first. A cache that cannot be written is one that keeps nothing: no error
//! of it ends a flight.

mod entry;
mod known;
mod ledger;
mod name;

use super::StoreError;
use crate::units::ByteSize;
use known::Known;
use ledger::Ledger;
pub(super) use name::{EntryName, Kind};
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant, SystemTime};

/// How much a cache takes on the disk where nothing else is asked for.
pub const CACHE_LIMIT: ByteSize = ByteSize(1 << 30);
/// Least limit: below it hardly a view could be kept.
pub const CACHE_LIMIT_MIN: ByteSize = ByteSize(1 << 20);
/// Longest entry, bytes: more than any page.
const ENTRY_BYTES_MAX: usize = 24 << 20;
/// The time of a file's last use is written no more often.
const TOUCH_EVERY: Duration = Duration::from_secs(60);
/// After another process did not let go of the folder, nothing is kept for so long.
const PAUSE: Duration = Duration::from_secs(10);
const PARTIAL: &str = ".partial";

/// A cache on disk. Thread-safe; several processes may share its folder.
pub struct DiskCache {
    folder: PathBuf,
    limit_bytes: u64,
    known: Mutex<Known>,
    /// Held by the one thread that changes the folder; until when none tries to.
    writing: Mutex<Option<Instant>>,
}

impl DiskCache {
    /// Makes the folder where there is none, counts what is in it, removes what was left unfinished, and drops entries
    /// beyond the limit. Files of others in it are left alone.
    pub fn open(folder: &Path, limit: ByteSize) -> Result<Self, StoreError> {
        let fail = |error: io::Error| StoreError::Cache { folder: folder.to_owned(), cause: error.to_string() };
        if limit < CACHE_LIMIT_MIN {
            let cause = format!("a limit of {limit} is too low: at least {CACHE_LIMIT_MIN} are needed");
            return Err(StoreError::Cache { folder: folder.to_owned(), cause });
        }
        fs::create_dir_all(folder).map_err(fail)?;
        let cache = Self {
            folder: folder.to_owned(),
            limit_bytes: limit.0,
            known: Mutex::default(),
            writing: Mutex::default(),
        };
        // While another process writes, what it has written is counted by it.
        match Ledger::lock(folder).map_err(fail)? {
            Some(mut ledger) => {
                let mut known = cache.lock();
                let total_bytes = cache.scan(&mut known, Left::Remove).map_err(fail)?;
                let total_bytes = cache.make_room(&mut known, total_bytes, 0);
                ledger.set_total_bytes(total_bytes).map_err(fail)?;
            }
            None => drop(cache.scan(&mut cache.lock(), Left::Keep).map_err(fail)?),
        }
        Ok(cache)
    }

    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// An entry that holds all of a range of a file.
    pub(super) fn find(&self, file: u128, offset: u64, len: u32) -> Option<EntryName> {
        self.lock().covering(file, offset, len)
    }

    /// The bytes of an entry; `None` where there is none, or a bad one.
    pub(super) fn load(&self, name: &EntryName) -> Option<Vec<u8>> {
        let path = self.path(name);
        match entry::read(&path, name) {
            Ok(Some(bytes)) => {
                self.lock().touch(name);
                touch(&path);
                Some(bytes)
            }
            Ok(None) => {
                self.forget(name);
                None
            }
            Err(_) => {
                // Another process dropped it, and counted that.
                self.lock().remove(name);
                None
            }
        }
    }

    /// Keeps bytes as long as there is room for them.
    pub(super) fn keep(&self, name: &EntryName, bytes: &[u8]) {
        if bytes.len() > ENTRY_BYTES_MAX || (self.lock().contains(name) && !name.kind.is_replaced()) {
            return;
        }
        // What cannot be kept is read again when it is needed.
        self.change(|ledger| drop(self.keep_locked(ledger, name, bytes)));
    }

    /// Drops an entry.
    pub(super) fn forget(&self, name: &EntryName) {
        self.lock().remove(name);
        self.change(|ledger| {
            let total_bytes = ledger.total_bytes();
            let removed_bytes = self.remove_file(name);
            if let Some(total_bytes) = total_bytes {
                // Too high a number is put right by whoever counts next.
                drop(ledger.set_total_bytes(total_bytes.saturating_sub(removed_bytes)));
            }
        });
    }

    /// Changes the folder, one thread of one process at a time; leaves it where another process holds it.
    fn change(&self, change: impl FnOnce(&mut Ledger)) {
        let mut paused = self.writing.lock().unwrap_or_else(PoisonError::into_inner);
        if paused.is_some_and(|until| Instant::now() < until) {
            return;
        }
        match Ledger::lock(&self.folder) {
            Ok(Some(mut ledger)) => {
                *paused = None;
                change(&mut ledger);
            }
            Ok(None) | Err(_) => *paused = Some(Instant::now() + PAUSE),
        }
    }

    fn keep_locked(&self, ledger: &mut Ledger, name: &EntryName, bytes: &[u8]) -> io::Result<()> {
        let (path, cost_bytes) = (self.path(name), entry::cost_bytes(bytes.len()));
        let mut known = self.lock();
        if path.exists() && !name.kind.is_replaced() {
            // Another process was faster.
            known.add(*name, cost_bytes);
            return Ok(());
        }
        let total_bytes = match ledger.total_bytes() {
            Some(total_bytes) => total_bytes,
            None => self.scan(&mut known, Left::Remove)?,
        };
        let mut total_bytes = self.make_room(&mut known, total_bytes, cost_bytes);
        if total_bytes + cost_bytes > self.limit_bytes {
            // What others put here is not known yet.
            let counted_bytes = self.scan(&mut known, Left::Remove)?;
            total_bytes = self.make_room(&mut known, counted_bytes, cost_bytes);
        }
        if total_bytes + cost_bytes > self.limit_bytes {
            return ledger.set_total_bytes(total_bytes);
        }
        ledger.set_total_bytes(total_bytes + cost_bytes)?;
        let replaced_bytes = known.remove(name).unwrap_or_default();
        match self.write(&path, name, bytes) {
            Ok(()) => {
                known.add(*name, cost_bytes);
                ledger.set_total_bytes((total_bytes + cost_bytes).saturating_sub(replaced_bytes))
            }
            Err(_) => ledger.set_total_bytes(total_bytes),
        }
    }

    fn write(&self, path: &Path, name: &EntryName, bytes: &[u8]) -> io::Result<()> {
        let partial = self.folder.join(format!("{name}{PARTIAL}"));
        let written = entry::write(&partial, name, bytes).and_then(|()| fs::rename(&partial, path));
        if written.is_err() {
            drop(fs::remove_file(&partial));
        }
        written
    }

    /// Drops entries until so many more bytes fit; gives what is left of `total_bytes`.
    fn make_room(&self, known: &mut Known, mut total_bytes: u64, more_bytes: u64) -> u64 {
        while total_bytes + more_bytes > self.limit_bytes
            && let Some(name) = known.next_to_go(self.limit_bytes)
        {
            known.remove(&name);
            total_bytes = total_bytes.saturating_sub(self.remove_file(&name));
        }
        total_bytes
    }

    /// What was on the disk there: nothing where another process was faster.
    fn remove_file(&self, name: &EntryName) -> u64 {
        let path = self.path(name);
        let len = fs::metadata(&path).map_or(0, |meta| meta.len());
        if fs::remove_file(&path).is_ok() { entry::disk_bytes(len) } else { 0 }
    }

    /// Learns the entries in the folder, those used last as the newest; gives the bytes that they take.
    fn scan(&self, known: &mut Known, left: Left) -> io::Result<u64> {
        let mut found: Vec<(SystemTime, EntryName, u64)> = Vec::new();
        // The file of the ledger.
        let mut total_bytes = entry::BLOCK_BYTES;
        for file in fs::read_dir(&self.folder)? {
            let file = file?;
            let text = file.file_name();
            let Some(text) = text.to_str() else { continue };
            if let Some(name) = EntryName::parse(text) {
                let Ok(meta) = file.metadata() else { continue };
                let bytes = entry::disk_bytes(meta.len());
                found.push((meta.modified().unwrap_or(SystemTime::UNIX_EPOCH), name, bytes));
                total_bytes += bytes;
            } else if left == Left::Remove
                && text.strip_suffix(PARTIAL).is_some_and(|text| EntryName::parse(text).is_some())
            {
                fs::remove_file(file.path())?;
            }
        }
        found.sort_unstable();
        *known = Known::default();
        found.into_iter().for_each(|(_, name, bytes)| known.add(name, bytes));
        debug_assert_eq!(known.bytes() + entry::BLOCK_BYTES, total_bytes);
        Ok(total_bytes)
    }

    fn path(&self, name: &EntryName) -> PathBuf {
        self.folder.join(name.to_string())
    }

    /// What a thread that failed left is true of the disk, or is found out to be missing there.
    fn lock(&self) -> MutexGuard<'_, Known> {
        self.known.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// What becomes of files that were left unfinished: whoever holds the ledger knows that nobody writes them.
#[derive(Clone, Copy, PartialEq)]
enum Left {
    Remove,
    Keep,
}

/// Tells later processes that a file was used; where that fails it goes sooner.
fn touch(path: &Path) {
    let now = SystemTime::now();
    let is_old = |meta: fs::Metadata| {
        meta.modified().is_ok_and(|used| now.duration_since(used).is_ok_and(|ago| ago > TOUCH_EVERY))
    };
    if fs::metadata(path).is_ok_and(is_old) {
        drop(File::options().append(true).open(path).and_then(|file| file.set_modified(now)));
    }
}

#[cfg(test)]
mod tests;
