//! The world format: manifest, index files, packs, codecs; local directories, servers and memory.
//!
//! ```text
//! world.json     the manifest
//! index/ZZ.idx   the index tree of zone ZZ, 00 to 31
//! packs/ZZ.pack  its pages
//! layouts/NAME.seek  pages once more, for flights without seeks
//! ```
//! What `stoop-prepare --into` adds later lies beside them; see `additions.rs`. All words are little-endian; every section and page carries magic, version and an xxh3 checksum.

mod additions;
mod atlas;
mod bytes;
mod cache;
mod change;
mod details;
mod error;
mod frame;
mod ground;
mod imagery;
mod index;
mod manifest;
mod map;
mod merge;
mod objects;
mod pack;
mod remote;
mod seat;
mod seek;
mod site;
mod stack;
mod terrain;
mod verify;
mod views;
mod whole;
mod world;
mod writer;

pub use additions::{Additions, PackFile, ZoneFiles};
pub use atlas::{decode_atlas, encode_atlas};
pub use cache::{CACHE_LIMIT, CACHE_LIMIT_MIN, DiskCache};
pub use change::{CollectionChange, WorldChange};
pub use error::{EncodeError, PageFault, StoreError};
pub use ground::{GroundPages, finest_terrain};
pub use imagery::{JPEG_QUALITY, decode_imagery, encode_imagery};
pub use manifest::{CollectionInfo, CostPoint, LayerInfo, Manifest, RepInfo, SourceInfo};
pub use objects::{
    FOOTPRINT_UNIT_MAX_M, FOOTPRINT_UNIT_PER_ERROR, OBJECT_HEIGHT_UNIT_M, PrismPage, decode_attributes, decode_objects,
    decode_prisms, encode_objects,
};
pub use pack::{PageRange, PageSource};
pub use remote::{Address, REQUEST_LIMIT, SCHEMES};
pub use seek::{LAYOUT_BLOCK_BYTES, LAYOUT_HEAD_MAX_BYTES, layout_blocks, layout_place, write_layout};
pub use stack::STACK_WORLDS_MAX;
pub use terrain::{HEIGHT_STEP_MIN_M, decode_terrain, encode_terrain, height_step_m};
pub use verify::{Problem, Verified};
pub use views::{HOME_HEIGHT_M, NamedView, VIEW_HEIGHT_M, VIEW_NAME_MAX, bookmarks};
pub use whole::write_whole;
pub use world::{INDEX_RESIDENT_MAX_BYTES, MANIFEST_FILE, OpenOptions, World};
pub use writer::{Existing, MemoryWriter, WorldWriter};

use crate::content::{Page, PageId, PageKind};
use std::sync::Arc;

/// Decodes a page of a pack and checks that it is the one asked for.
pub fn decode_page(id: PageId, bytes: &[u8]) -> Result<Page, PageFault> {
    let framed = frame::open(bytes)?;
    if framed.id != id {
        return Err(PageFault::WrongPage);
    }
    Ok(match id.kind {
        PageKind::Terrain => Page::Terrain(Arc::new(terrain::decode_framed(&framed)?)),
        PageKind::Imagery => Page::Imagery(Arc::new(imagery::decode_framed(&framed)?)),
        PageKind::Objects { .. } => {
            let (page, mesh) = decode_objects(bytes)?;
            Page::Objects(Arc::new(page), Arc::new(mesh))
        }
        // Segments are no pages of packs, and nothing that is framed says it is one.
        PageKind::Segment => return Err(PageFault::WrongPage),
    })
}

#[cfg(test)]
mod codec_tests;
