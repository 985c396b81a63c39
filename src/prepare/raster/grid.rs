//! A lattice of posts, made of one file or of many tiles that share it.

use super::blocks::{Block, BlockCache, BlockLayout};
use crate::geodesy::{GeoBounds, SEMI_MAJOR_M};
use crate::prepare::crs::{CONTROL_TOLERANCE, Placement};
use std::sync::Arc;

/// Posts on one lattice; row 0 is the first in the files, north or south.
#[derive(Debug)]
pub struct HeightGrid {
    pub placement: Placement,
    pub rows: u32,
    pub cols: u32,
    /// The last column is followed by the first: all the way round the Earth.
    wraps: bool,
    /// The grid goes on with its border row to the pole, which is nearer than a step: (before the first row, after
    /// the last).
    to_pole: (bool, bool),
    tiles: Vec<Tile>,
    /// Row and column intervals between tiles' borders, and the tile that has the posts of each.
    row_starts: Vec<u32>,
    col_starts: Vec<u32>,
    tile_at: Vec<Option<u32>>,
    /// Posts that no tile has: first row, first column, end row, end column.
    missing: Vec<[u32; 4]>,
}

/// One file's part of a lattice.
#[derive(Clone, Copy, Debug)]
pub struct Tile {
    pub row: u32,
    pub col: u32,
    pub layout: BlockLayout,
    /// Its block b is slot first_slot + b of the cache.
    pub first_slot: u32,
}

/// A place in post coordinates, inside the grid.
#[derive(Clone, Copy, Debug)]
pub struct Place {
    pub row: f64,
    pub col: f64,
}

/// Places this near to a post (in steps) count as on it.
const ON_POST: f64 = 1e-6;

impl HeightGrid {
    pub fn new(placement: Placement, rows: u32, cols: u32, tiles: Vec<Tile>) -> Self {
        let mut grid = Self {
            placement,
            rows,
            cols,
            wraps: false,
            to_pole: (false, false),
            tiles,
            row_starts: Vec::new(),
            col_starts: Vec::new(),
            tile_at: Vec::new(),
            missing: Vec::new(),
        };
        grid.close_round_the_earth();
        grid.index_tiles();
        grid
    }

    /// A grid that spans 360° wraps; a last column that repeats the first is left out.
    fn close_round_the_earth(&mut self) {
        let Placement::Geographic { lon_step_deg, first_lat_deg, lat_step_deg, cols, .. } = &mut self.placement else {
            return;
        };
        let round = 360.0 / *lon_step_deg;
        let spans = |count: f64| (count - round).abs() < 0.01;
        if spans(f64::from(self.cols) - 1.0) {
            self.cols -= 1;
        }
        self.wraps = spans(f64::from(self.cols));
        *cols = f64::from(self.cols);
        let last_lat_deg = *first_lat_deg + *lat_step_deg * f64::from(self.rows - 1);
        let near_pole = |lat_deg: f64| self.wraps && 90.0 - lat_deg.abs() <= lat_step_deg.abs() * 1.01;
        self.to_pole = (near_pole(*first_lat_deg), near_pole(last_lat_deg));
    }

    fn index_tiles(&mut self) {
        let (rows, cols) = (self.rows, self.cols);
        let starts = |first: fn(&Tile) -> u32, count: fn(&Tile) -> u32, end: u32| {
            let mut all: Vec<u32> = self.tiles.iter().flat_map(|t| [first(t), first(t) + count(t)]).collect();
            all.extend([0, end]);
            all.retain(|&v| v <= end);
            all.sort_unstable();
            all.dedup();
            all
        };
        self.row_starts = starts(|t| t.row, |t| t.layout.rows, rows);
        self.col_starts = starts(|t| t.col, |t| t.layout.cols, cols);
        let across = self.col_starts.len() - 1;
        let mut tile_at = vec![None; (self.row_starts.len() - 1) * across];
        for (index, tile) in self.tiles.iter().enumerate() {
            let span = |starts: &[u32], low: u32, high: u32| {
                (starts.partition_point(|&s| s < low), starts.partition_point(|&s| s < high).min(starts.len() - 1))
            };
            let (r0, r1) = span(&self.row_starts, tile.row, tile.row + tile.layout.rows);
            let (c0, c1) = span(&self.col_starts, tile.col, tile.col + tile.layout.cols);
            for slot in (r0..r1).flat_map(|r| (c0..c1).map(move |c| r * across + c)) {
                tile_at[slot].get_or_insert(index as u32);
            }
        }
        self.missing = (0..tile_at.len())
            .filter(|&i| tile_at[i].is_none())
            .map(|i| (i / across, i % across))
            .map(|(r, c)| [self.row_starts[r], self.col_starts[c], self.row_starts[r + 1], self.col_starts[c + 1]])
            .collect();
        self.tile_at = tile_at;
    }

    fn tile_of(&self, row: u32, col: u32) -> Option<&Tile> {
        if let [only] = self.tiles.as_slice() {
            return Some(only);
        }
        let r = self.row_starts.partition_point(|&s| s <= row).checked_sub(1)?;
        let c = self.col_starts.partition_point(|&s| s <= col).checked_sub(1)?;
        let index = *self.tile_at.get(r * (self.col_starts.len() - 1) + c)?;
        self.tiles.get(index? as usize)
    }

    /// The place of latitude and longitude if inside (poles and the antimeridian closed).
    pub fn place(&self, lat_rad: f64, lon_rad: f64) -> Option<Place> {
        let (col, row) = self.placement.locate(lat_rad, lon_rad)?;
        let hair = if self.placement.is_geographic() { ON_POST } else { 4.0 * CONTROL_TOLERANCE };
        let last_row = f64::from(self.rows - 1);
        let row_inside = (row >= -hair || self.to_pole.0) && (row <= last_row + hair || self.to_pole.1);
        let last_col = f64::from(self.cols - 1);
        let col_inside = self.wraps || (col >= -hair && col <= last_col + hair);
        if !row_inside || !col_inside {
            return None;
        }
        let col = if self.wraps { col.rem_euclid(f64::from(self.cols)) } else { col.clamp(0.0, last_col) };
        Some(Place { row: row.clamp(0.0, last_row), col })
    }

    /// The posts around a place with their bilinear weights; those with weight 0 are not needed.
    pub fn corners(&self, place: Place) -> [(u32, u32, f64); 4] {
        let split = |v: f64, last: u32| {
            let floor = v.floor();
            let (mut t, mut first) = (v - floor, floor as u32);
            if t < ON_POST {
                t = 0.0;
            } else if t > 1.0 - ON_POST {
                (t, first) = (0.0, first + 1);
            }
            (first.min(last), t)
        };
        let (row, t) = split(place.row, self.rows - 1);
        let (mut col, s) = split(place.col, if self.wraps { self.cols } else { self.cols - 1 });
        let mut next_col = (col + 1).min(self.cols - 1);
        if self.wraps {
            (col, next_col) = (col % self.cols, (col + 1) % self.cols);
        }
        let next_row = (row + 1).min(self.rows - 1);
        [
            (row, col, (1.0 - s) * (1.0 - t)),
            (row, next_col, s * (1.0 - t)),
            (next_row, col, (1.0 - s) * t),
            (next_row, next_col, s * t),
        ]
    }

    /// Size of a step of rows and of columns on the ground, metres (mean radius is near enough: seams and
    /// refinement hang on it, no height does).
    pub fn steps_m(&self, lat_rad: f64) -> (f64, f64) {
        let (ns, ew) = self.placement.steps_rad();
        let shrink = if self.placement.is_geographic() { lat_rad.cos() } else { 1.0 };
        (ns * SEMI_MAJOR_M, ew * shrink * SEMI_MAJOR_M)
    }

    /// Distance on the ground from a place to where the posts end, at most `up_to_m`; metres.
    pub fn distance_to_edge_m(&self, place: Place, lat_rad: f64, up_to_m: f64) -> f64 {
        let (row_m, col_m) = self.steps_m(lat_rad);
        let mut nearest_m = up_to_m;
        if !self.to_pole.0 {
            nearest_m = nearest_m.min(place.row * row_m);
        }
        if !self.to_pole.1 {
            nearest_m = nearest_m.min((f64::from(self.rows - 1) - place.row) * row_m);
        }
        if !self.wraps {
            nearest_m = nearest_m.min(place.col.min(f64::from(self.cols - 1) - place.col) * col_m);
        }
        for &[r0, c0, r1, c1] in &self.missing {
            // The posts beside a gap are the last that there are.
            let beyond = |v: f64, low: u32, high: u32| (f64::from(low) - 1.0 - v).max(v - f64::from(high)).max(0.0);
            let (down, across) = (beyond(place.row, r0, r1) * row_m, beyond(place.col, c0, c1) * col_m);
            if down < nearest_m && across < nearest_m {
                nearest_m = nearest_m.min(down.hypot(across));
            }
        }
        nearest_m.max(0.0)
    }

    /// Where its tiles are, poles closed; none crosses the antimeridian.
    pub fn bounds(&self) -> Vec<GeoBounds> {
        let one = |row: u32, col: u32, rows: u32, cols: u32| {
            let low_row = if row == 0 && self.to_pole.0 { -1.01 } else { f64::from(row) };
            let end = row + rows;
            let high_row = if end == self.rows && self.to_pole.1 { f64::from(end) + 0.01 } else { f64::from(end - 1) };
            let last_col =
                if self.wraps && cols >= self.cols { f64::from(self.cols) } else { f64::from(col + cols - 1) };
            self.placement.bounds((f64::from(col), low_row), (last_col, high_row))
        };
        if self.missing.is_empty() {
            return one(0, 0, self.rows, self.cols);
        }
        self.tiles.iter().flat_map(|t| one(t.row, t.col, t.layout.rows, t.layout.cols)).collect()
    }

    /// Rows and columns that hold every post in the bounds: once for each turn round the Earth that meets them, so that
    /// the first column of a grid that wraps counts on both sides of its seam.
    pub fn spans(&self, bounds: &GeoBounds) -> Vec<Span> {
        match &self.placement {
            Placement::Geographic { west_deg, lon_step_deg, first_lat_deg, lat_step_deg, .. } => {
                let row = |lat_rad: f64| (lat_rad.to_degrees() - first_lat_deg) / lat_step_deg;
                let (a, b) = (row(bounds.south_rad), row(bounds.north_rad));
                let rows = inclusive(a.min(b), a.max(b), 0, i64::from(self.rows) - 1);
                [-360.0, 0.0, 360.0]
                    .iter()
                    .filter_map(|turn| {
                        let col = |lon_rad: f64| (lon_rad.to_degrees() + turn - west_deg) / lon_step_deg;
                        let cols = inclusive(col(bounds.west_rad), col(bounds.east_rad), 0, i64::from(self.cols) - 1);
                        (!cols.is_empty() && !rows.is_empty()).then(|| Span {
                            rows: rows.clone(),
                            cols,
                            turn_deg: *turn,
                        })
                    })
                    .collect()
            }
            Placement::Warped(_) => self.warped_span(bounds).into_iter().collect(),
        }
    }

    fn warped_span(&self, bounds: &GeoBounds) -> Option<Span> {
        const STEPS: u32 = 16;
        let (mut low, mut high) = ((f64::INFINITY, f64::INFINITY), (f64::NEG_INFINITY, f64::NEG_INFINITY));
        for own in self.bounds() {
            let Some(shared) = own.intersection(bounds) else { continue };
            for i in 0..(STEPS + 1) * (STEPS + 1) {
                let fraction = |k: u32| f64::from(k) / f64::from(STEPS);
                let at = shared.at(fraction(i % (STEPS + 1)), fraction(i / (STEPS + 1)), 0.0);
                if let Some((col, row)) = self.placement.locate(at.lat_rad, at.lon_rad) {
                    low = (low.0.min(col), low.1.min(row));
                    high = (high.0.max(col), high.1.max(row));
                }
            }
        }
        // Between the places asked, borders bulge by less than a sixteenth of what is spanned.
        let margin = ((high.0 - low.0) / f64::from(STEPS) + 2.0, (high.1 - low.1) / f64::from(STEPS) + 2.0);
        if !(margin.0.is_finite() && margin.1.is_finite()) {
            return None;
        }
        let cols = inclusive(low.0 - margin.0, high.0 + margin.0, 0, i64::from(self.cols) - 1);
        let rows = inclusive(low.1 - margin.1, high.1 + margin.1, 0, i64::from(self.rows) - 1);
        Some(Span { rows, cols, turn_deg: 0.0 })
    }

    /// Latitude and longitude of a span's post, in the frame of the bounds; none outside them.
    pub fn post_in(&self, bounds: &GeoBounds, span: &Span, row: u32, index: i64) -> Option<(f64, f64)> {
        match &self.placement {
            Placement::Geographic { west_deg, lon_step_deg, first_lat_deg, lat_step_deg, .. } => {
                let lat_deg = (first_lat_deg + f64::from(row) * lat_step_deg).clamp(-90.0, 90.0);
                let lon_deg = west_deg + index as f64 * lon_step_deg - span.turn_deg;
                // Spans take posts in that are on the border up to rounding: they are put on it.
                let lat_rad = lat_deg.to_radians().clamp(bounds.south_rad, bounds.north_rad);
                Some((lat_rad, lon_deg.to_radians().clamp(bounds.west_rad, bounds.east_rad)))
            }
            Placement::Warped(_) => {
                let (lat_rad, lon_rad) = self.placement.lat_lon_rad(index as f64, f64::from(row));
                bounds.contains(lat_rad, lon_rad).then_some((lat_rad, lon_rad))
            }
        }
    }
}

/// Rows and columns, half open.
#[derive(Clone, Debug)]
pub struct Span {
    pub rows: std::ops::Range<i64>,
    pub cols: std::ops::Range<i64>,
    /// Longitudes of the grid are this much above those of the bounds asked for, degrees.
    pub turn_deg: f64,
}

/// Whole numbers in low…high (with a hair's tolerance) and in min…max.
fn inclusive(low: f64, high: f64, min: i64, max: i64) -> std::ops::Range<i64> {
    let first = ((low - ON_POST).ceil() as i64).max(min);
    let last = ((high + ON_POST).floor() as i64).min(max);
    first..(last + 1).max(first)
}

/// Looks posts up, and remembers the block that it last found one in.
pub struct Cursor<'a> {
    grid: &'a HeightGrid,
    cache: &'a BlockCache,
    held: Option<Held>,
}

struct Held {
    row: u32,
    col: u32,
    rows: u32,
    cols: u32,
    block: Arc<Block>,
}

impl<'a> Cursor<'a> {
    pub fn new(grid: &'a HeightGrid, cache: &'a BlockCache) -> Self {
        Self { grid, cache, held: None }
    }

    /// Height of a post as in the source, metres; none where it is void or missing.
    pub fn post(&mut self, row: u32, col: u32) -> Option<f32> {
        let inside = |h: &Held| row.wrapping_sub(h.row) < h.rows && col.wrapping_sub(h.col) < h.cols;
        if !self.held.as_ref().is_some_and(inside) {
            self.held = Some(self.fetch(row, col)?);
        }
        let held = self.held.as_ref()?;
        held.block.get(((row - held.row) * held.cols + (col - held.col)) as usize)
    }

    fn fetch(&self, row: u32, col: u32) -> Option<Held> {
        let tile = self.grid.tile_of(row, col)?;
        let (r, c) = (row - tile.row, col - tile.col);
        let index = r / tile.layout.block_rows * tile.layout.blocks_across() + c / tile.layout.block_cols;
        let extent = tile.layout.extent(index);
        let block = self.cache.get(tile.first_slot + index)?;
        Some(Held {
            row: tile.row + extent.row,
            col: tile.col + extent.col,
            rows: extent.rows,
            cols: extent.cols,
            block,
        })
    }
}
