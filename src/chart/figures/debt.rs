//! Debt over the time of a flight, with the debt that no policy can fall below.

use super::Runs;
use crate::chart::figure::{Axis, Curve, Figure, Panel, Stroke, thinned};
use crate::chart::flown::Flown;
use crate::chart::sheet::{Cell, Sheet};

/// Debts below this are drawn at it, px.
const LEAST_PX: f64 = 1e-4;

/// Debt over time.
pub fn debt_over_time(runs: &Runs<'_>) -> Figure {
    let mut panels = Vec::new();
    let mut sheet = Sheet::new("debt", &["flight", "storage", "policy", "since_s", "debt_px", "bound_px"]);
    for (flight, storage, title) in runs.places() {
        let base = runs.sweep.base(flight, storage);
        let mut flown: Vec<&Flown> = runs.policies(base).filter_map(|run| runs.get(&run)).collect();
        // Ours over the others.
        flown.sort_by_key(|one| one.run.policy == base.policy);
        let bounded = flown.iter().copied().find(|one| one.series.iter().any(|moment| moment.bound_px.is_some()));
        let mut curves: Vec<Curve> = bounded.map(bound_curve).into_iter().collect();
        for one in &flown {
            let series: Vec<(f64, f64)> = one.series.iter().map(|moment| (moment.since_s, moment.debt_px)).collect();
            curves.push(Curve::new(one.run.policy.name(), Stroke::Line, thinned(&series)));
            for moment in &one.series {
                sheet.push([
                    runs.flight_name(flight),
                    storage.to_string().into(),
                    one.run.policy.name().into(),
                    moment.since_s.into(),
                    moment.debt_px.into(),
                    moment.bound_px.into(),
                ]);
            }
        }
        let (x, y) = (Axis::linear("time of the flight, s"), Axis::log("debt, px", LEAST_PX));
        panels.push(Panel { title, x, y, curves });
    }
    Figure {
        title: "Debt over time".into(),
        text: format!(
            "Detail debt of each frame at the base settings, and the bound that no policy can fall below. Of stretches \
             shorter than a pixel the highest is drawn; what is below {LEAST_PX} px lies on the lowest line."
        ),
        panels,
        sheet,
        has_table: false,
    }
}

fn bound_curve(flown: &Flown) -> Curve {
    let series: Vec<(f64, f64)> =
        flown.series.iter().filter_map(|moment| Some((moment.since_s, moment.bound_px?))).collect();
    Curve::new("bound", Stroke::Dashed, thinned(&series))
}

/// Debts of whole flights, the cold start apart.
pub fn debts(runs: &Runs<'_>) -> Figure {
    let mut sheet = Sheet::new(
        "debts",
        &[
            "flight",
            "storage",
            "policy",
            "cold_debt_px_s",
            "debt_px_s",
            "bound_px_s",
            "excess_max_px",
            "time_to_sharp_ms",
            "bytes",
            "wasted_bytes",
            "seeks",
            "waiting_frames",
        ],
    );
    for (flight, storage, _) in runs.places() {
        let base = runs.sweep.base(flight, storage);
        let bound_px_s = runs.get(&base).and_then(bound_px_s);
        for one in runs.policies(base).filter_map(|run| runs.get(&run)) {
            let out = &one.outcome;
            sheet.push([
                runs.flight_name(flight),
                storage.to_string().into(),
                one.run.policy.name().into(),
                out.cold_debt_px_s.into(),
                out.debt_px_s.into(),
                Cell::from(bound_px_s),
                out.excess_max_px.into(),
                out.time_to_sharp_ms.into(),
                out.bytes.into(),
                out.wasted_bytes.into(),
                out.seeks.into(),
                one.measured.waiting_frames.into(),
            ]);
        }
    }
    Figure {
        title: "Policies at the base settings".into(),
        text: "Debt of the first two seconds, which begin without a page but the coarsest, and of the rest with its lower \
               bound; frames that lacked a page of their front after that; what was read and never drawn."
            .into(),
        panels: Vec::new(),
        sheet,
        has_table: true,
    }
}

/// The bound of the whole flight after the cold start.
fn bound_px_s(flown: &Flown) -> Option<f64> {
    let warm = flown.series.windows(2).filter(|pair| pair[0].since_s >= crate::chart::WARM_S - 1e-9);
    let parts: Option<Vec<f64>> =
        warm.map(|pair| Some(pair[0].bound_px? * (pair[1].since_s - pair[0].since_s))).collect();
    parts.filter(|parts| !parts.is_empty()).map(|parts| parts.iter().sum())
}
