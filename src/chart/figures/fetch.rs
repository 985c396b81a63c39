//! What is fetched for the current frame against the footprint (Varadhan & Manocha 2002, fig. 11), and the debt that is
//! left.

use super::{Runs, curve_of};
use crate::chart::figure::{Axis, Figure, Panel, Stroke};
use crate::chart::flown::Flown;
use crate::chart::sheet::Sheet;
use crate::chart::sweep::Run;

const LEAST_PX: f64 = 1e-4;

type Told = (&'static str, fn() -> Axis, fn(&Flown) -> f64);

const TOLD: [Told; 2] = [
    (
        "fetched for the frame at hand",
        || Axis::bytes("bytes fetched that a frame lacked"),
        |flown| flown.outcome.front_bytes as f64,
    ),
    ("debt", || Axis::log("mean debt, px", LEAST_PX), |flown| flown.measured.debt_mean_px),
];

/// Fetches and debt by footprint.
pub fn fetch_by_footprint(runs: &Runs<'_>) -> Figure {
    let mut panels = Vec::new();
    let mut sheet = Sheet::new(
        "fetch",
        &[
            "flight",
            "storage",
            "policy",
            "footprint_bytes",
            "front_bytes",
            "ahead_bytes",
            "debt_mean_px",
            "tolerance_max_px",
            "footprint_max_bytes",
        ],
    );
    for (flight, storage, title) in runs.places() {
        let base = runs.sweep.base(flight, storage);
        let lines: Vec<(Run, Vec<(f64, &Flown)>)> =
            runs.policies(base).map(|run| (run, by_footprint(runs, run))).collect();
        for (name, axis, of) in TOLD {
            let curves = lines.iter().map(|(run, points)| curve_of(run, points.iter().copied(), Stroke::Dotted, of));
            let curves = curves.collect();
            panels.push(Panel { title: format!("{title}: {name}"), x: Axis::bytes("footprint"), y: axis(), curves });
        }
        for (footprint_bytes, one) in lines.iter().flat_map(|(_, points)| points) {
            let out = &one.outcome;
            sheet.push([
                runs.flight_name(flight),
                storage.to_string().into(),
                one.run.policy.name().into(),
                (*footprint_bytes).into(),
                out.front_bytes.into(),
                out.ahead_bytes.into(),
                one.measured.debt_mean_px.into(),
                out.tolerance_max_px.into(),
                out.footprint_max_bytes.into(),
            ]);
        }
    }
    Figure {
        title: "Fetch size against footprint".into(),
        text: "Bytes that were asked for since the frame at hand lacked them (what was read ahead is in the table), and the \
               debt that was left. Where a front does not fit, the tolerance rises until it does."
            .into(),
        panels,
        sheet,
        has_table: true,
    }
}

fn by_footprint<'a>(runs: &Runs<'a>, base: Run) -> Vec<(f64, &'a Flown)> {
    let varied = runs.sweep.footprints.iter().map(|&footprint| Run { footprint, ..base });
    runs.along(base, varied, |run| run.footprint.0 as f64)
}
