//! WGS84 and its coordinates (NIMA TR8350.2, table 3.1).

use super::frame::{Ecef, Enu, Point, Transform};
use glam::{DMat3, DVec3};

/// Semi-major axis a, metres.
pub const SEMI_MAJOR_M: f64 = 6_378_137.0;
/// Flattening f = 1/298.257223563.
pub const FLATTENING: f64 = 1.0 / 298.257_223_563;
/// Semi-minor axis b = a(1 − f), metres.
pub const SEMI_MINOR_M: f64 = SEMI_MAJOR_M * (1.0 - FLATTENING);
/// First eccentricity squared e² = f(2 − f).
pub const ECCENTRICITY_SQ: f64 = FLATTENING * (2.0 - FLATTENING);

/// A place by geodetic latitude, longitude and height above the WGS84 ellipsoid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Geodetic {
    /// −π/2 to π/2.
    pub lat_rad: f64,
    /// −π to π; −π and π are the same meridian.
    pub lon_rad: f64,
    /// Above the ellipsoid, metres.
    pub height_m: f64,
}

impl Geodetic {
    pub fn from_degrees(lat_deg: f64, lon_deg: f64, height_m: f64) -> Self {
        Self { lat_rad: lat_deg.to_radians(), lon_rad: lon_deg.to_radians(), height_m }
    }

    pub fn lat_deg(&self) -> f64 {
        self.lat_rad.to_degrees()
    }

    pub fn lon_deg(&self) -> f64 {
        self.lon_rad.to_degrees()
    }

    pub fn at_height(self, height_m: f64) -> Self {
        Self { height_m, ..self }
    }

    /// Earth-centred, Earth-fixed coordinates.
    pub fn to_ecef(self) -> Point<Ecef> {
        let (sin_lat, cos_lat) = self.lat_rad.sin_cos();
        let (sin_lon, cos_lon) = self.lon_rad.sin_cos();
        let n = prime_vertical_radius_m(sin_lat);
        let across = (n + self.height_m) * cos_lat;
        Point::new(DVec3::new(
            across * cos_lon,
            across * sin_lon,
            (n * (1.0 - ECCENTRICITY_SQ) + self.height_m) * sin_lat,
        ))
    }

    /// The inverse of [`Geodetic::to_ecef`]: Bowring's start (1976), then Newton steps on his latitude
    /// equation until they stop moving; height by the form that is well conditioned at the poles as well.
    pub fn from_ecef(point: Point<Ecef>) -> Self {
        let p = point.xyz();
        let across = p.x.hypot(p.y);
        let lon_rad = p.y.atan2(p.x);
        let ratio = 1.0 - FLATTENING;
        let e2_prime_b = ECCENTRICITY_SQ / (1.0 - ECCENTRICITY_SQ) * SEMI_MINOR_M;
        let mut beta = (p.z).atan2(across * ratio);
        let mut lat_rad = 0.0;
        for _ in 0..6 {
            let (sin_b, cos_b) = beta.sin_cos();
            let next =
                (p.z + e2_prime_b * sin_b.powi(3)).atan2(across - ECCENTRICITY_SQ * SEMI_MAJOR_M * cos_b.powi(3));
            let (sin_lat, cos_lat) = next.sin_cos();
            beta = (ratio * sin_lat).atan2(cos_lat);
            if next == lat_rad {
                break;
            }
            lat_rad = next;
        }
        let (sin_lat, cos_lat) = lat_rad.sin_cos();
        let n = prime_vertical_radius_m(sin_lat);
        let height_m = across * cos_lat + p.z * sin_lat - SEMI_MAJOR_M * SEMI_MAJOR_M / n;
        Self { lat_rad, lon_rad, height_m }
    }

    /// Unit outward normal of the ellipsoid below this place.
    pub fn up(self) -> DVec3 {
        ellipsoid_normal(self.lat_rad, self.lon_rad)
    }

    /// The frame with its origin here and axes east, north, up.
    pub fn ecef_from_enu(self) -> Transform<Ecef, Enu> {
        let (sin_lat, cos_lat) = self.lat_rad.sin_cos();
        let (sin_lon, cos_lon) = self.lon_rad.sin_cos();
        let east = DVec3::new(-sin_lon, cos_lon, 0.0);
        let north = DVec3::new(-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat);
        let up = DVec3::new(cos_lat * cos_lon, cos_lat * sin_lon, sin_lat);
        Transform::new(DMat3::from_cols(east, north, up), self.to_ecef().xyz())
    }
}

/// Unit outward normal of the ellipsoid at geodetic latitude and longitude.
pub fn ellipsoid_normal(lat_rad: f64, lon_rad: f64) -> DVec3 {
    let (sin_lat, cos_lat) = lat_rad.sin_cos();
    let (sin_lon, cos_lon) = lon_rad.sin_cos();
    DVec3::new(cos_lat * cos_lon, cos_lat * sin_lon, sin_lat)
}

/// N(φ), the radius of curvature in the prime vertical, metres.
pub fn prime_vertical_radius_m(sin_lat: f64) -> f64 {
    SEMI_MAJOR_M / (1.0 - ECCENTRICITY_SQ * sin_lat * sin_lat).sqrt()
}

/// M(φ), the radius of curvature in the meridian, metres.
pub fn meridian_radius_m(sin_lat: f64) -> f64 {
    let w2 = 1.0 - ECCENTRICITY_SQ * sin_lat * sin_lat;
    SEMI_MAJOR_M * (1.0 - ECCENTRICITY_SQ) / (w2 * w2.sqrt())
}
