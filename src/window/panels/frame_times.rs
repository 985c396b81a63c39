//! How long the last frames took.

use std::collections::VecDeque;

/// Frames remembered; older ones are forgotten.
pub const FRAMES_KEPT: usize = 1024;
/// What is called the last second.
const SECOND_MS: f64 = 1000.0;
/// What percentiles are taken over: the last seconds.
pub const WINDOW_MS: f64 = 5000.0;

/// A bounded history of the times between frames, milliseconds.
#[derive(Clone, Debug, Default)]
pub struct FrameTimes {
    /// Newest last; finite and above 0.
    kept_ms: VecDeque<f32>,
}

impl FrameTimes {
    /// From the frame before to this one. What is no time (NaN, infinite, not above 0) is left out.
    pub fn push(&mut self, frame_ms: f64) {
        let frame_ms = frame_ms as f32;
        if !frame_ms.is_finite() || frame_ms <= 0.0 {
            return;
        }
        if self.kept_ms.len() == FRAMES_KEPT {
            self.kept_ms.pop_front();
        }
        self.kept_ms.push_back(frame_ms);
    }

    /// Newest first.
    pub fn newest(&self) -> impl Iterator<Item = f32> + '_ {
        self.kept_ms.iter().rev().copied()
    }

    /// Frames per second over the last second, or over the newest frame where that took longer; `None` before the
    /// first.
    pub fn fps(&self) -> Option<f64> {
        let (frames, total_ms) = self.last(SECOND_MS);
        (frames > 0).then(|| frames as f64 / total_ms * 1000.0)
    }

    /// Of the last five seconds: a share of 0.5 gives the median, 0.99 what one frame of a hundred exceeds. The value
    /// is that of a frame (the lowest that at least this share does not exceed); `None` before the first.
    pub fn percentile_ms(&self, share: f64) -> Option<f64> {
        let (frames, _) = self.last(WINDOW_MS);
        let mut times: Vec<f32> = self.newest().take(frames).collect();
        let rank = (share.clamp(0.0, 1.0) * frames as f64).ceil() as usize;
        let at = rank.max(1).checked_sub(1).filter(|&at| at < frames)?;
        Some(f64::from(*times.select_nth_unstable_by(at, f32::total_cmp).1))
    }

    /// The newest frames that together took at most `span_ms`, but at least one: their number and time.
    fn last(&self, span_ms: f64) -> (usize, f64) {
        let (mut frames, mut total_ms) = (0, 0.0);
        for frame_ms in self.newest().map(f64::from) {
            if frames > 0 && total_ms + frame_ms > span_ms {
                break;
            }
            frames += 1;
            total_ms += frame_ms;
        }
        (frames, total_ms)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fps_are_of_the_last_second_only() {
        let mut times = FrameTimes::default();
        assert_eq!(times.fps(), None);
        for _ in 0..100 {
            times.push(100.0);
        }
        assert!((times.fps().unwrap() - 10.0).abs() < 1e-9);
        for _ in 0..50 {
            times.push(20.0);
        }
        assert!((times.fps().unwrap() - 50.0).abs() < 1e-4);
        times.push(4000.0);
        assert!((times.fps().unwrap() - 0.25).abs() < 1e-9);
    }

    #[test]
    fn percentiles_are_those_of_the_sorted_times() {
        let mut times = FrameTimes::default();
        assert_eq!(times.percentile_ms(0.5), None);
        (1..=10).rev().for_each(|ms| times.push(f64::from(ms)));
        for (share, ms) in [(0.0, 1.0), (0.5, 5.0), (0.51, 6.0), (0.99, 10.0), (1.0, 10.0), (7.0, 10.0)] {
            assert_eq!(times.percentile_ms(share), Some(ms), "{share}");
        }
        // A long frame pushes what is older than five seconds out.
        times.push(4990.0);
        assert_eq!(times.percentile_ms(0.0), Some(1.0));
        times.push(4990.0);
        assert_eq!(times.percentile_ms(0.0), Some(4990.0));
    }

    #[test]
    fn what_is_no_time_is_left_out_and_the_ring_is_bounded() {
        let mut times = FrameTimes::default();
        for no_time in [f64::NAN, f64::INFINITY, 0.0, -1.0, 1e300] {
            times.push(no_time);
        }
        assert_eq!(times.newest().count(), 0);
        (0..5000).for_each(|at| times.push(1.0 + f64::from(at)));
        assert_eq!(times.newest().count(), FRAMES_KEPT);
        assert_eq!(times.newest().next(), Some(5000.0));
    }
}
