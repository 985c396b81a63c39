//! Imagery pages: a JPEG of 258 × 258 texels; mips are made as it is decoded.

use super::error::{EncodeError, PageFault};
use super::frame::{self, Framed};
use crate::content::{IMAGERY_STORED_PX, ImageryPage, PageId, PageKind};
use crate::forest::CellId;
use image::codecs::jpeg::{JpegDecoder, JpegEncoder};
use image::{ExtendedColorType, ImageDecoder};
use std::io::Cursor;

/// What the eye does not tell from the source at 1 texel a pixel.
pub const JPEG_QUALITY: u8 = 85;

const SIDE: usize = IMAGERY_STORED_PX as usize;
const RGB_BYTES: usize = SIDE * SIDE * 3;

/// Writes RGB8 texels, rows from the north, the gutter included.
pub fn encode_imagery(cell: CellId, rgb: &[u8], quality: u8) -> Result<Vec<u8>, EncodeError> {
    if rgb.len() != RGB_BYTES {
        return Err(EncodeError::PictureSize { expected: RGB_BYTES, found: rgb.len() });
    }
    let mut jpeg = Vec::new();
    JpegEncoder::new_with_quality(&mut jpeg, quality.clamp(1, 100))
        .encode(rgb, IMAGERY_STORED_PX, IMAGERY_STORED_PX, ExtendedColorType::Rgb8)
        .map_err(|error| EncodeError::Jpeg(error.to_string()))?;
    frame::frame(PageId { cell, kind: PageKind::Imagery }, &jpeg, jpeg.len())
}

pub fn decode_imagery(page: &[u8], cell: CellId) -> Result<ImageryPage, PageFault> {
    let framed = frame::open(page)?;
    if framed.id != (PageId { cell, kind: PageKind::Imagery }) {
        return Err(PageFault::WrongPage);
    }
    decode_framed(&framed)
}

pub(super) fn decode_framed(framed: &Framed) -> Result<ImageryPage, PageFault> {
    let broken = |_| PageFault::Malformed("a picture that cannot be read");
    let decoder = JpegDecoder::new(Cursor::new(framed.body)).map_err(broken)?;
    if decoder.dimensions() != (IMAGERY_STORED_PX, IMAGERY_STORED_PX) || decoder.total_bytes() != RGB_BYTES as u64 {
        return Err(PageFault::Malformed("a picture of another size"));
    }
    let mut rgb = vec![0; RGB_BYTES];
    decoder.read_image(&mut rgb).map_err(broken)?;
    let finest = rgb.chunks_exact(3).flat_map(|texel| [texel[0], texel[1], texel[2], 255]).collect();
    Ok(ImageryPage { cell: framed.id.cell, mips: mips(finest) })
}

/// Halves down to one texel; an odd last row or column is left out, as GPUs do.
fn mips(finest: Vec<u8>) -> Vec<Vec<u8>> {
    let mut side = SIDE;
    let mut levels = vec![finest];
    while side > 1 {
        let halved = match levels.last() {
            Some(level) => halve(level, side),
            None => break,
        };
        levels.push(halved);
        side /= 2;
    }
    levels
}

/// Means of 2 × 2 texels.
fn halve(level: &[u8], side: usize) -> Vec<u8> {
    let half = side / 2;
    let mut halved = Vec::with_capacity(half * half * 4);
    for row in 0..half {
        for column in 0..half {
            let at = |x: usize, y: usize, channel: usize| {
                u32::from(level[((2 * row + y) * side + 2 * column + x) * 4 + channel])
            };
            for channel in 0..4 {
                let sum = at(0, 0, channel) + at(1, 0, channel) + at(0, 1, channel) + at(1, 1, channel);
                halved.push(((sum + 2) / 4) as u8);
            }
        }
    }
    halved
}
