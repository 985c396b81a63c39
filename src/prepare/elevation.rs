//! The composite truth over all elevation sources (the finest source outside its feather, the stated blend inside,
//! bilinear, above the ellipsoid).

use super::{OnProgress, PrepareError, Recipe};
use crate::geodesy::GeoBounds;
use crate::store::SourceInfo;
use crate::units::ByteSize;
use std::path::Path;

/// All elevation of a recipe as one surface; shared between threads.
pub struct Elevation {}

/// What the recipe wants of cells somewhere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RefineGoals {
    /// Cells whose `error_m` is already below this are not refined.
    pub prune_error_m: f64,
    /// Cells are refined once more where `error_m` is still above this.
    pub finest_error_m: Option<f64>,
}

impl Elevation {
    /// Opens and verifies every elevation source: each block is read once here, so that damaged files fail early.
    /// `root`: what the recipe's paths are relative to ([`Recipe::root`] by default); at most `memory` bytes of
    /// decoded posts are kept.
    pub fn open(
        _recipe: &Recipe,
        _root: &Path,
        _memory: ByteSize,
        _progress: OnProgress<'_>,
    ) -> Result<Self, PrepareError> {
        todo!()
    }

    /// Height above the ellipsoid, metres; 0 outside all sources.
    pub fn height_m(&self, _lat_rad: f64, _lon_rad: f64) -> f64 {
        todo!()
    }

    /// Finest north–south post spacing of the sources that meet the bounds; none where no source is.
    pub fn finest_spacing_rad(&self, _bounds: &GeoBounds) -> Option<f64> {
        todo!()
    }

    /// The goals of the finest source that meets the bounds.
    pub fn goals(&self, _bounds: &GeoBounds) -> RefineGoals {
        todo!()
    }

    /// Calls `visit(lat_rad, lon_rad, height_m)` for every source post in the bounds (borders included) with the
    /// truth there. Posts of coarser sources deep inside a finer one are left out: they are not the truth. Posts on
    /// 180° are given as −π or π, whichever lies in the bounds.
    pub fn for_each_post(&self, _bounds: &GeoBounds, _visit: &mut dyn FnMut(f64, f64, f64)) {
        todo!()
    }

    /// What the manifest keeps of the sources.
    pub fn sources(&self) -> Vec<SourceInfo> {
        todo!()
    }

    /// Where sources are; none crosses the antimeridian.
    pub fn bounds(&self) -> Vec<GeoBounds> {
        todo!()
    }

    /// Lowest and highest truth, metres above the ellipsoid: bounds, perhaps wider by what datums differ.
    pub fn height_range_m(&self) -> (f64, f64) {
        todo!()
    }

    /// The first failure of reading since the sources were opened, if a file changed or went away meanwhile; heights
    /// there came from coarser sources. Ask when done.
    pub fn failure(&self) -> Option<PrepareError> {
        todo!()
    }
}
