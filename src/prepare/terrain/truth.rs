//! What the terrain is measured against, and the samples of it that a cell is measured at.

use crate::content::POSTS;
use crate::forest::CellId;
use crate::geodesy::{ECCENTRICITY_SQ, GeoBounds, prime_vertical_radius_m};
use crate::prepare::elevation::{Elevation, RefineGoals};
use glam::DVec3;
use rayon::prelude::*;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// The composite of the elevation sources: what a world's terrain is measured against.
pub trait Truth: Sync {
    /// Metres above the ellipsoid; 0 outside everything.
    fn height_m(&self, lat_rad: f64, lon_rad: f64) -> f64;
    /// Finest N–S spacing of the posts of the sources that meet the bounds, radians.
    fn finest_spacing_rad(&self, bounds: &GeoBounds) -> Option<f64>;
    /// How far the finest source that meets the bounds wants cells refined.
    fn goals(&self, bounds: &GeoBounds) -> RefineGoals;
    /// Visits every source post in the bounds as latitude, longitude (radians) and height (metres); rows of posts of
    /// one latitude come together where the source has such rows.
    fn for_each_post(&self, bounds: &GeoBounds, visit: &mut dyn FnMut(f64, f64, f64));
}

impl Sample {
    /// The finest triangle that it lies in.
    pub fn half(&self) -> usize {
        half_at(self.fractions[0], self.fractions[1])
    }
}

impl Truth for Elevation {
    fn height_m(&self, lat_rad: f64, lon_rad: f64) -> f64 {
        Elevation::height_m(self, lat_rad, lon_rad)
    }

    fn finest_spacing_rad(&self, bounds: &GeoBounds) -> Option<f64> {
        Elevation::finest_spacing_rad(self, bounds)
    }

    fn goals(&self, bounds: &GeoBounds) -> RefineGoals {
        Elevation::goals(self, bounds)
    }

    fn for_each_post(&self, bounds: &GeoBounds, visit: &mut dyn FnMut(f64, f64, f64)) {
        Elevation::for_each_post(self, bounds, visit);
    }
}

const SIDE: usize = POSTS - 1;
/// Halves of the squares of the grid of posts: `2 · (row · 64 + column)`, plus 1 for the half on the northern side of
/// the square's diagonal. Each is one of the finest triangles that a place can lie in.
pub const HALVES: usize = 2 * SIDE * SIDE;

/// The diagonal of a unit square runs from its south-west corner to its north-east one where column + row is even,
/// whichever way the roots' runs (the bintree splits each quadrant from its parent's centre).
pub fn is_rising(column: usize, row: usize) -> bool {
    (column + row).is_multiple_of(2)
}

/// The half that holds the place at fractions `u`, `v` of the cell; places outside count as on the edge.
fn half_at(u: f64, v: f64) -> usize {
    let last = (SIDE - 1) as f64;
    let (x, y) = (u * SIDE as f64, v * SIDE as f64);
    let (column, row) = (x.floor().clamp(0.0, last), y.floor().clamp(0.0, last));
    let (fx, fy) = (x - column, y - row);
    let (column, row) = (column as usize, row as usize);
    let north = if is_rising(column, row) { fy > fx } else { fx + fy > 1.0 };
    2 * (row * SIDE + column) + usize::from(north)
}

/// A place where the drawn surface is compared with the truth.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// Fractions of the cell, 0 west/south to 1 east/north.
    pub fractions: [f64; 2],
    /// The place on the ellipsoid, ECEF, metres.
    pub foot: DVec3,
    /// Unit normal of the ellipsoid there.
    pub up: DVec3,
    /// The truth, above the ellipsoid, metres.
    pub height_m: f64,
}

/// Turns latitude, longitude and height into samples; remembers the last latitude, since posts come in rows.
struct Sampler {
    bounds: GeoBounds,
    lat_rad: f64,
    /// (sin, cos) of it.
    lat: (f64, f64),
    radius_m: f64,
}

impl Sampler {
    fn new(bounds: GeoBounds) -> Self {
        Self { bounds, lat_rad: f64::NAN, lat: (0.0, 0.0), radius_m: 0.0 }
    }

    fn sample(&mut self, lat_rad: f64, lon_rad: f64, height_m: f64) -> Sample {
        if lat_rad != self.lat_rad {
            self.lat_rad = lat_rad;
            self.lat = lat_rad.sin_cos();
            self.radius_m = prime_vertical_radius_m(self.lat.0);
        }
        let (foot, up) = foot(self.lat, lon_rad.sin_cos(), self.radius_m);
        let (u, v) = self.bounds.fractions(lat_rad, lon_rad);
        Sample { fractions: [u, v], foot, up, height_m }
    }
}

/// Sines and cosines of a cell's columns and rows of posts.
pub struct Meridians {
    /// (sin, cos) of the longitudes of the columns, of the latitudes of the rows, and N(φ) of the rows.
    columns: Vec<(f64, f64)>,
    rows: Vec<(f64, f64)>,
    radii_m: Vec<f64>,
}

impl Meridians {
    pub fn of(bounds: &GeoBounds) -> Self {
        let places: Vec<_> = (0..POSTS as i32).map(|i| post_place(bounds, i, i)).collect();
        let rows: Vec<_> = places.iter().map(|(lat_rad, _)| lat_rad.sin_cos()).collect();
        Self {
            columns: places.iter().map(|(_, lon_rad)| lon_rad.sin_cos()).collect(),
            radii_m: rows.iter().map(|&(sin, _)| prime_vertical_radius_m(sin)).collect(),
            rows,
        }
    }

    /// A post's place on the ellipsoid (ECEF, metres) and the normal there.
    pub fn foot(&self, column: usize, row: usize) -> (DVec3, DVec3) {
        foot(self.rows[row], self.columns[column], self.radii_m[row])
    }
}

/// From (sin, cos) of latitude and longitude and N(φ).
fn foot((sin_lat, cos_lat): (f64, f64), (sin_lon, cos_lon): (f64, f64), radius_m: f64) -> (DVec3, DVec3) {
    let up = DVec3::new(cos_lat * cos_lon, cos_lat * sin_lon, sin_lat);
    (DVec3::new(up.x, up.y, up.z * (1.0 - ECCENTRICITY_SQ)) * radius_m, up)
}

/// Index of a post in arrays over a cell's grid.
pub fn post_index(column: usize, row: usize) -> usize {
    row * POSTS + column
}

/// A cell's own 65 × 65 posts on the truth, rows from the south.
#[derive(Clone, Debug)]
pub struct Posts {
    pub heights_m: Vec<f64>,
}

impl Posts {
    pub fn of(truth: &dyn Truth, cell: CellId) -> Self {
        let bounds = cell.bounds();
        let heights_m = (0..POSTS * POSTS)
            .map(|at| post_height_m(truth, &bounds, (at % POSTS) as i32, (at / POSTS) as i32))
            .collect();
        Self { heights_m }
    }
}

/// Latitude and longitude of a post; columns and rows beyond the cell are allowed.
pub fn post_place(bounds: &GeoBounds, column: i32, row: i32) -> (f64, f64) {
    let place = bounds.at(f64::from(column) / SIDE as f64, f64::from(row) / SIDE as f64, 0.0);
    (place.lat_rad, place.lon_rad)
}

/// The truth at a post; columns and rows one beyond the cell are allowed. All posts at a pole are one place and have
/// one height, whatever a source's row there says.
pub fn post_height_m(truth: &dyn Truth, bounds: &GeoBounds, column: i32, row: i32) -> f64 {
    let (lat_rad, lon_rad) = post_place(bounds, column, row);
    if lat_rad.abs() >= FRAC_PI_2 - POLE_RAD {
        return truth.height_m(FRAC_PI_2.copysign(lat_rad), 0.0);
    }
    let lon_rad = if lon_rad.abs() > PI { lon_rad - TAU.copysign(lon_rad) } else { lon_rad };
    truth.height_m(lat_rad, lon_rad)
}

/// Latitudes as near to a pole as this are the pole: 6 µm.
const POLE_RAD: f64 = 1e-12;

/// Posts per block of the area of a cell that one job measures.
const BLOCK_POSTS: f64 = 200_000.0;
const BLOCKS_PER_SIDE_MAX: f64 = 24.0;

/// All the samples of a cell: the source posts in it and its own posts; where no source is, the middles of its
/// squares too, so that a bound holds between posts.
pub struct Samples<'a> {
    truth: &'a dyn Truth,
    bounds: GeoBounds,
    posts: &'a Posts,
    blocks_per_side: u32,
    has_source: bool,
}

impl<'a> Samples<'a> {
    pub fn new(truth: &'a dyn Truth, cell: CellId, posts: &'a Posts) -> Self {
        let bounds = cell.bounds();
        let spacing = truth.finest_spacing_rad(&bounds);
        let per_side = spacing.map_or(0.0, |spacing| bounds.height_rad() / spacing);
        let blocks = (per_side * per_side / BLOCK_POSTS).sqrt().ceil().clamp(1.0, BLOCKS_PER_SIDE_MAX);
        Self { truth, bounds, posts, blocks_per_side: blocks as u32, has_source: spacing.is_some() }
    }

    /// Folds over all samples, in parallel over blocks of the cell.
    pub fn fold<A: Send>(
        &self,
        make: impl Fn() -> A + Sync + Send,
        visit: impl Fn(&mut A, &Sample) + Sync + Send,
        merge: impl Fn(A, A) -> A + Sync + Send,
    ) -> A {
        let own = {
            let mut state = make();
            self.visit_own(&mut |sample| visit(&mut state, sample));
            state
        };
        if !self.has_source {
            return own;
        }
        let blocks = self.blocks_per_side;
        let sources = (0..blocks * blocks)
            .into_par_iter()
            .map(|block| {
                let mut state = make();
                let mut sampler = Sampler::new(self.bounds);
                self.truth.for_each_post(&self.block(block), &mut |lat_rad, lon_rad, height_m| {
                    visit(&mut state, &sampler.sample(lat_rad, lon_rad, height_m));
                });
                state
            })
            .reduce(&make, &merge);
        merge(own, sources)
    }

    /// A part of the area; the outermost edges are exactly the cell's, so that no post on them is lost.
    fn block(&self, block: u32) -> GeoBounds {
        let (side, bounds) = (self.blocks_per_side, &self.bounds);
        let (x, y) = (block % side, block / side);
        let edge = |i: u32, low: f64, high: f64| match i {
            0 => low,
            i if i == side => high,
            i => low + (high - low) * f64::from(i) / f64::from(side),
        };
        GeoBounds {
            west_rad: edge(x, bounds.west_rad, bounds.east_rad),
            south_rad: edge(y, bounds.south_rad, bounds.north_rad),
            east_rad: edge(x + 1, bounds.west_rad, bounds.east_rad),
            north_rad: edge(y + 1, bounds.south_rad, bounds.north_rad),
        }
    }

    fn visit_own(&self, visit: &mut dyn FnMut(&Sample)) {
        let meridians = Meridians::of(&self.bounds);
        for (at, &height_m) in self.posts.heights_m.iter().enumerate() {
            let (column, row) = (at % POSTS, at / POSTS);
            let (foot, up) = meridians.foot(column, row);
            let fractions = [column, row].map(|i| i as f64 / SIDE as f64);
            visit(&Sample { fractions, foot, up, height_m });
        }
        if self.has_source {
            return;
        }
        let mut sampler = Sampler::new(self.bounds);
        for at in 0..SIDE * SIDE {
            let middle = |i: usize| (i as f64 + 0.5) / SIDE as f64;
            let place = self.bounds.at(middle(at % SIDE), middle(at / SIDE), 0.0);
            let height_m = self.truth.height_m(place.lat_rad, place.lon_rad);
            visit(&sampler.sample(place.lat_rad, place.lon_rad, height_m));
        }
    }
}
