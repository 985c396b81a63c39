//! Files of entries, little-endian:
//!
//! | bytes | |
//! |---|---|
//! | 0–3, 4–7 | magic `STCE`, version 1 |
//! | 8–15 | xxh3 of the file's name and of what follows |
//! | then | the bytes that are kept |

use super::name::EntryName;
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::Path;
use xxhash_rust::xxh3::Xxh3;

const MAGIC: [u8; 4] = *b"STCE";
const VERSION: u32 = 1;
const HEADER_BYTES: usize = 16;
/// What a file takes on a disk is a multiple of this, bytes.
pub(super) const BLOCK_BYTES: u64 = 4096;

/// What a file of an entry's bytes takes on a disk, bytes.
pub(super) fn cost_bytes(kept_bytes: usize) -> u64 {
    disk_bytes((HEADER_BYTES + kept_bytes) as u64)
}

/// What a file takes on a disk, bytes.
pub(super) fn disk_bytes(file_bytes: u64) -> u64 {
    file_bytes.next_multiple_of(BLOCK_BYTES)
}

fn checksum(name: &EntryName, bytes: &[u8]) -> u64 {
    let mut hash = Xxh3::new();
    hash.update(name.to_string().as_bytes());
    hash.update(bytes);
    hash.digest()
}

pub(super) fn write(path: &Path, name: &EntryName, bytes: &[u8]) -> io::Result<()> {
    let mut file = File::create(path)?;
    file.write_all(&MAGIC)?;
    file.write_all(&VERSION.to_le_bytes())?;
    file.write_all(&checksum(name, bytes).to_le_bytes())?;
    file.write_all(bytes)
}

/// `None` for what is not that entry, or not whole.
pub(super) fn read(path: &Path, name: &EntryName) -> io::Result<Option<Vec<u8>>> {
    let mut file = fs::read(path)?;
    if file.len() < HEADER_BYTES {
        return Ok(None);
    }
    let bytes = file.split_off(HEADER_BYTES);
    let is_ours = file[..4] == MAGIC && file[4..8] == VERSION.to_le_bytes();
    let has_len = name.len == 0 || bytes.len() == name.len as usize;
    let is_whole = file[8..] == checksum(name, &bytes).to_le_bytes();
    Ok((is_ours && has_len && is_whole).then_some(bytes))
}
