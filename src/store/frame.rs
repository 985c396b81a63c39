//! What every page begins with, 32 bytes, little-endian:
//!
//! | bytes | |
//! |---|---|
//! | 0–3 | magic `STPG` |
//! | 4 | version, 1 |
//! | 5 | kind: 0 terrain, 1 imagery, 2 objects |
//! | 6, 7 | collection and rep of objects, else 0 |
//! | 8–15 | the cell's ordinal |
//! | 16–19 | length of what follows |
//! | 20–23 | its length unpacked (zstd), or the same where it is stored plainly |
//! | 24–31 | xxh3 of bytes 0–23 and of what follows |

use super::bytes::{Reader, Writer};
use super::error::{EncodeError, PageFault};
use crate::content::{PageId, PageKind};
use crate::forest::CellId;
use std::borrow::Cow;
use xxhash_rust::xxh3::Xxh3;

const MAGIC: [u8; 4] = *b"STPG";
pub(super) const VERSION: u8 = 1;
pub(super) const HEADER_BYTES: usize = 32;
/// No page unpacks to more than this; what claims to is malformed.
pub(super) const UNPACKED_MAX: usize = 64 << 20;
const ZSTD_LEVEL: i32 = 12;

fn kind_bytes(kind: PageKind) -> [u8; 3] {
    match kind {
        PageKind::Terrain => [0, 0, 0],
        PageKind::Imagery => [1, 0, 0],
        PageKind::Objects { collection, rep } => [2, collection, rep],
        // Segments lie in index files, without a frame; the number is kept from other kinds, and nothing reads it.
        PageKind::Segment => [3, 0, 0],
    }
}

fn kind_of(bytes: [u8; 3]) -> Option<PageKind> {
    match bytes {
        [0, 0, 0] => Some(PageKind::Terrain),
        [1, 0, 0] => Some(PageKind::Imagery),
        [2, collection, rep] => Some(PageKind::Objects { collection, rep }),
        _ => None,
    }
}

fn checksum(head: &[u8], body: &[u8]) -> u64 {
    let mut hash = Xxh3::new();
    hash.update(head);
    hash.update(body);
    hash.digest()
}

/// Packs with zstd where that is shorter.
pub(super) fn pack(plain: &[u8]) -> Cow<'_, [u8]> {
    match zstd::bulk::compress(plain, ZSTD_LEVEL) {
        Ok(packed) if packed.len() < plain.len() => Cow::Owned(packed),
        _ => Cow::Borrowed(plain),
    }
}

/// The reverse of [`pack`]; no more than `len` bytes are made.
pub(super) fn unpack(packed: &[u8], len: usize) -> Result<Cow<'_, [u8]>, PageFault> {
    if len == packed.len() {
        return Ok(Cow::Borrowed(packed));
    }
    if len > UNPACKED_MAX {
        return Err(PageFault::Malformed("a length beyond the limit"));
    }
    let plain = zstd::bulk::decompress(packed, len).map_err(|_| PageFault::Malformed("it does not unpack"))?;
    if plain.len() == len { Ok(Cow::Owned(plain)) } else { Err(PageFault::Malformed("it unpacks to another length")) }
}

/// Frames a body that is as long unpacked as `unpacked`.
pub(super) fn frame(id: PageId, body: &[u8], unpacked: usize) -> Result<Vec<u8>, EncodeError> {
    let len = u32::try_from(body.len()).ok().filter(|&len| len < (1 << 24) - HEADER_BYTES as u32);
    let (Some(len), true) = (len, unpacked <= UNPACKED_MAX) else {
        return Err(EncodeError::TooLarge(body.len().max(unpacked)));
    };
    let mut page = Writer(Vec::with_capacity(HEADER_BYTES + body.len()));
    page.bytes(&MAGIC);
    page.u8(VERSION);
    page.bytes(&kind_bytes(id.kind));
    page.u64(id.cell.to_u64());
    page.u32(len);
    page.u32(unpacked as u32);
    page.u64(checksum(&page.0, body));
    page.bytes(body);
    Ok(page.0)
}

/// A page's frame, opened and checked.
pub(super) struct Framed<'a> {
    pub id: PageId,
    pub body: &'a [u8],
    pub unpacked: usize,
}

/// Opens a page of any cell and kind.
pub(super) fn open(page: &[u8]) -> Result<Framed<'_>, PageFault> {
    let mut reader = Reader::new(page);
    if reader.take(4)? != MAGIC {
        return Err(PageFault::Magic);
    }
    let version = reader.u8()?;
    if version > VERSION {
        return Err(PageFault::FutureVersion(version));
    }
    let kind = kind_of([reader.u8()?, reader.u8()?, reader.u8()?]);
    let cell = CellId::from_u64(reader.u64()?);
    let (len, unpacked) = (reader.u32()? as usize, reader.u32()? as usize);
    let expected = reader.u64()?;
    let body = reader.take(len)?;
    reader.finish()?;
    if checksum(&page[..HEADER_BYTES - 8], body) != expected || version == 0 {
        return Err(PageFault::Checksum);
    }
    match (kind, cell) {
        (Some(kind), Some(cell)) => Ok(Framed { id: PageId { cell, kind }, body, unpacked }),
        _ => Err(PageFault::Malformed("an unknown kind or cell")),
    }
}
