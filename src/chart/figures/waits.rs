//! Frame times of policies over each other (Varadhan & Manocha 2002, fig. 9; Funkhouser 1996, fig. 7). By the virtual
//! clock a frame takes a step, and what it waits for its pages where reads are synchronous.

use super::Runs;
use crate::chart::figure::{Axis, Curve, Figure, Panel, Stroke, thinned};
use crate::chart::flown::Flown;
use crate::chart::sheet::Sheet;
use crate::chart::sweep::Sweep;

const WAITING: &str = "demand, waiting";

/// Frame times by the virtual clock.
pub fn waits(runs: &Runs<'_>) -> Figure {
    let step_ms = 1000.0 * runs.sweep.step_s;
    let mut panels = Vec::new();
    let mut sheet = Sheet::new("waits", &["flight", "storage", "policy", "since_s", "frame_ms"]);
    for (flight, storage, title) in runs.places() {
        let base = runs.sweep.base(flight, storage);
        let mut curves = Vec::new();
        for (name, run) in [(WAITING, Sweep::waiting(base)), (base.policy.name(), base)] {
            let Some(flown) = runs.get(&run) else { continue };
            let series = frame_times(flown, step_ms);
            for &(since_s, frame_ms) in &series {
                let row = [
                    runs.flight_name(flight),
                    storage.to_string().into(),
                    name.into(),
                    since_s.into(),
                    frame_ms.into(),
                ];
                sheet.push(row);
            }
            curves.push(Curve::new(name, Stroke::Line, thinned(&series)));
        }
        let (x, y) = (Axis::linear("time of the flight, s"), Axis::log("frame time, ms", 1.0));
        panels.push(Panel { title, x, y, curves });
    }
    Figure {
        title: "Frame times by the storage alone".into(),
        text: format!(
            "A renderer that reads what a frame lacks and waits for it, and {}, which draws what is there: a step of \
             {step_ms:.1} ms by the virtual clock, and the wait. What drawing itself takes is not in it.",
            runs.sweep.ours()
        ),
        panels,
        sheet,
        has_table: false,
    }
}

fn frame_times(flown: &Flown, step_ms: f64) -> Vec<(f64, f64)> {
    flown.series.iter().map(|moment| (moment.since_s, step_ms + 1000.0 * moment.waited_s)).collect()
}
