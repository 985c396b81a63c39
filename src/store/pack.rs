//! Pack files: a header of 32 bytes (magic `STPK`, version, zone, zeros, xxh3 of bytes 0–23), then pages end to end.

use super::additions::{Additions, index_path, pack_path};
use super::bytes::{Reader, Writer};
use super::error::{PageFault, StoreError};
use super::{index, map};
use crate::content::PageFile;
use crate::forest::Zone;
use crate::forest::index::{Place, SharedBytes, aligned};
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
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

/// A range of a zone's packs or of its index file, and the pages in it.
#[derive(Clone, Copy, Debug)]
pub struct PageRange<'a> {
    pub zone: Zone,
    pub file: PageFile,
    pub place: Place,
    /// Ascending, apart from one another, inside of `place`; the bytes between them are not wanted.
    pub pages: &'a [Place],
}

impl PageRange<'_> {
    /// Where a place inside of the range lies in its bytes.
    pub(super) fn part(&self, place: Place) -> Option<std::ops::Range<usize>> {
        let start = usize::try_from(place.offset.checked_sub(self.place.offset)?).ok()?;
        let end = start.checked_add(place.len as usize)?;
        (end <= self.place.len as usize).then_some(start..end)
    }
}

/// Where pages and the index are read from. One call is one read; calls may come from any thread.
pub trait PageSource: Send + Sync {
    /// The bytes of a place in a zone's pack, no fewer and no more.
    fn read(&self, zone: Zone, place: Place) -> Result<Vec<u8>, StoreError>;

    /// The bytes of a range, no fewer and no more; those that are not wanted may be anything.
    fn read_range(&self, range: &PageRange<'_>) -> Result<Vec<u8>, StoreError> {
        match range.file {
            PageFile::Pack => self.read(range.zone, range.place),
            PageFile::Index => self.read_index(range.zone, range.place),
            // Which of the layouts, the world knows.
            PageFile::Layout => Err(no_layout(&self.pack_name(range.zone))),
        }
    }

    /// Several ranges, at once where that is faster than one after the other; in their order.
    fn read_ranges(&self, ranges: &[PageRange<'_>]) -> Vec<Result<Vec<u8>, StoreError>> {
        ranges.iter().map(|range| self.read_range(range)).collect()
    }

    /// Told before the indexes of some zones are opened: sources that are far away read ahead.
    fn before_open(&self, _zones: &[Zone]) -> Result<(), StoreError> {
        Ok(())
    }

    /// Told when they are open: what was read ahead is of no more use, and what belongs together must have stayed so.
    fn after_open(&self) -> Result<(), StoreError> {
        Ok(())
    }

    /// Whether reads go over a network.
    fn is_remote(&self) -> bool {
        false
    }

    /// What its user should know of how it was opened, a line.
    fn notice(&self) -> Option<String> {
        None
    }

    /// The bytes of a place in a file that lies beside the packs and that no zone has; no fewer and no more.
    fn read_beside(&self, name: &str, _place: Place) -> Result<Vec<u8>, StoreError> {
        Err(no_layout(Path::new(name)))
    }

    /// Length of such a file.
    fn beside_len(&self, name: &str) -> Result<u64, StoreError> {
        Err(no_layout(Path::new(name)))
    }

    /// Length of a zone's pack, its header included.
    fn pack_len(&self, zone: Zone) -> Result<u64, StoreError>;

    /// The name of a zone's pack, for messages.
    fn pack_name(&self, zone: Zone) -> PathBuf;

    /// The file that a place lies in and its offset there, for messages.
    fn file_of(&self, zone: Zone, place: Place) -> (PathBuf, u64) {
        (self.pack_name(zone), place.offset)
    }

    /// The bytes of a place in a zone's index file, no fewer and no more.
    fn read_index(&self, zone: Zone, place: Place) -> Result<Vec<u8>, StoreError>;

    /// All of a zone's index file, at a multiple of 8 in memory: mapped, where that is possible.
    fn whole_index(&self, zone: Zone) -> Result<SharedBytes, StoreError>;

    /// Length of a zone's index file.
    fn index_len(&self, zone: Zone) -> Result<u64, StoreError>;

    /// The name of a zone's index file, for messages.
    fn index_name(&self, zone: Zone) -> PathBuf;
}

fn no_layout(file: &Path) -> StoreError {
    StoreError::Layout { file: file.to_owned(), cause: "this world cannot have layouts".into() }
}

/// The files of a directory; each is opened as its first page is read.
pub(super) struct LocalPacks {
    dir: PathBuf,
    packs: [Vec<LocalPack>; Zone::COUNT],
    indexes: [LocalIndex; Zone::COUNT],
    /// Files beside them by name.
    beside: Mutex<BTreeMap<String, Arc<File>>>,
}

/// One of the packs of a zone.
struct LocalPack {
    path: PathBuf,
    /// Where its bytes begin in the zone's row of them.
    start: u64,
    /// As the manifest tells; `None` for the one pack of a zone that was never changed, which is as long as its file.
    len: Option<u64>,
    file: OnceLock<File>,
}

struct LocalIndex {
    path: PathBuf,
    /// That its head must hold, where the manifest tells.
    checksum: Option<String>,
    file: OnceLock<File>,
}

impl LocalPacks {
    pub fn new(dir: &Path, additions: &Additions) -> Self {
        let zones: Vec<Zone> = Zone::all().collect();
        let packs = std::array::from_fn(|at| LocalPack::all(dir, zones[at], additions));
        let indexes = std::array::from_fn(|at| LocalIndex::new(dir, zones[at], additions));
        Self { dir: dir.to_owned(), packs, indexes, beside: Mutex::default() }
    }

    /// What it begins with is checked by who reads its table.
    fn index(&self, zone: Zone) -> Result<&File, StoreError> {
        let index = &self.indexes[zone.index()];
        opened(&index.file, &index.path, |path, file| {
            if index.checksum.is_none() {
                return Ok(());
            }
            let mut head = [0; index::HEADER_BYTES];
            read_at(file, 0, &mut head).map_err(|error| index_cut_short(path, error))?;
            index.check(&head)
        })
    }

    fn beside(&self, name: &str) -> Result<Arc<File>, StoreError> {
        // Entries come, and are whole.
        let mut beside = self.beside.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(file) = beside.get(name) {
            return Ok(file.clone());
        }
        let path = self.dir.join(name);
        let file = Arc::new(File::open(&path).map_err(|error| match error.kind() {
            io::ErrorKind::NotFound => StoreError::Layout { file: path, cause: "there is no such layout".into() },
            _ => StoreError::io(&path, error),
        })?);
        beside.insert(name.to_owned(), file.clone());
        Ok(file)
    }

    fn part(&self, zone: Zone, offset: u64) -> Option<(usize, &LocalPack)> {
        let packs = &self.packs[zone.index()];
        let at = packs.partition_point(|pack| pack.start <= offset).checked_sub(1)?;
        Some((at, &packs[at]))
    }
}

impl LocalPack {
    fn all(dir: &Path, zone: Zone, additions: &Additions) -> Vec<Self> {
        let pack =
            |generation, start, len| Self { path: pack_path(dir, zone, generation), start, len, file: OnceLock::new() };
        match additions.of(zone) {
            None => vec![pack(0, 0, None)],
            Some(files) => {
                let packs = files.packs.iter().zip(files.starts());
                packs.map(|(part, start)| pack(part.generation, start, Some(part.bytes))).collect()
            }
        }
    }

    fn open(&self, zone: Zone) -> Result<&File, StoreError> {
        opened(&self.file, &self.path, |path, file| {
            let mut head = [0; HEADER_BYTES];
            read_at(file, 0, &mut head).map_err(|error| cut_short(path, error))?;
            check_header(zone, path, &head)
        })
    }

    fn byte_len(&self, zone: Zone) -> Result<u64, StoreError> {
        let len = self.open(zone)?.metadata().map_err(|error| StoreError::io(&self.path, error))?.len();
        match self.len {
            Some(told) if len != told => {
                let cause = format!("it has {len} bytes, the manifest tells {told}");
                Err(StoreError::Pack { file: self.path.clone(), cause })
            }
            _ => Ok(len),
        }
    }
}

impl LocalIndex {
    fn new(dir: &Path, zone: Zone, additions: &Additions) -> Self {
        let files = additions.of(zone);
        Self {
            path: index_path(dir, zone, files.map_or(0, |files| files.index)),
            checksum: files.map(|files| files.index_checksum.clone()),
            file: OnceLock::new(),
        }
    }

    /// An index that belongs to another manifest would tell places that hold other pages.
    fn check(&self, file: &[u8]) -> Result<(), StoreError> {
        match &self.checksum {
            Some(told) if index::checksum(file).as_ref() != Some(told) => {
                let cause = "it is not the index that the manifest names".to_owned();
                Err(StoreError::Index { file: self.path.clone(), cause })
            }
            _ => Ok(()),
        }
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
        let mut bytes = vec![0; place.len as usize];
        let (mut done, mut offset) = (0, place.offset);
        while done < bytes.len() {
            let Some((at, pack)) = self.part(zone, offset) else {
                return Err(cut_short(&self.pack_name(zone), io::ErrorKind::UnexpectedEof.into()));
            };
            let own = offset - pack.start;
            // A range that was joined from several pages may go on in the next pack.
            let next = self.packs[zone.index()].get(at + 1).map_or(u64::MAX, |next| next.start);
            let end = bytes.len().min(done.saturating_add(usize::try_from(next - offset).unwrap_or(usize::MAX)));
            read_at(pack.open(zone)?, own, &mut bytes[done..end]).map_err(|error| cut_short(&pack.path, error))?;
            offset += (end - done) as u64;
            done = end;
        }
        Ok(bytes)
    }

    fn pack_len(&self, zone: Zone) -> Result<u64, StoreError> {
        self.packs[zone.index()].iter().map(|pack| pack.byte_len(zone)).sum()
    }

    fn pack_name(&self, zone: Zone) -> PathBuf {
        pack_path(&self.dir, zone, 0)
    }

    fn file_of(&self, zone: Zone, place: Place) -> (PathBuf, u64) {
        let found = self.part(zone, place.offset);
        found.map_or_else(
            || (self.pack_name(zone), place.offset),
            |(_, pack)| (pack.path.clone(), place.offset - pack.start),
        )
    }

    fn read_beside(&self, name: &str, place: Place) -> Result<Vec<u8>, StoreError> {
        let mut bytes = vec![0; place.len as usize];
        let path = || self.dir.join(name);
        read_at(&*self.beside(name)?, place.offset, &mut bytes).map_err(|error| match error.kind() {
            io::ErrorKind::UnexpectedEof => StoreError::Layout { file: path(), cause: "it is cut short".into() },
            _ => StoreError::io(&path(), error),
        })?;
        Ok(bytes)
    }

    fn beside_len(&self, name: &str) -> Result<u64, StoreError> {
        Ok(self.beside(name)?.metadata().map_err(|error| StoreError::io(&self.dir.join(name), error))?.len())
    }

    fn read_index(&self, zone: Zone, place: Place) -> Result<Vec<u8>, StoreError> {
        let file = self.index(zone)?;
        let mut bytes = vec![0; place.len as usize];
        read_at(file, place.offset, &mut bytes).map_err(|error| index_cut_short(&self.index_name(zone), error))?;
        Ok(bytes)
    }

    fn whole_index(&self, zone: Zone) -> Result<SharedBytes, StoreError> {
        let bytes = map::map(&self.index_name(zone))?;
        self.indexes[zone.index()].check((*bytes).as_ref())?;
        Ok(bytes)
    }

    fn index_len(&self, zone: Zone) -> Result<u64, StoreError> {
        // Not by the file that parts are read from: whoever maps all of it needs no other.
        let path = self.index_name(zone);
        Ok(fs::metadata(&path).map_err(|error| StoreError::io(&path, error))?.len())
    }

    fn index_name(&self, zone: Zone) -> PathBuf {
        self.indexes[zone.index()].path.clone()
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
