//! Bounds of pieces of the Earth: in latitude and longitude, and as oriented boxes in space.

use super::{Ecef, Geodetic, Point, SEMI_MAJOR_M};
use glam::DVec3;
use std::f64::consts::{FRAC_PI_2, TAU};

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
    /// The box, in the east-north-up frame of the rectangle's centre, around the shell of `bounds` between two
    /// heights. It holds every point of the shell: sampled at enough points, widened by what can bulge between them.
    pub fn around(bounds: &GeoBounds, low_m: f64, high_m: f64) -> Self {
        let ecef_from_enu = bounds.center().ecef_from_enu();
        let enu_from_ecef = ecef_from_enu.inverse();
        let steps = (bounds.width_rad().max(bounds.height_rad()) / 0.1).ceil().clamp(2.0, 16.0) as u32;
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for row in 0..=steps {
            for column in 0..=steps {
                let (u, v) = (f64::from(column) / f64::from(steps), f64::from(row) / f64::from(steps));
                for height_m in [low_m, high_m] {
                    let p = (enu_from_ecef * bounds.at(u, v, height_m).to_ecef()).xyz();
                    low = low.min(p);
                    high = high.max(p);
                }
            }
        }
        let step_rad = (bounds.width_rad().min(TAU)).max(bounds.height_rad()).min(FRAC_PI_2 * 4.0) / f64::from(steps);
        let bulge_m = (SEMI_MAJOR_M * 1.01 + high_m.max(0.0)) * (step_rad * step_rad / 4.0);
        let (low, high) = (low - bulge_m, high + bulge_m);
        let rotation = ecef_from_enu.rotation();
        Self {
            center: ecef_from_enu * Point::new((low + high) / 2.0),
            axes: [rotation.x_axis, rotation.y_axis, rotation.z_axis],
            half_m: (high - low) / 2.0,
        }
    }

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
