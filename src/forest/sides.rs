//! How long the sides of cells are.

use super::CellId;
use super::Zone;
use super::cell::ZONE_ROWS;
use super::thinning::columns;
use crate::geodesy::{meridian_radius_m, prime_vertical_radius_m};
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};

/// Lengths of a cell's sides on the ellipsoid, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CellSides {
    pub south_m: f64,
    pub north_m: f64,
    pub height_m: f64,
}

impl CellId {
    /// South and north along the parallels; the height along the meridian, by its radius in the middle.
    pub fn sides_m(self) -> CellSides {
        let bounds = self.bounds();
        let along_parallel = |lat_rad: f64| {
            let (sin, cos) = lat_rad.sin_cos();
            prime_vertical_radius_m(sin) * cos.max(0.0) * bounds.width_rad()
        };
        CellSides {
            south_m: along_parallel(bounds.south_rad),
            north_m: along_parallel(bounds.north_rad),
            height_m: meridian_radius_m(bounds.center().lat_rad.sin()) * bounds.height_rad(),
        }
    }

    /// L_q (Davis et al. 1999, §III): the least side over the cell and its neighbours, a pole's zero side excepted;
    /// metres. An object with `reach < l_q_m` whose centre is in the cell reaches no quadrant of which
    /// `cells::linked_cells` does not name the cell.
    ///
    /// For that to hold on a curved Earth and not only in the limit of small cells, sides are taken as chords, the
    /// height by the meridian's least radius, polar cells also at half their height, where their quadrants meet, and a
    /// square's corners, which reach farther towards the equator than the middle of its side, are kept within half a
    /// height as well. From level 5 on all this takes 2.6 % in polar cells, less than 1 % near them and nothing to
    /// speak of elsewhere; at levels 0 to 4 up to half.
    pub fn l_q_m(self) -> f64 {
        let (row, level) = (self.row_column().0, self.level());
        let last = (ZONE_ROWS << level) - 1;
        let side_rad = FRAC_PI_4 / f64::from(1u32 << level);
        let (mut least, mut radius_m, mut corner) = (f64::INFINITY, f64::INFINITY, 0.0);
        for near in row.saturating_sub(1)..=(row + 1).min(last) {
            let zone = Zone::from_row_column(near >> level, 0);
            let half_width = FRAC_PI_4 / 2.0 / f64::from(columns(zone, level, near & ((1 << level) - 1)));
            // Southern rows are mirrored, so that rows count from the equator.
            let from_equator = if zone.is_northern() { near - (last / 2 + 1) } else { last / 2 - near };
            let edge = |rows: f64| Parallel::new((f64::from(from_equator) + rows) * side_rad);
            let (equatorward, poleward) = (edge(0.0), edge(1.0));
            least = least.min(equatorward.chord_m(half_width));
            radius_m = radius_m.min(meridian_radius_m(equatorward.sin));
            if near == row {
                corner = equatorward.largest_half_square(side_rad);
            }
            let is_polar = near == 0 || near == last;
            if !is_polar {
                least = least.min(poleward.chord_m(half_width));
            } else if near == row || level == 0 {
                least = least.min(edge(0.5).chord_m(half_width));
            }
        }
        least.min(2.0 * corner * radius_m) * (1.0 - ROUNDING)
    }
}

/// Latitudes are good to this part of the smallest cell.
const ROUNDING: f64 = 1e-8;

struct Parallel {
    sin: f64,
    cos: f64,
    across_m: f64,
}

impl Parallel {
    fn new(lat_rad: f64) -> Self {
        let (sin, cos) = (lat_rad.sin(), (FRAC_PI_2 - lat_rad).sin());
        Self { sin, cos, across_m: prime_vertical_radius_m(sin) * cos }
    }

    fn chord_m(&self, half_width_rad: f64) -> f64 {
        2.0 * self.across_m * half_width_rad.sin()
    }

    /// The largest half side r of a square on this parallel, on a sphere of radius 1, whose equatorward corners come
    /// down by no more than half of `height_rad`: they lie at sin φ' = √(1 − 2r²) sin φ − r cos φ, and the root is at
    /// least 1 − r² − 2r⁴ as long as 2r² ≤ 0.6; in the last term r is taken as half the height, which leaves a
    /// quadratic equation.
    fn largest_half_square(&self, height_rad: f64) -> f64 {
        let sin_half = (height_rad / 2.0).sin();
        // sin φ − sin(φ − h/2)
        let drop = self.sin * (height_rad / 4.0).sin().powi(2) * 2.0 + self.cos * sin_half;
        let bulge = self.sin * (1.0 + 2.0 * sin_half * sin_half);
        2.0 * drop / (self.cos + (self.cos * self.cos + 4.0 * bulge * drop).sqrt())
    }
}
