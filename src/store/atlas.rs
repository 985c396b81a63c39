//! Atlases of pages of objects: JPEG; mips are made as they are decoded.

use super::error::{EncodeError, PageFault};
use crate::content::Atlas;
use image::codecs::jpeg::{JpegDecoder, JpegEncoder};
use image::{ExtendedColorType, ImageDecoder};
use std::io::Cursor;

/// Writes RGB8 texels, rows from the top. Sides are those of an atlas: blocks of 8 × 8 then hold one part each.
pub fn encode_atlas(width_px: u32, height_px: u32, rgb: &[u8], quality: u8) -> Result<Vec<u8>, EncodeError> {
    let expected = if Atlas::is_size(width_px, height_px) { 3 * (width_px * height_px) as usize } else { 0 };
    if expected == 0 || rgb.len() != expected {
        return Err(EncodeError::PictureSize { expected, found: rgb.len() });
    }
    let mut jpeg = Vec::new();
    JpegEncoder::new_with_quality(&mut jpeg, quality.clamp(1, 100))
        .encode(rgb, width_px, height_px, ExtendedColorType::Rgb8)
        .map_err(|error| EncodeError::Jpeg(error.to_string()))?;
    Ok(jpeg)
}

/// Reads an atlas; nothing is unpacked before its sides are known to be in bounds.
pub fn decode_atlas(jpeg: &[u8]) -> Result<Atlas, PageFault> {
    let broken = |_| PageFault::Malformed("an atlas that cannot be read");
    let unfit = PageFault::Malformed("an atlas of a size that none has");
    let decoder = JpegDecoder::new(Cursor::new(jpeg)).map_err(broken)?;
    let (width_px, height_px) = decoder.dimensions();
    let expected = 3 * u64::from(width_px) * u64::from(height_px);
    if !Atlas::is_size(width_px, height_px) || decoder.total_bytes() != expected {
        return Err(unfit);
    }
    let mut rgb = vec![0; expected as usize];
    decoder.read_image(&mut rgb).map_err(broken)?;
    Atlas::new(width_px, height_px, &rgb).ok_or(unfit)
}
