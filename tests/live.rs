//! Flights with the threads of a window, without one: the render thread never waits, the footprint holds, nothing has a
//! hole however the view turns between two lists, and the end is clean at any moment.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on should stop")]

mod earth;

use earth::{Formulas, dive, source};
use std::collections::HashSet;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use stoop::camera::{Destination, NavInput, Navigator, Pose, Surroundings, View};
use stoop::content::{Page, PageId, PageKind};
use stoop::engine::{Engine, EngineParams, FrameReport, FrameRequest, Lack, Live, Mode, Pace, PickCache, Source};
use stoop::forest::index::Place;
use stoop::paging::{Gate, PageReader, ReadError, SlowReader};
use stoop::render::{DrawOptions, Renderer, SKY_ID};
use stoop::units::ByteSize;

const SIZE_PX: [u32; 2] = [160, 90];
const LOW_M: f64 = 30.0;
/// Longer than any machine needs for what a test waits for.
const LONG: Duration = Duration::from_secs(120);

fn live(source: Source, params: EngineParams, view: View) -> Live {
    let limits = Live::gpu_limits(&source, &params).unwrap();
    Live::start(source, params, Renderer::new(limits).unwrap(), view, Box::new(|| {})).unwrap()
}

fn gated() -> (Source, Arc<Gate>) {
    let (source, gate) = (source(Formulas::default()), Arc::new(Gate::default()));
    let reader = Arc::new(SlowReader::new(source.reader.clone(), Duration::ZERO, gate.clone()));
    (Source { reader, ..source }, gate)
}

/// Draws a view until `done`; gives the number of frames.
fn until(live: &mut Live, view: &View, t_s: &mut f64, done: impl Fn(&Live, &FrameReport) -> bool) -> u32 {
    let (started, mut frames) = (Instant::now(), 0);
    loop {
        *t_s += 1.0 / 60.0;
        let report = live.frame(view, *t_s, Pace::Moving).unwrap();
        live.renderer().finish().unwrap();
        frames += 1;
        if done(live, &report) {
            return frames;
        }
        assert!(started.elapsed() < LONG, "after {frames} frames: {report:?}");
    }
}

/// Whether the list was made for this very view and lacks nothing.
fn is_sharp(live: &Live, view: &View) -> bool {
    let list = live.list();
    list.view == *view && list.selection.stats.pages_missing == 0 && list.selection.stats.debt_px == 0.0
}

/// Sky pixels of the present list drawn in another view.
fn sky_px(live: &mut Live, view: &View) -> usize {
    let selection = live.list().selection.clone();
    let renderer = live.renderer();
    renderer.draw(view, &selection, &DrawOptions { aov: true, ..DrawOptions::default() }).unwrap();
    renderer.read_ids().unwrap().into_iter().filter(|&id| id == SKY_ID).count()
}

fn turned(view: &View, heading_rad: f64, pitch_rad: f64) -> View {
    View::new(Pose { heading_rad, pitch_rad, ..view.pose }, view.fov_y_rad, view.size_px)
}

#[test]
fn a_dive_becomes_sharp_and_stays_in_its_footprint() {
    for footprint in [ByteSize(64 << 20), ByteSize(256 << 20)] {
        let params = EngineParams { footprint, ..EngineParams::default() };
        let mut live = live(source(Formulas::default()), params, dive(0.0, LOW_M, SIZE_PX));
        let mut t_s = 0.0;
        for step in 0..=60 {
            t_s += 1.0 / 60.0;
            let report = live.frame(&dive(f64::from(step) / 60.0, LOW_M, SIZE_PX), t_s, Pace::Moving).unwrap();
            live.renderer().finish().unwrap();
            assert!(report.footprint_bytes <= footprint.0, "{footprint}: {report:?}");
            assert!(report.triangles > 0);
        }
        let end = dive(1.0, LOW_M, SIZE_PX);
        until(&mut live, &end, &mut t_s, |live, report| {
            assert!(report.footprint_bytes <= footprint.0, "{footprint}: {report:?}");
            is_sharp(live, &end)
        });
        let list = live.list();
        assert!(list.selection.stats.objects_drawn > 0 && list.awaited_s().is_none() && list.lacking.is_empty());
    }
}

#[test]
fn views_that_turned_since_their_list_show_no_hole() {
    let mut t_s = 0.0;
    for way in [0.0, 0.5, 0.9, 1.0] {
        let view = dive(way, LOW_M, SIZE_PX);
        let mut live = live(source(Formulas::default()), EngineParams::default(), view);
        until(&mut live, &view, &mut t_s, |live, _| is_sharp(live, &view));
        // From low down all of the picture is ground, whichever way it looks; from high up none may be lost.
        let pitch_rad = if way < 0.9 { view.pose.pitch_rad } else { -1.2 };
        for heading_rad in [0.0, 1.5, 3.0, 4.5] {
            let view = turned(&view, heading_rad, pitch_rad);
            let sky = sky_px(&mut live, &view);
            let expected = if way == 0.0 { sky_px_settled(&view) } else { 0 };
            assert!(sky <= expected, "{way} {heading_rad}: {sky} pixels of sky instead of {expected}");
        }
    }
}

/// The same view with nothing left to load.
fn sky_px_settled(view: &View) -> usize {
    let mut t_s = 0.0;
    let mut live = live(source(Formulas::default()), EngineParams::default(), *view);
    until(&mut live, view, &mut t_s, |live, _| is_sharp(live, view));
    sky_px(&mut live, view)
}

#[test]
fn frames_go_on_while_the_store_hangs_and_it_is_told_what_is_missing() {
    let (source, gate) = gated();
    let mut live = live(source, EngineParams::default(), dive(0.0, LOW_M, SIZE_PX));
    gate.close();
    let (end, mut t_s) = (dive(1.0, LOW_M, SIZE_PX), 0.0);
    let hung = Instant::now();
    let frames = until(&mut live, &end, &mut t_s, |live, _| {
        let list = live.list();
        hung.elapsed() > Duration::from_millis(500) && list.view == end && list.awaited_s().is_some_and(|s| s > 0.2)
    });
    assert!(frames > 3, "{frames} frames");
    let list = live.list();
    assert!(list.pages.total().missing > 0 && !list.lacking.is_empty() && list.selection.stats.debt_px > 0.0);
    // The horizon of coarser pages may lie lower: look down.
    let down = turned(&end, 0.0, -1.2);
    assert_eq!(sky_px(&mut live, &down), 0, "what is not there is drawn from coarser pages");
    gate.open();
    until(&mut live, &end, &mut t_s, |live, _| is_sharp(live, &end));
}

#[test]
fn it_ends_while_reads_hang() {
    let (source, gate) = gated();
    let mut live = live(source, EngineParams::default(), dive(0.0, LOW_M, SIZE_PX));
    gate.close();
    let mut t_s = 0.0;
    until(&mut live, &dive(1.0, LOW_M, SIZE_PX), &mut t_s, |_, _| gate.waiting() > 0);
    drop(live);
    assert!(gate.waiting() > 0, "the reads still hang");
    gate.open();
}

#[test]
fn limits_change_while_flying() {
    let view = dive(1.0, LOW_M, SIZE_PX);
    let mut live = live(source(Formulas::default()), EngineParams::default(), view);
    let mut t_s = 0.0;
    until(&mut live, &view, &mut t_s, |live, _| is_sharp(live, &view));
    let pages = |live: &Live| live.list().pages.total().resident;
    let fine_pages = pages(&live);
    let least = ByteSize(Live::least_footprint(live.source()).0 + (16 << 20));
    let tight = EngineParams { footprint: least, tolerance_px: 4.0, ..EngineParams::default() };
    live.set_params(tight).unwrap();
    until(&mut live, &view, &mut t_s, |live, report| {
        report.tolerance_drawn_px >= 4.0 && report.footprint_bytes <= least.0 && is_sharp(live, &view)
    });
    // What went out of the arenas leaves room: an eye that moves on gets its pages, and the globe stays.
    for heading_rad in [1.0, 3.0, 5.0] {
        let moved = turned(&view, heading_rad, -1.2);
        until(&mut live, &moved, &mut t_s, |live, report| {
            assert!(report.footprint_bytes <= least.0, "{report:?}");
            assert!(live.list().pages.terrain.resident >= 32, "the coarsest pages stay");
            is_sharp(live, &moved)
        });
        assert_eq!(sky_px(&mut live, &moved), 0);
    }
    assert!(live.set_params(EngineParams { footprint: ByteSize(1 << 20), ..tight }).is_err());
    live.set_params(EngineParams::default()).unwrap();
    until(&mut live, &view, &mut t_s, |live, _| is_sharp(live, &view) && pages(live) >= fine_pages);
}

#[test]
fn a_frame_time_is_held_while_the_eye_moves_and_not_when_it_rests() {
    let params = EngineParams { frame_ms: Some(8.0), ..EngineParams::default() };
    let view = dive(1.0, LOW_M, SIZE_PX);
    let mut live = live(source(Formulas::default()), params, view);
    let mut t_s = 0.0;
    until(&mut live, &view, &mut t_s, |live, _| is_sharp(live, &view));
    // On a machine on which each frame takes too long, whatever it shows.
    let mut heading_rad = 0.0;
    for _ in 0..200 {
        (heading_rad, t_s) = (heading_rad + 0.001, t_s + 1.0 / 60.0);
        live.frame(&turned(&view, heading_rad, view.pose.pitch_rad), t_s, Pace::Moving).unwrap();
        live.renderer().finish().unwrap();
        live.learn(100.0);
    }
    let moved = turned(&view, heading_rad, view.pose.pitch_rad);
    until(&mut live, &moved, &mut t_s, |_, report| report.lack == Lack::Time && report.tolerance_drawn_px > 1.5);
    let (started, mut rested) = (Instant::now(), false);
    while !rested && started.elapsed() < LONG {
        t_s += 1.0 / 60.0;
        let report = live.frame(&moved, t_s, Pace::Resting).unwrap();
        live.renderer().finish().unwrap();
        rested = report.lack == Lack::Nothing && report.tolerance_drawn_px == 1.0;
    }
    assert!(rested);
    let on = turned(&moved, heading_rad + 0.001, view.pose.pitch_rad);
    until(&mut live, &on, &mut t_s, |live, report| {
        live.list().view.pose == on.pose && report.lack == Lack::Time && report.tolerance_drawn_px > 1.5
    });
}

#[test]
fn what_is_drawn_answers_for_ground_and_houses() {
    let view = dive(1.0, LOW_M, SIZE_PX);
    let mut live = live(source(Formulas::default()), EngineParams::default(), view);
    let mut t_s = 0.0;
    until(&mut live, &view, &mut t_s, |live, _| is_sharp(live, &view));
    let cache = PickCache::default();
    let around = live.surroundings(&cache);
    let (lat_rad, lon_rad) = (earth::LAT_DEG.to_radians(), earth::LON_DEG.to_radians());
    let ground_m = around.ground_m(lat_rad, lon_rad).unwrap();
    assert!((ground_m - earth::ground_m(lat_rad, lon_rad)).abs() <= around.ground_error_m(lat_rad, lon_rad).unwrap());
    let house = around.obstacle(lat_rad, lon_rad, 0.0).unwrap();
    assert!((house.top_m - earth::ground_m(lat_rad, lon_rad) - 40.0).abs() < 5.0, "{house:?}");
    assert!(around.pick(&view, [80.0, 45.0]).is_some());
}

#[test]
fn a_lost_device_is_told_and_a_new_renderer_goes_on() {
    let (source, params) = (source(Formulas::default()), EngineParams::default());
    let (view, mut t_s) = (dive(1.0, LOW_M, SIZE_PX), 0.0);
    let mut first = live(source.clone(), params, view);
    until(&mut first, &view, &mut t_s, |live, _| is_sharp(live, &view));
    first.renderer().lose_device();
    assert!(first.is_lost() && first.frame(&view, t_s + 1.0, Pace::Moving).is_err());
    first.close();
    let mut second = live(source, params, view);
    until(&mut second, &view, &mut t_s, |live, _| is_sharp(live, &view));
    assert!(!second.is_lost());
}

/// Remembers which pages were read.
struct Listening {
    inner: Arc<dyn PageReader>,
    read: Mutex<HashSet<PageId>>,
}

impl Listening {
    fn of(source: Source) -> (Source, Arc<Self>) {
        let listening = Arc::new(Self { inner: source.reader.clone(), read: Mutex::default() });
        (Source { reader: listening.clone(), ..source }, listening)
    }

    fn has_read(&self, page: PageId) -> bool {
        self.read.lock().unwrap().contains(&page)
    }
}

impl PageReader for Listening {
    fn load(&self, page: PageId, place: Place) -> Result<Page, ReadError> {
        self.read.lock().unwrap().insert(page);
        self.inner.load(page, place)
    }
}

/// No ground is known.
struct Nowhere;

impl Surroundings for Nowhere {
    fn ground_m(&self, _: f64, _: f64) -> Option<f64> {
        None
    }

    fn pick(&self, _: &View, _: [f64; 2]) -> Option<stoop::geodesy::Point<stoop::geodesy::Ecef>> {
        None
    }

    fn obstacle(&self, _: f64, _: f64, _: f64) -> Option<stoop::camera::Obstacle> {
        None
    }
}

#[test]
fn where_a_flight_leads_is_read_before_the_eye_arrives() {
    let (high, low) = (dive(0.0, LOW_M, SIZE_PX), dive(1.0, LOW_M, SIZE_PX));
    let (source, listening) = Listening::of(source(Formulas::default()));
    let mut live = live(source, EngineParams::default(), high);
    let finest = earth::page_under_the_dive(earth::FINEST, PageKind::Imagery);
    let mut t_s = 0.0;
    until(&mut live, &high, &mut t_s, |live, _| is_sharp(live, &high));
    assert!(!listening.has_read(finest), "nothing leads there yet");
    let mut navigator = Navigator::new(high.pose, high.pose, high.fov_y_rad);
    navigator.input(NavInput::FlyTo(Destination::new(low.pose)), t_s, SIZE_PX, &Nowhere);
    let flight = navigator.flight().unwrap().clone();
    assert_eq!(flight.pose_at(flight.end_s()), low.pose);
    // The eye hardly moves: only the flight tells where it leads.
    t_s = flight.end_s() - 1.0;
    live.set_way(Some(flight));
    let (started, mut heading_rad) = (Instant::now(), high.pose.heading_rad);
    while !listening.has_read(finest) || !listening.has_read(earth::houses_page()) {
        (t_s, heading_rad) = (t_s + 1.0 / 60.0, heading_rad + 1e-5);
        live.frame(&turned(&high, heading_rad, high.pose.pitch_rad), t_s, Pace::Moving).unwrap();
        live.renderer().finish().unwrap();
        assert!(started.elapsed() < LONG);
    }
}

#[test]
fn a_way_that_is_told_is_known_to_the_end() {
    let finest = earth::page_under_the_dive(earth::FINEST, PageKind::Imagery);
    let high = dive(0.0, LOW_M, SIZE_PX);
    for told in [false, true] {
        let (source, listening) = Listening::of(source(Formulas::default()));
        let mut engine = Engine::new(source, EngineParams::default()).unwrap();
        if told {
            engine.set_way(Some(Arc::new(|t_s| dive((t_s - 1.0).clamp(0.0, 1.0), LOW_M, SIZE_PX).pose)));
        }
        for frame in 0..60 {
            let t_s = f64::from(frame) / 60.0;
            engine.frame(&FrameRequest { view: high, t_s, ids: false }).unwrap();
        }
        assert_eq!(listening.has_read(finest), told);
    }
}

/// Frames of a dive in steps that no prefetch covers, with reads that take their time.
fn synchronous(mode: Mode, broken: &[PageId]) -> Vec<FrameReport> {
    let source = source(Formulas { broken: broken.iter().copied().collect() });
    let slow = SlowReader::new(source.reader.clone(), Duration::from_millis(1), Arc::default());
    let params = EngineParams { mode, sync_reads: true, ..EngineParams::default() };
    let mut engine = Engine::new(Source { reader: Arc::new(slow), ..source }, params).unwrap();
    let frame = |number: u32| {
        let way = f64::from(number.min(10)) / 10.0;
        let request = FrameRequest { view: dive(way, LOW_M, SIZE_PX), t_s: f64::from(number), ids: false };
        engine.frame(&request).unwrap()
    };
    (0..15).map(frame).collect()
}

#[test]
fn synchronous_frames_wait_for_their_front_and_fetch_nothing_ahead() {
    for mode in [Mode::Live, Mode::LockStep] {
        let reports = synchronous(mode, &[]);
        for report in &reports {
            assert_eq!((report.pages_missing, report.debt_px, report.in_flight), (0, 0.0, 0), "{mode:?}: {report:?}");
            assert_eq!(report.ahead_bytes, 0, "{report:?}");
            let stood_still = report.would_have_waited && mode == Mode::Live;
            assert_eq!(report.waited_s > 0.0, stood_still, "{mode:?}: {report:?}");
        }
        assert!(reports.iter().any(|report| report.would_have_waited));
        assert!(!reports.last().unwrap().would_have_waited, "what stays is not waited for again");
    }
}

#[test]
fn synchronous_frames_do_not_wait_for_what_is_broken() {
    let broken = [earth::page_under_the_dive(9, PageKind::Terrain), earth::houses_page()];
    for mode in [Mode::Live, Mode::LockStep] {
        let reports = synchronous(mode, &broken);
        assert_eq!(reports.iter().map(|report| report.failed).sum::<u64>(), 2, "{mode:?}");
        assert_eq!(reports.last().unwrap().in_flight, 0);
    }
}
