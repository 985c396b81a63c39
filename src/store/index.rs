//! Index files.
//!
//! | bytes | |
//! |---|---|
//! | 0–3 | magic `STIX` |
//! | 4–7, 8–11, 12–15 | version 1, zone, number of segments |
//! | 16–23 | length of the file |
//! | 24–31 | xxh3 of bytes 0–23 and of the table |
//! | then | table: per segment its root's ordinal and its offset (8 bytes each), nodes and objects entries (4 each), xxh3 (8) |
//! | then | segments, aligned to 8 bytes: node records, then objects records |
//!
//! A file is read whole, or its head, its table and its first segment; other segments then one by one. Sums and links of
//! a segment are checked as it is read, so that traversal cannot fail later. For 1.4 million nodes in one zone (45 MB)
//! that took 55 ms; zones are opened side by side.

use super::StoreError;
use super::bytes::{Reader, Writer};
use super::pack::PageSource;
use crate::forest::index::{Directory, IndexError, IndexTree, Place, Segment, SegmentEntry};
use crate::forest::{CellId, Zone};
use xxhash_rust::xxh3::{Xxh3, xxh3_64};

const MAGIC: [u8; 4] = *b"STIX";
const VERSION: u32 = 1;
pub(super) const HEADER_BYTES: usize = 32;
const ENTRY_BYTES: usize = 32;
const ALIGNMENT: usize = 8;

/// What is wrong with an index file, or with reading it.
enum IndexFault {
    FutureVersion(u32),
    Other(String),
    Unread(StoreError),
}

impl IndexFault {
    fn in_file(self, source: &dyn PageSource, zone: Zone) -> StoreError {
        let file = source.index_name(zone);
        match self {
            Self::FutureVersion(found) => StoreError::FutureVersion { file, found, supported: VERSION },
            Self::Other(cause) => StoreError::Index { file, cause },
            Self::Unread(error) => error,
        }
    }
}

impl From<IndexError> for IndexFault {
    fn from(error: IndexError) -> Self {
        Self::Other(error.to_string())
    }
}

impl From<StoreError> for IndexFault {
    fn from(error: StoreError) -> Self {
        Self::Unread(error)
    }
}

fn fault<T>(what: &str) -> Result<T, IndexFault> {
    Err(IndexFault::Other(what.to_owned()))
}

fn head_checksum(head: &[u8], table: &[u8]) -> u64 {
    let mut hash = Xxh3::new();
    hash.update(head);
    hash.update(table);
    hash.digest()
}

/// The file of a tree, which must be whole: what is not resident is not written, and the file would not open.
pub(super) fn write(tree: &IndexTree) -> Vec<u8> {
    let count = tree.segments().count();
    let (mut table, mut body) = (Writer::default(), Vec::new());
    let body_at = HEADER_BYTES + count * ENTRY_BYTES;
    for segment in tree.segments() {
        body.resize((body_at + body.len()).next_multiple_of(ALIGNMENT) - body_at, 0);
        table.u64(segment.root().to_u64());
        table.u64((body_at + body.len()) as u64);
        table.u32(segment.nodes().len() as u32);
        table.u32(segment.objects().len() as u32);
        table.u64(xxh3_64(segment.as_bytes()));
        body.extend_from_slice(segment.as_bytes());
    }
    let mut file = Writer::default();
    file.bytes(&MAGIC);
    file.u32(VERSION);
    file.u32(tree.zone().index() as u32);
    file.u32(count as u32);
    file.u64((body_at + body.len()) as u64);
    file.u64(head_checksum(&file.0, &table.0));
    file.bytes(&table.0);
    file.bytes(&body);
    file.0
}

/// The checksum in the head of a file, which covers its table and so all of it; hexadecimal.
pub(super) fn checksum(file: &[u8]) -> Option<String> {
    let sum = file.get(HEADER_BYTES - 8..HEADER_BYTES)?;
    Some(format!("{:016x}", u64::from_le_bytes(sum.try_into().ok()?)))
}

/// How much of an index is brought into memory when it is opened.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Extent {
    Whole,
    /// The directory and the root's segment.
    Top,
}

/// Opens the index of a zone.
pub(super) fn open(source: &dyn PageSource, zone: Zone, extent: Extent) -> Result<IndexTree, StoreError> {
    let tree = match extent {
        Extent::Whole => read_whole(source, zone),
        Extent::Top => read_top(source, zone),
    };
    tree.map_err(|fault| fault.in_file(source, zone))
}

/// Checks and decodes the bytes of a segment. `tree`: of its zone.
pub(super) fn decode(
    source: &dyn PageSource,
    tree: &IndexTree,
    root: CellId,
    bytes: &[u8],
) -> Result<Segment, StoreError> {
    decode_segment(tree, root, bytes).map_err(|fault| fault.in_file(source, tree.zone()))
}

fn decode_segment(tree: &IndexTree, root: CellId, bytes: &[u8]) -> Result<Segment, IndexFault> {
    let entry = tree.directory().find(root).and_then(|number| tree.directory().get(number));
    let entry = entry.ok_or_else(|| IndexFault::Other(format!("it has no segment of cell {root}")))?;
    let segment = copy_segment(entry, bytes)?;
    tree.check_segment(&segment)?;
    Ok(segment)
}

fn read_whole(source: &dyn PageSource, zone: Zone) -> Result<IndexTree, IndexFault> {
    let bytes = source.whole_index(zone)?;
    let all = (*bytes).as_ref();
    let head = Head::read(zone, all, all.len() as u64)?;
    let directory = head.directory(all.get(HEADER_BYTES..).unwrap_or_default())?;
    let mut segments = Vec::with_capacity(directory.entries().len());
    for entry in directory.entries() {
        let (at, len) = (entry.offset as usize, entry.byte_len());
        check_sum(entry, all.get(at..at + len).unwrap_or_default())?;
        let segment = Segment::new(entry.root, bytes.clone(), at, entry.nodes as usize, entry.objects as usize);
        segments.push(segment.map_or_else(|| fault("a segment that is not aligned"), Ok)?);
    }
    Ok(IndexTree::whole(directory, segments)?)
}

/// Three reads, none of which touches what lies behind the first segment.
fn read_top(source: &dyn PageSource, zone: Zone) -> Result<IndexTree, IndexFault> {
    let read = |offset, len| source.read_index(zone, Place { offset, len });
    let head = Head::read(zone, &read(0, HEADER_BYTES as u32)?, source.index_len(zone)?)?;
    let table_len = u32::try_from(head.table_len()).or_else(|_| fault("too many segments"))?;
    let directory = head.directory(&read(HEADER_BYTES as u64, table_len)?)?;
    let Some(first) = directory.entries().first() else { return fault("it has no segment") };
    let top = copy_segment(first, &read(first.offset, first.byte_len() as u32)?)?;
    Ok(IndexTree::paged(directory, top)?)
}

fn check_sum(entry: &SegmentEntry, bytes: &[u8]) -> Result<(), IndexFault> {
    if bytes.len() != entry.byte_len() || xxh3_64(bytes) != entry.checksum {
        return Err(IndexFault::Other(format!("the checksum of the segment of cell {} is wrong", entry.root)));
    }
    Ok(())
}

fn copy_segment(entry: &SegmentEntry, bytes: &[u8]) -> Result<Segment, IndexFault> {
    check_sum(entry, bytes)?;
    Segment::copied(entry.root, bytes, entry.nodes as usize, entry.objects as usize)
        .map_or_else(|| fault("a segment that is not aligned"), Ok)
}

/// What a file begins with.
struct Head {
    zone: Zone,
    count: usize,
    file_len: u64,
    /// Of the head before it and of the table.
    checksum: u64,
    bytes: [u8; HEADER_BYTES - 8],
}

impl Head {
    /// `file_len`: bytes that are there.
    fn read(zone: Zone, bytes: &[u8], file_len: u64) -> Result<Self, IndexFault> {
        let mut reader = Reader::new(bytes);
        let short = |_| IndexFault::Other("it ends too early".to_owned());
        if reader.take(4).map_err(short)? != MAGIC {
            return fault("it does not begin like an index");
        }
        let version = reader.u32().map_err(short)?;
        if version > VERSION {
            return Err(IndexFault::FutureVersion(version));
        }
        let found = reader.u32().map_err(short)?;
        let count = reader.u32().map_err(short)? as usize;
        let told_len = reader.u64().map_err(short)?;
        let checksum = reader.u64().map_err(short)?;
        if told_len > file_len || (count as u64).saturating_mul(ENTRY_BYTES as u64) > file_len {
            return fault("it ends too early");
        }
        let mut head = Self { zone, count, file_len, checksum, bytes: [0; HEADER_BYTES - 8] };
        head.bytes.copy_from_slice(bytes.get(..HEADER_BYTES - 8).unwrap_or_default());
        if version != VERSION {
            return fault("its checksum is wrong");
        }
        if found as usize != zone.index() || told_len != file_len {
            return fault("it belongs to another zone, or has bytes beyond its end");
        }
        Ok(head)
    }

    fn table_len(&self) -> usize {
        self.count * ENTRY_BYTES
    }

    /// `bytes` begin with the table.
    fn directory(&self, bytes: &[u8]) -> Result<Directory, IndexFault> {
        let Some(table) = bytes.get(..self.table_len()) else { return fault("it ends too early") };
        if head_checksum(&self.bytes, table) != self.checksum {
            return fault("its checksum is wrong");
        }
        let body_at = (HEADER_BYTES + table.len()) as u64;
        let entries = table.chunks_exact(ENTRY_BYTES).map(|entry| read_entry(entry, body_at, self.file_len));
        Ok(Directory::new(self.zone, entries.collect::<Result<_, _>>()?)?)
    }
}

fn read_entry(bytes: &[u8], body_at: u64, file_len: u64) -> Result<SegmentEntry, IndexFault> {
    let mut reader = Reader::new(bytes);
    let short = |_| IndexFault::Other("its table ends too early".to_owned());
    let root = CellId::from_u64(reader.u64().map_err(short)?);
    let entry = SegmentEntry {
        root: root.map_or_else(|| fault("a segment of no cell"), Ok)?,
        offset: reader.u64().map_err(short)?,
        nodes: reader.u32().map_err(short)?,
        objects: reader.u32().map_err(short)?,
        checksum: reader.u64().map_err(short)?,
    };
    let end = entry.offset.checked_add(entry.byte_len() as u64);
    if entry.offset < body_at || end.is_none_or(|end| end > file_len) {
        return fault("a segment beyond its end");
    }
    if !entry.offset.is_multiple_of(ALIGNMENT as u64) {
        return fault("a segment that is not aligned");
    }
    Ok(entry)
}
