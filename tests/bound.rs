//! The lower bound of debt: nothing that is really resident, and no policy, falls below it; and it is no trivial bound.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on should stop")]

mod made_up;

use made_up::flights::wander;
use made_up::random::{AnyPage, Shape, page_as_stored, pages_of, unit};
use made_up::{Plan, build, view, with_roots};
use proptest::prelude::*;
use std::collections::{BTreeSet, HashMap};
use std::path::Path;
use std::sync::Arc;
use stoop::camera::View;
use stoop::cells::LiveTree;
use stoop::content::{PageId, PageKind};
use stoop::engine::Source;
use stoop::forest::CellId;
use stoop::forest::index::{IndexForest, Place};
use stoop::paging::{PlannerParams, PolicyName, held_bytes, least_held_bytes};
use stoop::select::{LAYERS, SelectParams, layer_of, select, select_raised, survey};
use stoop::simulate::{Budget, FrameBound, Library, Setup, Simulation, bytes_by, fly};
use stoop::storage::{Disk, Faults, PartOutcome, REQUEST_BYTES_MAX, Request, StorageModel};
use stoop::store::World;
use stoop::units::ByteSize;

const LAT_DEG: f64 = 20.0;
const LON_DEG: f64 = 30.0;
/// Sums of the same numbers in another order.
const ROUNDING: f64 = 1e-9;
const ANY: Budget = Budget { read_bytes: f64::INFINITY, held_bytes: u64::MAX };

fn params(tolerance_px: f64) -> SelectParams {
    SelectParams { tolerance_px, ..SelectParams::DEFAULT }
}

fn shape(seed: u64, refined: f64) -> Shape {
    Shape { seed, lat_deg: LAT_DEG, lon_deg: LON_DEG, finest: 13, refined, objects: 0.3, longest: 60_000 }
}

fn any_shape() -> impl Strategy<Value = Shape> {
    let numbers = (any::<u64>(), 5u8..15, 0.5f64..1.0, 0.0f64..0.6, 100u32..100_000);
    numbers.prop_map(|(seed, finest, refined, objects, longest)| Shape {
        finest,
        objects,
        longest,
        ..shape(seed, refined)
    })
}

fn any_view() -> impl Strategy<Value = View> {
    let numbers = (1.5f64..6.5, -1.0f64..1.0, -1.0f64..1.0, 0.0f64..360.0, -90.0f64..5.0);
    numbers.prop_map(|(log_height, north, east, heading_deg, pitch_deg)| {
        let height_m = 10f64.powf(log_height);
        let off_deg = (height_m / 111e3).min(4.0);
        view(LAT_DEG + off_deg * north, LON_DEG + off_deg * east, height_m, heading_deg, pitch_deg)
    })
}

/// What is resident beside the pinned pages.
struct Held {
    cells: LiveTree,
    pages: BTreeSet<PageId>,
    stored_bytes: f64,
    held_bytes: u64,
}

impl Held {
    fn nothing(index: &IndexForest) -> Self {
        Self { cells: with_roots(index), pages: BTreeSet::new(), stored_bytes: 0.0, held_bytes: 0 }
    }

    fn add(&mut self, page: PageId, place: Place) {
        if self.pages.insert(page) {
            self.cells.insert(&page_as_stored(page, place));
            self.stored_bytes += f64::from(place.len);
            self.held_bytes += least_held_bytes(page.kind, place);
        }
    }

    /// With the budgets that these pages just fit, each alone and both, the bound is not above the debt.
    fn check(&self, index: &IndexForest, view: &View, params: &SelectParams, bound: &FrameBound, drawn_px: f64) {
        let debt_px = select_raised(index, &self.cells, view, params, drawn_px).stats.debt_px;
        let (read_bytes, held_bytes) = (self.stored_bytes, self.held_bytes);
        for budget in [Budget { read_bytes, ..ANY }, Budget { held_bytes, ..ANY }, Budget { read_bytes, held_bytes }] {
            let bound_px = bound.debt_px(&budget);
            assert!(
                bound_px <= debt_px * (1.0 + ROUNDING) + 1e-12,
                "{} pages within {budget:?} leave {debt_px} px, below the bound {bound_px} px",
                self.pages.len()
            );
        }
    }
}

/// The page that lowers the debt most per byte, as far as single pages tell; `None` when none does.
fn best_bargain(index: &IndexForest, held: &Held, view: &View, params: &SelectParams) -> Option<(PageId, Place)> {
    let mut falls: HashMap<PageId, (Place, f64)> = HashMap::new();
    survey(index, &held.cells, view, params, params.tolerance_px, |region| {
        let excess_px = |error_px: f64| region.excess_px(error_px, params.tolerance_px);
        for (at, rep) in region.chain.iter().enumerate() {
            let fall_px = excess_px(region.drawn_px) - excess_px(region.error_px(Some(at)));
            let page = rep.page();
            if fall_px > 0.0 && !held.pages.contains(&page) {
                falls.entry(page).or_insert((rep.place, 0.0)).1 += region.share * fall_px;
            }
        }
    });
    let worth = |(place, fall_px): (Place, f64)| fall_px / f64::from(place.len);
    let best = falls.into_iter().filter(|(_, fall)| fall.1 > 0.0);
    let best = best.max_by(|a, b| worth(a.1).total_cmp(&worth(b.1)).then(a.0.cmp(&b.0)))?;
    Some((best.0, best.1.0))
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 96, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn no_set_of_pages_beats_the_bound(
        shape in any_shape(), view in any_view(), tolerance_px in 0.3f64..8.0, seed in any::<u64>(), share in 0.0f64..1.0,
        raised in 1.0f64..3.0
    ) {
        let index = shape.build();
        let params = params(tolerance_px);
        let bound = FrameBound::new(&index, &view, &params);
        // Pages of every level, those behind the eye and finer than the front too, with holes in all chains.
        let mut held = Held::nothing(&index);
        for (number, (page, place)) in pages_of(&index).into_iter().enumerate() {
            if unit(seed, number as u64) < share {
                held.add(page, place);
            }
        }
        held.check(&index, &view, &params, &bound, tolerance_px);
        held.check(&index, &view, &params, &bound, tolerance_px * raised);
    }

    #[test]
    fn greed_does_not_beat_the_bound(shape in any_shape(), view in any_view(), tolerance_px in 0.3f64..8.0) {
        let index = shape.build();
        let params = params(tolerance_px);
        let bound = FrameBound::new(&index, &view, &params);
        let mut held = Held::nothing(&index);
        held.check(&index, &view, &params, &bound, tolerance_px);
        for _ in 0..60 {
            let Some((page, place)) = best_bargain(&index, &held, &view, &params) else { break };
            held.add(page, place);
            held.check(&index, &view, &params, &bound, tolerance_px);
        }
    }

    #[test]
    fn the_bound_falls_from_the_debt_of_the_pinned_pages_to_nothing(
        shape in any_shape(), view in any_view(), tolerance_px in 0.3f64..8.0
    ) {
        let index = shape.build();
        let params = params(tolerance_px);
        let bound = FrameBound::new(&index, &view, &params);
        let all_bytes: u64 = pages_of(&index).iter().map(|(page, place)| least_held_bytes(page.kind, *place)).sum();
        let pinned_px = select(&index, &with_roots(&index), &view, &params).stats.debt_px;
        let by_read = |bytes: f64| bound.debt_px(&Budget { read_bytes: bytes, ..ANY });
        let by_held = |bytes: u64| bound.debt_px(&Budget { held_bytes: bytes, ..ANY });
        for none_px in [by_read(0.0), by_held(0)] {
            prop_assert!((none_px - pinned_px).abs() <= ROUNDING * pinned_px, "{} {}", none_px, pinned_px);
        }
        prop_assert_eq!((by_read(all_bytes as f64), by_held(all_bytes), bound.debt_px(&ANY)), (0.0, 0.0, 0.0));
        let sixteenths: Vec<u64> = (0..=16).map(|part| all_bytes * part / 16).collect();
        for pair in sixteenths.windows(2) {
            prop_assert!(by_read(pair[1] as f64) <= by_read(pair[0] as f64) && by_held(pair[1]) <= by_held(pair[0]));
            // Each of two budgets alone is weaker than both.
            let both = bound.debt_px(&Budget { read_bytes: pair[0] as f64, held_bytes: pair[1] });
            prop_assert_eq!(both, by_read(pair[0] as f64).max(by_held(pair[1])));
        }
    }
}

/// Pages of objects side by side over the zones' pictures, and nothing else that could be cured.
fn objects_alone() -> IndexForest {
    let middle = CellId::containing(LAT_DEG.to_radians(), LON_DEG.to_radians(), 12);
    let (x, y) = middle.xy();
    let offsets = (0..100).map(|n| (n % 10, n / 10));
    let object_roots = offsets.filter_map(|(dx, dy)| CellId::new(middle.zone(), 12, x + dx - 5, y + dy)).collect();
    build(&Plan { terrain_refines: |_| false, imagery_refines: |_| false, object_roots })
}

#[test]
fn where_each_page_serves_one_region_the_bound_is_reached() {
    let (index, params) = (objects_alone(), params(1.0));
    for (height_m, pitch_deg) in [(1000.0, -10.0), (3000.0, -40.0), (9000.0, -80.0)] {
        let view = view(LAT_DEG, LON_DEG, height_m, 0.0, pitch_deg);
        let bound = FrameBound::new(&index, &view, &params);
        let mut held = Held::nothing(&index);
        let (mut wanted, mut shares) = (Vec::new(), [0.0; LAYERS]);
        survey(&index, &held.cells, &view, &params, params.tolerance_px, |region| {
            let layer = layer_of(region.kind).unwrap();
            shares[layer] += region.share;
            if region.kind != PageKind::Terrain {
                let page = PageId { cell: region.cell, kind: region.kind };
                let fall_px = region.share * region.excess_px(region.absent_px, 1.0);
                wanted.push((layer, fall_px, page, region.chain[0].place));
            }
        });
        let worth =
            |&(layer, fall_px, _, place): &(usize, f64, _, Place)| fall_px / shares[layer] / f64::from(place.len);
        wanted.sort_by(|a, b| worth(b).total_cmp(&worth(a)));
        assert!(wanted.len() > 10, "{} pages are wanted", wanted.len());
        let mut before_px = f64::INFINITY;
        let first_px = select(&index, &held.cells, &view, &params).stats.debt_px;
        for (_, _, page, place) in wanted.into_iter().filter(|(_, fall_px, ..)| *fall_px > 0.0) {
            let debt_px = select(&index, &held.cells, &view, &params).stats.debt_px;
            let bound_px = bound.debt_px(&Budget { read_bytes: held.stored_bytes, ..ANY });
            assert!((bound_px - debt_px).abs() <= ROUNDING * first_px, "{bound_px} {debt_px}");
            assert!(debt_px > 0.0 && debt_px < before_px);
            before_px = debt_px;
            held.add(page, place);
        }
        assert_eq!(select(&index, &held.cells, &view, &params).stats.debt_px, 0.0);
    }
}

/// A policy that asks for any pages in any order over a disk, and gives up some of them.
struct Chance {
    seed: u64,
    draws: u64,
    under_way: HashMap<u64, Vec<(PageId, Place)>>,
}

impl Chance {
    fn unit(&mut self) -> f64 {
        self.draws += 1;
        unit(self.seed, self.draws)
    }

    /// A run of pages that lie one behind the other, as long as it stays one request.
    fn run(&mut self, pages: &[(PageId, Place)]) -> Vec<(PageId, Place)> {
        let first = (self.unit() * pages.len() as f64) as usize;
        let most = 1 + (self.unit() * 30.0) as usize;
        let from = pages[first];
        let end = |place: Place| place.offset + u64::from(place.len);
        let fits = |(page, place): &&(PageId, Place)| {
            page.cell.zone() == from.0.cell.zone() && end(*place) - from.1.offset <= REQUEST_BYTES_MAX
        };
        pages[first..].iter().take(most).take_while(fits).copied().collect()
    }

    fn ask(&mut self, disk: &mut Disk, pages: &[(PageId, Place)], now_s: f64) {
        let run = self.run(pages);
        let offset = run[0].1.offset;
        let parts = run.iter().map(|(_, place)| place.offset + u64::from(place.len) - offset).collect();
        let file = run[0].0.cell.zone().index() as u32;
        let id = self.draws;
        if disk.start(Request { id, file, offset, parts }, now_s) {
            self.under_way.insert(id, run);
        }
    }
}

fn any_model() -> impl Strategy<Value = StorageModel> {
    let custom = (0.0f64..100.0, -1.0f64..3.0, 1usize..8)
        .prop_map(|(ms, log_mb, parallel)| format!("{ms},{},{parallel}", 10f64.powf(log_mb)).parse().unwrap());
    prop_oneof![prop::sample::select(StorageModel::ALL.to_vec()), custom]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn whatever_is_asked_of_a_disk_the_bound_of_its_time_holds(
        shape in any_shape(), view in any_view(), model in any_model(), seed in any::<u64>()
    ) {
        let index = shape.build();
        let params = params(1.0);
        let bound = FrameBound::new(&index, &view, &params);
        let mut pages = pages_of(&index);
        pages.sort_by_key(|(page, place)| (page.cell.zone(), place.offset));
        let mut disk = Disk::new(model, Faults::NONE, seed);
        let mut chance = Chance { seed, draws: 0, under_way: HashMap::new() };
        let mut held = Held::nothing(&index);
        for frame in 0..40 {
            let now_s = f64::from(frame) / 60.0;
            for arrival in disk.advance(now_s).into_iter().filter(|arrival| arrival.outcome == PartOutcome::Ok) {
                let (page, place) = chance.under_way[&arrival.id][arrival.part];
                held.add(page, place);
            }
            let budget = Budget { read_bytes: bytes_by(&model, now_s), ..ANY };
            prop_assert!(held.stored_bytes <= budget.read_bytes * (1.0 + ROUNDING), "{} by {}", held.stored_bytes, now_s);
            let debt_px = select(&index, &held.cells, &view, &params).stats.debt_px;
            prop_assert!(bound.debt_px(&budget) <= debt_px * (1.0 + ROUNDING) + 1e-12);
            for _ in 0..(chance.unit() * 8.0) as u32 {
                chance.ask(&mut disk, &pages, now_s);
            }
            if chance.unit() < 0.2 {
                let given_up = chance.under_way.keys().copied().min();
                given_up.into_iter().for_each(|id| { disk.cancel(id, now_s); });
            }
        }
    }
}

/// Every frame of a flight stays above its bound; gives the sums of debt and bound, px·frames.
fn check_flight(library: &Library, seed: u64, setup: Setup) -> (f64, f64) {
    let path = wander(seed, LAT_DEG, LON_DEG, 3.0);
    let mut sums = (0.0, 0.0);
    fly(library, &path, Setup { bound: true, ..setup }, |frame, _| {
        let (debt_px, bound_px) = (frame.report.debt_px, frame.report.debt_bound_px.unwrap());
        let policy = setup.planner.policy;
        assert!(
            bound_px <= debt_px * (1.0 + ROUNDING) + 1e-12,
            "{policy} over {} is at {debt_px} px at {} s, below the bound {bound_px} px",
            setup.storage,
            frame.report.t_s
        );
        sums = (sums.0 + debt_px, sums.1 + bound_px);
        true
    })
    .unwrap();
    sums
}

#[test]
fn no_policy_beats_the_bound() {
    let mut bound_px = 0.0;
    for (number, policy) in PolicyName::ALL.into_iter().enumerate() {
        let seed = number as u64;
        let index = shape(seed, 0.9).build();
        let least = Simulation::least_footprint(&index);
        let library = Library::new(index, Arc::new(AnyPage));
        for (storage, mib) in [(StorageModel::HDD, 0), (StorageModel::LAN, 4), (StorageModel::MOBILE, 256)] {
            let planner = PlannerParams { policy, level_skip: number % 2 == 0, ..PlannerParams::default() };
            let footprint = ByteSize(least.0 + (mib << 20));
            let setup = Setup { planner, footprint, ..Setup::new(storage, 1.0 / 30.0) };
            bound_px += check_flight(&library, seed, setup).1;
            let faults = "errors=0.05,spike_ms=300,spikes=0.1".parse().unwrap();
            check_flight(&library, seed, Setup { faults, sync_reads: number == 0, ..setup });
        }
    }
    assert!(bound_px > 1.0, "the bound says something: {bound_px} px·frames");
}

#[test]
fn no_page_of_a_real_world_is_smaller_than_the_bound_counts() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tiles/default/world");
    let source = Source::of(World::open_whole(&folder).unwrap());
    let pages = pages_of(&source.index);
    assert!(pages.len() > 100);
    for (page, place) in pages {
        let held = held_bytes(&source.reader.load(page, place).unwrap());
        assert!(held >= least_held_bytes(page.kind, place), "{page:?} of {} bytes holds {held}", place.len);
    }
}
