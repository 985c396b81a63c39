//! Policies over flights and storage models, by the virtual clock: the same flight for each, side by side.

use crate::camera::{FlightPath, View};
use crate::paging::{FrameReport, PlannerParams, PolicyName};
use crate::record::SHARP_COVERAGE;
use crate::simulate::{FrameBound, Library, Setup, Simulation, SimulationError, fly};
use crate::storage::StorageModel;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::sync::Arc;

/// The cold start, which is told apart, seconds.
pub const WARM_S: f64 = 2.0;
/// VGIS's claim is told by the frames whose excess passes this, px.
const EXCESS_CLAIM_PX: f64 = 4.0;

/// A flight with its name.
#[derive(Clone, Debug)]
pub struct Flight {
    pub name: String,
    pub path: Arc<FlightPath>,
    /// Seconds of the flight.
    pub arrivals_s: Vec<f64>,
}

/// One run: a flight by a policy with its parameters over a storage model.
#[derive(Clone)]
pub struct Case {
    pub flight: usize,
    /// What the policy's row is called; several cases of one label are a grid, of which the best counts.
    pub label: String,
    /// The parameters in short; empty for the policy's own.
    pub variant: String,
    pub setup: Setup,
}

/// What became of a run.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct Outcome {
    /// Debt of the cold start and after it, px·s, and the bounds of both.
    pub cold_debt_px_s: f64,
    pub debt_px_s: f64,
    pub cold_bound_px_s: f64,
    pub bound_px_s: f64,
    /// After the cold start.
    pub excess_max_px: f64,
    pub frames_over_claim: u64,
    pub frames: u64,
    pub bytes: u64,
    /// Asked for when the frame lacked them already, and ahead.
    pub front_bytes: u64,
    pub ahead_bytes: u64,
    pub requests: u64,
    pub seeks: u64,
    pub cancelled: u64,
    pub failed: u64,
    pub wasted_bytes: u64,
    pub would_have_waited: u64,
    /// Mean over the arrivals, milliseconds; those that the flight's end cut off count with the time to it.
    pub time_to_sharp_ms: f64,
    pub footprint_max_bytes: u64,
    pub tolerance_max_px: f64,
    /// Decoded bytes of the largest front.
    pub front_max_bytes: u64,
    /// Of frames that wait for their pages, seconds.
    pub wait_max_s: f64,
    pub wait_sum_s: f64,
}

/// Runs all cases, side by side on all cores; outcomes in the order of the cases.
pub fn run(library: &Library, flights: &[Flight], cases: &[Case]) -> Result<Vec<Outcome>, SimulationError> {
    let bounds = bounds(library, flights, cases);
    cases
        .par_iter()
        .map(|case| {
            let flight = &flights[case.flight];
            let mut tally = Tally::new(flight, case.setup.step_s, &bounds[&BoundKey::of(case)]);
            let wasted_bytes = fly(library, &flight.path, Setup { bound: false, ..case.setup }, |frame, _| {
                tally.take(&frame.report);
                true
            })?;
            Ok(Outcome { wasted_bytes, ..tally.finish() })
        })
        .collect()
}

/// What bounds depend on.
#[derive(Clone, PartialEq, Eq, PartialOrd, Ord)]
struct BoundKey {
    flight: usize,
    storage: String,
    footprint_bytes: u64,
}

impl BoundKey {
    fn of(case: &Case) -> Self {
        let Setup { storage, footprint, .. } = case.setup;
        Self { flight: case.flight, storage: storage.to_string(), footprint_bytes: footprint.0 }
    }
}

/// The bound of every frame: no policy changes it, so that it is found once for all of a flight.
fn bounds(library: &Library, flights: &[Flight], cases: &[Case]) -> BTreeMap<BoundKey, Vec<f64>> {
    let mut wanted: BTreeMap<usize, BTreeMap<BoundKey, Setup>> = BTreeMap::new();
    for case in cases {
        wanted.entry(case.flight).or_default().insert(BoundKey::of(case), case.setup);
    }
    let of_flight = |(flight, setups): (usize, BTreeMap<BoundKey, Setup>)| {
        let path = &flights[flight].path;
        let Some(setup) = setups.values().next().copied() else { return Vec::new() };
        // A world whose index is paged has no bound.
        let steps = (path.duration_s() / setup.step_s + 1e-6).floor() as u64 + 1;
        let frames = if library.index.is_whole() { steps } else { 0 };
        let rows: Vec<Vec<f64>> = (0..frames)
            .into_par_iter()
            .map(|at| {
                let since_s = at as f64 * setup.step_s;
                let view = View::new(path.at(path.start_s() + since_s), path.fovy_rad(), setup.size_px);
                let bound = FrameBound::new(&library.index, &view, &setup.select_params());
                let debt = |setup: &Setup| bound.debt_px(&Simulation::budget_of(library, setup, since_s));
                setups.values().map(debt).collect()
            })
            .collect();
        let columns = setups.into_keys().enumerate();
        columns.map(|(column, key)| (key, rows.iter().map(|row| row[column]).collect())).collect()
    };
    wanted.into_iter().flat_map(of_flight).collect()
}

/// Sums up a flight frame by frame.
pub(super) struct Tally<'a> {
    flight: &'a Flight,
    step_s: f64,
    bounds: &'a [f64],
    outcome: Outcome,
    last: Option<(f64, f64, f64)>,
    /// Arrivals that were not sharp yet, and the waits of those that were.
    open: Vec<f64>,
    waits_s: Vec<f64>,
}

impl<'a> Tally<'a> {
    pub(super) fn new(flight: &'a Flight, step_s: f64, bounds: &'a [f64]) -> Self {
        let open = flight.arrivals_s.clone();
        Self { flight, step_s, bounds, outcome: Outcome::default(), last: None, open, waits_s: Vec::new() }
    }

    pub(super) fn take(&mut self, report: &FrameReport) {
        // What was waited for is shown when it is there; until then the frame before stands.
        let since_s = report.t_s + report.waited_s - self.flight.path.start_s();
        let bound_px = self.bounds.get((since_s / self.step_s).round() as usize).copied().unwrap_or(0.0);
        if let Some((before_s, debt_px, bound_px)) = self.last.replace((since_s, report.debt_px, bound_px)) {
            let stood_s = since_s - before_s;
            let cold = before_s < WARM_S - 1e-9;
            let out = &mut self.outcome;
            *(if cold { &mut out.cold_debt_px_s } else { &mut out.debt_px_s }) += debt_px * stood_s;
            *(if cold { &mut out.cold_bound_px_s } else { &mut out.bound_px_s }) += bound_px * stood_s;
        }
        self.arrive(report.t_s + report.waited_s, report.coverage);
        let out = &mut self.outcome;
        if since_s >= WARM_S - 1e-9 {
            out.excess_max_px = out.excess_max_px.max(report.excess_max_px);
            out.frames_over_claim += u64::from(report.excess_max_px > EXCESS_CLAIM_PX);
        }
        out.frames += 1;
        out.bytes += report.bytes_read;
        out.front_bytes += report.front_bytes;
        out.ahead_bytes += report.ahead_bytes;
        out.requests += report.requests;
        out.seeks += report.seeks;
        out.cancelled += report.cancelled;
        out.failed += report.failed;
        out.would_have_waited += u64::from(report.would_have_waited);
        out.footprint_max_bytes = out.footprint_max_bytes.max(report.footprint_bytes);
        out.tolerance_max_px = out.tolerance_max_px.max(report.tolerance_drawn_px);
        out.front_max_bytes = out.front_max_bytes.max(report.front_size_bytes);
        out.wait_max_s = out.wait_max_s.max(report.waited_s);
        out.wait_sum_s += report.waited_s;
    }

    fn arrive(&mut self, t_s: f64, coverage: f64) {
        if coverage < SHARP_COVERAGE {
            return;
        }
        let waits_s = &mut self.waits_s;
        self.open.retain(|&arrival_s| {
            let reached = t_s >= arrival_s - 1e-6;
            waits_s.extend(reached.then(|| (t_s - arrival_s).max(0.0)));
            !reached
        });
    }

    pub(super) fn finish(mut self) -> Outcome {
        let end_s = self.flight.path.end_s();
        self.waits_s.extend(self.open.iter().map(|arrival_s| (end_s - arrival_s).max(0.0)));
        let count = self.waits_s.len().max(1) as f64;
        self.outcome.time_to_sharp_ms = 1000.0 * self.waits_s.iter().sum::<f64>() / count;
        self.outcome
    }
}

impl Case {
    /// A policy as it is by default.
    pub fn of(flight: usize, policy: PolicyName, setup: Setup) -> Self {
        let planner = PlannerParams { policy, ..setup.planner };
        Self { flight, label: policy.to_string(), variant: String::new(), setup: Setup { planner, ..setup } }
    }

    pub fn storage(&self) -> StorageModel {
        self.setup.storage
    }
}
