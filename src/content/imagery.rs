//! A cell's picture.

use crate::forest::CellId;

/// Texels along a side of a cell's picture.
pub const IMAGERY_PX: u32 = 256;
/// Texels of the neighbours round it, so that filtering does not show the seam.
pub const IMAGERY_GUTTER_PX: u32 = 1;
/// Texels along a side of a stored page.
pub const IMAGERY_STORED_PX: u32 = IMAGERY_PX + 2 * IMAGERY_GUTTER_PX;

/// The mip level of a zone's picture, and all below it, that make the zone's part of the world image.
pub const WORLD_IMAGE_MIP: u32 = 2;
/// By how much the texels of the world image are larger than those of the zones' pictures.
pub const WORLD_IMAGE_COARSER: f64 = IMAGERY_STORED_PX as f64 / (IMAGERY_STORED_PX >> WORLD_IMAGE_MIP) as f64;

/// A decoded picture: sRGB, rows from the north, `IMAGERY_STORED_PX` squared with its gutter.
#[derive(Clone, Debug, PartialEq)]
pub struct ImageryPage {
    pub cell: CellId,
    /// RGBA8 of each mip level, finest first; level n has sides of `max(1, IMAGERY_STORED_PX >> n)` texels.
    pub mips: Vec<Vec<u8>>,
}

impl ImageryPage {
    pub fn byte_len(&self) -> usize {
        size_of::<Self>() + self.mips.iter().map(Vec::len).sum::<usize>()
    }
}
