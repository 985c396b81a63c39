//! The figures of a page, each from the runs that it shows.

pub mod accuracy;
pub mod debt;
pub mod distance;
pub mod fetch;
pub mod heights;
pub mod layouts;
pub mod modelled;
pub mod speed;
pub mod stability;
pub mod waits;

use super::figure::Curve;
use super::flown::Flown;
use super::sheet::Cell;
use super::sweep::{Run, Sweep};
use crate::paging::PolicyName;
use crate::storage::StorageModel;
use crate::units::ByteSize;

/// All runs, to be looked up by their settings.
#[derive(Clone, Copy)]
pub struct Runs<'a> {
    pub sweep: &'a Sweep,
    pub flown: &'a [Flown],
}

impl<'a> Runs<'a> {
    pub fn get(&self, run: &Run) -> Option<&'a Flown> {
        self.flown.iter().find(|flown| flown.run == *run)
    }

    /// Each flight over each storage model, with a title.
    pub fn places(&self) -> impl Iterator<Item = (usize, StorageModel, String)> + use<'a> {
        let sweep = self.sweep;
        (0..sweep.flights.len()).flat_map(move |flight| {
            let name = &sweep.flights[flight].name;
            sweep.storages.iter().map(move |&storage| (flight, storage, format!("{name} on {storage}")))
        })
    }

    /// Runs of a policy over a list of settings, the others at their base, in the order of growing `x`.
    fn along(&self, base: Run, runs: impl Iterator<Item = Run>, x: impl Fn(&Run) -> f64) -> Vec<(f64, &'a Flown)> {
        let mut found: Vec<(f64, &Flown)> = runs
            .map(|run| Run { policy: base.policy, ..run })
            .filter_map(|run| Some((x(&run), self.get(&run)?)))
            .collect();
        found.sort_by(|a, b| a.0.total_cmp(&b.0));
        found
    }

    fn policies(&self, base: Run) -> impl Iterator<Item = Run> + use<'a> {
        self.sweep.policies.iter().map(move |&policy| Run { policy, ..base })
    }

    fn flight_name(&self, flight: usize) -> Cell {
        self.sweep.flights[flight].name.as_str().into()
    }
}

/// The settings of a run that differ from a base, in short: `foresight 2 px 32 MiB`.
fn name_of(run: &Run, base: &Run) -> String {
    let mut name = format!("{} {} px", run.policy, run.tolerance_px);
    if run.footprint != base.footprint {
        name = format!("{name} {}", rounded(run.footprint));
    }
    name
}

fn rounded(size: ByteSize) -> String {
    size.to_string().replace(".00", "")
}

/// Whether a policy could be flown: it is not told the path.
fn is_real(policy: PolicyName) -> bool {
    policy != PolicyName::Oracle
}

/// A curve of a figure for each policy.
fn curve_of<'f>(
    run: &Run,
    points: impl IntoIterator<Item = (f64, &'f Flown)>,
    stroke: super::figure::Stroke,
    y: impl Fn(&Flown) -> f64,
) -> Curve {
    let spots: Vec<(f64, f64)> = points.into_iter().map(|(x, flown)| (x, y(flown))).collect();
    Curve::new(run.policy.name(), stroke, spots)
}
