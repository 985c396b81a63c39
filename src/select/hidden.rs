//! What stands in front of what: the nearest surface in each pixel of a picture, by the processor, and whether a triangle
//! shows beside it.
//!
//! Depth is kept as its inverse, which is linear over a triangle on the screen: a plane `n · p = d` is met along
//! `r = (x, y, −1)` at the depth `d / (n · r)`.

use super::polygon::Polygon;
use crate::camera::View;
use glam::{DMat3, DVec2, DVec3};

/// Larger pictures are looked at in larger pixels.
const SIDE_MAX_PX: u32 = 2048;
/// Nothing nearer to the eye's plane is drawn, metres.
const NEAR_M: f64 = 0.01;
/// A triangle shows where one of these pixels round it shows nothing nearer, so that slivers between two pixels' middles
/// are not lost.
const BESIDE_PX: f64 = 1.0;
/// Surfaces are equally near within this share.
const ALIKE: f64 = 1e-4;

/// Inverse depths of the nearest surface at the middle of each pixel.
pub struct DepthMap {
    view_from_ecef: DMat3,
    focal_px: f64,
    size_px: [usize; 2],
    /// Row by row, 1/m; 0 where nothing is.
    nearest: Vec<f32>,
}

/// The part of a triangle that is on the screen.
struct Shape {
    /// Pixels, y down, anticlockwise by the sign of `turn`.
    corners: [DVec2; Polygon::CORNERS_MAX],
    len: usize,
    turn: f64,
    /// Inverse depth at the screen's origin and per pixel; `None` where the triangle is seen from its edge.
    plane: Option<(f64, DVec2)>,
    /// Largest inverse depth.
    nearest: f64,
}

impl DepthMap {
    pub fn new(view: &View) -> Self {
        let longer = view.size_px[0].max(view.size_px[1]).max(1);
        let scale = f64::from(longer.min(SIDE_MAX_PX)) / f64::from(longer);
        let size_px = view.size_px.map(|side| (f64::from(side) * scale).ceil().max(1.0) as usize);
        Self {
            view_from_ecef: view.ecef_from_view().rotation().transpose(),
            focal_px: view.focal_px() * scale,
            size_px,
            nearest: vec![0.0; size_px[0] * size_px[1]],
        }
    }

    /// Draws a triangle; corners from the eye, ECEF axes, metres.
    pub fn draw(&mut self, triangle: [DVec3; 3]) {
        let Some(shape) = self.shape(triangle) else { return };
        if shape.plane.is_none() {
            return;
        }
        let [columns, rows] = self.pixels(&shape, 0.0);
        for row in rows {
            for column in columns.clone() {
                let middle = middle_of(column, row);
                if shape.reaches(middle, 0.0) {
                    let at = &mut self.nearest[row * self.size_px[0] + column];
                    *at = at.max(shape.inverse_m(middle, 0.0) as f32);
                }
            }
        }
    }

    /// Whether some pixel at a triangle, or beside it, shows nothing that is nearer.
    pub fn shows(&self, triangle: [DVec3; 3]) -> bool {
        let Some(shape) = self.shape(triangle) else { return false };
        let reach_px = 0.5 + BESIDE_PX;
        let [columns, mut rows] = self.pixels(&shape, reach_px);
        rows.any(|row| {
            columns.clone().any(|column| {
                let middle = middle_of(column, row);
                let nearest = f64::from(self.nearest[row * self.size_px[0] + column]);
                shape.reaches(middle, reach_px) && shape.inverse_m(middle, reach_px) >= nearest * (1.0 - ALIKE)
            })
        })
    }

    fn shape(&self, triangle: [DVec3; 3]) -> Option<Shape> {
        let corners = triangle.map(|corner| self.view_from_ecef * corner);
        let half = DVec2::new(self.size_px[0] as f64, self.size_px[1] as f64) / 2.0;
        let half_tan = half / self.focal_px;
        let mut polygon = Polygon::new(corners);
        polygon.clip(|p| -p.z - NEAR_M);
        for sign in [-1.0, 1.0] {
            polygon.clip(|p| -p.z * half_tan.x + sign * p.x);
            polygon.clip(|p| -p.z * half_tan.y + sign * p.y);
        }
        let seen = polygon.corners();
        let mut shape = Shape {
            corners: [DVec2::ZERO; Polygon::CORNERS_MAX],
            len: seen.len(),
            turn: 1.0,
            plane: plane(corners, half, self.focal_px),
            nearest: seen.iter().map(|corner| -1.0 / corner.z).fold(0.0, f64::max),
        };
        for (to, from) in shape.corners.iter_mut().zip(seen) {
            *to = half + DVec2::new(from.x, -from.y) * (self.focal_px / -from.z);
        }
        shape.turn = if shape.twice_area() < 0.0 { -1.0 } else { 1.0 };
        (shape.len > 2).then_some(shape)
    }

    /// Columns and rows of the pixels within `reach_px` of a shape.
    fn pixels(&self, shape: &Shape, reach_px: f64) -> [std::ops::Range<usize>; 2] {
        let corners = &shape.corners[..shape.len];
        let low = corners.iter().copied().reduce(DVec2::min).unwrap_or_default() - reach_px;
        let high = corners.iter().copied().reduce(DVec2::max).unwrap_or_default() + reach_px;
        // Negative floats become 0.
        let range =
            |low: f64, high: f64, size: usize| (low.floor() as usize).min(size)..(high.ceil() as usize).min(size);
        [range(low.x, high.x, self.size_px[0]), range(low.y, high.y, self.size_px[1])]
    }
}

impl Shape {
    fn edges(&self) -> impl Iterator<Item = (DVec2, DVec2)> + '_ {
        (0..self.len).map(|at| (self.corners[at], self.corners[(at + 1) % self.len]))
    }

    fn twice_area(&self) -> f64 {
        self.edges().map(|(from, to)| from.perp_dot(to)).sum()
    }

    /// Whether the square of half side `reach_px` round a place touches it; a few beyond its sharp corners count too.
    fn reaches(&self, place: DVec2, reach_px: f64) -> bool {
        self.edges().all(|(from, to)| {
            let along = to - from;
            self.turn * along.perp_dot(place - from) + reach_px * (along.x.abs() + along.y.abs()) >= 0.0
        })
    }

    /// The largest inverse depth in that square, or more.
    fn inverse_m(&self, place: DVec2, reach_px: f64) -> f64 {
        self.plane.map_or(self.nearest, |(origin, slope)| {
            let there = origin + slope.dot(place) + reach_px * (slope.x.abs() + slope.y.abs());
            there.min(self.nearest)
        })
    }
}

fn middle_of(column: usize, row: usize) -> DVec2 {
    DVec2::new(column as f64 + 0.5, row as f64 + 0.5)
}

fn plane([a, b, c]: [DVec3; 3], half: DVec2, focal_px: f64) -> Option<(f64, DVec2)> {
    let normal = (b - a).cross(c - a);
    let d = normal.dot(a);
    let slope = DVec2::new(normal.x, -normal.y) / (focal_px * d);
    let origin = -normal.z / d - slope.dot(half);
    (slope.is_finite() && origin.is_finite()).then_some((origin, slope))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Pose;
    use crate::geodesy::Geodetic;
    use proptest::prelude::*;

    fn view() -> View {
        let pose = Pose { eye: Geodetic::from_degrees(10.0, 20.0, 100.0), heading_rad: 0.4, pitch_rad: -0.1 };
        View::new(pose, 1.0, [64, 36])
    }

    /// Corners given right, up and ahead of the eye, metres.
    fn triangle(view: &View, corners: [[f64; 3]; 3]) -> [DVec3; 3] {
        corners.map(|[x, y, ahead]| view.ecef_from_view().rotation() * DVec3::new(x, y, -ahead))
    }

    fn wall(view: &View, left: f64, right: f64, ahead_m: f64) -> [DVec3; 3] {
        triangle(view, [[left, -50.0, ahead_m], [right, -50.0, ahead_m], [right, 150.0, ahead_m]])
    }

    #[test]
    fn a_wall_hides_what_is_behind_and_not_what_is_beside_it_or_before_it() {
        let view = view();
        let mut map = DepthMap::new(&view);
        map.draw(triangle(&view, [[-100.0, -100.0, 50.0], [100.0, -100.0, 50.0], [0.0, 200.0, 50.0]]));
        let small = |x: f64, ahead: f64| triangle(&view, [[x, 0.0, ahead], [x + 0.1, 0.0, ahead], [x, 0.1, ahead]]);
        assert!(!map.shows(small(0.0, 60.0)) && map.shows(small(0.0, 49.9)));
        assert!(map.shows(small(0.0, 50.0)), "it shows itself");
        let mut beside = DepthMap::new(&view);
        beside.draw(wall(&view, -200.0, -5.0, 20.0));
        assert!(beside.shows(small(0.0, 1000.0)));
        assert!(!beside.shows(small(0.0, -5.0)), "behind the eye");
    }

    #[test]
    fn ground_seen_at_a_slant_shows_to_its_far_end() {
        let view = view();
        let mut map = DepthMap::new(&view);
        let strip = |near: f64, far: f64| triangle(&view, [[-9.0, -2.0, near], [9.0, -2.0, near], [0.0, -2.0, far]]);
        let strips: Vec<_> = (1..200).map(|at| strip(f64::from(at) * 5.0, f64::from(at) * 5.0 + 5.0)).collect();
        strips.iter().for_each(|&strip| map.draw(strip));
        assert!(strips.iter().all(|&strip| map.shows(strip)));
    }

    proptest! {
        /// What is drawn and of which a pixel's middle is the nearest surface shows.
        #[test]
        fn the_nearest_of_any_triangles_shows(
            corners in prop::collection::vec(prop::array::uniform3(prop::array::uniform3(-40.0..40.0f64)), 1..12),
        ) {
            let view = view();
            let triangles: Vec<_> = corners.into_iter().map(|corners| {
                triangle(&view, corners.map(|[x, y, z]| [x, y, z + 45.0]))
            }).collect();
            let mut map = DepthMap::new(&view);
            let mut winner = vec![None; map.nearest.len()];
            for (number, &triangle) in triangles.iter().enumerate() {
                let before = map.nearest.clone();
                map.draw(triangle);
                for (at, (old, new)) in before.iter().zip(&map.nearest).enumerate() {
                    if new > old {
                        winner[at] = Some(number);
                    }
                }
            }
            for number in winner.into_iter().flatten() {
                prop_assert!(map.shows(triangles[number]));
            }
        }
    }
}
