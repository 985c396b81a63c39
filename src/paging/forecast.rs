//! Where the eye will be: from the last views, or from a flight that is known.
//!
//! Position, height and direction go on as they did over the last moments. Heights above the ground are taken in log
//! space, since people dive and climb by shares of their height; ways over the ground grow and shrink with it. How far
//! the last rates were apart tells how uncertain that is: a predicted view is wider by as much as the eye may have
//! turned or moved otherwise, so that what is likely at its edges counts with its likelihood.

use crate::camera::{Pose, View};
use crate::cells::LiveTree;
use crate::geodesy::{Geodetic, meridian_radius_m};
use std::collections::VecDeque;
use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::sync::Arc;

/// The last views count so long, seconds.
const WINDOW_S: f64 = 0.3;
/// Views kept at most; more frames a second than this many in the window are thinned.
const VIEWS_MAX: usize = 64;
/// An eye that has not stirred for so long stands, seconds.
const STANDS_S: f64 = 0.03;
/// A step between two views that no motion explains is a jump: what was before it says nothing. Heights, radians.
const JUMP_HEIGHTS: f64 = 3.0;
const JUMP_RAD: f64 = 0.7;
/// People turn for so long, seconds: a turn dies away with this time constant.
const TURN_LASTS_S: f64 = 1.5;
/// An eye that does not turn may begin to: predicted views grow by at least this, radians per second.
const UNREST_RAD_PER_S: f64 = 0.05;
/// No predicted view is wider than this, radians.
const FOV_MAX_RAD: f64 = 2.1;
/// Heights over the ground count as at least this, metres.
const LEAST_ABOVE_M: f64 = 1.0;

/// A pose by time, where the way is known: a flight to a place, or a path.
pub type KnownWay = Arc<dyn Fn(f64) -> Pose + Send + Sync>;

/// A view that is expected.
#[derive(Clone, Copy, Debug)]
pub struct Predicted {
    /// From now, seconds.
    pub after_s: f64,
    /// As wide as the uncertainty asks; pixels per radian are those of the present view.
    pub view: View,
    /// By how much it is wider than the present view on each side, pixels.
    pub pad_px: u32,
}

/// Rates of motion, per second.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Rates {
    /// Of the logarithm of the height above the ground.
    log_above: f64,
    /// Over the ground, in heights above it.
    east_heights: f64,
    north_heights: f64,
    heading_rad: f64,
    pitch_rad: f64,
}

impl Rates {
    fn map2(self, other: Self, f: impl Fn(f64, f64) -> f64) -> Self {
        Self {
            log_above: f(self.log_above, other.log_above),
            east_heights: f(self.east_heights, other.east_heights),
            north_heights: f(self.north_heights, other.north_heights),
            heading_rad: f(self.heading_rad, other.heading_rad),
            pitch_rad: f(self.pitch_rad, other.pitch_rad),
        }
    }

    /// Between two poses; heights above the ground at both.
    fn between(from: &Sample, to: &Sample) -> Self {
        let dt_s = to.t_s - from.t_s;
        let (a, b) = (from.pose.eye, to.pose.eye);
        let above_m = (from.above_m * to.above_m).sqrt();
        let radius_m = meridian_radius_m(a.lat_rad.sin()) + a.height_m;
        let east_m = wrapped(b.lon_rad - a.lon_rad) * a.lat_rad.cos() * radius_m;
        let north_m = (b.lat_rad - a.lat_rad) * radius_m;
        Self {
            log_above: (to.above_m / from.above_m).ln() / dt_s,
            east_heights: east_m / above_m / dt_s,
            north_heights: north_m / above_m / dt_s,
            heading_rad: wrapped(to.pose.heading_rad - from.pose.heading_rad) / dt_s,
            pitch_rad: (to.pose.pitch_rad - from.pose.pitch_rad) / dt_s,
        }
    }

    /// How fast the picture may come to be elsewhere, radians per second.
    fn angular(&self, cos_pitch: f64) -> f64 {
        let turned = (self.heading_rad * cos_pitch).hypot(self.pitch_rad);
        turned + self.east_heights.hypot(self.north_heights).min(1.0)
    }
}

fn wrapped(angle_rad: f64) -> f64 {
    (angle_rad + PI).rem_euclid(TAU) - PI
}

#[derive(Clone, Copy, Debug)]
struct Sample {
    t_s: f64,
    pose: Pose,
    above_m: f64,
}

/// Remembers the last views.
#[derive(Clone, Debug, Default)]
pub struct Forecaster {
    samples: VecDeque<Sample>,
    /// Since when the eye has been where it is.
    there_since_s: f64,
}

impl Forecaster {
    /// Takes in the view of a frame.
    pub fn note(&mut self, view: &View, now_s: f64, cells: &LiveTree) {
        let eye = view.pose.eye;
        let ground_m = cells.surface_height_m(eye.lat_rad, eye.lon_rad).unwrap_or(0.0);
        let sample = Sample { t_s: now_s, pose: view.pose, above_m: (eye.height_m - ground_m).max(LEAST_ABOVE_M) };
        let last = self.samples.back();
        let stirs = last.is_none_or(|last| last.pose != sample.pose || last.t_s > now_s);
        let jumps = last.is_some_and(|last| is_jump(last, &sample));
        if stirs {
            self.there_since_s = now_s;
        }
        if jumps || now_s - self.there_since_s >= STANDS_S {
            self.samples.clear();
        }
        let spacing_s = WINDOW_S / VIEWS_MAX as f64;
        let dense = self.samples.iter().rev().nth(1).is_some_and(|before| now_s - before.t_s < spacing_s);
        if self.samples.back().is_some_and(|last| last.t_s >= now_s || dense) {
            self.samples.pop_back();
        }
        self.samples.push_back(sample);
        while self.samples.len() > VIEWS_MAX || self.samples.get(1).is_some_and(|next| now_s - next.t_s >= WINDOW_S) {
            self.samples.pop_front();
        }
    }

    /// What is expected from a view on; where `known` tells the way, exactly that.
    pub fn forecast(&self, view: &View, now_s: f64, known: Option<KnownWay>) -> Forecast {
        let (rates, spread) = self.rates();
        let above_m = self.samples.back().map_or(view.pose.eye.height_m, |last| last.above_m);
        Forecast { view: *view, now_s, above_m: above_m.max(LEAST_ABOVE_M), rates, spread, known }
    }

    /// Mean rates over the window, and how far the rates of its parts are from them.
    fn rates(&self) -> (Rates, Rates) {
        let (Some(first), Some(last)) = (self.samples.front(), self.samples.back()) else { return Default::default() };
        if last.t_s <= first.t_s {
            return Default::default();
        }
        let middle = &self.samples[self.samples.len() / 2];
        if middle.t_s <= first.t_s || last.t_s <= middle.t_s {
            return (Rates::between(first, last), Rates::default());
        }
        let (early, late) = (Rates::between(first, middle), Rates::between(middle, last));
        // The newer half tells more of what comes; how much they differ is how much may change again.
        (
            early.map2(late, |early, late| (early + 3.0 * late) / 4.0),
            early.map2(late, |early, late| (late - early).abs()),
        )
    }
}

fn is_jump(from: &Sample, to: &Sample) -> bool {
    let way_m = from.pose.eye.to_ecef().distance_m(to.pose.eye.to_ecef());
    let turned_rad = wrapped(to.pose.heading_rad - from.pose.heading_rad).abs() * from.pose.pitch_rad.cos();
    way_m > JUMP_HEIGHTS * from.above_m.max(to.above_m) || turned_rad > JUMP_RAD
}

/// What is expected from a view on.
#[derive(Clone)]
pub struct Forecast {
    view: View,
    now_s: f64,
    above_m: f64,
    rates: Rates,
    spread: Rates,
    known: Option<KnownWay>,
}

impl Forecast {
    /// Whether the way is known.
    pub fn is_known(&self) -> bool {
        self.known.is_some()
    }

    /// Speed of turning, radians per second: about the vertical and the horizontal axis of the picture.
    pub fn turn_rad_per_s(&self) -> [f64; 2] {
        [self.rates.heading_rad * self.view.pose.pitch_rad.cos(), self.rates.pitch_rad]
    }

    /// Speed over the ground and of the height, in heights above the ground per second.
    pub fn heights_per_s(&self) -> f64 {
        self.rates.east_heights.hypot(self.rates.north_heights).hypot(self.rates.log_above)
    }

    /// Rate of the logarithm of the height above the ground, per second.
    pub fn log_height_per_s(&self) -> f64 {
        self.rates.log_above
    }

    /// Height above the ground, metres, at least 1.
    pub fn above_m(&self) -> f64 {
        self.above_m
    }

    /// The pose expected, without its uncertainty.
    pub fn pose(&self, after_s: f64) -> Pose {
        if let Some(known) = &self.known {
            return known(self.now_s + after_s);
        }
        let Pose { eye, heading_rad, pitch_rad } = self.view.pose;
        let growth = self.rates.log_above * after_s;
        // ∫ exp(r s) ds over the time, in which ways are counted in present heights.
        let time_s = if growth.abs() < 1e-6 { after_s } else { growth.exp_m1() / self.rates.log_above };
        let radius_m = meridian_radius_m(eye.lat_rad.sin()) + eye.height_m;
        let lat_rad = eye.lat_rad + self.rates.north_heights * self.above_m * time_s / radius_m;
        let across_m = self.rates.east_heights * self.above_m * time_s;
        let lon_rad = eye.lon_rad + across_m / (radius_m * eye.lat_rad.cos().max(1e-6));
        let height_m = eye.height_m + self.above_m * growth.exp_m1();
        let turning_s = TURN_LASTS_S * -(-after_s / TURN_LASTS_S).exp_m1();
        Pose {
            eye: Geodetic { lat_rad: lat_rad.clamp(-FRAC_PI_2, FRAC_PI_2), lon_rad: wrapped(lon_rad), height_m },
            heading_rad: wrapped(heading_rad + self.rates.heading_rad * turning_s),
            pitch_rad: (pitch_rad + self.rates.pitch_rad * turning_s).clamp(-FRAC_PI_2, FRAC_PI_2),
        }
    }

    /// The view expected, as wide as it is uncertain; `widen` is a factor on the uncertainty, 0 leaves it out.
    pub fn at(&self, after_s: f64, widen: f64) -> Predicted {
        let view = View::new(self.pose(after_s), self.view.fov_y_rad, self.view.size_px);
        let off_rad_per_s = self.spread.angular(view.pose.pitch_rad.cos()) + UNREST_RAD_PER_S;
        let off_rad = if self.is_known() { 0.0 } else { widen * off_rad_per_s * after_s };
        let widest_rad = (FOV_MAX_RAD - view.fov_y_rad).max(0.0) / 2.0;
        let pad_px = (off_rad.min(widest_rad).min(1.0).tan() * view.focal_px()) as u32;
        Predicted { after_s, view: if pad_px > 0 { view.padded(pad_px) } else { view }, pad_px }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn forecaster(pose_at: impl Fn(f64) -> Pose) -> (Forecaster, View) {
        let mut forecaster = Forecaster::default();
        let mut view = View::new(pose_at(0.0), 1.0, [640, 360]);
        for frame in 0..=30 {
            let t_s = f64::from(frame) / 60.0;
            view = View::new(pose_at(t_s), 1.0, [640, 360]);
            forecaster.note(&view, t_s, &LiveTree::default());
        }
        (forecaster, view)
    }

    fn pose(lat_deg: f64, lon_deg: f64, height_m: f64, heading_deg: f64, pitch_deg: f64) -> Pose {
        let eye = Geodetic::from_degrees(lat_deg, lon_deg, height_m);
        Pose { eye, heading_rad: heading_deg.to_radians(), pitch_rad: pitch_deg.to_radians() }
    }

    #[test]
    fn a_steady_dive_is_foretold() {
        // The way over the ground shrinks with the height.
        let dive = |t_s: f64| {
            let share = (-0.46 * t_s).exp();
            pose(33.0, -84.0 + 2e-3 * (1.0 - share), 1e6 * share, 10.0, -80.0 + t_s)
        };
        let (forecaster, view) = forecaster(dive);
        let forecast = forecaster.forecast(&view, 0.5, None);
        let (expected, told) = (dive(1.5), forecast.pose(1.0));
        assert!((told.eye.height_m / expected.eye.height_m - 1.0).abs() < 1e-3);
        assert!((told.eye.lon_deg() - expected.eye.lon_deg()).abs() < 2e-5);
        assert!((told.pitch_rad - expected.pitch_rad).to_degrees().abs() < 0.4);
        assert!(forecast.at(1.0, 1.0).pad_px < 60, "{}", forecast.at(1.0, 1.0).pad_px);
    }

    #[test]
    fn an_unsteady_hand_widens_the_view_and_a_known_way_does_not() {
        let shaky = |t_s: f64| pose(33.0, -84.0, 100.0, 20.0 * (t_s * 12.0).sin(), -10.0);
        let (forecaster, view) = forecaster(shaky);
        let forecast = forecaster.forecast(&view, 0.5, None);
        assert!(forecast.at(0.5, 1.0).pad_px > 100 && forecast.at(0.5, 0.0).pad_px == 0);
        let known = forecaster.forecast(&view, 0.5, Some(Arc::new(shaky)));
        assert_eq!((known.pose(0.3), known.at(0.3, 1.0).pad_px), (shaky(0.8), 0));
    }

    #[test]
    fn an_eye_that_has_stopped_is_expected_to_stay() {
        let (mut forecaster, view) = forecaster(|t_s| pose(33.0, -84.0 + 0.01 * t_s, 1000.0, 30.0 * t_s, -20.0));
        assert_ne!(forecaster.forecast(&view, 0.5, None).pose(1.0), view.pose);
        for frame in 1..=4 {
            forecaster.note(&view, 0.5 + f64::from(frame) / 60.0, &LiveTree::default());
        }
        let forecast = forecaster.forecast(&view, 0.6, None);
        assert_eq!((forecast.pose(1.0).eye, forecast.turn_rad_per_s()), (view.pose.eye, [0.0; 2]));
    }

    #[test]
    fn a_jump_makes_what_was_before_it_forgotten() {
        let (mut forecaster, _) = forecaster(|t_s| pose(33.0, -84.0 + 0.1 * t_s, 1000.0, 0.0, -20.0));
        let there = View::new(pose(37.0, -122.0, 1000.0, 0.0, -20.0), 1.0, [640, 360]);
        forecaster.note(&there, 0.6, &LiveTree::default());
        assert_eq!(forecaster.forecast(&there, 0.6, None).pose(1.0), there.pose);
    }
}
