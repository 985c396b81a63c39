//! Held keys: flying by heights per second, turning, zooming; every speed starts and stops smoothly.

use super::Pose;
use super::clearance::Clearance;
use super::motion::{clamped_pitch, gone, wrapped};

/// Speed of free flight, heights above the ground per second.
const HEIGHTS_PER_S: f64 = 1.0;
/// The same with `Fast`.
const FAST_HEIGHTS_PER_S: f64 = 4.0;
/// Turning and tilting, radians per second.
const TURN_RAD_PER_S: f64 = std::f64::consts::FRAC_PI_3;
/// Zooming, logarithm of the height per second.
const ZOOM_PER_S: f64 = 1.2;
/// Time constant of starting and stopping.
const SMOOTH_S: f64 = 0.1;
/// Share of full speed below which a movement that is no longer asked for ends.
const STILL: f64 = 1e-3;

/// Held keys.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Held {
    Forward,
    Back,
    Left,
    Right,
    Up,
    Down,
    TurnLeft,
    TurnRight,
    TiltUp,
    TiltDown,
    ZoomIn,
    ZoomOut,
    Fast,
}

const KEYS: usize = Held::Fast as usize + 1;
/// What is moved by a pair of keys: rightwards, forwards, upwards, turn, tilt, zoom out.
const PAIRS: [(Held, Held); 6] = [
    (Held::Right, Held::Left),
    (Held::Forward, Held::Back),
    (Held::Up, Held::Down),
    (Held::TurnRight, Held::TurnLeft),
    (Held::TiltUp, Held::TiltDown),
    (Held::ZoomOut, Held::ZoomIn),
];

/// The keys and the speeds that they have reached.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Walk {
    held: [bool; KEYS],
    /// By [`PAIRS`], in heights, radians or logarithms per second.
    speeds: [f64; PAIRS.len()],
}

impl Walk {
    pub(super) fn hold(&mut self, key: Held, held: bool) {
        self.held[key as usize] = held;
    }

    pub(super) fn release_all(&mut self) {
        self.held = Default::default();
    }

    pub(super) fn stop(&mut self) {
        *self = Self::default();
    }

    pub(super) fn is_moving(&self) -> bool {
        self.speeds.iter().chain(&self.targets()).any(|speed| *speed != 0.0)
    }

    fn targets(&self) -> [f64; PAIRS.len()] {
        let heights = if self.held[Held::Fast as usize] { FAST_HEIGHTS_PER_S } else { HEIGHTS_PER_S };
        let full = [heights, heights, heights, TURN_RAD_PER_S, TURN_RAD_PER_S, ZOOM_PER_S];
        std::array::from_fn(|at| {
            let (more, less) = PAIRS[at];
            let sign = f64::from(self.held[more as usize]) - f64::from(self.held[less as usize]);
            sign * full[at]
        })
    }

    /// The ways of `dt_s`, by [`PAIRS`]: speeds approach their targets exponentially, integrated exactly.
    fn ways(&mut self, dt_s: f64) -> [f64; PAIRS.len()] {
        let targets = self.targets();
        std::array::from_fn(|at| {
            let (target, excess) = (targets[at], self.speeds[at] - targets[at]);
            let gone = gone(dt_s, SMOOTH_S);
            self.speeds[at] = target + excess * (1.0 - gone);
            if target == 0.0 && self.speeds[at].abs() < STILL {
                self.speeds[at] = 0.0;
            }
            target * dt_s + excess * SMOOTH_S * gone
        })
    }

    /// The pose `dt_s` later, and the change of the logarithm of the height that the zoom keys ask for.
    pub(super) fn step(&mut self, pose: Pose, dt_s: f64, clear: Clearance) -> (Pose, f64) {
        if !self.is_moving() {
            return (pose, 0.0);
        }
        let [right, ahead, up, turn_rad, tilt_rad, zoom] = self.ways(dt_s);
        let turned = Pose {
            heading_rad: wrapped(pose.heading_rad + turn_rad),
            pitch_rad: clamped_pitch(pose.pitch_rad + tilt_rad),
            ..pose
        };
        if right == 0.0 && ahead == 0.0 && up == 0.0 {
            return (turned, zoom);
        }
        let height_m = clear.height_m(pose.eye);
        let (sin_h, cos_h) = turned.heading_rad.sin_cos();
        let (east, north) = (ahead * sin_h + right * cos_h, ahead * cos_h - right * sin_h);
        // Upwards the height itself grows at this rate, so that it never falls to the ground.
        let up_m = height_m * up.exp_m1();
        (clear.walked(turned, east * height_m, north * height_m, up_m), zoom)
    }
}
