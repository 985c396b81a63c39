//! Which side cells should have.

use super::compare::Delays;
use super::lemma::Prediction;
use serde::{Deserialize, Serialize};

/// What a side costs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CurvePoint {
    pub side_m: f64,
    pub cells: u64,
    /// Crossings looked at; fewer than there are where the cells are too many for all.
    pub crossings: u64,
    pub redundancy: f64,
    /// Bytes of the layout.
    pub layout_bytes: f64,
    /// Bytes that a crossing reads in the mean and at most.
    pub run_bytes_mean: f64,
    pub run_bytes_max: f64,
    /// Stored bytes of the largest set: decoded, buildings take some ten to twenty times as much of the footprint.
    pub set_bytes_max: f64,
    /// By the storage model that the layout is for, from the layout and from the packs.
    pub layout: Delays,
    pub packs: Delays,
    /// Lemmas 1 and 2.
    pub predicted: Prediction,
}

/// Whether a layout is worth its bytes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub enum Verdict {
    /// Crossings are faster by this share of the time from the packs, 0 to 1, in the mean and in the worst case.
    Pays { mean: f64, worst: f64 },
    /// By no more than these.
    Useless { mean: f64, worst: f64 },
}

/// A layout pays where it takes this share off the mean or off the longest delay of a crossing.
pub const PAYS_FROM: f64 = 0.1;

/// What was chosen of a curve, or why nothing was.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Choice {
    /// The place of the point.
    At(usize),
    /// No side is within the limit; the least possible redundancy.
    None { least_redundancy: f64 },
}

/// The knee of redundancy against the mean delay of a crossing, which larger cells lower and raise: the point of the curve,
/// both in logarithms and scaled to 0 … 1 between its ends, that lies furthest below the line between those (Satopää et al.
/// 2011, *Finding a "kneedle" in a haystack*); where its redundancy is beyond the limit, that of the least delay among those
/// within.
pub fn choose(curve: &[CurvePoint], max_redundancy: f64) -> Choice {
    let within = |at: &usize| curve[*at].redundancy <= max_redundancy;
    let all = || 0..curve.len();
    let least = all().map(|at| curve[at].redundancy).fold(f64::INFINITY, f64::min);
    if let Some(knee) = knee(curve).filter(within) {
        return Choice::At(knee);
    }
    let best = all().filter(within).min_by(|&a, &b| curve[a].layout.mean_s.total_cmp(&curve[b].layout.mean_s));
    best.map_or(Choice::None { least_redundancy: least }, Choice::At)
}

fn knee(curve: &[CurvePoint]) -> Option<usize> {
    let points: Vec<(f64, f64)> =
        curve.iter().map(|point| (point.redundancy.max(1e-9).ln(), point.layout.mean_s.max(1e-12).ln())).collect();
    let range = |of: &dyn Fn(&(f64, f64)) -> f64| {
        let low = points.iter().map(of).fold(f64::INFINITY, f64::min);
        let high = points.iter().map(of).fold(f64::NEG_INFINITY, f64::max);
        (low, (high - low).max(1e-12))
    };
    let ((x0, wide), (y0, high)) = (range(&|point| point.0), range(&|point| point.1));
    let below = |at: usize| {
        let (x, y) = points[at];
        1.0 - (x - x0) / wide - (y - y0) / high
    };
    (0..points.len()).max_by(|&a, &b| below(a).total_cmp(&below(b)))
}

/// Whether crossings are so much faster from a layout that it is worth its bytes.
pub fn verdict(layout: &Delays, packs: &Delays) -> Verdict {
    let gain = |layout_s: f64, packs_s: f64| if packs_s > 0.0 { 1.0 - layout_s / packs_s } else { 0.0 };
    let mean = gain(layout.mean_s, packs.mean_s);
    let worst = gain(layout.max_s, packs.max_s);
    if mean.max(worst) >= PAYS_FROM { Verdict::Pays { mean, worst } } else { Verdict::Useless { mean, worst } }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(side_m: f64, redundancy: f64, mean_s: f64) -> CurvePoint {
        CurvePoint {
            side_m,
            cells: 1,
            crossings: 1,
            redundancy,
            layout_bytes: 0.0,
            run_bytes_mean: 0.0,
            run_bytes_max: 0.0,
            set_bytes_max: 0.0,
            layout: Delays { mean_s, max_s: mean_s, ..Delays::default() },
            packs: Delays { mean_s: 0.03, max_s: 0.05, ..Delays::default() },
            predicted: Prediction::default(),
        }
    }

    #[test]
    fn the_knee_is_taken_or_the_best_within_the_limit() {
        // Waiting falls steeply up to 100 m, hardly beyond; redundancy falls evenly.
        let sides = [
            (25.0, 60.0, 0.0100),
            (50.0, 33.0, 0.0101),
            (100.0, 19.0, 0.0103),
            (200.0, 17.0, 0.0205),
            (400.0, 16.0, 0.041),
        ];
        let curve: Vec<CurvePoint> = sides.map(|(side, redundancy, mean)| point(side, redundancy, mean)).into();
        assert_eq!(choose(&curve, 100.0), Choice::At(2));
        assert_eq!(choose(&curve, 18.0), Choice::At(3));
        assert_eq!(choose(&curve, 10.0), Choice::None { least_redundancy: 16.0 });
        assert_eq!(choose(&[], 10.0), Choice::None { least_redundancy: f64::INFINITY });
        assert!(matches!(verdict(&curve[0].layout, &curve[0].packs), Verdict::Pays { .. }));
        let slow = point(25.0, 60.0, 0.05);
        assert!(matches!(verdict(&slow.layout, &slow.packs), Verdict::Useless { .. }));
    }
}
