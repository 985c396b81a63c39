//! Tilting and turning about a point, which stays in the middle of the picture at its distance.

use super::Pose;
use super::clearance::Clearance;
use super::hold::elevation_over;
use super::motion::{Lens, looking_at, mix, mix_angle, smoothstep, wrapped};
use crate::geodesy::{Ecef, Enu, Geodetic, Point, Transform};
use glam::DVec3;
use std::f64::consts::{FRAC_PI_2, PI};

/// Least elevation of the eye over the point's horizon, unless it was lower when it came.
const LEAST_ELEVATION_RAD: f64 = PI / 180.0;
/// Closer to the vertical than this, the eye's direction from the point has no azimuth of its own.
const VERTICAL: f64 = 1e-7;
/// Time of a turn to the north.
const NORTH_S: f64 = 0.5;

/// A heading further from the north after a turn there was not rounding.
const FLIPPED_RAD: f64 = 1e-3;

/// The eye round a point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Orbit {
    pivot: Point<Ecef>,
    ecef_from_enu: Transform<Ecef, Enu>,
    distance_m: f64,
    least_rad: f64,
    /// Direction from the point to the eye, clockwise from north.
    azimuth_rad: f64,
    /// Height of the eye over the point's horizon.
    elevation_rad: f64,
}

impl Orbit {
    /// Round a point in the middle of the picture.
    pub(super) fn new(pose: &Pose, pivot: Point<Ecef>) -> Self {
        let ecef_from_enu = Geodetic::from_ecef(pivot).ecef_from_enu();
        let [east, north, up] = (ecef_from_enu.inverse() * pose.eye.to_ecef()).xyz().to_array();
        let across = east.hypot(north);
        let vertical = across <= VERTICAL * up.abs();
        let azimuth_rad = if vertical { pose.heading_rad + PI } else { east.atan2(north) };
        let elevation_rad = elevation_over(pose, pivot);
        let least_rad = LEAST_ELEVATION_RAD.min(elevation_rad);
        let distance_m = across.hypot(up);
        Self { pivot, ecef_from_enu, distance_m, least_rad, azimuth_rad, elevation_rad }
    }

    pub(super) fn pose(&self) -> Pose {
        let (sin_a, cos_a) = self.azimuth_rad.sin_cos();
        let (sin_e, cos_e) = self.elevation_rad.sin_cos();
        let out = DVec3::new(sin_a * cos_e, cos_a * cos_e, sin_e) * self.distance_m;
        let eye = Geodetic::from_ecef(self.ecef_from_enu * Point::new(out));
        looking_at(eye, self.pivot, self.azimuth_rad + PI)
    }

    fn turned(&self, azimuth_rad: f64, elevation_rad: f64) -> Self {
        let elevation_rad = elevation_rad.clamp(self.least_rad, FRAC_PI_2);
        Self { azimuth_rad: wrapped(azimuth_rad), elevation_rad, ..*self }
    }

    /// After a drag: half a turn for the height of the picture. To the right the eye goes clockwise, downwards it
    /// rises. Over ground the eye rises, at walls it stops or slides up and down or sideways.
    pub(super) fn dragged(&self, by_px: [f64; 2], lens: Lens, clear: Clearance) -> Self {
        let [turn_rad, rise_rad] = by_px.map(|px| px * PI / lens.height_px());
        let wanted = [[turn_rad, rise_rad], [0.0, rise_rad], [turn_rad, 0.0]];
        let full_m = turn_rad.hypot(rise_rad) * self.distance_m;
        let mut best = (*self, 0.0);
        for [turn_rad, rise_rad] in wanted {
            let way =
                |share: f64| self.turned(self.azimuth_rad + turn_rad * share, self.elevation_rad + rise_rad * share);
            let length_m = turn_rad.hypot(rise_rad) * self.distance_m;
            let share = clear.clear_share(length_m, |share| way(share).pose());
            if share >= 1.0 {
                return way(1.0);
            }
            if let Some(lifted) = way(1.0).lifted(full_m, clear) {
                return lifted;
            }
            if share * length_m > best.1 {
                best = (way(share), share * length_m);
            }
        }
        best.0
    }

    /// Raised out of the ground; `None` where that takes a jump, as at a wall.
    fn lifted(&self, way_m: f64, clear: Clearance) -> Option<Self> {
        const HALVINGS: usize = 20;
        let rise_rad = 2.0 * way_m / self.distance_m;
        let at = |share: f64| self.turned(self.azimuth_rad, self.elevation_rad + rise_rad * share);
        let is_clear = |share: f64| clear.lack_m(at(share).pose().eye) <= 0.0;
        if !is_clear(1.0) {
            return None;
        }
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..HALVINGS {
            let middle = (low + high) / 2.0;
            if is_clear(middle) {
                high = middle;
            } else {
                low = middle;
            }
        }
        Some(at(high))
    }
}

/// A turn to the north, about the point in the middle or in place.
#[derive(Clone, Copy, Debug)]
pub(super) struct NorthUp {
    orbit: Option<Orbit>,
    from: Pose,
    gone_s: f64,
}

impl NorthUp {
    pub(super) fn new(pose: Pose, pivot: Option<Point<Ecef>>) -> Self {
        Self { orbit: pivot.map(|pivot| Orbit::new(&pose, pivot)), from: pose, gone_s: 0.0 }
    }

    /// The pose `dt_s` later, and whether that was the end. `pose` is the one now.
    pub(super) fn step(&mut self, pose: Pose, dt_s: f64, clear: Clearance) -> (Pose, bool) {
        self.gone_s += dt_s;
        let share = smoothstep(self.gone_s / NORTH_S);
        let wanted = self.at(share);
        let length_m = wanted.eye.to_ecef().distance_m(pose.eye.to_ecef());
        let from_share = smoothstep((self.gone_s - dt_s) / NORTH_S);
        let clear_share = clear.clear_share(length_m, |part| self.at(mix(from_share, share, part)));
        if clear_share < 1.0 {
            // What stands in the way ends the turn; the rest of it needs no room.
            *self = Self::new(pose, None);
            return (pose, false);
        }
        if self.gone_s < NORTH_S {
            return (wanted, false);
        }
        if wanted.heading_rad.abs() > FLIPPED_RAD {
            // The eye is beyond the pole, where south of the point is north of it.
            *self = Self::new(wanted, None);
            return (wanted, false);
        }
        (Pose { heading_rad: 0.0, ..wanted }, true)
    }

    fn at(&self, share: f64) -> Pose {
        match self.orbit {
            None => Pose { heading_rad: mix_angle(self.from.heading_rad, 0.0, share), ..self.from },
            // South of the point the eye looks north.
            Some(orbit) => orbit.turned(mix_angle(orbit.azimuth_rad, PI, share), orbit.elevation_rad).pose(),
        }
    }
}
