//! The one place where f64 positions in space become f32 positions from the eye.

use crate::camera::View;
use crate::geodesy::{Ecef, Point};
use glam::Vec3;

/// A point from the eye in Earth-fixed axes, metres: subtracted in f64, then rounded, so that the error is relative
/// to the distance (2⁻²⁴ of it) and not to the Earth's radius (0.4 m).
pub fn eye_relative(point: Point<Ecef>, view: &View) -> Vec3 {
    (point - view.eye()).xyz().as_vec3()
}
