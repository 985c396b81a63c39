//! Height errors of the drawn ground, against the tolerance and against what pictures cost.

use super::Runs;
use crate::chart::compare::WARM_S;
use crate::chart::figure::{Axis, Curve, Figure, Panel, Spot, Stroke};
use crate::chart::flown::{Flown, SAMPLE_S};
use crate::chart::gauge::{PART_SHARE_MAX, SIDE_POINTS};
use crate::chart::heights::{HeightErrors, HeightRun, Truth, measure_heights};
use crate::chart::sheet::{Cell, Sheet};
use crate::chart::sweep::Sweep;
use crate::simulate::{Library, SimulationError};

/// Errors below this are drawn at it, px.
const LEAST_PX: f64 = 1e-3;

const COLUMNS: [&str; 25] = [
    "flight",
    "storage",
    "policy",
    "tolerance_px",
    "frames",
    "points",
    "unmeasured_share",
    "error_mean_px",
    "error_p99_px",
    "error_max_px",
    "error_mean_m",
    "error_p99_m",
    "error_max_m",
    "bound_mean_px",
    "bound_p99_px",
    "bound_max_px",
    "over_tolerance_share",
    "over_bound_share",
    "over_bound_points",
    "over_bound_max_m",
    "posts",
    "over_bound_posts",
    "over_bound_posts_max_m",
    "triangles_mean",
    "bytes",
];

/// A run with its errors, and the same flight of the sweep.
struct Row<'a> {
    measured: &'a HeightRun,
    errors: HeightErrors,
    flown: &'a Flown,
}

/// What is drawn up a panel.
struct Told {
    title: &'static str,
    axis: &'static str,
    of: fn(&HeightErrors) -> f64,
    /// The same of what the pieces claim.
    bound: fn(&HeightErrors) -> f64,
}

const TOLD: [Told; 2] = [
    Told {
        title: "mean",
        axis: "height error, mean, px",
        of: |errors| errors.error_px.mean,
        bound: |errors| errors.bound_px.mean,
    },
    Told {
        title: "99 of 100 points",
        axis: "height error, 99 of 100 within, px",
        of: |errors| errors.error_px.p99,
        bound: |errors| errors.bound_px.p99,
    },
];

/// What is drawn along a panel.
struct Along {
    title: &'static str,
    axis: fn() -> Axis,
    of: fn(&Row<'_>) -> f64,
    /// Whether points have to be told which tolerance they are of.
    names_tolerances: bool,
}

const ALONG: [Along; 3] = [
    Along {
        title: "tolerance",
        axis: || Axis::log("tolerance, px", LEAST_PX),
        of: |row| row.measured.run.tolerance_px,
        names_tolerances: false,
    },
    Along {
        title: "triangles",
        axis: || Axis::log("triangles a frame, mean", 1.0),
        of: |row| row.flown.measured.triangles_mean,
        names_tolerances: true,
    },
    Along {
        title: "bytes read",
        axis: || Axis::bytes("bytes read"),
        of: |row| row.flown.outcome.bytes as f64,
        names_tolerances: true,
    },
];

/// The ground drawn on our policy's flights against the source, by tolerance; `flown` are the runs of the sweep, which tell
/// the cost.
pub fn height_errors(
    library: &Library,
    sweep: &Sweep,
    flown: &[Flown],
    truth: &dyn Truth,
) -> Result<Figure, SimulationError> {
    Ok(figure(&Runs { sweep, flown }, &measure_heights(library, sweep, truth)?))
}

fn figure(runs: &Runs<'_>, measured: &[HeightRun]) -> Figure {
    let row = |one: &'_ HeightRun| Some((one.errors?, runs.get(&one.run)?));
    let mut rows: Vec<Row<'_>> = measured
        .iter()
        .filter_map(|measured| row(measured).map(|(errors, flown)| Row { measured, errors, flown }))
        .collect();
    rows.sort_by(|a, b| {
        let (a, b) = (&a.measured.run, &b.measured.run);
        a.flight.cmp(&b.flight).then(a.tolerance_px.total_cmp(&b.tolerance_px))
    });
    let panels = ALONG.iter().flat_map(|along| TOLD.iter().map(|told| panel(runs, &rows, along, told)));
    Figure {
        title: "Height error against the source".into(),
        text: text(runs.sweep),
        panels: if rows.is_empty() { Vec::new() } else { panels.collect() },
        sheet: sheet(runs, &rows),
        has_table: true,
    }
}

fn panel(runs: &Runs<'_>, rows: &[Row<'_>], along: &Along, told: &Told) -> Panel {
    let mut curves = Vec::new();
    for (at, flight) in runs.sweep.flights.iter().enumerate() {
        let of_flight = || rows.iter().filter(move |row| row.measured.run.flight == at);
        let spot = |row: &Row<'_>| {
            let name = along.names_tolerances.then(|| format!("{} px", row.measured.run.tolerance_px));
            Spot { x: (along.of)(row), y: (told.of)(&row.errors), name }
        };
        curves.push(Curve::new(flight.name.as_str(), Stroke::Dotted, of_flight().map(spot)));
        if !along.names_tolerances {
            let bounds = of_flight().map(|row| ((along.of)(row), (told.bound)(&row.errors)));
            curves.push(Curve::new(format!("{}, bound", flight.name), Stroke::Line, bounds));
        }
    }
    if !along.names_tolerances {
        let mut tolerances_px = runs.sweep.tolerances_px.clone();
        tolerances_px.sort_by(f64::total_cmp);
        curves.push(Curve::new("tolerance", Stroke::Dashed, tolerances_px.into_iter().map(|px| (px, px))));
    }
    let title = format!("{} by {}", told.title, along.title);
    Panel { title, x: (along.axis)(), y: Axis::log(told.axis, LEAST_PX), curves }
}

fn sheet(runs: &Runs<'_>, rows: &[Row<'_>]) -> Sheet {
    let mut sheet = Sheet::new("heights", &COLUMNS);
    for Row { measured: HeightRun { run, counts, .. }, errors, flown } in rows {
        sheet.push([
            runs.flight_name(run.flight),
            run.storage.to_string().into(),
            run.policy.name().into(),
            run.tolerance_px.into(),
            counts.frames.into(),
            counts.points.into(),
            counts.unmeasured_share().into(),
            errors.error_px.mean.into(),
            errors.error_px.p99.into(),
            errors.error_px.max.into(),
            errors.error_m.mean.into(),
            errors.error_m.p99.into(),
            errors.error_m.max.into(),
            errors.bound_px.mean.into(),
            errors.bound_px.p99.into(),
            errors.bound_px.max.into(),
            errors.over_tolerance_share.into(),
            errors.over_bound_share.into(),
            counts.over_bound_points.into(),
            counts.over_bound_max_m.into(),
            counts.posts.into(),
            counts.over_bound_posts.into(),
            counts.over_bound_posts_max_m.into(),
            flown.measured.triangles_mean.into(),
            Cell::from(flown.outcome.bytes),
        ]);
    }
    sheet
}

fn text(sweep: &Sweep) -> String {
    format!(
        "How far the drawn ground is off the elevation that the world was made from: {} on {}, one frame each {SAMPLE_S} s \
         from {WARM_S} s on. Points are spread over each piece of the ground in view, {least} × {least} or as many as make none \
         stand for more than 1/{most} of the screen; they count by that share, and each frame counts alike. Pixels are those of the \
         vertical error at the point's own distance. Bounds are what pieces claim: they hold at the source's posts, and the \
         table has how many posts beside the points are beyond them (over_bound_posts, which should be 0). Between posts the \
         source is interpolated and the ground drawn as flat triangles, so that there points may be beyond them too \
         (over_bound_share, over_bound_points). Ground outside the sources is left out, and so are pieces of which no point is \
         in view (both are in unmeasured_share); objects, skirts and the pressing down of ground round a buried eye are in none \
         of these figures.",
        sweep.ours(),
        sweep.storages[0],
        least = SIDE_POINTS,
        most = 1.0 / PART_SHARE_MAX,
    )
}
