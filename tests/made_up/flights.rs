//! Flights for virtual runs: dives, random ways, and ends at rest.

use super::random::unit;
use std::sync::Arc;
use stoop::camera::{FlightPath, Pose};
use stoop::geodesy::Geodetic;

pub fn pose(lat_deg: f64, lon_deg: f64, height_m: f64, heading_deg: f64, pitch_deg: f64) -> Pose {
    let eye = Geodetic::from_degrees(lat_deg, lon_deg, height_m);
    Pose { eye, heading_rad: heading_deg.to_radians(), pitch_rad: pitch_deg.to_radians() }
}

/// A flight over poses at seconds from 0 on; 60 frames a second.
pub fn path(poses: impl IntoIterator<Item = (f64, Pose)>) -> Arc<FlightPath> {
    Arc::new(FlightPath::new(60f64.to_radians(), 60.0, poses).unwrap())
}

/// A dive from one height to another, by equal shares of the height in equal times.
pub fn dive(lat_deg: f64, lon_deg: f64, heights_m: [f64; 2], pitch_deg: f64, duration_s: f64) -> Arc<FlightPath> {
    let steps = (60.0 * duration_s) as u32;
    let height_m = |share: f64| heights_m[0] * (heights_m[1] / heights_m[0]).powf(share);
    path((0..=steps).map(|step| {
        let share = f64::from(step) / f64::from(steps);
        (share * duration_s, pose(lat_deg, lon_deg, height_m(share), 0.0, pitch_deg))
    }))
}

/// A way through random places near one, at heights from 300 m to 3,000 km: from stop to stop by equal shares of the
/// height, slow at both ends.
pub fn wander(seed: u64, lat_deg: f64, lon_deg: f64, duration_s: f64) -> Arc<FlightPath> {
    const LEGS: u64 = 4;
    const STEPS: u64 = 30;
    let stop = |stop: u64| {
        let random = |draw: u64| unit(seed, stop * 8 + draw);
        let log_height = 300f64.ln() + 1e4f64.ln() * random(0);
        let off_deg = (log_height.exp() / 111e3).min(5.0);
        let (north_deg, east_deg) = (off_deg * (random(1) - 0.5), off_deg * (random(2) - 0.5));
        [lat_deg + north_deg, lon_deg + east_deg, log_height, 360.0 * random(3), -90.0 * random(4)]
    };
    path((0..=LEGS * STEPS).map(|step| {
        let (from, to) = (stop(step / STEPS), stop(step / STEPS + 1));
        let way = (step % STEPS) as f64 / STEPS as f64;
        let share = way * way * (3.0 - 2.0 * way);
        let [lat_deg, lon_deg, log_height, heading_deg, pitch_deg] =
            std::array::from_fn(|at| from[at] + share * (to[at] - from[at]));
        let pose = pose(lat_deg, lon_deg, log_height.exp(), heading_deg, pitch_deg);
        (duration_s * step as f64 / (LEGS * STEPS) as f64, pose)
    }))
}
