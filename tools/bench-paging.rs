//! What a frame's decisions cost, by the size of its front and of the world: `cargo bench --bench paging`.
//!
//! With `--once NAME` the named work is done 16 times instead, after its scene has been set up, in the function
//! `measured` alone, so that its instructions can be counted:
//!
//! `valgrind --tool=callgrind --toggle-collect='*measured*' PROGRAM --once select/front-1000`
#![allow(clippy::unwrap_used, reason = "a bench that cannot go on should stop")]

#[path = "../tests/made_up/mod.rs"]
mod made_up;

use criterion::Criterion;
use made_up::{page, view, with_roots};
use std::hint::black_box;
use std::time::Duration;
use stoop::camera::View;
use stoop::cells::LiveTree;
use stoop::content::{PageId, PageKind};
use stoop::forest::index::synthetic::{Near, SyntheticForest};
use stoop::forest::index::{IndexForest, Place};
use stoop::geodesy::Geodetic;
use stoop::paging::{Command, Completion, Event, Frame, Limits, Planner, PlannerParams, RequestManager, held_bytes};
use stoop::select::{Demand, SelectParams, select, survey};

const LAT_DEG: f64 = 33.755;
const LON_DEG: f64 = -84.39;
const FRONTS: [usize; 3] = [100, 1_000, 10_000];
const WORLDS: [u64; 4] = [100_000, 1_000_000, 10_000_000, 100_000_000];
const WORKS: [(&str, Work); 4] =
    [("select", Work::Select), ("survey", Work::Survey), ("plan", Work::Plan), ("update", Work::Update)];
/// Between these the tolerance is sought that gives a front.
const TOLERANCES_PX: [f64; 2] = [0.02, 1e3];
/// How often `--once` does its work.
const TIMES: usize = 16;
/// From frame to frame; longer than a plan of foresight lasts, so that each frame plans.
const STEP_S: f64 = 0.05;
/// Views of the motion that is planned for, there and back.
const VIEWS: usize = 32;
/// Room for all pages, and as many of them under way as are asked for.
const LIMITS: Limits = Limits {
    footprint_bytes: 1 << 40,
    bytes_in_flight: u64::MAX,
    in_flight: 1 << 20,
    pages_in_flight: 1 << 20,
    read_bytes_per_update: 1 << 40,
    run_bytes: 1 << 20,
    gap_bytes: 1 << 14,
};

#[derive(Clone, Copy)]
enum Work {
    /// The front of a view, all of it resident.
    Select,
    /// The regions of a view.
    Survey,
    /// The demands of a frame by foresight, on the move.
    Plan,
    /// The request manager's share of a frame in which nothing changes.
    Update,
}

/// A view whose front is resident.
struct Scene {
    index: IndexForest,
    cells: LiveTree,
    manager: RequestManager,
    planner: Planner,
    params: SelectParams,
    views: Vec<View>,
    front: Vec<Demand>,
    frames: usize,
    pieces: usize,
}

fn params(tolerance_px: f64) -> SelectParams {
    SelectParams { tolerance_px, ..SelectParams::DEFAULT }
}

fn forest(radius_cells: u32, nodes: u64) -> SyntheticForest {
    let place = Geodetic::from_degrees(LAT_DEG, LON_DEG, 0.0);
    SyntheticForest::new(Near { place, finest_level: 17, radius_cells }, nodes).unwrap()
}

/// Looking down at the refined place, `east` heights beside it.
fn over_the_place(east: f64) -> View {
    const HEIGHT_M: f64 = 3_000.0;
    let off_deg = (east * HEIGHT_M / 6.37e6 / LAT_DEG.to_radians().cos()).to_degrees();
    view(LAT_DEG, LON_DEG + off_deg, HEIGHT_M, 0.0, -70.0)
}

impl Scene {
    /// A front of about `cells` cells in a world of 10⁶: the tolerance is sought that gives it.
    fn of_front(cells: usize) -> Self {
        let forest = forest(64, 1_000_000);
        // With all of the index that any of the tolerances needs.
        let finest = Self::new(&forest, TOLERANCES_PX[0]);
        let [mut fine, mut coarse] = TOLERANCES_PX;
        for _ in 0..24 {
            let middle = (fine * coarse).sqrt();
            *(if finest.regions(middle) > cells { &mut fine } else { &mut coarse }) = middle;
        }
        Self::new(&forest, coarse)
    }

    /// Regions of the front at a tolerance.
    fn regions(&self, tolerance_px: f64) -> usize {
        let mut regions = 0;
        survey(&self.index, &self.cells, &self.views[0], &params(tolerance_px), tolerance_px, |region| {
            regions += usize::from(region.kind == PageKind::Terrain);
        });
        regions
    }

    /// The same view in a world of as many cells.
    fn of_world(nodes: u64) -> Self {
        Self::new(&forest(8, nodes), 0.25)
    }

    fn new(forest: &SyntheticForest, tolerance_px: f64) -> Self {
        let index = forest.index().clone();
        let mut scene = Self {
            cells: with_roots(&index),
            index,
            manager: RequestManager::new(LIMITS).unwrap(),
            planner: Planner::new(&PlannerParams::default()),
            params: params(tolerance_px),
            views: (0..VIEWS).map(|at| over_the_place(0.01 * at.min(VIEWS - at) as f64)).collect(),
            front: Vec::new(),
            frames: 0,
            pieces: 0,
        };
        while scene.bring(forest) {}
        scene
    }

    /// Brings what the front lacks; false when it lacks nothing.
    fn bring(&mut self, forest: &SyntheticForest) -> bool {
        let selection = select(&self.index, &self.cells, &self.views[0], &self.params);
        (self.front, self.pieces) = (selection.demands, selection.pieces.len());
        let mut lacked = false;
        for command in self.manager.update(&self.front, 0.0) {
            let Command::Start(read) = command else { continue };
            lacked = true;
            for (page, place) in read.pages {
                let bytes = self.insert(forest, page, place);
                self.manager.complete(Event { page, completion: Completion::Loaded { bytes } }, 0.0);
            }
        }
        lacked
    }

    /// Gives the bytes that the page holds.
    fn insert(&mut self, forest: &SyntheticForest, id: PageId, place: Place) -> u64 {
        if id.kind == PageKind::Segment {
            self.index.insert_segment(forest.segment(id.cell).unwrap()).unwrap();
            return u64::from(place.len);
        }
        let page = page(id);
        self.cells.insert(&page);
        held_bytes(&page)
    }

    fn work(&mut self, work: Work) {
        self.frames += 1;
        let view = self.views[self.frames % VIEWS];
        let now_s = self.frames as f64 * STEP_S;
        match work {
            Work::Select => {
                black_box(select(&self.index, &self.cells, &view, &self.params));
            }
            Work::Survey => {
                let mut regions = 0;
                survey(&self.index, &self.cells, &view, &self.params, self.params.tolerance_px, |_| regions += 1);
                black_box(regions);
            }
            Work::Plan => {
                let frame = Frame {
                    index: &self.index,
                    cells: &self.cells,
                    manager: &self.manager,
                    view: &view,
                    now_s,
                    step_s: STEP_S,
                    params: &self.params,
                    drawn_tolerance_px: self.params.tolerance_px,
                };
                black_box(self.planner.plan(&frame, &self.front));
            }
            Work::Update => {
                black_box(self.manager.update(&self.front, now_s));
            }
        }
    }
}

/// A scene by its name.
fn scene(name: &str) -> Option<Scene> {
    let front = FRONTS.into_iter().find(|cells| name == format!("front-{cells}"));
    let world = WORLDS.into_iter().find(|nodes| name == format!("world-{nodes}"));
    front.map(Scene::of_front).or_else(|| world.map(Scene::of_world))
}

fn scene_names() -> Vec<String> {
    let fronts = FRONTS.map(|cells| format!("front-{cells}"));
    fronts.into_iter().chain(WORLDS.map(|nodes| format!("world-{nodes}"))).collect()
}

/// What instructions are counted of.
#[inline(never)]
fn measured(scene: &mut Scene, work: Work) {
    for _ in 0..TIMES {
        scene.work(work);
    }
}

/// Does one work in one scene, both named as in `select/front-100`.
fn once(name: &str) {
    let found = name.split_once('/').and_then(|(work, at)| {
        let work = WORKS.into_iter().find(|(name, _)| *name == work)?.1;
        Some((work, scene(at)?))
    });
    let Some((work, mut scene)) = found else {
        eprintln!("there is no {name:?}: name select, survey, plan or update, a slash, and one of {:?}", scene_names());
        std::process::exit(2);
    };
    // Whatever is made at first use is made now.
    scene.work(work);
    measured(&mut scene, work);
    println!("{name}: {TIMES} times over {} pieces, {} demands", scene.pieces, scene.front.len());
}

fn bench_all(criterion: &mut Criterion) {
    for at in scene_names() {
        let Some(mut scene) = scene(&at) else { continue };
        println!("{at}: {} pieces, {} demands", scene.pieces, scene.front.len());
        for (name, work) in WORKS {
            criterion.bench_function(&format!("{name}/{at}"), |bencher| bencher.iter(|| scene.work(work)));
        }
    }
}

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    if let Some(at) = arguments.iter().position(|argument| argument == "--once") {
        return once(arguments.get(at + 1).map_or("", String::as_str));
    }
    // `cargo test --benches` runs benches without this, to see that they start.
    if !arguments.iter().any(|argument| argument == "--bench") {
        return;
    }
    let criterion = Criterion::default().sample_size(10).measurement_time(Duration::from_secs(1));
    let mut criterion = criterion.warm_up_time(Duration::from_millis(300)).configure_from_args();
    bench_all(&mut criterion);
    criterion.final_summary();
}
