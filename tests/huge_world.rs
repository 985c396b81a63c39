//! A world of a hundred million cells, whose index comes in segments and whose pages are answered by a function, is
//! flown over by the virtual clock like a small one.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on should stop")]

mod made_up;

use made_up::flights::dive;
use made_up::random::page_as_stored;
use std::collections::BTreeMap;
use std::sync::Arc;
use stoop::camera::View;
use stoop::content::{Page, PageId, PageKind};
use stoop::forest::index::Place;
use stoop::forest::index::synthetic::{Near, SyntheticForest};
use stoop::forest::{CellId, LEVEL_MAX};
use stoop::geodesy::Geodetic;
use stoop::paging::{FrameReport, PageReader, PlannerParams, PolicyName, ReadError};
use stoop::select::Urgency;
use stoop::simulate::{Library, Setup, Simulation};
use stoop::storage::StorageModel;
use stoop::units::ByteSize;

const LAT_DEG: f64 = 33.755;
const LON_DEG: f64 = -84.39;
const STEP_S: f64 = 1.0 / 30.0;
const SMALL: u64 = 100_000;
const HUGE: u64 = 100_000_000;
/// Bytes of the index that stay in memory at [`HUGE`] cells: 32 a segment of the directories, and the zones' tops.
const INDEX_BYTES_MAX: usize = 16 << 20;
/// Bytes of further segments on the way down.
const PAGED_BYTES_MAX: usize = 4 << 20;

/// Footprint beside the index that stays.
const ROOM_BYTES: u64 = 128 << 20;

struct Synthetic(SyntheticForest);

impl PageReader for Synthetic {
    fn load(&self, page: PageId, place: Place) -> Result<Page, ReadError> {
        let broken = || ReadError::Broken(format!("there is no segment {}", page.cell));
        match page.kind {
            PageKind::Segment => Ok(Page::Segment(self.0.segment(page.cell).ok_or_else(broken)?)),
            _ => Ok(page_as_stored(page, place)),
        }
    }
}

fn library(nodes: u64) -> Library {
    let place = Geodetic::from_degrees(LAT_DEG, LON_DEG, 0.0);
    let forest = SyntheticForest::new(Near { place, finest_level: 19, radius_cells: 8 }, nodes).unwrap();
    assert_eq!(forest.node_count(), nodes);
    Library::new(forest.index().clone(), Arc::new(Synthetic(forest)))
}

/// What a frame of the dive did.
struct Step {
    report: FrameReport,
    /// By urgency.
    demands: BTreeMap<Urgency, usize>,
}

/// A dive to the refined place, and a rest there until all is there.
fn dive_down(library: &Library, policy: PolicyName) -> Vec<Step> {
    let planner = PlannerParams { policy, ..PlannerParams::default() };
    // The same room for pages, however large the index.
    let footprint = ByteSize(ROOM_BYTES + library.index.bytes().fixed() as u64);
    let setup = Setup { planner, footprint, ..Setup::new(StorageModel::WAN, STEP_S) };
    let path = dive(LAT_DEG, LON_DEG, [10e6, 20.0], -70.0, 10.0);
    let mut simulation = Simulation::new(library, setup).unwrap();
    let mut steps: Vec<Step> = Vec::new();
    let mut was_there: BTreeMap<CellId, bool> = BTreeMap::new();
    for number in 0..900u32 {
        let t_s = f64::from(number) * STEP_S;
        let view = View::new(path.at(t_s), path.fovy_rad(), setup.size_px);
        let frame = simulation.frame(&view, t_s);
        assert!(frame.report.footprint_bytes <= setup.footprint.0);
        let manager = simulation.manager();
        for segment in segments_above(library) {
            was_there.insert(segment, manager.is_resident(PageId { cell: segment, kind: PageKind::Segment }));
        }
        // Nothing of a segment is drawn or asked for before the segment itself is there.
        for page in frame.selection.demands.iter().map(|demand| demand.page) {
            let above = segments_towards(page.cell).filter(|&root| page.kind != PageKind::Segment || root != page.cell);
            for root in above {
                let segment = PageId { cell: root, kind: PageKind::Segment };
                assert!(manager.is_resident(segment), "{page:?} is asked for before {root}");
            }
        }
        let mut demands = BTreeMap::new();
        frame.selection.demands.iter().for_each(|demand| *demands.entry(demand.urgency).or_insert(0) += 1);
        steps.push(Step { report: frame.report, demands });
        if t_s > path.duration_s() && simulation.is_settled() {
            break;
        }
    }
    let paged = was_there.values().filter(|there| **there).count();
    assert_eq!(paged, was_there.len(), "all segments under the eye have come");
    steps
}

/// Roots of the segments on the way to a cell, the zone's left out.
fn segments_towards(cell: CellId) -> impl Iterator<Item = CellId> {
    (6..=cell.level()).step_by(6).filter_map(move |level| cell.ancestor(level))
}

/// Those under the eye.
fn segments_above(library: &Library) -> Vec<CellId> {
    let cell = CellId::containing(LAT_DEG.to_radians(), LON_DEG.to_radians(), LEVEL_MAX);
    segments_towards(cell).filter(|root| library.index.segment(*root).is_some()).collect()
}

#[test]
fn a_hundred_million_cells_are_dived_into() {
    let library = library(HUGE);
    let bytes = library.index.bytes();
    assert!(bytes.fixed() < INDEX_BYTES_MAX && bytes.total() > 50 * INDEX_BYTES_MAX, "{bytes:?}");
    for policy in [PolicyName::Foresight, PolicyName::Demand] {
        let steps = dive_down(&library, policy);
        let last = &steps[steps.len() - 1].report;
        assert!(steps.len() > 300 && steps.len() < 900, "{policy} took {} frames", steps.len());
        assert_eq!((last.debt_px, last.excess_max_px, last.pages_missing), (0.0, 0.0, 0), "{policy}");
        assert!(steps.iter().any(|step| step.report.debt_px > 0.0), "{policy}: nothing had to come");
    }
    assert!(library.index.bytes() == bytes, "a flight changes its own copy of the index alone");
}

#[test]
fn what_lies_far_away_costs_nothing() {
    for policy in [PolicyName::Foresight, PolicyName::Demand] {
        let [small, huge] = [SMALL, HUGE].map(|nodes| dive_down(&library(nodes), policy));
        assert_eq!(small.len(), huge.len(), "{policy}");
        for (a, b) in small.iter().zip(&huge) {
            let work = |step: &Step| {
                let report = &step.report;
                let tested = (report.cells_tested, report.cells_culled, report.cells_drawn, report.triangles);
                (tested, report.bytes_read, report.requests, report.seeks, step.demands.clone())
            };
            assert_eq!(work(a), work(b), "{policy} at {} s", a.report.t_s);
        }
    }
}

#[test]
fn segments_on_the_way_take_little() {
    let place = Geodetic::from_degrees(LAT_DEG, LON_DEG, 0.0);
    let forest = SyntheticForest::new(Near { place, finest_level: 19, radius_cells: 8 }, HUGE).unwrap();
    let mut index = forest.index().clone();
    let middle = CellId::containing(LAT_DEG.to_radians(), LON_DEG.to_radians(), 19);
    for (dx, dy) in (0..17).flat_map(|dx| (0..17).map(move |dy| (dx, dy))) {
        let (x, y) = (middle.xy().0 + dx - 8, middle.xy().1 + dy - 8);
        forest.insert_towards(&mut index, CellId::new(middle.zone(), 19, x, y).unwrap()).unwrap();
    }
    let bytes = index.bytes();
    assert!(bytes.paged > 0 && bytes.paged < PAGED_BYTES_MAX, "{bytes:?}");
}
