//! One lattice of posts as a part of the composite.

use super::RefineGoals;
use crate::geodesy::{GeoBounds, VerticalDatum};
use crate::prepare::placement::overlap;
use crate::prepare::raster::blocks::BlockCache;
use crate::prepare::raster::grid::{Cursor, HeightGrid, Place, Span};
use crate::prepare::recipe::{DEFAULT_PRUNE_ERROR_M, ElevationSection};

/// A grid, and how it takes part.
pub struct Layer {
    pub grid: HeightGrid,
    /// North–south spacing of its posts.
    pub spacing_rad: f64,
    pub goals: RefineGoals,
    pub bounds: Vec<GeoBounds>,
    /// Index of its section in the recipe.
    pub section: usize,
    vertical: VerticalDatum,
    feather_m: f64,
}

/// How much a layer has to say of a place.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Coverage {
    None,
    /// In its feather, or beside or among voids.
    Part,
    /// It alone is the truth.
    Whole,
}

/// A post as its own source has it.
#[derive(Clone, Copy, Debug)]
pub struct OwnPost {
    /// Above the ellipsoid.
    pub height_m: f64,
    /// Outside the feather: coarser sources have no part in the truth.
    pub alone: bool,
}

/// Heights of coarser sources, at latitude and longitude.
type Fill<'a> = &'a dyn Fn(f64, f64) -> Option<f64>;

/// Width of the default feather, posts.
const DEFAULT_FEATHER_POSTS: f64 = 16.0;
/// Bounds that share less than this part of a post's spacing only touch.
const BORDER: f64 = 0.01;
/// A feather is never wider than this part of its grid's lesser side.
const WIDEST_FEATHER: f64 = 0.25;

impl Layer {
    pub fn new(grid: HeightGrid, section: &ElevationSection, index: usize) -> Self {
        let bounds = grid.bounds();
        let spacing_rad = grid.placement.steps_rad().0;
        let lat_rad = bounds.first().map_or(0.0, |b| b.center().lat_rad);
        let (row_m, col_m) = grid.steps_m(lat_rad);
        let lesser_side_m = (row_m * f64::from(grid.rows)).min(col_m * f64::from(grid.cols));
        let feather_m = section.feather_m.unwrap_or(DEFAULT_FEATHER_POSTS * row_m).min(lesser_side_m * WIDEST_FEATHER);
        let goals = RefineGoals {
            prune_error_m: section.prune_error_m.unwrap_or(DEFAULT_PRUNE_ERROR_M),
            finest_error_m: section.finest_error_m,
        };
        Self { grid, spacing_rad, goals, bounds, section: index, vertical: section.vertical, feather_m }
    }

    pub fn meets(&self, bounds: &GeoBounds) -> bool {
        self.bounds.iter().any(|own| own.intersects(bounds))
    }

    /// More than a touch of borders.
    pub fn shares_ground(&self, bounds: &GeoBounds) -> bool {
        self.bounds.iter().any(|own| overlap(own, bounds, self.spacing_rad * BORDER))
    }

    pub fn is_ellipsoidal(&self) -> bool {
        self.vertical == VerticalDatum::Ellipsoid
    }

    /// Height of the source's datum above the ellipsoid.
    fn datum_m(&self, lat_rad: f64, lon_rad: f64) -> f64 {
        self.vertical.undulation_m(lat_rad, lon_rad)
    }

    /// 0 where its posts end, 1 from the feather's width inwards, smoothstep between.
    pub fn weight(&self, place: Place, lat_rad: f64) -> f64 {
        if self.feather_m <= 0.0 {
            return 1.0;
        }
        let t = self.grid.distance_to_edge_m(place, lat_rad, self.feather_m) / self.feather_m;
        t * t * (3.0 - 2.0 * t)
    }

    /// Bilinear height above the ellipsoid; void posts take what `fill` has there.
    pub fn height_m(&self, cache: &BlockCache, place: Place, at: (f64, f64), fill: Fill<'_>) -> Option<f64> {
        let mut cursor = Cursor::new(&self.grid, cache);
        let (mut sum, mut weights) = (0.0, 0.0);
        for (row, col, weight) in self.grid.corners(place) {
            if weight <= 0.0 {
                continue;
            }
            let Some(post) = cursor.post(row, col).map(f64::from).or_else(|| self.filled_m(row, col, fill)) else {
                continue;
            };
            sum += weight * post;
            weights += weight;
        }
        (weights > 0.0).then(|| sum / weights + self.datum_m(at.0, at.1))
    }

    /// A void post's height in the source's own datum, from coarser sources.
    fn filled_m(&self, row: u32, col: u32, fill: Fill<'_>) -> Option<f64> {
        let (lat_rad, lon_rad) = self.grid.placement.lat_lon_rad(f64::from(col), f64::from(row));
        Some(fill(lat_rad, lon_rad)? - self.datum_m(lat_rad, lon_rad))
    }

    pub fn coverage(&self, cache: &BlockCache, lat_rad: f64, lon_rad: f64) -> Coverage {
        let Some(place) = self.grid.place(lat_rad, lon_rad) else { return Coverage::None };
        let mut cursor = Cursor::new(&self.grid, cache);
        let mut void = false;
        for (row, col, _) in self.grid.corners(place).into_iter().filter(|c| c.2 > 0.0) {
            void |= cursor.post(row, col).is_none();
        }
        if !void && self.weight(place, lat_rad) >= 1.0 { Coverage::Whole } else { Coverage::Part }
    }

    /// Its posts in the bounds that are not void.
    pub fn for_each_post(&self, cache: &BlockCache, bounds: &GeoBounds, visit: &mut dyn FnMut(f64, f64, OwnPost)) {
        if !self.meets(bounds) {
            return;
        }
        let mut cursor = Cursor::new(&self.grid, cache);
        for span in self.grid.spans(bounds) {
            for row in span.rows.clone() {
                self.row_posts(&mut cursor, bounds, &span, row as u32, visit);
            }
        }
    }

    fn row_posts(
        &self,
        cursor: &mut Cursor<'_>,
        bounds: &GeoBounds,
        span: &Span,
        row: u32,
        visit: &mut dyn FnMut(f64, f64, OwnPost),
    ) {
        for index in span.cols.clone() {
            let col = index as u32;
            let Some(post) = cursor.post(row, col) else { continue };
            let Some((lat_rad, lon_rad)) = self.grid.post_in(bounds, span, row, index) else { continue };
            let place = Place { row: f64::from(row), col: f64::from(col) };
            let own = OwnPost {
                height_m: f64::from(post) + self.datum_m(lat_rad, lon_rad),
                alone: self.weight(place, lat_rad) >= 1.0,
            };
            visit(lat_rad, lon_rad, own);
        }
    }
}
