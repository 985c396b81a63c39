//! Flight paths: where the eye is over time, as JSON.

use super::Pose;
use crate::geodesy::Geodetic;
use serde::Deserialize;
use serde_json::Value;
use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::fs;
use std::path::{Path, PathBuf};

/// Frames per second of a path that names no `hz`.
const DEFAULT_HZ: f64 = 60.0;
const DEFAULT_FOVY_DEG: f64 = 60.0;
/// Speed at which an eye arrives, heights per second.
const ARRIVAL_HEIGHTS_PER_SEC: f64 = 0.1;
/// The order in which a sample's numbers are kept.
const COLUMNS: [&str; 6] = ["t_s", "lon_deg", "lat_deg", "height_m", "heading_deg", "pitch_deg"];

#[derive(Debug, thiserror::Error)]
pub enum PathError {
    #[error("cannot read the flight path {}: {source}", file.display())]
    Read { file: PathBuf, source: std::io::Error },
    #[error(
        "{}: no flight path: {source}; it should look like \
         {{\"columns\": [\"t_s\", \"lon_deg\", \"lat_deg\", \"height_m\", \"heading_deg\", \"pitch_deg\"], \"samples\": [[…], …]}}",
        file.display()
    )]
    Json { file: PathBuf, source: serde_json::Error },
    #[error("{}: \"columns\" does not name {column:?}; add it, and its numbers to the samples", file.display())]
    Column { file: PathBuf, column: &'static str },
    #[error("{}: {key} is {value}, but should be {should}", file.display())]
    Setting { file: PathBuf, key: &'static str, value: f64, should: &'static str },
    #[error("{}: sample {sample} (counted from 0): {what}", file.display())]
    Sample { file: PathBuf, sample: usize, what: String },
    #[error("{}: there are no samples; at least one is needed", file.display())]
    Empty { file: PathBuf },
}

/// The file as it is written; unknown keys are ignored.
#[derive(Deserialize)]
struct PathFile {
    #[serde(default = "default_fovy_deg")]
    fovy_deg: f64,
    #[serde(default = "default_hz")]
    hz: f64,
    columns: Vec<String>,
    samples: Vec<Vec<Value>>,
    arrivals_s: Option<Vec<f64>>,
}

fn default_fovy_deg() -> f64 {
    DEFAULT_FOVY_DEG
}

fn default_hz() -> f64 {
    DEFAULT_HZ
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Sample {
    t_s: f64,
    pose: Pose,
}

/// A flight: poses at times, linear between them.
///
/// ```
/// # use stoop::camera::FlightPath;
/// # use std::path::Path;
/// let text = r#"{"columns": ["t_s", "lon_deg", "lat_deg", "height_m", "heading_deg", "pitch_deg"],
///                "samples": [[0, 179, 0, 100, 350, -90], [2, -179, 0, 300, 10, -10]]}"#;
/// let path = FlightPath::parse(text, Path::new("turn.json"))?;
/// let middle = path.at(1.0);
/// assert!((middle.eye.lon_deg().abs() - 180.0).abs() < 1e-9, "longitudes go the short way round");
/// assert!(middle.heading_rad.sin().abs() < 1e-9 && middle.heading_rad.cos() > 0.0, "headings too");
/// assert_eq!((middle.eye.height_m, path.duration_s()), (200.0, 2.0));
/// # Ok::<(), stoop::camera::PathError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct FlightPath {
    fovy_rad: f64,
    hz: f64,
    samples: Vec<Sample>,
    stated_arrivals_s: Option<Vec<f64>>,
}

impl FlightPath {
    pub fn load(file: &Path) -> Result<Self, PathError> {
        let text = fs::read_to_string(file).map_err(|source| PathError::Read { file: file.to_owned(), source })?;
        Self::parse(&text, file)
    }

    /// `file` is for messages only.
    pub fn parse(text: &str, file: &Path) -> Result<Self, PathError> {
        let read: PathFile =
            serde_json::from_str(text).map_err(|source| PathError::Json { file: file.to_owned(), source })?;
        check_setting(file, "fovy_deg", read.fovy_deg, "above 0 and below 180", |v| v > 0.0 && v < 180.0)?;
        check_setting(file, "hz", read.hz, "above 0, frames per second", |v| v > 0.0 && v <= 1e6)?;
        let places = find_columns(file, &read.columns)?;
        let mut samples: Vec<Sample> = Vec::with_capacity(read.samples.len());
        for (at, row) in read.samples.iter().enumerate() {
            let fail = |what: String| PathError::Sample { file: file.to_owned(), sample: at, what };
            let sample = read_sample(row, &read.columns, &places).map_err(fail)?;
            if samples.last().is_some_and(|last| last.t_s >= sample.t_s) {
                return Err(fail(format!("t_s is {}, not later than the sample before it", sample.t_s)));
            }
            samples.push(sample);
        }
        if samples.is_empty() {
            return Err(PathError::Empty { file: file.to_owned() });
        }
        for &arrival in read.arrivals_s.iter().flatten() {
            check_setting(file, "arrivals_s", arrival, "a time in seconds", f64::is_finite)?;
        }
        Ok(Self { fovy_rad: read.fovy_deg.to_radians(), hz: read.hz, samples, stated_arrivals_s: read.arrivals_s })
    }

    /// A flight from poses at times, in seconds, each later than the one before it; those that are not are left out.
    /// `None` without samples.
    pub fn new(fovy_rad: f64, hz: f64, poses: impl IntoIterator<Item = (f64, Pose)>) -> Option<Self> {
        let mut samples: Vec<Sample> = Vec::new();
        for (t_s, pose) in poses {
            if t_s.is_finite() && samples.last().is_none_or(|last| last.t_s < t_s) {
                samples.push(Sample { t_s, pose });
            }
        }
        (!samples.is_empty()).then_some(Self { fovy_rad, hz, samples, stated_arrivals_s: None })
    }

    /// The same way in less time, or in more: `factor` times as fast, from the same start; above 0.
    #[must_use]
    pub fn at_speed(&self, factor: f64) -> Self {
        let start_s = self.start_s();
        let scaled = |t_s: f64| start_s + (t_s - start_s) / factor;
        let samples = self.samples.iter().map(|sample| Sample { t_s: scaled(sample.t_s), ..*sample }).collect();
        let arrivals = self.stated_arrivals_s.as_ref();
        let stated_arrivals_s = arrivals.map(|times| times.iter().map(|&t_s| scaled(t_s)).collect());
        Self { samples, stated_arrivals_s, ..*self }
    }

    /// The file's text, a sample a line; angles to a nanodegree (0.1 mm), heights to a tenth of a millimetre.
    pub fn to_json(&self) -> String {
        let sample = |sample: &Sample| {
            let Pose { eye, heading_rad, pitch_rad } = sample.pose;
            let (lon, lat) = (eye.lon_deg(), eye.lat_deg());
            let (heading, pitch) = (heading_rad.to_degrees().rem_euclid(360.0), pitch_rad.to_degrees());
            format!("[{:.6}, {lon:.9}, {lat:.9}, {:.4}, {heading:.7}, {pitch:.7}]", sample.t_s, eye.height_m)
        };
        let columns = COLUMNS.map(|column| format!("\"{column}\"")).join(", ");
        let samples: Vec<String> = self.samples.iter().map(sample).collect();
        let arrivals = self.stated_arrivals_s.as_ref().map_or(String::new(), |s| format!(" \"arrivals_s\": {s:?},\n"));
        format!(
            "{{\n \"fovy_deg\": {}, \"hz\": {},\n \"columns\": [{columns}],\n{arrivals} \"samples\": [\n  {}\n ]\n}}\n",
            self.fovy_rad.to_degrees(),
            self.hz,
            samples.join(",\n  ")
        )
    }

    pub fn fovy_rad(&self) -> f64 {
        self.fovy_rad
    }

    pub fn hz(&self) -> f64 {
        self.hz
    }

    /// Time of the first sample.
    pub fn start_s(&self) -> f64 {
        self.samples[0].t_s
    }

    /// Time of the last sample.
    pub fn end_s(&self) -> f64 {
        self.samples[self.samples.len() - 1].t_s
    }

    /// From the first sample to the last.
    pub fn duration_s(&self) -> f64 {
        self.end_s() - self.start_s()
    }

    /// The pose at a time: before the first sample the first, after the last the last.
    pub fn at(&self, t_s: f64) -> Pose {
        let next = self.samples.partition_point(|sample| sample.t_s <= t_s);
        let (Some(from), to) = (next.checked_sub(1).map(|at| self.samples[at]), self.samples.get(next)) else {
            return self.samples[0].pose;
        };
        let Some(to) = to else {
            return from.pose;
        };
        between(from.pose, to.pose, (t_s - from.t_s) / (to.t_s - from.t_s))
    }

    /// Times of arrival: those that the file states, else each time at which the eye's speed falls below
    /// 0.1 heights per second after having been above it. `ground_m` gives the height of the ground above
    /// the ellipsoid by latitude and longitude in radians; heights count above it, and as at least 1 m.
    pub fn arrivals_s(&self, ground_m: impl Fn(f64, f64) -> f64) -> Vec<f64> {
        if let Some(stated) = &self.stated_arrivals_s {
            return stated.clone();
        }
        let mut arrivals = Vec::new();
        let mut moving = false;
        for pair in self.samples.windows(2) {
            let [from, to] = [pair[0], pair[1]];
            let eye = from.pose.eye;
            let height_m = (eye.height_m - ground_m(eye.lat_rad, eye.lon_rad)).max(1.0);
            let way_m = eye.to_ecef().distance_m(to.pose.eye.to_ecef());
            let fast = way_m / (to.t_s - from.t_s) >= ARRIVAL_HEIGHTS_PER_SEC * height_m;
            if moving && !fast {
                arrivals.push(from.t_s);
            }
            moving = fast;
        }
        if moving {
            // The eye stops where the path ends.
            arrivals.push(self.end_s());
        }
        arrivals
    }
}

fn check_setting(
    file: &Path,
    key: &'static str,
    value: f64,
    should: &'static str,
    good: impl Fn(f64) -> bool,
) -> Result<(), PathError> {
    if good(value) { Ok(()) } else { Err(PathError::Setting { file: file.to_owned(), key, value, should }) }
}

fn find_columns(file: &Path, names: &[String]) -> Result<[usize; 6], PathError> {
    let mut places = [0; 6];
    for (place, column) in places.iter_mut().zip(COLUMNS) {
        *place = names
            .iter()
            .position(|name| name == column)
            .ok_or_else(|| PathError::Column { file: file.to_owned(), column })?;
    }
    Ok(places)
}

fn read_sample(row: &[Value], names: &[String], places: &[usize; 6]) -> Result<Sample, String> {
    if row.len() != names.len() {
        return Err(format!("{} numbers for {} columns", row.len(), names.len()));
    }
    let mut numbers = [0.0; 6];
    for ((number, &place), column) in numbers.iter_mut().zip(places).zip(COLUMNS) {
        *number = row[place]
            .as_f64()
            .filter(|number| number.is_finite())
            .ok_or_else(|| format!("{column} is {}, which is no number", row[place]))?;
    }
    let [t_s, lon_deg, lat_deg, height_m, heading_deg, pitch_deg] = numbers;
    if !(-90.0..=90.0).contains(&lat_deg) {
        return Err(format!("lat_deg is {lat_deg}, but should be between -90 and 90"));
    }
    if !(-90.0..=90.0).contains(&pitch_deg) {
        return Err(format!("pitch_deg is {pitch_deg}, but should be between -90 (down) and 90 (up)"));
    }
    if !(-720.0..=720.0).contains(&lon_deg) {
        return Err(format!("lon_deg is {lon_deg}, but should be between -180 and 180"));
    }
    let eye = Geodetic { lat_rad: lat_deg.to_radians(), lon_rad: wrap_half_turn(lon_deg.to_radians()), height_m };
    let pose = Pose { eye, heading_rad: heading_deg.to_radians(), pitch_rad: pitch_deg.to_radians() };
    Ok(Sample { t_s, pose })
}

/// The same direction between −π and π.
fn wrap_half_turn(angle_rad: f64) -> f64 {
    if angle_rad.abs() <= PI { angle_rad } else { (angle_rad + PI).rem_euclid(TAU) - PI }
}

/// Linear in every number; longitudes and headings the short way round.
fn between(from: Pose, to: Pose, share: f64) -> Pose {
    let mix = |a: f64, b: f64| a + (b - a) * share;
    let turn = |a: f64, b: f64| wrap_half_turn(a + wrap_half_turn(b - a) * share);
    Pose {
        eye: Geodetic {
            lat_rad: mix(from.eye.lat_rad, to.eye.lat_rad).clamp(-FRAC_PI_2, FRAC_PI_2),
            lon_rad: turn(from.eye.lon_rad, to.eye.lon_rad),
            height_m: mix(from.eye.height_m, to.eye.height_m),
        },
        heading_rad: turn(from.heading_rad, to.heading_rad),
        pitch_rad: mix(from.pitch_rad, to.pitch_rad),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<FlightPath, PathError> {
        FlightPath::parse(text, Path::new("flight.json"))
    }

    fn with_samples(samples: &str) -> String {
        format!(
            r#"{{"fovy_deg": 50, "hz": 30, "note": 1, "samples": {samples},
                "columns": ["pitch_deg", "t_s", "lon_deg", "extra", "lat_deg", "height_m", "heading_deg"]}}"#
        )
    }

    #[test]
    fn columns_are_found_by_name() {
        let path = parse(&with_samples("[[-30, 1, 10, 99, 20, 1000, 90], [-40, 3, 12, \"x\", 22, 3000, 90]]")).unwrap();
        assert_eq!((path.hz(), path.duration_s(), path.start_s()), (30.0, 2.0, 1.0));
        let pose = path.at(2.0);
        assert!((pose.eye.lon_deg() - 11.0).abs() < 1e-12 && (pose.eye.lat_deg() - 21.0).abs() < 1e-12);
        assert!((pose.pitch_rad.to_degrees() + 35.0).abs() < 1e-12);
        assert_eq!(path.at(-5.0), path.at(1.0));
        assert_eq!(path.at(50.0), path.at(3.0));
    }

    #[test]
    fn a_faster_flight_passes_the_same_places() {
        let path = parse(&with_samples("[[-30, 1, 10, 99, 20, 1000, 90], [-40, 3, 12, 0, 22, 3000, 90]]")).unwrap();
        let fast = path.at_speed(4.0);
        assert_eq!((fast.start_s(), fast.duration_s(), fast.hz()), (1.0, 0.5, 30.0));
        assert_eq!(fast.at(1.25), path.at(2.0));
        let text = with_samples("[[-30, 1, 10, 99, 20, 1000, 90]]").replace("\"note\": 1", "\"arrivals_s\": [3]");
        assert_eq!(parse(&text).unwrap().at_speed(2.0).arrivals_s(|_, _| 0.0), [2.0]);
    }

    #[test]
    fn bad_files_are_named_with_the_sample() {
        let broken = [
            ("[", "no flight path"),
            (r#"{"columns": ["t_s"], "samples": []}"#, "lon_deg"),
            (&with_samples("[]"), "no samples"),
            (&with_samples("[[0,0,0,0,0,0,0],[0,0,0,0,0,0,0]]"), "sample 1"),
            (&with_samples("[[0,0,0,0,0,0]]"), "6 numbers for 7"),
            (&with_samples("[[0,0,0,0,91,0,0]]"), "lat_deg is 91"),
            (&with_samples("[[0,0,\"w\",0,9,0,0]]"), "no number"),
            (&with_samples("[[0,null,0,0,9,0,0]]"), "t_s is null"),
            (&with_samples("[[0,0,0,0,0,0,0]]").replace("50", "190"), "fovy_deg"),
            (&with_samples("[[0,0,0,0,0,0,0]]").replace("30", "0"), "hz"),
        ];
        for (text, what) in broken {
            let message = parse(text).unwrap_err().to_string();
            assert!(message.contains("flight.json") && message.contains(what), "{message}");
        }
    }

    #[test]
    fn arrivals_are_where_the_eye_slows_down() {
        let columns = r#""columns": ["t_s", "lon_deg", "lat_deg", "height_m", "heading_deg", "pitch_deg"]"#;
        let samples =
            "[[0,0,0,1000,0,0],[1,0,0,500,0,0],[2,0,0,100,0,0],[3,0,0,99,0,0],[4,0,0,99,0,0],[5,0,0,500,0,0]]";
        let path = parse(&format!(r#"{{{columns}, "samples": {samples}}}"#)).unwrap();
        assert_eq!(path.arrivals_s(|_, _| 0.0), [2.0, 5.0]);
        let path = parse(&format!(r#"{{{columns}, "samples": {samples}, "arrivals_s": [3.5]}}"#)).unwrap();
        assert_eq!(path.arrivals_s(|_, _| 0.0), [3.5]);
    }

    #[test]
    fn the_reference_dive_reads_and_arrives_at_its_street() {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data/dive/path.json");
        if !file.exists() {
            println!("skipped: ../shared/data is not here");
            return;
        }
        let path = FlightPath::load(&file).unwrap();
        assert_eq!(path.hz(), 60.0);
        assert!((path.duration_s() - 50.0).abs() < 0.1, "{}", path.duration_s());
        assert!((path.at(0.0).eye.height_m - 10_000_242.66).abs() < 1e-2);
        assert!(!path.arrivals_s(|_, _| 242.66).is_empty());
    }
}
