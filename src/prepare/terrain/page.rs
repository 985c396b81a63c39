//! Pages of terrain from a plan: quantized heights, the parent's heights, slopes.

use super::pyramid::CellPlan;
use super::truth::{Truth, post_height_m, post_index, post_place};
use crate::content::rtin::{Active, Diagonal, Post};
use crate::content::{POSTS, Surface, TerrainPage, TerrainPost};
use crate::forest::CellId;
use crate::geodesy::{GeoBounds, meridian_radius_m, prime_vertical_radius_m};
use crate::store;
use std::f64::consts::FRAC_PI_2;

/// A height as it comes out of a page that declares `error_m`, as [`store::encode_terrain`] writes it.
fn quantize_m(height_m: f64, error_m: f32) -> f64 {
    let step = f64::from(store::height_step_m(error_m));
    f64::from(((height_m / step).round() * step) as f32)
}

pub fn quantized(heights_m: &[f64], error_m: f32) -> Vec<f64> {
    heights_m.iter().map(|&height_m| quantize_m(height_m, error_m)).collect()
}

/// The page of a planned cell. `parent` is its parent's finished page.
pub fn build(truth: &dyn Truth, cell: CellId, plan: &CellPlan, parent: Option<&TerrainPage>) -> TerrainPage {
    let bounds = cell.bounds();
    let parent = parent.map(|parent| Surface::new(parent, 1.0));
    let mut grid = Grid::new(truth, cell);
    let mut posts = Vec::with_capacity(plan.active.len());
    for (column, row) in plan.active.posts() {
        let (lat_rad, lon_rad) = post_place(&bounds, i32::from(column), i32::from(row));
        let height_m = quantize_m(grid.height_m(i32::from(column), i32::from(row)), plan.error_m) as f32;
        let above = parent.as_ref().and_then(|surface| surface.height_m(lat_rad, lon_rad));
        posts.push(TerrainPost {
            column,
            row,
            height_m,
            parent_height_m: above.map_or(height_m, |height_m| height_m as f32),
            slope: grid.slope(i32::from(column), i32::from(row)),
        });
    }
    page_of(cell, plan.error_m, &plan.active, posts)
}

/// A page for measuring only: heights of all 65 × 65 posts, without the parent's and without slopes.
pub fn bare(cell: CellId, active: &Active, heights_m: &[f64]) -> TerrainPage {
    let post = |(column, row): Post| {
        let height_m = heights_m[post_index(column.into(), row.into())] as f32;
        TerrainPost { column, row, height_m, parent_height_m: height_m, slope: [0; 2] }
    };
    page_of(cell, 0.0, active, active.posts().map(post).collect())
}

/// `posts` are those of `active`, in its order.
fn page_of(cell: CellId, error_m: f32, active: &Active, posts: Vec<TerrainPost>) -> TerrainPage {
    let diagonal = Diagonal::of(cell);
    let mut index = vec![u16::MAX; POSTS * POSTS];
    for (at, post) in posts.iter().enumerate() {
        index[post_index(post.column.into(), post.row.into())] = at as u16;
    }
    let corners = active.triangles(diagonal).into_iter();
    let triangles = corners.map(|t| t.map(|(column, row)| index[post_index(column.into(), row.into())])).collect();
    TerrainPage { cell, error_m, diagonal, posts, triangles }
}

/// The truth on a cell's posts and on those one beyond its borders, as far as it was asked for.
struct Grid<'a> {
    truth: &'a dyn Truth,
    bounds: GeoBounds,
    heights_m: Vec<f64>,
}

const GRID_SIDE: usize = POSTS + 2;

impl<'a> Grid<'a> {
    fn new(truth: &'a dyn Truth, cell: CellId) -> Self {
        Self { truth, bounds: cell.bounds(), heights_m: vec![f64::NAN; GRID_SIDE * GRID_SIDE] }
    }

    /// Columns and rows from −1 to 65.
    fn height_m(&mut self, column: i32, row: i32) -> f64 {
        let at = (row + 1) as usize * GRID_SIDE + (column + 1) as usize;
        if self.heights_m[at].is_nan() {
            self.heights_m[at] = post_height_m(self.truth, &self.bounds, column, row);
        }
        self.heights_m[at]
    }

    /// The rise of the truth at a post by central differences over its neighbours.
    fn slope(&mut self, column: i32, row: i32) -> [i8; 2] {
        let (lat_rad, _) = post_place(&self.bounds, column, row);
        let (sin, cos) = lat_rad.sin_cos();
        let intervals = (POSTS - 1) as f64;
        // A parallel shrinks to nothing at a pole, and so does what can rise along it.
        let east_m = 2.0 * self.bounds.width_rad() / intervals * prime_vertical_radius_m(sin) * cos.max(1e-6);
        let north_m = 2.0 * self.bounds.height_rad() / intervals * meridian_radius_m(sin);
        let east = (self.height_m(column + 1, row) - self.height_m(column - 1, row)) / east_m;
        let north = (self.height_m(column, row + 1) - self.height_m(column, row - 1)) / north_m;
        [east, north].map(|rise| {
            let turned = rise.atan() / FRAC_PI_2 / f64::from(TerrainPost::SLOPE_STEP);
            turned.round().clamp(-127.0, 127.0) as i8
        })
    }
}
