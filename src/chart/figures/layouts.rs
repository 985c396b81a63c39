//! What sides of cells would have cost a single-seek layout: redundancy against the delay of a crossing (Jiang, Sajadi &
//! Gopi 2013, fig. 4).

use crate::chart::{Axis, Curve, Figure, Panel, Sheet, Spot, Stroke};
use crate::layout::{CurvePoint, Layout};

const COLUMNS: [&str; 9] = [
    "side_m",
    "cells",
    "redundancy",
    "lemma_1",
    "run_mean_bytes",
    "lemma_2_bytes",
    "layout_delay_ms",
    "packs_delay_ms",
    "layout_bytes",
];

/// The curve that a layout's side was chosen by; `None` where it was given by hand.
pub fn redundancy_by_delay(name: &str, layout: &Layout) -> Option<Figure> {
    let points = &layout.curve;
    if points.is_empty() {
        return None;
    }
    let row = |point: &CurvePoint| {
        let numbers = [
            point.side_m,
            point.cells as f64,
            point.redundancy,
            point.predicted.redundancy,
            point.run_bytes_mean,
            point.predicted.run_bytes,
            point.layout.mean_s * 1e3,
            point.packs.mean_s * 1e3,
            point.layout_bytes,
        ];
        numbers.map(Into::into).into()
    };
    let sheet = Sheet {
        name: format!("layout-{name}"),
        columns: COLUMNS.map(str::to_owned).into(),
        rows: points.iter().map(row).collect(),
    };
    let curve = |name: &str, delay_s: fn(&CurvePoint) -> f64| {
        let spot = |point: &CurvePoint| Spot {
            x: point.redundancy,
            y: delay_s(point) * 1e3,
            name: Some(format!("{:.0} m", point.side_m)),
        };
        Curve { name: name.to_owned(), stroke: Stroke::Dotted, spots: points.iter().map(spot).collect() }
    };
    let panel = Panel {
        title: format!("Crossings by the layout {name}"),
        x: Axis::linear("redundancy"),
        y: Axis::linear("mean delay of a crossing, ms"),
        curves: vec![curve("layout", |point| point.layout.mean_s), curve("packs", |point| point.packs.mean_s)],
    };
    let text = format!(
        "Each point is a side of cells. What a step adds is read from the layout {name} in one run, from the packs in \
         ranges of neighbours. Cells of {:.0} m were taken.",
        layout.grid.side_m()
    );
    Some(Figure { title: "Redundancy against delay".into(), text, panels: vec![panel], sheet, has_table: true })
}
