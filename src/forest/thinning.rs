//! The thinning of columns with latitude.

use super::{LEVEL_MAX, Zone};

/// Where k grows: for k = 1, 2, …, the first row edge of the deepest level, counted from 45° poleward, with
/// cos φ ≤ 2⁻ᵏ. A coarser level's row edges are some of these, so that one table serves all levels.
const EDGES: [u32; LEVEL_MAX as usize] = [
    1_398_102, 2_844_903, 3_525_010, 3_860_315, 4_027_391, 4_110_858, 4_152_583, 4_173_444, 4_183_874, 4_189_089,
    4_191_697, 4_193_001, 4_193_653, 4_193_979, 4_194_142, 4_194_223, 4_194_264, 4_194_284, 4_194_294, 4_194_299,
    4_194_302, 4_194_303,
];

/// k: how many E–W splits less the row of cells `y` of `level` has, `⌊log2(1/cos φ)⌋` with φ the latitude of the
/// row's equatorward edge.
pub fn thinning(zone: Zone, level: u8, y: u32) -> u8 {
    if !zone.touches_pole() {
        return 0;
    }
    let edge = equatorward_edge(zone, level, y);
    EDGES.partition_point(|&threshold| threshold <= edge) as u8
}

/// The number of cells in a row within its zone, 2^(level − k).
pub fn columns(zone: Zone, level: u8, y: u32) -> u32 {
    1 << (level - thinning(zone, level, y))
}

/// Counted from 45° poleward, in rows of the deepest level.
fn equatorward_edge(zone: Zone, level: u8, y: u32) -> u32 {
    let from_equator = if zone.is_northern() { y } else { (1 << level) - 1 - y };
    from_equator << (LEVEL_MAX - level)
}

/// On the way from a zone's root to row `y` of `level`, the levels where k grows, so that a cell has one child across
/// and not two: bit `level − d` for level `d`, as the bits of `y` stand.
pub(super) fn thinned_bits(zone: Zone, level: u8, y: u32) -> u32 {
    if !zone.touches_pole() {
        return 0;
    }
    let edge = equatorward_edge(zone, level, y);
    let reached = EDGES.iter().take_while(|&&threshold| threshold <= edge);
    reached.fold(0, |bits, &threshold| {
        // Rows above have this edge cut off to fewer bits. With the lowest s bits cut it is still at the threshold or
        // above for s up to the highest bit in which they differ, or up to the zeros that end the threshold.
        let differing = (edge ^ threshold).checked_ilog2().unwrap_or(0);
        let cut = differing.max(threshold.trailing_zeros());
        bits | 1 << (cut - u32::from(LEVEL_MAX - level))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::FRAC_PI_4;

    #[test]
    fn the_table_is_its_formula() {
        let rows = f64::from(1 << LEVEL_MAX);
        for (k, &edge) in (1..).zip(&EDGES) {
            let exact = (0.5f64.powi(k).acos() / FRAC_PI_4 - 1.0) * rows;
            assert_eq!(edge, exact.ceil() as u32, "k = {k}");
        }
        // One more would be at the pole itself.
        assert_eq!(((0.5f64.powi(23).acos() / FRAC_PI_4 - 1.0) * rows).ceil(), rows);
    }

    /// The definition, level by level.
    fn thinned_bits_slowly(zone: Zone, level: u8, y: u32) -> u32 {
        (1..=level)
            .filter(|&d| thinning(zone, d, y >> (level - d)) > thinning(zone, d - 1, y >> (level - d + 1)))
            .fold(0, |bits, d| bits | 1 << (level - d))
    }

    #[test]
    fn thinned_levels_are_found_at_once() {
        for zone in [Zone::new(0), Zone::new(9), Zone::new(31)].into_iter().flatten() {
            for level in 0..=10 {
                for y in 0..1 << level {
                    assert_eq!(
                        thinned_bits(zone, level, y),
                        thinned_bits_slowly(zone, level, y),
                        "{zone:?} {level} {y}"
                    );
                }
            }
            for &edge in &EDGES {
                for y in edge.saturating_sub(3)..(edge + 3).min(1 << LEVEL_MAX) {
                    let y = if zone.is_northern() { y } else { (1 << LEVEL_MAX) - 1 - y };
                    assert_eq!(
                        thinned_bits(zone, LEVEL_MAX, y),
                        thinned_bits_slowly(zone, LEVEL_MAX, y),
                        "{zone:?} {y}"
                    );
                }
            }
        }
    }
}
