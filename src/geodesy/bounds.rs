//! Bounds of pieces of the Earth: in latitude and longitude, and as oriented boxes in space.

use super::{ECCENTRICITY_SQ, Ecef, Geodetic, Point, prime_vertical_radius_m};
use glam::{DVec2, DVec3};
use std::f64::consts::PI;

/// A latitude–longitude rectangle that does not cross the antimeridian; radians.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GeoBounds {
    pub west_rad: f64,
    pub south_rad: f64,
    pub east_rad: f64,
    pub north_rad: f64,
}

impl GeoBounds {
    pub fn from_degrees(west: f64, south: f64, east: f64, north: f64) -> Self {
        Self {
            west_rad: west.to_radians(),
            south_rad: south.to_radians(),
            east_rad: east.to_radians(),
            north_rad: north.to_radians(),
        }
    }

    pub fn width_rad(&self) -> f64 {
        self.east_rad - self.west_rad
    }

    pub fn height_rad(&self) -> f64 {
        self.north_rad - self.south_rad
    }

    /// The place at fractions `u` (0 west, 1 east) and `v` (0 south, 1 north) of the rectangle.
    pub fn at(&self, u: f64, v: f64, height_m: f64) -> Geodetic {
        Geodetic {
            lat_rad: self.south_rad + v * self.height_rad(),
            lon_rad: self.west_rad + u * self.width_rad(),
            height_m,
        }
    }

    pub fn center(&self) -> Geodetic {
        self.at(0.5, 0.5, 0.0)
    }

    /// Fractions (u, v) of a place; outside 0..1 where it lies outside.
    pub fn fractions(&self, lat_rad: f64, lon_rad: f64) -> (f64, f64) {
        ((lon_rad - self.west_rad) / self.width_rad(), (lat_rad - self.south_rad) / self.height_rad())
    }

    pub fn contains(&self, lat_rad: f64, lon_rad: f64) -> bool {
        (self.south_rad..=self.north_rad).contains(&lat_rad) && (self.west_rad..=self.east_rad).contains(&lon_rad)
    }

    pub fn intersects(&self, other: &Self) -> bool {
        self.west_rad <= other.east_rad
            && other.west_rad <= self.east_rad
            && self.south_rad <= other.north_rad
            && other.south_rad <= self.north_rad
    }

    pub fn intersection(&self, other: &Self) -> Option<Self> {
        self.intersects(other).then(|| Self {
            west_rad: self.west_rad.max(other.west_rad),
            south_rad: self.south_rad.max(other.south_rad),
            east_rad: self.east_rad.min(other.east_rad),
            north_rad: self.north_rad.min(other.north_rad),
        })
    }

    pub fn union(&self, other: &Self) -> Self {
        Self {
            west_rad: self.west_rad.min(other.west_rad),
            south_rad: self.south_rad.min(other.south_rad),
            east_rad: self.east_rad.max(other.east_rad),
            north_rad: self.north_rad.max(other.north_rad),
        }
    }
}

/// A box with its own axes in space; bounds a cell between two heights.
#[derive(Clone, Copy, Debug)]
pub struct OrientedBox {
    pub center: Point<Ecef>,
    /// Unit axes.
    pub axes: [DVec3; 3],
    /// Half sides along the axes, metres.
    pub half_m: DVec3,
}

impl OrientedBox {
    /// The least box, in the east-north-up frame of the rectangle's centre, around the shell of `bounds` between two
    /// heights above −6000 km.
    ///
    /// In closed form: a point at latitude φ, Δλ from the middle meridian and height h has, with
    /// R = (N + h) cos φ and Z = (N(1 − e²) + h) sin φ, less the origin's, the coordinates
    /// east R sin Δλ, north −sin φ₀ R cos Δλ + cos φ₀ Z, up cos φ₀ R cos Δλ + sin φ₀ Z. Each is linear in h and in
    /// cos Δλ, so extremes lie at their ends; in latitude they lie at the ends or where the derivative is zero:
    /// tan φ = tan φ₀ / cos Δλ for up, −cot φ₀ / cos Δλ for north.
    pub fn around(bounds: &GeoBounds, low_m: f64, high_m: f64) -> Self {
        let ecef_from_enu = bounds.center().ecef_from_enu();
        let (low, high) = shell_extent(bounds, low_m, high_m);
        let rotation = ecef_from_enu.rotation();
        Self {
            center: ecef_from_enu * Point::new((low + high) / 2.0),
            axes: [rotation.x_axis, rotation.y_axis, rotation.z_axis],
            half_m: (high - low) / 2.0 + Self::ROUNDING_M,
        }
    }

    /// What rounding may take away, metres.
    const ROUNDING_M: f64 = 1e-7;

    /// Distance from a point to the box, 0 inside; metres.
    pub fn distance_m(&self, point: Point<Ecef>) -> f64 {
        let d = (point - self.center).xyz();
        let local = DVec3::new(d.dot(self.axes[0]), d.dot(self.axes[1]), d.dot(self.axes[2]));
        (local.abs() - self.half_m).max(DVec3::ZERO).length()
    }

    pub fn corners(&self) -> [Point<Ecef>; 8] {
        std::array::from_fn(|i| {
            let sign = |bit: usize| if i >> bit & 1 == 1 { 1.0 } else { -1.0 };
            let offset = (0..3).map(|a| self.axes[a] * self.half_m[a] * sign(a)).sum::<DVec3>();
            Point::new(self.center.xyz() + offset)
        })
    }

    /// Largest distance of the box from the plane through its centre with unit normal `normal`.
    pub fn extent_along_m(&self, normal: DVec3) -> f64 {
        (0..3).map(|a| (self.axes[a].dot(normal) * self.half_m[a]).abs()).sum()
    }
}

/// A latitude's circle on the ellipsoid: what [`OrientedBox::around`] needs of it.
struct Parallel {
    sin: f64,
    cos: f64,
    /// Distances from the axis and from the equator's plane, metres.
    across_m: f64,
    along_m: f64,
}

impl Parallel {
    fn new(lat_rad: f64) -> Self {
        let (sin, cos) = lat_rad.sin_cos();
        let n = prime_vertical_radius_m(sin);
        Self { sin, cos, across_m: n * cos, along_m: n * (1.0 - ECCENTRICITY_SQ) * sin }
    }

    fn across_at_m(&self, height_m: f64) -> f64 {
        self.across_m + height_m * self.cos
    }
}

/// Least and greatest east, north and up of the shell from the rectangle's centre at height 0; metres.
fn shell_extent(bounds: &GeoBounds, low_m: f64, high_m: f64) -> (DVec3, DVec3) {
    let origin = Parallel::new(bounds.center().lat_rad);
    let half_width = (bounds.width_rad() / 2.0).clamp(0.0, PI);
    let (sin_far, cos_far) = half_width.sin_cos();
    let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
    let mut take = |parallel: &Parallel, cos_lon: f64| {
        for height_m in [low_m, high_m] {
            let across = parallel.across_at_m(height_m) * cos_lon - origin.across_m;
            let along = parallel.along_m + height_m * parallel.sin - origin.along_m;
            let p = DVec2::new(origin.cos * along - origin.sin * across, origin.cos * across + origin.sin * along);
            low = low.min(p);
            high = high.max(p);
        }
    };
    let ends = [Parallel::new(bounds.south_rad), Parallel::new(bounds.north_rad)];
    for parallel in &ends {
        take(parallel, 1.0);
        take(parallel, cos_far);
    }
    // Straight ahead the highest point is the origin's zenith; at the far meridians an extreme within the rectangle
    // is a highest point too, lower than this one, unless they lie beyond 90°.
    take(&origin, 1.0);
    if cos_far < 0.0 {
        for stationary in [origin.sin.atan2(origin.cos * cos_far), (-origin.cos).atan2(origin.sin * cos_far)] {
            // Latitudes are the two angles' values within ±90°.
            let lat_rad = stationary.tan().atan();
            take(&Parallel::new(lat_rad.clamp(bounds.south_rad, bounds.north_rad)), cos_far);
        }
    }
    let widest = if bounds.south_rad <= 0.0 && bounds.north_rad >= 0.0 {
        Parallel::new(0.0).across_at_m(high_m)
    } else {
        ends[0].across_at_m(high_m).max(ends[1].across_at_m(high_m))
    };
    let east = widest * if cos_far < 0.0 { 1.0 } else { sin_far };
    (DVec3::new(-east, low.x, low.y), DVec3::new(east, high.x, high.y))
}
