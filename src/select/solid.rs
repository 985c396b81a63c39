//! Triangles against a view, exactly: what of one is inside the pyramid of the view, and how near that comes.

use super::polygon::Polygon;
use super::sight::Sight;
use crate::geodesy::{Ecef, Point};
use glam::DVec3;

/// A triangle that is in view, wholly or in part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Part {
    /// From the eye, ECEF axes, metres.
    pub corners: [DVec3; 3],
    /// From the eye to the nearest point in view, metres.
    pub distance_m: f64,
}

/// `None` where nothing of it is in the pyramid of the view, or the horizon hides all that is.
pub fn part_in_view(triangle: [Point<Ecef>; 3], sight: &Sight<'_>) -> Option<Part> {
    // From the eye, all planes of the pyramid pass through the origin.
    let corners = triangle.map(|corner| (corner - sight.eye).xyz());
    let mut polygon = Polygon::new(corners);
    for normal in sight.frustum.inward() {
        polygon.clip(|corner| corner.dot(normal));
    }
    let seen = polygon.corners();
    let is_hidden = |corner: &DVec3| sight.horizon.hides(Point::new(sight.eye.xyz() + *corner));
    if seen.is_empty() || seen.iter().all(is_hidden) {
        return None;
    }
    let fan = (2..seen.len()).map(|at| nearest_m([seen[0], seen[at - 1], seen[at]]));
    Some(Part { corners, distance_m: fan.fold(f64::INFINITY, f64::min) })
}

/// Distance from the origin to a triangle.
fn nearest_m([a, b, c]: [DVec3; 3]) -> f64 {
    let normal = (b - a).cross(c - a);
    let is_left = |from: DVec3, to: DVec3| (to - from).cross(-from).dot(normal) >= 0.0;
    if normal != DVec3::ZERO && is_left(a, b) && is_left(b, c) && is_left(c, a) {
        return a.dot(normal).abs() / normal.length();
    }
    [(a, b), (b, c), (c, a)].into_iter().map(|(from, to)| to_segment_m(from, to)).fold(f64::INFINITY, f64::min)
}

fn to_segment_m(from: DVec3, to: DVec3) -> f64 {
    let along = to - from;
    let share = (-from.dot(along) / along.length_squared()).clamp(0.0, 1.0);
    if share.is_nan() { from.length() } else { (from + along * share).length() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn vector() -> impl Strategy<Value = DVec3> {
        prop::array::uniform3(-9.0..9.0f64).prop_map(DVec3::from)
    }

    proptest! {
        #[test]
        fn no_point_of_a_triangle_is_nearer(corners in prop::array::uniform3(vector()), u in 0.0..1.0f64, v in 0.0..1.0f64) {
            let [a, b, c] = corners;
            let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
            let point = a + (b - a) * u + (c - a) * v;
            let distance_m = nearest_m(corners);
            prop_assert!(distance_m <= point.length() + 1e-9);
            // It is reached: no nearer than a descent over the triangle finds.
            let mut best = [a, b, c].map(DVec3::length).into_iter().fold(f64::INFINITY, f64::min);
            for row in 0..=200 {
                for column in 0..=200 - row {
                    let (u, v) = (f64::from(row) / 200.0, f64::from(column) / 200.0);
                    best = best.min((a + (b - a) * u + (c - a) * v).length());
                }
            }
            prop_assert!(best - distance_m < 0.2, "{best} {distance_m}");
        }
    }
}
