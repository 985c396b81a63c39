//! The terrain surface of a cell: a right-triangulated irregular network over its posts, drawn as flat triangles in
//! space between ellipsoid positions of its posts.

use super::rtin::Diagonal;
use crate::forest::CellId;
use crate::geodesy::{Ecef, Point};
use bytemuck::{Pod, Zeroable};

/// A post that the network uses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TerrainPost {
    /// Column from the west and row from the south, 0 to 64.
    pub column: u8,
    pub row: u8,
    /// Above the ellipsoid, metres.
    pub height_m: f32,
    /// Height of the parent's drawn surface above the ellipsoid at this post, metres; its own where there is no parent.
    pub parent_height_m: f32,
    /// Rise of the truth towards east and north, in steps of [`TerrainPost::SLOPE_STEP`] of atan(slope)/(π/2).
    pub slope: [i8; 2],
}

/// A decoded terrain page.
#[derive(Clone, Debug, PartialEq)]
pub struct TerrainPage {
    pub cell: CellId,
    /// Bounds the distance between the drawn surface and the truth, metres.
    pub error_m: f32,
    pub diagonal: Diagonal,
    pub posts: Vec<TerrainPost>,
    /// Indices into `posts`, counter-clockwise seen from above, in depth-first order of the bintree.
    pub triangles: Vec<[u16; 3]>,
}

/// A vertex as the GPU takes it: 24 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct TerrainVertex {
    /// From the mesh's origin, ECEF axes, metres; at the page's own height.
    pub position_m: [f32; 3],
    /// The parent's height less the own one, metres.
    pub morph_m: f32,
    /// Fractions of the piece's cell, 0 west/south to 65535 east/north.
    pub uv: [u16; 2],
    /// Slope towards east and north as in [`TerrainPost`]; then 127 for the lower edge of a skirt, else 0; then 0.
    pub slope_skirt: [i8; 4],
}

/// The surface of a page cut to a cell: its own or any below it.
#[derive(Clone, Debug)]
pub struct TerrainMesh {
    pub origin: Point<Ecef>,
    pub vertices: Vec<TerrainVertex>,
    /// Triangles, counter-clockwise from outside; the first `surface_len` indices are the surface, the rest skirts.
    pub indices: Vec<u32>,
    pub surface_len: u32,
}

impl TerrainPost {
    pub const SLOPE_STEP: f32 = 1.0 / 127.0;
}

impl TerrainPage {
    pub fn byte_len(&self) -> usize {
        size_of::<Self>() + size_of_val(&*self.posts) + size_of_val(&*self.triangles)
    }

    /// Height above the ellipsoid of the drawn surface at a place inside the cell, metres, at morph weight `own`
    /// (0: the parent's surface, 1: its own). `None` outside the cell.
    pub fn surface_height_m(&self, _lat_rad: f64, _lon_rad: f64, _own: f64) -> Option<f64> {
        todo!()
    }

    /// The drawn surface cut exactly to `piece`, which must be this page's cell or below it, with skirts along the
    /// four sides of the piece.
    pub fn cut(&self, _piece: CellId) -> TerrainMesh {
        todo!()
    }
}
