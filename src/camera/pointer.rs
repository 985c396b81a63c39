//! Where the pointer was, how fast it went, and how it would have gone on.

use std::collections::VecDeque;

/// Positions remembered, at most.
const TRAIL_LIMIT: usize = 32;
/// Positions nearer in time are one, seconds.
const APART_S: f64 = 0.004;
/// A speed is measured over this time, seconds.
const WINDOW_S: f64 = 0.08;
/// A pointer that rested as long before it let go has no speed, seconds.
const REST_S: f64 = 0.04;
/// Time constant with which a coasting pointer slows down, seconds.
const SLOW_S: f64 = 0.3;
/// Slower than this a coasting pointer stops, pixels per second.
const STILL_PX_PER_S: f64 = 4.0;
/// No pointer coasts faster, pixels per second.
const FASTEST_PX_PER_S: f64 = 6000.0;
/// Two presses are a double click within this time and distance.
const DOUBLE_S: f64 = 0.35;
const DOUBLE_PX: f64 = 6.0;

fn distance_px(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// The pointer's last moments.
#[derive(Clone, Debug, Default)]
pub(super) struct Pointer {
    trail: VecDeque<(f64, [f64; 2])>,
    inside: bool,
    last_press: Option<(f64, [f64; 2])>,
}

impl Pointer {
    pub(super) fn moved(&mut self, now_s: f64, at_px: [f64; 2]) {
        self.inside = true;
        if self.trail.len() >= 2 && now_s - self.trail[self.trail.len() - 2].0 < APART_S {
            self.trail.pop_back();
        }
        if self.trail.len() == TRAIL_LIMIT {
            self.trail.pop_front();
        }
        self.trail.push_back((now_s, at_px));
    }

    pub(super) fn left(&mut self) {
        self.inside = false;
    }

    /// Where the pointer was last, inside the window or not.
    pub(super) fn last_px(&self) -> Option<[f64; 2]> {
        self.trail.back().map(|(_, at_px)| *at_px)
    }

    /// Where the pointer is; `None` outside the window.
    pub(super) fn over_px(&self) -> Option<[f64; 2]> {
        self.last_px().filter(|_| self.inside)
    }

    /// Speed just before `now_s`, pixels per second.
    pub(super) fn speed_px_per_s(&self, now_s: f64) -> [f64; 2] {
        let Some(&(last_s, last_px)) = self.trail.back() else { return [0.0; 2] };
        let first = self.trail.iter().find(|(t_s, _)| now_s - t_s <= WINDOW_S);
        match first {
            Some(&(first_s, first_px)) if last_s - first_s >= APART_S && now_s - last_s <= REST_S => {
                let speed = [0, 1].map(|axis| (last_px[axis] - first_px[axis]) / (last_s - first_s));
                let cap = (FASTEST_PX_PER_S / speed[0].hypot(speed[1]).max(f64::MIN_POSITIVE)).min(1.0);
                speed.map(|part| part * cap)
            }
            _ => [0.0; 2],
        }
    }

    /// Where a press is. What came before it gives no speed to its drag.
    pub(super) fn pressed(&mut self, now_s: f64) -> Option<[f64; 2]> {
        let at_px = self.last_px()?;
        self.trail.clear();
        self.trail.push_back((now_s, at_px));
        Some(at_px)
    }

    /// Notes a press; whether it is the second of a double click.
    pub(super) fn is_double(&mut self, now_s: f64, at_px: [f64; 2]) -> bool {
        let double = self
            .last_press
            .is_some_and(|(t_s, was_px)| now_s - t_s <= DOUBLE_S && distance_px(was_px, at_px) <= DOUBLE_PX);
        self.last_press = (!double).then_some((now_s, at_px));
        double
    }

    pub(super) fn forget_press(&mut self) {
        self.last_press = None;
    }
}

/// A pointer that runs on by itself and comes to a stop.
#[derive(Clone, Copy, Debug)]
pub(super) struct Coast {
    from_px: [f64; 2],
    speed_px_per_s: [f64; 2],
    gone_s: f64,
}

impl Coast {
    /// `None` where it would not move.
    pub(super) fn new(from_px: [f64; 2], speed_px_per_s: [f64; 2]) -> Option<Self> {
        let coast = Self { from_px, speed_px_per_s, gone_s: 0.0 };
        (!coast.has_ended()).then_some(coast)
    }

    pub(super) fn step(&mut self, dt_s: f64) -> [f64; 2] {
        self.gone_s += dt_s;
        let way_s = SLOW_S * super::motion::gone(self.gone_s, SLOW_S);
        [0, 1].map(|axis| self.from_px[axis] + self.speed_px_per_s[axis] * way_s)
    }

    pub(super) fn has_ended(&self) -> bool {
        let [x, y] = self.speed_px_per_s;
        x.hypot(y) * (-self.gone_s / SLOW_S).exp() < STILL_PX_PER_S
    }
}
