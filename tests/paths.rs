//! The committed flights that paging policies are compared on (`tools/make-test-paths.py` makes them) are what they
//! promise to be. That they fly over ground and beside buildings needs their world; the generator checks it.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on should stop")]

use std::collections::BTreeSet;
use std::fs;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use stoop::camera::FlightPath;
use stoop::geodesy::GeoBounds;

const LARGEST_FILE_BYTES: u64 = 200_000;
const FRAME_S: f64 = 1.0 / 60.0;
/// Added to heights above the ellipsoid before speeds are measured in them: San Francisco lies below it.
const LIFT_M: f64 = 100.0;
const GEORGIA_DEG: [f64; 4] = [-85.6, 30.4, -80.8, 35.0];
const CALIFORNIA_DEG: [f64; 4] = [-124.5, 32.5, -117.0, 42.0];

enum Speed {
    /// Metres per second.
    Metres(f64),
    /// Heights (above the ellipsoid, plus [`LIFT_M`]) per second.
    Heights(f64),
}

struct Promise {
    name: &'static str,
    seconds: f64,
    /// No frame is faster but those that jump.
    speed: Speed,
    /// The fastest turn, degrees per second.
    turn_deg: RangeInclusive<f64>,
    /// Without jumps, metres.
    way_m: RangeInclusive<f64>,
    /// Least and greatest height above the ellipsoid, metres.
    low_m: RangeInclusive<f64>,
    high_m: RangeInclusive<f64>,
    arrivals_s: &'static [f64],
    /// Whether each arrival is a jump.
    jumps: bool,
}

fn promises() -> Vec<Promise> {
    let dive = |name, seconds, rate, turn_deg, arrivals_s| Promise {
        name,
        seconds,
        speed: Speed::Heights(rate),
        turn_deg,
        way_m: 9.99e6..=1.01e7,
        low_m: 240.0..=270.0,
        high_m: 9.99e6..=1.001e7,
        arrivals_s,
        jumps: false,
    };
    let street = |name, seconds, speed, turn_deg, way_m, low_m, high_m| Promise {
        name,
        seconds,
        speed: Speed::Metres(speed),
        turn_deg,
        way_m,
        low_m,
        high_m,
        arrivals_s: &[],
        jumps: false,
    };
    vec![
        dive("dive", 50.0, 0.6, 10.0..=25.0, &[30.0]),
        dive("dive-10s", 15.0, 1.8, 0.0..=0.0, &[10.0]),
        dive("dive-3s", 8.0, 6.0, 0.0..=0.0, &[3.0]),
        street("street-2", 60.0, 2.2, 5.0..=15.0, 110.0..=121.0, 230.0..=280.0, 240.0..=290.0),
        street("street-20", 60.0, 22.0, 20.0..=35.0, 1000.0..=1210.0, 230.0..=280.0, 250.0..=310.0),
        street("sf-street", 40.0, 17.0, 20.0..=45.0, 500.0..=610.0, -30.0..=30.0, 50.0..=110.0),
        street("sierra", 60.0, 360.0, 7.0..=10.0, 18_000.0..=19_500.0, 2000.0..=3500.0, 3500.0..=5000.0),
        Promise {
            name: "look-around",
            seconds: 40.0,
            speed: Speed::Metres(0.01),
            turn_deg: 350.0..=361.0,
            way_m: 0.0..=0.1,
            low_m: 240.0..=270.0,
            high_m: 4000.0..=7000.0,
            arrivals_s: &[13.0, 26.0],
            jumps: true,
        },
        Promise {
            name: "teleports",
            seconds: 40.0,
            speed: Speed::Heights(0.04),
            turn_deg: 1.9..=2.1,
            way_m: 20_000.0..=40_000.0,
            low_m: -40.0..=50.0,
            high_m: 1.0e5..=1.02e5,
            arrivals_s: &[4.0, 8.0, 12.0, 16.0, 20.0, 24.0, 28.0, 32.0, 36.0],
            jumps: true,
        },
        Promise {
            name: "random-walk",
            seconds: 60.0,
            speed: Speed::Heights(2.0),
            turn_deg: 30.0..=75.0,
            way_m: 4.0e6..=2.0e7,
            low_m: 240.0..=350.0,
            high_m: 1.0e6..=2.01e6,
            arrivals_s: &[],
            jumps: false,
        },
    ]
}

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/paths")
}

fn load(name: &str) -> FlightPath {
    FlightPath::load(&folder().join(format!("{name}.json"))).unwrap()
}

/// What a flight does from frame to frame.
struct Flown {
    jumps_s: Vec<f64>,
    turn_deg: f64,
    way_m: f64,
    low_m: f64,
    high_m: f64,
}

fn fly(path: &FlightPath, speed: &Speed) -> Flown {
    let mut flown = Flown { jumps_s: vec![], turn_deg: 0.0, way_m: 0.0, low_m: f64::MAX, high_m: f64::MIN };
    let frames = (path.duration_s() / FRAME_S).round() as u32;
    for frame in 0..=frames {
        let t_s = path.start_s() + f64::from(frame) * FRAME_S;
        let (before, now) = (path.at(t_s - FRAME_S), path.at(t_s));
        assert!(now.eye.height_m.is_finite() && now.heading_rad.is_finite() && now.pitch_rad.is_finite(), "{t_s} s");
        flown.low_m = flown.low_m.min(now.eye.height_m);
        flown.high_m = flown.high_m.max(now.eye.height_m);
        let way_m = before.eye.to_ecef().distance_m(now.eye.to_ecef());
        let fastest_m_per_s = match speed {
            Speed::Metres(metres) => *metres,
            Speed::Heights(heights) => heights * (before.eye.height_m.max(now.eye.height_m) + LIFT_M),
        };
        if way_m > fastest_m_per_s * FRAME_S {
            flown.jumps_s.push(t_s);
            continue;
        }
        flown.way_m += way_m;
        let turn_rad = (now.heading_rad - before.heading_rad).sin().atan2((now.heading_rad - before.heading_rad).cos());
        flown.turn_deg = flown.turn_deg.max(turn_rad.abs().to_degrees() / FRAME_S);
    }
    flown
}

fn assert_within(name: &str, what: &str, value: f64, range: &RangeInclusive<f64>) {
    // Files are rounded.
    let slack = 1e-6 * range.end().abs() + 1e-9;
    assert!(value >= range.start() - slack && value <= range.end() + slack, "{name}: {what} {value} not in {range:?}");
}

#[test]
fn flights_are_what_they_promise() {
    for promise in promises() {
        let (name, path) = (promise.name, load(promise.name));
        assert_eq!((path.hz(), path.start_s(), path.duration_s()), (60.0, 0.0, promise.seconds), "{name}");
        let flown = fly(&path, &promise.speed);
        assert_within(name, "fastest turn (deg/s)", flown.turn_deg, &promise.turn_deg);
        assert_within(name, "way (m)", flown.way_m, &promise.way_m);
        assert_within(name, "least height (m)", flown.low_m, &promise.low_m);
        assert_within(name, "greatest height (m)", flown.high_m, &promise.high_m);
        let jumps_s = if promise.jumps { promise.arrivals_s } else { &[] };
        let as_promised = flown.jumps_s.iter().zip(jumps_s).all(|(flown, promised)| (flown - promised).abs() < FRAME_S);
        assert!(as_promised && flown.jumps_s.len() == jumps_s.len(), "{name} jumps at {:?} s", flown.jumps_s);
        if !promise.arrivals_s.is_empty() {
            assert_eq!(
                path.arrivals_s(|_, _| f64::NAN),
                promise.arrivals_s,
                "{name}: stated, so no ground is asked for"
            );
        }
    }
}

#[test]
fn a_jump_and_haste_are_seen() {
    let text = r#"{"columns": ["t_s", "lon_deg", "lat_deg", "height_m", "heading_deg", "pitch_deg"],
                   "samples": [[0, 0, 0, 100, 0, 0], [1, 0, 0, 100, 0, 0], [1.001, 0, 1, 100, 0, 0], [2, 0, 1, 100, 0, 0]]}"#;
    let path = FlightPath::parse(text, Path::new("jump.json")).unwrap();
    assert_eq!(fly(&path, &Speed::Metres(10.0)).jumps_s.len(), 1);
    assert_eq!(fly(&path, &Speed::Heights(10.0)).jumps_s.len(), 1);
    assert_eq!(fly(&path, &Speed::Metres(1e8)).jumps_s, [0.0; 0]);
}

#[test]
fn the_folder_holds_these_flights_and_they_are_small() {
    let mut found = BTreeSet::new();
    for entry in fs::read_dir(folder()).unwrap() {
        let entry = entry.unwrap();
        assert!(entry.metadata().unwrap().len() <= LARGEST_FILE_BYTES, "{:?}", entry.path());
        found.insert(entry.file_name().into_string().unwrap());
    }
    let promised: BTreeSet<_> = promises().iter().map(|promise| format!("{}.json", promise.name)).collect();
    assert_eq!(found, promised);
}

#[test]
fn dives_of_all_lengths_go_the_same_way() {
    let (slow, fast) = (load("dive"), load("dive-3s"));
    for tenth in 0..=10 {
        let (a, b) = (slow.at(f64::from(tenth) * 3.0), fast.at(f64::from(tenth) * 0.3));
        let apart_m = a.eye.to_ecef().distance_m(b.eye.to_ecef());
        assert!(apart_m < 1.0 + 1e-3 * a.eye.height_m, "{tenth} tenths: {apart_m} m apart");
        assert!((a.pitch_rad - b.pitch_rad).abs() < 1e-3, "{tenth} tenths");
    }
    let end = fast.at(3.0);
    assert_eq!(fast.at(5.5), end, "it rests where it arrived");
}

#[test]
fn the_random_walk_is_low_over_georgia_and_over_california() {
    let path = load("random-walk");
    let lowest_over = |[west, south, east, north]: [f64; 4]| {
        let bounds = GeoBounds::from_degrees(west, south, east, north);
        let eyes = (0..=3600).map(|frame| path.at(f64::from(frame) * FRAME_S).eye);
        eyes.filter(|eye| bounds.contains(eye.lat_rad, eye.lon_rad)).map(|eye| eye.height_m).fold(f64::MAX, f64::min)
    };
    assert!(lowest_over(GEORGIA_DEG) < 400.0);
    // The ground is at up to 4.4 km there.
    assert!(lowest_over(CALIFORNIA_DEG) < 4500.0);
}
