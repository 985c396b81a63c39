//! A plane about a set of objects, turned along their walls.

use crate::content::Prism;
use crate::prepare::buildings::clean;
use geo::Coord;
use std::f64::consts::{FRAC_PI_2, TAU};

/// Metres about a place, x along the walls. Longitudes are taken as they are: objects of one zone.
#[derive(Clone, Copy, Debug)]
pub struct Plane {
    plane: clean::Plane,
    /// Cosine and sine of the x axis over east.
    turn: [f64; 2],
}

impl Plane {
    /// About the middle of some objects' bounds, with the axes along most of their walls' length.
    pub fn along_walls<'p>(prisms: impl Iterator<Item = &'p Prism> + Clone) -> Self {
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for &[lon, lat] in prisms.clone().flat_map(|prism| prism.rings.iter().flatten()) {
            low = [low[0].min(lon), low[1].min(lat)];
            high = [high[0].max(lon), high[1].max(lat)];
        }
        let origin = [0, 1].map(|axis| if low[axis] <= high[axis] { (low[axis] + high[axis]) / 2.0 } else { 0.0 });
        let mut plane = Self { plane: clean::Plane::about(origin), turn: [1.0, 0.0] };
        let turn_rad = plane.wall_turn_rad(prisms);
        plane.turn = [turn_rad.cos(), turn_rad.sin()];
        plane
    }

    /// The walls' mean direction by length, walls at right angles taken as the same: a mean over four times the angle.
    fn wall_turn_rad<'p>(&self, prisms: impl Iterator<Item = &'p Prism>) -> f64 {
        let mut sum = [0.0; 2];
        for ring in prisms.flat_map(|prism| &prism.rings) {
            let Some(last) = ring.last() else { continue };
            let mut from = self.to(*last);
            for corner in ring {
                let to = self.to(*corner);
                let (x, y) = (to[0] - from[0], to[1] - from[1]);
                from = to;
                // The fourth power of x + iy has four times its angle; over its length cubed it has its length.
                let (square, twice) = (x * x - y * y, 2.0 * x * y);
                let length = (x * x + y * y).sqrt();
                let scale = 1.0 / (length * length * length);
                if scale.is_finite() {
                    sum[0] += (square * square - twice * twice) * scale;
                    sum[1] += 2.0 * square * twice * scale;
                }
            }
        }
        (sum[1].atan2(sum[0]).rem_euclid(TAU) / 4.0) % FRAC_PI_2
    }

    /// Longitude and latitude, radians, to metres.
    pub fn to(&self, corner: [f64; 2]) -> [f64; 2] {
        let Coord { x: east, y: north } = self.plane.to(corner);
        let [cos, sin] = self.turn;
        [east * cos + north * sin, north * cos - east * sin]
    }

    pub fn back(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [cos, sin] = self.turn;
        self.plane.back(Coord { x: x * cos - y * sin, y: x * sin + y * cos })
    }
}
