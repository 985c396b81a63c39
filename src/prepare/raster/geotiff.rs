//! GeoTIFF: strips and tiles, decoded one chunk at a time.

use super::blocks::{Block, BlockLayout, BlockReader};
use super::georeference::GeoTags;
use super::samples::{Conditions, SampleKind, block_of, block_of_i16};
use crate::prepare::PrepareError;
use crate::prepare::crs::Affine;
use crate::prepare::source::{ReadSeek, SourceFile};
use std::io::Cursor;
use std::sync::{Arc, Mutex, PoisonError};
use tiff::decoder::{ChunkType, Decoder, DecodingResult, Limits};
use tiff::tags::{SampleFormat, Tag};
use tiff::{ColorType, TiffError};

type TiffReader = Decoder<Box<dyn ReadSeek>>;

/// An open TIFF; decoders are made as threads need them.
pub struct GeoTiff {
    file: SourceFile,
    /// Bytes of one that lies in a .zip.
    unpacked: Option<Arc<Vec<u8>>>,
    idle: Mutex<Vec<TiffReader>>,
    pub layout: BlockLayout,
    pub kind: SampleKind,
    pub color: ColorType,
    /// Bands that lie apart, one plane after the other.
    pub planar: bool,
    pub bands: u16,
    /// GDAL's tag.
    pub nodata: Option<f64>,
    pub geo: GeoTags,
    /// Chunks that the file leaves out (sparse files): they have no data.
    left_out: Vec<bool>,
}

/// A chunk that unpacks to more is refused, bytes.
const MAX_CHUNK_BYTES: usize = 2 << 30;

/// Decoders kept for reuse.
const MAX_IDLE: usize = 16;

impl GeoTiff {
    pub fn open(file: &SourceFile) -> Result<Self, PrepareError> {
        let unpacked = match file.inside {
            Some(_) => Some(Arc::new(file.read()?)),
            None => None,
        };
        let mut decoder = new_decoder(file, unpacked.as_ref())?;
        let damaged = |e: TiffError| PrepareError::damaged(file, "TIFF header", e);
        let (cols, rows) = decoder.dimensions().map_err(damaged)?;
        let color = decoder.colortype().map_err(|e| {
            PrepareError::value(
                file,
                "TIFF header",
                e,
                "convert it with gdal_translate (-expand rgb takes palettes away)",
            )
        })?;
        let (block_cols, block_rows) = decoder.chunk_dimensions();
        if cols < 2 || rows < 2 || block_cols == 0 || block_rows == 0 {
            return Err(PrepareError::damaged(file, "TIFF header", format!("{cols} × {rows} samples")));
        }
        let layout = BlockLayout { rows, cols, block_rows: block_rows.min(rows), block_cols: block_cols.min(cols) };
        let kind = sample_kind(file, &mut decoder)?;
        let planar = decoder.find_tag_unsigned::<u16>(Tag::PlanarConfiguration).map_err(damaged)? == Some(2);
        let bands = decoder.find_tag_unsigned::<u16>(Tag::SamplesPerPixel).map_err(damaged)?.unwrap_or(1);
        let tiff = Self {
            layout,
            kind,
            color,
            planar,
            bands,
            nodata: gdal_nodata(&mut decoder),
            geo: geo_tags(&mut decoder),
            left_out: left_out(&mut decoder),
            file: file.clone(),
            unpacked,
            idle: Mutex::new(Vec::new()),
        };
        tiff.check_chunks(&mut decoder)?;
        tiff.put_back(decoder);
        Ok(tiff)
    }

    fn check_chunks(&self, decoder: &mut TiffReader) -> Result<(), PrepareError> {
        let count = match decoder.get_chunk_type() {
            ChunkType::Strip => decoder.strip_count(),
            ChunkType::Tile => decoder.tile_count(),
        }
        .map_err(|e| PrepareError::damaged(&self.file, "TIFF header", e))?;
        let needed = self.layout.blocks() * if self.planar { u32::from(self.bands) } else { 1 };
        if count < needed {
            let what = format!("{count} chunks instead of {needed}");
            return Err(PrepareError::damaged(&self.file, "TIFF header", what));
        }
        Ok(())
    }

    /// Samples' places; none without georeference.
    pub fn affine(&self) -> Option<Affine> {
        self.geo.affine()
    }

    /// Whether the file leaves a chunk out.
    pub fn is_left_out(&self, index: u32) -> bool {
        self.left_out.get(index as usize).copied().unwrap_or(false)
    }

    pub fn has_gaps(&self) -> bool {
        self.left_out.contains(&true)
    }

    /// All samples of a chunk, bands interleaved (or one plane's).
    pub fn chunk(&self, index: u32) -> Result<DecodingResult, PrepareError> {
        let mut decoder = match self.idle.lock().unwrap_or_else(PoisonError::into_inner).pop() {
            Some(decoder) => decoder,
            None => new_decoder(&self.file, self.unpacked.as_ref())?,
        };
        let extent = self.layout.extent(index % self.layout.blocks());
        let samples = decoder.read_chunk(index).map_err(|e| {
            let place = format!(
                "rows {} to {}, columns {} to {}",
                extent.row,
                extent.row + extent.rows - 1,
                extent.col,
                extent.col + extent.cols - 1
            );
            match e {
                TiffError::UnsupportedError(what) => PrepareError::unsupported(
                    &self.file,
                    place,
                    what,
                    "convert it with gdal_translate -co COMPRESS=DEFLATE",
                ),
                other => PrepareError::damaged(&self.file, place, other),
            }
        })?;
        self.put_back(decoder);
        Ok(samples)
    }

    fn put_back(&self, decoder: TiffReader) {
        let mut idle = self.idle.lock().unwrap_or_else(PoisonError::into_inner);
        if idle.len() < MAX_IDLE {
            idle.push(decoder);
        }
    }

    pub fn file(&self) -> &SourceFile {
        &self.file
    }
}

fn new_decoder(file: &SourceFile, unpacked: Option<&Arc<Vec<u8>>>) -> Result<TiffReader, PrepareError> {
    let reader: Box<dyn ReadSeek> = match unpacked {
        Some(bytes) => Box::new(Cursor::new(SharedBytes(bytes.clone()))),
        None => file.open()?,
    };
    let mut limits = Limits::default();
    limits.decoding_buffer_size = MAX_CHUNK_BYTES;
    limits.intermediate_buffer_size = MAX_CHUNK_BYTES;
    limits.ifd_value_size = 64 << 20;
    let decoder = Decoder::new(reader).map_err(|e| PrepareError::damaged(file, "TIFF header", e))?;
    Ok(decoder.with_limits(limits))
}

/// Bytes that several decoders read.
struct SharedBytes(Arc<Vec<u8>>);

impl AsRef<[u8]> for SharedBytes {
    fn as_ref(&self) -> &[u8] {
        &self.0
    }
}

fn sample_kind(file: &SourceFile, decoder: &mut TiffReader) -> Result<SampleKind, PrepareError> {
    let damaged = |e: TiffError| PrepareError::damaged(file, "TIFF header", e);
    let bits = decoder.find_tag_unsigned_vec::<u16>(Tag::BitsPerSample).map_err(damaged)?.unwrap_or_default();
    let formats = decoder.find_tag_unsigned_vec::<u16>(Tag::SampleFormat).map_err(damaged)?.unwrap_or_default();
    let format = formats.first().map_or(SampleFormat::Uint, |&f| SampleFormat::from_u16_exhaustive(f));
    match (format, bits.first().copied().unwrap_or(1)) {
        (SampleFormat::Uint, 8) => Ok(SampleKind::U8),
        (SampleFormat::Int, 8) => Ok(SampleKind::I8),
        (SampleFormat::Uint, 16) => Ok(SampleKind::U16),
        (SampleFormat::Int, 16) => Ok(SampleKind::I16),
        (SampleFormat::Uint, 32) => Ok(SampleKind::U32),
        (SampleFormat::Int, 32) => Ok(SampleKind::I32),
        (SampleFormat::IEEEFP, 32) => Ok(SampleKind::F32),
        (SampleFormat::IEEEFP, 64) => Ok(SampleKind::F64),
        (format, bits) => {
            let what = format!("samples of {bits} bits ({format:?})");
            Err(PrepareError::unsupported(file, "TIFF header", what, "convert it with gdal_translate -ot Float32"))
        }
    }
}

fn left_out(decoder: &mut TiffReader) -> Vec<bool> {
    let tag = match decoder.get_chunk_type() {
        ChunkType::Strip => Tag::StripByteCounts,
        ChunkType::Tile => Tag::TileByteCounts,
    };
    decoder.get_tag_u64_vec(tag).unwrap_or_default().into_iter().map(|bytes| bytes == 0).collect()
}

fn gdal_nodata(decoder: &mut TiffReader) -> Option<f64> {
    let text = decoder.get_tag_ascii_string(Tag::GdalNodata).ok()?;
    text.trim_matches(|c: char| c.is_whitespace() || c == '\0').parse().ok()
}

fn geo_tags(decoder: &mut TiffReader) -> GeoTags {
    GeoTags {
        pixel_scale: decoder.get_tag_f64_vec(Tag::ModelPixelScaleTag).unwrap_or_default(),
        tiepoint: decoder.get_tag_f64_vec(Tag::ModelTiepointTag).unwrap_or_default(),
        transformation: decoder.get_tag_f64_vec(Tag::ModelTransformationTag).unwrap_or_default(),
        key_directory: decoder.get_tag_u16_vec(Tag::GeoKeyDirectoryTag).unwrap_or_default(),
        double_params: decoder.get_tag_f64_vec(Tag::GeoDoubleParamsTag).unwrap_or_default(),
        ascii_params: decoder.get_tag_ascii_string(Tag::GeoAsciiParamsTag).unwrap_or_default(),
    }
}

/// Heights of the first band.
pub struct TiffHeights {
    tiff: GeoTiff,
    conditions: Conditions,
}

impl TiffHeights {
    /// `nodata` of the recipe overrides the file's.
    pub fn new(tiff: GeoTiff, mut conditions: Conditions) -> Result<Self, PrepareError> {
        tiff.kind.check_nodata(conditions.nodata, &tiff.file.to_string())?;
        conditions.nodata = conditions.nodata.or(tiff.nodata);
        Ok(Self { tiff, conditions })
    }
}

impl BlockReader for TiffHeights {
    fn layout(&self) -> BlockLayout {
        self.tiff.layout
    }

    fn read(&self, index: u32) -> Result<Block, PrepareError> {
        let extent = self.tiff.layout.extent(index);
        let count = (extent.rows * extent.cols) as usize;
        if self.tiff.is_left_out(index) {
            return Ok(Block::F32(vec![f32::NAN; count]));
        }
        let samples = self.tiff.chunk(index)?;
        let stride = if self.tiff.planar { 1 } else { usize::from(self.tiff.bands.max(1)) };
        let conditions = &self.conditions;
        fn first_band<T: Copy>(samples: &[T], stride: usize, count: usize) -> impl Iterator<Item = T> {
            samples.iter().step_by(stride).take(count).copied()
        }
        let block = match &samples {
            DecodingResult::I16(s) => block_of_i16(first_band(s, stride, count).collect(), conditions),
            DecodingResult::U8(s) => block_of(first_band(s, stride, count).map(f64::from), conditions),
            DecodingResult::I8(s) => block_of(first_band(s, stride, count).map(f64::from), conditions),
            DecodingResult::U16(s) => block_of(first_band(s, stride, count).map(f64::from), conditions),
            DecodingResult::U32(s) => block_of(first_band(s, stride, count).map(f64::from), conditions),
            DecodingResult::I32(s) => block_of(first_band(s, stride, count).map(f64::from), conditions),
            DecodingResult::F32(s) => block_of(first_band(s, stride, count).map(f64::from), conditions),
            DecodingResult::F64(s) => block_of(first_band(s, stride, count), conditions),
            _ => {
                let what = "this kind of samples";
                return Err(PrepareError::unsupported(&self.tiff.file, "samples", what, "convert it to Float32"));
            }
        }
        .map_err(|bad| {
            let (row, col) = (bad.index as u32 / extent.cols, bad.index as u32 % extent.cols);
            bad.into_error(&self.tiff.file.to_string(), extent.row + row, extent.col + col)
        })?;
        if block.len() != count {
            let what = format!("{} samples instead of {count}", block.len());
            return Err(PrepareError::damaged(&self.tiff.file, format!("row {}", extent.row), what));
        }
        Ok(block)
    }
}
