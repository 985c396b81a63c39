//! Tiny made-up files for tests.

use std::fs::File;
use std::path::{Path, PathBuf};
use tiff::encoder::colortype::{Gray8, Gray16, Gray32, Gray32Float, Gray64Float, GrayI8, GrayI16, GrayI32};
use tiff::encoder::{Compression, DeflateLevel, Predictor, TiffEncoder, TiffValue, colortype::ColorType};
use tiff::tags::Tag;

/// A TIFF to be written.
pub struct TiffOf<T> {
    cols: u32,
    rows: u32,
    samples: Vec<T>,
    place: Option<(f64, f64, f64)>,
    raster_type: u16,
    crs_key: (u16, u16),
    nodata: Option<&'static str>,
    pub compression: Compression,
    pub predictor: Predictor,
    pub strip_rows: Option<u32>,
}

impl<T> TiffOf<T> {
    pub fn new(cols: u32, rows: u32, samples: Vec<T>) -> Self {
        Self {
            cols,
            rows,
            samples,
            place: None,
            raster_type: 1,
            crs_key: (2048, 4326),
            nodata: None,
            compression: Compression::Uncompressed,
            predictor: Predictor::None,
            strip_rows: None,
        }
    }

    /// Pixel is point: the first post at (west, north), degrees.
    pub fn point(mut self, west: f64, north: f64, step: f64) -> Self {
        (self.place, self.raster_type) = (Some((west, north, step)), 2);
        self
    }

    /// Pixel is area: the first pixel's corner at (west, north), degrees.
    pub fn area(mut self, west: f64, north: f64, step: f64) -> Self {
        (self.place, self.raster_type) = (Some((west, north, step)), 1);
        self
    }

    pub fn strips_of(mut self, rows: u32) -> Self {
        self.strip_rows = Some(rows);
        self
    }

    pub fn nodata(mut self, text: &'static str) -> Self {
        self.nodata = Some(text);
        self
    }

    /// Names the system by a key; 3072 is for projected ones.
    pub fn epsg(mut self, key: u16, code: u16) -> Self {
        self.crs_key = (if key == 1024 { 2048 } else { key }, code);
        self
    }
}

/// Samples that the encoder has a grey kind for.
pub trait Grey: Copy {
    type Kind: ColorType<Inner = Self>;
}

macro_rules! grey {
    ($($sample:ty: $kind:ty),*) => { $(impl Grey for $sample { type Kind = $kind; })* };
}

grey!(u8: Gray8, i8: GrayI8, u16: Gray16, i16: GrayI16, u32: Gray32, i32: GrayI32, f32: Gray32Float, f64: Gray64Float);

impl<T: Grey> TiffOf<T>
where
    [T]: TiffValue,
{
    pub fn write(self, folder: &Path, name: &str) {
        self.write_as::<T::Kind>(folder, name);
    }
}

impl<T> TiffOf<T>
where
    [T]: TiffValue,
{
    /// As another colour type, such as RGB8.
    pub fn write_as<C: ColorType<Inner = T>>(self, folder: &Path, name: &str) {
        let file = File::create(folder.join(name)).expect("created");
        let mut encoder =
            TiffEncoder::new(file).expect("encoder").with_compression(self.compression).with_predictor(self.predictor);
        let mut image = encoder.new_image::<C>(self.cols, self.rows).expect("image");
        if let Some(rows) = self.strip_rows {
            image.rows_per_strip(rows).expect("strips");
        }
        let tags = image.encoder();
        if let Some((west, north, step)) = self.place {
            tags.write_tag(Tag::ModelPixelScaleTag, &[step, step, 0.0][..]).expect("tag");
            tags.write_tag(Tag::ModelTiepointTag, &[0.0, 0.0, 0.0, west, north, 0.0][..]).expect("tag");
            let model = if self.crs_key.0 == 3072 { 1 } else { 2 };
            let keys =
                [1, 1, 0, 3, 1024, 0, 1, model, 1025, 0, 1, self.raster_type, self.crs_key.0, 0, 1, self.crs_key.1];
            tags.write_tag(Tag::GeoKeyDirectoryTag, &keys[..]).expect("tag");
        }
        if let Some(text) = self.nodata {
            tags.write_tag(Tag::GdalNodata, text).expect("tag");
        }
        image.write_data(&self.samples).expect("written");
    }
}

type Write = fn(&[f64], &Path, &str);

/// Writers of 4 × 3 posts of every kind of samples, and of every compression that the encoder has.
pub fn every_kind() -> Vec<(&'static str, Write)> {
    macro_rules! kind {
        ($name:literal, $sample:ty) => {
            kind!($name, $sample, Compression::Uncompressed, Predictor::None)
        };
        ($name:literal, $sample:ty, $compression:expr, $predictor:expr) => {
            (
                $name,
                (|values, folder, name| {
                    let samples = values.iter().map(|&v| v as $sample).collect();
                    let mut tiff = TiffOf::new(4, 3, samples).point(0.0, 10.0, 1.0);
                    (tiff.compression, tiff.predictor, tiff.strip_rows) = ($compression, $predictor, Some(2));
                    tiff.write(folder, name);
                }) as Write,
            )
        };
    }
    vec![
        kind!("u8.tif", u8),
        kind!("i8.tif", i8),
        kind!("u16.tif", u16),
        kind!("i16.tif", i16),
        kind!("u32.tif", u32),
        kind!("i32.tif", i32),
        kind!("f32.tif", f32),
        kind!("f64.tif", f64),
        kind!("deflate.tif", f32, Compression::Deflate(DeflateLevel::Balanced), Predictor::None),
        kind!("lzw.tif", i16, Compression::Lzw, Predictor::None),
        kind!("packbits.tif", u16, Compression::Packbits, Predictor::None),
        kind!("deflate-2.tif", i16, Compression::Deflate(DeflateLevel::Balanced), Predictor::Horizontal),
        kind!("lzw-2.tif", u16, Compression::Lzw, Predictor::Horizontal),
    ]
}

/// Makes the last strip's offset lie near the file's end: the header is sound, the samples are cut off.
pub fn point_strips_beyond_the_end(bytes: &mut [u8]) {
    const STRIP_OFFSETS: u16 = 273;
    let end = bytes.len() as u32 - 8;
    set_last(bytes, STRIP_OFFSETS, end);
}

/// As GDAL writes sparse files: no offset, no bytes.
pub fn leave_last_strip_out(bytes: &mut [u8]) {
    const STRIP_OFFSETS: u16 = 273;
    const STRIP_BYTE_COUNTS: u16 = 279;
    set_last(bytes, STRIP_OFFSETS, 0);
    set_last(bytes, STRIP_BYTE_COUNTS, 0);
}

/// Overwrites the last of a tag's u32 values in a little-endian TIFF.
fn set_last(bytes: &mut [u8], tag: u16, value: u32) {
    let word = |b: &[u8], at: usize| u32::from_le_bytes([b[at], b[at + 1], b[at + 2], b[at + 3]]) as usize;
    let directory = word(bytes, 4);
    let entries = usize::from(u16::from_le_bytes([bytes[directory], bytes[directory + 1]]));
    let entry = (0..entries)
        .map(|i| directory + 2 + i * 12)
        .find(|&at| u16::from_le_bytes([bytes[at], bytes[at + 1]]) == tag)
        .expect("tag");
    let count = word(bytes, entry + 4);
    let at = if count == 1 { entry + 8 } else { word(bytes, entry + 8) + 4 * (count - 1) };
    bytes[at..at + 4].copy_from_slice(&value.to_le_bytes());
}

/// The project's shared real data, if it is here.
pub fn shared(folder: &str) -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data").join(folder);
    if !path.exists() {
        println!("skipped: ../shared/data is not here");
        return None;
    }
    Some(path)
}
