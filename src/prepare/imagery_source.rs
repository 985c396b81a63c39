//! The composite picture over all imagery sources.

use super::{OnProgress, PrepareError, Recipe};
use crate::geodesy::GeoBounds;
use crate::store::SourceInfo;
use crate::units::ByteSize;
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
    sources: Vec<Box<dyn PictureSource>>,
}

impl Pictures {
    /// Opens every picture file of the recipe; an `.osm.pbf` is painted.
    pub fn open(
        _recipe: &Recipe,
        _root: &Path,
        _memory: ByteSize,
        _progress: OnProgress<'_>,
    ) -> Result<Self, PrepareError> {
        todo!()
    }

    /// From given sources, in any order.
    pub fn from_sources(mut sources: Vec<Box<dyn PictureSource>>) -> Self {
        sources.sort_by(|a, b| a.texel_rad().total_cmp(&b.texel_rad()));
        Self { sources }
    }

    /// Colour (sRGB) of a square of ground of side `texel_rad` about a place; none where no source is.
    pub fn color(&self, _lat_rad: f64, _lon_rad: f64, _texel_rad: f64) -> Option<[u8; 3]> {
        todo!()
    }

    /// The finest texel of the sources that meet the bounds; none where no source is.
    pub fn finest_texel_rad(&self, bounds: &GeoBounds) -> Option<f64> {
        let meets = |source: &&Box<dyn PictureSource>| source.bounds().iter().any(|b| b.intersects(bounds));
        self.sources.iter().find(meets).map(|source| source.texel_rad())
    }

    /// What the manifest keeps of the sources.
    pub fn sources(&self) -> Vec<SourceInfo> {
        self.sources.iter().map(|source| source.info()).collect()
    }

    /// Where sources are; none crosses the antimeridian.
    pub fn bounds(&self) -> Vec<GeoBounds> {
        self.sources.iter().flat_map(|source| source.bounds()).collect()
    }
}
