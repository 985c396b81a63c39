//! A flight's log and its summary: `frames.csv`, `timings.csv` and `report.json`.

use super::Distribution;
use crate::engine::{FrameReport, FrameTimings};
use crate::layout::RideCounts;
use crate::store::write_whole;
use serde::Serialize;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Beside the report: what each frame did.
pub const FRAMES_FILE: &str = "frames.csv";
/// Beside the report: how long each frame took on this machine.
pub const TIMINGS_FILE: &str = "timings.csv";
/// A frame is sharp once this share of the screen has no excess.
pub const SHARP_COVERAGE: f64 = 0.99;

#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    #[error("cannot write {file}: {source}; check the folder, its rights and the room on the disk")]
    Write { file: PathBuf, source: std::io::Error },
    #[error("cannot encode {file}: {cause}; check the room on the disk")]
    Encode { file: PathBuf, cause: String },
    #[error("cannot start ffmpeg for {file}: {source}; install the program ffmpeg, or leave --video away")]
    NoFfmpeg { file: PathBuf, source: std::io::Error },
    #[error("ffmpeg gave up on {file}: {cause}; choose a name that ends in .mp4, .webm or .mkv and a folder with room")]
    Ffmpeg { file: PathBuf, cause: String },
}

/// What a flight was, apart from its frames.
#[derive(Clone, Debug, Default)]
pub struct FlightHeader {
    pub world: String,
    /// "lockstep", "settled", "live", or "virtual" with the storage model.
    pub mode: String,
    pub policy: String,
    pub size_px: [u32; 2],
    pub tolerance_px: f64,
    pub footprint_limit_bytes: u64,
    /// Times of arrival, seconds of the flight.
    pub arrivals_s: Vec<f64>,
}

impl FlightHeader {
    /// Whether the flight followed a virtual clock.
    pub fn is_virtual(&self) -> bool {
        self.mode.starts_with("virtual")
    }
}

/// One arrival at a place.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Arrival {
    pub at_s: f64,
    /// Share of the screen without excess when the eye arrived.
    pub coverage: Option<f64>,
    /// From the arrival to the first sharp frame; null where the flight ended before.
    pub time_to_sharp_ms: Option<f64>,
}

/// `report.json`; keys that stand for later parts or were not measured are null.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FlightSummary {
    pub world: String,
    pub mode: String,
    pub policy: String,
    pub size_px: [u32; 2],
    pub tolerance_px: f64,
    pub frames: u64,
    pub seconds: f64,
    pub first_frame_ms: Option<f64>,
    pub frame_ms: Option<Distribution>,
    pub cpu_ms: Option<Distribution>,
    pub triangles: Option<Distribution>,
    pub debt_px: Option<Distribution>,
    pub debt_px_s: f64,
    pub debt_bound_px_s: Option<f64>,
    pub excess_px: Option<Distribution>,
    pub raw_error_px: Option<Distribution>,
    pub holes: Option<u64>,
    pub ground_pressed_frames: u64,
    pub would_have_waited: u64,
    pub bytes_read: u64,
    pub seeks: u64,
    pub requests: u64,
    pub cancelled: u64,
    pub failed: u64,
    pub crossings: Option<u64>,
    pub crossing_seeks_max: Option<u64>,
    pub layout_fallbacks: Option<u64>,
    pub footprint_limit_bytes: u64,
    pub footprint_max_bytes: u64,
    pub peak_rss_bytes: Option<u64>,
    pub waste_fraction: Option<f64>,
    pub arrivals: Vec<Arrival>,
    pub per_frame: String,
    pub timings: String,
    pub debt_peak_px: f64,
    pub tolerance_drawn_max_px: f64,
    pub audited_frames: u64,
    /// Holes and pixels by which silhouettes moved, together.
    pub uncovered_px: Option<u64>,
    pub evicted: u64,
    pub level_switches: u64,
    /// Stored bytes asked for: of pages that the frame lacked already, and of those fetched ahead.
    pub front_bytes: u64,
    pub ahead_bytes: u64,
    /// Times that frames waited for their pages, by the virtual or the real clock, seconds; null where none did.
    pub waited_s: Option<Distribution>,
    /// Over-modelling over the frames in which it was measured: triangles drawn over those needed in view and over those of
    /// the needed reps as wholes, stored bytes held over needed, and the ground's needed triangles over those of one cut
    /// over the whole view, all without occlusion; and drawn and held over what of the needed shows.
    pub drawn_over_needed: Option<Distribution>,
    pub drawn_over_front: Option<Distribution>,
    pub resident_over_needed: Option<Distribution>,
    pub needed_over_view_cut: Option<Distribution>,
    pub drawn_over_seen: Option<Distribution>,
    pub resident_over_seen: Option<Distribution>,
}

/// The frames of a flight.
#[derive(Clone, Debug, Default)]
pub struct FlightLog {
    pub header: FlightHeader,
    pub frames: Vec<FrameReport>,
    /// Bytes read and never drawn by the end.
    pub wasted_bytes: u64,
    /// From the opening of the world to the first picture, milliseconds.
    pub first_frame_ms: Option<f64>,
    /// Along the layout that was flown by.
    pub ride: Option<RideCounts>,
}

impl FlightLog {
    pub fn new(header: FlightHeader) -> Self {
        Self { header, ..Self::default() }
    }

    pub fn summary(&self) -> FlightSummary {
        let (header, frames) = (&self.header, &self.frames);
        let spread = |figure: fn(&FrameReport) -> f64| Distribution::of(frames.iter().map(figure));
        // A virtual clock tells nothing of this machine.
        let measured = |figure: fn(&FrameReport) -> f64| spread(figure).filter(|_| !header.is_virtual());
        let modelled = |figure: fn(&FrameReport) -> Option<f64>| Distribution::of(frames.iter().filter_map(figure));
        let total = |figure: fn(&FrameReport) -> u64| frames.iter().map(figure).sum::<u64>();
        let highest = |figure: fn(&FrameReport) -> f64| frames.iter().map(figure).fold(0.0, f64::max);
        let bytes_read = total(|frame| frame.bytes_read);
        let audited: Vec<u64> = frames.iter().filter_map(|frame| frame.holes).collect();
        FlightSummary {
            world: header.world.clone(),
            mode: header.mode.clone(),
            policy: header.policy.clone(),
            size_px: header.size_px,
            tolerance_px: header.tolerance_px,
            frames: frames.len() as u64,
            seconds: self.seconds(),
            first_frame_ms: self.first_frame_ms,
            frame_ms: measured(|frame| frame.timings.frame_ms),
            cpu_ms: measured(|frame| frame.timings.cpu_ms()),
            triangles: spread(|frame| frame.triangles as f64),
            debt_px: spread(|frame| frame.debt_px),
            debt_px_s: self.integral(|frame| Some(frame.debt_px)).unwrap_or(0.0),
            debt_bound_px_s: self.integral(|frame| frame.debt_bound_px),
            excess_px: spread(|frame| frame.excess_max_px),
            raw_error_px: spread(|frame| frame.raw_error_px),
            holes: (!audited.is_empty()).then(|| audited.iter().sum()),
            ground_pressed_frames: total(|frame| u64::from(frame.ground_pressed)),
            would_have_waited: total(|frame| u64::from(frame.would_have_waited)),
            bytes_read,
            seeks: total(|frame| frame.seeks),
            requests: total(|frame| frame.requests),
            cancelled: total(|frame| frame.cancelled),
            failed: total(|frame| frame.failed),
            crossings: self.ride.map(|ride| ride.crossings),
            crossing_seeks_max: self.ride.map(|ride| ride.crossing_seeks_max),
            layout_fallbacks: self.ride.map(|ride| ride.fallbacks),
            footprint_limit_bytes: header.footprint_limit_bytes,
            footprint_max_bytes: frames.iter().map(|frame| frame.footprint_bytes).max().unwrap_or(0),
            peak_rss_bytes: super::peak_rss_bytes().filter(|_| !header.is_virtual()),
            waste_fraction: (bytes_read > 0).then(|| self.wasted_bytes as f64 / bytes_read as f64),
            arrivals: header.arrivals_s.iter().map(|&at_s| self.arrival(at_s)).collect(),
            per_frame: FRAMES_FILE.to_owned(),
            timings: TIMINGS_FILE.to_owned(),
            debt_peak_px: highest(|frame| frame.debt_px),
            tolerance_drawn_max_px: highest(|frame| frame.tolerance_drawn_px),
            audited_frames: audited.len() as u64,
            uncovered_px: (!audited.is_empty()).then(|| total(|frame| frame.uncovered_px.unwrap_or(0))),
            evicted: total(|frame| frame.evicted),
            level_switches: total(|frame| u64::from(frame.level_switches)),
            front_bytes: total(|frame| frame.front_bytes),
            ahead_bytes: total(|frame| frame.ahead_bytes),
            waited_s: spread(|frame| frame.waited_s).filter(|waits| waits.max > 0.0),
            drawn_over_needed: modelled(FrameReport::drawn_over_needed),
            drawn_over_front: modelled(FrameReport::drawn_over_front),
            resident_over_needed: modelled(FrameReport::resident_over_needed),
            needed_over_view_cut: modelled(FrameReport::needed_over_view_cut),
            drawn_over_seen: modelled(FrameReport::drawn_over_seen),
            resident_over_seen: modelled(FrameReport::resident_over_seen),
        }
    }

    fn seconds(&self) -> f64 {
        match (self.frames.first(), self.frames.last()) {
            (Some(first), Some(last)) => last.t_s - first.t_s,
            _ => 0.0,
        }
    }

    /// Each frame's figure stands until the next frame shows, which is when it has waited; `None` where a frame has none.
    fn integral(&self, figure: impl Fn(&FrameReport) -> Option<f64>) -> Option<f64> {
        let shown_s = |frame: &FrameReport| frame.t_s + frame.waited_s;
        self.frames.windows(2).map(|pair| Some(figure(&pair[0])? * (shown_s(&pair[1]) - shown_s(&pair[0])))).sum()
    }

    fn arrival(&self, at_s: f64) -> Arrival {
        // A frame's time may miss the arrival by a rounding error.
        let after = self.frames.partition_point(|frame| frame.t_s < at_s - 1e-6);
        let later = &self.frames[after..];
        let sharp = later.iter().find(|frame| frame.coverage >= SHARP_COVERAGE);
        Arrival {
            at_s,
            coverage: later.first().map(|frame| frame.coverage),
            time_to_sharp_ms: sharp.map(|frame| (frame.t_s + frame.waited_s - at_s).max(0.0) * 1000.0),
        }
    }

    /// Writes the report to `file`, and frames and timings beside it. Each file appears whole or not at all.
    pub fn write(&self, file: &Path) -> Result<(), RecordError> {
        let folder = file.parent().unwrap_or(Path::new("."));
        write_file(&folder.join(FRAMES_FILE), self.frames_csv())?;
        write_file(&folder.join(TIMINGS_FILE), self.timings_csv())?;
        let mut text = to_json(file, &self.summary())?;
        text.push('\n');
        write_file(file, &text)
    }

    /// A header of names, then a line for each frame.
    pub fn frames_csv(&self) -> String {
        csv(self.frames.iter())
    }

    pub fn timings_csv(&self) -> String {
        #[derive(Serialize)]
        struct Row {
            frame: u64,
            t_s: f64,
            #[serde(flatten)]
            timings: FrameTimings,
        }
        csv(self.frames.iter().map(|frame| Row { frame: frame.frame, t_s: frame.t_s, timings: frame.timings }))
    }
}

fn to_json(file: &Path, value: &impl Serialize) -> Result<String, RecordError> {
    serde_json::to_string_pretty(value)
        .map_err(|error| RecordError::Encode { file: file.to_owned(), cause: error.to_string() })
}

/// Rows whose values are numbers, truth values or nothing, which need no quotes.
fn csv(rows: impl Iterator<Item = impl Serialize>) -> String {
    let mut text = String::new();
    for row in rows {
        let Ok(serde_json::Value::Object(columns)) = serde_json::to_value(row) else { continue };
        if text.is_empty() {
            text.push_str(&columns.keys().cloned().collect::<Vec<_>>().join(","));
            text.push('\n');
        }
        let cells: Vec<String> = columns.values().map(cell).collect();
        text.push_str(&cells.join(","));
        text.push('\n');
    }
    text
}

fn cell(value: &serde_json::Value) -> String {
    match value {
        serde_json::Value::Null => String::new(),
        serde_json::Value::Bool(truth) => u8::from(*truth).to_string(),
        other => other.to_string(),
    }
}

/// All of a file at once, under its name once it is whole.
pub(super) fn write_file(file: &Path, contents: impl AsRef<[u8]>) -> Result<(), RecordError> {
    write_whole(file, |out| out.write_all(contents.as_ref()))
        .map_err(|source: std::io::Error| RecordError::Write { file: file.to_owned(), source })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(t_s: f64, debt_px: f64, coverage: f64) -> FrameReport {
        FrameReport { t_s, debt_px, coverage, bytes_read: 10, ..FrameReport::default() }
    }

    fn log() -> FlightLog {
        let header = FlightHeader { arrivals_s: vec![0.5, 1.5], ..FlightHeader::default() };
        let frames = vec![frame(0.0, 2.0, 0.1), frame(0.5, 1.0, 0.5), frame(1.0, 0.0, 1.0), frame(1.5, 0.5, 0.9)];
        FlightLog { frames, wasted_bytes: 10, ..FlightLog::new(header) }
    }

    #[test]
    fn summarizes_debt_waste_and_arrivals() {
        let summary = log().summary();
        assert_eq!(summary.debt_px_s, 1.5);
        assert_eq!((summary.seconds, summary.waste_fraction, summary.holes), (1.5, Some(0.25), None));
        let [first, second] = summary.arrivals[..] else { panic!("two arrivals") };
        assert_eq!((first.coverage, first.time_to_sharp_ms), (Some(0.5), Some(500.0)));
        assert_eq!((second.coverage, second.time_to_sharp_ms), (Some(0.9), None));
    }

    #[test]
    fn a_report_has_every_promised_key_even_without_a_frame() {
        let json = serde_json::to_value(FlightLog::default().summary()).unwrap();
        for key in "world mode policy size_px tolerance_px frames seconds first_frame_ms frame_ms cpu_ms triangles \
                    debt_px debt_px_s debt_bound_px_s excess_px raw_error_px holes ground_pressed_frames \
                    would_have_waited bytes_read seeks requests cancelled failed crossings crossing_seeks_max \
                    layout_fallbacks footprint_limit_bytes footprint_max_bytes peak_rss_bytes waste_fraction \
                    arrivals per_frame"
            .split_whitespace()
        {
            assert!(json.get(key).is_some(), "{key}");
        }
    }

    #[test]
    fn rows_have_the_columns_of_the_header() {
        let text = log().frames_csv();
        let mut lines = text.lines().map(|line| line.split(',').count());
        let columns = lines.next().unwrap();
        assert!(lines.all(|count| count == columns));
        assert_eq!(text.lines().count(), 5);
        assert!(log().timings_csv().starts_with("frame,t_s,frame_ms,"));
    }

    #[test]
    fn files_appear_whole() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("report.json");
        log().write(&file).unwrap();
        let mut names: Vec<_> = std::fs::read_dir(&folder).unwrap().map(|f| f.unwrap().file_name()).collect();
        names.sort();
        assert_eq!(names, ["frames.csv", "report.json", "timings.csv"]);
        assert!(log().write(&folder.path().join("none/report.json")).is_err());
    }
}
