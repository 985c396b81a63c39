//! How many bytes a page will hold before it has been read.
//!
//! Terrain and imagery pages have a largest size that follows from their format. Objects grow with what is stored, by
//! a factor that is learned from the pages that have come in: the largest seen so far, and at first
//! [`OBJECTS_GROWTH`]. Estimates are meant to be too large rather than too small; what they miss is caught by the
//! manager's [`reserve`](super::manager).

use crate::content::{IMAGERY_STORED_PX, POSTS, Page, PageKind, TerrainPage, TerrainPost};
use crate::forest::index::Place;

/// Bytes that a page of objects holds per stored byte, before any has been seen: a stored footprint corner takes about 3
/// bytes, its wall 4 vertices of 16 bytes and 6 indices of 4, and 8 bytes of the footprint that stays. Pages of real
/// cities hold 20. A texel of an atlas takes 5 bytes and the sixth part of one as JPEG, about 30 times as much.
pub const OBJECTS_GROWTH: f64 = 25.0;
/// What a page takes while it is decoded and uploaded, per byte that it holds afterwards: 34 bytes of those 20 in real
/// cities; a picture is in memory and on the GPU.
const ARRIVING: u64 = 2;
/// What a page takes beside its arrays, bytes.
const PAGE_OVERHEAD_BYTES: u64 = 1024;
/// All posts active.
const TERRAIN_BYTES: u64 = (POSTS * POSTS * size_of::<TerrainPost>()
    + 2 * (POSTS - 1) * (POSTS - 1) * size_of::<[u16; 3]>()
    + size_of::<TerrainPage>()) as u64
    + PAGE_OVERHEAD_BYTES;

/// The corners and the two triangles between them: what every page has.
const TERRAIN_LEAST_BYTES: u64 =
    (size_of::<TerrainPage>() + 4 * size_of::<TerrainPost>() + 2 * size_of::<[u16; 3]>()) as u64;

/// Bytes of a picture with its mips on the GPU.
pub const PICTURE_GPU_BYTES: u64 = {
    let (mut bytes, mut side) = (0, IMAGERY_STORED_PX as u64);
    while side > 0 {
        bytes += 4 * side * side;
        side /= 2;
    }
    bytes
};

/// Bytes that a page holds once it is resident, on the GPU and beside it: pictures and meshes of objects lie on the GPU
/// alone.
pub fn held_bytes(page: &Page) -> u64 {
    match page {
        Page::Terrain(terrain) => terrain.byte_len() as u64,
        Page::Imagery(_) => PICTURE_GPU_BYTES,
        Page::Objects(objects, mesh) => (objects.byte_len() + mesh.byte_len()) as u64,
        Page::Segment(segment) => segment.byte_len() as u64,
    }
}

/// A lower bound of the same by the index alone: no page is smaller decoded than stored.
pub fn least_held_bytes(kind: PageKind, place: Place) -> u64 {
    match kind {
        PageKind::Terrain => u64::from(place.len).max(TERRAIN_LEAST_BYTES),
        PageKind::Imagery => PICTURE_GPU_BYTES,
        PageKind::Objects { .. } | PageKind::Segment => u64::from(place.len),
    }
}

/// Learned sizes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimator {
    objects_growth: Option<f64>,
}

impl Estimator {
    pub const fn new() -> Self {
        Self { objects_growth: None }
    }

    /// Bytes that a page will hold once it is resident.
    pub fn held_bytes(&self, kind: PageKind, place: Place) -> u64 {
        match kind {
            PageKind::Segment => u64::from(place.len),
            PageKind::Terrain => TERRAIN_BYTES,
            PageKind::Imagery => PICTURE_GPU_BYTES + PAGE_OVERHEAD_BYTES,
            PageKind::Objects { .. } => {
                let growth = self.objects_growth.unwrap_or(OBJECTS_GROWTH);
                (growth * f64::from(place.len)).ceil() as u64 + PAGE_OVERHEAD_BYTES
            }
        }
    }

    /// Bytes that it takes until then, its stored bytes while they are read included.
    pub fn arriving_bytes(&self, kind: PageKind, place: Place) -> u64 {
        let held = self.held_bytes(kind, place);
        match kind {
            // As long in memory as it is stored, and read into the memory that it stays in.
            PageKind::Segment => held,
            PageKind::Terrain => held + u64::from(place.len),
            PageKind::Imagery | PageKind::Objects { .. } => ARRIVING * held + u64::from(place.len),
        }
    }

    /// Learns from a page that has come in.
    pub fn learn(&mut self, kind: PageKind, place: Place, bytes: u64) {
        if let PageKind::Objects { .. } = kind {
            let growth = bytes as f64 / f64::from(place.len.max(1));
            self.objects_growth = Some(self.objects_growth.map_or(growth, |seen| seen.max(growth)));
        }
    }
}

/// The largest page of a kind that can be told beforehand, bytes.
pub const fn largest_bytes() -> u64 {
    let imagery = ARRIVING * (PICTURE_GPU_BYTES + PAGE_OVERHEAD_BYTES);
    if imagery > TERRAIN_BYTES { imagery } else { TERRAIN_BYTES }
}
