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
//! All sums and links are checked as a file is opened, at some GiB/s, so that traversal cannot fail later.

use super::bytes::{Reader, Writer};
use crate::forest::index::{IndexTree, NodeRecord, ObjectsRecord, Segment};
use crate::forest::{CellId, Zone};
use std::sync::Arc;
use xxhash_rust::xxh3::{Xxh3, xxh3_64};

const MAGIC: [u8; 4] = *b"STIX";
pub(super) const VERSION: u32 = 1;
const HEADER_BYTES: usize = 32;
const ENTRY_BYTES: usize = 32;
const ALIGNMENT: usize = 8;

/// What is wrong with an index file.
#[derive(Debug, PartialEq)]
pub(super) enum IndexFault {
    FutureVersion(u32),
    Other(String),
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

fn segment_bytes(segment: &Segment) -> Vec<u8> {
    let mut bytes: Vec<u8> = bytemuck::cast_slice(segment.nodes()).to_vec();
    bytes.extend_from_slice(bytemuck::cast_slice(segment.objects()));
    bytes
}

/// The file of a tree.
pub(super) fn write(tree: &IndexTree) -> Vec<u8> {
    let count = tree.segments().len();
    let (mut table, mut body) = (Writer::default(), Vec::new());
    let body_at = HEADER_BYTES + count * ENTRY_BYTES;
    for segment in tree.segments() {
        body.resize((body_at + body.len()).next_multiple_of(ALIGNMENT) - body_at, 0);
        let bytes = segment_bytes(segment);
        table.u64(segment.root().to_u64());
        table.u64((body_at + body.len()) as u64);
        table.u32(segment.nodes().len() as u32);
        table.u32(segment.objects().len() as u32);
        table.u64(xxh3_64(&bytes));
        body.extend_from_slice(&bytes);
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

/// Opens the file of a zone; the bytes must lie at a multiple of 8 in memory, as maps do.
pub(super) fn read(zone: Zone, bytes: Arc<dyn AsRef<[u8]> + Send + Sync>) -> Result<IndexTree, IndexFault> {
    let entries = read_table(zone, (*bytes).as_ref())?;
    let mut segments = Vec::with_capacity(entries.len());
    for entry in entries {
        segments.push(entry.open(&bytes)?);
    }
    IndexTree::from_segments(zone, segments).map_err(|error| IndexFault::Other(error.to_string()))
}

struct Entry {
    root: CellId,
    offset: usize,
    nodes: usize,
    objects: usize,
    checksum: u64,
}

impl Entry {
    fn open(&self, bytes: &Arc<dyn AsRef<[u8]> + Send + Sync>) -> Result<Segment, IndexFault> {
        let len = self.nodes * size_of::<NodeRecord>() + self.objects * size_of::<ObjectsRecord>();
        let slice = self.offset.checked_add(len).and_then(|end| (**bytes).as_ref().get(self.offset..end));
        match slice {
            None => fault("a segment beyond its end"),
            Some(slice) if xxh3_64(slice) != self.checksum => {
                Err(IndexFault::Other(format!("the checksum of the segment of cell {} is wrong", self.root)))
            }
            Some(_) => Segment::new(self.root, bytes.clone(), self.offset, self.nodes, self.objects)
                .map_or_else(|| fault("a segment that is not aligned"), Ok),
        }
    }
}

fn read_table(zone: Zone, bytes: &[u8]) -> Result<Vec<Entry>, IndexFault> {
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
    let len = reader.u64().map_err(short)?;
    let checksum = reader.u64().map_err(short)?;
    if len > bytes.len() as u64 {
        return fault("it ends too early");
    }
    let table = reader.take(count.saturating_mul(ENTRY_BYTES)).map_err(short)?;
    if head_checksum(&bytes[..HEADER_BYTES - 8], table) != checksum || version != VERSION {
        return fault("its checksum is wrong");
    }
    if found as usize != zone.index() || len != bytes.len() as u64 {
        return fault("it belongs to another zone, or has bytes beyond its end");
    }
    table.chunks_exact(ENTRY_BYTES).map(read_entry).collect()
}

fn read_entry(bytes: &[u8]) -> Result<Entry, IndexFault> {
    let mut reader = Reader::new(bytes);
    let short = |_| IndexFault::Other("its table ends too early".to_owned());
    let root = CellId::from_u64(reader.u64().map_err(short)?);
    Ok(Entry {
        root: root.map_or_else(|| fault("a segment of no cell"), Ok)?,
        offset: usize::try_from(reader.u64().map_err(short)?).or_else(|_| fault("a segment beyond its end"))?,
        nodes: reader.u32().map_err(short)? as usize,
        objects: reader.u32().map_err(short)? as usize,
        checksum: reader.u64().map_err(short)?,
    })
}
