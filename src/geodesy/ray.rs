//! Rays in space, and where they enter simple bodies. Distances are along the ray, metres, never negative.

use super::{Ecef, OrientedBox, Point};
use glam::DVec3;

/// Barycentric coordinates count as inside down to this, so that no ray slips through between two triangles.
const INSIDE: f64 = -1e-9;

/// A half-line in space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    pub origin: Point<Ecef>,
    /// Unit vector.
    pub direction: DVec3,
}

impl Ray {
    pub fn at(&self, distance_m: f64) -> Point<Ecef> {
        Point::new(self.origin.xyz() + self.direction * distance_m)
    }

    /// Where the ray enters a box; 0 from inside, `None` when it misses.
    pub fn enters_box(&self, bounds: &OrientedBox) -> Option<f64> {
        let from_center = (self.origin - bounds.center).xyz();
        let along = |v: DVec3| DVec3::from(bounds.axes.map(|axis| axis.dot(v)));
        enters_aligned(along(from_center), along(self.direction), -bounds.half_m, bounds.half_m)
    }

    /// Where the ray enters a ball; 0 from inside, `None` when it misses.
    pub fn enters_ball(&self, center: Point<Ecef>, radius_m: f64) -> Option<f64> {
        let to_center = (center - self.origin).xyz();
        let nearest_m = to_center.dot(self.direction);
        let off_sq = (to_center - self.direction * nearest_m).length_squared();
        let half_chord = (radius_m * radius_m - off_sq).max(0.0).sqrt();
        let misses = off_sq > radius_m * radius_m || nearest_m + half_chord < 0.0;
        (!misses).then(|| (nearest_m - half_chord).max(0.0))
    }
}

/// Where a ray enters the box from `low` to `high`, all in the box's axes (Kay, Kajiya 1986).
pub fn enters_aligned(origin: DVec3, direction: DVec3, low: DVec3, high: DVec3) -> Option<f64> {
    let (mut enter, mut leave) = (0.0f64, f64::INFINITY);
    for axis in 0..3 {
        let (from, along) = (origin[axis], direction[axis]);
        if along == 0.0 {
            if from < low[axis] || from > high[axis] {
                return None;
            }
            continue;
        }
        let (a, b) = ((low[axis] - from) / along, (high[axis] - from) / along);
        enter = enter.max(a.min(b));
        leave = leave.min(a.max(b));
    }
    (enter <= leave).then_some(enter)
}

/// Where a ray from the origin of the corners' frame meets the front of a triangle, whose corners run
/// counter-clockwise as seen from there (Möller, Trumbore 1997, with culling).
pub fn meets_front(direction: DVec3, [a, b, c]: [DVec3; 3]) -> Option<f64> {
    let (ab, ac) = (b - a, c - a);
    let across = direction.cross(ac);
    let det = ab.dot(across);
    if det <= 0.0 || det.is_nan() {
        return None;
    }
    let u = -a.dot(across) / det;
    let q = (-a).cross(ab);
    let v = direction.dot(q) / det;
    let distance_m = ac.dot(q) / det;
    (u >= INSIDE && v >= INSIDE && u + v <= 1.0 - INSIDE && distance_m >= 0.0).then_some(distance_m)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn vector(size: f64) -> impl Strategy<Value = DVec3> {
        [-size..size, -size..size, -size..size].prop_map(DVec3::from)
    }

    proptest! {
        #[test]
        fn a_ray_meets_a_front_where_it_aims_and_never_a_back(
            a in vector(100.0), b in vector(100.0), c in vector(100.0), u in 0.01..0.98f64, v in 0.0..1.0f64,
        ) {
            let v = 0.01 + v * (0.98 - u);
            let aim = a + (b - a) * u + (c - a) * v;
            let normal = (b - a).cross(c - a);
            prop_assume!(normal.length() > 1.0 && aim.normalize().dot(normal.normalize()).abs() > 1e-3);
            let direction = aim.normalize();
            let (front, back) = if direction.dot(normal) < 0.0 { ([a, b, c], [a, c, b]) } else { ([a, c, b], [a, b, c]) };
            prop_assert!((meets_front(direction, front).unwrap() - aim.length()).abs() < 1e-6);
            prop_assert_eq!(meets_front(direction, back), None);
            prop_assert_eq!(meets_front(-direction, front), None);
            let beside = a + (b - a) * 1.01;
            prop_assert_eq!(meets_front(beside.normalize(), front), None);
        }

        #[test]
        fn boxes_and_balls_are_entered_on_their_surface(
            origin in vector(1e7), center in vector(1e7), aim in vector(1.0), half in vector(1e5), out in vector(1.0),
        ) {
            let half_m = half.abs() + 1.0;
            let rotation = glam::DMat3::from_rotation_z(aim.x * 3.0) * glam::DMat3::from_rotation_x(aim.y * 3.0);
            let axes = [rotation.x_axis, rotation.y_axis, rotation.z_axis];
            let bounds = OrientedBox { center: Point::new(center), axes, half_m };
            let inside = center + rotation * (aim * half_m * 0.99);
            prop_assume!(bounds.distance_m(Point::new(origin)) > 1.0);
            let ray = Ray { origin: Point::new(origin), direction: (inside - origin).normalize() };
            let entry = ray.at(ray.enters_box(&bounds).unwrap());
            prop_assert!(bounds.distance_m(entry) < 1e-4);
            prop_assert!(bounds.distance_m(ray.at(ray.enters_box(&bounds).unwrap() - 1.0)) > 0.0);
            prop_assert_eq!(Ray { direction: -ray.direction, ..ray }.enters_box(&bounds), None);
            prop_assert_eq!(Ray { origin: Point::new(inside), direction: out.normalize() }.enters_box(&bounds), Some(0.0));
            let radius_m = half_m.length();
            prop_assume!(origin.distance(center) > radius_m + 1.0);
            let entry = ray.at(ray.enters_ball(bounds.center, radius_m).unwrap());
            prop_assert!((entry.distance_m(bounds.center) - radius_m).abs() < 1e-2);
            prop_assert_eq!(Ray { direction: -ray.direction, ..ray }.enters_ball(bounds.center, radius_m), None);
        }
    }
}
