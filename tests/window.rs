//! The window: its events without a display, and the program itself on a display without a screen (Xvfb), with input as
//! the X server sends it (xdotool). Where one of the two is not installed, that part is skipped.

#![cfg(feature = "window")]
#![allow(clippy::unwrap_used, reason = "a test that cannot go on should stop")]

use std::fs;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};
use stoop::camera::{Navigator, Pose, Surroundings, View};
use stoop::engine::{Engine, EngineParams, FrameRequest, Mode, Source};
use stoop::geodesy::Geodetic;
use stoop::store::World;
use stoop::window::{Hands, Taken};
use winit::dpi::PhysicalPosition;
use winit::event::{DeviceId, ElementState, MouseButton, MouseScrollDelta, TouchPhase, WindowEvent};

const SIZE_PX: [u32; 2] = [320, 180];
const FOV_Y_RAD: f64 = std::f64::consts::FRAC_PI_3;

fn default_world() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tiles/default/world")
}

/// Window events on their way to the eye, over what a settled engine draws of the default world.
struct Hand {
    engine: Engine,
    hands: Hands,
    navigator: Navigator,
    now_s: f64,
}

impl Hand {
    fn new() -> Self {
        let source = Source::of(World::open(&default_world()).unwrap());
        let engine = Engine::new(source, EngineParams { mode: Mode::Settled, ..EngineParams::default() }).unwrap();
        let pose = pose([0.0, 0.0, 1e7], [0.0, -90.0]);
        Self { engine, hands: Hands::default(), navigator: Navigator::new(pose, pose, FOV_Y_RAD), now_s: 0.0 }
    }

    fn event(&mut self, event: &WindowEvent) {
        let taken = Taken::default();
        if let Some(input) = self.hands.translate(event, 1.0, taken) {
            self.navigator.input(input, self.now_s, SIZE_PX, &self.engine.surroundings());
        }
    }

    fn cursor(&mut self, [x, y]: [f64; 2]) {
        self.event(&WindowEvent::CursorMoved { device_id: DeviceId::dummy(), position: PhysicalPosition::new(x, y) });
    }

    fn button(&mut self, state: ElementState) {
        self.event(&WindowEvent::MouseInput { device_id: DeviceId::dummy(), state, button: MouseButton::Left });
    }

    fn wheel(&mut self, lines: f32) {
        let delta = MouseScrollDelta::LineDelta(0.0, lines);
        self.event(&WindowEvent::MouseWheel { device_id: DeviceId::dummy(), delta, phase: TouchPhase::Moved });
    }

    /// The next frame of the window.
    fn frame(&mut self) -> View {
        self.now_s += 1.0 / 30.0;
        let view = self.navigator.step(self.now_s, SIZE_PX, &self.engine.surroundings());
        self.engine.frame(&FrameRequest { view, t_s: self.now_s, ids: false }).unwrap();
        view
    }
}

fn pose([lat_deg, lon_deg, height_m]: [f64; 3], [heading_deg, pitch_deg]: [f64; 2]) -> Pose {
    let eye = Geodetic::from_degrees(lat_deg, lon_deg, height_m);
    Pose { eye, heading_rad: heading_deg.to_radians(), pitch_rad: pitch_deg.to_radians() }
}

/// At 10,000 km, 10 km and 10 m over the drawn ground; also near a pole and across the antimeridian.
#[test]
fn the_point_that_was_grabbed_stays_under_the_cursor() {
    let mut hand = Hand::new();
    let places = [[20.0, 30.0], [89.99, 40.0], [-89.999, -100.0], [5.0, 179.99999], [-30.0, -179.99999]];
    for [lat_deg, lon_deg] in places {
        for (height_m, pitch_deg) in [(1e7, -90.0), (1e4, -60.0), (10.0, -45.0)] {
            let ground_m = {
                hand.navigator.place(pose([lat_deg, lon_deg, 2e4], [20.0, -90.0]));
                hand.frame();
                hand.engine.surroundings().ground_m(f64::to_radians(lat_deg), f64::to_radians(lon_deg)).unwrap()
            };
            // Finer ground may come up under the eye, which rises out of it.
            hand.navigator.place(pose([lat_deg, lon_deg, ground_m + height_m], [20.0, pitch_deg]));
            (0..60).for_each(|_| _ = hand.frame());
            assert!(!hand.navigator.is_moving());
            let view = hand.frame();
            let start_px = [140.0, 100.0];
            hand.cursor(start_px);
            hand.button(ElementState::Pressed);
            let grabbed = hand.engine.surroundings().pick(&view, start_px).unwrap();
            for step in 1..=4 {
                let at_px = [start_px[0] + 11.0 * f64::from(step), start_px[1] - 6.0 * f64::from(step)];
                hand.cursor(at_px);
                let view = hand.frame();
                let [x, y] = view.project_px(grabbed).unwrap();
                let off_px = (x - at_px[0]).hypot(y - at_px[1]);
                assert!(off_px < 1.0, "{lat_deg} {lon_deg} from {height_m} m, step {step}: {off_px} px off");
                let moved_px = {
                    let [x, y] = view.project_px(grabbed).unwrap();
                    (x - start_px[0]).hypot(y - start_px[1])
                };
                assert!(moved_px > 9.0 * f64::from(step), "the globe did not turn");
            }
            hand.button(ElementState::Released);
            // Two presses in a row are a double click.
            hand.now_s += 1.0;
        }
    }
}

#[test]
fn the_wheel_goes_to_the_point_under_the_cursor() {
    let mut hand = Hand::new();
    hand.navigator.place(pose([30.0, 10.0, 1e6], [0.0, -80.0]));
    let view = hand.frame();
    let at_px = [200.0, 60.0];
    hand.cursor(at_px);
    let point = hand.engine.surroundings().pick(&view, at_px).unwrap();
    let before_m = view.eye().distance_m(point);
    (0..5).for_each(|_| hand.wheel(1.0));
    let view = (0..60).map(|_| hand.frame()).last().unwrap();
    let [x, y] = view.project_px(point).unwrap();
    assert!((x - at_px[0]).hypot(y - at_px[1]) < 1.0, "{x} {y}");
    assert!(view.eye().distance_m(point) < 0.5 * before_m && !hand.navigator.is_moving());
}

/// A display of its own, ended with the test.
struct Display {
    server: Child,
    name: String,
    /// Stands for the user's home and settings.
    home: tempfile::TempDir,
}

impl Display {
    fn open() -> Option<Self> {
        for program in ["Xvfb", "xdotool"] {
            if Command::new("which").arg(program).stdout(Stdio::null()).status().ok()?.success() {
                continue;
            }
            println!("skipped: {program} is not installed");
            return None;
        }
        let mut server = Command::new("Xvfb")
            .args(["-displayfd", "1", "-screen", "0", "800x600x24"])
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let mut number = String::new();
        BufReader::new(server.stdout.take().unwrap()).read_line(&mut number).unwrap();
        Some(Self { server, name: format!(":{}", number.trim()), home: tempfile::tempdir().unwrap() })
    }

    fn path(&self, name: &str) -> PathBuf {
        self.home.path().join(name)
    }

    fn stoop(&self, arguments: &[&str]) -> Command {
        let mut stoop = Command::new(env!("CARGO_BIN_EXE_stoop"));
        stoop.args(arguments).current_dir(self.home.path());
        stoop.env("DISPLAY", &self.name).env("HOME", self.home.path()).env("XDG_CONFIG_HOME", self.path("config"));
        stoop.env_remove("WAYLAND_DISPLAY");
        stoop
    }

    /// Input as from hands; each word of `steps` is one of xdotool's.
    fn hands(&self, steps: &str) {
        // A window that never comes must not keep the test waiting for it.
        let mut hands = Command::new("timeout");
        hands.args(["180", "xdotool"]).args(steps.split(' ')).env("DISPLAY", &self.name);
        let status = hands.status().unwrap();
        assert!(status.success(), "xdotool {steps}");
    }

    /// Waits for something that must come sooner or later.
    fn wait(&self, what: &str, mut there: impl FnMut() -> bool) {
        let started = Instant::now();
        while !there() {
            assert!(started.elapsed() < Duration::from_secs(180), "{what} never came");
            // Not by xdotool: a display resets when its last window goes, and takes nobody in meanwhile.
            let slept = Command::new("sleep").arg("0.1").status().unwrap();
            assert!(slept.success());
        }
    }
}

impl Drop for Display {
    fn drop(&mut self) {
        drop(self.server.kill());
        drop(self.server.wait());
    }
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).lines().filter(|line| line.starts_with("stoop: ")).collect()
}

fn screenshots(folder: &Path) -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files
        .retain(|file| file.extension().is_some_and(|ending| ending == "png") && fs::metadata(file).unwrap().len() > 0);
    files.sort();
    files
}

#[test]
fn a_session_by_hand_ends_cleanly_and_keeps_what_was_made() {
    let Some(display) = Display::open() else { return };
    let report = display.path("session/report.json");
    let world = default_world();
    let arguments = [world.to_str().unwrap(), "--size", "640x360", "--report", report.to_str().unwrap()];
    let mut program = display.stoop(&arguments).stderr(Stdio::piped()).spawn().unwrap();
    display.hands("search --sync --onlyvisible --name Stoop windowfocus --sync");
    // A drag of the globe, a screenshot, all panels, the wheel, a recording of turning, a flight to the second bookmark.
    display.hands("mousemove 320 180 sleep 0.5 mousedown 1 mousemove 300 185 mousemove 260 190 sleep 0.2 mouseup 1");
    display.hands("key p");
    display.wait("the screenshot", || !screenshots(display.home.path()).is_empty());
    display.hands("key t key z key c key h sleep 0.3 key o sleep 0.3 key Escape");
    // Letters of a text do not fly; sizes change.
    display.hands("key f sleep 0.3 key ctrl+a type --delay 50 wwwwssaa");
    display.hands(
        "key Escape sleep 0.3 key Escape search --name Stoop windowsize 400 300 sleep 0.5 windowsize 640 360 sleep 0.5",
    );
    display.hands("mousemove 320 180 click 4 click 4 click 4 sleep 0.5");
    display.hands("key shift+p keydown Left sleep 0.5 keyup Left sleep 0.3 key shift+p");
    display.hands("key 2 sleep 12 mousedown 3 mousemove 330 150 sleep 0.2 mouseup 3 sleep 0.5");
    display.hands("key p");
    display.wait("the second screenshot", || screenshots(display.home.path()).len() == 2);
    display.hands("key ctrl+q");
    display.wait("the end", || program.try_wait().unwrap().is_some());
    let output = program.wait_with_output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));

    let report: serde_json::Value = serde_json::from_str(&fs::read_to_string(&report).unwrap()).unwrap();
    assert!(report["frames"].as_u64().unwrap() > 50 && report["first_frame_ms"].as_f64().unwrap() > 0.0, "{report}");
    assert!(report["footprint_max_bytes"].as_u64() <= report["footprint_limit_bytes"].as_u64());
    assert_eq!((&report["mode"], &report["failed"]), (&"window".into(), &0.into()));
    let pictures = screenshots(display.home.path()).iter().map(|file| mean(file)).collect::<Vec<_>>();
    assert!(
        pictures.iter().all(|&mean| mean > 5.0) && pictures[1] > 1.5 * pictures[0],
        "a globe, then a city: {pictures:?}"
    );
    let recorded = fs::read_dir(display.home.path()).unwrap().map(|entry| entry.unwrap().path());
    let recorded: Vec<_> = recorded.filter(|file| file.extension().is_some_and(|ending| ending == "json")).collect();
    let path = stoop::camera::FlightPath::load(&recorded[0]).unwrap();
    assert!(path.duration_s() > 0.3 && path.at(path.start_s()) != path.at(path.end_s()));
    let settings = fs::read_to_string(display.path("config/stoop/settings.toml")).unwrap();
    assert!(settings.contains("hud = true") && settings.contains("cells = true"), "{settings}");
    let view = settings.split("[[last_view]]").nth(1).unwrap();
    let key = |name: &str| {
        let line = view.lines().find(|line| line.starts_with(name)).unwrap();
        line.split('=').nth(1).unwrap().trim().parse::<f64>().unwrap()
    };
    assert!(key("height_m") < 1e6, "the flight came down: {view}");
    assert!((key("lat_deg") - 60.17).abs() < 5.0, "{view}");
}

/// A folder and what is in it.
fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap().map(|entry| entry.unwrap()) {
        let (path, to) = (entry.path(), to.join(entry.file_name()));
        if path.is_dir() { copy(&path, &to) } else { assert!(fs::copy(&path, &to).is_ok()) }
    }
}

/// The path of a world is typed, its set is listed and hidden; the name that the first world has already gets another.
#[test]
fn a_world_is_added_by_hand_and_its_set_is_hidden() {
    let Some(display) = Display::open() else { return };
    copy(&default_world(), &display.path("again"));
    let (report, folder) = (display.path("report.json"), display.path("again"));
    let world = default_world();
    let arguments = [world.to_str().unwrap(), "--size", "640x360", "--report", report.to_str().unwrap()];
    let mut program = display.stoop(&arguments).stderr(Stdio::piped()).spawn().unwrap();
    display.hands("search --sync --onlyvisible --name Stoop windowfocus --sync");
    display.hands("key b sleep 0.5 mousemove 510 66 click 1 sleep 0.3");
    display.hands(&format!("type --delay 30 {}", folder.to_str().unwrap()));
    display.hands("sleep 0.3 key Return sleep 3 mousemove 410 57 sleep 0.3 click 1 sleep 1 key ctrl+q");
    display.wait("the end", || program.try_wait().unwrap().is_some());
    let output = program.wait_with_output().unwrap();
    assert!(output.status.success(), "{}", said(&output));
    let report: serde_json::Value = serde_json::from_str(&fs::read_to_string(&report).unwrap()).unwrap();
    assert_eq!(report["failed"], 0);
    let settings = fs::read_to_string(display.path("config/stoop/settings.toml")).unwrap();
    assert!(settings.contains(r#"hidden = ["helsinki (default)"]"#), "{settings}");
    assert!(settings.contains(r#"side = "sets""#), "{settings}");
}

/// Mean of all channels.
fn mean(file: &Path) -> f64 {
    let picture = image::open(file).unwrap().to_rgb8();
    picture.as_raw().iter().map(|&value| f64::from(value)).sum::<f64>() / picture.as_raw().len() as f64
}

#[test]
fn a_store_that_hangs_does_not_keep_the_window_from_closing() {
    let Some(display) = Display::open() else { return };
    let world = default_world();
    let stalled = [world.to_str().unwrap(), "--size", "320x180", "--stall-secs", "2,3600"];
    let mut program = display.stoop(&stalled).stderr(Stdio::piped()).spawn().unwrap();
    display.hands("search --sync --onlyvisible --name Stoop windowfocus --sync");
    display.hands("sleep 2 key 2 sleep 3");
    // As a window manager or a shell ends it.
    let ended = Command::new("kill").args(["-TERM", &program.id().to_string()]).status().unwrap();
    assert!(ended.success());
    display.wait("the end", || program.try_wait().unwrap().is_some());
    let output = program.wait_with_output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(display.path("config/stoop/settings.toml").exists());
}

#[test]
fn what_cannot_be_opened_is_told_in_one_line_with_a_way_out() {
    let folder = tempfile::tempdir().unwrap();
    let world = default_world();
    let stoop = |arguments: &[&str]| {
        let mut stoop = Command::new(env!("CARGO_BIN_EXE_stoop"));
        stoop.args(arguments).current_dir(folder.path()).env("XDG_CONFIG_HOME", folder.path());
        stoop.env_remove("DISPLAY").env_remove("WAYLAND_DISPLAY").env_remove("WAYLAND_SOCKET");
        stoop.output().unwrap()
    };
    let refused = |output: Output, parts: &[&str]| {
        let said = said(&output);
        assert!(!output.status.success(), "{said}");
        parts.iter().for_each(|part| assert!(said.contains(part), "{part:?} is not in {said:?}"));
    };
    refused(stoop(&[world.to_str().unwrap()]), &["no window can be opened", "stoop fly"]);
    refused(stoop(&["no/such/world"]), &["no/such/world"]);
    refused(stoop(&["a", "b"]), &["no world here"]);
    refused(stoop(&[world.to_str().unwrap(), "--frame-ms", "1"]), &["--frame-ms", "off or a number from 8 to 100"]);
    refused(stoop(&[world.to_str().unwrap(), "--stall-secs", "2"]), &["AT,FOR"]);
    fs::write(folder.path().join("world.json"), "{").unwrap();
    refused(stoop(&[folder.path().to_str().unwrap()]), &["world.json"]);

    let Some(display) = Display::open() else { return };
    let mut without_driver = display.stoop(&[world.to_str().unwrap()]);
    without_driver.env("VK_DRIVER_FILES", "/nonexistent").env("VK_ICD_FILENAMES", "/nonexistent");
    refused(without_driver.output().unwrap(), &["graphics", "mesa-vulkan-drivers"]);
}
