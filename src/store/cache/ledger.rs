//! How many bytes a cache's folder holds, told to all processes that share it.
//!
//! The number stands in a file that a process locks while it adds or removes entries. It is raised before a file is
//! written and lowered after one was removed, so that it is never too low; who opens the folder counts anew.

use std::fs::{File, TryLockError};
use std::io::{self, Read, Seek, Write};
use std::path::Path;
use std::time::Duration;

pub(super) const FILE: &str = "lock.stoop-cache";
/// A process that is stopped may hold the lock for ever: then nothing is kept, and reading goes on.
const TRIES: u32 = 20;
const WAIT: Duration = Duration::from_millis(5);

/// Locked while it lives.
pub(super) struct Ledger {
    file: File,
}

impl Ledger {
    /// `None` where another process does not let go of it.
    pub fn lock(folder: &Path) -> io::Result<Option<Self>> {
        let file = File::options().read(true).write(true).create(true).truncate(false).open(folder.join(FILE))?;
        for _ in 0..TRIES {
            match file.try_lock() {
                Ok(()) => return Ok(Some(Self { file })),
                // A timer is a channel that gives one message.
                Err(TryLockError::WouldBlock) => drop(crossbeam_channel::after(WAIT).recv()),
                Err(TryLockError::Error(error)) => return Err(error),
            }
        }
        Ok(None)
    }

    /// `None` where it was never written, or not whole.
    pub fn total_bytes(&mut self) -> Option<u64> {
        let mut text = String::new();
        self.file.rewind().ok()?;
        self.file.read_to_string(&mut text).ok()?;
        text.strip_suffix('\n')?.parse().ok()
    }

    pub fn set_total_bytes(&mut self, total_bytes: u64) -> io::Result<()> {
        self.file.set_len(0)?;
        self.file.rewind()?;
        self.file.write_all(format!("{total_bytes}\n").as_bytes())
    }
}
