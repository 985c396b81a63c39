//! Which runs a page is made of: lists of settings of which one, two or three vary at a time.

use super::compare::Flight;
use crate::paging::{PlannerParams, PolicyName};
use crate::simulate::Setup;
use crate::storage::{Faults, StorageModel};
use crate::units::ByteSize;
use std::sync::Arc;

/// Runs of one page at most: a mistyped list must not take a day.
pub const RUNS_MAX: usize = 4096;

/// Settings to choose from. Of each the first is the base, which stands while others vary; none is empty.
#[derive(Clone, Debug)]
pub struct Sweep {
    pub flights: Vec<Flight>,
    pub policies: Vec<PolicyName>,
    pub storages: Vec<StorageModel>,
    /// Allowed screen-space errors, px.
    pub tolerances_px: Vec<f64>,
    pub footprints: Vec<ByteSize>,
    /// How many times as fast as its file says a flight is flown.
    pub speeds: Vec<f64>,
    pub sizes_px: Vec<[u32; 2]>,
    /// From frame to frame, seconds.
    pub step_s: f64,
    pub seed: u64,
    pub faults: Faults,
}

/// One run of a sweep.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Run {
    /// Place among the flights.
    pub flight: usize,
    pub policy: PolicyName,
    pub storage: StorageModel,
    pub tolerance_px: f64,
    pub footprint: ByteSize,
    pub speed: f64,
    pub size_px: [u32; 2],
    /// Each frame reads what it lacks and waits for it.
    pub sync_reads: bool,
}

impl Sweep {
    /// The policy that others are compared with and settings are chosen for: the default one where it is among them, else
    /// the first.
    pub fn ours(&self) -> PolicyName {
        let default = PolicyName::default();
        if self.policies.contains(&default) { default } else { self.policies[0] }
    }

    /// All settings at their base.
    pub fn base(&self, flight: usize, storage: StorageModel) -> Run {
        Run {
            flight,
            policy: self.ours(),
            storage,
            tolerance_px: self.tolerances_px[0],
            footprint: self.footprints[0],
            speed: self.speeds[0],
            size_px: self.sizes_px[0],
            sync_reads: false,
        }
    }

    /// All runs, each once: policies by tolerances, by footprints and by speeds, and waiting ones, over each storage
    /// model; tolerances by footprints for the recommendation; frame sizes.
    pub fn runs(&self) -> Vec<Run> {
        let mut runs = Runs::default();
        for flight in 0..self.flights.len() {
            for &storage in &self.storages {
                let base = self.base(flight, storage);
                for &policy in &self.policies {
                    let of_policy = Run { policy, ..base };
                    runs.extend(self.tolerances_px.iter().map(|&tolerance_px| Run { tolerance_px, ..of_policy }));
                    runs.extend(self.footprints.iter().map(|&footprint| Run { footprint, ..of_policy }));
                    runs.extend(self.speeds.iter().map(|&speed| Run { speed, ..of_policy }));
                }
                runs.extend(self.sizes_px.iter().map(|&size_px| Run { size_px, ..base }));
                runs.extend([Self::waiting(base)]);
            }
            let base = self.base(flight, self.storages[0]);
            for &tolerance_px in &self.tolerances_px {
                runs.extend(self.footprints.iter().map(|&footprint| Run { tolerance_px, footprint, ..base }));
            }
        }
        runs.0
    }

    /// The run of a renderer that reads on demand and waits.
    pub fn waiting(base: Run) -> Run {
        Run { policy: PolicyName::Demand, sync_reads: true, ..base }
    }

    /// The flight of a run, at its speed.
    pub fn flight(&self, run: &Run) -> Flight {
        let flight = &self.flights[run.flight];
        if run.speed == 1.0 {
            return flight.clone();
        }
        let start_s = flight.path.start_s();
        let arrivals_s = flight.arrivals_s.iter().map(|at_s| start_s + (at_s - start_s) / run.speed).collect();
        Flight { name: flight.name.clone(), path: Arc::new(flight.path.at_speed(run.speed)), arrivals_s }
    }

    pub fn setup(&self, run: &Run) -> Setup {
        Setup {
            faults: self.faults,
            seed: self.seed,
            planner: PlannerParams { policy: run.policy, ..PlannerParams::default() },
            sync_reads: run.sync_reads,
            tolerance_px: run.tolerance_px,
            footprint: run.footprint,
            size_px: run.size_px,
            ..Setup::new(run.storage, self.step_s)
        }
    }

    /// Whether over-modelling is measured in a run: for our policy at each tolerance, and each policy at the base.
    pub fn measures_needs(&self, run: &Run) -> bool {
        let base = self.base(run.flight, run.storage);
        *run == Run { tolerance_px: run.tolerance_px, ..base } || *run == Run { policy: run.policy, ..base }
    }

    /// Whether a run's frames are kept one by one: all policies at the base, and the one that waits.
    pub fn keeps_series(&self, run: &Run) -> bool {
        let base = self.base(run.flight, run.storage);
        *run == Run { policy: run.policy, ..base } || *run == Self::waiting(base)
    }
}

/// Without repetitions.
#[derive(Default)]
struct Runs(Vec<Run>);

impl Runs {
    fn extend(&mut self, runs: impl IntoIterator<Item = Run>) {
        for run in runs {
            if !self.0.contains(&run) {
                self.0.push(run);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{FlightPath, Pose};
    use crate::geodesy::Geodetic;

    fn sweep() -> Sweep {
        let pose = Pose { eye: Geodetic::from_degrees(0.0, 0.0, 1e3), heading_rad: 0.0, pitch_rad: 0.0 };
        let path = FlightPath::new(1.0, 30.0, [(5.0, pose), (9.0, pose)]).unwrap();
        Sweep {
            flights: vec![Flight { name: "still".into(), path: Arc::new(path), arrivals_s: vec![9.0] }],
            policies: vec![PolicyName::Demand, PolicyName::Foresight],
            storages: vec![StorageModel::SSD, StorageModel::WAN],
            tolerances_px: vec![1.0, 2.0],
            footprints: vec![ByteSize(9), ByteSize(8), ByteSize(7)],
            speeds: vec![1.0, 4.0],
            sizes_px: vec![[640, 360]],
            step_s: 0.1,
            seed: 0,
            faults: Faults::NONE,
        }
    }

    #[test]
    fn each_run_comes_once_and_the_base_stands_where_others_vary() {
        let sweep = sweep();
        let runs = sweep.runs();
        // For each storage: for each policy the base, a tolerance, two footprints, a speed; one that waits. Tolerance
        // and footprint together: two more.
        assert_eq!(runs.len(), 2 * (2 * 5 + 1) + 2);
        assert!(runs.iter().enumerate().all(|(at, run)| !runs[..at].contains(run)));
        assert_eq!(runs.iter().filter(|run| sweep.keeps_series(run)).count(), 2 * 3);
        assert_eq!(sweep.ours(), PolicyName::Foresight);
    }

    #[test]
    fn a_faster_run_arrives_sooner() {
        let sweep = sweep();
        let run = Run { speed: 4.0, ..sweep.base(0, StorageModel::SSD) };
        let flight = sweep.flight(&run);
        assert_eq!((flight.path.end_s(), &flight.arrivals_s[..]), (6.0, &[6.0][..]));
    }
}
