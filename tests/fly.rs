//! Flights over a made-up Earth, on whatever adapter there is: the same input gives the same flight, the footprint
//! holds, nothing has a hole, a broken page costs its detail only.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on should stop")]

mod earth;

use earth::{Formulas, dive, source};
use stoop::content::PageKind;
use stoop::engine::{Engine, EngineError, EngineParams, FrameReport, FrameRequest, Mode};
use stoop::record::{FlightHeader, FlightLog};
use stoop::units::ByteSize;

const SIZE_PX: [u32; 2] = [160, 90];
const FRAMES: u32 = 60;
const LOW_M: f64 = 30.0;

fn engine(reader: Formulas, params: EngineParams) -> Engine {
    Engine::new(source(reader), params).unwrap()
}

/// Flies the dive, hovers as long again, and audits every `audit`th frame (0: none).
fn fly(engine: &mut Engine, audit: u32) -> Vec<FrameReport> {
    let mut reports = Vec::new();
    for number in 0..2 * FRAMES {
        let way = f64::from(number.min(FRAMES)) / f64::from(FRAMES);
        let audited = audit > 0 && number % audit == 0;
        let view = dive(way, LOW_M, SIZE_PX);
        let request = FrameRequest { view, t_s: f64::from(number) / 60.0, ids: audited };
        let mut report = engine.frame(&request).unwrap();
        if audited {
            engine.audit(&request, &mut report).unwrap();
        }
        reports.push(report);
    }
    reports
}

fn params(mode: Mode) -> EngineParams {
    EngineParams { mode, ..EngineParams::default() }
}

#[test]
fn the_same_flight_twice_gives_the_same_report_to_the_byte() {
    let fly_once = || {
        let mut engine = engine(Formulas::default(), params(Mode::LockStep));
        let mut log = FlightLog::new(FlightHeader { arrivals_s: vec![1.0], ..FlightHeader::default() });
        log.frames = fly(&mut engine, 0);
        log.wasted_bytes = engine.wasted_bytes();
        let mut summary = serde_json::to_value(log.summary()).unwrap();
        for clock in ["first_frame_ms", "frame_ms", "cpu_ms", "peak_rss_bytes"] {
            summary.as_object_mut().unwrap().remove(clock);
        }
        (log.frames_csv(), summary, engine.picture().read_color().unwrap())
    };
    let (first, second) = (fly_once(), fly_once());
    assert_eq!(first.0, second.0);
    assert_eq!(first.1, second.1);
    assert_eq!(first.2, second.2);
}

#[test]
fn a_dive_has_no_hole_and_becomes_sharp_where_it_ends() {
    let mut engine = engine(Formulas::default(), params(Mode::LockStep));
    let reports = fly(&mut engine, 3);
    assert_eq!(reports.iter().filter_map(|report| report.holes).sum::<u64>(), 0);
    let last = reports.last().unwrap();
    assert_eq!((last.debt_px, last.excess_max_px, last.pages_missing), (0.0, 0.0, 0));
    assert!(last.coverage > 0.999 && !last.would_have_waited, "{last:?}");
    assert!(last.objects_drawn > 0 && last.triangles > 0, "{last:?}");
    assert!(reports.iter().any(|report| report.would_have_waited), "a dive without a page to wait for shows nothing");
    assert!(reports.iter().all(|report| report.failed == 0));
}

#[test]
fn the_footprint_holds_in_every_frame_and_quality_gives_way() {
    let least = match Engine::new(
        source(Formulas::default()),
        EngineParams { footprint: ByteSize(1 << 20), ..params(Mode::LockStep) },
    ) {
        Err(EngineError::FootprintTooSmall { least, .. }) => least,
        Err(other) => panic!("{other}"),
        Ok(_) => panic!("a mebibyte cannot be enough"),
    };
    for footprint in [least, ByteSize(96 << 20), ByteSize(256 << 20)] {
        let mut engine = engine(Formulas::default(), EngineParams { footprint, ..params(Mode::LockStep) });
        for report in fly(&mut engine, 20) {
            assert!(report.footprint_bytes <= footprint.0, "{footprint}: {report:?}");
            assert!(report.tolerance_drawn_px >= 1.0);
            assert_eq!(report.holes.unwrap_or(0), 0, "{footprint}: {report:?}");
        }
    }
    // A front that cannot fit is drawn coarser, and the debt says so.
    let wish = EngineParams { footprint: least, tolerance_px: 0.02, ..params(Mode::LockStep) };
    let reports = fly(&mut engine(Formulas::default(), wish), 0);
    for report in &reports {
        assert!(report.footprint_bytes <= least.0, "{least}: {report:?}");
    }
    let raised = |report: &&FrameReport| report.tolerance_drawn_px > wish.tolerance_px;
    assert!(reports.iter().any(|report| raised(&report)));
    assert!(reports.iter().filter(raised).any(|report| report.debt_px > 0.0));
}

#[test]
fn settled_frames_owe_nothing() {
    let mut engine = engine(Formulas::default(), params(Mode::Settled));
    for report in fly(&mut engine, 0) {
        assert_eq!((report.debt_px, report.pages_missing, report.in_flight), (0.0, 0, 0), "{report:?}");
    }
}

#[test]
fn a_broken_page_is_counted_and_the_flight_goes_on() {
    let broken = [
        earth::page_under_the_dive(5, PageKind::Terrain),
        earth::page_under_the_dive(9, PageKind::Imagery),
        earth::houses_page(),
    ];
    let reader = Formulas { broken: broken.into_iter().collect() };
    for mode in [Mode::LockStep, Mode::Settled] {
        let reader = Formulas { broken: reader.broken.clone() };
        let mut engine = engine(reader, params(mode));
        let reports = fly(&mut engine, 20);
        assert_eq!(reports.iter().map(|report| report.failed).sum::<u64>(), 3);
        assert_eq!(reports.iter().filter_map(|report| report.holes).sum::<u64>(), 0);
        assert_eq!(engine.take_failures().len(), 3);
    }
}

#[test]
fn a_live_flight_ends_and_shuts_its_threads_down() {
    let mut engine = engine(Formulas::default(), params(Mode::Live));
    let reports = fly(&mut engine, 0);
    assert_eq!(reports.len(), 2 * FRAMES as usize);
    assert!(reports.iter().map(|report| report.bytes_read).sum::<u64>() > 0);
    assert!(reports.iter().all(|report| report.timings.frame_ms > 0.0));
}

/// Hovers low over a made-up city until nothing is left to load; gives the failed reads.
fn hover(params: EngineParams) -> u64 {
    let mut engine = engine(Formulas::default(), params);
    let (view, mut failed) = (dive(1.0, LOW_M, SIZE_PX), 0);
    for frame in 0..100_000 {
        // Failed pages are tried again by the flight's clock.
        let request = FrameRequest { view, t_s: f64::from(frame) / 10.0, ids: false };
        let report = engine.frame(&request).unwrap();
        failed += report.failed;
        if frame > 0 && report.pages_missing == 0 && report.in_flight == 0 {
            assert_eq!(report.debt_px, 0.0, "{report:?}");
            return failed;
        }
    }
    panic!("not all pages came");
}

#[test]
fn held_back_reads_come_and_failed_ones_are_tried_again() {
    let storage = Some("2,20,2".parse().unwrap());
    assert_eq!(hover(EngineParams { storage, ..params(Mode::Live) }), 0);
    for storage in [storage, None] {
        let faults = "errors=0.3".parse().unwrap();
        let failed = hover(EngineParams { storage, faults, seed: 5, ..params(Mode::Live) });
        assert!(failed > 0, "{storage:?}");
    }
}

#[test]
fn ground_above_the_eye_is_pressed_and_counted() {
    let mut engine = engine(Formulas::default(), params(Mode::Settled));
    let mut view = dive(1.0, LOW_M, SIZE_PX);
    view.pose.eye.height_m -= LOW_M + 20.0;
    let view = stoop::camera::View::new(view.pose, view.fov_y_rad, view.size_px);
    let report = engine.frame(&FrameRequest { view, t_s: 0.0, ids: true }).unwrap();
    assert!(report.ground_pressed);
    let depth = engine.picture().read_depth().unwrap();
    assert!(depth.iter().all(|&metres| metres > 0.2), "the ground must not touch the eye");
}

/// Runs the program; gives exit status and what it said on standard error.
fn stoop(arguments: &[&str]) -> (i32, String) {
    let output = std::process::Command::new(env!("CARGO_BIN_EXE_stoop")).args(arguments).output().unwrap();
    (output.status.code().unwrap(), String::from_utf8(output.stderr).unwrap())
}

#[test]
fn wrong_usage_is_told_in_one_line() {
    for arguments in [
        &["fly"][..],
        &["fly", "world", "--path", "f", "--policy", "luck"],
        &["fly", "world", "--path", "f", "--live", "--settled"],
        &["fly", "world", "--path", "f", "--virtual", "tape"],
        &["fly", "world", "--path", "f", "--virtual", "ssd", "--live"],
        &["fly", "world", "--path", "f", "--sync-reads", "--settled"],
        &["fly", "world", "--path", "f", "--at-secs", "1"],
        &["fly", "world", "--path", "f", "--size", "640"],
        &["fly", "world", "--path", "f", "--footprint", "12MB"],
        &["fly", "world", "--path", "f", "--tolerance-px", "0"],
        &["fly", "world", "--path", "f", "--live", "--storage", "floppy"],
        &["fly", "world", "--path", "f", "--live", "--faults", "luck=1"],
        &["fly", "world", "--path", "f", "--live", "--faults", "revive_s=1"],
        &["fly", "world", "--path", "f", "--storage", "hdd"],
        &["fly", "world", "--path", "f", "--settled", "--faults", "errors=0.1"],
        &["shot", "world", "--lon-deg", "0", "--lat-deg", "91", "--height-m", "0", "--out", "f"],
        &["world", "--tolerance-px", "0.1"],
    ] {
        let (code, said) = stoop(arguments);
        assert_eq!((code, said.lines().count()), (2, 1), "{arguments:?}: {said}");
        assert!(said.starts_with("stoop: "), "{said}");
    }
}

#[test]
fn missing_files_are_named_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("path.json");
    let path = path.to_str().unwrap();
    let (code, said) = stoop(&["fly", "world", "--path", path]);
    assert!(code == 1 && said.contains("path.json") && said.lines().count() == 1, "{said}");
    let columns = r#"["t_s", "lon_deg", "lat_deg", "height_m", "heading_deg", "pitch_deg"]"#;
    let text = format!(r#"{{"columns": {columns}, "samples": [[0, 0, 0, 1e6, 0, -90]]}}"#);
    std::fs::write(path, text).unwrap();
    let (code, said) = stoop(&["fly", "no/such/world", "--path", path]);
    assert!(code == 1 && said.contains("no/such/world") && said.lines().count() == 1, "{said}");
}

/// The made-up Earth and a dive over it, on disk.
fn world_on_disk() -> (tempfile::TempDir, impl Fn(&str) -> String) {
    let folder = tempfile::tempdir().unwrap();
    earth::write(&folder.path().join("world"));
    std::fs::write(folder.path().join("path.json"), earth::path_json(LOW_M)).unwrap();
    let root = folder.path().to_owned();
    (folder, move |name| root.join(name).to_str().unwrap().to_owned())
}

fn read_json(file: &str) -> serde_json::Value {
    serde_json::from_str(&std::fs::read_to_string(file).unwrap()).unwrap()
}

#[test]
fn the_program_flies_a_world_on_disk_in_every_mode() {
    let (_folder, at) = world_on_disk();
    let (world, path) = (at("world"), at("path.json"));
    for mode in [&[][..], &["--settled"], &["--live"]] {
        let report = at("report.json");
        let size = ["--size", "96x54", "--report", &report];
        let (code, said) = stoop(&[&["fly", &world, "--path", &path], &size[..], mode].concat());
        assert_eq!(code, 0, "{mode:?}: {said}");
        let report = read_json(&report);
        assert_eq!(report["mode"], mode.first().map_or("lockstep", |mode| &mode[2..]));
        assert!((report["seconds"].as_f64().unwrap() - 3.0).abs() < 0.01 && report["failed"] == 0, "{report}");
        assert!(report["footprint_max_bytes"].as_u64() <= report["footprint_limit_bytes"].as_u64());
        let frames = report["frames"].as_u64().unwrap();
        let rows = std::fs::read_to_string(at("frames.csv")).unwrap().lines().count() as u64;
        assert_eq!(rows, frames + 1);
        match mode.first() {
            Some(&"--live") => assert!(frames > 1),
            Some(_) => assert_eq!((frames, &report["debt_px_s"]), (91, &0.0.into())),
            None => assert_eq!(frames, 91),
        }
        let arrival = &report["arrivals"][0];
        assert!(arrival["at_s"].as_f64().unwrap() > 0.5, "{arrival}");
    }
}

#[test]
fn pictures_ids_and_depths_are_written_when_asked() {
    let (_folder, at) = world_on_disk();
    let outputs = ["--frames", &at("f"), "--aov", &at("a"), "--at-secs", "0,2.5", "--report", &at("report.json")];
    let flight = ["fly", &at("world"), "--path", &at("path.json"), "--size", "64x36"];
    let (code, said) = stoop(&[&flight[..], &outputs].concat());
    assert_eq!(code, 0, "{said}");
    assert_eq!(read_json(&at("report.json"))["holes"], 0, "pictures are audited unless told otherwise");
    for name in ["t0000.00", "t0002.50"] {
        assert_eq!(image::open(at(&format!("f/{name}.png"))).unwrap().to_rgb8().dimensions(), (64, 36));
        let ids = std::fs::read(at(&format!("a/{name}.ids.npy"))).unwrap();
        let depth = std::fs::read(at(&format!("a/{name}.depth.npy"))).unwrap();
        assert!(ids.len() == 128 + 64 * 36 * 4 && depth.len() == ids.len());
        let legend = read_json(&at(&format!("a/{name}.ids.json")));
        assert!(!legend.as_object().unwrap().is_empty());
        assert!(legend.as_object().unwrap().values().all(|meaning| !meaning.is_null()), "{legend}");
    }
    assert_eq!(std::fs::read_dir(at("f")).unwrap().count(), 2);
    let low = read_json(&at("a/t0002.50.ids.json"));
    assert!(low.as_object().unwrap().values().any(|meaning| meaning["collection"] == "houses"), "{low}");
}

#[test]
fn a_shot_is_taken_settled() {
    let (_folder, at) = world_on_disk();
    let place = ["--lon-deg", "-84.39", "--lat-deg", "33.75", "--height-m", "3000", "--size", "64x36"];
    let (code, said) = stoop(&[&["shot", &at("world"), "--out", &at("shot.png")], &place[..]].concat());
    assert_eq!(code, 0, "{said}");
    assert_eq!(image::open(at("shot.png")).unwrap().to_rgb8().dimensions(), (64, 36));
    let (code, said) = stoop(&[&["shot", &at("world"), "--out", &at("no/shot.png")], &place[..]].concat());
    assert!(code == 1 && said.contains("no/shot.png"), "{said}");
}

#[test]
fn synchronous_flights_owe_nothing_and_fetch_nothing_ahead() {
    let (_folder, at) = world_on_disk();
    for mode in [&["--live"][..], &[], &["--virtual", "wan"]] {
        let report = at("report.json");
        let flight = ["fly", &at("world"), "--path", &at("path.json"), "--size", "96x54", "--sync-reads"];
        let (code, said) = stoop(&[&flight[..], &["--report", &report], mode].concat());
        assert_eq!(code, 0, "{mode:?}: {said}");
        let report = read_json(&report);
        assert_eq!((&report["debt_px"]["max"], &report["ahead_bytes"]), (&0.0.into(), &0.into()), "{mode:?}: {report}");
        assert!(report["would_have_waited"].as_u64() > Some(0), "{mode:?}: {report}");
        assert_eq!(report["waited_s"].is_null(), mode.is_empty(), "lock-step has no clock: {report}");
    }
}

/// Flies the world on disk into `folder` below it; gives the pictures' names, sorted, and the report.
fn fly_into(at: &dyn Fn(&str) -> String, folder: &str, arguments: &[&str]) -> (Vec<String>, serde_json::Value) {
    let (frames, report) = (at(&format!("{folder}/frames")), at(&format!("{folder}/report.json")));
    let flight = ["fly", &at("world"), "--path", &at("path.json"), "--size", "96x54"];
    let outputs = ["--frames", &frames, "--report", &report];
    let (code, said) = stoop(&[&flight[..], &outputs, arguments].concat());
    assert_eq!(code, 0, "{arguments:?}: {said}");
    let entries = std::fs::read_dir(frames).unwrap();
    let mut names: Vec<_> = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    (names, read_json(&report))
}

fn pixels(file: &str) -> image::RgbaImage {
    image::open(file).unwrap().to_rgba8()
}

#[test]
fn a_virtual_flight_shows_what_its_pages_show() {
    let (_folder, at) = world_on_disk();
    let times = ["--at-secs", "0,1.5,3"];
    let (names, fast) = fly_into(&at, "fast", &[&["--virtual", "ssd"], &times[..]].concat());
    let (_, slow) = fly_into(&at, "slow", &[&["--virtual", "200,0.02,1"], &times[..]].concat());
    let (_, settled) = fly_into(&at, "settled", &[&["--settled"], &times[..]].concat());
    assert_eq!(names, ["t0000.00.png", "t0001.50.png", "t0003.00.png"]);
    let picture = |folder: &str, name: &str| pixels(&at(&format!("{folder}/frames/{name}")));
    assert_eq!(picture("fast", "t0003.00.png"), picture("settled", "t0003.00.png"));
    assert_ne!(picture("slow", "t0003.00.png"), picture("settled", "t0003.00.png"), "coarser pages show");
    assert!(slow["debt_px"]["mean"].as_f64() > fast["debt_px"]["mean"].as_f64());
    for report in [&fast, &slow] {
        assert_eq!((&report["audited_frames"], &report["holes"]), (&report["frames"], &0.into()), "{report}");
        for measured in ["first_frame_ms", "frame_ms", "cpu_ms", "peak_rss_bytes"] {
            assert!(report[measured].is_null(), "{measured} is of a machine: {report}");
        }
        let keys = |report: &serde_json::Value| report.as_object().unwrap().keys().cloned().collect::<Vec<_>>();
        assert_eq!(keys(report), keys(&settled));
        assert!(report["mode"].as_str().unwrap().starts_with("virtual "), "{report}");
    }
}

#[test]
fn a_virtual_flight_leaves_the_same_files_whether_or_not_it_is_drawn() {
    let (_folder, at) = world_on_disk();
    let flight = ["fly", &at("world"), "--path", &at("path.json"), "--size", "96x54", "--virtual", "wan"];
    let fly = |folder: &str, outputs: &[&str]| {
        let report = at(&format!("{folder}/report.json"));
        let (code, said) = stoop(&[&flight[..], &["--report", &report], outputs].concat());
        assert_eq!(code, 0, "{folder}: {said}");
        [report, at(&format!("{folder}/frames.csv"))].map(|file| std::fs::read_to_string(file).unwrap())
    };
    let plain = fly("plain", &[]);
    assert_eq!(fly("again", &[]), plain);
    assert_eq!(fly("drawn", &["--frames", &at("f"), "--every-secs", "1", "--audit", "0"]), plain);
    let audited = fly("audited", &["--aov", &at("a"), "--at-secs", "3", "--audit", "10"]);
    assert_eq!(fly("audited again", &["--aov", &at("a"), "--at-secs", "3", "--audit", "10"]), audited);
    let legend = read_json(&at("a/t0003.00.ids.json"));
    assert!(legend.as_object().unwrap().values().any(|meaning| meaning["collection"] == "houses"), "{legend}");
    assert_eq!(read_json(&at("audited/report.json"))["audited_frames"], 10);
}

#[test]
fn a_virtual_flight_without_pictures_opens_no_renderer() {
    let (_folder, at) = world_on_disk();
    let output = std::process::Command::new(env!("CARGO_BIN_EXE_stoop"))
        .args(["fly", &at("world"), "--path", &at("path.json"), "--virtual", "lan", "--report", &at("report.json")])
        // A loader that finds no driver.
        .envs(["VK_DRIVER_FILES", "VK_ICD_FILENAMES", "LIBGL_DRIVERS_PATH"].map(|name| (name, "/nowhere")))
        .output()
        .unwrap();
    assert!(output.status.success(), "{output:?}");
    let said = String::from_utf8(output.stdout).unwrap();
    assert!(said.contains("on the virtual clock\n"), "{said}");
    assert_eq!(read_json(&at("report.json"))["holes"], serde_json::Value::Null);
}
