//! Shortest ways on the ellipsoid, by Karney's method (Karney 2013, "Algorithms for geodesics", J. Geodesy 87), which
//! unlike Vincenty's finds the way between near-antipodes as well. 15 nm on WGS84.

use super::Geodetic;
use geographiclib_rs::{DirectGeodesic, Geodesic, InverseGeodesic};
use std::sync::LazyLock;

static WGS84: LazyLock<Geodesic> = LazyLock::new(Geodesic::wgs84);

/// The shortest way between two places on the ellipsoid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Course {
    pub distance_m: f64,
    /// Direction at the start and at the end, clockwise from north; −π to π.
    pub departure_rad: f64,
    pub arrival_rad: f64,
}

impl Course {
    /// Heights are ignored.
    pub fn between(from: Geodetic, to: Geodetic) -> Self {
        let (distance_m, departure, arrival, _arc): (f64, f64, f64, f64) =
            WGS84.inverse(from.lat_deg(), from.lon_deg(), to.lat_deg(), to.lon_deg());
        Self { distance_m, departure_rad: departure.to_radians(), arrival_rad: arrival.to_radians() }
    }
}

impl Geodetic {
    /// The place reached by going straight on for `distance_m` along the ellipsoid, at the same height, and the
    /// direction there; directions clockwise from north.
    pub fn travel(self, departure_rad: f64, distance_m: f64) -> (Self, f64) {
        let (lat, lon, arrival): (f64, f64, f64) =
            WGS84.direct(self.lat_deg(), self.lon_deg(), departure_rad.to_degrees(), distance_m);
        (Self::from_degrees(lat, lon, self.height_m), arrival.to_radians())
    }
}
