//! Debt against the speed of flight, and cost against the size of the frame.

use super::{Runs, curve_of};
use crate::chart::figure::{Axis, Curve, Figure, Panel, Stroke};
use crate::chart::sheet::Sheet;
use crate::chart::sweep::Run;

const LEAST_PX: f64 = 1e-4;

/// Debt of the same way flown faster.
pub fn debt_by_speed(runs: &Runs<'_>) -> Figure {
    let mut panels = Vec::new();
    let mut sheet = Sheet::new(
        "speed",
        &[
            "flight",
            "storage",
            "policy",
            "speed",
            "cold_debt_px_s",
            "debt_px_s",
            "debt_mean_px",
            "excess_max_px",
            "bytes",
        ],
    );
    for (flight, storage, title) in runs.places() {
        let base = runs.sweep.base(flight, storage);
        let mut curves = Vec::new();
        for run in runs.policies(base) {
            let varied = runs.sweep.speeds.iter().map(|&speed| Run { speed, ..run });
            let points = runs.along(run, varied, |run| run.speed);
            for (speed, one) in &points {
                sheet.push([
                    runs.flight_name(flight),
                    storage.to_string().into(),
                    run.policy.name().into(),
                    (*speed).into(),
                    one.outcome.cold_debt_px_s.into(),
                    one.outcome.debt_px_s.into(),
                    one.measured.debt_mean_px.into(),
                    one.outcome.excess_max_px.into(),
                    one.outcome.bytes.into(),
                ]);
            }
            curves.push(curve_of(&run, points, Stroke::Dotted, |flown| flown.measured.debt_mean_px));
        }
        let (x, y) = (Axis::log("speed, times that of the file", 1e-3), Axis::log("mean debt, px", LEAST_PX));
        panels.push(Panel { title, x, y, curves });
    }
    Figure {
        title: "Debt against speed".into(),
        text: "The same way flown faster: mean debt after the first two seconds, which are of all speeds two seconds."
            .into(),
        panels,
        sheet,
        has_table: true,
    }
}

/// Triangles and bytes by the size of the frame, at the same tolerance in pixels.
pub fn cost_by_size(runs: &Runs<'_>) -> Figure {
    let mut panels = Vec::new();
    let mut sheet = Sheet::new(
        "size",
        &[
            "flight",
            "storage",
            "width_px",
            "height_px",
            "triangles_mean",
            "bytes",
            "footprint_max_bytes",
            "debt_mean_px",
        ],
    );
    for (flight, storage, title) in runs.places() {
        let base = runs.sweep.base(flight, storage);
        let varied = runs.sweep.sizes_px.iter().map(|&size_px| Run { size_px, ..base });
        let points = runs.along(base, varied, pixels);
        for (_, one) in &points {
            sheet.push([
                runs.flight_name(flight),
                storage.to_string().into(),
                u64::from(one.run.size_px[0]).into(),
                u64::from(one.run.size_px[1]).into(),
                one.measured.triangles_mean.into(),
                one.outcome.bytes.into(),
                one.outcome.footprint_max_bytes.into(),
                one.measured.debt_mean_px.into(),
            ]);
        }
        let spots: Vec<(f64, f64)> = points.iter().map(|(x, one)| (*x, one.measured.triangles_mean)).collect();
        let curves = vec![Curve::new(base.policy.name(), Stroke::Dotted, spots)];
        let (x, y) = (Axis::log("pixels of the frame", 1.0), Axis::log("triangles a frame, mean", 1.0));
        panels.push(Panel { title, x, y, curves });
    }
    Figure {
        title: "Cost against frame size".into(),
        text: "At the same tolerance in pixels a larger frame asks for more.".into(),
        panels,
        sheet,
        has_table: true,
    }
}

fn pixels(run: &Run) -> f64 {
    f64::from(run.size_px[0]) * f64::from(run.size_px[1])
}
