//! Summaries of many numbers.

use serde::Serialize;

/// How a figure is spread over the frames of a flight.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Distribution {
    pub min: f64,
    pub median: f64,
    pub p99: f64,
    pub max: f64,
    pub mean: f64,
    /// Standard deviation of the sample as a whole (divided by n).
    pub sd: f64,
}

impl Distribution {
    /// `None` of nothing. Quantiles are by nearest rank: `p99` of fewer than 100 values is the largest.
    ///
    /// ```
    /// # use stoop::record::Distribution;
    /// let d = Distribution::of([3.0, 1.0, 2.0]).unwrap();
    /// assert_eq!((d.min, d.median, d.p99, d.max, d.mean), (1.0, 2.0, 3.0, 3.0, 2.0));
    /// ```
    pub fn of(values: impl IntoIterator<Item = f64>) -> Option<Self> {
        let mut sorted: Vec<f64> = values.into_iter().collect();
        sorted.sort_by(f64::total_cmp);
        let (&min, &max) = (sorted.first()?, sorted.last()?);
        let count = sorted.len() as f64;
        let rank = |share: f64| sorted[((share * count).ceil() as usize).clamp(1, sorted.len()) - 1];
        let mean = sorted.iter().sum::<f64>() / count;
        let variance = sorted.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / count;
        Some(Self { min, median: rank(0.5), p99: rank(0.99), max, mean, sd: variance.sqrt() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_values_that_occurred() {
        let d = Distribution::of((1..=200).map(f64::from)).unwrap();
        assert_eq!((d.min, d.median, d.p99, d.max), (1.0, 100.0, 198.0, 200.0));
        assert!((d.mean - 100.5).abs() < 1e-12 && (d.sd - 57.734_305_23).abs() < 1e-6);
        assert_eq!(Distribution::of([]), None);
    }
}
