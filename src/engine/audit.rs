//! Holes: what a settled frame covers and a frame does not.

use crate::render::SKY_ID;

/// Pixels that show the sky in `drawn` and something in `settled`; both of the same view.
pub fn count_holes(drawn: &[u32], settled: &[u32]) -> u64 {
    drawn.iter().zip(settled).filter(|&(&drawn, &settled)| drawn == SKY_ID && settled != SKY_ID).count() as u64
}

/// A frame without sky has no hole, whatever the settled one shows.
pub fn may_have_holes(drawn: &[u32]) -> bool {
    drawn.contains(&SKY_ID)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_sky_before_something_is_a_hole() {
        assert_eq!(count_holes(&[0, 0, 7, 8], &[0, 5, 0, 9]), 1);
        assert!(may_have_holes(&[3, 0]) && !may_have_holes(&[3, 4]));
    }
}
