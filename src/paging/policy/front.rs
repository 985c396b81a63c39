//! `front`: prioritized prefetching (Varadhan & Manocha 2002, §4.2) with their replacement (§4.3).
//!
//! The view is widened by an angle that grows with the pan rate; its front holds all that may be needed next. A rep of it
//! whose error nears the tolerance δ from below will be replaced by its children (CHD), one whose parent's error nears δ
//! from above by that parent (PAR). How near is Priority against δ (see [`priority`]); candidates go into bins over
//! [0, δ] by that distance, first in first out inside a bin. What has been prefetched is classified again, so that the
//! prefetch runs several levels ahead of the front. Replacement by their InMemoryList with StartTail is the request
//! manager's, which all policies share; the bins are the order of its prefetched part.
//!
//! Where ours departs, and why:
//! * Pages of the wider front that the present one lacks count as reps at δ itself: they are needed as soon as a pan
//!   brings them into view, whatever their error. Theirs are ordered by their error alone.
//! * The layers of the ground have fronts of their own; pages of objects have no PAR and CHD here, and come when their
//!   projected dimension, as a share of the threshold, nears 1 from below.
//! * A parent whose error is more than 2 δ falls outside of [0, δ]; it goes to the last bin, since terrain errors may
//!   shrink by any factor from level to level.
//! * Fetching never holds a frame up, and a candidate that is under way is cancelled once it is none any more.

mod bins;
mod candidates;
mod priority;

use super::wide::widened;
use super::{Policy, Situation, is_due};
use crate::camera::View;
use crate::select::Demand;
use bins::Bins;
use candidates::Candidates;
use serde::{Deserialize, Serialize};

/// Parameters of [`FrontPolicy`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FrontParams {
    /// How far ahead pans are followed, seconds; at least 0.
    pub look_ahead_s: f64,
    /// Factor on the pan rate in the widening of the view; 0 and more.
    pub pan_gain: f64,
    /// The view is wider by at least this on each side, radians; 0 and more.
    pub least_pan_rad: f64,
    /// θ₁: at this angle beyond the view's half angle the angular priority is a half; radians, above 0.
    pub theta1_rad: f64,
    /// Bins over [0, δ], 1 to 64.
    pub bins: u32,
    /// How many levels candidates may lie from the front, 0 to 8; 0 takes what pans bring alone.
    pub levels: u32,
    /// Pages of objects are candidates from this share of the threshold on, 0 to 1.
    pub objects_from: f64,
    /// Candidates are classified anew after this time, seconds; 0 does so in each frame.
    pub replan_s: f64,
}

impl Default for FrontParams {
    fn default() -> Self {
        Self {
            look_ahead_s: 0.5,
            pan_gain: 1.0,
            least_pan_rad: 0.05,
            theta1_rad: 0.5,
            bins: 16,
            levels: 2,
            objects_from: 0.5,
            replan_s: 0.03,
        }
    }
}

/// The policy with its bins.
pub struct FrontPolicy {
    params: FrontParams,
    bins: Bins,
    plan: Vec<Demand>,
    planned_s: Option<f64>,
}

impl FrontPolicy {
    pub fn new(params: FrontParams) -> Self {
        Self { params, bins: Bins::new(params.bins), plan: Vec::new(), planned_s: None }
    }
}

/// The view that prefetching looks at: as much wider as a pan at this rate turns it within the look-ahead time.
fn prefetch_view(params: &FrontParams, view: &View, turn_rad_per_s: [f64; 2]) -> View {
    let by_rad =
        turn_rad_per_s.map(|rate| params.pan_gain * rate.abs() * params.look_ahead_s + params.least_pan_rad.max(0.0));
    widened(view, by_rad)
}

impl Policy for FrontPolicy {
    fn demands(&mut self, situation: &Situation<'_>, front: &[Demand]) -> Vec<Demand> {
        if is_due(self.planned_s, situation.frame.now_s, self.params.replan_s) {
            let wide = prefetch_view(&self.params, situation.frame.view, situation.forecast.turn_rad_per_s());
            let candidates = Candidates::gather(&self.params, situation, &wide, front);
            self.plan = self.bins.fill(candidates);
            self.planned_s = Some(situation.frame.now_s);
        }
        // What the front has come to want since the last plan is the front's: a page counts at its highest rank.
        front.iter().chain(&self.plan).copied().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::wide::half_angles_rad;
    use super::*;
    use crate::camera::Pose;
    use crate::geodesy::Geodetic;

    #[test]
    fn the_prefetch_view_grows_with_the_pan_rate() {
        let params = FrontParams { least_pan_rad: 0.1, look_ahead_s: 0.5, pan_gain: 2.0, ..FrontParams::default() };
        let pose = Pose { eye: Geodetic::from_degrees(33.0, -84.0, 1000.0), heading_rad: 0.0, pitch_rad: -0.5 };
        let view = View::new(pose, 0.8, [360, 360]);
        let half = |rates| half_angles_rad(&prefetch_view(&params, &view, rates))[0];
        assert!((half([0.0, 0.0]) - 0.5).abs() < 0.005);
        // 2 · 0.2 rad/s · 0.5 s more, whichever way it turns.
        for rates in [[0.2, 0.0], [-0.2, 0.0], [0.1, -0.2]] {
            assert!((half(rates) - 0.7).abs() < 0.005, "{}", half(rates));
        }
    }
}
