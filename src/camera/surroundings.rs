//! What navigation asks of the scene; answered from what is drawn now.

use super::View;
use crate::geodesy::{Ecef, Point};

/// A body that the eye must not enter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Obstacle {
    /// Lower and upper end above the ellipsoid, metres.
    pub base_m: f64,
    pub top_m: f64,
}

pub trait Surroundings {
    /// The point drawn at a pixel position (from the picture's top left corner, pixels); `None` for the sky.
    fn pick(&self, view: &View, at_px: [f64; 2]) -> Option<Point<Ecef>>;
    /// Height of the drawn ground above the ellipsoid, metres; `None` where none is drawn.
    fn ground_m(&self, lat_rad: f64, lon_rad: f64) -> Option<f64>;
    /// The building or the like whose footprint, grown by `margin_m`, holds a place; the highest of several.
    fn obstacle(&self, lat_rad: f64, lon_rad: f64, margin_m: f64) -> Option<Obstacle>;
}
