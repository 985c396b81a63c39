//! Quality degrades when the front does not fit into the footprint: the tolerance is raised, and comes back as soon as
//! it can.

/// A step of the tolerance, up or down.
const STEP: f64 = 1.1;
/// Beyond this factor the front is as coarse as it gets.
const FACTOR_MAX: f64 = 1e6;

/// The factor on the tolerance asked for, 1 when the front fits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DrawnTolerance {
    factor: f64,
    moving: bool,
}

impl Default for DrawnTolerance {
    fn default() -> Self {
        Self { factor: 1.0, moving: false }
    }
}

impl DrawnTolerance {
    pub fn factor(&self) -> f64 {
        self.factor
    }

    /// Whether the last frame changed it, so that the next one may do so again.
    pub fn is_moving(&self) -> bool {
        self.moving
    }

    /// Selects at the factor of the last frame; raises it while the result does not fit, and lowers it by one step
    /// when that fits as well. One step a frame keeps what is resident from being dropped and asked for in turns.
    pub fn settle<T>(&mut self, mut choose: impl FnMut(f64) -> T, fits: impl Fn(&T) -> bool) -> T {
        let before = self.factor;
        let mut chosen = choose(self.factor);
        if fits(&chosen) {
            if self.factor > 1.0 {
                let finer = (self.factor / STEP).max(1.0);
                let candidate = choose(finer);
                if fits(&candidate) {
                    self.factor = finer;
                    chosen = candidate;
                }
            }
        } else {
            while !fits(&chosen) && self.factor < FACTOR_MAX {
                self.factor *= STEP;
                chosen = choose(self.factor);
            }
        }
        self.moving = self.factor < before;
        chosen
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rises_at_once_to_the_least_that_fits_and_comes_back_in_steps() {
        let mut tolerance = DrawnTolerance::default();
        let bytes = |factor: f64| 100.0 / factor;
        tolerance.settle(bytes, |&bytes| bytes <= 50.0);
        let raised = tolerance.factor();
        assert!((2.0..2.0 * STEP).contains(&raised));
        tolerance.settle(bytes, |&bytes| bytes <= 50.0);
        assert_eq!((tolerance.factor(), tolerance.is_moving()), (raised, false));
        for _ in 0..100 {
            tolerance.settle(bytes, |&bytes| bytes <= 200.0);
        }
        assert_eq!((tolerance.factor(), tolerance.is_moving()), (1.0, false));
    }
}
