//! Keeping out of the ground and of buildings.

use super::motion::{LEAST_HEIGHT_M, MAX_HEIGHT_M, gone, moved};
use super::{Obstacle, Pose, Surroundings};
use crate::geodesy::Geodetic;

/// Least height of an eye above the drawn ground, metres: below it the ground would be pressed down.
pub const EYE_OVER_GROUND_M: f64 = 2.0;
/// Least distance of an eye from walls and roofs, metres.
pub const EYE_FROM_WALLS_M: f64 = 0.5;
/// What rounding may take from either, metres.
const ROUNDING_M: f64 = 1e-6;
/// Ways are tested at points as far apart as this share of the height above the ground, but not nearer than the
/// distance kept from walls, and at no more than `MAX_SAMPLES`.
const SAMPLE_HEIGHTS: f64 = 0.04;
const MAX_SAMPLES: usize = 64;
/// How fast an eye rises to where it must be: time constant, and a speed with which it ends, metres per second.
const RISE_S: f64 = 0.12;
const RISE_M_PER_S: f64 = 0.5;
/// Angles from the wanted way at which a way along a wall is looked for, degrees.
const SLIDES_DEG: [f64; 5] = [15.0, 30.0, 50.0, 70.0, 88.0];

impl Obstacle {
    fn holds(&self, height_m: f64) -> bool {
        height_m > self.base_m - EYE_FROM_WALLS_M && height_m < self.top_m + EYE_FROM_WALLS_M - ROUNDING_M
    }
}

/// Where an eye may be.
#[derive(Clone, Copy)]
pub(super) struct Clearance<'a> {
    around: &'a dyn Surroundings,
}

impl<'a> Clearance<'a> {
    pub(super) fn new(around: &'a dyn Surroundings) -> Self {
        Self { around }
    }

    /// The drawn ground below a place, metres; where none is drawn, the ellipsoid.
    pub(super) fn ground_m(&self, place: Geodetic) -> f64 {
        self.known_ground_m(place).unwrap_or(0.0)
    }

    fn known_ground_m(&self, place: Geodetic) -> Option<f64> {
        self.around.ground_m(place.lat_rad, place.lon_rad).filter(|ground_m| ground_m.is_finite())
    }

    /// Height above the ground by which speeds go, metres.
    pub(super) fn height_m(&self, place: Geodetic) -> f64 {
        (place.height_m - self.ground_m(place)).max(LEAST_HEIGHT_M)
    }

    /// The top of the ground or of what stands there, metres.
    pub(super) fn top_m(&self, place: Geodetic) -> f64 {
        let roof_m = self.obstacle(place).map_or(f64::NEG_INFINITY, |obstacle| obstacle.top_m);
        self.ground_m(place).max(roof_m)
    }

    fn obstacle(&self, place: Geodetic) -> Option<Obstacle> {
        self.around
            .obstacle(place.lat_rad, place.lon_rad, EYE_FROM_WALLS_M)
            .filter(|obstacle| obstacle.base_m.is_finite() && obstacle.top_m.is_finite())
    }

    /// The least height at a place that is no lower than its own and above the ground.
    fn over_ground(&self, place: Geodetic) -> Geodetic {
        let least_m = self.known_ground_m(place).map_or(f64::NEG_INFINITY, |ground_m| ground_m + EYE_OVER_GROUND_M);
        place.at_height(place.height_m.max(least_m))
    }

    /// How far an eye would have to rise to be clear, metres; 0 where it is.
    pub(super) fn lack_m(&self, place: Geodetic) -> f64 {
        let over = self.over_ground(place);
        let clear_m = match self.obstacle(place) {
            Some(obstacle) if obstacle.holds(over.height_m) => obstacle.top_m + EYE_FROM_WALLS_M,
            _ => over.height_m,
        };
        let lack_m = clear_m - place.height_m;
        if lack_m <= ROUNDING_M { 0.0 } else { lack_m }
    }

    /// The eye after `dt_s` of rising to where it must be, and what is left, metres: finer ground or a building may
    /// arrive round a resting eye.
    pub(super) fn risen(&self, eye: Geodetic, dt_s: f64) -> (Geodetic, f64) {
        let lack_m = self.lack_m(eye);
        if lack_m == 0.0 {
            return (eye, 0.0);
        }
        let rise_m = (lack_m * gone(dt_s, RISE_S) + RISE_M_PER_S * dt_s).min(lack_m);
        (eye.at_height(eye.height_m + rise_m), lack_m - rise_m)
    }

    fn samples(&self, eye: Geodetic, length_m: f64) -> usize {
        let apart_m = (SAMPLE_HEIGHTS * self.height_m(eye)).max(EYE_FROM_WALLS_M);
        ((length_m / apart_m).ceil().max(1.0) as usize).min(MAX_SAMPLES)
    }

    /// The furthest share of a way, 0 to 1, that is clear; `way` gives the pose at a share. An eye that is not clear at
    /// its start may go where it is no deeper.
    pub(super) fn clear_share(&self, length_m: f64, way: impl Fn(f64) -> Pose) -> f64 {
        const HALVINGS: usize = 12;
        let start = way(0.0).eye;
        let allowed_m = self.lack_m(start);
        let clear = |share: f64| self.lack_m(way(share).eye) <= allowed_m;
        let samples = self.samples(start, length_m);
        let shares = (1..=samples).map(|at| at as f64 / samples as f64);
        let Some(blocked) = shares.clone().find(|&share| !clear(share)) else {
            return 1.0;
        };
        let (mut low, mut high) = (blocked - 1.0 / samples as f64, blocked);
        for _ in 0..HALVINGS {
            let middle = (low + high) / 2.0;
            if clear(middle) {
                low = middle;
            } else {
                high = middle;
            }
        }
        low
    }

    /// A way on foot or in flight: over the ground and over roofs where it comes from above, along walls where it comes
    /// from the side.
    pub(super) fn walked(&self, pose: Pose, east_m: f64, north_m: f64, up_m: f64) -> Pose {
        let length_m = east_m.hypot(north_m);
        let samples = self.samples(pose.eye, length_m.max(up_m.abs()));
        let part = 1.0 / samples as f64;
        let (east_m, north_m, up_m) = (east_m * part, north_m * part, up_m * part);
        // A departure for each part: north turns on the way, the heading with it.
        let turn_rad = east_m.atan2(north_m) - pose.heading_rad;
        let mut at = pose;
        for _ in 0..samples {
            let (sin_d, cos_d) = (turn_rad + at.heading_rad).sin_cos();
            at = self.part_walked(at, [sin_d, cos_d].map(|share| share * length_m * part), up_m);
        }
        at
    }

    fn part_walked(&self, pose: Pose, [east_m, north_m]: [f64; 2], up_m: f64) -> Pose {
        let allowed_m = self.lack_m(pose.eye);
        let clear = |to: &Pose| self.lack_m(to.eye) <= allowed_m;
        let straight = self.beside(pose, moved(pose, east_m, north_m), up_m);
        if clear(&straight) {
            return straight;
        }
        for degrees in SLIDES_DEG {
            for (sin_a, cos_a) in [degrees.to_radians().sin_cos(), (-degrees.to_radians()).sin_cos()] {
                let (east_m, north_m) = (east_m * cos_a + north_m * sin_a, north_m * cos_a - east_m * sin_a);
                let along = self.beside(pose, moved(pose, east_m * cos_a, north_m * cos_a), up_m);
                if clear(&along) {
                    return along;
                }
            }
        }
        let vertical = self.beside(pose, pose, up_m);
        if clear(&vertical) { vertical } else { pose }
    }

    /// `to`, higher by `up_m`, but over the ground, and over the roof or under the base of an obstacle that `from` was
    /// over or under.
    fn beside(&self, from: Pose, to: Pose, up_m: f64) -> Pose {
        let height_m = (to.eye.height_m + up_m).min(MAX_HEIGHT_M.max(from.eye.height_m));
        let eye = self.over_ground(to.eye.at_height(height_m));
        let Some(obstacle) = self.obstacle(eye).filter(|obstacle| obstacle.holds(eye.height_m)) else {
            return Pose { eye, ..to };
        };
        let (over_m, under_m) = (obstacle.top_m + EYE_FROM_WALLS_M, obstacle.base_m - EYE_FROM_WALLS_M);
        let height_m = match from.eye.height_m {
            was_m if was_m >= over_m - ROUNDING_M => over_m,
            was_m if was_m <= under_m => under_m,
            _ => eye.height_m,
        };
        Pose { eye: eye.at_height(height_m), ..to }
    }
}
