//! Flights by hand as paths: recorded, saved, replayed.

use crate::camera::{FlightPath, Pose};

/// Poses of a recording; an hour at 60 frames a second.
const SAMPLES_MAX: usize = 60 * 60 * 60;
/// What a recording says of its frames.
const HZ: f64 = 60.0;

/// A recording under way.
#[derive(Clone, Debug)]
pub struct Recorder {
    started_s: f64,
    fov_y_rad: f64,
    samples: Vec<(f64, Pose)>,
}

impl Recorder {
    pub fn start(now_s: f64, fov_y_rad: f64) -> Self {
        Self { started_s: now_s, fov_y_rad, samples: Vec::new() }
    }

    /// Seconds since it began.
    pub fn at_s(&self, now_s: f64) -> f64 {
        now_s - self.started_s
    }

    /// Takes the pose of a frame. An eye at rest needs its first and last frame only.
    pub fn push(&mut self, now_s: f64, pose: Pose) {
        let at_s = self.at_s(now_s);
        if self.samples.last().is_some_and(|last| last.0 >= at_s) {
            return;
        }
        if let [.., (_, before), last] = &mut self.samples[..]
            && *before == pose
            && last.1 == pose
        {
            last.0 = at_s;
        } else if !self.is_full() {
            self.samples.push((at_s, pose));
        }
    }

    pub fn is_full(&self) -> bool {
        self.samples.len() >= SAMPLES_MAX
    }

    /// The flight; `None` where there was no frame.
    pub fn finish(self) -> Option<FlightPath> {
        FlightPath::new(self.fov_y_rad, HZ, self.samples)
    }
}

/// A flight that is shown instead of the controller's.
#[derive(Clone, Debug)]
pub struct Replay {
    pub path: FlightPath,
    started_s: f64,
}

impl Replay {
    pub fn start(path: FlightPath, now_s: f64) -> Self {
        Self { path, started_s: now_s }
    }

    /// Seconds since its first sample.
    pub fn at_s(&self, now_s: f64) -> f64 {
        (now_s - self.started_s).clamp(0.0, self.path.duration_s())
    }

    pub fn pose(&self, now_s: f64) -> Pose {
        self.path.at(self.path.start_s() + self.at_s(now_s))
    }

    pub fn is_over(&self, now_s: f64) -> bool {
        now_s - self.started_s > self.path.duration_s()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geodesy::Geodetic;

    fn pose(lon_deg: f64) -> Pose {
        Pose { eye: Geodetic::from_degrees(10.0, lon_deg, 1000.0), heading_rad: 0.5, pitch_rad: -0.7 }
    }

    #[test]
    fn a_replay_shows_what_was_recorded_at_the_same_times() {
        let mut recorder = Recorder::start(100.0, 1.0);
        let flown = |t_s: f64| pose(if t_s < 101.0 { 20.0 } else { 20.0 + (t_s - 101.0) });
        for frame in 0..=180 {
            let now_s = 100.0 + f64::from(frame) / 60.0;
            recorder.push(now_s, flown(now_s));
        }
        assert!(recorder.samples.len() < 125, "an eye at rest needs two samples");
        let path = recorder.finish().unwrap();
        let file = std::path::Path::new("flight.json");
        let read = FlightPath::parse(&path.to_json(), file).unwrap();
        let replay = Replay::start(read, 500.0);
        for tenth in 0..=30 {
            let t_s = f64::from(tenth) / 10.0;
            let (shown, was) = (replay.pose(500.0 + t_s), flown(100.0 + t_s));
            assert!(shown.eye.to_ecef().distance_m(was.eye.to_ecef()) < 1e-3, "{t_s}");
            assert!((shown.heading_rad - was.heading_rad).abs() < 1e-9 && !replay.is_over(500.0 + t_s));
        }
        assert!(replay.is_over(503.1) && replay.pose(510.0).eye.lon_deg() > 21.99);
    }

    #[test]
    fn a_recording_without_frames_is_none() {
        assert!(Recorder::start(0.0, 1.0).finish().is_none());
        let mut recorder = Recorder::start(0.0, 1.0);
        recorder.push(1.0, pose(1.0));
        recorder.push(1.0, pose(2.0));
        recorder.push(0.5, pose(2.0));
        assert_eq!(recorder.finish().unwrap().duration_s(), 0.0);
    }
}
