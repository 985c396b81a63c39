//! The Earth: WGS84, typed frames, bounds, horizon, geodesics, geoid.
//!
//! Everything is f64 and in metres and radians; degrees exist only in `from_degrees` and at the edges.

mod above;
mod bounds;
mod ellipsoid;
mod frame;
mod geodesic;
mod geoid;
mod horizon;
mod ray;

pub use above::Viewpoint;
pub use bounds::{GeoBounds, OrientedBox};
pub use ellipsoid::{
    ECCENTRICITY_SQ, Ellipsoid, FLATTENING, Geodetic, SEMI_MAJOR_M, SEMI_MINOR_M, ellipsoid_normal, meridian_radius_m,
    normal_through, prime_vertical_radius_m,
};
pub use frame::{Ecef, Enu, Point, Transform, Vector};
pub use geodesic::Course;
pub use geoid::VerticalDatum;
pub use horizon::HorizonCone;
pub use ray::{Ray, enters_aligned, meets_front};
