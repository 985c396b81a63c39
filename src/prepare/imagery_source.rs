//! The composite picture over all imagery sources: the finest wins, with a small feather at its seams.

mod georeferenced;

use super::paint::OsmPainter;
use super::placement::overlap;
use super::raster::picture::{to_linear, to_srgb};
use super::relief::ReliefPainter;
use super::source::{SourceFile, resolve};
use super::{OnProgress, PrepareError, Progress, Recipe};
use crate::geodesy::GeoBounds;
use crate::store::SourceInfo;
use crate::units::ByteSize;
use georeferenced::GeoPicture;
use std::path::Path;

/// Anything that has a colour on the ground: a picture file, or a painter.
pub trait PictureSource: Send + Sync {
    /// Red, green, blue (sRGB) and coverage (0 nothing … 255 full) of a square of ground of side `texel_rad` (a
    /// north–south angle; as many metres east–west) about a place; none outside. Smooth for texels finer than the
    /// source's, averaged for coarser ones.
    fn color(&self, lat_rad: f64, lon_rad: f64, texel_rad: f64) -> Option<[u8; 4]>;

    /// North–south size of its finest texel.
    fn texel_rad(&self) -> f64;

    /// Where it is; none crosses the antimeridian.
    fn bounds(&self) -> Vec<GeoBounds>;

    fn info(&self) -> SourceInfo;
}

/// All imagery of a recipe as one picture; shared between threads.
pub struct Pictures {
    /// Finest first.
    sources: Vec<Placed>,
}

/// A source and where it is, which is asked for often.
struct Placed {
    source: Box<dyn PictureSource>,
    texel_rad: f64,
    bounds: Vec<GeoBounds>,
}

/// What pictures are read from; `.osm.pbf` is painted.
pub const EXTENSIONS: [&str; 6] = ["tif", "tiff", "png", "jpg", "jpeg", "pbf"];

impl Pictures {
    /// Opens every picture file of the recipe; an `.osm.pbf` is painted. Picture files are unpacked whole with their
    /// mips (4 bytes a pixel and 5 with gaps), and must together stay within `memory`.
    pub fn open(
        recipe: &Recipe,
        root: &Path,
        memory: ByteSize,
        progress: OnProgress<'_>,
    ) -> Result<Self, PrepareError> {
        let mut sources: Vec<Box<dyn PictureSource>> = Vec::new();
        let mut room = Room { left_bytes: memory.0, limit: memory };
        for section in &recipe.imagery {
            if section.heights {
                sources.push(Box::new(ReliefPainter::open(section, root, memory, progress)?));
                continue;
            }
            let files = resolve(root, &section.file, &EXTENSIONS)?;
            let total = files.len() as u64;
            let mut set = Vec::new();
            for (index, file) in files.iter().enumerate() {
                if file.has_extension(&["pbf"]) {
                    sources.push(Box::new(OsmPainter::open(section, file)?));
                } else {
                    set.push(GeoPicture::open(section, file, &mut |cols, rows| room.take(file, cols, rows))?);
                }
                progress(Progress { stage: "read imagery", item: &section.file, done: index as u64 + 1, total });
            }
            GeoPicture::join(&mut set);
            sources.extend(set.into_iter().map(|picture| Box::new(picture) as Box<dyn PictureSource>));
        }
        Ok(Self::from_sources(sources))
    }

    /// From given sources, in any order; of equally fine ones the first wins.
    pub fn from_sources(sources: Vec<Box<dyn PictureSource>>) -> Self {
        let mut sources: Vec<Placed> = sources
            .into_iter()
            .map(|source| Placed { texel_rad: source.texel_rad(), bounds: source.bounds(), source })
            .collect();
        sources.sort_by(|a, b| a.texel_rad.total_cmp(&b.texel_rad));
        Self { sources }
    }

    /// Colour (sRGB) of a square of ground of side `texel_rad` about a place; none where no source is. Finer sources
    /// lie over coarser ones by their coverage; what is only partly covered in the end counts as covered.
    pub fn color(&self, lat_rad: f64, lon_rad: f64, texel_rad: f64) -> Option<[u8; 3]> {
        let (mut light, mut left) = ([0.0f32; 3], 1.0f32);
        for placed in self.sources.iter().filter(|p| p.bounds.iter().any(|b| b.contains(lat_rad, lon_rad))) {
            let Some([r, g, b, coverage]) = placed.source.color(lat_rad, lon_rad, texel_rad) else { continue };
            if coverage == 255 && left >= 1.0 {
                return Some([r, g, b]);
            }
            let weight = left * f32::from(coverage) / 255.0;
            for (sum, byte) in light.iter_mut().zip([r, g, b]) {
                *sum += weight * to_linear(byte);
            }
            left -= weight;
            if left <= 0.0 {
                break;
            }
        }
        (left < 1.0).then(|| light.map(|sum| to_srgb(sum / (1.0 - left.max(0.0)))))
    }

    /// The finest texel of the sources that share ground (more than a border) with the bounds; none where no source is.
    pub fn finest_texel_rad(&self, bounds: &GeoBounds) -> Option<f64> {
        /// Bounds that share less than this part of a texel only touch.
        const BORDER: f64 = 0.01;
        let shares = |placed: &&Placed| placed.bounds.iter().any(|b| overlap(b, bounds, placed.texel_rad * BORDER));
        self.sources.iter().find(shares).map(|placed| placed.texel_rad)
    }

    /// What the manifest keeps of the sources; files of one section together.
    pub fn sources(&self) -> Vec<SourceInfo> {
        let mut all: Vec<SourceInfo> = Vec::new();
        for info in self.sources.iter().map(|placed| placed.source.info()) {
            match all.iter_mut().find(|other| other.kind == info.kind && other.file == info.file) {
                Some(same) => {
                    same.count += info.count;
                    same.spacing_m = same.spacing_m.min(info.spacing_m);
                }
                None => all.push(info),
            }
        }
        all
    }

    /// Where sources are; none crosses the antimeridian.
    pub fn bounds(&self) -> Vec<GeoBounds> {
        self.sources.iter().flat_map(|placed| placed.bounds.iter().copied()).collect()
    }
}

/// Memory that pictures may still take.
struct Room {
    left_bytes: u64,
    limit: ByteSize,
}

impl Room {
    fn take(&mut self, file: &SourceFile, cols: u32, rows: u32) -> Result<(), PrepareError> {
        // Three bytes, and a third more for the mips.
        let bytes = u64::from(cols) * u64::from(rows) * 4;
        self.left_bytes = self.left_bytes.checked_sub(bytes).ok_or_else(|| {
            let what = format!("{cols} × {rows} pixels take {}, more than is left of {}", ByteSize(bytes), self.limit);
            PrepareError::value(file, "its size", what, "give more --memory, or a coarser picture")
        })?;
        Ok(())
    }
}

#[cfg(test)]
mod tests;
