//! Outcomes as rows: all of them as CSV, the best of each policy side by side as Markdown.

use super::compare::{Case, Flight, Outcome};
use std::collections::BTreeMap;
use std::fmt::Write;

/// A line for each run.
pub fn csv(flights: &[Flight], cases: &[Case], outcomes: &[Outcome]) -> String {
    let mut text = String::from(
        "flight,storage,footprint_bytes,policy,variant,level_skip,sync_reads,frames,cold_debt_px_s,cold_bound_px_s,\
         debt_px_s,bound_px_s,excess_max_px,frames_over_4px,bytes,front_bytes,ahead_bytes,wasted_bytes,requests,seeks,\
         cancelled,failed,would_have_waited,time_to_sharp_ms,footprint_max_bytes,tolerance_max_px,front_max_bytes,wait_max_s,wait_sum_s\n",
    );
    for (case, out) in cases.iter().zip(outcomes) {
        let setup = &case.setup;
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "\"{}\",\"{}\",{},\"{}\",\"{}\",{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{}",
            flights[case.flight].name.replace('"', "'"),
            setup.storage,
            setup.footprint.0,
            case.label.replace('"', "'"),
            case.variant.replace('"', "'"),
            u8::from(setup.planner.level_skip),
            u8::from(setup.sync_reads),
            out.frames,
            out.cold_debt_px_s,
            out.cold_bound_px_s,
            out.debt_px_s,
            out.bound_px_s,
            out.excess_max_px,
            out.frames_over_claim,
            out.bytes,
            out.front_bytes,
            out.ahead_bytes,
            out.wasted_bytes,
            out.requests,
            out.seeks,
            out.cancelled,
            out.failed,
            out.would_have_waited,
            out.time_to_sharp_ms,
            out.footprint_max_bytes,
            out.tolerance_max_px,
            out.front_max_bytes,
            out.wait_max_s,
            out.wait_sum_s,
        );
    }
    text
}

/// A table for each flight and storage model: the best variant of each policy, in the order in which the cases name
/// them.
pub fn markdown(flights: &[Flight], cases: &[Case], outcomes: &[Outcome]) -> String {
    let mut rows: BTreeMap<(usize, usize), Vec<(&Case, &Outcome)>> = BTreeMap::new();
    let mut storages: Vec<String> = Vec::new();
    for (case, outcome) in cases.iter().zip(outcomes) {
        let name = case.storage().to_string();
        let at = storages.iter().position(|known| *known == name).unwrap_or_else(|| {
            storages.push(name);
            storages.len() - 1
        });
        rows.entry((case.flight, at)).or_default().push((case, outcome));
    }
    let mut text = String::from(
        "| flight | storage | policy | debt px·s | bound | ÷ max(oracle, bound) | cold debt | cold bound | waste | MB | seeks | sharp ms | parameters |\n\
         |---|---|---|---|---|---|---|---|---|---|---|---|---|\n",
    );
    for ((flight, storage), runs) in rows {
        let best = best_of_each(&runs);
        let oracle_px_s = best.iter().find(|(case, _)| case.label == "oracle").map_or(0.0, |(_, out)| out.debt_px_s);
        for (case, out) in best {
            let least_px_s = oracle_px_s.max(out.bound_px_s);
            let ratio = if least_px_s > 0.0 { format!("{:.2}", out.debt_px_s / least_px_s) } else { "–".into() };
            let _ = writeln!(
                text,
                "| {} | {} | {} | {:.3} | {:.3} | {ratio} | {:.3} | {:.3} | {:.0} % | {:.2} | {} | {:.0} | {} |",
                flights[flight].name,
                storages[storage],
                case.label,
                out.debt_px_s,
                out.bound_px_s,
                out.cold_debt_px_s,
                out.cold_bound_px_s,
                100.0 * out.wasted_bytes as f64 / out.bytes.max(1) as f64,
                out.bytes as f64 / 1e6,
                out.seeks,
                out.time_to_sharp_ms,
                case.variant,
            );
        }
    }
    text
}

/// Of each label the run with the least debt, the first one where several are alike.
fn best_of_each<'a>(runs: &[(&'a Case, &'a Outcome)]) -> Vec<(&'a Case, &'a Outcome)> {
    let mut best: Vec<(&Case, &Outcome)> = Vec::new();
    for &(case, outcome) in runs {
        match best.iter_mut().find(|(known, _)| known.label == case.label) {
            Some(known) if outcome.debt_px_s < known.1.debt_px_s => *known = (case, outcome),
            Some(_) => {}
            None => best.push((case, outcome)),
        }
    }
    best
}
