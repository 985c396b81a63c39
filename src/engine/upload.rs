//! How much of what arrived a live frame takes in: as much as fits into a share of its time, by the rate measured so far.
//! On a card uploads hardly show; a software renderer copies every byte itself.

use std::ops::RangeInclusive;

/// Decoded bytes that a live frame takes in: the least keeps pages coming on the slowest machine.
pub const UPLOAD_BYTES_PER_FRAME: RangeInclusive<u64> = 1 << 20..=16 << 20;
/// The share of a frame's time that uploads may take.
const FRAME_SHARE: f64 = 0.25;
/// Of a frame whose time is not held, milliseconds.
const FRAME_MS: f64 = 1000.0 / 60.0;
/// What is believed before any upload: so many bytes take the share of such a frame.
const PRIOR_BYTES: f64 = (4 << 20) as f64;
/// What old uploads weigh after each new one.
const FORGET: f64 = 0.9;

/// Bytes that were uploaded and the time that it took, the newest weighing most.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UploadRate {
    bytes: f64,
    took_ms: f64,
}

impl Default for UploadRate {
    fn default() -> Self {
        Self { bytes: PRIOR_BYTES, took_ms: FRAME_MS * FRAME_SHARE }
    }
}

impl UploadRate {
    /// Decoded bytes that the next frame may take in; `frame_ms` is the frame time to hold, where there is one.
    pub fn budget_bytes(&self, frame_ms: Option<f64>) -> u64 {
        let share_ms = frame_ms.unwrap_or(FRAME_MS) * FRAME_SHARE;
        let bytes = share_ms * self.bytes / self.took_ms;
        (bytes as u64).clamp(*UPLOAD_BYTES_PER_FRAME.start(), *UPLOAD_BYTES_PER_FRAME.end())
    }

    /// Learns from the uploads of a frame.
    pub fn learn(&mut self, bytes: u64, took_ms: f64) {
        if bytes > 0 && took_ms.is_finite() {
            self.bytes = self.bytes * FORGET + bytes as f64;
            self.took_ms = self.took_ms * FORGET + took_ms.max(0.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is believed after many frames that upload as much as they may, on a machine that takes `ms_per_mib`.
    fn learned(ms_per_mib: f64, frame_ms: Option<f64>) -> u64 {
        let mut rate = UploadRate::default();
        for _ in 0..200 {
            let bytes = rate.budget_bytes(frame_ms);
            rate.learn(bytes, bytes as f64 / (1u64 << 20) as f64 * ms_per_mib);
        }
        rate.budget_bytes(frame_ms)
    }

    #[test]
    fn a_frame_takes_in_what_fits_into_a_quarter_of_its_time() {
        for (ms_per_mib, frame_ms) in [(1.0, Some(33.0)), (0.5, Some(10.0)), (0.5, None)] {
            let takes_ms = learned(ms_per_mib, frame_ms) as f64 / (1u64 << 20) as f64 * ms_per_mib;
            let share_ms = frame_ms.unwrap_or(FRAME_MS) / 4.0;
            assert!((takes_ms / share_ms - 1.0).abs() < 1e-3, "{takes_ms} of {share_ms} ms");
        }
    }

    #[test]
    fn slow_machines_go_on_and_fast_ones_keep_to_a_limit() {
        assert_eq!(learned(100.0, None), 1 << 20);
        assert_eq!(learned(1e-3, None), 16 << 20);
        let mut rate = UploadRate::default();
        assert_eq!(rate.budget_bytes(None), 4 << 20);
        rate.learn(0, 50.0);
        rate.learn(1 << 20, f64::NAN);
        assert_eq!(rate, UploadRate::default(), "neither tells anything");
    }
}
