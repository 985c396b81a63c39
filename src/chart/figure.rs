//! A chart before it is drawn: curves over two axes, and the table of what they show.

use super::sheet::Sheet;

/// How values lie along an axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Scale {
    Linear,
    /// Values below this, 0 among them, are drawn at it; above 0.
    Log {
        least: f64,
    },
}

/// An axis; its name says the unit.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    pub name: String,
    pub scale: Scale,
    /// Lengths in bytes are told in binary multiples.
    pub is_bytes: bool,
}

impl Axis {
    pub fn linear(name: &str) -> Self {
        Self { name: name.to_owned(), scale: Scale::Linear, is_bytes: false }
    }

    pub fn log(name: &str, least: f64) -> Self {
        Self { scale: Scale::Log { least }, ..Self::linear(name) }
    }

    pub fn bytes(name: &str) -> Self {
        Self { is_bytes: true, ..Self::log(name, 1.0) }
    }
}

/// How a curve is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stroke {
    Line,
    /// Of limits and bounds.
    Dashed,
    /// A line with its points.
    Dotted,
    /// Points alone.
    Points,
}

/// A place of a curve; a name is written beside it.
#[derive(Clone, Debug, PartialEq)]
pub struct Spot {
    pub x: f64,
    pub y: f64,
    pub name: Option<String>,
}

impl From<(f64, f64)> for Spot {
    fn from((x, y): (f64, f64)) -> Self {
        Self { x, y, name: None }
    }
}

/// A curve. Curves of one name have one colour on the whole page, and stand in the legend once.
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    pub name: String,
    pub stroke: Stroke,
    pub spots: Vec<Spot>,
}

impl Curve {
    pub fn new(name: impl Into<String>, stroke: Stroke, spots: impl IntoIterator<Item = impl Into<Spot>>) -> Self {
        Self { name: name.into(), stroke, spots: spots.into_iter().map(Into::into).collect() }
    }
}

/// One picture of a figure.
#[derive(Clone, Debug, PartialEq)]
pub struct Panel {
    pub title: String,
    pub x: Axis,
    pub y: Axis,
    pub curves: Vec<Curve>,
}

/// A figure of the page: panels that are read together, and their numbers.
#[derive(Clone, Debug, PartialEq)]
pub struct Figure {
    pub title: String,
    /// What is to be seen, and how it was measured.
    pub text: String,
    pub panels: Vec<Panel>,
    /// All that the panels show; in a file of its own.
    pub sheet: Sheet,
    /// Whether the page has the table too; else only its file.
    pub has_table: bool,
}

/// Of a long series no more than about this many spots are drawn: of each stretch the highest, as peaks count.
const SPOTS_MAX: usize = 600;

/// The highest of each stretch of a series, so that no peak is lost.
pub fn thinned(series: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let stretch = series.len().div_ceil(SPOTS_MAX).max(1);
    let highest = |of: &[(f64, f64)]| of.iter().copied().max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.total_cmp(&a.0)));
    series.chunks(stretch).filter_map(highest).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thinning_keeps_the_peaks_and_short_series() {
        let series: Vec<(f64, f64)> = (0..6000).map(|at| (at as f64, if at == 4321 { 9.0 } else { 1.0 })).collect();
        let thin = thinned(&series);
        assert!(thin.len() <= SPOTS_MAX && thin.contains(&(4321.0, 9.0)));
        assert_eq!(thinned(&series[..5]), &series[..5]);
        assert_eq!(thinned(&[]), []);
    }
}
