//! Flights to places that were typed: where the eye goes, over ground that may be known only coarsely from afar.

use super::panels::Place;
use crate::camera::Destination;
use crate::geodesy::Geodetic;
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};

/// From how high a place that was typed is looked at, metres, and how steeply; from above the last height straight down.
const TYPED_DISTANCE_M: f64 = 1000.0;
const TYPED_PITCH_RAD: f64 = -FRAC_PI_4;
const STRAIGHT_DOWN_M: f64 = 100_000.0;
/// What the ground may differ from what a flight counted with, over the height above it.
const AIM_SLACK: f64 = 0.02;

/// A place that was typed, and what ground its flight counted with.
#[derive(Clone, Copy, Debug)]
pub struct Aim {
    pub place: Place,
    pub ground_m: f64,
}

impl Aim {
    fn distance_m(&self) -> f64 {
        self.place.above_ground_m.unwrap_or(TYPED_DISTANCE_M)
    }

    /// Whether the ground turned out to lie elsewhere, so far that the height over it is not the one asked for.
    pub fn is_off(&self, ground_m: f64) -> bool {
        (ground_m - self.ground_m).abs() > AIM_SLACK * self.distance_m()
    }

    /// Looking at the place from the south of the heading; from far above straight down.
    pub fn destination(&self, heading_rad: f64) -> Destination {
        let target = Geodetic { lat_rad: self.place.lat_rad, lon_rad: self.place.lon_rad, height_m: self.ground_m };
        let height_m = self.distance_m();
        if height_m > STRAIGHT_DOWN_M {
            return Destination::looking_at(target, height_m, heading_rad, -FRAC_PI_2);
        }
        Destination::looking_at(target, height_m / -TYPED_PITCH_RAD.sin(), heading_rad, TYPED_PITCH_RAD)
    }
}
