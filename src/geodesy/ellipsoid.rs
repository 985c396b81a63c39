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

/// An ellipsoid of revolution, not prolate. The world is WGS84 throughout; others let the formulas be tested against
/// cases that were made on them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ellipsoid {
    /// Semi-major axis a, metres.
    semi_major_m: f64,
    /// First eccentricity squared e².
    eccentricity_sq: f64,
    /// b/a.
    axis_ratio: f64,
}

impl Ellipsoid {
    pub const WGS84: Self = Self::new(SEMI_MAJOR_M, FLATTENING);
    /// Newton steps allowed; two or three do within 10⁸ m, more only deep inside the Earth.
    const NEWTON_STEPS: usize = 16;
    /// Below this part of a from the centre, Newton's steps are not safe: the evolute (within 0.7 % of a for WGS84)
    /// lies there, on which several normals meet.
    const DEEP: f64 = 0.1;

    /// `flattening` from 0 to 0.03, so that the evolute stays in the part that is solved by bisection.
    pub const fn new(semi_major_m: f64, flattening: f64) -> Self {
        Self { semi_major_m, eccentricity_sq: flattening * (2.0 - flattening), axis_ratio: 1.0 - flattening }
    }

    /// Earth-centred, Earth-fixed coordinates of a place.
    pub fn to_ecef(&self, place: Geodetic) -> Point<Ecef> {
        let (sin_lat, cos_lat) = place.lat_rad.sin_cos();
        let (sin_lon, cos_lon) = place.lon_rad.sin_cos();
        let n = self.prime_vertical_radius_m(sin_lat);
        let across = (n + place.height_m) * cos_lat;
        Point::new(DVec3::new(
            across * cos_lon,
            across * sin_lon,
            (n * (1.0 - self.eccentricity_sq) + place.height_m) * sin_lat,
        ))
    }

    /// The inverse of [`Ellipsoid::to_ecef`] for the nearest place of the ellipsoid, at any point, the axis and the
    /// centre included (there the north pole is taken). On WGS84 a point comes back to itself within 5 nm up to
    /// 100 km of height and 100 nm up to 10⁸ m.
    pub fn to_geodetic(&self, point: Point<Ecef>) -> Geodetic {
        let p = point.xyz();
        let across = p.x.hypot(p.y);
        let (sin_lat, cos_lat) = if across.hypot(p.z) > Self::DEEP * self.semi_major_m {
            self.latitude_by_newton(across, p.z)
        } else {
            self.latitude_by_bisection(across, p.z)
        };
        let n = self.prime_vertical_radius_m(sin_lat);
        // Along the normal, from its foot: small differences of like numbers, well conditioned at the poles as well.
        let height_m = (across - n * cos_lat) * cos_lat + (p.z - n * (1.0 - self.eccentricity_sq) * sin_lat) * sin_lat;
        Geodetic { lat_rad: sin_lat.atan2(cos_lat), lon_rad: p.y.atan2(p.x), height_m }
    }

    /// Sine and cosine of the latitude: Bowring's start (1976) and his equation, which as an iteration is Newton's
    /// (Fukushima 1999). Angles are kept as unit vectors: no trigonometry.
    fn latitude_by_newton(&self, across: f64, z: f64) -> (f64, f64) {
        let semi_minor = self.semi_major_m * self.axis_ratio;
        let polar = self.eccentricity_sq / (1.0 - self.eccentricity_sq) * semi_minor;
        let equatorial = self.eccentricity_sq * self.semi_major_m;
        let (mut sin_lat, mut cos_lat) = (0.0, 0.0);
        let (mut sin_beta, mut cos_beta) = unit(z, across * self.axis_ratio);
        for _ in 0..Self::NEWTON_STEPS {
            let before = (sin_lat, cos_lat);
            (sin_lat, cos_lat) =
                unit(z + polar * sin_beta * sin_beta * sin_beta, across - equatorial * cos_beta * cos_beta * cos_beta);
            (sin_beta, cos_beta) = unit(self.axis_ratio * sin_lat, cos_lat);
            let turn = sin_lat * before.1 - cos_lat * before.0;
            if before != (0.0, 0.0) && turn.abs() < 1e-16 {
                break;
            }
        }
        (sin_lat, cos_lat)
    }

    /// Sine and cosine of the latitude for points near the centre: the nearest point of the ellipse by bisection,
    /// which cannot fail (Eberly 2011, "Distance from a point to an ellipse, an ellipsoid, or a hyperellipsoid").
    fn latitude_by_bisection(&self, across: f64, z: f64) -> (f64, f64) {
        let (a, b) = (self.semi_major_m, self.semi_major_m * self.axis_ratio);
        let focal_sq = self.eccentricity_sq * a * a;
        // The foot is (a²·across/(u + a²e²), b²·z/u); `outside` falls with u and is 0 where the foot is on the ellipse.
        let outside = |u: f64| (a * across / (u + focal_sq)).hypot(b * z / u) - 1.0;
        let (mut low, mut high) = (b * z.abs(), (a * across).hypot(b * z));
        if low == 0.0 {
            // In the plane of the equator: within the evolute the nearest place is not on the equator.
            let cos_beta = if focal_sq > 0.0 { (a * across / focal_sq).min(1.0) } else { f64::from(across > 0.0) };
            return unit((1.0 - cos_beta * cos_beta).sqrt() / self.axis_ratio, cos_beta);
        }
        while low < high {
            let middle = low + (high - low) / 2.0;
            if middle <= low || middle >= high {
                break;
            }
            if outside(middle) > 0.0 {
                low = middle;
            } else {
                high = middle;
            }
        }
        unit(z / high, across / (high + focal_sq))
    }

    /// N(φ), the radius of curvature in the prime vertical, metres.
    fn prime_vertical_radius_m(&self, sin_lat: f64) -> f64 {
        self.semi_major_m / (1.0 - self.eccentricity_sq * sin_lat * sin_lat).sqrt()
    }
}

/// (y, x) scaled to length 1: sine and cosine of their angle.
fn unit(y: f64, x: f64) -> (f64, f64) {
    let length = y.hypot(x);
    (y / length, x / length)
}

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
        Ellipsoid::WGS84.to_ecef(self)
    }

    /// The inverse of [`Geodetic::to_ecef`]; see [`Ellipsoid::to_geodetic`].
    pub fn from_ecef(point: Point<Ecef>) -> Self {
        Ellipsoid::WGS84.to_geodetic(point)
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

/// Unit normal of the ellipsoid that is scaled to go through a point: the gradient of x²/a² + y²/a² + z²/b², as the
/// shaders have it. At height h it is off the normal below the point by less than f · h/a radians (5 · 10⁻¹⁰ a metre).
pub fn normal_through(point: Point<Ecef>) -> DVec3 {
    const STRETCH: f64 = 1.0 / (1.0 - FLATTENING);
    (point.xyz() * DVec3::new(1.0, 1.0, STRETCH * STRETCH)).normalize_or(DVec3::Z)
}

/// N(φ), the radius of curvature in the prime vertical, metres.
pub fn prime_vertical_radius_m(sin_lat: f64) -> f64 {
    Ellipsoid::WGS84.prime_vertical_radius_m(sin_lat)
}

/// M(φ), the radius of curvature in the meridian, metres.
pub fn meridian_radius_m(sin_lat: f64) -> f64 {
    let w2 = 1.0 - ECCENTRICITY_SQ * sin_lat * sin_lat;
    SEMI_MAJOR_M * (1.0 - ECCENTRICITY_SQ) / (w2 * w2.sqrt())
}
