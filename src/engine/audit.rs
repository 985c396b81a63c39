//! Holes: what a settled frame covers and a frame does not.

use super::FrameReport;
use crate::render::SKY_ID;

/// Silhouettes are looked for no further than this, pixels.
const REACH_MAX_PX: usize = 64;

/// Pixels of a frame that show the sky where the settled frame of the same view shows something.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Uncovered {
    /// All of them.
    pub pixels: u64,
    /// Those further inside, and from the picture's edge, than a silhouette may move: drawn error shifts the border against the sky, and is counted
    /// as error already.
    pub holes: u64,
}

/// A frame without sky has no hole, whatever the settled one shows.
pub fn may_have_holes(drawn: &[u32]) -> bool {
    drawn.contains(&SKY_ID)
}

/// How far a silhouette may move in a frame: by the error that was allowed and what was still owed, and by the pixel's
/// rounding.
pub fn silhouette_px(report: &FrameReport) -> usize {
    let allowed_px = (report.tolerance_drawn_px + report.excess_max_px).ceil();
    (allowed_px.clamp(1.0, REACH_MAX_PX as f64) as usize).max(1)
}

/// Compares ids of the same view, rows from the top.
pub fn compare(drawn: &[u32], settled: &[u32], width_px: usize, reach_px: usize) -> Uncovered {
    let mut uncovered = Uncovered::default();
    for (at, (&drawn, &wanted)) in drawn.iter().zip(settled).enumerate() {
        if drawn == SKY_ID && wanted != SKY_ID {
            uncovered.pixels += 1;
            uncovered.holes += u64::from(!is_near_sky(settled, width_px, at, reach_px));
        }
    }
    uncovered
}

fn is_near_sky(ids: &[u32], width_px: usize, at: usize, reach_px: usize) -> bool {
    let (x, y) = (at % width_px, at / width_px);
    let height_px = ids.len() / width_px;
    // Beyond the picture's edge there may be sky.
    if x < reach_px || y < reach_px || x + reach_px >= width_px || y + reach_px >= height_px {
        return true;
    }
    let columns = x - reach_px..x + reach_px + 1;
    (y - reach_px..=y + reach_px).any(|row| ids[row * width_px..][columns.clone()].contains(&SKY_ID))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sky_inside_what_the_settled_frame_covers_is_a_hole_and_a_moved_border_is_not() {
        // The upper row of the settled frame is sky.
        let settled = [[0; 5], [7; 5], [7; 5], [7; 5], [7; 5]].concat();
        let mut drawn = settled.clone();
        drawn[5 + 2] = 0;
        assert_eq!(compare(&drawn, &settled, 5, 1), Uncovered { pixels: 1, holes: 0 });
        drawn[3 * 5 + 1] = 0;
        assert_eq!(compare(&drawn, &settled, 5, 1), Uncovered { pixels: 2, holes: 1 });
        drawn[4 * 5] = 0;
        assert_eq!(compare(&drawn, &settled, 5, 1), Uncovered { pixels: 3, holes: 1 }, "the picture's edge");
        assert!(may_have_holes(&drawn) && !may_have_holes(&[3, 4]));
        // What the settled frame does not show either is no hole.
        assert_eq!(compare(&[0; 25], &[0; 25], 5, 1), Uncovered::default());
    }
}
