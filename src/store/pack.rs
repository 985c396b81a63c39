//! Pack files: a header of 32 bytes (magic `STPK`, version, zone, zeros, xxh3 of bytes 0–23), then pages end to end.

use super::bytes::{Reader, Writer};
use super::error::{PageFault, StoreError};
use super::map;
use crate::forest::Zone;
use crate::forest::index::{Place, SharedBytes, aligned};
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use xxhash_rust::xxh3::xxh3_64;

const MAGIC: [u8; 4] = *b"STPK";
const VERSION: u32 = 1;
pub(super) const HEADER_BYTES: usize = 32;

pub(super) fn header(zone: Zone) -> Vec<u8> {
    let mut header = Writer::default();
    header.bytes(&MAGIC);
    header.u32(VERSION);
    header.u32(zone.index() as u32);
    header.bytes(&[0; 12]);
    header.u64(xxh3_64(&header.0));
    header.0
}

fn check_header(zone: Zone, file: &Path, bytes: &[u8]) -> Result<(), StoreError> {
    let version = || -> Result<u32, PageFault> {
        let mut reader = Reader::new(bytes);
        let magic = reader.take(4)?;
        if magic == MAGIC { reader.u32() } else { Err(PageFault::Magic) }
    };
    match version() {
        Ok(found) if found > VERSION => {
            Err(StoreError::FutureVersion { file: file.to_owned(), found, supported: VERSION })
        }
        _ if bytes == header(zone) => Ok(()),
        _ => {
            Err(StoreError::Pack { file: file.to_owned(), cause: "it does not begin like the pack of its zone".into() })
        }
    }
}

/// Where pages and the index are read from. One call is one read; calls may come from any thread.
pub trait PageSource: Send + Sync {
    /// The bytes of a place in a zone's pack, no fewer and no more.
    fn read(&self, zone: Zone, place: Place) -> Result<Vec<u8>, StoreError>;

    /// Length of a zone's pack, its header included.
    fn pack_len(&self, zone: Zone) -> Result<u64, StoreError>;

    /// The name of a zone's pack, for messages.
    fn pack_name(&self, zone: Zone) -> PathBuf;

    /// The bytes of a place in a zone's index file, no fewer and no more.
    fn read_index(&self, zone: Zone, place: Place) -> Result<Vec<u8>, StoreError>;

    /// All of a zone's index file, at a multiple of 8 in memory: mapped, where that is possible.
    fn whole_index(&self, zone: Zone) -> Result<SharedBytes, StoreError>;

    /// Length of a zone's index file.
    fn index_len(&self, zone: Zone) -> Result<u64, StoreError>;

    /// The name of a zone's index file, for messages.
    fn index_name(&self, zone: Zone) -> PathBuf;
}

pub(super) fn pack_path(dir: &Path, zone: Zone) -> PathBuf {
    dir.join("packs").join(format!("{:02}.pack", zone.index()))
}

pub(super) fn index_path(dir: &Path, zone: Zone) -> PathBuf {
    dir.join("index").join(format!("{:02}.idx", zone.index()))
}

/// The files of a directory; each is opened as its first page is read.
pub(super) struct LocalPacks {
    dir: PathBuf,
    packs: [OnceLock<File>; Zone::COUNT],
    indexes: [OnceLock<File>; Zone::COUNT],
}

impl LocalPacks {
    pub fn new(dir: &Path) -> Self {
        Self { dir: dir.to_owned(), packs: Default::default(), indexes: Default::default() }
    }

    fn pack(&self, zone: Zone) -> Result<&File, StoreError> {
        opened(&self.packs[zone.index()], &self.pack_name(zone), |path, file| {
            let mut head = [0; HEADER_BYTES];
            read_at(file, 0, &mut head).map_err(|error| cut_short(path, error))?;
            check_header(zone, path, &head)
        })
    }

    /// What it begins with is checked by who reads its table.
    fn index(&self, zone: Zone) -> Result<&File, StoreError> {
        opened(&self.indexes[zone.index()], &self.index_name(zone), |_, _| Ok(()))
    }
}

/// The file of a slot, opened and checked when it is first asked for.
fn opened<'a>(
    slot: &'a OnceLock<File>,
    path: &Path,
    check: impl FnOnce(&Path, &File) -> Result<(), StoreError>,
) -> Result<&'a File, StoreError> {
    if let Some(file) = slot.get() {
        return Ok(file);
    }
    let file = File::open(path).map_err(|error| StoreError::io(path, error))?;
    check(path, &file)?;
    // Another thread may have been faster; its file is as good.
    Ok(slot.get_or_init(|| file))
}

fn cut_short(path: &Path, error: io::Error) -> StoreError {
    if error.kind() == io::ErrorKind::UnexpectedEof {
        return StoreError::Pack { file: path.to_owned(), cause: "it ends before a page that the index names".into() };
    }
    StoreError::io(path, error)
}

fn index_cut_short(path: &Path, error: io::Error) -> StoreError {
    if error.kind() == io::ErrorKind::UnexpectedEof {
        return StoreError::Index { file: path.to_owned(), cause: "it ends too early".into() };
    }
    StoreError::io(path, error)
}

#[cfg(unix)]
fn read_at(file: &File, offset: u64, bytes: &mut [u8]) -> io::Result<()> {
    std::os::unix::fs::FileExt::read_exact_at(file, bytes, offset)
}

#[cfg(windows)]
fn read_at(file: &File, mut offset: u64, mut bytes: &mut [u8]) -> io::Result<()> {
    while !bytes.is_empty() {
        let count = std::os::windows::fs::FileExt::seek_read(file, bytes, offset)?;
        if count == 0 {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        bytes = &mut bytes[count..];
        offset += count as u64;
    }
    Ok(())
}

impl PageSource for LocalPacks {
    fn read(&self, zone: Zone, place: Place) -> Result<Vec<u8>, StoreError> {
        let file = self.pack(zone)?;
        let mut bytes = vec![0; place.len as usize];
        read_at(file, place.offset, &mut bytes).map_err(|error| cut_short(&self.pack_name(zone), error))?;
        Ok(bytes)
    }

    fn pack_len(&self, zone: Zone) -> Result<u64, StoreError> {
        let name = self.pack_name(zone);
        Ok(self.pack(zone)?.metadata().map_err(|error| StoreError::io(&name, error))?.len())
    }

    fn pack_name(&self, zone: Zone) -> PathBuf {
        pack_path(&self.dir, zone)
    }

    fn read_index(&self, zone: Zone, place: Place) -> Result<Vec<u8>, StoreError> {
        let file = self.index(zone)?;
        let mut bytes = vec![0; place.len as usize];
        read_at(file, place.offset, &mut bytes).map_err(|error| index_cut_short(&self.index_name(zone), error))?;
        Ok(bytes)
    }

    fn whole_index(&self, zone: Zone) -> Result<SharedBytes, StoreError> {
        map::map(&self.index_name(zone))
    }

    fn index_len(&self, zone: Zone) -> Result<u64, StoreError> {
        // Not by the file that parts are read from: whoever maps all of it needs no other.
        let path = self.index_name(zone);
        Ok(fs::metadata(&path).map_err(|error| StoreError::io(&path, error))?.len())
    }

    fn index_name(&self, zone: Zone) -> PathBuf {
        index_path(&self.dir, zone)
    }
}

/// Files in memory by zone, headers included.
pub(super) struct MemoryPacks {
    pub packs: Vec<Vec<u8>>,
    pub indexes: Vec<Vec<u8>>,
}

fn part(file: Option<&Vec<u8>>, place: Place) -> io::Result<Vec<u8>> {
    let start = usize::try_from(place.offset).unwrap_or(usize::MAX);
    let bytes = file.and_then(|file| file.get(start..)).and_then(|tail| tail.get(..place.len as usize));
    bytes.map(<[u8]>::to_vec).ok_or_else(|| io::ErrorKind::UnexpectedEof.into())
}

impl PageSource for MemoryPacks {
    fn read(&self, zone: Zone, place: Place) -> Result<Vec<u8>, StoreError> {
        part(self.packs.get(zone.index()), place).map_err(|error| cut_short(&self.pack_name(zone), error))
    }

    fn pack_len(&self, zone: Zone) -> Result<u64, StoreError> {
        Ok(self.packs.get(zone.index()).map_or(0, Vec::len) as u64)
    }

    fn pack_name(&self, zone: Zone) -> PathBuf {
        format!("memory/{:02}.pack", zone.index()).into()
    }

    fn read_index(&self, zone: Zone, place: Place) -> Result<Vec<u8>, StoreError> {
        part(self.indexes.get(zone.index()), place).map_err(|error| index_cut_short(&self.index_name(zone), error))
    }

    fn whole_index(&self, zone: Zone) -> Result<SharedBytes, StoreError> {
        let file = self.indexes.get(zone.index()).map_or(&[][..], Vec::as_slice);
        Ok(aligned(file))
    }

    fn index_len(&self, zone: Zone) -> Result<u64, StoreError> {
        Ok(self.indexes.get(zone.index()).map_or(0, Vec::len) as u64)
    }

    fn index_name(&self, zone: Zone) -> PathBuf {
        format!("memory/{:02}.idx", zone.index()).into()
    }
}
