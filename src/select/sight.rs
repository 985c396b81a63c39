//! What one view sees: culling by frustum and horizon, distances, and shares of the screen.

use super::OutOfView;
use super::polygon::Polygon;
use crate::camera::{Frustum, View};
use crate::forest::index::IndexForest;
use crate::geodesy::{Ecef, GeoBounds, HorizonCone, OrientedBox, Point, Viewpoint};
use glam::DVec2;

/// Cells wider than this are looked at in parts when their share of the screen is taken: a flat quad would cut too
/// deep into the Earth.
const QUAD_MAX_RAD: f64 = 0.1;
/// Corners closer to the eye's plane than this are clipped, metres.
const NEAR_M: f64 = 0.01;

/// How far an eye may rise until the next selection: a share of its height and a few metres.
const RISE_SHARE: f64 = 0.25;
const RISE_M: f64 = 10.0;

/// The tolerance asked for, and the one drawn where memory or time lack; the drawn one is not below the asked one.
#[derive(Clone, Copy, Debug)]
pub struct Tolerance {
    pub asked_px: f64,
    pub drawn_px: f64,
}

impl Tolerance {
    pub fn new(asked_px: f64, drawn_px: f64) -> Self {
        Self { asked_px, drawn_px: drawn_px.max(asked_px) }
    }
}

pub struct Sight<'a> {
    pub view: &'a View,
    pub tolerance: Tolerance,
    pub eye: Point<Ecef>,
    pub viewpoint: Viewpoint,
    pub frustum: Frustum,
    pub horizon: HorizonCone,
    half_tan: DVec2,
    /// Of the view, once for all of the walk.
    pub focal_px: f64,
}

impl<'a> Sight<'a> {
    pub fn new(index: &IndexForest, view: &'a View, tolerance: Tolerance, out_of_view: OutOfView) -> Self {
        let lowest_m = index.trees().map(|tree| tree.root().height_range_m().0).fold(0.0, f64::min);
        let tan_y = (view.fov_y_rad / 2.0).tan();
        Self {
            view,
            tolerance,
            eye: view.eye(),
            viewpoint: Viewpoint::new(view.pose.eye),
            frustum: view.frustum(),
            horizon: HorizonCone::new(horizon_eye(view, out_of_view), -lowest_m),
            half_tan: DVec2::new(tan_y * view.aspect(), tan_y),
            focal_px: view.focal_px(),
        }
    }

    /// False when the box is out of the view or behind the horizon.
    pub fn sees(&self, bounds: &OrientedBox) -> bool {
        self.frustum.meets(bounds) && !self.horizon.hides_box(bounds)
    }

    /// Whether no part of the box is out of view, and no corner of it behind the horizon.
    pub fn sees_all(&self, bounds: &OrientedBox) -> bool {
        self.frustum.holds(bounds) && !bounds.corners().iter().any(|&corner| self.horizon.hides(corner))
    }

    /// Share of the screen, 0 to 1, of the quad between the corners of a cell at `height_m`, clipped to the viewport;
    /// parts behind the horizon do not count, what stands in front of it does not hide it.
    pub fn screen_share(&self, bounds: &GeoBounds, height_m: f64) -> f64 {
        let side = bounds.width_rad().max(bounds.height_rad());
        let parts = (side / QUAD_MAX_RAD).ceil().clamp(1.0, 8.0) as u32;
        let step = 1.0 / f64::from(parts);
        let mut share = 0.0;
        for row in 0..parts {
            for column in 0..parts {
                let (u, v) = (f64::from(column) * step, f64::from(row) * step);
                // The middle of a part may be seen where all its corners lie beyond the horizon.
                let (low, high) = (bounds.at(u, v, height_m), bounds.at(u + step, v + step, height_m));
                let part = GeoBounds {
                    west_rad: low.lon_rad,
                    south_rad: low.lat_rad,
                    east_rad: high.lon_rad,
                    north_rad: high.lat_rad,
                };
                if self.horizon.hides_box(&OrientedBox::around(&part, height_m, height_m)) {
                    continue;
                }
                let corners = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)];
                share += self.quad_share(corners.map(|(u, v)| part.at(u, v, height_m).to_ecef()));
            }
        }
        share.min(1.0)
    }

    fn quad_share(&self, corners: [Point<Ecef>; 4]) -> f64 {
        let view_from_ecef = self.view.ecef_from_view().inverse();
        let mut polygon = Polygon::new(corners.map(|corner| (view_from_ecef * corner).xyz()));
        polygon.clip(|p| -p.z - NEAR_M);
        for sign in [-1.0, 1.0] {
            polygon.clip(|p| -p.z * self.half_tan.x + sign * p.x);
            polygon.clip(|p| -p.z * self.half_tan.y + sign * p.y);
        }
        polygon.area(|p| DVec2::new(p.x, p.y) / (-p.z * self.half_tan)) / 4.0
    }
}

/// The eye that the horizon is taken from: higher than the view's where later views are drawn from the selection, so
/// that an eye that rises sees no edge.
fn horizon_eye(view: &View, out_of_view: OutOfView) -> Point<Ecef> {
    let eye = view.pose.eye;
    match out_of_view {
        OutOfView::Left => view.eye(),
        OutOfView::Coarse => eye.at_height(eye.height_m + RISE_SHARE * eye.height_m.abs() + RISE_M).to_ecef(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Pose;
    use crate::geodesy::Geodetic;

    fn share(view: &View, bounds: &GeoBounds) -> f64 {
        let index = IndexForest::default();
        Sight::new(&index, view, Tolerance::new(1.0, 1.0), OutOfView::Left).screen_share(bounds, 0.0)
    }

    fn looking_down(height_m: f64) -> View {
        let eye = Geodetic::from_degrees(10.0, 20.0, height_m);
        let pose = Pose { eye, heading_rad: 0.3, pitch_rad: -std::f64::consts::FRAC_PI_2 };
        View::new(pose, 1.0, [640, 360])
    }

    #[test]
    fn a_quad_below_the_eye_has_its_share() {
        let view = looking_down(10_000.0);
        assert!((share(&view, &GeoBounds::from_degrees(18.0, 8.0, 22.0, 12.0)) - 1.0).abs() < 1e-9);
        let (side_m, focal) = (1000.0, view.focal_px());
        let half = side_m / 2.0 / 6_378_137.0;
        let (lat, lon) = (10f64.to_radians(), 20f64.to_radians());
        let small = GeoBounds {
            west_rad: lon - half / lat.cos(),
            east_rad: lon + half / lat.cos(),
            south_rad: lat - half,
            north_rad: lat + half,
        };
        let expected = (side_m * focal / 10_000.0f64).powi(2) / (640.0 * 360.0);
        assert!((share(&view, &small) / expected - 1.0).abs() < 0.01, "{}", share(&view, &small) / expected);
    }

    #[test]
    fn what_is_behind_the_eye_or_the_earth_has_none() {
        let view = looking_down(1e7);
        assert_eq!(share(&view, &GeoBounds::from_degrees(-165.0, -15.0, -155.0, -5.0)), 0.0);
        let eye = Geodetic::from_degrees(10.0, 20.0, 1000.0);
        let level = View::new(Pose { eye, heading_rad: 0.0, pitch_rad: 0.0 }, 1.0, [640, 360]);
        assert_eq!(share(&level, &GeoBounds::from_degrees(19.9, 9.8, 20.1, 9.95)), 0.0);
        assert!(share(&level, &GeoBounds::from_degrees(19.9, 10.05, 20.1, 10.2)) > 0.0);
    }
}
