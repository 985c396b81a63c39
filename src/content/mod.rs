//! Decoded pages: terrain surfaces, imagery, objects, segments of the index. No files, no GPU.

mod atlas;
mod cut;
mod detail;
mod footprints;
mod imagery;
mod objects;
mod prism;
pub mod rtin;
mod surface;
mod terrain;

pub use atlas::{
    ATLAS_ALIGN_PX, ATLAS_GUTTER_PX, ATLAS_MIPS, ATLAS_SIDE_MAX, ATLAS_TEXELS_MAX, Atlas, AtlasFormat, NO_TEXTURE,
};
pub use detail::{Detail, DetailCorner, FaceGroup, FaceKind};
pub use footprints::{Ball, Footprints};
pub use imagery::{
    IMAGERY_GUTTER_PX, IMAGERY_PX, IMAGERY_STORED_PX, ImageryPage, WORLD_IMAGE_COARSER, WORLD_IMAGE_MIP,
};
pub use objects::{CellObjects, Look, Object, ObjectMesh, ObjectPage, ObjectVertex};
pub use prism::{Footprint, Prism};
pub use surface::Surface;
pub use terrain::{TerrainMesh, TerrainPage, TerrainPost, TerrainVertex, border_posts};

use crate::forest::CellId;
use crate::forest::index::{IndexForest, Place, Segment};
use std::sync::Arc;

/// Posts along a side of a terrain page.
pub const POSTS: usize = rtin::SIDE + 1;

/// Reps of objects from this on are groups: they stand for the objects of all pages in the subtree, not only for those
/// of the page that is rooted at the same cell. Larger is coarser.
pub const FIRST_GROUPS: u8 = 4;

/// Which page of a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum PageKind {
    Terrain,
    Imagery,
    /// The page of objects of a collection that is rooted at the cell; `rep` 0 is the finest.
    Objects {
        collection: u8,
        rep: u8,
    },
    /// The segment of the index that begins with the cell. It is paged like the others, and never drawn.
    Segment,
}

/// Which file a page is read from: one of its zone's, or the single-seek layout that is flown by.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum PageFile {
    Pack,
    Index,
    Layout,
}

/// Where the places of a layout begin; packs and indexes end before. A page has a place in the layout beside its own.
pub const LAYOUT_AT: u64 = 1 << 62;

impl PageKind {
    /// The file that a page's place lies in.
    pub fn file_of(self, place: Place) -> PageFile {
        match self {
            _ if place.offset >= LAYOUT_AT => PageFile::Layout,
            Self::Segment => PageFile::Index,
            _ => PageFile::Pack,
        }
    }
}

/// Names a page of a world.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct PageId {
    pub cell: CellId,
    pub kind: PageKind,
}

impl PageId {
    /// Where the page lies; `None` when the world has no such page, or its node is not in memory.
    pub fn place(self, index: &IndexForest) -> Option<Place> {
        if self.kind == PageKind::Segment {
            return index.segment(self.cell).map(|segment| segment.place);
        }
        let node = index.find(self.cell)?;
        match self.kind {
            PageKind::Terrain => Some(node.terrain()?.place),
            PageKind::Imagery => node.imagery(),
            PageKind::Objects { collection, rep } => {
                node.objects().find(|entry| entry.collection == collection && entry.rep == rep).map(|entry| entry.place)
            }
            PageKind::Segment => None,
        }
    }
}

/// A decoded page; cheap to clone.
#[derive(Clone, Debug)]
pub enum Page {
    Terrain(Arc<TerrainPage>),
    Imagery(Arc<ImageryPage>),
    Objects(Arc<ObjectPage>, Arc<ObjectMesh>),
    Segment(Segment),
}

impl Page {
    pub fn id(&self) -> PageId {
        match self {
            Self::Terrain(page) => PageId { cell: page.cell, kind: PageKind::Terrain },
            Self::Imagery(page) => PageId { cell: page.cell, kind: PageKind::Imagery },
            Self::Objects(page, _) => {
                PageId { cell: page.root, kind: PageKind::Objects { collection: page.collection, rep: page.rep } }
            }
            Self::Segment(segment) => PageId { cell: segment.root(), kind: PageKind::Segment },
        }
    }

    /// Bytes of memory that the decoded page holds.
    pub fn byte_len(&self) -> usize {
        match self {
            Self::Terrain(page) => page.byte_len(),
            Self::Imagery(page) => page.byte_len(),
            Self::Objects(page, mesh) => page.byte_len() + mesh.byte_len(),
            Self::Segment(segment) => segment.byte_len(),
        }
    }
}
