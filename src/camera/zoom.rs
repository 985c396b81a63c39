//! Zooming in log height towards a point, which stays where it is in the picture.

use super::Pose;
use super::Surroundings;
use super::clearance::{Clearance, EYE_OVER_GROUND_M};
use super::hold::{Reach, face, hold};
use super::motion::{
    LEAST_HEIGHT_M, Lens, MAX_HEIGHT_M, MAX_HEIGHTS_PER_S, MAX_LOG_HEIGHT_PER_S, gone, moved, wrapped,
};
use crate::geodesy::{Course, Ecef, Geodetic, Point};

/// One notch of the wheel multiplies the height by this, inwards.
const NOTCH: f64 = 0.8;
/// Time constant with which a notch is carried out; nearly all of it within 0.15 s.
const SMOOTH_S: f64 = 0.05;
/// A zoom ends with its last thousandth.
const STILL: f64 = 1e-3;
/// More than this does not pile up, logarithm of the height: e⁴ is eighteen notches.
const MAX_LEFT: f64 = 4.0;
/// Where the eye looks on a point less steeply than this (sine), its height says nothing about its distance: it goes
/// along the ray.
const SHALLOW: f64 = 0.08;
/// Zooming in ends at this distance, metres.
const LEAST_DISTANCE_M: f64 = 2.0;
/// The pointer may move as far before another point is zoomed to, pixels.
const SAME_PX: f64 = 3.0;

/// A point and the pixel where it stays.
#[derive(Clone, Copy, Debug)]
pub(super) struct Anchor {
    pub(super) point: Point<Ecef>,
    pub(super) at_px: [f64; 2],
}

impl Anchor {
    pub(super) fn pick(pose: Pose, lens: Lens, at_px: [f64; 2], around: &dyn Surroundings) -> Option<Self> {
        let point = around.pick(&lens.view(pose), at_px).filter(|point| point.xyz().is_finite())?;
        Some(Self { point, at_px })
    }
}

/// A zoom under way.
#[derive(Clone, Copy, Debug)]
pub(super) struct Zoom {
    /// Without one the zoom is along the vertical.
    anchor: Option<Anchor>,
    /// Where the cursor was.
    cursor_px: [f64; 2],
    /// What is still to be done, logarithm of the height.
    left: f64,
}

impl Zoom {
    /// About the point at a pixel, else about the one in the middle, else along the vertical.
    pub(super) fn about(pose: Pose, lens: Lens, at_px: [f64; 2], around: &dyn Surroundings) -> Self {
        let anchor =
            Anchor::pick(pose, lens, at_px, around).or_else(|| Anchor::pick(pose, lens, lens.middle_px(), around));
        Self { anchor, cursor_px: at_px, left: 0.0 }
    }

    pub(super) fn is_about(&self, at_px: [f64; 2]) -> bool {
        (self.cursor_px[0] - at_px[0]).hypot(self.cursor_px[1] - at_px[1]) <= SAME_PX
    }

    /// Positive notches zoom in.
    pub(super) fn turn(&mut self, notches: f64) {
        self.add(notches * NOTCH.ln());
    }

    pub(super) fn add(&mut self, log_height: f64) {
        self.left = (self.left + log_height).clamp(-MAX_LEFT, MAX_LEFT);
    }

    /// The pose `dt_s` later; `None` as zoom where it has ended.
    pub(super) fn step(mut self, pose: Pose, lens: Lens, dt_s: f64, clear: Clearance) -> (Pose, Option<Self>) {
        let most = MAX_LOG_HEIGHT_PER_S * dt_s;
        let part = if self.left.abs() < STILL { self.left } else { self.left * gone(dt_s, SMOOTH_S) };
        let part = part.clamp(-most, most);
        self.left -= part;
        let part = part.clamp(-self.most_by_way(&pose, dt_s, clear), self.most_by_way(&pose, dt_s, clear));
        let way = |share: f64| self.zoomed(pose, lens, part * share, clear);
        let length_m = way(1.0).eye.to_ecef().distance_m(pose.eye.to_ecef());
        let share = clear.clear_share(length_m, way);
        let ended = share < 1.0 || self.left == 0.0;
        (way(share), (!ended).then_some(self))
    }

    /// A far point seen from low down must not fling the eye: what the cap of speed leaves.
    fn most_by_way(&self, pose: &Pose, dt_s: f64, clear: Clearance) -> f64 {
        let Some(anchor) = self.anchor else { return f64::INFINITY };
        let distance_m = pose.eye.to_ecef().distance_m(anchor.point).max(LEAST_DISTANCE_M);
        MAX_HEIGHTS_PER_S * clear.height_m(pose.eye) * dt_s / distance_m
    }

    fn zoomed(&self, pose: Pose, lens: Lens, log_height: f64, clear: Clearance) -> Pose {
        if log_height == 0.0 {
            return pose;
        }
        let factor = log_height.exp();
        let Some(anchor) = self.anchor else {
            let eye = over(pose.eye, factor, clear.ground_m(pose.eye));
            return raised(Pose { eye, ..pose }, &pose, clear);
        };
        let to_eye = (pose.eye.to_ecef() - anchor.point).xyz();
        let distance_m = to_eye.length();
        if factor < 1.0 && distance_m * factor < LEAST_DISTANCE_M {
            return pose;
        }
        let steep = to_eye.dot(pose.eye.up()) > SHALLOW * distance_m;
        let point_m = Geodetic::from_ecef(anchor.point).height_m;
        let zoomed = if steep && pose.eye.height_m > point_m {
            held(Pose { eye: over(pose.eye, factor, point_m), ..pose }, lens, anchor)
        } else {
            faced(drawn_near(pose, anchor.point, factor), lens, anchor)
        };
        let raised = raised(zoomed, &pose, clear);
        if raised == zoomed { zoomed } else { faced(raised, lens, anchor) }
    }
}

/// The place with its height over `base_m` multiplied.
fn over(place: Geodetic, factor: f64, base_m: f64) -> Geodetic {
    let height_m = base_m + (place.height_m - base_m) * factor;
    place.at_height(height_m.min(MAX_HEIGHT_M.max(place.height_m)))
}

/// No lower than zooming may go; an eye that was lower stays as low.
fn raised(pose: Pose, from: &Pose, clear: Clearance) -> Pose {
    let was_m = from.eye.height_m - clear.ground_m(from.eye);
    let least_m = clear.ground_m(pose.eye) + was_m.clamp(EYE_OVER_GROUND_M, LEAST_HEIGHT_M);
    Pose { eye: pose.eye.at_height(pose.eye.height_m.max(least_m)), ..pose }
}

/// Gone to where the anchor is in its place. Where its ray has left the globe the anchor stays at the globe's edge, and
/// the eye tilts only where it would lose the globe from the middle of the picture.
fn held(pose: Pose, lens: Lens, anchor: Anchor) -> Pose {
    let Some(way) = hold(pose, lens, anchor.point, anchor.at_px) else {
        return faced(pose, lens, anchor);
    };
    let held = moved(pose, way.east_m, way.north_m);
    match way.reach {
        Reach::Cursor => held,
        Reach::Limb if looks_at_globe(&held, anchor.point) => held,
        Reach::Limb => faced(held, lens, anchor),
    }
}

/// Whether the middle of the picture is less far from straight down than a point at the globe's edge.
fn looks_at_globe(pose: &Pose, edge: Point<Ecef>) -> bool {
    let to_edge = (edge - pose.eye.to_ecef()).xyz().normalize_or_zero();
    -pose.pitch_rad.sin() > -to_edge.dot(pose.eye.up())
}

fn faced(pose: Pose, lens: Lens, anchor: Anchor) -> Pose {
    face(pose, lens, (anchor.point - pose.eye.to_ecef()).xyz().normalize_or_zero(), anchor.at_px)
}

/// Nearer to a point on a straight line.
fn drawn_near(pose: Pose, point: Point<Ecef>, factor: f64) -> Pose {
    let eye = point.xyz() + (pose.eye.to_ecef() - point).xyz() * factor;
    let eye = Geodetic::from_ecef(Point::new(eye));
    let course = Course::between(pose.eye, eye);
    let eye = eye.at_height(eye.height_m.min(MAX_HEIGHT_M.max(pose.eye.height_m)));
    Pose { eye, heading_rad: wrapped(pose.heading_rad + course.arrival_rad - course.departure_rad), ..pose }
}
