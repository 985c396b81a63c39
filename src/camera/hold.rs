//! Where an eye must go, and how it must turn, for a thing to be drawn under the cursor.
//!
//! Going: height and pitch stay, so the eye has two freedoms, east and north, for the two pixels. On a sphere the answer
//! is closed: the ray of the cursor meets the sphere of the held point at Q; the rotation that takes Q to the point,
//! about an axis in the eye's horizon, moves the eye without twisting it. From there Levenberg's and Marquardt's steps
//! (Marquardt 1963) find the answer on the ellipsoid.

use super::Pose;
use super::motion::{Lens, clamped_pitch, moved, radius_m, wrapped};
use crate::geodesy::{Ecef, Point};
use glam::{DMat2, DVec2, DVec3};
use std::f64::consts::{FRAC_PI_2, PI};

/// Elevation of the eye over the held point's horizon below which the point cannot be held by going, radians: the way
/// would grow beyond all bounds at the horizon itself.
pub(super) const LEAST_ELEVATION_RAD: f64 = 0.01;
/// A point is held when it is drawn as near to the cursor as this, pixels.
const TOLERANCE_PX: f64 = 0.002;
const MAX_STEPS: usize = 40;
/// Way over which slopes are measured, in distances to the point.
const PROBE: f64 = 1e-4;

/// Whether what was asked for can be had.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Reach {
    /// The point is under the cursor.
    Cursor,
    /// The cursor is beside the globe; the point is at the globe's edge, towards the cursor.
    Limb,
}

/// The way along the ellipsoid that brings a point to its place in the picture.
#[derive(Clone, Copy, Debug)]
pub(super) struct Way {
    pub(super) east_m: f64,
    pub(super) north_m: f64,
    pub(super) reach: Reach,
}

/// Elevation of the eye over the horizon of a point, radians; negative where the point looks down on the eye.
pub(super) fn elevation_over(pose: &Pose, point: Point<Ecef>) -> f64 {
    let to_eye = (pose.eye.to_ecef() - point).xyz();
    let up = crate::geodesy::Geodetic::from_ecef(point).up();
    (up.dot(to_eye) / to_eye.length()).clamp(-1.0, 1.0).asin()
}

/// The sphere that the ellipsoid is taken for round the eye.
struct Sphere {
    center: DVec3,
    eye: DVec3,
    up: DVec3,
    radius_m: f64,
}

impl Sphere {
    fn below(pose: &Pose) -> Self {
        let (eye, up, radius_m) = (pose.eye.to_ecef().xyz(), pose.eye.up(), radius_m(pose.eye));
        Self { center: eye - up * (radius_m + pose.eye.height_m), eye, up, radius_m }
    }

    /// A direction, pulled towards the globe's centre to where it meets the sphere through `point` at no less than
    /// [`LEAST_ELEVATION_RAD`]; and where it meets it. `None` where the point is not below the eye.
    fn aim(&self, direction: DVec3, point: DVec3) -> Option<(DVec3, DVec3, Reach)> {
        let (eye_m, point_m) = ((self.eye - self.center).length(), (point - self.center).length());
        if point_m >= eye_m {
            return None;
        }
        let cos_down = -direction.dot(self.up);
        let across = direction + self.up * cos_down;
        let sin_most = point_m / eye_m * LEAST_ELEVATION_RAD.cos();
        let meets = cos_down > 0.0 && across.length() <= sin_most;
        let (direction, sin_down, cos_down, reach) = if meets {
            (direction, across.length(), cos_down, Reach::Cursor)
        } else {
            let cos_most = (1.0 - sin_most * sin_most).sqrt();
            (across.normalize_or_zero() * sin_most - self.up * cos_most, sin_most, cos_most, Reach::Limb)
        };
        let inside = (point_m * point_m - eye_m * eye_m * sin_down * sin_down).max(0.0);
        // The nearer root, written without a difference of like numbers.
        let far_m = (eye_m - point_m) * (eye_m + point_m) / (eye_m * cos_down + inside.sqrt());
        Some((direction, self.eye + direction * far_m, reach))
    }

    /// Way of the eye, metres on the ground in ECEF axes, that takes `from` (fixed to the eye) to `to`.
    fn roll(&self, from: DVec3, to: DVec3) -> DVec3 {
        let axis = self.up.cross(to - from).normalize_or_zero();
        let (from, to) = (from - self.center, to - self.center);
        let (from, to) = (from - axis * axis.dot(from), to - axis * axis.dot(to));
        let angle_rad = axis.dot(from.cross(to)).atan2(from.dot(to));
        axis.cross(self.up) * (angle_rad * self.radius_m)
    }
}

/// How far beside its target a point is drawn, as a function of the eye's way; about pixels, and defined behind the
/// picture's plane as well.
struct Miss {
    pose: Pose,
    lens: Lens,
    point: Point<Ecef>,
    target: DVec3,
    right: DVec3,
    up: DVec3,
}

impl Miss {
    /// `target` is a unit direction in view axes.
    fn new(pose: Pose, lens: Lens, point: Point<Ecef>, target: DVec3) -> Self {
        let right = target.any_orthonormal_vector();
        Self { pose, lens, point, target, right, up: right.cross(target) }
    }

    fn at(&self, way: DVec2) -> DVec2 {
        let view = self.lens.view(moved(self.pose, way.x, way.y));
        let seen = (view.ecef_from_view().inverse() * self.point).xyz().normalize_or_zero();
        if seen.dot(self.target) <= 0.0 {
            return DVec2::INFINITY;
        }
        DVec2::new(self.right.dot(seen), self.up.dot(seen)) * self.lens.focal_px()
    }

    fn slopes(&self, way: DVec2, here: DVec2, probe_m: f64) -> DMat2 {
        let along = |step: DVec2| (self.at(way + step) - here) / probe_m;
        DMat2::from_cols(along(DVec2::X * probe_m), along(DVec2::Y * probe_m))
    }

    /// The way with the least miss from a start.
    fn least(&self, start: DVec2, probe_m: f64) -> (DVec2, f64) {
        let (mut way, mut miss) = (start, self.at(start));
        let mut damping = 1e-6;
        for _ in 0..MAX_STEPS {
            if miss.length() <= TOLERANCE_PX || !miss.is_finite() {
                break;
            }
            let slopes = self.slopes(way, miss, probe_m);
            let square = slopes.transpose() * slopes;
            let damped = square + DMat2::from_diagonal((square.x_axis.x + square.y_axis.y) * DVec2::splat(damping));
            let step = -(damped.inverse() * (slopes.transpose() * miss));
            let next = self.at(way + step);
            if step.is_finite() && next.length() < miss.length() {
                (way, miss) = (way + step, next);
                damping = (damping / 10.0).max(1e-12);
            } else {
                damping *= 10.0;
            }
        }
        (way, miss.length())
    }
}

/// The eye's way after which `point` is drawn at `at_px`, at the same height and pitch; where the cursor is beside the
/// globe, at the edge of the globe. `None` where the point is not below the eye.
pub(super) fn hold(pose: Pose, lens: Lens, point: Point<Ecef>, at_px: [f64; 2]) -> Option<Way> {
    let view = lens.view(pose);
    let sphere = Sphere::below(&pose);
    let ray = view.ecef_from_view().rotation() * lens.direction(at_px);
    let (aimed, met, reach) = sphere.aim(ray, point.xyz())?;
    let roll = sphere.roll(met, point.xyz());
    let axes = pose.eye.ecef_from_enu().rotation();
    let start = DVec2::new(axes.x_axis.dot(roll), axes.y_axis.dot(roll));
    let miss = Miss::new(pose, lens, point, view.ecef_from_view().rotation().transpose() * aimed);
    let probe_m = PROBE * view.eye().distance_m(point);
    let rolled = miss.least(start, probe_m);
    // A long roll may leave what the sphere knows about the ellipsoid; the last pose is the other good start.
    let best = if rolled.1 <= 0.1 { rolled } else { least_of(rolled, miss.least(DVec2::ZERO, probe_m)) };
    best.0.is_finite().then_some(Way { east_m: best.0.x, north_m: best.0.y, reach })
}

fn least_of(a: (DVec2, f64), b: (DVec2, f64)) -> (DVec2, f64) {
    if b.1 < a.1 { b } else { a }
}

/// The pose, turned on its place so that a direction (unit, ECEF) is drawn at `at_px`, as far as pitch can go.
pub(super) fn face(pose: Pose, lens: Lens, direction: DVec3, at_px: [f64; 2]) -> Pose {
    let enu = pose.eye.ecef_from_enu().rotation().transpose() * direction;
    let ray = lens.direction(at_px);
    // The ray climbs by ray.y cos p − ray.z sin p, which must be enu.z.
    let amplitude = ray.y.hypot(ray.z);
    let (rise_rad, own_rad) = ((enu.z / amplitude).clamp(-1.0, 1.0).asin(), ray.y.atan2(-ray.z));
    let far = |pitch_rad: f64| (pitch_rad - pose.pitch_rad).abs() + 10.0 * (pitch_rad.abs() - FRAC_PI_2).max(0.0);
    let (one, other) = (wrapped(rise_rad - own_rad), wrapped(PI - rise_rad - own_rad));
    let pitch_rad = clamped_pitch(if far(one) <= far(other) { one } else { other });
    let (sin_p, cos_p) = pitch_rad.sin_cos();
    let ahead = -ray.z * cos_p - ray.y * sin_p;
    if enu.x.hypot(enu.y) < 1e-12 || ray.x.hypot(ahead) < 1e-12 {
        return Pose { pitch_rad, ..pose };
    }
    Pose { heading_rad: wrapped(enu.x.atan2(enu.y) - ray.x.atan2(ahead)), pitch_rad, ..pose }
}
