//! Pictures on disk: colours as PNG, ids and depth as NumPy arrays.

use super::flight::{RecordError, write_file};
use image::{ExtendedColorType, ImageEncoder, codecs::png};
use std::path::Path;

/// Name of the picture of a time, less its ending: `t0012.00`; more digits where frames are closer than 1/100 s.
///
/// ```
/// # use stoop::record::picture_name;
/// assert_eq!(picture_name(12.0, 1.0), "t0012.00");
/// assert_eq!(picture_name(1.0 / 240.0, 1.0 / 240.0), "t0000.0042");
/// ```
pub fn picture_name(t_s: f64, step_s: f64) -> String {
    if step_s < 0.01 { format!("t{t_s:09.4}") } else { format!("t{t_s:07.2}") }
}

/// Writes RGBA8 rows from the top as an RGB picture.
pub fn write_png(file: &Path, size_px: [u32; 2], rgba: &[u8]) -> Result<(), RecordError> {
    let bytes = png_bytes(size_px, rgba)
        .map_err(|error| RecordError::Encode { file: file.to_owned(), cause: error.to_string() })?;
    write_file(file, bytes)
}

/// RGBA8 rows from the top as a PNG without its alpha.
pub fn png_bytes(size_px: [u32; 2], rgba: &[u8]) -> Result<Vec<u8>, image::ImageError> {
    let rgb: Vec<u8> = rgba.chunks_exact(4).flat_map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect();
    let mut bytes = Vec::new();
    png::PngEncoder::new_with_quality(&mut bytes, png::CompressionType::Fast, png::FilterType::Adaptive).write_image(
        &rgb,
        size_px[0],
        size_px[1],
        ExtendedColorType::Rgb8,
    )?;
    Ok(bytes)
}

/// Writes a text file whole or not at all.
pub fn write_text(file: &Path, text: &str) -> Result<(), RecordError> {
    write_file(file, text)
}

/// Numbers that NumPy reads.
pub trait NpyScalar: bytemuck::NoUninit {
    const DESCRIPTION: &'static str;
}

impl NpyScalar for u32 {
    const DESCRIPTION: &'static str = "<u4";
}

impl NpyScalar for f32 {
    const DESCRIPTION: &'static str = "<f4";
}

/// Writes an array of height × width numbers, rows from the top (NumPy format 1.0, little-endian).
pub fn write_npy<T: NpyScalar>(file: &Path, size_px: [u32; 2], values: &[T]) -> Result<(), RecordError> {
    write_file(file, npy(size_px, values))
}

fn npy<T: NpyScalar>(size_px: [u32; 2], values: &[T]) -> Vec<u8> {
    let mut header = format!(
        "{{'descr': '{}', 'fortran_order': False, 'shape': ({}, {}), }}",
        T::DESCRIPTION,
        size_px[1],
        size_px[0]
    );
    // Ten bytes stand before the header; together they fill lines of 64, ended by a newline.
    let padding = (64 - (10 + header.len() + 1) % 64) % 64;
    header.extend(std::iter::repeat_n(' ', padding));
    header.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend_from_slice(&(header.len() as u16).to_le_bytes());
    bytes.extend_from_slice(header.as_bytes());
    if cfg!(target_endian = "little") {
        bytes.extend_from_slice(bytemuck::cast_slice(values));
    } else {
        for value in values {
            bytes.extend(bytemuck::bytes_of(value).iter().rev());
        }
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_array_starts_on_a_line_of_64_bytes() {
        let bytes = npy([3, 2], &[1u32, 2, 3, 4, 5, 6]);
        let header_len = usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
        assert_eq!((10 + header_len) % 64, 0);
        assert_eq!(&bytes[10 + header_len..][..4], [1, 0, 0, 0]);
        assert!(String::from_utf8_lossy(&bytes).contains("'shape': (2, 3)"));
    }

    #[test]
    fn a_picture_comes_back_as_it_was() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.png");
        write_png(&file, [2, 1], &[1, 2, 3, 255, 250, 251, 252, 255]).unwrap();
        let read = image::open(&file).unwrap().to_rgb8();
        assert_eq!((read.dimensions(), read.into_raw()), ((2, 1), vec![1, 2, 3, 250, 251, 252]));
    }
}
