//! Pictures of the ground, whole in memory with their mips: PNG, JPEG and GeoTIFF.
//!
//! Averages are taken in linear light; sRGB by IEC 61966-2-1.

use super::geotiff::GeoTiff;
use crate::prepare::PrepareError;
use crate::prepare::source::SourceFile;
use std::sync::LazyLock;
use tiff::ColorType;
use tiff::decoder::DecodingResult;

/// One level of a picture: rows from the north.
pub struct Level {
    pub cols: u32,
    pub rows: u32,
    rgb: Vec<u8>,
    /// Coverage, 0 nothing … 255 full; none where all is covered.
    coverage: Option<Vec<u8>>,
}

/// A picture and its mips, each half as large.
pub struct Picture {
    pub levels: Vec<Level>,
    /// Whether columns wrap round the Earth.
    pub wraps: bool,
}

/// A picture that unpacks to more is refused, bytes.
const MAX_PICTURE_BYTES: u64 = 4 << 30;

/// Linear light of an sRGB byte, 0 to 1.
static LINEAR: LazyLock<[f32; 256]> = LazyLock::new(|| {
    std::array::from_fn(|i| {
        let s = i as f32 / 255.0;
        if s <= 0.040_45 { s / 12.92 } else { ((s + 0.055) / 1.055).powf(2.4) }
    })
});

/// Steps of [`SRGB`].
const SRGB_STEPS: usize = 4096;

/// sRGB bytes by linear light.
static SRGB: LazyLock<Vec<u8>> = LazyLock::new(|| {
    (0..=SRGB_STEPS)
        .map(|i| {
            let l = i as f32 / SRGB_STEPS as f32;
            let s = if l <= 0.003_130_8 { l * 12.92 } else { 1.055 * l.powf(1.0 / 2.4) - 0.055 };
            (s * 255.0).round() as u8
        })
        .collect()
});

/// Linear light and its coverage (premultiplied): what is added up in averages.
#[derive(Clone, Copy, Debug, Default)]
pub struct Light {
    rgb: [f32; 3],
    coverage: f32,
}

impl Light {
    pub fn add(&mut self, other: Self, weight: f32) {
        for (sum, value) in self.rgb.iter_mut().zip(other.rgb) {
            *sum += value * weight;
        }
        self.coverage += other.coverage * weight;
    }

    /// sRGB and coverage, given the weights' sum.
    pub fn to_rgba(self, weights: f32) -> [u8; 4] {
        if self.coverage <= 0.0 || weights <= 0.0 {
            return [0; 4];
        }
        let [r, g, b] = self.rgb.map(|v| to_srgb(v / self.coverage));
        [r, g, b, (self.coverage / weights * 255.0).round() as u8]
    }
}

/// Linear light of an sRGB byte.
pub fn to_linear(byte: u8) -> f32 {
    LINEAR[usize::from(byte)]
}

/// The sRGB byte of linear light.
pub fn to_srgb(linear: f32) -> u8 {
    SRGB[(linear.clamp(0.0, 1.0) * SRGB_STEPS as f32).round() as usize]
}

impl Level {
    fn light(&self, col: u32, row: u32) -> Light {
        let index = (row * self.cols + col) as usize;
        let coverage = self.coverage.as_ref().map_or(1.0, |c| f32::from(c[index]) / 255.0);
        let rgb = [0, 1, 2].map(|band| to_linear(self.rgb[index * 3 + band]) * coverage);
        Light { rgb, coverage }
    }

    fn halved(&self) -> Self {
        let (cols, rows) = (self.cols.div_ceil(2), self.rows.div_ceil(2));
        let mut rgb = Vec::with_capacity((cols * rows) as usize * 3);
        let mut coverage = self.coverage.as_ref().map(|_| Vec::with_capacity((cols * rows) as usize));
        for row in 0..rows {
            for col in 0..cols {
                let mut sum = Light::default();
                for (dy, dx) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                    sum.add(self.light((col * 2 + dx).min(self.cols - 1), (row * 2 + dy).min(self.rows - 1)), 1.0);
                }
                let [r, g, b, a] = sum.to_rgba(4.0);
                rgb.extend([r, g, b]);
                if let Some(coverage) = &mut coverage {
                    coverage.push(a);
                }
            }
        }
        Self { cols, rows, rgb, coverage }
    }
}

impl Picture {
    fn new(base: Level, wraps: bool) -> Self {
        let mut levels = vec![base];
        while let Some(last) = levels.last().filter(|l| l.cols > 1 && l.rows > 1) {
            levels.push(last.halved());
        }
        Self { levels, wraps }
    }

    /// Adds the bilinear colour at a place, in texels of level 0 (whole at their centres), of a mip.
    pub fn add(&self, sum: &mut Light, mip: usize, col: f64, row: f64) {
        let Some(level) = self.levels.get(mip.min(self.levels.len() - 1)) else { return };
        let scale = (1u64 << mip.min(self.levels.len() - 1)) as f64;
        let (x, y) = ((col + 0.5) / scale - 0.5, (row + 0.5) / scale - 0.5);
        let (x0, y0) = (x.floor(), y.floor());
        let (s, t) = ((x - x0) as f32, (y - y0) as f32);
        let column = |c: i64| {
            let cols = i64::from(level.cols);
            (if self.wraps { c.rem_euclid(cols) } else { c.clamp(0, cols - 1) }) as u32
        };
        let line = |r: i64| r.clamp(0, i64::from(level.rows) - 1) as u32;
        let (cols, rows) = ([column(x0 as i64), column(x0 as i64 + 1)], [line(y0 as i64), line(y0 as i64 + 1)]);
        for (j, wy) in [(0, 1.0 - t), (1, t)] {
            for (i, wx) in [(0, 1.0 - s), (1, s)] {
                if wx * wy > 0.0 {
                    sum.add(level.light(cols[i], rows[j]), wx * wy);
                }
            }
        }
    }

    pub fn cols(&self) -> u32 {
        self.levels[0].cols
    }

    pub fn rows(&self) -> u32 {
        self.levels[0].rows
    }
}

/// Reads a PNG or JPEG. `wraps`: it goes all the way round the Earth.
pub fn read_plain(file: &SourceFile, wraps: bool) -> Result<Picture, PrepareError> {
    let damaged = |e: image::ImageError| PrepareError::damaged(file, "picture", e);
    let mut reader = image::ImageReader::new(std::io::BufReader::new(file.open()?))
        .with_guessed_format()
        .map_err(|e| PrepareError::damaged(file, "header", e))?;
    let mut limits = image::Limits::default();
    limits.max_alloc = Some(MAX_PICTURE_BYTES);
    reader.limits(limits);
    let decoded = reader.decode().map_err(damaged)?;
    let (cols, rows) = (decoded.width(), decoded.height());
    if cols < 2 || rows < 2 {
        return Err(PrepareError::damaged(file, "picture", format!("{cols} × {rows} pixels")));
    }
    let (rgb, coverage) = if decoded.color().has_alpha() {
        let (rgb, alpha) = split_alpha(decoded.into_rgba8().as_raw());
        (rgb, alpha.iter().any(|&a| a < 255).then_some(alpha))
    } else {
        (decoded.into_rgb8().into_raw(), None)
    };
    Ok(Picture::new(Level { cols, rows, rgb, coverage }, wraps))
}

fn split_alpha(rgba: &[u8]) -> (Vec<u8>, Vec<u8>) {
    let rgb = rgba.chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]]).collect();
    (rgb, rgba.chunks_exact(4).map(|p| p[3]).collect())
}

/// Width and height without decoding.
pub fn plain_size(file: &SourceFile) -> Result<(u32, u32), PrepareError> {
    image::ImageReader::new(std::io::BufReader::new(file.open()?))
        .with_guessed_format()
        .map_err(|e| PrepareError::damaged(file, "header", e))?
        .into_dimensions()
        .map_err(|e| PrepareError::damaged(file, "header", e))
}

/// Reads all chunks of a TIFF with 8- or 16-bit grey or colour; pixels with `nodata` in all bands are empty.
pub fn read_tiff(tiff: &GeoTiff, nodata: Option<f64>, wraps: bool) -> Result<Picture, PrepareError> {
    let layout = tiff.layout;
    let texels = u64::from(layout.rows) * u64::from(layout.cols);
    if texels * 4 > MAX_PICTURE_BYTES {
        let remedy = "cut it into tiles and give their folder";
        return Err(PrepareError::unsupported(tiff.file(), "header", format!("a picture of {texels} pixels"), remedy));
    }
    let bands = Bands::of(tiff)?;
    let mut level = Level {
        cols: layout.cols,
        rows: layout.rows,
        rgb: vec![0; texels as usize * 3],
        coverage: (bands.alpha.is_some() || nodata.is_some() || tiff.has_gaps()).then(|| vec![255; texels as usize]),
    };
    for block in 0..layout.blocks() {
        bands.read_block(tiff, block, nodata, &mut level)?;
    }
    if level.coverage.as_ref().is_some_and(|c| c.iter().all(|&a| a == 255)) {
        level.coverage = None;
    }
    Ok(Picture::new(level, wraps))
}

/// Which samples of a pixel are red, green, blue and coverage.
struct Bands {
    rgb: [usize; 3],
    alpha: Option<usize>,
    ycbcr: bool,
    count: usize,
}

impl Bands {
    fn of(tiff: &GeoTiff) -> Result<Self, PrepareError> {
        let count = usize::from(tiff.bands.max(1));
        let plain = |rgb, alpha, ycbcr| Ok(Self { rgb, alpha, ycbcr, count });
        match tiff.color {
            ColorType::Gray(8 | 16) => plain([0; 3], None, false),
            ColorType::GrayA(8 | 16) => plain([0; 3], Some(1), false),
            ColorType::RGB(8 | 16) => plain([0, 1, 2], None, false),
            ColorType::RGBA(8 | 16) => plain([0, 1, 2], Some(3), false),
            ColorType::YCbCr(8) => plain([0, 1, 2], None, true),
            ColorType::Multiband { bit_depth: 8 | 16, num_samples } if num_samples >= 3 => {
                plain([0, 1, 2], None, false)
            }
            ColorType::Multiband { bit_depth: 8 | 16, .. } => plain([0; 3], None, false),
            other => {
                let what = format!("a picture of kind {other:?}");
                Err(PrepareError::unsupported(
                    tiff.file(),
                    "header",
                    what,
                    "convert it with gdal_translate -expand rgb -ot Byte",
                ))
            }
        }
    }

    fn read_block(
        &self,
        tiff: &GeoTiff,
        block: u32,
        nodata: Option<f64>,
        level: &mut Level,
    ) -> Result<(), PrepareError> {
        let extent = tiff.layout.extent(block);
        let pixels = (extent.rows * extent.cols) as usize;
        if tiff.is_left_out(block) {
            for row in extent.row..extent.row + extent.rows {
                let at = (row * level.cols + extent.col) as usize;
                if let Some(coverage) = &mut level.coverage {
                    coverage[at..at + extent.cols as usize].fill(0);
                }
            }
            return Ok(());
        }
        // Bands interleaved, or each from its own plane.
        let planes = if tiff.planar { self.count } else { 1 };
        let samples: Vec<Vec<u8>> = (0..planes)
            .map(|plane| bytes(tiff, tiff.chunk(block + plane as u32 * tiff.layout.blocks())?))
            .collect::<Result<_, _>>()?;
        let stride = if tiff.planar { 1 } else { self.count };
        let enough = samples.iter().all(|s| s.len() >= pixels * stride);
        if !enough {
            return Err(PrepareError::damaged(tiff.file(), format!("row {}", extent.row), "too few samples"));
        }
        let sample = |pixel: usize, band: usize| {
            if tiff.planar { samples[band][pixel] } else { samples[0][pixel * stride + band] }
        };
        for pixel in 0..pixels {
            let (r, c) = (pixel as u32 / extent.cols, pixel as u32 % extent.cols);
            let at = ((extent.row + r) * level.cols + extent.col + c) as usize;
            let raw = self.rgb.map(|band| sample(pixel, band));
            let rgb = if self.ycbcr { from_ycbcr(raw) } else { raw };
            level.rgb[at * 3..at * 3 + 3].copy_from_slice(&rgb);
            if let Some(coverage) = &mut level.coverage {
                let empty = nodata.is_some_and(|n| raw.iter().all(|&v| f64::from(v) == n));
                coverage[at] = if empty { 0 } else { self.alpha.map_or(255, |band| sample(pixel, band)) };
            }
        }
        Ok(())
    }
}

fn bytes(tiff: &GeoTiff, samples: DecodingResult) -> Result<Vec<u8>, PrepareError> {
    match samples {
        DecodingResult::U8(v) => Ok(v),
        DecodingResult::U16(v) => Ok(v.into_iter().map(|s| (s >> 8) as u8).collect()),
        _ => {
            Err(PrepareError::unsupported(tiff.file(), "samples", "this kind of picture samples", "convert it to Byte"))
        }
    }
}

/// JFIF 1.02: full-range BT.601.
fn from_ycbcr([y, cb, cr]: [u8; 3]) -> [u8; 3] {
    let (y, cb, cr) = (f32::from(y), f32::from(cb) - 128.0, f32::from(cr) - 128.0);
    [y + 1.402 * cr, y - 0.344_136 * cb - 0.714_136 * cr, y + 1.772 * cb].map(|v| v.round().clamp(0.0, 255.0) as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_and_bytes_are_inverse() {
        for byte in 0..=255u8 {
            assert!(to_srgb(to_linear(byte)).abs_diff(byte) <= 1, "{byte}");
        }
    }

    #[test]
    fn mips_average_in_linear_light_and_leave_out_what_is_empty() {
        let rgb = [0u8, 255, 255, 0].iter().flat_map(|&v| [v; 3]).collect();
        let level = Level { cols: 2, rows: 2, rgb, coverage: None };
        assert_eq!(level.halved().rgb, [188; 3]);
        let rgb = [0u8, 255, 255, 0].iter().flat_map(|&v| [v; 3]).collect();
        let half = Level { cols: 2, rows: 2, rgb, coverage: Some(vec![0, 255, 255, 0]) }.halved();
        assert_eq!((half.rgb, half.coverage), (vec![255; 3], Some(vec![128])));
    }

    #[test]
    fn ycbcr_by_jfif() {
        assert_eq!(from_ycbcr([128, 128, 128]), [128; 3]);
        assert_eq!(from_ycbcr([76, 85, 255]), [254, 0, 0]);
    }
}
