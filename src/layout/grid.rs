//! Navigation cells: a grid over the ground by bands of altitude.

use crate::geodesy::{GeoBounds, Geodetic, meridian_radius_m, prime_vertical_radius_m};
use serde::{Deserialize, Serialize};

/// Most cells of a layout.
pub const CELLS_MAX: u64 = 1 << 20;

/// A cell of a [`NavGrid`]; columns from the west, rows from the south, bands from the ground.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct NavCell {
    pub band: u32,
    pub row: u32,
    pub column: u32,
}

/// To an adjacent cell: one that shares an edge, or the one of the next band.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    West,
    East,
    South,
    North,
    Down,
    Up,
}

impl Direction {
    pub const ALL: [Self; 6] = [Self::West, Self::East, Self::South, Self::North, Self::Down, Self::Up];

    /// Steps by column, row and band.
    fn step(self) -> (i64, i64, i64) {
        match self {
            Self::West => (-1, 0, 0),
            Self::East => (1, 0, 0),
            Self::South => (0, -1, 0),
            Self::North => (0, 1, 0),
            Self::Down => (0, 0, -1),
            Self::Up => (0, 0, 1),
        }
    }
}

/// Where the cells lie. Cells have their side along meridians everywhere, along parallels in the middle of the region.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct NavGrid {
    west_rad: f64,
    south_rad: f64,
    lon_step_rad: f64,
    lat_step_rad: f64,
    columns: u32,
    rows: u32,
    side_m: f64,
    /// Heights above ground at which bands end and begin, ascending, metres.
    bands_m: Vec<f64>,
    /// Ground at the corners of the columns and rows, from the south-west, row by row, metres above the ellipsoid.
    ground_m: Vec<f32>,
}

impl NavGrid {
    /// As many cells as cover the bounds. `ground_m` gives the height of the ground at a latitude and longitude, radians.
    pub fn new<E>(
        bounds: &GeoBounds,
        side_m: f64,
        bands_m: &[f64],
        mut ground_m: impl FnMut(f64, f64) -> Result<f64, E>,
    ) -> Result<Self, E> {
        let (sin, cos) = bounds.center().lat_rad.sin_cos();
        let lat_step_rad = side_m / meridian_radius_m(sin);
        let lon_step_rad = side_m / (prime_vertical_radius_m(sin) * cos);
        // A region that is a multiple of the side but for rounding has no sliver of a last cell.
        let count = |extent_rad: f64, step_rad: f64| ((extent_rad / step_rad - 1e-6).ceil().max(1.0)) as u32;
        let (columns, rows) = (count(bounds.width_rad(), lon_step_rad), count(bounds.height_rad(), lat_step_rad));
        let mut grid = Self {
            west_rad: bounds.west_rad,
            south_rad: bounds.south_rad,
            lon_step_rad,
            lat_step_rad,
            columns,
            rows,
            side_m,
            bands_m: bands_m.to_vec(),
            ground_m: Vec::new(),
        };
        for row in 0..=rows {
            for column in 0..=columns {
                let (lat_rad, lon_rad) = grid.place(f64::from(column), f64::from(row));
                grid.ground_m.push(ground_m(lat_rad, lon_rad)? as f32);
            }
        }
        Ok(grid)
    }

    /// How many cells a grid would have.
    pub fn cells_for(bounds: &GeoBounds, side_m: f64, bands: usize) -> f64 {
        let (sin, cos) = bounds.center().lat_rad.sin_cos();
        let high = (bounds.height_rad() * meridian_radius_m(sin) / side_m).ceil();
        let wide = (bounds.width_rad() * prime_vertical_radius_m(sin) * cos / side_m).ceil();
        high * wide * bands as f64
    }

    /// Whether what was read of a file is a grid.
    pub fn is_sound(&self) -> bool {
        let numbers = [self.west_rad, self.south_rad, self.lon_step_rad, self.lat_step_rad, self.side_m];
        let corners = (u64::from(self.columns) + 1).saturating_mul(u64::from(self.rows) + 1);
        numbers.iter().all(|number| number.is_finite())
            && self.lon_step_rad > 0.0
            && self.lat_step_rad > 0.0
            && self.columns > 0
            && self.rows > 0
            && self.bands_m.len() >= 2
            && self.bands_m.iter().all(|edge| edge.is_finite())
            && self.bands_m.is_sorted_by(|a, b| a < b)
            && self.ground_m.len() as u64 == corners
            && u64::from(self.columns) * u64::from(self.rows) <= CELLS_MAX / self.bands().max(1) as u64
    }

    pub fn side_m(&self) -> f64 {
        self.side_m
    }

    pub fn columns(&self) -> u32 {
        self.columns
    }

    pub fn rows(&self) -> u32 {
        self.rows
    }

    pub fn bands(&self) -> usize {
        self.bands_m.len() - 1
    }

    /// Lowest and highest height above ground of a band, metres.
    pub fn band_m(&self, band: u32) -> (f64, f64) {
        (self.bands_m[band as usize], self.bands_m[band as usize + 1])
    }

    pub fn cell_count(&self) -> usize {
        self.columns as usize * self.rows as usize * self.bands()
    }

    /// From 0 on, by band, row and column.
    pub fn number(&self, cell: NavCell) -> usize {
        (cell.band as usize * self.rows as usize + cell.row as usize) * self.columns as usize + cell.column as usize
    }

    /// The cell of a number below [`NavGrid::cell_count`].
    pub fn cell(&self, number: usize) -> NavCell {
        let (columns, rows) = (self.columns as usize, self.rows as usize);
        NavCell {
            band: (number / columns / rows) as u32,
            row: (number / columns % rows) as u32,
            column: (number % columns) as u32,
        }
    }

    pub fn cells(&self) -> impl Iterator<Item = NavCell> + '_ {
        (0..self.cell_count()).map(|number| self.cell(number))
    }

    pub fn neighbor(&self, cell: NavCell, direction: Direction) -> Option<NavCell> {
        let (east, north, up) = direction.step();
        let within = |at: u32, step: i64, end: usize| {
            let next = i64::from(at) + step;
            (0..end as i64).contains(&next).then_some(next as u32)
        };
        Some(NavCell {
            column: within(cell.column, east, self.columns as usize)?,
            row: within(cell.row, north, self.rows as usize)?,
            band: within(cell.band, up, self.bands())?,
        })
    }

    /// The direction of a cell that is adjacent.
    pub fn direction(&self, from: NavCell, to: NavCell) -> Option<Direction> {
        Direction::ALL.into_iter().find(|&direction| self.neighbor(from, direction) == Some(to))
    }

    /// Latitude and longitude of a place by columns and rows, radians.
    pub fn place(&self, column: f64, row: f64) -> (f64, f64) {
        (self.south_rad + row * self.lat_step_rad, self.west_rad + column * self.lon_step_rad)
    }

    pub fn bounds(&self, cell: NavCell) -> GeoBounds {
        let (south_rad, west_rad) = self.place(cell.column.into(), cell.row.into());
        GeoBounds {
            west_rad,
            south_rad,
            east_rad: west_rad + self.lon_step_rad,
            north_rad: south_rad + self.lat_step_rad,
        }
    }

    /// Columns and rows of a place from the south-west corner.
    fn fractions(&self, lat_rad: f64, lon_rad: f64) -> (f64, f64) {
        ((lon_rad - self.west_rad) / self.lon_step_rad, (lat_rad - self.south_rad) / self.lat_step_rad)
    }

    /// Ground by the corners, bilinear between them, metres above the ellipsoid; beyond the grid that of its edge.
    pub fn ground_m(&self, column: f64, row: f64) -> f64 {
        let (column, row) = (column.clamp(0.0, self.columns.into()), row.clamp(0.0, self.rows.into()));
        let (west, south) =
            (column.floor().min(f64::from(self.columns - 1)), row.floor().min(f64::from(self.rows - 1)));
        let (u, v) = (column - west, row - south);
        let corner = |column: f64, row: f64| {
            f64::from(self.ground_m[row as usize * (self.columns as usize + 1) + column as usize])
        };
        let south_m = corner(west, south) * (1.0 - u) + corner(west + 1.0, south) * u;
        let north_m = corner(west, south + 1.0) * (1.0 - u) + corner(west + 1.0, south + 1.0) * u;
        south_m * (1.0 - v) + north_m * v
    }

    /// The cell that an eye is in.
    pub fn locate(&self, eye: Geodetic) -> Option<NavCell> {
        let (column, row) = self.fractions(eye.lat_rad, eye.lon_rad);
        let inside = (0.0..f64::from(self.columns)).contains(&column) && (0.0..f64::from(self.rows)).contains(&row);
        if !inside {
            return None;
        }
        let above_m = eye.height_m - self.ground_m(column, row);
        let band = self.bands_m.windows(2).position(|edges| (edges[0]..edges[1]).contains(&above_m))?;
        Some(NavCell { band: band as u32, row: row as u32, column: column as u32 })
    }

    /// An eye above a place by columns and rows.
    pub fn eye(&self, column: f64, row: f64, above_m: f64) -> Geodetic {
        let (lat_rad, lon_rad) = self.place(column, row);
        Geodetic { lat_rad, lon_rad, height_m: self.ground_m(column, row) + above_m }
    }

    /// How much ground at the corners of a cell and in those around it differs, metres.
    pub fn relief_m(&self, column: f64, row: f64) -> f64 {
        let around = [(-1.0, 0.0), (1.0, 0.0), (0.0, -1.0), (0.0, 1.0)];
        let here_m = self.ground_m(column, row);
        let differences = around.map(|(east, north)| (self.ground_m(column + east, row + north) - here_m).abs());
        differences.into_iter().fold(0.0, f64::max)
    }

    pub fn byte_len(&self) -> usize {
        self.ground_m.len() * 4 + self.bands_m.len() * 8 + size_of::<Self>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid() -> NavGrid {
        let bounds = GeoBounds::from_degrees(-122.42, 37.77, -122.39, 37.80);
        NavGrid::new::<()>(&bounds, 250.0, &[2.0, 50.0, 200.0], |lat_rad, _| Ok(lat_rad * 10.0)).unwrap()
    }

    #[test]
    fn every_cell_is_found_by_its_middle_and_its_number() {
        let grid = grid();
        assert!(grid.is_sound() && grid.cell_count() == 11 * 14 * 2, "{}", grid.cell_count());
        for cell in grid.cells() {
            let (low_m, high_m) = grid.band_m(cell.band);
            let eye = grid.eye(f64::from(cell.column) + 0.5, f64::from(cell.row) + 0.5, (low_m + high_m) / 2.0);
            assert_eq!(grid.locate(eye), Some(cell));
            assert_eq!(grid.cell(grid.number(cell)), cell);
        }
        for above_m in [1.9, 200.1] {
            assert_eq!(grid.locate(grid.eye(3.0, 3.0, above_m)), None);
        }
        assert_eq!(grid.locate(grid.eye(-0.1, 3.0, 60.0)), None);
    }

    #[test]
    fn neighbors_are_mutual() {
        let grid = grid();
        let mut pairs = 0;
        for cell in grid.cells() {
            for next in Direction::ALL.into_iter().filter_map(|direction| grid.neighbor(cell, direction)) {
                assert!(grid.direction(cell, next).is_some() && grid.direction(next, cell).is_some());
                pairs += 1;
            }
        }
        assert_eq!(pairs, 2 * (2 * (10 * 14 + 11 * 13) + 11 * 14));
        let diagonal = NavCell { band: 0, row: 1, column: 1 };
        assert_eq!(grid.direction(NavCell { band: 0, row: 0, column: 0 }, diagonal), None);
    }
}
