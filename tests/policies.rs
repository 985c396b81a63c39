//! The published policies over made-up worlds: what they ask for ahead, in which order, and that the present front is
//! always asked for.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on should stop")]

mod made_up;

use made_up::{Plan, build, page, tops, view, with_roots};
use std::collections::BTreeSet;
use stoop::camera::View;
use stoop::cells::LiveTree;
use stoop::content::{PageId, PageKind};
use stoop::forest::CellId;
use stoop::forest::index::IndexForest;
use stoop::geodesy::{Geodetic, OrientedBox, SEMI_MAJOR_M};
use stoop::paging::{
    Command, Completion, Event, ForesightParams, Frame, Limits, Planner, PlannerParams, PolicyName, PolicyParams,
    RequestManager, ranked, service_order,
};
use stoop::select::{Demand, ObjectsMode, SelectParams, Urgency, ground_page, select};

const MIB: u64 = 1 << 20;
const LIMITS: Limits = Limits {
    footprint_bytes: 2048 * MIB,
    in_flight: 100,
    pages_in_flight: 1000,
    bytes_in_flight: u64::MAX,
    read_bytes_per_update: 4 * MIB,
    run_bytes: 0,
    gap_bytes: 0,
};
const SELECT: SelectParams = SelectParams { threshold_px: 20.0, objects: ObjectsMode::Cells, ..SelectParams::DEFAULT };
const STEP_S: f64 = 1.0 / 60.0;
const PUBLISHED: [PolicyName; 2] = [PolicyName::Front, PolicyName::Range];

/// Terrain and imagery to level 11 within 80 km of 0.7° N 20.3° E, and pages of objects of level 10 within 20 km.
fn world() -> IndexForest {
    let middle = Geodetic::from_degrees(0.7, 20.3, 0.0);
    let is_within = move |cell: CellId, m: f64| {
        let side_m = cell.bounds().height_rad() * SEMI_MAJOR_M;
        cell.bounds().center().to_ecef().distance_m(middle.to_ecef()) < m + side_m
    };
    let mut roots = vec![CellId::containing(middle.lat_rad, middle.lon_rad, 0)];
    for _ in 0..10 {
        roots = roots.iter().flat_map(|cell| cell.children()).filter(|&cell| is_within(cell, 20_000.0)).collect();
    }
    let refines = move |cell: CellId| cell.level() < 3 || (cell.level() < 11 && is_within(cell, 80_000.0));
    build(&Plan { terrain_refines: refines, imagery_refines: refines, object_roots: roots })
}

/// A run without engine: storage answers at once.
struct Run {
    /// All of the index, and what is resident of it.
    whole: IndexForest,
    index: IndexForest,
    cells: LiveTree,
    manager: RequestManager,
    planner: Planner,
    now_s: f64,
}

impl Run {
    fn new(policy: PolicyName, params: PolicyParams) -> Self {
        let whole = world();
        let (index, cells) = (whole.clone(), with_roots(&whole));
        let planner = Planner::new(&PlannerParams { policy, params, level_skip: true });
        Self { whole, index, cells, manager: RequestManager::new(LIMITS).unwrap(), planner, now_s: 0.0 }
    }

    fn paged(policy: PolicyName) -> Self {
        let run = Self::new(policy, PolicyParams::default());
        Self { index: tops(&run.whole), ..run }
    }

    /// Demands of the present front and of the policy.
    fn plan(&mut self, view: &View) -> (Vec<Demand>, Vec<Demand>) {
        let front = select(&self.index, &self.cells, view, &SELECT).demands;
        let frame = Frame {
            index: &self.index,
            cells: &self.cells,
            manager: &self.manager,
            view,
            now_s: self.now_s,
            step_s: STEP_S,
            params: &SELECT,
            drawn_tolerance_px: SELECT.tolerance_px,
        };
        let demands = self.planner.plan(&frame, &front);
        self.now_s += STEP_S;
        (front, demands)
    }

    fn insert(&mut self, id: PageId) {
        if id.kind == PageKind::Segment {
            let mut segments = self.whole.tree(id.cell.zone()).unwrap().segments();
            let segment = segments.find(|segment| segment.root() == id.cell).unwrap().clone();
            self.index.insert_segment(segment).unwrap();
        } else {
            self.cells.insert(&page(id));
        }
    }

    fn serve(&mut self, demands: &[Demand]) {
        for command in self.manager.update(demands, self.now_s) {
            match command {
                Command::Start(read) => {
                    for (id, _) in read.pages {
                        self.insert(id);
                        let completion = Completion::Loaded { bytes: 100_000 };
                        self.manager.complete(Event { page: id, completion }, self.now_s + STEP_S);
                    }
                }
                Command::Evict(id) => assert!(self.cells.remove(id)),
                Command::Cancel(id) => panic!("{id:?} is under way, where all is answered at once"),
            }
        }
    }

    /// Flies for so many frames and gives the demands of all.
    fn fly(&mut self, frames: u32, view_at: impl Fn(f64) -> View) -> Vec<(Vec<Demand>, Vec<Demand>)> {
        let frame = |at: u32| {
            let planned = self.plan(&view_at(f64::from(at) * STEP_S));
            self.serve(&planned.1);
            planned
        };
        (0..frames).map(frame).collect()
    }
}

fn dive(t_s: f64) -> View {
    view(0.7, 20.3 + 0.01 * t_s, 40_000.0 * (-t_s).exp(), 80.0, -60.0)
}

fn straight_on(t_s: f64) -> View {
    view(0.3 + 0.1 * t_s, 20.3, 6_000.0, 0.0, -35.0)
}

fn pan(t_s: f64) -> View {
    view(0.7, 20.3, 6_000.0, 40.0 * t_s, -25.0)
}

fn pages(demands: &[Demand]) -> BTreeSet<PageId> {
    demands.iter().map(|demand| demand.page).collect()
}

fn ahead(demands: &[Demand]) -> Vec<Demand> {
    ranked(demands).into_iter().filter(|demand| demand.urgency == Urgency::Predicted).collect()
}

#[test]
fn the_present_front_is_always_asked_for() {
    for policy in PUBLISHED {
        for way in [dive, straight_on, pan] {
            for (front, demands) in Run::new(policy, PolicyParams::default()).fly(45, way) {
                let ranked = ranked(&demands);
                // Which of the ground under the eye is asked for is the planner's choice.
                for wanted in front.iter().filter(|demand| demand.urgency == Urgency::Visible) {
                    let asked = ranked.iter().find(|demand| demand.page == wanted.page);
                    assert!(asked.is_some_and(|asked| asked.urgency >= wanted.urgency), "{policy}: {wanted:?}");
                }
                let mut visible = ranked.iter().filter(|demand| demand.urgency == Urgency::Visible);
                assert!(visible.all(|demand| front.contains(demand)), "{policy}: what is ahead is Predicted");
                assert!(demands.iter().all(|demand| demand.gain.is_finite() && demand.gain > 0.0));
            }
        }
    }
}

#[test]
fn the_same_flight_gives_the_same_demands() {
    for policy in PUBLISHED {
        let fly =
            || Run::new(policy, PolicyParams::default()).fly(40, |t_s| if t_s < 0.3 { dive(t_s) } else { pan(t_s) });
        assert_eq!(fly(), fly(), "{policy}");
    }
}

/// Of the pages that join the front after the first half of a second, how many were asked for before, and how many
/// joined.
fn foreseen(policy: PolicyName, way: fn(f64) -> View) -> (usize, usize) {
    let mut asked = BTreeSet::new();
    let (mut foreseen, mut joined) = (0, 0);
    let mut before = BTreeSet::new();
    for (at, (front, demands)) in Run::new(policy, PolicyParams::default()).fly(75, way).into_iter().enumerate() {
        let now = pages(&front);
        if at >= 30 {
            let new: Vec<_> = now.difference(&before).collect();
            joined += new.len();
            foreseen += new.into_iter().filter(|page| asked.contains(*page)).count();
        }
        asked.extend(pages(&demands));
        before.extend(now);
    }
    (foreseen, joined)
}

#[test]
fn what_comes_into_view_was_asked_for_before() {
    for policy in PUBLISHED {
        for (name, way) in [("dive", dive as fn(f64) -> View), ("straight on", straight_on), ("pan", pan)] {
            let (foreseen, joined) = foreseen(policy, way);
            assert!(joined >= 10, "{policy} {name}: the flight shows something new: {joined}");
            assert!(foreseen as f64 >= 0.9 * joined as f64, "{policy} {name}: {foreseen} of {joined}");
        }
    }
}

#[test]
fn a_steady_eye_gets_its_front_and_comes_to_rest() {
    for policy in PUBLISHED {
        let mut run = Run::new(policy, PolicyParams::default());
        run.fly(240, |_| straight_on(0.0));
        let before = run.manager.stats();
        run.fly(60, |_| straight_on(0.0));
        let after = run.manager.stats();
        assert_eq!((before.started, before.evicted), (after.started, after.evicted), "{policy}: nothing is read twice");
        assert!(before.ahead_bytes_started > 0, "{policy}");
    }
}

#[test]
fn segments_of_the_index_come_before_what_they_tell_of_and_before_they_are_needed() {
    for policy in PUBLISHED {
        let mut run = Run::paged(policy);
        let (mut asked, mut needed, mut foreseen) = (BTreeSet::new(), BTreeSet::new(), 0);
        for (at, (front, demands)) in run.fly(150, pan).into_iter().enumerate() {
            let ahead = ahead(&demands);
            let first_other = ahead.iter().position(|demand| demand.page.kind != PageKind::Segment);
            let others = ahead.iter().skip(first_other.unwrap_or(ahead.len()));
            assert_eq!(others.filter(|demand| demand.page.kind == PageKind::Segment).count(), 0, "{policy}");
            let now: BTreeSet<_> = pages(&front).into_iter().filter(|page| page.kind == PageKind::Segment).collect();
            let new = now.difference(&needed).filter(|page| at >= 5 && asked.contains(*page)).count();
            foreseen += new;
            needed.extend(now);
            asked.extend(pages(&demands));
        }
        assert!(foreseen >= 2, "{policy}: {foreseen} of {}", needed.len());
        // The front is in the end what it is with the whole index.
        let last = pan(150.0 * STEP_S);
        run.fly(30, |_| last);
        let of = |index: &IndexForest| {
            let ground = |page: &PageId| page.kind != PageKind::Segment;
            pages(&select(index, &run.cells, &last, &SELECT).demands).into_iter().filter(ground).collect::<Vec<_>>()
        };
        assert_eq!(of(&run.index), of(&run.whole), "{policy}");
    }
}

/// |δ − Priority| / δ of the rep at a cell, reckoned anew.
fn distance(index: &IndexForest, view: &View, cell: CellId, kind: PageKind, theta1_rad: f64) -> f64 {
    let node = index.find(cell).unwrap();
    let (low_m, high_m) = node.height_range_m();
    let around = OrientedBox::around(&cell.bounds(), low_m, high_m);
    let error_px = ground_page(&node, kind).unwrap().1 * view.projected_px(1.0, around.distance_m(view.eye()));
    let theta_rad = view.forward().angle_between((around.center - view.eye()).xyz());
    let half_y = (view.fov_y_rad / 2.0).tan();
    let theta0_rad = half_y.hypot(half_y * view.aspect()).atan();
    let angular = 1.0 / (1.0 + (theta_rad - theta0_rad).max(0.0) / theta1_rad);
    let priority = if error_px <= SELECT.tolerance_px { error_px * angular } else { error_px / angular };
    (SELECT.tolerance_px - priority).abs() / SELECT.tolerance_px
}

#[test]
fn front_serves_children_and_parents_by_bins_of_their_distance_to_the_tolerance() {
    let mut params = PolicyParams::default();
    params.front.levels = 1;
    params.front.bins = 8;
    // No wider than the view, so that nothing is there for pans.
    params.front.least_pan_rad = 0.0;
    let mut run = Run::new(PolicyName::Front, params);
    let view = straight_on(0.0);
    let (front, demands) = run.plan(&view);
    let front = pages(&front);
    let (mut children, mut parents, mut last_bin) = (0, 0, 0);
    for demand in ahead(&demands) {
        let PageId { cell, kind } = demand.page;
        let is_child = cell.parent().is_some_and(|cell| front.contains(&PageId { cell, kind }));
        let is_parent = cell.children().any(|cell| front.contains(&PageId { cell, kind }));
        let source = if is_child && !is_parent { cell.parent() } else { Some(cell) };
        if !(is_child ^ is_parent) || matches!(kind, PageKind::Objects { .. }) {
            continue;
        }
        let wide = distance(&run.index, &view, source.unwrap(), kind, params.front.theta1_rad);
        let bin = (wide * 8.0).min(7.0) as u32;
        assert!(bin >= last_bin, "{cell} {kind:?}: bin {bin} after {last_bin}");
        last_bin = bin;
        children += u32::from(is_child);
        parents += u32::from(is_parent);
    }
    assert!(children > 50 && parents > 5, "{children} children, {parents} parents");
    assert!(last_bin > 2);
}

#[test]
fn front_goes_on_from_what_it_has_prefetched() {
    let deepest_below = |levels: u32| {
        let mut params = PolicyParams::default();
        params.front.levels = levels;
        let mut run = Run::new(PolicyName::Front, params);
        let still = |_: f64| view(0.7, 20.3, 40_000.0, 0.0, -90.0);
        let (front, demands) = run.fly(200, still).pop().unwrap();
        let visible: BTreeSet<_> = front.iter().filter(|demand| demand.urgency == Urgency::Visible).collect_pages();
        let below = |page: &PageId| {
            let above = page.cell.ancestors().skip(1).position(|cell| visible.contains(&PageId { cell, ..*page }));
            above.map_or(0, |levels| levels + 1)
        };
        pages(&ahead(&demands)).iter().map(below).max().unwrap_or(0)
    };
    assert_eq!([0, 1, 2, 3].map(deepest_below), [0, 1, 2, 3]);
}

trait CollectPages {
    fn collect_pages(self) -> BTreeSet<PageId>;
}

impl<'a, I: Iterator<Item = &'a Demand>> CollectPages for I {
    fn collect_pages(self) -> BTreeSet<PageId> {
        self.map(|demand| demand.page).collect()
    }
}

#[test]
fn front_asks_for_objects_before_they_pass_the_threshold() {
    // An object of 60 m is 20 px high at 935 m with this lens; from 1,200 m it is below that.
    let objects = |height_m: f64, objects_from: f64| {
        let mut params = PolicyParams::default();
        params.front.objects_from = objects_from;
        let (front, demands) = Run::new(PolicyName::Front, params).plan(&view(0.7, 20.3, height_m + 120.0, 0.0, -90.0));
        let of_objects = |page: &&PageId| matches!(page.kind, PageKind::Objects { .. });
        [front, ahead(&demands)].map(|demands| pages(&demands).iter().filter(of_objects).count())
    };
    assert_eq!(objects(1_200.0, 0.9), [0, 0]);
    let [present, ahead] = objects(1_200.0, 0.5);
    assert!(present == 0 && ahead > 0);
    assert!(objects(800.0, 0.5)[0] > 0);
}

#[test]
fn range_reads_coarse_to_fine_and_then_by_time() {
    let mut run = Run::new(PolicyName::Range, PolicyParams::default());
    // Nothing is there but the roots, and the eye is at rest: what is ahead is what is seen from its own cell.
    let (_, demands) = run.plan(&straight_on(0.0));
    let ahead = ahead(&demands);
    assert!(ahead.is_sorted_by(|a, b| service_order(a, b).is_lt()));
    // What the front wants is the finest; two levels above it come before it.
    let wanted = pages(&ahead);
    let height = |page: &PageId| {
        (1..=2).rev().find(|&up| {
            wanted.iter().any(|below| {
                below.kind == page.kind
                    && below.cell.level() == page.cell.level() + up
                    && page.cell.contains(below.cell)
            })
        })
    };
    let heights: Vec<u8> = ahead.iter().map(|demand| height(&demand.page).unwrap_or(0)).collect();
    assert!(heights.is_sorted_by(|a, b| a >= b), "{heights:?}");
    assert!(heights.contains(&0) && heights.contains(&1) && heights.contains(&2));
}

#[test]
fn range_closes_its_set_by_bytes_and_by_memory() {
    let ahead_pages = |bytes_factor: f64, memory_share: f64| {
        let mut params = PolicyParams::default();
        (params.range.bytes_factor, params.range.memory_share) = (bytes_factor, memory_share);
        let mut run = Run::new(PolicyName::Range, params);
        let (_, demands) = run.plan(&straight_on(0.0));
        let bytes: u64 = ahead(&demands).iter().map(|demand| u64::from(demand.place.len)).sum();
        (ahead(&demands).len(), bytes)
    };
    let all = ahead_pages(1e3, 1.0);
    // 60 frames at the 20 MB/s that are taken for the rate before anything came.
    let (_, bytes) = ahead_pages(0.02, 1.0);
    assert!(bytes <= 400_000 + u64::from(made_up::IMAGERY_LEN) && bytes > 300_000, "{bytes} bytes");
    let (held, _) = ahead_pages(1e3, 0.005);
    assert!(held > 0 && held < all.0 / 2, "{held} of {}", all.0);
}

#[test]
fn parameters_go_through_json_and_unknown_keys_are_refused() {
    let mut params = PolicyParams::default();
    params.front.theta1_rad = 0.125;
    params.range.cells = 7;
    let text = serde_json::to_string(&params).unwrap();
    assert_eq!(serde_json::from_str::<PolicyParams>(&text).unwrap(), params);
    let some = serde_json::from_str::<PolicyParams>(r#"{"front": {"bins": 4}, "range": {"frames": 10}}"#).unwrap();
    assert_eq!((some.front.bins, some.range.frames), (4, 10));
    assert_eq!(some.vgis, PolicyParams::default().vgis);
    for unknown in [r#"{"front": {"bin": 4}}"#, r#"{"range": {"frame": 4}}"#, r#"{"fronts": {}}"#] {
        assert!(serde_json::from_str::<PolicyParams>(unknown).is_err(), "{unknown}");
    }
}

#[test]
fn wild_parameters_do_no_harm() {
    let wild = [
        r#"{"front": {"bins": 0, "levels": 1000000, "theta1_rad": 0, "look_ahead_s": 1e300, "pan_gain": -5,
            "objects_from": 7, "replan_s": 0}}"#,
        r#"{"range": {"frames": 0, "cells": 0, "sectors": 0, "v_r_rad_per_s": -1, "bytes_factor": -1, "surveys": 0}}"#,
        r#"{"range": {"frames": 4000000000, "cells": 4000000000, "sectors": 4000000000, "share_of_measured_speed": 0,
            "bytes_factor": 1e300, "memory_share": 1e300, "coarser_levels": 4000000000, "replan_s": -1}}"#,
    ];
    for text in wild {
        let params = serde_json::from_str::<PolicyParams>(text).unwrap();
        for policy in PUBLISHED {
            for (front, demands) in Run::new(policy, params).fly(3, pan) {
                assert!(
                    pages(&demands)
                        .is_superset(&front.iter().filter(|d| d.urgency == Urgency::Visible).collect_pages())
                );
                assert!(demands.iter().all(|demand| demand.gain.is_finite()));
            }
        }
    }
}

#[test]
fn parameters_that_a_file_leaves_out_are_the_policys_own() {
    let params: PolicyParams = serde_json::from_str(r#"{"oracle": {"views": 3}, "foresight": {"widen": 2}}"#).unwrap();
    let expected = PolicyParams::default();
    assert_eq!(params.oracle, ForesightParams { views: 3, ..expected.oracle });
    assert_eq!(params.foresight, ForesightParams { widen: 2.0, ..expected.foresight });
    assert!(serde_json::from_str::<PolicyParams>(r#"{"oracle": {"view": 3}}"#).is_err());
}
