//! `stoop-chart` and profiles through the real programs: the same figures each time, all of them in the tables, and one
//! clear error for what cannot be flown.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on should stop")]

mod towns;

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use stoop::chart::{DATA_FILE, PAGE_FILE, PROFILE_FILE, Profile};

const CHART: &str = env!("CARGO_BIN_EXE_stoop-chart");
const STOOP: &str = env!("CARGO_BIN_EXE_stoop");

/// A world with towns, a dive to one of them, and what was charted of it.
struct Case {
    folder: tempfile::TempDir,
}

impl Case {
    fn new() -> Self {
        let folder = towns::sources();
        let case = Self { folder };
        let sets = towns::set("west", "west.geojson") + &towns::set("near", "near.geojson");
        towns::make(case.folder.path(), &case.path("world"), &sets);
        fs::write(case.path("recipe.toml"), towns::world_text(&sets)).unwrap();
        fs::write(case.path("dive.json"), dive()).unwrap();
        case
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn chart(&self, out: &str) -> PathBuf {
        let out = self.path(out);
        let output = Command::new(CHART)
            .current_dir(self.folder.path())
            .args(["world", "--path", "dive.json", "--storage", "wan;20,50,4", "--policy", "demand,foresight"])
            .args([
                "--tolerance-px",
                "1,4",
                "--footprint",
                "256MiB,16MiB",
                "--speed",
                "1,5",
                "--size",
                "320x180,160x90",
            ])
            .args(["--step-secs", "0.1", "--faults", "errors=0.05", "--seed", "7", "--against", "recipe.toml"])
            .arg("--out")
            .arg(&out)
            .output()
            .unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        out
    }
}

/// From 2,000 km to 300 m above the western town in 8 s.
fn dive() -> String {
    let sample = |at: u32| {
        let share = f64::from(at) / 80.0;
        let height_m = 2e6 * (500.0 / 2e6f64).powf(share);
        format!("[{}, -84.35, 33.6, {height_m}, 30, {}]", 8.0 * share, -90.0 + 50.0 * share)
    };
    let samples: Vec<String> = (0..=80).map(sample).collect();
    let columns = r#"["t_s", "lon_deg", "lat_deg", "height_m", "heading_deg", "pitch_deg"]"#;
    format!(r#"{{"hz": 60, "columns": {columns}, "samples": [{}]}}"#, samples.join(","))
}

fn files(folder: &Path, ending: &str) -> Vec<String> {
    let names = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let mut names: Vec<String> = names.filter(|name| name.ends_with(ending)).collect();
    names.sort();
    names
}

/// All cells of all tables.
fn cells(folder: &Path) -> BTreeSet<String> {
    let mut cells = BTreeSet::new();
    for name in files(folder, ".csv") {
        let mut reader = csv::Reader::from_path(folder.join(name)).unwrap();
        for record in reader.records() {
            cells.extend(record.unwrap().iter().map(str::to_owned));
        }
    }
    cells
}

/// The values of the page's `data` elements.
fn values(page: &str) -> Vec<&str> {
    page.split("<data value=\"").skip(1).map(|rest| rest.split('"').next().unwrap()).collect()
}

#[test]
fn charts_are_the_same_each_time_and_all_their_figures_are_in_the_tables() {
    let case = Case::new();
    let (first, second) = (case.chart("a"), case.chart("b"));
    let names = files(&first, "");
    assert_eq!(names, files(&second, ""));
    let csv: Vec<&String> = names.iter().filter(|name| name.ends_with(".csv")).collect();
    let expected = [
        "accuracy",
        "debt",
        "debts",
        "distance",
        "dominance",
        "fetch",
        "heights",
        "modelled",
        "recommendation",
        "runs",
    ];
    assert!(expected.iter().all(|name| csv.contains(&&format!("{name}.csv"))), "{csv:?}");
    for name in &names {
        assert!(fs::read(first.join(name)).unwrap() == fs::read(second.join(name)).unwrap(), "{name} differs");
    }

    let page = fs::read_to_string(first.join(PAGE_FILE)).unwrap();
    let (values, cells) = (values(&page), cells(&first));
    assert!(values.len() > 300, "{}", values.len());
    let missing: Vec<&&str> = values.iter().filter(|value| !cells.contains(**value)).collect();
    assert!(missing.is_empty(), "{missing:?}");
    assert!(page.matches("<svg").count() >= 20);
    for foreign in ["<script", "<img", "<link", "@import", "src="] {
        assert!(!page.contains(foreign), "{foreign}");
    }
    let data: serde_json::Value = serde_json::from_slice(&fs::read(first.join(DATA_FILE)).unwrap()).unwrap();
    for name in csv {
        let rows = csv::Reader::from_path(first.join(name)).unwrap().into_records().count();
        assert_eq!(data["tables"][name.trim_end_matches(".csv")].as_array().unwrap().len(), rows, "{name}");
    }
    assert!(page.contains("Height error against the source"));
    heights_keep_their_bounds_and_grow_with_the_tolerance(&first.join("heights.csv"));
    a_profile_is_taken_and_flags_win(&case, &first.join(PROFILE_FILE));
}

fn heights_keep_their_bounds_and_grow_with_the_tolerance(file: &Path) {
    type Row = std::collections::BTreeMap<String, String>;
    let rows: Vec<Row> = csv::Reader::from_path(file).unwrap().into_deserialize().map(Result::unwrap).collect();
    let figures = |column: &str| -> Vec<f64> { rows.iter().map(|row| row[column].parse().unwrap()).collect() };
    assert_eq!(figures("tolerance_px"), [1.0, 4.0]);
    // From 2 s to 8 s, one each half second.
    assert_eq!(figures("frames"), [13.0, 13.0]);
    for column in ["error_mean_px", "error_mean_m", "bound_mean_px"] {
        let [fine, coarse] = figures(column)[..] else { panic!("two tolerances") };
        assert!(0.0 < fine && fine < coarse, "{column}: {fine} {coarse}");
    }
    assert!(figures("bytes")[0] > figures("bytes")[1]);
    // A coarse page that reaches beyond the view may have more triangles than the fine ones in it.
    assert!(figures("triangles_mean").iter().all(|&triangles| triangles > 0.0));
    assert!(figures("posts").iter().all(|&posts| posts > 500.0), "{:?}", figures("posts"));
    assert_eq!(figures("over_bound_posts"), [0.0, 0.0]);
    for (at, row) in rows.iter().enumerate() {
        let [mean, most, worst] = ["error_mean_px", "error_p99_px", "error_max_px"].map(|column| figures(column)[at]);
        assert!(mean <= most && most <= worst && worst <= 1.5 * figures("bound_max_px")[at], "{row:?}");
        assert!(figures("over_bound_share")[at] < 0.05 && figures("unmeasured_share")[at] < 0.05, "{row:?}");
    }
}

fn a_profile_is_taken_and_flags_win(case: &Case, file: &Path) {
    let profile = Profile::load(file).unwrap();
    assert_eq!(profile.storage, "wan");
    let fly = |further: &[&str]| {
        let report = case.path("report.json");
        let output = Command::new(STOOP)
            .current_dir(case.folder.path())
            .args(["fly", "world", "--path", "dive.json", "--virtual", "wan", "--step-secs", "0.5", "--modelled", "4"])
            .args(["--profile", file.to_str().unwrap(), "--report", report.to_str().unwrap()])
            .args(further)
            .output()
            .unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let report: serde_json::Value = serde_json::from_slice(&fs::read(report).unwrap()).unwrap();
        report
    };
    let report = fly(&[]);
    assert_eq!(report["tolerance_px"].as_f64(), profile.tolerance_px);
    assert_eq!(report["footprint_limit_bytes"].as_u64(), profile.footprint_bytes);
    let mean = |ratio: &str| report[ratio]["mean"].as_f64().unwrap();
    assert!(mean("needed_over_view_cut") >= 1.0 && mean("drawn_over_needed") >= 1.0, "{report}");
    // What of the needed reps lies beyond the view is not drawn, and what is behind something nearer is.
    assert!(0.0 < mean("drawn_over_front") && mean("drawn_over_front") < mean("drawn_over_needed"), "{report}");
    assert!(mean("drawn_over_seen") >= mean("drawn_over_needed"), "{report}");
    let report = fly(&["--tolerance-px", "3", "--footprint", "99MiB"]);
    assert_eq!(
        (report["tolerance_px"].as_f64(), report["footprint_limit_bytes"].as_u64()),
        (Some(3.0), Some(99 << 20))
    );
}

fn says(output: &Output, part: &str) {
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success(), "it passed");
    assert_eq!(error.lines().count(), 1, "not one line: {error}");
    assert!(error.contains(part) && !error.contains("panicked"), "{part:?} is not in: {error}");
}

#[test]
fn bad_arguments_give_one_clear_error() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, text: &str| {
        fs::write(folder.path().join(name), text).unwrap();
    };
    file("no-path.json", "{}");
    file("profile.json", r#"{"tolerance_px": -1}"#);
    let run = |program: &str, arguments: &[&str]| {
        Command::new(program).current_dir(folder.path()).args(arguments).output().unwrap()
    };
    let chart =
        |further: &[&str]| run(CHART, &[&["world", "--path", "no-path.json", "--out", "out"], further].concat());
    says(&chart(&["--tolerance-px", "1,0"]), "above 0");
    says(&chart(&["--policy", "best"]), "there is no policy \"best\"");
    says(&chart(&["--storage", "floppy"]), "no storage model");
    says(&chart(&["--size", "640"]), "640x360");
    says(&chart(&["--footprint", "many"]), "256MiB");
    says(&chart(&["--over", "12"]), "LON,LAT");
    says(&chart(&["--pictures", "0"]), "--pictures");
    says(&chart(&[]), "world");
    says(&chart(&["--root", "."]), "--against");
    says(&run(CHART, &["world", "--out", "out"]), "--path");
    let fly = ["fly", "world", "--path", "no-path.json", "--virtual", "wan"];
    says(&run(STOOP, &[&fly[..4], &["--profile", "none.json"]].concat()), "none.json");
    says(&run(STOOP, &[&fly[..], &["--profile", "profile.json"]].concat()), "tolerance_px is -1");
    says(&run(STOOP, &[&fly[..4], &["--modelled", "3"]].concat()), "--virtual");
    assert!(!folder.path().join("out").exists());
}

#[test]
fn heights_need_a_recipe_with_elevation_and_its_files() {
    let case = Case::new();
    let run = |recipe: &str| {
        let arguments = ["world", "--path", "dive.json", "--policy", "demand", "--out", "out", "--against", recipe];
        Command::new(CHART).current_dir(case.folder.path()).args(arguments).output().unwrap()
    };
    says(&run("no-recipe.toml"), "no-recipe.toml: cannot be read");
    fs::write(case.path("flat.toml"), "name = \"flat\"\n".to_owned() + &towns::set("west", "west.geojson")).unwrap();
    says(&run("flat.toml"), "flat.toml: has no [[elevation]]");
    fs::write(case.path("lost.toml"), "name = \"lost\"\n[[elevation]]\nfile = \"lost.tif\"\n").unwrap();
    says(&run("lost.toml"), "lost.tif: not found");
    assert!(!case.path("out").exists());
}
