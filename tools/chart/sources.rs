//! What `--against` compares with: the elevation of the recipe that a world was prepared from.

use anyhow::Context;
use std::path::Path;
use stoop::chart::Truth;
use stoop::geodesy::{GeoBounds, Geodetic};
use stoop::prepare::{Elevation, Recipe};
use stoop::units::ByteSize;

/// Decoded posts that are kept.
const MEMORY: ByteSize = ByteSize(1 << 30);
/// In search of a post each look reaches so many times as far as the one before.
const FARTHER: f64 = 4.0;

/// All elevation of a recipe.
pub struct Sources(Elevation);

impl Sources {
    /// `root`: what the recipe's paths are relative to, its own folder by default.
    pub fn open(recipe: &Path, root: Option<&Path>) -> anyhow::Result<Self> {
        let read = Recipe::read(recipe).context("--against")?;
        anyhow::ensure!(
            !read.elevation.is_empty(),
            "{}: has no [[elevation]] to compare heights with; name the recipe that the ground was prepared from",
            recipe.display()
        );
        Ok(Self(Elevation::open(&read, root.unwrap_or(read.root()), MEMORY, &|_| {})?))
    }

    /// Whether all could be read that was asked for.
    pub fn check(&self) -> anyhow::Result<()> {
        self.0.failure().map_or(Ok(()), |failure| Err(failure.into()))
    }

    fn nearest_post(&self, lat_rad: f64, lon_rad: f64, bounds: &GeoBounds) -> Option<Geodetic> {
        let mut nearest: Option<(f64, Geodetic)> = None;
        self.0.for_each_post(bounds, &mut |post_lat_rad, post_lon_rad, height_m| {
            let (north, east) = (post_lat_rad - lat_rad, (post_lon_rad - lon_rad) * lat_rad.cos());
            let distance = north * north + east * east;
            if nearest.is_none_or(|(least, _)| distance < least) {
                nearest = Some((distance, Geodetic { lat_rad: post_lat_rad, lon_rad: post_lon_rad, height_m }));
            }
        });
        nearest.map(|(_, post)| post)
    }
}

impl Truth for Sources {
    fn height_m(&self, lat_rad: f64, lon_rad: f64) -> Option<f64> {
        self.0.source_height_m(lat_rad, lon_rad)
    }

    /// Looks farther and farther round the place: where sources of several spacings meet, no look sees more than some dozens
    /// of posts.
    fn post_near(&self, lat_rad: f64, lon_rad: f64, within: &GeoBounds) -> Option<Geodetic> {
        let mut reach_rad = self.0.finest_spacing_rad(within)?;
        loop {
            let around = around(lat_rad, lon_rad, reach_rad).intersection(within)?;
            let post = self.nearest_post(lat_rad, lon_rad, &around);
            let is_all = around == *within;
            if post.is_some() || is_all {
                return post;
            }
            reach_rad *= FARTHER;
        }
    }
}

/// As far to all sides on the ground.
fn around(lat_rad: f64, lon_rad: f64, reach_rad: f64) -> GeoBounds {
    let east_rad = reach_rad / lat_rad.cos().max(reach_rad);
    GeoBounds {
        west_rad: lon_rad - east_rad,
        south_rad: lat_rad - reach_rad,
        east_rad: lon_rad + east_rad,
        north_rad: lat_rad + reach_rad,
    }
}
