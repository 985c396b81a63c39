//! When pictures are taken, the live clock, and what a person sees of a flight in the terminal.

use crate::cli;
use std::io::{IsTerminal, Write};
use std::time::{Duration, Instant};
use stoop::record::{Distribution, FlightSummary};
use stoop::units::ByteSize;

/// The times of a flight that pictures are taken at.
#[derive(Clone, Debug)]
pub enum PictureTimes {
    Never,
    Always,
    /// Multiples of a time.
    Every {
        every_s: f64,
        next: u64,
    },
    /// Ascending.
    At {
        times_s: Vec<f64>,
        next: usize,
    },
}

impl PictureTimes {
    pub fn every(every_s: f64) -> Self {
        Self::Every { every_s, next: 0 }
    }

    pub fn at(mut times_s: Vec<f64>) -> Self {
        times_s.sort_by(f64::total_cmp);
        times_s.dedup();
        Self::At { times_s, next: 0 }
    }

    /// The time that a frame's picture stands for, if one is due: the first frame at or after a wanted time takes it
    /// (half a step of `step_s` before counts as at).
    pub fn due(&mut self, t_s: f64, step_s: f64) -> Option<f64> {
        let reached_s = t_s + step_s / 2.0;
        match self {
            Self::Never => None,
            Self::Always => Some(t_s),
            Self::Every { every_s, next } => {
                let wanted_s = *next as f64 * *every_s;
                (wanted_s < reached_s).then(|| {
                    *next = (reached_s / *every_s).ceil() as u64;
                    (*next - 1) as f64 * *every_s
                })
            }
            Self::At { times_s, next } => {
                let reached = times_s.partition_point(|&time_s| time_s < reached_s);
                let due = (reached > *next).then(|| times_s[reached - 1]);
                *next = reached.max(*next);
                due
            }
        }
    }
}

/// The real clock, less the time spent beside flying.
pub struct FlightClock {
    started: Instant,
    paused: Duration,
}

impl FlightClock {
    pub fn start() -> Self {
        Self { started: Instant::now(), paused: Duration::ZERO }
    }

    pub fn pause(&mut self, seconds: f64) {
        self.paused += Duration::from_secs_f64(seconds.max(0.0));
    }

    pub fn elapsed_s(&self) -> f64 {
        self.started.elapsed().saturating_sub(self.paused).as_secs_f64()
    }
}

/// A line in the terminal that tells how far a flight is.
pub struct Progress {
    duration_s: f64,
    shown: Option<Instant>,
    visible: bool,
}

impl Progress {
    pub fn new(duration_s: f64) -> Self {
        Self { duration_s, shown: None, visible: std::io::stderr().is_terminal() }
    }

    pub fn at(&mut self, t_s: f64) {
        let lately = self.shown.is_some_and(|shown| shown.elapsed() < Duration::from_millis(200));
        if self.visible && !lately {
            self.shown = Some(Instant::now());
            self.say(&format!("\r{t_s:7.2} s of {:.2} s", self.duration_s));
        }
    }

    pub fn end(&mut self) {
        if self.visible && self.shown.is_some() {
            self.say("\r                          \r");
        }
    }

    fn say(&self, text: &str) {
        let mut terminal = std::io::stderr();
        // A terminal that went away is no reason to end a flight.
        let _ = terminal.write_all(text.as_bytes()).and_then(|()| terminal.flush());
    }
}

/// Tells the main figures on standard output.
pub fn print_summary(summary: &FlightSummary, adapter: &str) {
    let mut text = format!(
        "{} ({}, {}×{}, tolerance {} px): {} frames over {:.2} s on {adapter}\n",
        summary.world,
        summary.mode,
        summary.size_px[0],
        summary.size_px[1],
        summary.tolerance_px,
        summary.frames,
        summary.seconds
    );
    let holes = summary.holes.map_or("not audited".to_owned(), |holes| holes.to_string());
    if let (Some(crossings), Some(seeks), Some(fallbacks)) =
        (summary.crossings, summary.crossing_seeks_max, summary.layout_fallbacks)
    {
        text += &format!(
            "layout: {crossings} crossings, at most {seeks} reads each, {fallbacks} moves left to the packs\n"
        );
    }
    text += &format!(
        "debt {:.3} px·s (peak {:.3} px), holes {holes}, would have waited {}, ground pressed {}\n",
        summary.debt_px_s, summary.debt_peak_px, summary.would_have_waited, summary.ground_pressed_frames
    );
    text += &format!(
        "read {} in {} requests, {} seeks, {} failed, {:.0} % never drawn\n",
        ByteSize(summary.bytes_read),
        summary.requests,
        summary.seeks,
        summary.failed,
        summary.waste_fraction.unwrap_or(0.0) * 100.0
    );
    text += &format!(
        "footprint {} of {}, process {}\n",
        ByteSize(summary.footprint_max_bytes),
        ByteSize(summary.footprint_limit_bytes),
        summary.peak_rss_bytes.map_or("unknown".to_owned(), |bytes| ByteSize(bytes).to_string())
    );
    text += &spread_line("frame ms", summary.frame_ms);
    text += &spread_line("triangles", summary.triangles);
    for arrival in &summary.arrivals {
        let sharp = arrival.time_to_sharp_ms.map_or("never sharp".to_owned(), |ms| format!("sharp after {ms:.0} ms"));
        text += &format!("arrival at {:.2} s: {sharp}\n", arrival.at_s);
    }
    cli::say(&text);
}

fn spread_line(name: &str, spread: Option<Distribution>) -> String {
    spread.map_or(String::new(), |spread| {
        format!("{name}: median {:.1}, p99 {:.1}, max {:.1}\n", spread.median, spread.p99, spread.max)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_wanted_time_gets_one_picture() {
        let step_s = 1.0 / 60.0;
        let taken = |mut times: PictureTimes| -> Vec<(u64, f64)> {
            (0..=180).filter_map(|frame| Some((frame, times.due(frame as f64 * step_s, step_s)?))).collect()
        };
        assert_eq!(taken(PictureTimes::at(vec![2.0, 0.0, 1.5])), [(0, 0.0), (90, 1.5), (120, 2.0)]);
        assert_eq!(taken(PictureTimes::every(1.0)), [(0, 0.0), (60, 1.0), (120, 2.0), (180, 3.0)]);
        assert_eq!(taken(PictureTimes::Always).len(), 181);
        assert!(taken(PictureTimes::Never).is_empty());
    }

    #[test]
    fn a_late_frame_takes_the_last_time_it_passed() {
        let mut times = PictureTimes::every(1.0);
        assert_eq!(times.due(0.0, 0.0), None);
        assert_eq!(times.due(2.5, 0.0), Some(2.0));
        assert_eq!(times.due(2.9, 0.0), None);
        assert_eq!(times.due(3.1, 0.0), Some(3.0));
    }
}
