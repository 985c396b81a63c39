//! What all movements share: the lens, ways along the ellipsoid, limits of speed, easing.

use super::{Pose, View};
use crate::geodesy::{Ecef, Geodetic, Point, meridian_radius_m, prime_vertical_radius_m};
use glam::DVec3;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Highest an eye goes above the ellipsoid, metres: the Earth is then 17 degrees wide.
pub const MAX_HEIGHT_M: f64 = 4e7;
/// No movement by hand is faster than this, in heights of the eye above the ground per second: a grab near the horizon
/// asks for any speed, and pages must have a chance to come.
pub const MAX_HEIGHTS_PER_S: f64 = 60.0;
/// No zoom changes the logarithm of the height faster than this, per second: the whole Earth to a street in three
/// seconds.
pub const MAX_LOG_HEIGHT_PER_S: f64 = 5.0;
/// Speeds count from at least this height above the ground, metres.
pub(super) const LEAST_HEIGHT_M: f64 = 2.0;
/// A frame that took longer counts as this long, seconds: after a stall the picture goes on from where it was.
pub(super) const MAX_STEP_S: f64 = 0.25;

/// What makes a view of a pose.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lens {
    fov_y_rad: f64,
    size_px: [u32; 2],
}

impl Lens {
    /// A picture has at least one pixel.
    pub(super) fn new(fov_y_rad: f64, size_px: [u32; 2]) -> Self {
        Self { fov_y_rad, size_px: size_px.map(|side| side.max(1)) }
    }

    pub(super) fn view(&self, pose: Pose) -> View {
        View::new(pose, self.fov_y_rad, self.size_px)
    }

    pub(super) fn middle_px(&self) -> [f64; 2] {
        self.size_px.map(|side| f64::from(side) / 2.0)
    }

    pub(super) fn height_px(&self) -> f64 {
        f64::from(self.size_px[1])
    }

    pub(super) fn focal_px(&self) -> f64 {
        self.height_px() / (2.0 * (self.fov_y_rad / 2.0).tan())
    }

    /// Unit direction of a pixel in view axes: x right, y up, z backwards.
    pub(super) fn direction(&self, at_px: [f64; 2]) -> DVec3 {
        let [x_px, y_px] = self.middle_px();
        DVec3::new(at_px[0] - x_px, y_px - at_px[1], -self.focal_px()).normalize()
    }
}

/// The pose after going east and north by as much along a geodesic of the ellipsoid, at the same height and pitch. The
/// heading keeps its angle to the geodesic (parallel transport), so that neither poles nor meridians are special.
pub(super) fn moved(pose: Pose, east_m: f64, north_m: f64) -> Pose {
    let distance_m = east_m.hypot(north_m);
    if distance_m == 0.0 || !distance_m.is_finite() {
        return pose;
    }
    let departure_rad = east_m.atan2(north_m);
    let (eye, arrival_rad) = pose.eye.travel(departure_rad, distance_m);
    Pose { eye, heading_rad: wrapped(pose.heading_rad + arrival_rad - departure_rad), ..pose }
}

/// The pose from another eye that looks at `point` in the middle of the picture. Where it looks straight down,
/// `heading_rad` is kept.
pub(super) fn looking_at(eye: Geodetic, point: Point<Ecef>, heading_rad: f64) -> Pose {
    let local = eye.ecef_from_enu().inverse() * point;
    let [east, north, up] = local.xyz().to_array();
    let across = east.hypot(north);
    let straight_down = across <= 1e-9 * up.abs();
    let heading_rad = if straight_down { heading_rad } else { east.atan2(north) };
    Pose { eye, heading_rad: wrapped(heading_rad), pitch_rad: up.atan2(across) }
}

/// Gaussian mean radius of curvature of the ellipsoid below a place, metres.
pub(super) fn radius_m(place: Geodetic) -> f64 {
    let sin_lat = place.lat_rad.sin();
    (meridian_radius_m(sin_lat) * prime_vertical_radius_m(sin_lat)).sqrt()
}

/// The same direction, −π to π.
pub(super) fn wrapped(angle_rad: f64) -> f64 {
    if angle_rad.abs() <= PI { angle_rad } else { (angle_rad + PI).rem_euclid(TAU) - PI }
}

pub(super) fn clamped_pitch(pitch_rad: f64) -> f64 {
    pitch_rad.clamp(-FRAC_PI_2, FRAC_PI_2)
}

/// From 0 to 1 with slope 0 at both ends.
pub(super) fn smoothstep(share: f64) -> f64 {
    let share = share.clamp(0.0, 1.0);
    share * share * (3.0 - 2.0 * share)
}

pub(super) fn mix(from: f64, to: f64, share: f64) -> f64 {
    from + (to - from) * share
}

/// Between two directions the short way round.
pub(super) fn mix_angle(from_rad: f64, to_rad: f64, share: f64) -> f64 {
    wrapped(from_rad + wrapped(to_rad - from_rad) * share)
}

/// The part of a difference that is gone after `dt_s` at a time constant.
pub(super) fn gone(dt_s: f64, constant_s: f64) -> f64 {
    -(-dt_s / constant_s).exp_m1()
}

pub(super) fn is_finite(pose: &Pose) -> bool {
    [pose.eye.lat_rad, pose.eye.lon_rad, pose.eye.height_m, pose.heading_rad, pose.pitch_rad]
        .iter()
        .all(|number| number.is_finite())
}
