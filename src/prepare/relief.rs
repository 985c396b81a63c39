//! Heights painted as a picture, for ground that no picture shows finely: sea, and land by its height.

use super::recipe::{ElevationSection, ImagerySection};
use super::{Elevation, OnProgress, PictureSource, PrepareError, Recipe};
use crate::geodesy::{GeoBounds, VerticalDatum};
use crate::store::SourceInfo;
use crate::units::ByteSize;
use std::path::Path;

/// Colours (sRGB) from a height on, metres in the source's own datum; between them they are mixed.
const LAND: [(f64, [f64; 3]); 6] = [
    (0.0, [150.0, 146.0, 124.0]),
    (15.0, [124.0, 132.0, 98.0]),
    (120.0, [112.0, 124.0, 80.0]),
    (400.0, [134.0, 124.0, 86.0]),
    (1500.0, [146.0, 132.0, 112.0]),
    (3500.0, [232.0, 234.0, 238.0]),
];
const SEA: [f64; 3] = [52.0, 88.0, 122.0];
/// The share of the shorter side over which the borders fade out.
const FADE: f64 = 0.06;
/// The most samples along a side of a texel that is averaged.
const SAMPLES_MAX: f64 = 4.0;

/// A painter over one `[[imagery]]` section with `heights = true`.
pub struct ReliefPainter {
    heights: Elevation,
    texel_rad: f64,
}

impl ReliefPainter {
    pub fn open(
        section: &ImagerySection,
        root: &Path,
        memory: ByteSize,
        progress: OnProgress<'_>,
    ) -> Result<Self, PrepareError> {
        let elevation = ElevationSection {
            file: section.file.clone(),
            vertical: VerticalDatum::Ellipsoid,
            feather_m: None,
            clamp_m: None,
            prune_error_m: None,
            finest_error_m: None,
            nodata: section.nodata,
            crs: section.crs.clone(),
            layer: section.layer.clone(),
            credit: section.credit.clone(),
            licence: section.licence.clone(),
        };
        let recipe = Recipe {
            name: String::new(),
            elevation: vec![elevation],
            imagery: Vec::new(),
            buildings: Vec::new(),
            objects: Vec::new(),
            layout: Vec::new(),
            view: vec![],
            text: String::new(),
            path: root.join("relief"),
        };
        let heights = Elevation::open(&recipe, root, memory, progress)?;
        let spacing = heights.bounds().iter().filter_map(|bounds| heights.finest_spacing_rad(bounds)).reduce(f64::min);
        let texel_rad = spacing.ok_or_else(|| {
            PrepareError::value(&section.file, "[[imagery]]", "holds no heights", "name a file of heights")
        })?;
        Ok(Self { heights, texel_rad })
    }

    fn coverage(&self, lat_rad: f64, lon_rad: f64) -> Option<u8> {
        let inside = |bounds: &GeoBounds| {
            let (u, v) = bounds.fractions(lat_rad, lon_rad);
            let side_rad = bounds.width_rad().min(bounds.height_rad());
            let from_edge_rad = (u.min(1.0 - u) * bounds.width_rad()).min(v.min(1.0 - v) * bounds.height_rad());
            (from_edge_rad / (side_rad * FADE)).clamp(0.0, 1.0)
        };
        let part = self.heights.bounds().iter().map(inside).fold(0.0, f64::max);
        (part > 0.0).then_some((part * 255.0).round() as u8)
    }
}

impl PictureSource for ReliefPainter {
    fn color(&self, lat_rad: f64, lon_rad: f64, texel_rad: f64) -> Option<[u8; 4]> {
        let coverage = self.coverage(lat_rad, lon_rad)?;
        let side = (texel_rad / self.texel_rad).round().clamp(1.0, SAMPLES_MAX) as u32;
        let mut sum = [0.0; 3];
        for row in 0..side {
            for column in 0..side {
                let offset = |at: u32| ((f64::from(at) + 0.5) / f64::from(side) - 0.5) * texel_rad;
                let (lat, lon) = (lat_rad + offset(row), lon_rad + offset(column) / lat_rad.cos().max(1e-6));
                let color = color_of(self.heights.height_m(lat, lon));
                sum = std::array::from_fn(|band| sum[band] + color[band] / f64::from(side * side));
            }
        }
        let [r, g, b] = sum.map(|band| band.round() as u8);
        Some([r, g, b, coverage])
    }

    fn texel_rad(&self) -> f64 {
        self.texel_rad
    }

    fn bounds(&self) -> Vec<GeoBounds> {
        self.heights.bounds()
    }

    fn info(&self) -> SourceInfo {
        let info = self.heights.sources().into_iter().next();
        SourceInfo { kind: "relief".into(), ..info.unwrap_or_default() }
    }
}

fn color_of(height_m: f64) -> [f64; 3] {
    if height_m <= 0.0 {
        return SEA;
    }
    let above = LAND.iter().position(|(from_m, _)| *from_m > height_m).unwrap_or(LAND.len());
    let (low_m, low) = LAND[above - 1];
    let Some(&(high_m, high)) = LAND.get(above) else { return low };
    let part = (height_m - low_m) / (high_m - low_m);
    std::array::from_fn(|band| low[band] + (high[band] - low[band]) * part)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sea_is_blue_and_land_changes_without_steps() {
        assert_eq!(color_of(0.0), SEA);
        assert_eq!(color_of(9000.0), LAND[LAND.len() - 1].1);
        for at in 1..40_000 {
            let (a, b) = (color_of(f64::from(at) * 0.1), color_of(f64::from(at + 1) * 0.1));
            assert!((0..3).all(|band| (a[band] - b[band]).abs() < 1.0), "a step at {at}");
        }
    }
}
