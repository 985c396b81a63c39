//! Zooming in log height towards a point, which stays where it is in the picture.

use super::Surroundings;
use super::clearance::{Clearance, EYE_OVER_GROUND_M};
use super::hold::{elevation_over, face, hold};
use super::motion::{
    LEAST_HEIGHT_M, Lens, MAX_HEIGHT_M, MAX_HEIGHTS_PER_S, MAX_LOG_HEIGHT_PER_S, gone, moved, radius_m, wrapped,
};
use super::{Pose, View};
use crate::geodesy::{Course, Ecef, Geodetic, Point};
use std::f64::consts::FRAC_PI_2;

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
/// A cap of speed is kept to within this share.
const HURRY_ROUNDING: f64 = 1e-3;
/// A point drawn further from its pixel has left it.
const LOST_PX: f64 = 0.5;
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

    /// With the pixel where it is drawn now, where it could not be kept.
    fn drawn(self, view: &View) -> Self {
        match view.project_px(self.point) {
            Some(px) if (px[0] - self.at_px[0]).hypot(px[1] - self.at_px[1]) > LOST_PX => Self { at_px: px, ..self },
            _ => self,
        }
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
        let part = self.unhurried(part, pose, lens, dt_s, clear);
        let way = |share: f64| self.zoomed(pose, lens, part * share, clear);
        let share = clear.clear_share(way_m(&pose, &way(1.0)), way);
        let zoomed = way(share);
        let ended = share < 1.0 || self.left == 0.0;
        self.anchor = self.anchor.map(|anchor| anchor.drawn(&lens.view(zoomed)));
        (zoomed, (!ended).then_some(self))
    }

    /// As much of a zoom as both caps of speed leave: a far point seen from low down must not fling the eye, and on a
    /// ray along the globe's edge the height grows faster than the distance.
    fn unhurried(&self, mut part: f64, pose: Pose, lens: Lens, dt_s: f64, clear: Clearance) -> f64 {
        const TRIES: usize = 4;
        let over_m = clear.height_m(pose.eye);
        for _ in 0..TRIES {
            let zoomed = self.zoomed(pose, lens, part, clear);
            let heights = way_m(&pose, &zoomed) / over_m / MAX_HEIGHTS_PER_S;
            let log_height = (clear.height_m(zoomed.eye) / over_m).ln().abs() / MAX_LOG_HEIGHT_PER_S;
            let hurry = heights.max(log_height) / dt_s.max(f64::MIN_POSITIVE);
            if hurry <= 1.0 + HURRY_ROUNDING {
                break;
            }
            part /= hurry;
        }
        part
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
        let point_m = Geodetic::from_ecef(anchor.point).height_m;
        let below = to_eye.dot(pose.eye.up()) > SHALLOW * distance_m && pose.eye.height_m > point_m;
        let grazing = elevation_over(&pose, anchor.point) < SHALLOW;
        let zoomed = if below && (!grazing || looks_at_globe(&pose, point_m)) {
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

/// Gone to where the anchor is in its place; where its ray has left the globe, to where it is at the globe's edge.
fn held(pose: Pose, lens: Lens, anchor: Anchor) -> Pose {
    match hold(pose, lens, anchor.point, anchor.at_px) {
        Some(way) => moved(pose, way.east_m, way.north_m),
        None => faced(pose, lens, anchor),
    }
}

/// Whether the middle of the picture shows the globe, up to a height above the ellipsoid.
fn looks_at_globe(pose: &Pose, height_m: f64) -> bool {
    let radius_m = radius_m(pose.eye);
    let half_rad = ((radius_m + height_m) / (radius_m + pose.eye.height_m)).min(1.0).asin();
    FRAC_PI_2 + pose.pitch_rad < half_rad
}

fn way_m(from: &Pose, to: &Pose) -> f64 {
    from.eye.to_ecef().distance_m(to.eye.to_ecef())
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
