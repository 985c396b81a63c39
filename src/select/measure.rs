//! Debt and excess: errors count only as far as the world can cure them at the tolerance asked for.

use super::SelectStats;

/// One region of a layer.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Item {
    share: f64,
    excess_px: f64,
}

/// A layer's regions.
#[derive(Clone, Debug, Default)]
pub struct LayerMeasure {
    items: Vec<Item>,
    raw_error_px: f64,
}

impl LayerMeasure {
    /// Adds a region with the excess drawn there.
    pub fn add(&mut self, share: f64, drawn_px: f64, excess_px: f64) {
        self.items.push(Item { share, excess_px });
        if share > 0.0 {
            self.raw_error_px = self.raw_error_px.max(drawn_px);
        }
    }

    /// Of regions that take some of the screen.
    pub fn excess_max_px(&self) -> f64 {
        self.items.iter().filter(|item| item.share > 0.0).map(|item| item.excess_px).fold(0.0, f64::max)
    }

    fn total_share(&self) -> f64 {
        self.items.iter().map(|item| item.share).sum()
    }
}

/// Writes the measures of all layers into the counts.
pub fn summarize(layers: &[LayerMeasure], stats: &mut SelectStats) {
    let mut all = Vec::new();
    stats.coverage = 1.0;
    for layer in layers {
        stats.raw_error_px = stats.raw_error_px.max(layer.raw_error_px);
        let total = layer.total_share();
        if total <= 0.0 {
            continue;
        }
        let debt_px: f64 = layer.items.iter().map(|item| item.share / total * item.excess_px).sum();
        let sharp: f64 = layer.items.iter().filter(|item| item.excess_px == 0.0).map(|item| item.share / total).sum();
        stats.debt_px += debt_px;
        // The layers lie over one another: what is sharp is sharp in all; the worst one bounds it.
        stats.coverage = stats.coverage.min(sharp.clamp(0.0, 1.0));
        all.extend(layer.items.iter().map(|item| Item { share: item.share / total, ..*item }));
    }
    all.retain(|item| item.share > 0.0);
    if all.iter().all(|item| item.excess_px == 0.0) {
        stats.coverage = 1.0;
        return;
    }
    all.sort_by(|a, b| b.excess_px.total_cmp(&a.excess_px).then(b.share.total_cmp(&a.share)));
    stats.excess_max_px = all.first().map_or(0.0, |item| item.excess_px);
    stats.excess_p99_px = weighted_p99(&all);
}

/// The excess that 99 % of the screen do not exceed; `items` by falling excess.
fn weighted_p99(items: &[Item]) -> f64 {
    let above = 0.01 * items.iter().map(|item| item.share).sum::<f64>();
    let mut seen = 0.0;
    for item in items {
        seen += item.share;
        if seen > above {
            return item.excess_px;
        }
    }
    0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn debt_is_the_weighted_mean_of_what_can_be_cured() {
        let mut terrain = LayerMeasure::default();
        terrain.add(0.5, 5.0, 4.0);
        terrain.add(0.25, 8.0, 0.0);
        terrain.add(0.25, 0.5, 0.0);
        let mut imagery = LayerMeasure::default();
        imagery.add(0.004, 9.0, 8.0);
        imagery.add(0.796, 3.0, 1.0);
        let mut stats = SelectStats::default();
        summarize(&[terrain, imagery, LayerMeasure::default()], &mut stats);
        assert!((stats.debt_px - (2.0 + (0.004 * 8.0 + 0.796) / 0.8)).abs() < 1e-12);
        assert_eq!((stats.excess_max_px, stats.raw_error_px, stats.coverage), (8.0, 9.0, 0.0));
        assert_eq!(stats.excess_p99_px, 4.0);
    }
}
