//! Flights by the real clock, on this machine: frame times of policies over each other (Varadhan & Manocha 2002, fig. 9;
//! Funkhouser 1996, fig. 7), and what tolerances cost.

use super::compare::WARM_S;
use super::figure::{Axis, Curve, Figure, Panel, Stroke, thinned};
use super::sheet::Sheet;
use super::sweep::{Run, Sweep};
use crate::camera::View;
use crate::engine::{Engine, EngineError, EngineParams, FrameReport, FrameRequest, Mode, Source};
use crate::paging::{PlannerParams, PolicyName};
use crate::record::Distribution;
use std::sync::Arc;
use std::time::Instant;

/// A live flight and its frames.
#[derive(Clone, Debug)]
pub struct LiveFlight {
    pub run: Run,
    pub frames: Vec<FrameReport>,
    pub start_s: f64,
}

/// Flies our policy at each tolerance, and at the base the one that waits and all others, over the first storage model;
/// `speed` times as fast as the flights' files say. `tell` takes each flight's name before it begins.
pub fn fly_live(
    source: &Source,
    sweep: &Sweep,
    speed: f64,
    tell: &dyn Fn(&str),
) -> Result<Vec<LiveFlight>, EngineError> {
    let mut flights = Vec::new();
    for flight in 0..sweep.flights.len() {
        let base = Run { speed, ..sweep.base(flight, sweep.storages[0]) };
        let mut runs: Vec<Run> = sweep.tolerances_px.iter().map(|&tolerance_px| Run { tolerance_px, ..base }).collect();
        runs.push(Sweep::waiting(base));
        let others = sweep.policies.iter().filter(|&&policy| policy != base.policy);
        runs.extend(others.map(|&policy| Run { policy, ..base }));
        for run in runs {
            tell(&format!("{} {} {} px", sweep.flights[flight].name, name(&run), run.tolerance_px));
            flights.push(fly_one(source, sweep, run)?);
        }
    }
    Ok(flights)
}

fn name(run: &Run) -> String {
    if run.sync_reads { format!("{}, waiting", run.policy) } else { run.policy.to_string() }
}

fn fly_one(source: &Source, sweep: &Sweep, run: Run) -> Result<LiveFlight, EngineError> {
    let path = sweep.flight(&run).path;
    let mut engine = Engine::new(
        source.clone(),
        EngineParams {
            mode: Mode::Live,
            tolerance_px: run.tolerance_px,
            footprint: run.footprint,
            planner: PlannerParams { policy: run.policy, ..PlannerParams::default() },
            storage: Some(run.storage),
            faults: sweep.faults,
            seed: sweep.seed,
            sync_reads: run.sync_reads,
            ..EngineParams::default()
        },
    )?;
    if run.policy == PolicyName::Oracle {
        let known = Arc::clone(&path);
        engine.set_way(Some(Arc::new(move |t_s| known.at(t_s))));
    }
    let (started, mut frames) = (Instant::now(), Vec::new());
    loop {
        let t_s = (path.start_s() + started.elapsed().as_secs_f64()).min(path.end_s());
        let view = View::new(path.at(t_s), path.fovy_rad(), run.size_px);
        frames.push(engine.frame(&FrameRequest { view, t_s, ids: false })?);
        if t_s >= path.end_s() {
            return Ok(LiveFlight { run, frames, start_s: path.start_s() });
        }
    }
}

impl LiveFlight {
    fn warm(&self) -> impl Iterator<Item = &FrameReport> {
        self.frames.iter().filter(|frame| frame.t_s - self.start_s >= WARM_S)
    }

    fn frame_ms(&self) -> Option<Distribution> {
        Distribution::of(self.warm().map(|frame| frame.timings.frame_ms))
    }
}

/// Of our policy at each tolerance the frame time that 99 of 100 frames keep in all flights, ms.
pub fn frame_times(sweep: &Sweep, flights: &[LiveFlight]) -> Vec<(f64, f64)> {
    let of = |tolerance_px: f64| {
        let ours = flights.iter().filter(|one| {
            (one.run.policy, one.run.sync_reads, one.run.tolerance_px) == (sweep.ours(), false, tolerance_px)
        });
        let late_ms: Vec<f64> = ours.filter_map(|one| Some(one.frame_ms()?.p99)).collect();
        (!late_ms.is_empty()).then(|| (tolerance_px, late_ms.into_iter().fold(0.0, f64::max)))
    };
    sweep.tolerances_px.iter().copied().filter_map(of).collect()
}

/// Frame times over each other, with their summary; and the times themselves, which differ from run to run.
pub fn frame_time_figures(sweep: &Sweep, flights: &[LiveFlight]) -> [Figure; 2] {
    let mut series = Sheet::new("timings", &["flight", "policy", "tolerance_px", "since_s", "frame_ms"]);
    let mut panels = Vec::new();
    for (at, flight) in sweep.flights.iter().enumerate() {
        let base_px = sweep.tolerances_px[0];
        let mut curves = Vec::new();
        for one in flights.iter().filter(|one| one.run.flight == at) {
            let times: Vec<(f64, f64)> =
                one.frames.iter().map(|frame| (frame.t_s - one.start_s, frame.timings.frame_ms)).collect();
            for &(since_s, frame_ms) in &times {
                let tolerance_px = one.run.tolerance_px.into();
                series.push([
                    flight.name.as_str().into(),
                    name(&one.run).into(),
                    tolerance_px,
                    since_s.into(),
                    frame_ms.into(),
                ]);
            }
            if one.run.tolerance_px == base_px {
                curves.push(Curve::new(name(&one.run), Stroke::Line, thinned(&times)));
            }
        }
        let (x, y) = (Axis::linear("time of the flight, s"), Axis::log("frame time, ms", 0.1));
        panels.push(Panel { title: flight.name.clone(), x, y, curves });
    }
    let storage = sweep.storages[0];
    let text = "On this machine by the real clock, reads held back to the storage model; the drawing is in it.";
    [
        Figure {
            title: format!("Live frame times on {storage}"),
            text: text.into(),
            panels,
            sheet: series,
            has_table: false,
        },
        summary(sweep, flights),
    ]
}

fn summary(sweep: &Sweep, flights: &[LiveFlight]) -> Figure {
    let columns = [
        "flight",
        "policy",
        "tolerance_px",
        "frames",
        "median_ms",
        "p99_ms",
        "max_ms",
        "sd_ms",
        "triangles_mean",
        "debt_mean_px",
    ];
    let mut sheet = Sheet::new("live", &columns);
    for one in flights {
        let Some(times) = one.frame_ms() else { continue };
        let mean = |figure: fn(&FrameReport) -> f64| Distribution::of(one.warm().map(figure)).map(|spread| spread.mean);
        sheet.push([
            sweep.flights[one.run.flight].name.as_str().into(),
            name(&one.run).into(),
            one.run.tolerance_px.into(),
            (one.frames.len() as u64).into(),
            times.median.into(),
            times.p99.into(),
            times.max.into(),
            times.sd.into(),
            mean(|frame| frame.triangles as f64).into(),
            mean(|frame| frame.debt_px).into(),
        ]);
    }
    Figure {
        title: "Live flights".into(),
        text: format!(
            "Frame times after the first {WARM_S} seconds, and what was drawn; these differ from run to run."
        ),
        panels: Vec::new(),
        sheet,
        has_table: true,
    }
}
