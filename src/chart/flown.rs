//! Runs of a sweep by the virtual clock, and what was measured in them.

use super::compare::{Outcome, Tally, WARM_S};
use super::sheet::{Cell, Sheet};
use super::sweep::{Run, Sweep};
use crate::paging::FrameReport;
use crate::record::Distribution;
use crate::select::{SelectParams, select_raised};
use crate::simulate::{Frame, Library, Setup, Simulation, SimulationError, fly};
use rayon::prelude::*;
use serde::Serialize;

/// Errors of runs at different tolerances are compared by what they lack of the front at this one, px.
pub const REFERENCE_PX: f64 = 0.25;
/// Seconds of flight from one frame that is compared with the reference, or with the source, to the next.
pub(super) const SAMPLE_S: f64 = 0.5;

/// A frame of a run whose frames are kept.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moment {
    /// Since the start, seconds.
    pub since_s: f64,
    pub debt_px: f64,
    /// The least debt that any policy could have here; `None` where it was not computed.
    pub bound_px: Option<f64>,
    /// Time that the frame stood still for its pages, seconds.
    pub waited_s: f64,
    pub would_have_waited: bool,
    /// Where they were measured, in one frame each half second.
    pub drawn_over_needed: Option<f64>,
    pub drawn_over_front: Option<f64>,
    pub drawn_over_seen: Option<f64>,
    pub resident_over_needed: Option<f64>,
}

/// What is measured beside the sums of [`Outcome`]; means are over the frames from [`WARM_S`] on, unless they say
/// otherwise.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Measured {
    pub debt_mean_px: f64,
    /// Debt against the front at [`REFERENCE_PX`], which can be compared between tolerances; of one frame each half second.
    pub error_mean_px: Option<f64>,
    pub error_max_px: Option<f64>,
    pub raw_error_mean_px: f64,
    pub triangles_mean: f64,
    pub triangles_p99: f64,
    pub cells_tested_mean: f64,
    pub objects_drawn_mean: f64,
    pub waiting_frames: u64,
    /// Over-modelling, of one frame each half second: sums over sums of triangles drawn and needed in view, and of the
    /// needed reps as wholes; of stored bytes held and needed; and of the ground's needed triangles and those of one cut
    /// over the whole view, all without occlusion. Then drawn and held over what of the needed shows.
    pub drawn_over_needed: Option<f64>,
    pub drawn_over_needed_max: Option<f64>,
    pub drawn_over_front: Option<f64>,
    pub resident_over_needed: Option<f64>,
    pub needed_over_view_cut: Option<f64>,
    pub drawn_over_seen: Option<f64>,
    pub resident_over_seen: Option<f64>,
    pub needed_triangles_mean: Option<f64>,
    pub needed_bytes_mean: Option<f64>,
}

/// A run and what became of it.
#[derive(Clone, Debug)]
pub struct Flown {
    pub run: Run,
    pub outcome: Outcome,
    pub measured: Measured,
    /// All frames, where the sweep keeps them.
    pub series: Vec<Moment>,
}

/// Flies all runs on all cores; results in their order. `done` is told how many are over, from any thread.
pub fn fly_all(
    library: &Library,
    sweep: &Sweep,
    runs: &[Run],
    done: &(dyn Fn() + Sync),
) -> Result<Vec<Flown>, SimulationError> {
    let fly_one = |run: &Run| {
        let flown = fly_run(library, sweep, run);
        done();
        flown
    };
    runs.par_iter().map(fly_one).collect()
}

fn fly_run(library: &Library, sweep: &Sweep, run: &Run) -> Result<Flown, SimulationError> {
    let flight = sweep.flight(run);
    let keeps_series = sweep.keeps_series(run);
    // The bound depends on no policy: once for each storage model is enough.
    let bound = keeps_series && run.policy == sweep.ours() && !run.sync_reads;
    let setup = Setup { bound, ..sweep.setup(run) };
    let mut tally = Tally::new(&flight, setup.step_s, &[]);
    let mut meter = Meter::new(flight.path.start_s(), setup, sweep.measures_needs(run));
    let wasted_bytes = fly(library, &flight.path, setup, |mut frame, simulation| {
        tally.take(&frame.report);
        meter.take(&mut frame, simulation);
        true
    })?;
    let series = if keeps_series { std::mem::take(&mut meter.series) } else { Vec::new() };
    let outcome = Outcome { wasted_bytes, ..tally.finish() };
    Ok(Flown { run: *run, outcome, measured: meter.finish(), series })
}

/// Takes the measures of a run frame by frame.
struct Meter {
    start_s: f64,
    setup: Setup,
    next_sample_s: f64,
    /// Whether over-modelling is measured: it costs more than the frames themselves.
    measures_needs: bool,
    series: Vec<Moment>,
    warm: Warm,
}

/// Figures of the frames after the cold start.
#[derive(Default)]
struct Warm {
    debts_px: Vec<f64>,
    errors_px: Vec<f64>,
    raw_errors_px: Vec<f64>,
    triangles: Vec<f64>,
    cells_tested: Vec<f64>,
    objects_drawn: Vec<f64>,
    waiting_frames: u64,
    modelled: Vec<FrameReport>,
}

impl Meter {
    fn new(start_s: f64, setup: Setup, measures_needs: bool) -> Self {
        Self { start_s, setup, next_sample_s: WARM_S, measures_needs, series: Vec::new(), warm: Warm::default() }
    }

    fn take(&mut self, frame: &mut Frame, simulation: &Simulation<'_>) {
        let since_s = frame.report.t_s - self.start_s;
        if since_s >= self.next_sample_s - 1e-9 {
            self.next_sample_s += SAMPLE_S;
            self.sample(frame, simulation);
        }
        let report = &frame.report;
        self.series.push(Moment {
            since_s,
            debt_px: report.debt_px,
            bound_px: report.debt_bound_px,
            waited_s: report.waited_s,
            would_have_waited: report.would_have_waited,
            drawn_over_needed: report.drawn_over_needed(),
            drawn_over_front: report.drawn_over_front(),
            drawn_over_seen: report.drawn_over_seen(),
            resident_over_needed: report.resident_over_needed(),
        });
        if since_s < WARM_S - 1e-9 {
            return;
        }
        let warm = &mut self.warm;
        warm.debts_px.push(report.debt_px);
        warm.raw_errors_px.push(report.raw_error_px);
        warm.triangles.push(report.triangles as f64);
        warm.cells_tested.push(report.cells_tested.into());
        warm.objects_drawn.push(report.objects_drawn.into());
        warm.waiting_frames += u64::from(report.would_have_waited);
    }

    /// What the frame lacks of the front at the reference, and what it has too much of.
    fn sample(&mut self, frame: &mut Frame, simulation: &Simulation<'_>) {
        let params = SelectParams { tolerance_px: REFERENCE_PX, ..self.setup.select_params() };
        let drawn_px = frame.report.tolerance_drawn_px;
        let selection = select_raised(simulation.index(), simulation.cells(), &frame.view, &params, drawn_px);
        self.warm.errors_px.push(selection.stats.debt_px);
        if self.measures_needs {
            frame.report.take_modelled(&simulation.modelled(frame));
            self.warm.modelled.push(frame.report.clone());
        }
    }

    fn finish(self) -> Measured {
        let warm = self.warm;
        let mean = |values: &[f64]| Distribution::of(values.iter().copied()).map_or(0.0, |spread| spread.mean);
        let errors = Distribution::of(warm.errors_px);
        let modelled = &warm.modelled;
        let ratio = |of: Count, whole: Count| ratio(modelled, of, whole);
        Measured {
            debt_mean_px: mean(&warm.debts_px),
            error_mean_px: errors.map(|errors| errors.mean),
            error_max_px: errors.map(|errors| errors.max),
            raw_error_mean_px: mean(&warm.raw_errors_px),
            triangles_mean: mean(&warm.triangles),
            triangles_p99: Distribution::of(warm.triangles.iter().copied()).map_or(0.0, |spread| spread.p99),
            cells_tested_mean: mean(&warm.cells_tested),
            objects_drawn_mean: mean(&warm.objects_drawn),
            waiting_frames: warm.waiting_frames,
            drawn_over_needed: ratio(|report| report.modelled_triangles, |report| report.needed_triangles),
            drawn_over_needed_max: modelled.iter().filter_map(FrameReport::drawn_over_needed).reduce(f64::max),
            drawn_over_front: ratio(|report| report.modelled_triangles, |report| report.front_triangles),
            resident_over_needed: ratio(|report| report.resident_bytes, |report| report.needed_bytes),
            needed_over_view_cut: ratio(|report| report.needed_ground_triangles, |report| report.view_cut_triangles),
            drawn_over_seen: ratio(|report| report.modelled_triangles, |report| report.seen_triangles),
            resident_over_seen: ratio(|report| report.resident_bytes, |report| report.seen_bytes),
            needed_triangles_mean: mean_of(modelled, |report| report.needed_triangles),
            needed_bytes_mean: mean_of(modelled, |report| report.needed_bytes),
        }
    }
}

type Count = fn(&FrameReport) -> Option<u64>;

/// A sum over a sum.
fn ratio(reports: &[FrameReport], of: Count, whole: Count) -> Option<f64> {
    let sum = |figure: Count| reports.iter().filter_map(figure).sum::<u64>() as f64;
    (sum(whole) > 0.0).then(|| sum(of) / sum(whole))
}

fn mean_of(reports: &[FrameReport], figure: Count) -> Option<f64> {
    Distribution::of(reports.iter().filter_map(figure).map(|count| count as f64)).map(|spread| spread.mean)
}

/// All runs as rows: the settings, then all that was measured.
pub fn runs_sheet(sweep: &Sweep, flown: &[Flown]) -> Result<Sheet, serde_json::Error> {
    let mut rows = Vec::new();
    for one in flown {
        let mut row = serde_json::Map::new();
        for (name, cell) in settings(sweep, &one.run) {
            row.insert(name.to_owned(), json_of(cell));
        }
        for value in [serde_json::to_value(&one.outcome)?, serde_json::to_value(&one.measured)?] {
            if let serde_json::Value::Object(figures) = value {
                row.extend(figures);
            }
        }
        rows.push(row);
    }
    Ok(Sheet::of_values("runs", rows))
}

fn json_of(cell: Cell) -> serde_json::Value {
    match cell {
        Cell::Text(text) => text.into(),
        Cell::Number(number) => number.into(),
        Cell::Nothing => serde_json::Value::Null,
    }
}

/// The settings of a run, by column.
pub fn settings(sweep: &Sweep, run: &Run) -> [(&'static str, Cell); 9] {
    [
        ("flight", sweep.flights[run.flight].name.as_str().into()),
        ("policy", run.policy.name().into()),
        ("storage", run.storage.to_string().into()),
        ("sync_reads", u64::from(run.sync_reads).into()),
        ("tolerance_px", run.tolerance_px.into()),
        ("footprint_bytes", run.footprint.0.into()),
        ("speed", run.speed.into()),
        ("width_px", u64::from(run.size_px[0]).into()),
        ("height_px", u64::from(run.size_px[1]).into()),
    ]
}
