//! Flights by the virtual clock: footprints, dives, jumps, faults, and days.

use super::search::first_of_all_that_hold;
use super::table::{Row, digits};
use crate::made_up::flights::{dive, path, pose};
use crate::made_up::random::AnyPage;
use crate::made_up::town_world;
use std::collections::{HashMap, VecDeque};
use std::sync::Arc;
use stoop::camera::{FlightPath, Pose, View};
use stoop::content::PageId;
use stoop::paging::{FrameReport, Lack, PlannerParams, PolicyName};
use stoop::simulate::{Frame, Library, Setup, Simulation};
use stoop::storage::{Faults, StorageModel};
use stoop::units::ByteSize;

const LAT_DEG: f64 = 33.0;
const LON_DEG: f64 = -84.0;
const STEP_S: f64 = 1.0 / 30.0;

pub fn library() -> Library {
    Library::new(town_world(LAT_DEG, LON_DEG), Arc::new(AnyPage))
}

fn setup(policy: PolicyName, storage: StorageModel) -> Setup {
    Setup { planner: PlannerParams { policy, ..PlannerParams::default() }, ..Setup::new(storage, STEP_S) }
}

/// Flies a path and stays at its end for a while.
fn fly(library: &Library, path: &Arc<FlightPath>, setup: Setup, rest_s: f64) -> Vec<FrameReport> {
    let mut reports = Vec::new();
    watch(library, path, setup, rest_s, |frame, _| reports.push(frame.report));
    reports
}

fn watch(
    library: &Library,
    path: &Arc<FlightPath>,
    setup: Setup,
    rest_s: f64,
    mut look: impl FnMut(Frame, &Simulation<'_>),
) {
    let mut simulation = Simulation::new(library, setup).unwrap();
    let mut t_s = 0.0;
    while t_s <= path.duration_s() + rest_s {
        let view = View::new(path.at(path.start_s() + t_s), path.fovy_rad(), setup.size_px);
        let frame = simulation.frame(&view, t_s);
        assert!(frame.report.footprint_bytes <= setup.footprint.0);
        t_s += setup.step_s * (1.0 + (frame.report.waited_s / setup.step_s).ceil());
        look(frame, &simulation);
    }
}

/// A cache of bytes that drops what was longest not used, as is usual.
struct LeastRecent {
    order: VecDeque<PageId>,
    sizes: HashMap<PageId, u64>,
    bytes: u64,
    limit: u64,
}

impl LeastRecent {
    fn new(limit: u64) -> Self {
        Self { order: VecDeque::new(), sizes: HashMap::new(), bytes: 0, limit }
    }

    /// Uses a page; tells whether it had to be read.
    fn touch(&mut self, page: PageId, bytes: u64) -> bool {
        let is_read = self.sizes.insert(page, bytes).is_none();
        if is_read {
            self.bytes += bytes;
        } else {
            self.order.retain(|&other| other != page);
        }
        self.order.push_back(page);
        while self.bytes > self.limit
            && let Some(oldest) = self.order.pop_front()
        {
            self.bytes -= self.sizes.remove(&oldest).unwrap_or(0);
        }
        is_read
    }
}

fn street() -> Pose {
    pose(LAT_DEG, LON_DEG, 600.0, 0.0, -60.0)
}

pub fn small_footprints() -> Row {
    let library = library();
    let rest = path([(0.0, street()), (20.0, street())]);
    let least = Simulation::least_footprint(&library.index);
    let at_rest = |footprint: ByteSize| {
        let setup = Setup { footprint, ..setup(PolicyName::Foresight, StorageModel::SSD) };
        let reports = fly(&library, &rest, setup, 0.0);
        let late = reports.iter().filter(|report| report.t_s > 15.0);
        (late.map(|report| report.bytes_read + report.evicted).sum::<u64>(), reports[reports.len() - 1].clone())
    };
    let (_, whole) = at_rest(ByteSize(256 << 20));
    assert_eq!((whole.lack, whole.pages_missing), (Lack::Nothing, 0));
    let (moved, drawn) = at_rest(least);
    assert_eq!((moved, drawn.lack, drawn.pages_missing), (0, Lack::Memory, 0));
    // The same front through a cache that holds nine tenths of it.
    let setup = setup(PolicyName::Demand, StorageModel::SSD);
    let mut front: Vec<(PageId, u64)> = Vec::new();
    watch(&library, &rest, setup, 0.0, |frame, _| {
        front = frame.selection.demands.iter().map(|demand| (demand.page, u64::from(demand.place.len))).collect();
    });
    let front_bytes: u64 = front.iter().map(|(_, bytes)| bytes).sum();
    let mut cache = LeastRecent::new(front_bytes * 9 / 10);
    let mut read =
        |frames: u32| (0..frames).flat_map(|_| &front).filter(|(page, bytes)| cache.touch(*page, *bytes)).count();
    read(10);
    let share = read(100) as f64 / (100 * front.len()) as f64;
    assert!(share > 0.9, "{share}");
    let refused = Setup { footprint: ByteSize(least.0 - 1), ..setup };
    assert!(Simulation::new(&library, refused).is_err());
    let pool_bytes = least.0 - library.fixed_bytes();
    assert!(pool_bytes as f64 <= 0.8 * whole.front_size_bytes as f64, "{pool_bytes} {}", whole.front_size_bytes);
    Row {
        case: "a footprint smaller than the front",
        usual: format!(
            "a cache of nine tenths of the front that drops the least recent: {} % of it is read again in every frame",
            digits(100.0 * share)
        ),
        ours: format!(
            "the tolerance rises to {} px; at rest nothing is read or dropped, and no page lacks",
            digits(drawn.tolerance_drawn_px)
        ),
        limit: format!(
            "{} MiB for pages, where the front takes {} MiB; below that an error names the least",
            digits(pool_bytes as f64 / f64::from(1 << 20)),
            digits(whole.front_size_bytes as f64 / f64::from(1 << 20))
        ),
    }
}

/// Excess of the first frame after the dive's end, px, and debt of the whole flight, px·s.
fn dived(library: &Library, policy: PolicyName, storage: StorageModel, duration_s: f64) -> (f64, f64) {
    let dive = dive(LAT_DEG, LON_DEG, [1e7, 600.0], -60.0, duration_s);
    let reports = fly(library, &dive, setup(policy, storage), 0.0);
    let debt_px_s = reports.iter().map(|report| report.debt_px * STEP_S).sum();
    (reports[reports.len() - 1].excess_max_px, debt_px_s)
}

const DIVES_S: [f64; 5] = [60.0, 30.0, 10.0, 3.0, 1.0];

pub fn dives() -> Row {
    let library = library();
    let debts = |policy| DIVES_S.map(|duration_s| dived(&library, policy, StorageModel::WAN, duration_s).1);
    let (demand, foresight) = (debts(PolicyName::Demand), debts(PolicyName::Foresight));
    for (at, duration_s) in DIVES_S.into_iter().enumerate() {
        assert!(foresight[at] <= demand[at], "{duration_s} s: {} {}", foresight[at], demand[at]);
    }
    let tried: Vec<f64> = (1..=16).map(|half| f64::from(half) / 2.0).collect();
    let sharp = |policy| {
        first_of_all_that_hold(&tried, |duration_s| dived(&library, policy, StorageModel::WAN, duration_s).0 == 0.0)
    };
    let (late, soon) = (sharp(PolicyName::Demand), sharp(PolicyName::Foresight).unwrap());
    assert!(soon <= 3.0 && late.is_none_or(|late| late > soon), "{late:?} {soon}");
    let late = late.map_or("none of up to 8 s is".to_owned(), |late| format!("those of {late} s and more are"));
    let list = |debts: [f64; 5]| debts.map(digits).join(", ");
    Row {
        case: "dives from 10,000 km to 600 m in 60, 30, 10, 3, 1 s, over `wan`",
        usual: format!("reading what the frame lacks: {} px·s of debt; {late} sharp on arrival", list(demand)),
        ours: format!("`foresight`: {} px·s", list(foresight)),
        limit: format!("sharp on arrival from {soon} s on"),
    }
}

/// Places far from each other, with a stay at each; jumps are half-way between two frames.
fn jumps(stay_s: f64) -> Arc<FlightPath> {
    let stops = [
        pose(LAT_DEG, LON_DEG, 600.0, 0.0, -60.0),
        pose(-20.0, 130.0, 2e6, 40.0, -80.0),
        pose(LAT_DEG + 0.01, LON_DEG, 900.0, 180.0, -20.0),
        pose(89.9, 10.0, 1e5, 0.0, -60.0),
        pose(LAT_DEG, LON_DEG + 0.02, 400.0, 270.0, -40.0),
    ];
    path(stops.into_iter().enumerate().flat_map(|(at, stop)| {
        let start_s = at as f64 * stay_s - STEP_S / 2.0;
        [(start_s.max(0.0), stop), (start_s + stay_s - 1e-6, stop)]
    }))
}

/// From each jump until nothing lacks, the longest; seconds.
fn longest_blur_s(reports: &[FrameReport], stay_s: f64) -> f64 {
    let since_s = |report: &FrameReport| (report.t_s + STEP_S / 2.0) % stay_s + STEP_S / 2.0;
    reports.iter().filter(|report| report.excess_max_px > 0.0).map(since_s).fold(0.0, f64::max)
}

pub fn teleports() -> Row {
    const STAY_S: f64 = 8.0;
    let library = library();
    let way = jumps(STAY_S);
    let waiting = Setup { sync_reads: true, ..setup(PolicyName::Demand, StorageModel::WAN) };
    let stood_s = fly(&library, &way, waiting, 0.0).iter().map(|report| report.waited_s).fold(0.0, f64::max);
    assert!(stood_s > 0.5, "{stood_s}");
    let blur_s = |storage| {
        let reports = fly(&library, &way, setup(PolicyName::Foresight, storage), 0.0);
        assert!(reports.iter().all(|report| report.waited_s == 0.0 && report.cells_drawn > 0));
        longest_blur_s(&reports, STAY_S)
    };
    let [ssd, wan] = [StorageModel::SSD, StorageModel::WAN].map(blur_s);
    assert!(ssd < 1.5 * STEP_S && ssd < wan && wan < STAY_S / 2.0, "{ssd} {wan}");
    Row {
        case: "teleports, over `wan`",
        usual: format!("frames that wait for their pages: one stands still for {} s", digits(stood_s)),
        ours: format!("no frame waits, ground everywhere; sharp at the latest {} s after the jump", digits(wan)),
        limit: format!("{} s, one frame, on `ssd`", digits(ssd)),
    }
}

/// Whether all is there half a minute after a dive's end.
fn comes_to_rest(library: &Library, faults: &str, rest_s: f64) -> bool {
    let faults: Faults = faults.parse().unwrap();
    let dive = dive(LAT_DEG, LON_DEG, [4e6, 600.0], -60.0, 5.0);
    let setup = Setup { faults, seed: 11, ..setup(PolicyName::Foresight, StorageModel::WAN) };
    let reports = fly(library, &dive, setup, rest_s);
    assert!(reports.iter().all(|report| report.waited_s == 0.0 && report.cells_drawn > 0));
    reports[reports.len() - 1].excess_max_px == 0.0
}

pub fn faults() -> Row {
    const BAD: &str = "errors=0.05,spike_ms=2000,spikes=0.1,die_s=2,revive_s=6";
    let library = library();
    let dive = dive(LAT_DEG, LON_DEG, [4e6, 600.0], -60.0, 5.0);
    let waiting = Setup {
        faults: BAD.parse().unwrap(),
        seed: 11,
        sync_reads: true,
        ..setup(PolicyName::Demand, StorageModel::WAN)
    };
    let stood_s = fly(&library, &dive, waiting, 30.0).iter().map(|report| report.waited_s).fold(0.0, f64::max);
    assert!(stood_s > 4.0, "{stood_s}");
    assert!(comes_to_rest(&library, BAD, 30.0));
    // What is stored wrong never comes; all else does, and what is coarser is drawn there.
    let corrupt =
        Setup { faults: "corrupt=0.2".parse().unwrap(), seed: 3, ..setup(PolicyName::Foresight, StorageModel::WAN) };
    let (mut failed, mut uncovered) = (0, 0);
    for report in fly(&library, &dive, corrupt, 30.0) {
        failed += report.failed;
        uncovered += u32::from(report.cells_drawn == 0);
    }
    assert!(failed > 0 && uncovered == 0, "{failed} {uncovered}");
    // A server that stays dead: what is there is drawn.
    let dead = Setup { faults: "die_s=2".parse().unwrap(), ..setup(PolicyName::Foresight, StorageModel::WAN) };
    let frozen = fly(&library, &dive, dead, 10.0);
    assert!(frozen.iter().all(|report| report.waited_s == 0.0 && report.cells_drawn > 0));
    let shares = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9];
    let borne = shares.into_iter().take_while(|share| comes_to_rest(&library, &format!("errors={share}"), 60.0));
    let borne = borne.last().unwrap();
    assert!(borne >= 0.2, "{borne}");
    Row {
        case: "a store with errors, corruption, spikes of 2 s, and a server that dies for 4 s",
        usual: format!("frames that wait for their pages: one stands still for {} s", digits(stood_s)),
        ours: format!(
            "no frame waits, all is there 30 s later; {failed} reads of broken pages, each drawn coarser; a server that \
             stays dead stops no frame"
        ),
        limit: format!("{} % of all reads failing: sharp within 60 s", digits(100.0 * borne)),
    }
}
