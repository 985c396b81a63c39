//! Heights as they are drawn against those of the source, in the frames of a flight.
//!
//! A point of a picture counts by the share of the screen that it stands for, and each frame counts alike. Errors in pixels
//! are those of a vertical distance at the point's own distance, as tolerances are: seen from above they show less.

use super::compare::WARM_S;
use super::flown::SAMPLE_S;
use super::gauge::{Found, Point, is_over, weight};
use super::sweep::{Run, Sweep};
use crate::geodesy::{GeoBounds, Geodetic};
use crate::simulate::{Library, SimulationError, fly};
use rayon::prelude::*;
use std::ops::AddAssign;

/// The elevation that a world was made from.
pub trait Truth: Sync {
    /// Height above the ellipsoid, metres; `None` where the source says nothing.
    fn height_m(&self, lat_rad: f64, lon_rad: f64) -> Option<f64>;

    /// A post of the source near a place, with its height; `None` where none lies within the bounds, which hold the place.
    fn post_near(&self, lat_rad: f64, lon_rad: f64, within: &GeoBounds) -> Option<Geodetic>;
}

/// A quantity over all points of a flight: mean, the value that 99 of 100 stay within, and the largest.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Spread {
    pub mean: f64,
    pub p99: f64,
    pub max: f64,
}

/// Height errors of one flight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeightErrors {
    pub error_px: Spread,
    pub error_m: Spread,
    /// What the pieces claim, at the points' distances.
    pub bound_px: Spread,
    /// Shares of the screen, 0 to 1: beyond the tolerance asked for, and beyond the piece's own bound.
    pub over_tolerance_share: f64,
    pub over_bound_share: f64,
}

/// What was counted beside.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct HeightCounts {
    /// With ground of the source in view.
    pub frames: u64,
    pub points: u64,
    /// Sum over the frames: of the ground in view, the share that no point stands for.
    pub(super) unmeasured_shares: f64,
    /// Points beyond their piece's bound, and how far at most, metres.
    pub over_bound_points: u64,
    pub over_bound_max_m: f64,
    /// Of the source's posts beside the points, where bounds hold.
    pub posts: u64,
    pub over_bound_posts: u64,
    pub over_bound_posts_max_m: f64,
}

impl HeightCounts {
    /// Of the ground in view, the share that no point stands for; 0 to 1, mean over the frames.
    pub fn unmeasured_share(&self) -> f64 {
        self.unmeasured_shares / self.frames.max(1) as f64
    }

    pub(super) fn take_post(&mut self, miss_m: f64, bound_m: f64) {
        self.posts += 1;
        if is_over(miss_m, bound_m) {
            self.over_bound_posts += 1;
            self.over_bound_posts_max_m = self.over_bound_posts_max_m.max(miss_m - bound_m);
        }
    }
}

impl AddAssign for HeightCounts {
    fn add_assign(&mut self, other: Self) {
        self.frames += other.frames;
        self.points += other.points;
        self.unmeasured_shares += other.unmeasured_shares;
        self.over_bound_points += other.over_bound_points;
        self.over_bound_max_m = self.over_bound_max_m.max(other.over_bound_max_m);
        self.posts += other.posts;
        self.over_bound_posts += other.over_bound_posts;
        self.over_bound_posts_max_m = self.over_bound_posts_max_m.max(other.over_bound_posts_max_m);
    }
}

/// What was measured in a run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeightRun {
    pub run: Run,
    /// `None` where nothing of the source was in view.
    pub errors: Option<HeightErrors>,
    pub counts: HeightCounts,
}

/// Flies our policy at each tolerance of the sweep on its first storage model, all else at its base, over all flights.
pub fn measure_heights(library: &Library, sweep: &Sweep, truth: &dyn Truth) -> Result<Vec<HeightRun>, SimulationError> {
    let of_flight = |flight: usize| {
        let base = sweep.base(flight, sweep.storages[0]);
        sweep.tolerances_px.iter().map(move |&tolerance_px| Run { tolerance_px, ..base })
    };
    let runs: Vec<Run> = (0..sweep.flights.len()).flat_map(of_flight).collect();
    runs.par_iter().map(|run| measure_run(library, sweep, run, truth)).collect()
}

fn measure_run(library: &Library, sweep: &Sweep, run: &Run, truth: &dyn Truth) -> Result<HeightRun, SimulationError> {
    let flight = sweep.flight(run);
    let (mut points, mut counts) = (Vec::new(), HeightCounts::default());
    let mut next_sample_s = WARM_S;
    fly(library, &flight.path, sweep.setup(run), |frame, simulation| {
        if frame.report.t_s - flight.path.start_s() >= next_sample_s - 1e-9 {
            next_sample_s += SAMPLE_S;
            let found = Found::of(&frame, simulation.index(), truth);
            counts += found.counts;
            points.extend(found.normalized());
        }
        true
    })?;
    Ok(HeightRun { run: *run, errors: HeightErrors::of(points, run.tolerance_px), counts })
}

impl HeightErrors {
    fn of(points: Vec<Point>, tolerance_px: f64) -> Option<Self> {
        let spread = |of: fn(&Point) -> f64| Spread::of(points.iter().map(|point| (point.weight, of(point))));
        let all = weight(&points);
        let share = |is_in: &dyn Fn(&Point) -> bool| weight(points.iter().filter(|point| is_in(point))) / all;
        Some(Self {
            error_px: spread(|point| point.miss_m * point.px_per_m)?,
            error_m: spread(|point| point.miss_m)?,
            bound_px: spread(|point| point.bound_m * point.px_per_m)?,
            over_tolerance_share: share(&|point| point.miss_m * point.px_per_m > tolerance_px),
            over_bound_share: share(&Point::is_over_bound),
        })
    }
}

impl Spread {
    /// Of weights and values; `None` of nothing.
    fn of(values: impl Iterator<Item = (f64, f64)>) -> Option<Self> {
        const MOST: f64 = 0.99;
        let mut sorted: Vec<(f64, f64)> = values.collect();
        sorted.sort_by(|a, b| a.1.total_cmp(&b.1));
        let max = sorted.last()?.1;
        let all: f64 = sorted.iter().map(|(weight, _)| weight).sum();
        let sum: f64 = sorted.iter().map(|(weight, value)| weight * value).sum();
        let mut below = 0.0;
        let p99 = sorted.iter().find(|(weight, _)| {
            below += weight;
            below >= MOST * all
        });
        Some(Self { mean: sum / all, p99: p99.map_or(max, |(_, value)| *value), max })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spreads_are_weighted() {
        let spread = Spread::of([(0.98, 1.0), (0.015, 3.0), (0.005, 9.0)].into_iter()).unwrap();
        assert!((spread.mean - 1.07).abs() < 1e-12);
        assert_eq!((spread.p99, spread.max), (3.0, 9.0));
        assert_eq!(Spread::of(std::iter::empty()), None);
        assert_eq!(HeightErrors::of(Vec::new(), 1.0), None);
        let point = |weight, miss_m| Point { weight, miss_m, bound_m: 1.5, px_per_m: 0.5 };
        let errors = HeightErrors::of(vec![point(3.0, 1.0), point(1.0, 4.0)], 1.0).unwrap();
        assert_eq!((errors.over_tolerance_share, errors.over_bound_share), (0.25, 0.25));
        let within = HeightErrors::of(vec![point(3.0, 1.0)], 1.0).unwrap();
        assert!(within.over_bound_share.is_sign_positive() && within.over_bound_share == 0.0);
        assert_eq!((errors.error_px.mean, errors.error_px.max, errors.bound_px.max), (0.875, 2.0, 0.75));
    }
}
