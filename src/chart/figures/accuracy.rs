//! Accuracy against cost, with the Pareto front: what no other setting gives for less.

use super::{Runs, is_real, name_of};
use crate::chart::figure::{Axis, Curve, Figure, Panel, Spot, Stroke};
use crate::chart::flown::{Flown, REFERENCE_PX};
use crate::chart::pareto::{Choice, not_covered, pareto_front};
use crate::chart::sheet::{Cell, Sheet};
use crate::chart::sweep::Run;
use crate::paging::PolicyName;

/// A cost: its column, its axis, and its figure.
struct Cost {
    column: &'static str,
    axis: fn() -> Axis,
    of: fn(&Flown) -> f64,
}

const COSTS: [Cost; 4] = [
    Cost { column: "bytes", axis: || Axis::bytes("bytes read"), of: |flown| flown.outcome.bytes as f64 },
    Cost { column: "seeks", axis: || Axis::log("seeks", 1.0), of: |flown| flown.outcome.seeks as f64 },
    Cost {
        column: "footprint_max_bytes",
        axis: || Axis::bytes("footprint used"),
        of: |flown| flown.outcome.footprint_max_bytes as f64,
    },
    Cost {
        column: "triangles_mean",
        axis: || Axis::log("triangles a frame, mean", 1.0),
        of: |flown| flown.measured.triangles_mean,
    },
];

/// Errors below this are drawn at it, px.
const LEAST_PX: f64 = 0.01;

/// Runs of one flight over one storage model that differ in policy, tolerance and footprint alone.
fn comparable<'a>(runs: &Runs<'a>, base: Run) -> Vec<&'a Flown> {
    let is_like = |flown: &&Flown| {
        let Run { policy, tolerance_px, footprint, .. } = flown.run;
        flown.run == Run { policy, tolerance_px, footprint, ..base } && flown.measured.error_mean_px.is_some()
    };
    runs.flown.iter().filter(is_like).collect()
}

fn choice(flown: &Flown, cost: &Cost) -> Choice {
    Choice { cost: (cost.of)(flown), error: flown.measured.error_mean_px.unwrap_or(f64::INFINITY) }
}

/// Error against each cost.
pub fn accuracy(runs: &Runs<'_>) -> Figure {
    let mut panels = Vec::new();
    for (flight, storage, title) in runs.places() {
        let base = runs.sweep.base(flight, storage);
        let flown = comparable(runs, base);
        panels.extend(COSTS.iter().map(|cost| panel(&title, cost, &flown, &base, runs)));
    }
    Figure {
        title: "Accuracy against cost".into(),
        text: format!(
            "Each point is a flight by one policy at one tolerance and footprint. The error is the detail debt against the \
             front at {REFERENCE_PX} px: what the pictures lack of the finest settled ones, in the mean over the screen and \
             the flight after its first two seconds. The line is the Pareto front of the policies that do not know the \
             path: nothing on it can be had cheaper without being worse."
        ),
        panels,
        sheet: sheet(runs),
        has_table: true,
    }
}

fn panel(title: &str, cost: &Cost, flown: &[&Flown], base: &Run, runs: &Runs<'_>) -> Panel {
    let spot = |one: &&Flown| {
        let Choice { cost, error } = choice(one, cost);
        Spot { x: cost, y: error, name: None }
    };
    let of_policy = |policy: PolicyName| flown.iter().filter(move |one| one.run.policy == policy);
    let mut curves = vec![front_curve(cost, flown, base)];
    let policies = runs.sweep.policies.iter();
    curves.extend(policies.map(|&policy| Curve::new(policy.name(), Stroke::Points, of_policy(policy).map(spot))));
    let y = Axis::log("error, px", LEAST_PX);
    Panel { title: title.to_owned(), x: (cost.axis)(), y, curves }
}

fn front_curve(cost: &Cost, flown: &[&Flown], base: &Run) -> Curve {
    let real: Vec<&Flown> = flown.iter().copied().filter(|one| is_real(one.run.policy)).collect();
    let choices: Vec<Choice> = real.iter().map(|one| choice(one, cost)).collect();
    let spot = |at: usize| {
        let Choice { cost, error } = choices[at];
        Spot { x: cost, y: error, name: Some(name_of(&real[at].run, base)) }
    };
    Curve::new("Pareto front", Stroke::Dashed, pareto_front(&choices).into_iter().map(spot))
}

fn sheet(runs: &Runs<'_>) -> Sheet {
    let mut columns: Vec<String> =
        ["flight", "storage", "policy", "tolerance_px", "footprint_bytes", "error_mean_px", "error_max_px"]
            .map(str::to_owned)
            .into();
    columns.extend(COSTS.iter().map(|cost| cost.column.to_owned()));
    columns.extend(COSTS.iter().map(|cost| format!("on_front_of_{}", cost.column)));
    let mut rows = Vec::new();
    for (flight, storage, _) in runs.places() {
        let flown = comparable(runs, runs.sweep.base(flight, storage));
        let fronts = COSTS.each_ref().map(|cost| on_front(cost, &flown));
        for (at, one) in flown.iter().enumerate() {
            let mut row: Vec<Cell> = vec![
                runs.flight_name(flight),
                storage.to_string().into(),
                one.run.policy.name().into(),
                one.run.tolerance_px.into(),
                one.run.footprint.0.into(),
                one.measured.error_mean_px.into(),
                one.measured.error_max_px.into(),
            ];
            row.extend(COSTS.iter().map(|cost| Cell::from((cost.of)(one))));
            row.extend(fronts.iter().map(|front| Cell::from(u64::from(front.contains(&at)))));
            rows.push(row);
        }
    }
    Sheet { name: "accuracy".into(), columns, rows }
}

/// Places of the runs on the front, among those that do not know the path.
fn on_front(cost: &Cost, flown: &[&Flown]) -> Vec<usize> {
    let real: Vec<usize> = (0..flown.len()).filter(|&at| is_real(flown[at].run.policy)).collect();
    let choices: Vec<Choice> = real.iter().map(|&at| choice(flown[at], cost)).collect();
    pareto_front(&choices).into_iter().map(|at| real[at]).collect()
}

/// Where the front of our policy is not the best: for each other policy, how many of its own front's choices none of ours
/// covers, and how much dearer ours is where it is as accurate as those.
pub fn dominance(runs: &Runs<'_>) -> Figure {
    let ours = runs.sweep.ours();
    let mut sheet = Sheet::new(
        "dominance",
        &["flight", "storage", "cost", "policy", "front_choices", "not_covered", "dearer_at_most_percent", "by"],
    );
    for (flight, storage, _) in runs.places() {
        let base = runs.sweep.base(flight, storage);
        let flown = comparable(runs, base);
        for cost in &COSTS {
            for &policy in runs.sweep.policies.iter().filter(|&&policy| policy != ours && is_real(policy)) {
                let theirs = front_of(&flown, policy, cost);
                let mine: Vec<Choice> = of(&flown, ours).map(|one| choice(one, cost)).collect();
                let choices: Vec<Choice> = theirs.iter().map(|one| choice(one, cost)).collect();
                let open = not_covered(&mine, &choices);
                let worst = open
                    .iter()
                    .map(|&at| (at, dearer_percent(&mine, choices[at])))
                    .max_by(|a, b| a.1.unwrap_or(f64::INFINITY).total_cmp(&b.1.unwrap_or(f64::INFINITY)));
                sheet.push([
                    runs.flight_name(flight),
                    storage.to_string().into(),
                    cost.column.into(),
                    policy.name().into(),
                    (choices.len() as u64).into(),
                    (open.len() as u64).into(),
                    worst.and_then(|(_, percent)| percent).into(),
                    worst.map_or(Cell::Nothing, |(at, _)| name_of(&theirs[at].run, &base).into()),
                ]);
            }
        }
    }
    Figure {
        title: format!("Does {ours} dominate?"),
        text: format!(
            "For each cost and each other policy: the choices on that policy's own front, how many of them no choice of \
             {ours} covers (as accurate and as cheap, within 1 % and 0.001 px), and how much more the cheapest choice of \
             {ours} costs that is as accurate as the worst of these; nothing there where none is as accurate."
        ),
        panels: Vec::new(),
        sheet,
        has_table: true,
    }
}

fn of<'a>(flown: &[&'a Flown], policy: PolicyName) -> impl Iterator<Item = &'a Flown> {
    flown.iter().copied().filter(move |one| one.run.policy == policy)
}

fn front_of<'a>(flown: &[&'a Flown], policy: PolicyName, cost: &Cost) -> Vec<&'a Flown> {
    let all: Vec<&Flown> = of(flown, policy).collect();
    let choices: Vec<Choice> = all.iter().map(|one| choice(one, cost)).collect();
    pareto_front(&choices).into_iter().map(|at| all[at]).collect()
}

/// How much dearer the cheapest of ours is that is as accurate, in percent.
fn dearer_percent(ours: &[Choice], other: Choice) -> Option<f64> {
    let as_accurate = ours.iter().filter(|choice| Choice { cost: 0.0, ..**choice }.covers(other));
    let cheapest = as_accurate.map(|choice| choice.cost).min_by(f64::total_cmp)?;
    Some(100.0 * (cheapest / other.cost.max(1.0) - 1.0))
}
