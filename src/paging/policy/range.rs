//! `range`: lookahead over the observer range (Funkhouser 1996, §4).
//!
//! The observer range holds all viewpoints that can be reached within the next N frames at the speeds v_p and v_r. It is
//! walked cell by cell on shortest paths, in the order of the frames that it takes to enter a cell (see [`observer`]).
//! What is seen from the cells in that order, at the level of detail that they ask for, is the lookahead set; it is closed
//! where what is to be read takes the time of N frames, or memory is full. The read set is served coarse to fine, then by
//! time to visibility. The release set is what left the lookahead longest ago, dropped before anything is loaded for it:
//! the request manager's order, which all policies share.
//!
//! Where ours departs, and why:
//! * His cells and the visibility between them are precomputed from walls. Outdoors there are none: an observer cell is a
//!   cell of the ground × an octave of height above it, with a side of about that height, so that what is seen from one
//!   cell is about the same; and what is seen is surveyed from its middle, kept for as long as it is near.
//! * Speeds are in heights above the ground per second and in the logarithm of the height, as the controllers cap them.
//!   These caps are far above what flights do (a range of a second holds thousands of cells), so that by default v_p and
//!   v_r are the present speeds with a margin; [`RangeParams::share_of_measured_speed`] 0 takes the caps.
//! * Details of the ground are quadtree levels: the coarser ones of a page are the pages above it.

mod directions;
mod lookahead;
mod observer;
mod surveys;

use super::{Policy, Situation, is_due};
use crate::camera::{MAX_HEIGHTS_PER_S, MAX_LOG_HEIGHT_PER_S};
use crate::select::Demand;
use directions::{Direction, reachable};
use lookahead::Lookahead;
use observer::{Eye, ObserverCell, Speeds, observer_range};
use serde::{Deserialize, Serialize};
use surveys::Surveys;

/// Parameters of [`RangePolicy`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RangeParams {
    /// N: how many frames the observer range reaches ahead; at least 1.
    pub frames: u32,
    /// Observer cells at most, 1 to 1024; the nearest by time.
    pub cells: u32,
    /// Directions that are told apart round the horizon, 1 to 32.
    pub sectors: u32,
    /// v_r: the fastest turn, radians per second.
    pub v_r_rad_per_s: f64,
    /// v_p and v_r are this factor on the present speeds, and no more than the caps; 0 takes the caps themselves.
    pub share_of_measured_speed: f64,
    /// The set is closed where what is missing takes this many times N frames to read; above 0.
    pub bytes_factor: f64,
    /// The set is closed where it takes this share of the footprint, by estimates that are on the high side; above 0.
    pub memory_share: f64,
    /// How many levels of coarser pages are read before those that are wanted, 0 to 8.
    pub coarser_levels: u32,
    /// New surveys in a plan at most; at least 1.
    pub surveys: u32,
    /// The lookahead set is made anew after this time, seconds; 0 does so in each frame.
    pub replan_s: f64,
}

impl Default for RangeParams {
    fn default() -> Self {
        Self {
            frames: 60,
            cells: 64,
            sectors: 8,
            v_r_rad_per_s: 3.0,
            share_of_measured_speed: 1.5,
            bytes_factor: 1.0,
            memory_share: 0.75,
            coarser_levels: 2,
            surveys: 3,
            replan_s: 0.03,
        }
    }
}

/// Who rests may start: measured speeds count as at least these, per second.
const LEAST_HEIGHTS_PER_S: f64 = 0.1;
const LEAST_LOG_HEIGHT_PER_S: f64 = 0.1;
const LEAST_TURN_RAD_PER_S: f64 = 0.2;
/// Observer cells at most.
const CELLS_MAX: u32 = 1024;

/// The policy with what it has surveyed.
pub struct RangePolicy {
    params: RangeParams,
    surveys: Surveys,
    plan: Vec<Demand>,
    planned_s: Option<f64>,
}

impl RangePolicy {
    pub fn new(params: RangeParams) -> Self {
        Self { params, surveys: Surveys::default(), plan: Vec::new(), planned_s: None }
    }

    fn make_plan(&mut self, situation: &Situation<'_>) -> Vec<Demand> {
        let eye = Eye { place: situation.frame.view.pose.eye, above_m: situation.forecast.above_m() };
        let mut lookahead = Lookahead::new(&self.params, situation);
        self.surveys.begin(situation, self.params.surveys);
        for (frames, cell, direction) in viewpoints(&self.params, situation, &eye) {
            let Some(wants) = self.surveys.from(situation, &self.params, &eye, (cell, direction)) else { continue };
            if !lookahead.add(wants, frames) {
                break;
            }
        }
        self.surveys.end();
        lookahead.into_demands()
    }
}

impl Policy for RangePolicy {
    fn demands(&mut self, situation: &Situation<'_>, front: &[Demand]) -> Vec<Demand> {
        if is_due(self.planned_s, situation.frame.now_s, self.params.replan_s) {
            self.plan = self.make_plan(situation);
            self.planned_s = Some(situation.frame.now_s);
        }
        // The front is part of the lookahead set; a page counts at its highest rank.
        front.iter().chain(&self.plan).copied().collect()
    }
}

/// v_p and v_r, per frame.
fn speeds(params: &RangeParams, situation: &Situation<'_>) -> Speeds {
    let [yaw, pitch] = situation.forecast.turn_rad_per_s();
    let log_height = situation.forecast.log_height_per_s().abs();
    let all = situation.forecast.heights_per_s();
    let heights = (all * all - log_height * log_height).max(0.0).sqrt();
    let share = params.share_of_measured_speed;
    let speed =
        |measured: f64, least: f64, cap: f64| if share > 0.0 { (share * measured).max(least).min(cap) } else { cap };
    let turn_cap = params.v_r_rad_per_s.max(0.0);
    let step_s = situation.frame.step_s;
    Speeds {
        heights: speed(heights, LEAST_HEIGHTS_PER_S, MAX_HEIGHTS_PER_S) * step_s,
        log_height: speed(log_height, LEAST_LOG_HEIGHT_PER_S, MAX_LOG_HEIGHT_PER_S) * step_s,
        turn_rad: speed(yaw.hypot(pitch), LEAST_TURN_RAD_PER_S, turn_cap) * step_s,
    }
}

/// The observer range: where the observer can be and where he can look by then, with the frames that it takes. He moves
/// and turns at the same time.
fn viewpoints(params: &RangeParams, situation: &Situation<'_>, eye: &Eye) -> Vec<(f64, ObserverCell, Direction)> {
    let speeds = speeds(params, situation);
    let frames_max = f64::from(params.frames.max(1));
    let cells = observer_range(eye, &speeds, frames_max, params.cells.clamp(1, CELLS_MAX) as usize);
    let directions = reachable(params.sectors, &situation.frame.view.pose, speeds.turn_rad, frames_max);
    let mut viewpoints: Vec<(f64, ObserverCell, Direction)> = cells
        .iter()
        .flat_map(|&(to_enter, cell)| directions.iter().map(move |&(to_turn, to)| (to_enter.max(to_turn), cell, to)))
        .collect();
    viewpoints.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
    viewpoints
}
