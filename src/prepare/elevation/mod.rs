//! The composite truth over all elevation sources (the finest source outside its feather, the stated blend inside,
//! bilinear, above the ellipsoid).
//!
//! - Sources are taken finest first; of equally fine ones the one named first in the recipe.
//! - Inside the `feather_m` next to where its posts end, a source is blended (smoothstep) into the coarser ones; where
//!   there is no coarser one it stands alone.
//! - A void post takes the height that the coarser sources have there, so that the surface is continuous round voids;
//!   where there is no coarser one, the cell's other posts stand for it, and where all four are void there is nothing.
//! - Files that share a lattice are one source: there is no seam between them.
//! - Grids that go round the Earth close at the antimeridian, and go on to a pole that is nearer than a step.

mod files;
mod layer;

use super::raster::blocks::BlockCache;
use super::recipe::DEFAULT_PRUNE_ERROR_M;
use super::{OnProgress, PrepareError, Progress, Recipe};
use crate::geodesy::{GeoBounds, SEMI_MAJOR_M};
use crate::store::SourceInfo;
use crate::units::ByteSize;
use layer::{Coverage, Layer};
use rayon::prelude::*;
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// All elevation of a recipe as one surface; shared between threads.
pub struct Elevation {
    /// Finest first.
    layers: Vec<Layer>,
    cache: BlockCache,
    stats: Vec<SourceStats>,
    infos: Vec<SourceInfo>,
}

/// What a source holds, counted when it was opened; heights as in the source, after `clamp_m`.
#[derive(Clone, Debug, PartialEq)]
pub struct SourceStats {
    /// As the recipe names it.
    pub file: String,
    pub files: u64,
    /// Of all files; shared edges count in each.
    pub posts: u64,
    pub voids: u64,
    /// Infinities the wrong way round where all is void.
    pub low_m: f64,
    pub high_m: f64,
}

/// What the recipe wants of cells somewhere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RefineGoals {
    /// Cells whose `error_m` is already below this are not refined.
    pub prune_error_m: f64,
    /// Cells are refined once more where `error_m` is still above this.
    pub finest_error_m: Option<f64>,
}

impl Default for RefineGoals {
    fn default() -> Self {
        Self { prune_error_m: DEFAULT_PRUNE_ERROR_M, finest_error_m: None }
    }
}

impl Elevation {
    /// Opens and verifies every elevation source: each block is read once here, so that damaged files fail early.
    /// `root`: what the recipe's paths are relative to ([`Recipe::root`] by default); at most `memory` bytes of
    /// decoded posts are kept (one block a thread more while they are in use; a block is a strip or tile of a TIFF,
    /// a whole .hgt, a whole netCDF variable).
    pub fn open(
        recipe: &Recipe,
        root: &Path,
        memory: ByteSize,
        progress: OnProgress<'_>,
    ) -> Result<Self, PrepareError> {
        let mut cache = BlockCache::new(memory.0);
        let (mut layers, mut stats, mut infos) = (Vec::new(), Vec::new(), Vec::new());
        for (index, section) in recipe.elevation.iter().enumerate() {
            let first_slot = cache.slots();
            let opened = files::open_all(section, root)?;
            let files = opened.len() as u64;
            let own: Vec<Layer> =
                files::join(opened, &mut cache)?.into_iter().map(|grid| Layer::new(grid, section, index)).collect();
            let mut found = verify(&cache, first_slot..cache.slots(), &section.file, progress)?;
            found.files = files;
            let spacing_rad = own.iter().map(|layer| layer.spacing_rad).fold(f64::INFINITY, f64::min);
            infos.push(SourceInfo {
                kind: "elevation".to_owned(),
                file: section.file.clone(),
                credit: section.credit.clone(),
                licence: section.licence.clone(),
                spacing_m: spacing_rad * SEMI_MAJOR_M,
                count: found.posts,
            });
            stats.push(found);
            layers.extend(own);
        }
        layers.sort_by(|a, b| a.spacing_rad.total_cmp(&b.spacing_rad));
        Ok(Self { layers, cache, stats, infos })
    }

    /// Height above the ellipsoid, metres; 0 outside all sources.
    pub fn height_m(&self, lat_rad: f64, lon_rad: f64) -> f64 {
        self.source_height_m(lat_rad, lon_rad).unwrap_or(0.0)
    }

    /// The same; none outside all sources.
    pub fn source_height_m(&self, lat_rad: f64, lon_rad: f64) -> Option<f64> {
        self.composite_m(0, lat_rad, lon_rad)
    }

    /// The truth of the layers from `first` on; none where they have nothing.
    fn composite_m(&self, first: usize, lat_rad: f64, lon_rad: f64) -> Option<f64> {
        /// Less weight than this counts as none.
        const NO_WEIGHT: f64 = 1e-9;
        let (mut sum_m, mut left, mut edge) = (0.0, 1.0, None);
        let height_m = |index: usize, place| {
            let fill = |lat_rad, lon_rad| self.composite_m(index + 1, lat_rad, lon_rad);
            self.layers[index].height_m(&self.cache, place, (lat_rad, lon_rad), &fill)
        };
        for (index, layer) in self.layers.iter().enumerate().skip(first) {
            let Some(place) = layer.grid.place(lat_rad, lon_rad) else { continue };
            let weight = layer.weight(place, lat_rad);
            if weight < NO_WEIGHT {
                edge = edge.or(Some((index, place)));
                continue;
            }
            let Some(height_m) = height_m(index, place) else { continue };
            sum_m += left * weight * height_m;
            left *= 1.0 - weight;
            if left <= 0.0 {
                return Some(sum_m);
            }
        }
        if left < 1.0 {
            // Where nothing coarser lies below, the seam has nothing to be blended with.
            return Some(sum_m / (1.0 - left));
        }
        edge.and_then(|(index, place)| height_m(index, place))
    }

    /// Finest north–south post spacing of the sources that share ground (more than a border) with the bounds; none
    /// where no source is.
    pub fn finest_spacing_rad(&self, bounds: &GeoBounds) -> Option<f64> {
        self.finest(bounds).map(|layer| layer.spacing_rad)
    }

    /// The goals of the finest source that shares ground with the bounds.
    pub fn goals(&self, bounds: &GeoBounds) -> RefineGoals {
        self.finest(bounds).map_or_else(RefineGoals::default, |layer| layer.goals)
    }

    fn finest(&self, bounds: &GeoBounds) -> Option<&Layer> {
        self.layers.iter().find(|layer| layer.shares_ground(bounds))
    }

    /// Calls `visit(lat_rad, lon_rad, height_m)` for every source post in the bounds (borders included) with the
    /// truth there. Posts of coarser sources deep inside a finer one are left out: they are not the truth. Posts on
    /// 180° are given as −π or π, whichever lies in the bounds.
    pub fn for_each_post(&self, bounds: &GeoBounds, visit: &mut dyn FnMut(f64, f64, f64)) {
        for (index, layer) in self.layers.iter().enumerate() {
            let finer: Vec<&Layer> = self.layers[..index].iter().filter(|other| other.meets(bounds)).collect();
            let hidden = |lat_rad, lon_rad| {
                let coverage = |other: &&Layer| other.coverage(&self.cache, lat_rad, lon_rad);
                finer.iter().map(coverage).max().unwrap_or(Coverage::None)
            };
            layer.for_each_post(&self.cache, bounds, &mut |lat_rad, lon_rad, own| match if finer.is_empty() {
                Coverage::None
            } else {
                hidden(lat_rad, lon_rad)
            } {
                Coverage::Whole => {}
                Coverage::None if own.alone => visit(lat_rad, lon_rad, own.height_m),
                _ => visit(lat_rad, lon_rad, self.height_m(lat_rad, lon_rad)),
            });
        }
    }

    /// What the manifest keeps of the sources.
    pub fn sources(&self) -> Vec<SourceInfo> {
        self.infos.clone()
    }

    /// What was counted when the sources were opened, in the recipe's order.
    pub fn stats(&self) -> &[SourceStats] {
        &self.stats
    }

    /// Where sources are; none crosses the antimeridian.
    pub fn bounds(&self) -> Vec<GeoBounds> {
        self.layers.iter().flat_map(|layer| layer.bounds.iter().copied()).collect()
    }

    /// Lowest and highest truth, metres above the ellipsoid: bounds, wider by what datums differ.
    pub fn height_range_m(&self) -> (f64, f64) {
        /// No geoid is further from the ellipsoid.
        const GEOID_M: f64 = 110.0;
        self.layers.iter().fold((0.0f64, 0.0f64), |(low_m, high_m), layer| {
            let stats = &self.stats[layer.section];
            let wide_m = if layer.is_ellipsoidal() { 0.0 } else { GEOID_M };
            (low_m.min(stats.low_m - wide_m), high_m.max(stats.high_m + wide_m))
        })
    }

    /// The first failure of reading since the sources were opened, if a file changed or went away meanwhile; heights
    /// there came from coarser sources. Ask when done.
    pub fn failure(&self) -> Option<PrepareError> {
        self.cache.take_failure()
    }
}

/// Reads every block once.
fn verify(
    cache: &BlockCache,
    slots: std::ops::Range<u32>,
    file: &str,
    progress: OnProgress<'_>,
) -> Result<SourceStats, PrepareError> {
    let (done, total) = (AtomicU64::new(0), slots.len() as u64);
    let empty = SourceStats {
        file: file.to_owned(),
        files: 0,
        posts: 0,
        voids: 0,
        low_m: f64::INFINITY,
        high_m: f64::NEG_INFINITY,
    };
    let all = Mutex::new(empty);
    slots.into_par_iter().try_for_each(|slot| {
        let block = cache.load(slot)?;
        let (mut voids, mut low, mut high) = (0, f32::INFINITY, f32::NEG_INFINITY);
        for index in 0..block.len() {
            match block.get(index) {
                Some(height) => (low, high) = (low.min(height), high.max(height)),
                None => voids += 1,
            }
        }
        let mut all = all.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        all.posts += block.len() as u64;
        all.voids += voids;
        all.low_m = all.low_m.min(low.into());
        all.high_m = all.high_m.max(high.into());
        drop(all);
        progress(Progress { stage: "read elevation", item: file, done: done.fetch_add(1, Relaxed) + 1, total });
        Ok::<_, PrepareError>(())
    })?;
    let stats = all.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner);
    if stats.voids == stats.posts {
        let what = "every post is void";
        return Err(PrepareError::value(file, "samples", what, "check `nodata` and `layer` in the recipe"));
    }
    Ok(stats)
}

#[cfg(test)]
mod tests;
