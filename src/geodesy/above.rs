//! How far a point is at least from all that lies above and below a rectangle: meridians and parallels bound it by planes
//! and cones, which cost a tenth of a box.

use super::{ECCENTRICITY_SQ, Ecef, GeoBounds, Geodetic, Point, prime_vertical_radius_m};
use std::f64::consts::{FRAC_PI_2, TAU};

/// A point that distances are taken from.
#[derive(Clone, Copy, Debug)]
pub struct Viewpoint {
    place: Geodetic,
    /// Distances from the axis and from the equator's plane, metres; the latter towards north.
    across_m: f64,
    along_m: f64,
}

impl Viewpoint {
    /// `place`: its longitude within ±π.
    pub fn new(place: Geodetic) -> Self {
        let ecef: Point<Ecef> = place.to_ecef();
        let ecef = ecef.xyz();
        Self { place, across_m: ecef.x.hypot(ecef.y), along_m: ecef.z }
    }

    /// No more than the distance from any point over or under the rectangle (above −6000 km), 0 where the point is over it
    /// itself; metres. The larger of the distances from its nearer meridian's half-plane and its nearer parallel's cone
    /// of normals; the first alone where that is `enough_m`.
    pub fn at_least_m(&self, bounds: &GeoBounds, enough_m: f64) -> f64 {
        let across_m = self.across_meridians_m(bounds);
        if across_m >= enough_m { across_m } else { across_m.max(self.across_parallels_m(bounds)) }
    }

    fn across_meridians_m(&self, bounds: &GeoBounds) -> f64 {
        let half_rad = bounds.width_rad() / 2.0;
        let from_middle_rad = (self.place.lon_rad - bounds.west_rad - half_rad).abs();
        let beyond_rad = from_middle_rad.min(TAU - from_middle_rad) - half_rad;
        match beyond_rad {
            rad if rad <= 0.0 => 0.0,
            rad if rad < FRAC_PI_2 => self.across_m * rad.sin(),
            _ => self.across_m,
        }
    }

    fn across_parallels_m(&self, bounds: &GeoBounds) -> f64 {
        let lat_rad = self.place.lat_rad;
        if lat_rad < bounds.south_rad {
            -self.above_cone_m(bounds.south_rad)
        } else if lat_rad > bounds.north_rad {
            self.above_cone_m(bounds.north_rad)
        } else {
            0.0
        }
    }

    /// Signed distance from the cone of the normals along a parallel, positive north of it. The normals meet on the axis at
    /// −e² N sin φ.
    fn above_cone_m(&self, lat_rad: f64) -> f64 {
        let (sin, cos) = lat_rad.sin_cos();
        let apex_m = -ECCENTRICITY_SQ * prime_vertical_radius_m(sin) * sin;
        (self.along_m - apex_m) * cos - self.across_m * sin
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geodesy::OrientedBox;
    use proptest::prelude::*;
    use std::f64::consts::PI;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]

        #[test]
        fn nothing_over_a_rectangle_is_nearer(
            (lat, lon) in (-1.57..1.57f64, -PI..PI), height_m in -5e3..3e7f64,
            (south, west) in (-1.57..1.5f64, -PI..3.0), (high_rad, wide_rad) in (1e-4..0.7f64, 1e-4..0.7f64),
            (u, v) in (0.0..1.0f64, 0.0..1.0f64), (at_m, enough_m) in (-1e4..1e5f64, 0.0..1e7f64),
        ) {
            let north_rad = (south + high_rad).min(FRAC_PI_2);
            let bounds = GeoBounds { west_rad: west, south_rad: south, east_rad: (west + wide_rad).min(PI), north_rad };
            let eye = Geodetic { lat_rad: lat, lon_rad: lon, height_m };
            let least_m = Viewpoint::new(eye).at_least_m(&bounds, enough_m);
            let there = bounds.at(u, v, at_m).to_ecef();
            let distance_m = (there - eye.to_ecef()).xyz().length();
            prop_assert!(least_m <= distance_m + 1e-6, "{least_m} > {distance_m}");
            prop_assert!(!bounds.contains(lat, lon) || least_m == 0.0);
        }
    }

    #[test]
    fn a_far_zone_is_told_by_its_meridian_and_a_near_one_closely() {
        let eye = Geodetic::from_degrees(10.0, 179.0, 1000.0);
        let viewpoint = Viewpoint::new(eye);
        let of = |west, south, east, north| {
            let bounds = GeoBounds::from_degrees(west, south, east, north);
            let boxed_m = OrientedBox::around(&bounds, 0.0, 100.0).distance_m(eye.to_ecef());
            (viewpoint.at_least_m(&bounds, f64::INFINITY), boxed_m)
        };
        // Across the antimeridian.
        let (least_m, boxed_m) = of(-180.0, 9.0, -179.0, 11.0);
        assert!(least_m > 0.99 * boxed_m && least_m <= boxed_m * 1.01, "{least_m} {boxed_m}");
        let (least_m, boxed_m) = of(178.5, 12.0, 179.5, 13.0);
        assert!(least_m > 0.99 * boxed_m && least_m <= boxed_m * 1.01, "{least_m} {boxed_m}");
        assert!(of(0.0, -45.0, 45.0, 0.0).0 > 6e6);
    }
}
