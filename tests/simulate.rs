//! Flights by the virtual clock: the same to the bit, never above the footprint, and always at rest in the end.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on should stop")]

mod made_up;

use made_up::flights::{dive, path, pose, wander};
use made_up::random::{AnyPage, page_as_stored, pages_of};
use made_up::{town_world, with_roots};
use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;
use stoop::camera::{FlightPath, View};
use stoop::content::{PageId, PageKind};
use stoop::engine::Source;
use stoop::forest::index::Place;
use stoop::paging::{FrameReport, Lack, PageState, PlannerParams, PolicyName, drawn_pages};
use stoop::select::{SelectParams, Urgency, select};
use stoop::simulate::{Frame, Library, Setup, Simulation, SimulationError};
use stoop::storage::{Disk, Faults, PartOutcome, Request, StorageModel};
use stoop::store::World;
use stoop::units::ByteSize;

const LAT_DEG: f64 = 33.0;
const LON_DEG: f64 = -84.0;
const STEP_S: f64 = 1.0 / 30.0;
/// Longer than any of the worlds here takes to come over any model, retries after faults included.
const REST_MAX_S: f64 = 90.0;
/// At rest is who has nothing under way and lacks nothing for so long.
const QUIET_S: f64 = 0.6;
const MIB: u64 = 1 << 20;

/// Those of [`Setup::new`].
const PARAMS: SelectParams = SelectParams::DEFAULT;

fn library() -> Library {
    Library::new(town_world(LAT_DEG, LON_DEG), Arc::new(AnyPage))
}

fn with_policy(policy: PolicyName, setup: Setup) -> Setup {
    Setup { planner: PlannerParams { policy, ..setup.planner }, ..setup }
}

fn street_dive() -> Arc<FlightPath> {
    dive(LAT_DEG, LON_DEG, [4e6, 600.0], -60.0, 5.0)
}

/// What became of a flight that ends at rest.
struct Flown {
    reports: Vec<FrameReport>,
    last: Frame,
    /// How long after the end of the path nothing more was to come; `None` where that never was.
    settled_s: Option<f64>,
}

impl Flown {
    fn debt_px_s(&self, from_s: f64) -> f64 {
        self.reports.iter().filter(|report| report.t_s >= from_s).map(|report| report.debt_px * STEP_S).sum()
    }

    fn log(&self) -> String {
        self.reports.iter().map(|report| serde_json::to_string(report).unwrap() + "\n").collect()
    }

    fn failed(&self) -> u64 {
        self.reports.iter().map(|report| report.failed).sum()
    }
}

/// Flies a path, and stays at its end until all is there; `look` sees each frame.
fn fly(
    library: &Library,
    path: &Arc<FlightPath>,
    setup: Setup,
    mut look: impl FnMut(&Frame, &Simulation<'_>),
) -> Result<Flown, SimulationError> {
    let mut simulation = Simulation::new(library, setup)?;
    if setup.planner.policy == PolicyName::Oracle {
        simulation.know(path.clone());
    }
    let mut reports: Vec<FrameReport> = Vec::new();
    let (mut t_s, mut quiet_s, end_s) = (0.0, 0.0, path.duration_s());
    loop {
        let view = View::new(path.at(path.start_s() + t_s), path.fovy_rad(), setup.size_px);
        let frame = simulation.frame(&view, t_s);
        assert!(
            frame.report.footprint_bytes <= setup.footprint.0,
            "{} over {} holds {} of {} at {t_s} s",
            setup.planner.policy,
            setup.storage,
            frame.report.footprint_bytes,
            setup.footprint
        );
        look(&frame, &simulation);
        reports.push(frame.report.clone());
        // Policies that foretell motion need a moment to see that there is none any more.
        quiet_s = if t_s > end_s && simulation.is_settled() { quiet_s + STEP_S } else { 0.0 };
        if quiet_s > QUIET_S || t_s > end_s + REST_MAX_S {
            let settled_s = (quiet_s > QUIET_S).then_some(t_s - end_s);
            return Ok(Flown { reports, last: frame, settled_s });
        }
        t_s += STEP_S * (1.0 + (frame.report.waited_s / STEP_S).ceil());
    }
}

fn flown(library: &Library, path: &Arc<FlightPath>, setup: Setup) -> Flown {
    fly(library, path, setup, |_, _| {}).unwrap()
}

#[test]
fn the_same_seed_gives_the_same_frames_to_the_bit() {
    let library = library();
    let path = wander(7, LAT_DEG, LON_DEG, 4.0);
    let faults: Faults = "errors=0.05,corrupt=0.01,spike_ms=200,spikes=0.1".parse().unwrap();
    for (number, policy) in PolicyName::ALL.into_iter().enumerate() {
        let storage = StorageModel::ALL[number % StorageModel::ALL.len()];
        let setup = with_policy(policy, Setup { faults, seed: 3, ..Setup::new(storage, STEP_S) });
        let log = flown(&library, &path, setup).log();
        assert!(log == flown(&library, &path, setup).log(), "{policy} over {storage} differs from run to run");
        let other = flown(&library, &path, Setup { seed: 4, ..setup }).log();
        assert!(log != other, "{policy} over {storage}: the seed says nothing");
        // Without faults there is nothing that a seed could change.
        let sound = |seed| flown(&library, &path, Setup { faults: Faults::NONE, seed, ..setup }).log();
        assert!(sound(3) == sound(4));
    }
}

/// A footprint that cannot work is refused with the least one; all others hold, and end at rest.
#[test]
fn every_policy_keeps_every_footprint_on_every_model_and_comes_to_rest() {
    let library = library();
    let least = Simulation::least_footprint(&library.index);
    let footprints: Vec<ByteSize> = [4, 16, 32, 64, 128].map(|mib| ByteSize(mib * MIB)).into();
    let (workable, refused): (Vec<ByteSize>, Vec<ByteSize>) = footprints.into_iter().partition(|size| *size >= least);
    assert!(workable.len() > 1 && !refused.is_empty(), "{least}");
    let path = street_dive();
    for footprint in refused {
        let setup = Setup { footprint, ..Setup::new(StorageModel::SSD, STEP_S) };
        let error = Simulation::new(&library, setup).err().unwrap();
        assert_eq!(error, SimulationError::FootprintTooSmall { asked: footprint, least });
    }
    for storage in StorageModel::ALL {
        let mut all: Vec<(ByteSize, [f64; 6])> = Vec::new();
        for footprint in [least].into_iter().chain(workable.iter().copied()) {
            let debts = PolicyName::ALL.map(|policy| debt_within(&library, &path, policy, storage, footprint));
            println!("{storage:>6} {footprint:>9}: {debts:.3?} px·s");
            for (less, small) in all.iter().filter(|(less, _)| 2 * less.0 <= footprint.0) {
                let sums = [small.iter().sum::<f64>(), debts.iter().sum()];
                assert!(
                    sums[1] <= LESS_IS_SOONER * sums[0] + 0.05,
                    "{storage}, {less}: {small:?}, {footprint}: {debts:?}"
                );
                let alike = small.iter().zip(&debts).all(|(small, large)| *large <= 2.0 * small + 0.05);
                assert!(alike, "{storage}, {less}: {small:?}, {footprint}: {debts:?}");
            }
            all.push((footprint, debts));
        }
        let [first, last] = [all[0].1, all[all.len() - 1].1].map(|debts| debts.iter().sum::<f64>());
        assert!(first > 1.2 * last, "{storage}: from {last} px·s with all room to {first} px·s with the least");
    }
}

/// Debt grows as the footprint shrinks, but for this: less room raises the tolerance, a coarser front is sooner there, and
/// over a slow link policies that ask for the whole front, whatever it takes, are better off with it.
const LESS_IS_SOONER: f64 = 1.25;

fn debt_within(
    library: &Library,
    path: &Arc<FlightPath>,
    policy: PolicyName,
    storage: StorageModel,
    footprint: ByteSize,
) -> f64 {
    let flown = flown(library, path, with_policy(policy, Setup { footprint, ..Setup::new(storage, STEP_S) }));
    let last = &flown.last.report;
    assert!(flown.settled_s.is_some(), "{policy} over {storage} within {footprint} never rests: {last:?}");
    assert!(last.lack == Lack::Memory || last.excess_max_px == 0.0, "{policy} over {storage} {footprint}: {last:?}");
    flown.debt_px_s(0.0)
}

#[test]
fn at_rest_nothing_is_read_or_dropped_any_more() {
    let library = library();
    let least = Simulation::least_footprint(&library.index);
    for policy in PolicyName::ALL {
        // As small as it may be, and a little more: where pages would be swapped in turns, they would be here.
        for footprint in [least, ByteSize(least.0 + 3 * MIB), ByteSize(least.0 + 12 * MIB)] {
            let setup = with_policy(policy, Setup { footprint, ..Setup::new(StorageModel::LAN, STEP_S) });
            let path = street_dive();
            let mut simulation = Simulation::new(&library, setup).unwrap();
            let mut late = 0;
            for number in 0..600 {
                let t_s = f64::from(number) * STEP_S;
                let view = View::new(path.at(t_s), path.fovy_rad(), setup.size_px);
                let report = simulation.frame(&view, t_s).report;
                assert!(report.footprint_bytes <= footprint.0);
                if t_s > 15.0 {
                    late += report.requests + report.evicted + report.cancelled;
                }
            }
            assert_eq!(late, 0, "{policy} within {footprint}");
        }
    }
}

/// Pages that a seed makes corrupt: they are so for whoever reads them.
fn corrupt_pages(pages: &[(PageId, Place)], faults: Faults, seed: u64) -> BTreeSet<PageId> {
    let mut disk = Disk::new(StorageModel::DIRECT, Faults { corrupt: faults.corrupt, ..Faults::NONE }, seed);
    for (id, (page, place)) in (0..).zip(pages) {
        let parts = vec![u64::from(place.len)];
        assert!(disk.start(Request { id, file: page.cell.zone().index() as u32, offset: place.offset, parts }, 0.0));
    }
    let corrupt = disk.advance(1e6).into_iter().filter(|arrival| arrival.outcome == PartOutcome::Corrupt);
    corrupt.map(|arrival| pages[arrival.id as usize].0).collect()
}

#[test]
fn faults_delay_and_never_stop_a_flight() {
    let library = library();
    let path = street_dive();
    for text in ["errors=0.01", "errors=0.3", "spike_ms=2000,spikes=0.05", "die_s=1,revive_s=4", "halve_s=1"] {
        let faults: Faults = text.parse().unwrap();
        for storage in StorageModel::ALL {
            // All policies over one model, the plainest and the one by default over all.
            let plain = [PolicyName::Demand, PolicyName::Foresight];
            let policies =
                PolicyName::ALL.into_iter().filter(|policy| storage == StorageModel::WAN || plain.contains(policy));
            for policy in policies {
                let setup = with_policy(policy, Setup { faults, seed: 11, ..Setup::new(storage, STEP_S) });
                let flown = flown(&library, &path, setup);
                let last = &flown.last.report;
                assert!(flown.settled_s.is_some(), "{policy} over {storage} with {text} never rests: {last:?}");
                // Settled means that what failed often is not waited for; at these shares nothing does so for long.
                assert!(
                    last.excess_max_px == 0.0 || faults.errors > 0.1,
                    "{policy} over {storage} with {text}: {last:?}"
                );
                // Who has fetched all ahead does not notice that a server dies.
                let fails = faults.errors > 0.1 || (faults.die_s.is_some() && policy == PolicyName::Demand);
                assert!(!fails || flown.failed() > 0, "{policy} over {storage} with {text}: nothing failed");
            }
        }
    }
}

#[test]
fn corrupt_pages_are_counted_once_and_never_drawn() {
    let library = library();
    let pages = pages_of(&library.index);
    let path = street_dive();
    for (share, seed) in [(0.001, 1), (0.03, 2), (0.2, 3)] {
        let faults = Faults { corrupt: share, ..Faults::NONE };
        let corrupt = corrupt_pages(&pages, faults, seed);
        assert!(share < 0.01 || corrupt.len() > 3, "{} of {} pages", corrupt.len(), pages.len());
        for (number, policy) in PolicyName::ALL.into_iter().enumerate() {
            let storage = StorageModel::ALL[number % StorageModel::ALL.len()];
            let setup = with_policy(policy, Setup { faults, seed, ..Setup::new(storage, STEP_S) });
            let (mut met, mut there): (u64, BTreeSet<PageId>) = (0, BTreeSet::new());
            let flown = fly(&library, &path, setup, |frame, simulation| {
                assert!(drawn_pages(&frame.selection).all(|page| !corrupt.contains(&page)));
                let failed = |(page, _): &&(PageId, Place)| simulation.manager().state(*page) == PageState::Failed;
                met = pages.iter().filter(failed).count() as u64;
                let resident = |page: &PageId| simulation.manager().is_resident(*page);
                there = pages.iter().map(|(page, _)| *page).filter(resident).collect();
            })
            .unwrap();
            assert_eq!(flown.failed(), met, "{policy}: each is read once");
            assert!(share < 0.1 || met > 0, "{policy} met none of {}", corrupt.len());
            assert!(flown.settled_s.is_some(), "{policy} over {storage} never rests");
            // With the corrupt ones there as well, nothing would lack.
            let mut cells = with_roots(&library.index);
            pages.iter().filter(|(page, _)| there.contains(page) || corrupt.contains(page)).for_each(
                |(page, place)| {
                    cells.insert(&page_as_stored(*page, *place));
                },
            );
            let whole = select(&library.index, &cells, &flown.last.view, &PARAMS);
            assert_eq!(whole.stats.excess_max_px, 0.0, "{policy} over {storage}: more lacks than {met} corrupt pages");
            assert!(met > 0 || flown.last.report.excess_max_px == 0.0);
        }
    }
}

#[test]
fn frames_that_read_on_demand_wait_and_lack_nothing() {
    let library = library();
    let path = street_dive();
    for storage in [StorageModel::HDD, StorageModel::WAN] {
        let setup = Setup { sync_reads: true, ..with_policy(PolicyName::Demand, Setup::new(storage, STEP_S)) };
        let flown = flown(&library, &path, setup);
        let waited_s: f64 = flown.reports.iter().map(|report| report.waited_s).sum();
        let bytes: u64 = flown.reports.iter().map(|report| report.bytes_read).sum();
        for report in &flown.reports {
            assert_eq!((report.excess_max_px, report.debt_px, report.coverage), (0.0, 0.0, 1.0), "{report:?}");
            assert_eq!(report.waited_s > 0.0, report.would_have_waited, "{report:?}");
        }
        // All that came was waited for, and the storage gives it no faster.
        assert!(waited_s >= bytes as f64 / storage.bytes_per_sec, "{waited_s} s for {bytes} bytes");
    }
}

/// The page above, where that is no pinned one.
fn parent_of(page: PageId) -> Option<PageId> {
    let cell = page.cell.parent()?;
    let is_layer = match page.kind {
        PageKind::Terrain => cell.level() > 0,
        kind => kind == PageKind::Imagery,
    };
    is_layer.then_some(PageId { cell, ..page })
}

/// Pages that were resident in a frame while their parents were not, and all that came.
fn orphans(library: &Library, path: &Arc<FlightPath>, setup: Setup) -> (usize, usize) {
    let pages = pages_of(&library.index);
    let (mut came, mut alone) = (BTreeSet::new(), BTreeSet::new());
    fly(library, path, setup, |_, simulation| {
        for &(page, _) in pages.iter().filter(|(page, _)| simulation.manager().is_resident(*page)) {
            came.insert(page);
            if parent_of(page).is_some_and(|parent| !simulation.manager().is_resident(parent)) {
                alone.insert(page);
            }
        }
    })
    .unwrap();
    (alone.len(), came.len())
}

#[test]
fn without_level_skipping_parents_come_before_children_and_with_it_they_are_left_out() {
    let library = library();
    let path = dive(LAT_DEG, LON_DEG, [4e6, 600.0], -60.0, 2.0);
    let in_turn = |setup: Setup| Setup { planner: PlannerParams { level_skip: false, ..setup.planner }, ..setup };
    for policy in PolicyName::ALL {
        let setup = with_policy(policy, Setup::new(StorageModel::WAN, STEP_S));
        let (alone, _) = orphans(&library, &path, in_turn(setup));
        assert_eq!(alone, 0, "{policy}: children came before their parents");
        let (alone, _) = orphans(&library, &path, setup);
        assert!(alone > 0, "{policy}: no level was left out");
    }
    // An eye at rest that fetches nothing ahead needs less where levels are left out.
    let low = pose(LAT_DEG, LON_DEG, 600.0, 0.0, -60.0);
    let rest = self::path([(0.0, low), (2.0, low)]);
    let setup = with_policy(PolicyName::Demand, Setup::new(StorageModel::WAN, STEP_S));
    let ((_, came), (_, came_in_turn)) = (orphans(&library, &rest, setup), orphans(&library, &rest, in_turn(setup)));
    assert!(came < came_in_turn, "{came} and {came_in_turn} pages came");
}

#[test]
fn pages_of_one_range_come_one_by_one() {
    let library = library();
    // A picture takes 0.4 s, terrain 60 ms; ranges are up to 100 kB long.
    let storage: StorageModel = "2000,0.05,1".parse().unwrap();
    let setup = with_policy(PolicyName::Demand, Setup::new(storage, STEP_S));
    let rest =
        path([(0.0, pose(LAT_DEG, LON_DEG, 40e3, 0.0, -60.0)), (20.0, pose(LAT_DEG, LON_DEG, 40e3, 0.0, -60.0))]);
    let (mut before, mut pages, mut requests) = (None, 0, 0);
    fly(&library, &rest, setup, |frame, _| {
        let resident = frame.report.resident_pages;
        let came = resident - before.replace(resident).unwrap_or(resident);
        assert!(came <= 1, "{came} pages at once");
        (pages, requests) = (pages + came, requests + frame.report.requests);
    })
    .unwrap();
    assert!(requests > 1 && requests < pages, "{pages} pages by {requests} requests");
}

#[test]
fn foresight_is_ahead_of_demand_and_not_far_behind_who_knows_the_way() {
    let library = library();
    let dives = [3.0, 4.0, 6.0].map(|duration_s| dive(LAT_DEG, LON_DEG, [4e6, 600.0], -60.0, duration_s));
    let ways = [1, 2, 3, 4, 5].map(|seed| wander(seed, LAT_DEG, LON_DEG, 8.0));
    for path in dives.iter().chain(&ways) {
        let [demand, foresight, oracle] =
            [PolicyName::Demand, PolicyName::Foresight, PolicyName::Oracle].map(|policy| {
                flown(&library, path, with_policy(policy, Setup::new(StorageModel::WAN, STEP_S))).debt_px_s(2.0)
            });
        println!("over {} s: demand {demand:.4}, foresight {foresight:.4}, oracle {oracle:.4} px·s", path.duration_s());
        assert!(foresight <= demand && demand > 0.0, "{foresight} {demand}");
        assert!(oracle <= 1.05 * foresight + 0.01, "{oracle} {foresight}");
    }
}

#[test]
fn the_default_world_is_flown_by_every_policy() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tiles/default/world");
    let source = Source::of(World::open_whole(&folder).unwrap());
    let library = Library::new(source.index.clone(), source.reader.clone());
    let least = Simulation::least_footprint(&library.index);
    let path = dive(46.5, 8.5, [6e6, 30e3], -50.0, 3.0);
    for (policy, storage) in
        PolicyName::ALL.into_iter().flat_map(|policy| StorageModel::ALL.map(|model| (policy, model)))
    {
        for footprint in [least, ByteSize(least.0.max(64 * MIB))] {
            let flown = flown(&library, &path, with_policy(policy, Setup { footprint, ..Setup::new(storage, STEP_S) }));
            let last = &flown.last.report;
            assert!(flown.settled_s.is_some(), "{policy} over {storage} within {footprint}: {last:?}");
            assert!(last.lack == Lack::Memory || last.excess_max_px == 0.0, "{policy} over {storage}: {last:?}");
        }
    }
}

/// Frames from two seconds on in which a page of objects was due by its distance and could not be drawn, and how many
/// pages came due.
fn late_objects(library: &Library, path: &Arc<FlightPath>, setup: Setup) -> (usize, usize) {
    let (mut late, mut due) = (0, BTreeSet::new());
    let mut frames = 0;
    fly(library, path, setup, |frame, simulation| {
        let front = frame.selection.demands.iter().filter(|demand| demand.urgency == Urgency::Visible);
        let objects: Vec<PageId> =
            front.map(|demand| demand.page).filter(|page| matches!(page.kind, PageKind::Objects { .. })).collect();
        frames += 1;
        let is_late = objects.iter().any(|&page| !simulation.manager().is_resident(page));
        late += usize::from(is_late && f64::from(frames) * STEP_S > 2.0);
        due.extend(objects);
    })
    .unwrap();
    (late, due.len())
}

#[test]
fn what_is_due_at_its_distance_is_drawn_there_by_every_policy_that_looks_ahead() {
    let library = library();
    // Towards the city, from beyond the distance of all its objects, at 500 m/s.
    let way = (0..=60u32).map(|second| {
        let apart_m = 45_000.0 - 500.0 * f64::from(second);
        (f64::from(second), pose(LAT_DEG - apart_m / 111_000.0, LON_DEG, 800.0, 0.0, -5.0))
    });
    let path = path(way);
    for policy in [PolicyName::Front, PolicyName::Range, PolicyName::Vgis, PolicyName::Foresight, PolicyName::Demand] {
        let (late, due) = late_objects(&library, &path, with_policy(policy, Setup::new(StorageModel::LAN, STEP_S)));
        assert!(due >= 20, "{due} pages");
        // Who does not look ahead is late by one latency at each page or row of pages.
        assert_eq!(late > 0, policy == PolicyName::Demand, "{policy}: {late} frames");
    }
}
