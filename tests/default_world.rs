//! The committed default world, through the commands that its users type.

use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn tiles() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tiles/default")
}

fn stoop(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_stoop")).args(arguments).output().expect("stoop starts")
}

fn json(output: &Output) -> Value {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("JSON on standard output")
}

fn world() -> String {
    tiles().join("world").display().to_string()
}

#[test]
fn the_world_is_whole_small_and_credits_its_sources() {
    let report = json(&stoop(&["check", &world(), "--json"]));
    assert_eq!(report["problems"].as_array().map(Vec::len), Some(0), "{report}");
    let info = json(&stoop(&["info", &world(), "--json"]));
    let bytes = info["pack_bytes"].as_u64().unwrap() + info["index_bytes"].as_u64().unwrap();
    assert!(bytes <= 32 << 20, "{bytes} bytes");
    for credit in ["ETOPO5", "SRTM", "Blue Marble", "OpenStreetMap"] {
        let credited =
            info["sources"].as_array().unwrap().iter().any(|s| s["credit"].as_str().unwrap().contains(credit));
        assert!(credited, "{credit}");
    }
    let views: Vec<_> = info["views"].as_array().unwrap().iter().map(|view| view["name"].as_str().unwrap()).collect();
    assert_eq!(views, ["Helsinki", "Golden Gate"]);
    let text = String::from_utf8(stoop(&["info", &world()]).stdout).unwrap();
    assert!(text.contains("Golden Gate: -122.51000 37.80800 degrees, 650.0 m, heading 67.0, pitch -13.0"), "{text}");
}

#[test]
fn the_ground_is_where_it_should_be() {
    let height_above_geoid = |lon: &str, lat: &str| {
        let probed = json(&stoop(&["probe", &world(), "--lon-deg", lon, "--lat-deg", lat, "--json"]));
        probed[0]["ground_above_geoid_m"].as_f64().unwrap()
    };
    // Mount Tamalpais' east peak is 784 m, its highest post in the source 781 m.
    let tamalpais = height_above_geoid("-122.5777", "37.9292");
    assert!((700.0..800.0).contains(&tamalpais), "{tamalpais}");
    let pacific = height_above_geoid("-150.0", "30.0");
    assert!(pacific.abs() < 25.0, "{pacific}");
}

#[test]
fn a_headless_dive_has_no_hole_and_keeps_its_footprint() {
    let folder = tempfile::tempdir().unwrap();
    let report_file = folder.path().join("report.json");
    let path = tiles().join("helsinki.json");
    let output = stoop(&[
        "fly",
        &world(),
        "--path",
        path.to_str().unwrap(),
        "--size",
        "320x180",
        "--step-secs",
        "1",
        "--audit",
        "5",
        "--frames",
        folder.path().to_str().unwrap(),
        "--at-secs",
        "0,12,30",
        "--report",
        report_file.to_str().unwrap(),
    ]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let report: Value = serde_json::from_str(&std::fs::read_to_string(report_file).unwrap()).unwrap();
    assert_eq!(report["holes"], 0);
    assert_eq!(report["failed"], 0);
    assert!(report["footprint_max_bytes"].as_u64() <= report["footprint_limit_bytes"].as_u64());
    assert!(report["bytes_read"].as_u64().unwrap() > 0);
    let mut pictures: Vec<_> = std::fs::read_dir(folder.path())
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|ext| ext == "png"))
        .collect();
    pictures.sort();
    assert_eq!(pictures.len(), 3, "{pictures:?}");
    for picture in pictures {
        let picture = image::open(&picture).unwrap().to_rgb8();
        assert_eq!(picture.dimensions(), (320, 180));
        let distinct: std::collections::BTreeSet<_> = picture.pixels().map(|p| p.0).collect();
        assert!(distinct.len() > 200, "a picture of {} colours", distinct.len());
    }
}
