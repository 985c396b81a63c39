//! What the Earth hides: horizon culling against an ellipsoid inside the ground (Ring 2013, "Horizon Culling").

use super::{Ecef, FLATTENING, OrientedBox, Point, SEMI_MAJOR_M, SEMI_MINOR_M};
use glam::DVec3;

/// The part of space that the solid Earth hides from an eye. The Earth is taken as the WGS84 ellipsoid lowered by
/// `sunk_m`, so that ground below zero never hides what can be seen.
#[derive(Clone, Copy, Debug)]
pub struct HorizonCone {
    inverse_radii: DVec3,
    eye: DVec3,
    /// |eye|² − 1 in scaled space; not positive when the eye is inside the ellipsoid, where nothing is hidden.
    magnitude_sq: f64,
}

impl HorizonCone {
    /// `sunk_m` is at least the depth of the lowest ground.
    pub fn new(eye: Point<Ecef>, sunk_m: f64) -> Self {
        // The ellipsoid of axes a − s, b − s reaches up to s·f²/2 above the surface that lies s below the ground all
        // over; a little deeper it is inside.
        let sunk_m = sunk_m * (1.0 + FLATTENING * FLATTENING);
        let inverse_radii = 1.0 / DVec3::new(SEMI_MAJOR_M - sunk_m, SEMI_MAJOR_M - sunk_m, SEMI_MINOR_M - sunk_m);
        let scaled = eye.xyz() * inverse_radii;
        Self { inverse_radii, eye: scaled, magnitude_sq: scaled.length_squared() - 1.0 }
    }

    /// Whether the Earth hides a point.
    pub fn hides(&self, point: Point<Ecef>) -> bool {
        let to = point.xyz() * self.inverse_radii - self.eye;
        let along = -to.dot(self.eye);
        self.magnitude_sq > 0.0 && along > self.magnitude_sq && along * along > self.magnitude_sq * to.length_squared()
    }

    /// Whether the Earth hides a whole box: the hidden part is convex, so all its corners must be hidden.
    pub fn hides_box(&self, bounds: &OrientedBox) -> bool {
        self.magnitude_sq > 0.0 && bounds.corners().iter().all(|&corner| self.hides(corner))
    }
}
