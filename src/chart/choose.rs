//! Which tolerance and footprint to take.

use super::flown::Flown;
use super::sheet::{Cell, Sheet};
use super::sweep::{Run, Sweep};
use crate::units::ByteSize;

/// Mean debt that goes unseen, px.
pub const DEBT_AIM_PX: f64 = 0.05;
/// Frame time that 99 of 100 frames keep where the machine was measured, ms: 30 a second.
pub const FRAME_AIM_MS: f64 = 33.0;

/// Frame times of live flights by tolerance: the 99th of 100, ms.
pub type FrameTimes = [(f64, f64)];

/// A setting and how it did, in the worst flight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    pub tolerance_px: f64,
    pub footprint: ByteSize,
    pub debt_mean_px: f64,
    /// How far the tolerance rose for want of memory, px.
    pub tolerance_max_px: f64,
    /// Live, where it was measured.
    pub frame_p99_ms: Option<f64>,
}

/// What is recommended, and what of the aims it keeps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Recommended {
    pub candidate: Candidate,
    pub keeps: Keeps,
}

/// Which aims a choice keeps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Keeps {
    All,
    /// Memory and storage hold it, but this machine is too slow for all tolerances.
    AllButTime,
    Nothing,
}

impl Candidate {
    /// Whether memory and storage hold it.
    fn is_held(&self) -> bool {
        self.debt_mean_px <= DEBT_AIM_PX && self.tolerance_max_px <= self.tolerance_px * (1.0 + 1e-9)
    }

    fn is_fast(&self) -> bool {
        self.frame_p99_ms.is_none_or(|frame_ms| frame_ms <= FRAME_AIM_MS)
    }
}

/// All tolerances by all footprints, on the first storage model.
pub fn candidates(sweep: &Sweep, flown: &[Flown], frame_times: &FrameTimes) -> Vec<Candidate> {
    let mut candidates = Vec::new();
    for &tolerance_px in &sweep.tolerances_px {
        for &footprint in &sweep.footprints {
            let run = |flight: usize| Run { tolerance_px, footprint, ..sweep.base(flight, sweep.storages[0]) };
            let of_all: Option<Vec<&Flown>> =
                (0..sweep.flights.len()).map(|at| flown.iter().find(|one| one.run == run(at))).collect();
            let Some(of_all) = of_all else { continue };
            let worst = |figure: fn(&Flown) -> f64| of_all.iter().map(|one| figure(one)).fold(0.0, f64::max);
            candidates.push(Candidate {
                tolerance_px,
                footprint,
                debt_mean_px: worst(|one| one.measured.debt_mean_px),
                tolerance_max_px: worst(|one| one.outcome.tolerance_max_px),
                frame_p99_ms: frame_times.iter().find(|(px, _)| *px == tolerance_px).map(|(_, ms)| *ms),
            });
        }
    }
    candidates
}

/// The finest tolerance, and of that the least footprint, that are held; no finer than the base where no flight told what
/// this machine can draw, or all told that it is too slow. Where none is held, the one with the least debt.
pub fn choose(sweep: &Sweep, candidates: &[Candidate]) -> Option<Recommended> {
    let finest = |may_be: &dyn Fn(&Candidate) -> bool| {
        let held = candidates.iter().filter(|one| one.is_held() && may_be(one));
        held.min_by(|a, b| a.tolerance_px.total_cmp(&b.tolerance_px).then(a.footprint.cmp(&b.footprint))).copied()
    };
    let is_no_finer = |one: &Candidate| one.tolerance_px >= sweep.tolerances_px[0];
    let is_slow = candidates.iter().all(|one| one.frame_p99_ms.is_some() && !one.is_fast());
    let is_fit = |one: &Candidate| one.is_fast() && (one.frame_p99_ms.is_some() || is_no_finer(one));
    let found = finest(&is_fit).map(|candidate| (candidate, Keeps::All));
    let found = found.or_else(|| finest(&is_no_finer).filter(|_| is_slow).map(|one| (one, Keeps::AllButTime)));
    let by_debt =
        |a: &&Candidate, b: &&Candidate| a.debt_mean_px.total_cmp(&b.debt_mean_px).then(a.footprint.cmp(&b.footprint));
    let least = || Some((*candidates.iter().min_by(by_debt)?, Keeps::Nothing));
    found.or_else(least).map(|(candidate, keeps)| Recommended { candidate, keeps })
}

/// How a choice was made, in a sentence.
pub fn why(sweep: &Sweep, choice: &Recommended) -> String {
    let storage = sweep.storages[0];
    let held = format!(
        "the finest tolerance, and with it the least footprint, at which the mean debt of every flight on {storage} stayed \
         under {DEBT_AIM_PX} px and memory never raised the tolerance"
    );
    let base_px = sweep.tolerances_px[0];
    match choice.keeps {
        Keeps::All if choice.candidate.frame_p99_ms.is_some() => {
            format!("{held}, and 99 of 100 live frames kept {FRAME_AIM_MS} ms")
        }
        Keeps::All => {
            format!("{held}; finer ones than {base_px} px were left out, as no live flight measured this machine")
        }
        Keeps::AllButTime => format!(
            "{held}, no finer than {base_px} px, as 99 of 100 live frames kept {FRAME_AIM_MS} ms at none: the frame time is to \
             be held by drawing coarser where it must"
        ),
        Keeps::Nothing => format!(
            "none of the settings kept the mean debt of every flight on {storage} under {DEBT_AIM_PX} px without raising the \
             tolerance: this is the one with the least debt"
        ),
    }
}

/// The candidates as rows; the one that was chosen is marked.
pub fn sheet(candidates: &[Candidate], chosen: Option<&Recommended>) -> Sheet {
    let mut sheet = Sheet::new(
        "recommendation",
        &["tolerance_px", "footprint_bytes", "debt_mean_px", "tolerance_max_px", "is_held", "is_chosen"],
    );
    for one in candidates {
        sheet.push([
            one.tolerance_px.into(),
            one.footprint.0.into(),
            one.debt_mean_px.into(),
            one.tolerance_max_px.into(),
            Cell::from(u64::from(one.is_held())),
            Cell::from(u64::from(chosen.is_some_and(|choice| choice.candidate == *one))),
        ]);
    }
    sheet
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::chart::compare::Flight;
    use crate::paging::PolicyName;
    use crate::storage::{Faults, StorageModel};

    fn sweep() -> Sweep {
        Sweep {
            flights: Vec::<Flight>::new(),
            policies: vec![PolicyName::Foresight],
            storages: vec![StorageModel::WAN],
            tolerances_px: vec![1.0, 0.5, 2.0],
            footprints: vec![ByteSize(100), ByteSize(50)],
            speeds: vec![1.0],
            sizes_px: vec![[64, 36]],
            step_s: 0.1,
            seed: 0,
            faults: Faults::NONE,
        }
    }

    fn candidate(tolerance_px: f64, footprint: u64, debt_mean_px: f64) -> Candidate {
        let (footprint, tolerance_max_px) = (ByteSize(footprint), tolerance_px);
        Candidate { tolerance_px, footprint, debt_mean_px, tolerance_max_px, frame_p99_ms: None }
    }

    #[test]
    fn the_finest_that_is_held_and_then_the_smallest() {
        let sweep = sweep();
        let mut all = vec![
            candidate(1.0, 100, 0.01),
            candidate(1.0, 50, 0.02),
            candidate(1.0, 25, 0.06),
            candidate(0.5, 100, 0.0),
            candidate(2.0, 25, 0.0),
        ];
        let choice = choose(&sweep, &all).unwrap();
        assert_eq!((choice.candidate, choice.keeps), (all[1], Keeps::All));
        assert!(why(&sweep, &choice).contains("no live flight"));
        // Memory raised the tolerance there.
        all[1].tolerance_max_px = 1.5;
        assert_eq!(choose(&sweep, &all).unwrap().candidate, all[0]);
        // A machine that was measured may take what is finer, or must take what is coarser.
        all.iter_mut().for_each(|one| one.frame_p99_ms = Some(20.0));
        assert_eq!(choose(&sweep, &all).unwrap().candidate, all[3]);
        all.iter_mut().for_each(|one| one.frame_p99_ms = Some(30.0 / one.tolerance_px + 10.0));
        assert_eq!(choose(&sweep, &all).unwrap().candidate, all[4]);
        // Too slow for all: memory and storage decide, and the frame time is held otherwise.
        all.iter_mut().for_each(|one| one.frame_p99_ms = Some(50.0));
        let choice = choose(&sweep, &all).unwrap();
        assert_eq!((choice.candidate, choice.keeps), (all[0], Keeps::AllButTime));
        assert!(why(&sweep, &choice).contains("drawing coarser"));
    }

    #[test]
    fn where_none_is_held_the_least_debt_counts() {
        let all = [candidate(1.0, 100, 0.4), candidate(2.0, 100, 0.3)];
        let choice = choose(&sweep(), &all).unwrap();
        assert_eq!((choice.candidate, choice.keeps), (all[1], Keeps::Nothing));
        assert!(why(&sweep(), &choice).starts_with("none"));
        assert_eq!(choose(&sweep(), &[]), None);
    }
}
