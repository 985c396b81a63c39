//! The controller: input and time go in, poses come out. It reads no clock and draws nothing.

use super::Surroundings;
use super::clearance::Clearance;
use super::fly_to::{Destination, FlyTo};
use super::grab::{Followed, Grab, middle};
use super::motion::{Lens, MAX_STEP_S, clamped_pitch, is_finite, wrapped};
use super::orbit::NorthUp;
use super::pointer::{Coast, Pointer};
use super::walk::{Held, Walk};
use super::zoom::{Anchor, Zoom};
use super::{Pose, View};
use crate::geodesy::Geodetic;
use std::f64::consts::FRAC_PI_2;
use std::sync::Arc;

/// A double click flies to this share of the distance, but no nearer than so many metres.
const DOUBLE_CLICK_SHARE: f64 = 1.0 / 8.0;
const DOUBLE_CLICK_LEAST_M: f64 = 60.0;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Button {
    Left,
    Middle,
    Right,
}

/// What hands do; positions are pixels from the top left of the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NavInput {
    PointerMoved([f64; 2]),
    PointerLeft,
    Pressed(Button),
    Released(Button),
    /// Positive zooms in.
    Wheel {
        notches: f64,
    },
    Hold(Held, bool),
    NorthUp,
    Reset,
    Stop,
    FlyTo(Destination),
    /// The window lost the keyboard: nothing is held any more.
    Unfocused,
}

/// What moves the eye beside keys and wheel; one at a time.
#[derive(Clone, Debug)]
enum Gesture {
    Rest,
    Drag(Grab, Button),
    Coast(Grab, Coast),
    Flight(Arc<FlyTo>),
    North(NorthUp),
}

/// Moves an eye by hand; see [`NavInput`].
///
/// A left drag holds the point under the cursor, a right or middle drag goes round the middle of the picture, the wheel
/// zooms to the cursor, a double click flies there. The eye keeps out of the ground and of buildings. Times are seconds
/// on any clock that does not run backwards.
#[derive(Clone, Debug)]
pub struct Navigator {
    pose: Pose,
    home: Pose,
    fov_y_rad: f64,
    last_s: Option<f64>,
    pointer: Pointer,
    walk: Walk,
    zoom: Option<Zoom>,
    gesture: Gesture,
    /// Whether the drag has not caught up with its cursor.
    behind: bool,
    /// Whether the eye is still rising out of what came over it.
    rising: bool,
}

impl Navigator {
    /// `home` is where `Reset` flies. A pose that is not finite is replaced by the other one, or by the whole Earth.
    pub fn new(pose: Pose, home: Pose, fov_y_rad: f64) -> Self {
        let home = sane(home).or(sane(pose)).unwrap_or(WHOLE_EARTH);
        Self {
            pose: sane(pose).unwrap_or(home),
            home,
            fov_y_rad,
            last_s: None,
            pointer: Pointer::default(),
            walk: Walk::default(),
            zoom: None,
            gesture: Gesture::Rest,
            behind: false,
            rising: false,
        }
    }

    pub fn pose(&self) -> Pose {
        self.pose
    }

    /// Jumps to a pose; everything stops, drags too. One that is not finite is ignored.
    pub fn place(&mut self, pose: Pose) {
        self.stop();
        self.walk.stop();
        self.pose = sane(pose).unwrap_or(self.pose);
    }

    /// Whether a later step will move the eye without further input.
    pub fn is_moving(&self) -> bool {
        let by_gesture = matches!(self.gesture, Gesture::Coast(..) | Gesture::Flight(_) | Gesture::North(_));
        by_gesture || self.behind || self.rising || self.zoom.is_some() || self.walk.is_moving()
    }

    /// The flight under way, whose path is known: the pose at any time.
    pub fn flight(&self) -> Option<&Arc<FlyTo>> {
        match &self.gesture {
            Gesture::Flight(flight) => Some(flight),
            _ => None,
        }
    }

    /// Takes an input that came at `now_s`; the eye moves with the next [`Navigator::step`].
    pub fn input(&mut self, input: NavInput, now_s: f64, size_px: [u32; 2], around: &dyn Surroundings) {
        let lens = Lens::new(self.fov_y_rad, size_px);
        self.wake(now_s);
        match input {
            NavInput::PointerMoved(at_px) if at_px.iter().all(|px| px.is_finite()) => self.pointer.moved(now_s, at_px),
            NavInput::PointerMoved(_) => {}
            NavInput::PointerLeft => self.pointer.left(),
            NavInput::Pressed(button) => self.press(button, now_s, lens, around),
            NavInput::Released(button) => self.release(button, now_s),
            NavInput::Wheel { notches } if notches.is_finite() => self.wheel(notches, lens, around),
            NavInput::Wheel { .. } => {}
            NavInput::Hold(key, held) => self.key(key, held),
            NavInput::NorthUp => {
                self.stop();
                self.gesture = Gesture::North(NorthUp::new(self.pose, middle(self.pose, lens, around)));
            }
            NavInput::Reset => self.fly(self.home, now_s, around),
            NavInput::FlyTo(destination) => self.fly(destination.pose, now_s, around),
            NavInput::Stop => {
                self.stop();
                self.walk.stop();
            }
            NavInput::Unfocused => {
                self.walk.release_all();
                self.end_drag();
            }
        }
    }

    /// Moves on to `now_s` and gives the view of this frame.
    pub fn step(&mut self, now_s: f64, size_px: [u32; 2], around: &dyn Surroundings) -> View {
        let lens = Lens::new(self.fov_y_rad, size_px);
        let clear = Clearance::new(around);
        let dt_s = self.tick(now_s);
        self.walk_on(dt_s, lens, clear, around);
        self.zoom_on(dt_s, lens, clear);
        self.follow(dt_s, lens, clear);
        self.rise(dt_s, clear);
        lens.view(self.pose)
    }

    /// A rest is no time to make up for.
    fn wake(&mut self, now_s: f64) {
        let is_dragged = matches!(self.gesture, Gesture::Drag(..));
        if now_s.is_finite() && !is_dragged && !self.is_moving() {
            self.last_s = Some(self.last_s.map_or(now_s, |last_s| last_s.max(now_s)));
        }
    }

    /// Seconds since the last step, as far as they count; a flight waits for the rest.
    fn tick(&mut self, now_s: f64) -> f64 {
        let passed_s = (now_s - self.last_s.unwrap_or(now_s)).max(0.0);
        let passed_s = if passed_s.is_finite() { passed_s } else { 0.0 };
        if now_s.is_finite() {
            self.last_s = Some(self.last_s.map_or(now_s, |last_s| last_s.max(now_s)));
        }
        if let Gesture::Flight(flight) = &mut self.gesture {
            let late_s = passed_s - MAX_STEP_S;
            if late_s > 0.0 {
                Arc::make_mut(flight).delay(late_s);
            }
        }
        passed_s.min(MAX_STEP_S)
    }

    /// Ends drags, zooms, coasting and flights.
    fn stop(&mut self) {
        self.gesture = Gesture::Rest;
        self.zoom = None;
        self.behind = false;
    }

    fn end_drag(&mut self) {
        if matches!(self.gesture, Gesture::Drag(..)) {
            self.gesture = Gesture::Rest;
            self.behind = false;
        }
    }

    fn press(&mut self, button: Button, now_s: f64, lens: Lens, around: &dyn Surroundings) {
        self.stop();
        let Some(at_px) = self.pointer.pressed(now_s) else { return };
        if button != Button::Left {
            self.pointer.forget_press();
            self.gesture = Gesture::Drag(Grab::round(self.pose, lens, at_px, around), button);
        } else if self.pointer.is_double(now_s, at_px) {
            if let Some(anchor) = Anchor::pick(self.pose, lens, at_px, around) {
                let there = Destination::nearer(&self.pose, anchor.point, DOUBLE_CLICK_SHARE, DOUBLE_CLICK_LEAST_M);
                self.fly(there.pose, now_s, around);
            }
        } else {
            self.gesture = Gesture::Drag(Grab::at(self.pose, lens, at_px, around), button);
        }
    }

    fn release(&mut self, button: Button, now_s: f64) {
        let Gesture::Drag(grab, by) = self.gesture else { return };
        if by != button {
            return;
        }
        let coast = self.coast(now_s);
        self.gesture = coast.map_or(Gesture::Rest, |coast| Gesture::Coast(grab, coast));
        self.behind = false;
    }

    /// A drag that had not caught up with its cursor stops where it is.
    fn coast(&self, now_s: f64) -> Option<Coast> {
        let from_px = self.pointer.last_px().filter(|_| !self.behind)?;
        Coast::new(from_px, self.pointer.speed_px_per_s(now_s))
    }

    fn wheel(&mut self, notches: f64, lens: Lens, around: &dyn Surroundings) {
        if !matches!(self.gesture, Gesture::Drag(..)) {
            self.gesture = Gesture::Rest;
        }
        let at_px = self.pointer.over_px().unwrap_or(lens.middle_px());
        let same = self.zoom.take().filter(|zoom| zoom.is_about(at_px));
        let mut zoom = same.unwrap_or_else(|| Zoom::about(self.pose, lens, at_px, around));
        zoom.turn(notches);
        self.zoom = Some(zoom);
    }

    fn key(&mut self, key: Held, held: bool) {
        self.walk.hold(key, held);
        let turning = matches!(self.gesture, Gesture::Drag(grab, _) if grab.leaves_the_eye());
        if held && key != Held::Fast && !turning {
            self.stop();
        }
    }

    fn fly(&mut self, to: Pose, now_s: f64, around: &dyn Surroundings) {
        self.stop();
        self.walk.stop();
        if let Some(to) = sane(to).filter(|_| now_s.is_finite()) {
            // All else has stopped: what went by before is nothing to make up for.
            self.last_s = Some(self.last_s.map_or(now_s, |last_s| last_s.max(now_s)));
            self.gesture = Gesture::Flight(Arc::new(FlyTo::new(self.pose, to, now_s, Clearance::new(around))));
        }
    }

    fn walk_on(&mut self, dt_s: f64, lens: Lens, clear: Clearance, around: &dyn Surroundings) {
        let (pose, log_height) = self.walk.step(self.pose, dt_s, clear);
        self.pose = pose;
        if log_height != 0.0 {
            let about = || Zoom::about(pose, lens, lens.middle_px(), around);
            self.zoom.get_or_insert_with(about).add(log_height);
        }
    }

    fn zoom_on(&mut self, dt_s: f64, lens: Lens, clear: Clearance) {
        if let Some(zoom) = self.zoom {
            (self.pose, self.zoom) = zoom.step(self.pose, lens, dt_s, clear);
        }
    }

    fn follow(&mut self, dt_s: f64, lens: Lens, clear: Clearance) {
        let pose = self.pose;
        match &mut self.gesture {
            Gesture::Rest => {}
            Gesture::Drag(grab, _) => {
                let Some(at_px) = self.pointer.last_px() else { return };
                let (pose, followed) = grab.follow(pose, lens, at_px, dt_s, clear);
                self.pose = pose;
                self.behind = followed == Followed::Behind;
            }
            Gesture::Coast(grab, coast) => {
                let at_px = coast.step(dt_s);
                let (pose, followed) = grab.follow(pose, lens, at_px, dt_s, clear);
                self.pose = pose;
                if followed != Followed::There || coast.has_ended() {
                    self.gesture = Gesture::Rest;
                }
            }
            Gesture::Flight(flight) => {
                // `tick` has put `last_s` to now.
                let now_s = self.last_s.unwrap_or(flight.start_s());
                self.pose = flight.pose_at(now_s);
                let lack_m = clear.lack_m(self.pose.eye);
                self.pose.eye.height_m += lack_m;
                if now_s >= flight.end_s() {
                    self.gesture = Gesture::Rest;
                }
            }
            Gesture::North(north) => {
                let (pose, ended) = north.step(pose, dt_s, clear);
                self.pose = pose;
                if ended {
                    self.gesture = Gesture::Rest;
                }
            }
        }
    }

    fn rise(&mut self, dt_s: f64, clear: Clearance) {
        let (eye, left_m) = clear.risen(self.pose.eye, dt_s);
        self.pose.eye = eye;
        self.rising = left_m > 0.0;
    }
}

/// Straight down on the whole Earth.
pub const WHOLE_EARTH: Pose =
    Pose { eye: Geodetic { lat_rad: 0.0, lon_rad: 0.0, height_m: 1.5e7 }, heading_rad: 0.0, pitch_rad: -FRAC_PI_2 };

/// The pose with its place and pitch in range; `None` where it is not finite.
fn sane(pose: Pose) -> Option<Pose> {
    is_finite(&pose).then(|| {
        let eye = Geodetic {
            lat_rad: clamped_pitch(pose.eye.lat_rad),
            lon_rad: wrapped(pose.eye.lon_rad),
            height_m: pose.eye.height_m,
        };
        Pose { eye, pitch_rad: clamped_pitch(pose.pitch_rad), ..pose }
    })
}
