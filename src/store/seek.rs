//! Files of single-seek layouts (`layouts/NAME.seek`): pages of a world once more, in runs, in the order in which they are
//! wanted together.
//!
//! A header of 64 bytes (magic `STSL`, version, xxh3 of the world's manifest, lengths of head packed and unpacked, length of
//! the file, xxh3 of the packed head, zeros, xxh3 of bytes 0–55), the head (zstd; what it says is up to the module `layout`),
//! then runs of pages, each page framed as in a pack, each run from a multiple of [`LAYOUT_BLOCK_BYTES`] on.

use super::bytes::{Reader, Writer};
use super::error::{PageFault, StoreError};
use super::world::World;
use super::write_whole;
use crate::content::{LAYOUT_AT, PageId};
use crate::forest::index::Place;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use xxhash_rust::xxh3::xxh3_64;

/// Runs begin at multiples of this: 16 KiB.
pub const LAYOUT_BLOCK_BYTES: u64 = 16 << 10;
/// Longest head, unpacked: what opening a layout may take of the memory.
pub const LAYOUT_HEAD_MAX_BYTES: usize = 64 << 20;

const MAGIC: [u8; 4] = *b"STSL";
const VERSION: u32 = 1;
const HEADER_BYTES: usize = 64;
const CHECKED_BYTES: usize = HEADER_BYTES - 8;
const PACK_LEVEL: i32 = 9;
const FOLDER: &str = "layouts";
const SUFFIX: &str = ".seek";

/// The file of an open layout.
#[derive(Clone, Debug)]
pub(super) struct SeekFile {
    name: String,
    /// Where the first run begins.
    runs_at: u64,
}

struct Header {
    world: u64,
    packed: u64,
    unpacked: u64,
    file_len: u64,
    head_checksum: u64,
}

/// `layouts/NAME.seek`; `None` where that is no name of a file.
pub(super) fn file_name(layout: &str) -> Option<String> {
    let is_plain = |c: char| c.is_alphanumeric() || "-_. ".contains(c);
    let is_name = !layout.is_empty() && !layout.starts_with('.') && layout.len() <= 128 && layout.chars().all(is_plain);
    is_name.then(|| format!("{FOLDER}/{layout}{SUFFIX}"))
}

/// The number of blocks that a run of so many bytes takes.
pub fn layout_blocks(run_bytes: u64) -> u64 {
    run_bytes.div_ceil(LAYOUT_BLOCK_BYTES)
}

/// Where a page lies that begins `offset` bytes behind the first run's start.
pub fn layout_place(offset: u64, len: u32) -> Place {
    Place { offset: LAYOUT_AT + offset, len }
}

impl Header {
    fn to_bytes(&self) -> Vec<u8> {
        let mut header = Writer::default();
        header.bytes(&MAGIC);
        header.u32(VERSION);
        for word in [self.world, self.packed, self.unpacked, self.file_len, self.head_checksum] {
            header.u64(word);
        }
        header.bytes(&[0; CHECKED_BYTES - 8 - 5 * 8]);
        header.u64(xxh3_64(&header.0));
        header.0
    }

    fn parse(file: &Path, bytes: &[u8]) -> Result<Self, StoreError> {
        let fail = |cause: &str| layout_error(file, cause);
        let read = || -> Result<(u32, [u64; 5]), PageFault> {
            let mut reader = Reader::new(bytes);
            if reader.take(4)? != MAGIC {
                return Err(PageFault::Magic);
            }
            let version = reader.u32()?;
            let mut words = [0; 5];
            for word in &mut words {
                *word = reader.u64()?;
            }
            Ok((version, words))
        };
        let (version, [world, packed, unpacked, file_len, head_checksum]) =
            read().map_err(|_| fail("it does not begin like a layout"))?;
        if version > VERSION {
            return Err(StoreError::FutureVersion { file: file.to_owned(), found: version, supported: VERSION });
        }
        let told = bytes.get(CHECKED_BYTES..HEADER_BYTES);
        if told != Some(&xxh3_64(&bytes[..CHECKED_BYTES]).to_le_bytes()) {
            return Err(fail("its header's checksum is wrong"));
        }
        if packed > LAYOUT_HEAD_MAX_BYTES as u64 || unpacked > LAYOUT_HEAD_MAX_BYTES as u64 {
            return Err(fail("its head is too long"));
        }
        Ok(Self { world, packed, unpacked, file_len, head_checksum })
    }

    fn runs_at(&self) -> u64 {
        (HEADER_BYTES as u64 + self.packed).next_multiple_of(LAYOUT_BLOCK_BYTES)
    }
}

fn layout_error(file: &Path, cause: impl Into<String>) -> StoreError {
    StoreError::Layout { file: file.to_owned(), cause: cause.into() }
}

/// Writes a layout beside a world in a folder, and gives the file's length. `runs` are the pages of each run with their
/// places in the world, in the order of the file; each begins at the next block.
pub fn write_layout<'r>(
    world: &World,
    name: &str,
    head: &[u8],
    runs: impl Iterator<Item = std::borrow::Cow<'r, [(PageId, Place)]>> + Clone,
) -> Result<u64, StoreError> {
    let file = file_name(name).ok_or_else(|| layout_error(Path::new(name), "this is no name for a layout"))?;
    if world.is_remote() {
        return Err(StoreError::ReadOnly(world.name().to_owned()));
    }
    let path = world.name().join(&file);
    let folder = world.name().join(FOLDER);
    std::fs::create_dir_all(&folder).map_err(|error| StoreError::io(&folder, error))?;
    let packed = zstd::bulk::compress(head, PACK_LEVEL).map_err(|error| StoreError::io(&path, error))?;
    if head.len().max(packed.len()) > LAYOUT_HEAD_MAX_BYTES {
        return Err(layout_error(&path, "its head would be too long; take larger cells or a smaller region"));
    }
    let mut header = Header {
        world: world.build(),
        packed: packed.len() as u64,
        unpacked: head.len() as u64,
        file_len: 0,
        head_checksum: xxh3_64(&packed),
    };
    let run_bytes = |run: &[(PageId, Place)]| run.iter().map(|(_, place)| u64::from(place.len)).sum::<u64>();
    let blocks: u64 = runs.clone().map(|run| layout_blocks(run_bytes(&run))).sum();
    header.file_len = header.runs_at() + blocks * LAYOUT_BLOCK_BYTES;
    let written = write_whole::<WriteFault>(&path, |out| {
        out.write_all(&header.to_bytes())?;
        out.write_all(&packed)?;
        out.write_all(&vec![0; (header.runs_at() - HEADER_BYTES as u64 - header.packed) as usize])?;
        for run in runs {
            for &(page, place) in run.iter() {
                out.write_all(&world.read(page, place)?)?;
            }
            let bytes = run_bytes(&run);
            out.write_all(&vec![0; (layout_blocks(bytes) * LAYOUT_BLOCK_BYTES - bytes) as usize])?;
        }
        Ok(())
    });
    match written {
        Ok(()) => Ok(header.file_len),
        Err(WriteFault::Io(error)) => Err(StoreError::io(&path, error)),
        Err(WriteFault::Read(error)) => Err(error),
    }
}

/// What broke a layout off while it was written.
enum WriteFault {
    Io(std::io::Error),
    Read(StoreError),
}

impl From<std::io::Error> for WriteFault {
    fn from(error: std::io::Error) -> Self {
        Self::Io(error)
    }
}

impl From<StoreError> for WriteFault {
    fn from(error: StoreError) -> Self {
        Self::Read(error)
    }
}

/// Opens a layout of a world, and gives its head as it was written: checks that it is whole, and of this build of the world.
fn open(world: &World, name: &str) -> Result<(SeekFile, Vec<u8>), StoreError> {
    let unnamed = || layout_error(&world.name().join(FOLDER), format!("{name:?} is no name of a layout"));
    let file = file_name(name).ok_or_else(unnamed)?;
    let path: PathBuf = world.name().join(&file);
    let source = world.source();
    let len = source.beside_len(&file)?;
    if len < HEADER_BYTES as u64 {
        return Err(layout_error(&path, "it is cut short"));
    }
    let header = source.read_beside(&file, Place { offset: 0, len: HEADER_BYTES as u32 })?;
    let header = Header::parse(&path, &header)?;
    if header.world != world.build() {
        return Err(layout_error(&path, "it was made for another build of this world"));
    }
    if header.file_len != len {
        return Err(layout_error(&path, format!("it has {len} bytes, its header tells {}", header.file_len)));
    }
    let at = Place { offset: HEADER_BYTES as u64, len: header.packed as u32 };
    let packed = source.read_beside(&file, at)?;
    if xxh3_64(&packed) != header.head_checksum {
        return Err(layout_error(&path, "its head's checksum is wrong"));
    }
    let head = zstd::bulk::decompress(&packed, header.unpacked as usize)
        .map_err(|error| layout_error(&path, format!("its head cannot be unpacked: {error}")))?;
    Ok((SeekFile { name: file, runs_at: header.runs_at() }, head))
}

impl SeekFile {
    /// Bytes of a place from [`LAYOUT_AT`] on.
    pub fn read(&self, world: &World, place: Place) -> Result<Vec<u8>, StoreError> {
        let offset = place.offset.wrapping_sub(LAYOUT_AT).saturating_add(self.runs_at);
        world.source().read_beside(&self.name, Place { offset, len: place.len })
    }

    /// For messages: the file, and where a place lies in it.
    pub fn locate(&self, world: &World, place: Place) -> (PathBuf, u64) {
        (world.name().join(&self.name), place.offset.wrapping_sub(LAYOUT_AT).saturating_add(self.runs_at))
    }
}

impl World {
    /// Opens one of the world's single-seek layouts: from then on pages can be read at its places too, and the head tells
    /// what lies where. A layout that is broken, or of another build of the world, is refused, and nothing changes.
    pub fn open_layout(&mut self, name: &str) -> Result<Vec<u8>, StoreError> {
        let (file, head) = open(self, name)?;
        self.layout = Some(file);
        Ok(head)
    }
}
