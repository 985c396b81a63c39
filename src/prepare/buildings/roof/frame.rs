//! The rectangle that a roof is laid out in.

use super::RoofShape;
use geo::{Coord, LineString, MinimumRotatedRect, Polygon};
use glam::DVec2;
use std::f64::consts::FRAC_PI_2;

/// Middle, direction of the ridge, and half the sides of a rectangle round a footprint; local metres.
#[derive(Clone, Copy, Debug)]
pub struct Frame {
    pub middle: DVec2,
    /// Unit vector; the roof slopes to both sides of it, a skillion down to its right.
    pub along: DVec2,
    pub along_m: f64,
    pub across_m: f64,
}

impl Frame {
    pub fn new(rings: &[Vec<Coord>], shape: RoofShape, direction_rad: Option<f64>, across: bool) -> Self {
        let outer: &[Coord] = rings.first().map_or(&[], |ring| ring);
        let long = longer_side(outer);
        let ridge = if across { long.perp() } else { long };
        let along = match direction_rad.map(|rad| DVec2::new(rad.sin(), rad.cos())) {
            None => ridge,
            // Down is to the right of the ridge.
            Some(down) if shape == RoofShape::Skillion => down.perp(),
            // Which of the rectangle's sides a ridge follows.
            Some(down) if down.dot(long).abs() > down.dot(long.perp()).abs() => long.perp(),
            Some(_) => long,
        };
        Self::round(outer, along)
    }

    fn round(outer: &[Coord], along: DVec2) -> Self {
        let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        for point in outer {
            let point = DVec2::new(point.x, point.y);
            let at = DVec2::new(point.dot(along), point.dot(along.perp()));
            low = low.min(at);
            high = high.max(at);
        }
        let middle = (low + high) / 2.0;
        let half = (high - low) / 2.0;
        let middle = along * middle.x + along.perp() * middle.y;
        Self { middle, along, along_m: half.x.max(1e-3), across_m: half.y.max(1e-3) }
    }
}

/// Direction of the longer side of the smallest turned rectangle; of a square, the one nearer to east.
fn longer_side(outer: &[Coord]) -> DVec2 {
    let polygon = Polygon::new(LineString::new(outer.to_vec()), Vec::new());
    let Some(rectangle) = polygon.minimum_rotated_rect() else { return DVec2::X };
    let corners: Vec<DVec2> = rectangle.exterior().coords().map(|p| DVec2::new(p.x, p.y)).collect();
    let sides = corners.windows(2).map(|side| side[1] - side[0]);
    let longest = sides.max_by(|a, b| a.length().total_cmp(&b.length())).unwrap_or(DVec2::X);
    // Half a turn is no difference: one of the two is taken, so that the same building has the same roof.
    let turn = longest.to_angle().rem_euclid(2.0 * FRAC_PI_2);
    DVec2::from_angle(turn)
}
