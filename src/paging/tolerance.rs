//! Quality degrades when the front does not fit into the footprint or the frame's time: the tolerance is raised, and
//! comes back as soon as it can (for time: Funkhouser & Séquin 1993).

use serde::Serialize;

/// A step of the tolerance, up or down.
const STEP: f64 = 1.1;
/// Beyond this factor the front is as coarse as it gets.
const FACTOR_MAX: f64 = 1e6;
/// For want of time the tolerance is raised no further than this: what a frame costs whatever it shows cannot be
/// saved, and a picture must stay.
const TIME_FACTOR_MAX: f64 = 16.0;

/// What is lacking where the tolerance is raised.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Lack {
    #[default]
    Nothing,
    Memory,
    Time,
}

/// What a front is tried for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Aim {
    /// To go on as before, or coarser.
    Hold,
    /// To be finer than the frame before.
    Finer,
}

/// The factor on the tolerance asked for, 1 when the front fits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DrawnTolerance {
    factor: f64,
    moving: bool,
    lack: Lack,
}

impl Default for DrawnTolerance {
    fn default() -> Self {
        Self { factor: 1.0, moving: false, lack: Lack::Nothing }
    }
}

impl DrawnTolerance {
    /// Raised for want of time, as it was before.
    pub fn slowed(factor: f64) -> Self {
        Self { factor, moving: false, lack: if factor > 1.0 { Lack::Time } else { Lack::Nothing } }
    }

    pub fn factor(&self) -> f64 {
        self.factor
    }

    /// Whether the last frame changed it, so that the next one may do so again.
    pub fn is_moving(&self) -> bool {
        self.moving
    }

    /// Why it is raised.
    pub fn lack(&self) -> Lack {
        self.lack
    }

    /// Selects at the factor of the last frame; raises it while something lacks, and lowers it by one step when
    /// nothing lacks then either. One step a frame, and what `lacks` keeps back from [`Aim::Finer`], keep it from
    /// going up and down, and what is resident from being dropped and asked for in turns.
    pub fn settle<T>(&mut self, mut choose: impl FnMut(f64) -> T, lacks: impl Fn(&T, Aim) -> Option<Lack>) -> T {
        let before = self.factor;
        let mut chosen = choose(self.factor);
        let mut lack = lacks(&chosen, Aim::Hold);
        if lack.is_none() && self.factor > 1.0 {
            let finer = (self.factor / STEP).max(1.0);
            let refused = lacks(&chosen, Aim::Finer).or_else(|| {
                let candidate = choose(finer);
                let refused = lacks(&candidate, Aim::Finer);
                if refused.is_none() {
                    self.factor = finer;
                    chosen = candidate;
                }
                refused
            });
            // What keeps it up now may be another than what raised it.
            self.lack = refused.unwrap_or(self.lack);
        }
        while let Some(why) = lack
            && self.factor < limit(why)
        {
            self.lack = why;
            self.factor *= STEP;
            chosen = choose(self.factor);
            lack = lacks(&chosen, Aim::Hold);
        }
        if self.factor <= 1.0 {
            self.lack = Lack::Nothing;
        }
        self.moving = self.factor < before;
        chosen
    }
}

fn limit(lack: Lack) -> f64 {
    if lack == Lack::Time { TIME_FACTOR_MAX } else { FACTOR_MAX }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lacks_memory(room: f64) -> impl Fn(&f64, Aim) -> Option<Lack> {
        move |&bytes, _| (bytes > room).then_some(Lack::Memory)
    }

    #[test]
    fn rises_at_once_to_the_least_that_fits_and_comes_back_in_steps() {
        let mut tolerance = DrawnTolerance::default();
        let bytes = |factor: f64| 100.0 / factor;
        tolerance.settle(bytes, lacks_memory(50.0));
        let raised = tolerance.factor();
        assert!((2.0..2.0 * STEP).contains(&raised));
        assert_eq!(tolerance.lack(), Lack::Memory);
        tolerance.settle(bytes, lacks_memory(50.0));
        assert_eq!((tolerance.factor(), tolerance.is_moving()), (raised, false));
        for _ in 0..100 {
            tolerance.settle(bytes, lacks_memory(200.0));
        }
        assert_eq!((tolerance.factor(), tolerance.is_moving(), tolerance.lack()), (1.0, false, Lack::Nothing));
    }

    #[test]
    fn time_that_nothing_can_save_does_not_take_the_picture_away() {
        let mut tolerance = DrawnTolerance::default();
        tolerance.settle(|factor| factor, |_, _| Some(Lack::Time));
        assert!((TIME_FACTOR_MAX..TIME_FACTOR_MAX * STEP).contains(&tolerance.factor()));
    }

    #[test]
    fn a_steady_load_is_drawn_at_a_steady_tolerance_in_spite_of_noise() {
        let mut tolerance = DrawnTolerance::default();
        let mut changes = 0;
        for frame in 0..1000u32 {
            // Cost falls with the tolerance; its estimate wavers by 5 %.
            let waver = 1.0 + 0.05 * f64::from(frame % 7) / 3.0 - 0.05;
            let before = tolerance.factor();
            let lacks = |&cost: &f64, aim: Aim| {
                (cost > if aim == Aim::Finer { 0.8 * 33.0 } else { 33.0 }).then_some(Lack::Time)
            };
            tolerance.settle(|factor| waver * 100.0 / factor.powf(1.5), lacks);
            changes += u32::from(tolerance.factor() != before);
        }
        assert!(changes <= 3, "{changes} changes");
    }
}
