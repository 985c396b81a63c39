//! Flights to a place: along the geodesic, by the arc of van Wijk and Nuij, over what stands in the way.

use super::Pose;
use super::arc::Arc;
use super::clearance::{Clearance, EYE_OVER_GROUND_M};
use super::motion::{LEAST_HEIGHT_M, MAX_HEIGHT_M, looking_at, mix, mix_angle, smoothstep, wrapped};
use crate::geodesy::{Course, Ecef, Geodetic, Point};
use glam::DVec3;
use std::f64::consts::{FRAC_PI_2, PI};

/// Speed along the arc, in the paper's metric per second.
const SPEED: f64 = 1.4;
const SHORTEST_S: f64 = 1.5;
const LONGEST_S: f64 = 8.0;
/// Places on the way where the ground is asked for.
const STATIONS: usize = 128;
/// A lift over the ground spreads over as many stations to both sides.
const SPREAD: usize = 12;
/// Height over the ground on the way, metres; less where the arc itself is lower than twice this.
const CLEARANCE_M: f64 = 30.0;
/// Beyond this latitude a compass heading says little, and flights keep the picture from spinning instead.
const POLAR_RAD: f64 = 85.0 / 180.0 * PI;

/// Where a flight goes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Destination {
    pub pose: Pose,
}

impl Destination {
    pub fn new(pose: Pose) -> Self {
        Self { pose }
    }

    /// With `place` in the middle of the picture, `distance_m` away, seen in the direction `heading_rad` and down by
    /// `-pitch_rad` (−π/2 to 0, over the horizon of the place).
    pub fn looking_at(place: Geodetic, distance_m: f64, heading_rad: f64, pitch_rad: f64) -> Self {
        let elevation_rad = (-pitch_rad).clamp(0.0, FRAC_PI_2);
        let back_rad = heading_rad + PI;
        let ((sin_a, cos_a), (sin_e, cos_e)) = (back_rad.sin_cos(), elevation_rad.sin_cos());
        let out = DVec3::new(sin_a * cos_e, cos_a * cos_e, sin_e) * distance_m;
        let eye = Geodetic::from_ecef(place.ecef_from_enu() * Point::new(out));
        Self { pose: looking_at(eye, place.to_ecef(), heading_rad) }
    }

    /// Nearer to a point that is seen: at `share` of the distance, but no nearer than `least_m`, with the pitch in
    /// −90° to −30° and the heading kept.
    pub(super) fn nearer(pose: &Pose, point: Point<Ecef>, share: f64, least_m: f64) -> Self {
        let place = Geodetic::from_ecef(point);
        let distance_m = (pose.eye.to_ecef().distance_m(point) * share).max(least_m);
        let polar = pose.eye.lat_rad.abs().max(place.lat_rad.abs()) > POLAR_RAD;
        let course = Course::between(pose.eye, place);
        let turn_rad = if polar { course.arrival_rad - course.departure_rad } else { 0.0 };
        let pitch_rad = pose.pitch_rad.clamp(-FRAC_PI_2, -PI / 6.0);
        Self::looking_at(place, distance_m, wrapped(pose.heading_rad + turn_rad), pitch_rad)
    }
}

/// A flight under way. Its path is known from its start; only stalls of the clock put it off.
#[derive(Clone, Debug, PartialEq)]
pub struct FlyTo {
    from: Pose,
    to: Pose,
    course: Course,
    arc: Arc,
    /// Ground at the start and at the end that the arc stands on, metres.
    bases_m: [f64; 2],
    /// What each station must be raised by for the ground to be cleared, metres; 0 at both ends.
    lifts_m: Vec<f64>,
    start_s: f64,
    duration_s: f64,
}

impl FlyTo {
    pub(super) fn new(from: Pose, to: Pose, start_s: f64, clear: Clearance) -> Self {
        let course = Course::between(from.eye, to.eye);
        let bases_m = [from, to].map(|pose| clear.ground_m(pose.eye).min(pose.eye.height_m - LEAST_HEIGHT_M));
        let heights_m = [from.eye.height_m - bases_m[0], to.eye.height_m - bases_m[1]];
        let arc = Arc::new(course.distance_m, heights_m);
        let duration_s = (arc.length() / SPEED).clamp(SHORTEST_S, LONGEST_S);
        let mut flight = Self { from, to, course, arc, bases_m, lifts_m: Vec::new(), start_s, duration_s };
        flight.lifts_m = spread(&flight.lacks_m(clear));
        flight
    }

    pub fn start_s(&self) -> f64 {
        self.start_s
    }

    pub fn end_s(&self) -> f64 {
        self.start_s + self.duration_s
    }

    /// The pose at a time on the clock of [`super::Navigator::step`]: before the start the first, from the end on the
    /// destination, exactly.
    pub fn pose_at(&self, t_s: f64) -> Pose {
        if t_s >= self.end_s() {
            return self.to;
        }
        let share = smoothstep((t_s - self.start_s) / self.duration_s);
        if share <= 0.0 { self.from } else { self.at(share) }
    }

    /// Puts the rest of the flight off.
    pub(super) fn delay(&mut self, by_s: f64) {
        self.start_s += by_s;
    }

    fn at(&self, share: f64) -> Pose {
        let (eye, azimuth_rad, _) = self.on_arc(share);
        let height_m = eye.height_m + self.lift_m(share);
        let relative = |heading_rad: f64, course_rad: f64| wrapped(heading_rad - course_rad);
        let off_rad = mix_angle(
            relative(self.from.heading_rad, self.course.departure_rad),
            relative(self.to.heading_rad, self.course.arrival_rad),
            share,
        );
        Pose {
            eye: eye.at_height(height_m.min(MAX_HEIGHT_M.max(self.from.eye.height_m).max(self.to.eye.height_m))),
            heading_rad: wrapped(azimuth_rad + off_rad),
            pitch_rad: mix(self.from.pitch_rad, self.to.pitch_rad, share),
        }
    }

    /// The eye without lift, the direction of the geodesic, and the height over the arc's base.
    fn on_arc(&self, share: f64) -> (Geodetic, f64, f64) {
        let (way_m, height_m) = self.arc.at(share);
        let part = if self.course.distance_m > 0.0 { (way_m / self.course.distance_m).clamp(0.0, 1.0) } else { share };
        let (place, azimuth_rad) = self.from.eye.travel(self.course.departure_rad, way_m);
        (place.at_height(mix(self.bases_m[0], self.bases_m[1], part) + height_m), azimuth_rad, height_m)
    }

    /// How far the arc is too low at each station, metres.
    fn lacks_m(&self, clear: Clearance) -> Vec<f64> {
        let lack_m = |station: usize| {
            let (eye, _, height_m) = self.on_arc(station as f64 / STATIONS as f64);
            let over_m = CLEARANCE_M.min(height_m / 2.0).max(EYE_OVER_GROUND_M);
            (clear.top_m(eye) + over_m - eye.height_m).max(0.0)
        };
        (0..=STATIONS).map(|station| if station % STATIONS == 0 { 0.0 } else { lack_m(station) }).collect()
    }

    fn lift_m(&self, share: f64) -> f64 {
        let at = share * STATIONS as f64;
        let station = (at.floor() as usize).min(STATIONS - 1);
        mix(self.lifts_m[station], self.lifts_m[station + 1], smoothstep(at - station as f64))
    }
}

/// A smoother function that is nowhere less than the given one and the same at both ends: the maximum over a window that
/// narrows towards the ends, then the mean over half of it, through which every maximum reaches its own place.
fn spread(lacks_m: &[f64]) -> Vec<f64> {
    let last = lacks_m.len() - 1;
    let reach = |at: usize| SPREAD.min(at).min(last - at);
    let window = |at: usize, reach: usize| at - reach..=at + reach;
    let highest: Vec<f64> =
        (0..=last).map(|at| lacks_m[window(at, reach(at))].iter().copied().fold(0.0, f64::max)).collect();
    let mean = |part: &[f64]| part.iter().sum::<f64>() / part.len() as f64;
    (0..=last).map(|at| mean(&highest[window(at, reach(at) / 2)])).collect()
}

#[cfg(test)]
mod tests {
    use super::super::View;
    use super::super::hold::elevation_over;
    use super::*;

    #[test]
    fn a_spread_lift_covers_what_it_is_for() {
        for peak in [1, 2, 5, 40, 126, 127] {
            let mut lacks_m = vec![0.0; STATIONS + 1];
            lacks_m[peak] = 100.0;
            lacks_m[64] = 30.0;
            let lifts_m = spread(&lacks_m);
            assert!(lifts_m.iter().zip(&lacks_m).all(|(lift, lack)| lift >= lack), "{peak}: {lifts_m:?}");
            assert_eq!((lifts_m[0], lifts_m[STATIONS]), (0.0, 0.0));
        }
    }

    #[test]
    fn a_destination_looks_at_its_place() {
        let place = Geodetic::from_degrees(60.0, 25.0, 20.0);
        for (distance_m, pitch_deg) in [(60.0, -30.0), (1e6, -90.0), (2e5, -45.0_f64)] {
            let pose = Destination::looking_at(place, distance_m, 0.7, pitch_deg.to_radians()).pose;
            assert!((pose.eye.to_ecef().distance_m(place.to_ecef()) - distance_m).abs() < 1e-6);
            assert!((elevation_over(&pose, place.to_ecef()) + pitch_deg.to_radians()).abs() < 1e-6);
            let seen = View::new(pose, 1.0, [640, 360]).project_px(place.to_ecef()).unwrap();
            assert!((seen[0] - 320.0).hypot(seen[1] - 180.0) < 1e-3, "{seen:?}");
        }
    }
}
