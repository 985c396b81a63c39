//! What a frame will cost, fitted as it runs, so that the drawn tolerance can be raised before a frame gets too long
//! (Funkhouser, Séquin 1993, "Adaptive display algorithm for interactive frame rates", §4: cost of what is to be drawn,
//! predicted from counts; we fit the coefficients instead of measuring them beforehand).

use crate::paging::Aim;
use crate::select::Selection;
use glam::{DMat3, DVec3};

/// What old frames weigh after each new one: about 60 frames count.
const FORGET: f64 = 0.984;
/// Triangles and runs of objects are counted in these, so that all coefficients are of about one size.
const TRIANGLES_UNIT: f64 = 10_000.0;
const RUNS_UNIT: f64 = 100.0;
/// What is believed before any frame, milliseconds: of a frame, of each 10,000 triangles, of each 100 runs.
const PRIOR_MS: DVec3 = DVec3::new(2.0, 1.0, 0.3);
/// Its weight, in frames.
const PRIOR_WEIGHT: f64 = 0.5;
/// A frame that took longer than this many times what was expected was held up by something else, and counts as that.
const OUTLIER: f64 = 3.0;
/// A frame made finer must fit into this share of the time: the next one may be a little dearer, and one step of the
/// tolerance costs up to 1.1² times the triangles.
const ROOM: f64 = 0.8;

/// What a frame may take at least, over its fixed part.
const FIXED_SHARE: f64 = 1.25;

/// Counts that a frame's cost follows from.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Load {
    pub triangles: u64,
    pub runs: u64,
}

impl Load {
    fn features(self) -> DVec3 {
        DVec3::new(1.0, self.triangles as f64 / TRIANGLES_UNIT, self.runs as f64 / RUNS_UNIT)
    }

    /// What drawing a selection will take, as far as it can be told.
    pub fn of(selection: &Selection) -> Self {
        let ranges: usize = selection.objects.iter().map(|drawn| drawn.objects.len()).sum();
        Self { triangles: selection.stats.triangles, runs: (selection.pieces.len() + ranges) as u64 }
    }
}

/// cost = a + b · triangles + c · runs, by least squares over the last frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CostModel {
    /// Weighted sums of features × features and of features × cost.
    moments: DMat3,
    products: DVec3,
    coefficients_ms: DVec3,
}

impl Default for CostModel {
    fn default() -> Self {
        Self { moments: DMat3::ZERO, products: DVec3::ZERO, coefficients_ms: PRIOR_MS }
    }
}

impl CostModel {
    pub fn predict_ms(&self, load: Load) -> f64 {
        self.coefficients_ms.dot(load.features())
    }

    /// Learns from a frame.
    pub fn learn(&mut self, load: Load, took_ms: f64) {
        if !took_ms.is_finite() {
            return;
        }
        let features = load.features();
        let took_ms = took_ms.clamp(0.0, OUTLIER * self.predict_ms(load).max(1.0));
        self.moments = self.moments * FORGET
            + DMat3::from_cols(features * features.x, features * features.y, features * features.z);
        self.products = self.products * FORGET + features * took_ms;
        self.coefficients_ms = self.fit();
    }

    /// The least-squares coefficients that are not negative: those that would be are left out, the others fitted anew.
    fn fit(&self) -> DVec3 {
        let moments = self.moments + DMat3::from_diagonal(DVec3::splat(PRIOR_WEIGHT));
        let products = self.products + PRIOR_MS * PRIOR_WEIGHT;
        let mut kept = DVec3::ONE;
        loop {
            let only = DMat3::from_diagonal(kept);
            let rest = DMat3::from_diagonal(DVec3::ONE - kept);
            let fitted = (only * moments * only + rest).inverse() * (kept * products);
            let worst = (0..3).filter(|&at| fitted[at] < 0.0).min_by(|&a, &b| fitted[a].total_cmp(&fitted[b]));
            match worst {
                Some(at) => kept[at] = 0.0,
                None => return fitted,
            }
        }
    }
}

/// A frame time to hold.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimeBudget {
    pub frame_ms: f64,
    pub model: CostModel,
}

impl TimeBudget {
    pub fn new(frame_ms: f64) -> Self {
        Self { frame_ms, model: CostModel::default() }
    }

    /// Whether a selection can be drawn in time; made finer than the frame before it needs some room. Where a frame's
    /// fixed part alone takes about all of the time, its selection still has a share of that: a coarser picture would
    /// save nothing that shows.
    pub fn allows(&self, selection: &Selection, aim: Aim) -> bool {
        let share = if aim == Aim::Finer { ROOM } else { 1.0 };
        let limit_ms = self.frame_ms.max(self.model.predict_ms(Load::default()) * FIXED_SHARE);
        self.model.predict_ms(Load::of(selection)) <= limit_ms * share
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What drawing costs on some machine, with noise from −1 to 1 that follows from the frame's number.
    fn truth_ms(load: Load, frame: u64) -> f64 {
        let noise = (frame.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40) as f64 / (1u64 << 23) as f64 - 1.0;
        (4.0 + load.triangles as f64 / 5_000.0 + load.runs as f64 / 50.0) * (1.0 + 0.1 * noise)
    }

    #[test]
    fn learns_what_frames_cost() {
        let mut model = CostModel::default();
        let load = |frame: u64| Load { triangles: 20_000 + frame * 7_919 % 90_000, runs: 40 + frame * 31 % 400 };
        (0..300).for_each(|frame| model.learn(load(frame), truth_ms(load(frame), frame)));
        for at in [Load { triangles: 10_000, runs: 50 }, Load { triangles: 100_000, runs: 500 }] {
            let expected_ms = 4.0 + at.triangles as f64 / 5_000.0 + at.runs as f64 / 50.0;
            assert!((model.predict_ms(at) / expected_ms - 1.0).abs() < 0.1, "{model:?}");
        }
    }

    #[test]
    fn coefficients_are_never_negative_and_a_hitch_hardly_counts() {
        let mut model = CostModel::default();
        // More triangles go with less time: another load made the others slow.
        (0..100u64).for_each(|at| model.learn(Load { triangles: 1000 * at, runs: at }, 200.0 - at as f64));
        assert!(model.coefficients_ms.min_element() >= 0.0, "{model:?}");
        let mut model = CostModel::default();
        let load = Load { triangles: 50_000, runs: 200 };
        (0..100).for_each(|frame| model.learn(load, truth_ms(load, frame)));
        let before_ms = model.predict_ms(load);
        model.learn(load, 5_000.0);
        model.learn(load, f64::NAN);
        assert!(model.predict_ms(load) < 1.1 * before_ms);
    }
}
