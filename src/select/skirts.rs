//! Skirts: as deep as the largest errors drawn on the two sides of a seam, in this frame.

use super::GroundPress;
use super::front::Piece;
use crate::forest::CellId;
use std::f64::consts::FRAC_PI_2;

/// Rounding of positions in f32, as a share of a piece's size, and at least this much, metres.
const ROUNDING: f64 = 1e-6;
const DEPTH_MIN_M: f64 = 0.05;

/// Depth by piece, metres. Two surfaces that meet each lie within their error of the truth, so that their gap is at most
/// the sum of both errors; a piece takes the largest sum over its neighbours. `pieces` ascend by cell and lie apart.
pub fn depths_m(pieces: &[Piece], press: Option<&GroundPress>) -> Vec<f64> {
    let mut beside_m = vec![0.0f64; pieces.len()];
    for (at, piece) in pieces.iter().enumerate() {
        for neighbor in cells_beside(piece.cell) {
            if let Some(other) = piece_over(pieces, neighbor) {
                // Finer pieces find this one as the piece over their neighbour: so both learn of each other.
                beside_m[at] = beside_m[at].max(pieces[other].error_m());
                beside_m[other] = beside_m[other].max(piece.error_m());
            }
        }
    }
    let pressed_m = |piece: &Piece| match press {
        Some(press) if piece.distance_m <= 2.0 * f64::from(press.radius_m) => f64::from(press.depth_m),
        _ => 0.0,
    };
    pieces
        .iter()
        .zip(beside_m)
        .map(|(piece, beside_m)| {
            let rounding_m = DEPTH_MIN_M + ROUNDING * piece.terrain.cell.bounds().height_rad() * 6.4e6;
            piece.error_m() + beside_m + rounding_m + pressed_m(piece)
        })
        .collect()
}

/// The piece that covers a cell.
fn piece_over(pieces: &[Piece], cell: CellId) -> Option<usize> {
    // Pieces lie apart and a subtree is contiguous, so none stands between a cell and the piece that covers it.
    let at = pieces.partition_point(|piece| piece.cell <= cell).checked_sub(1)?;
    pieces[at].cell.contains(cell).then_some(at)
}

/// Cells of the same level across the sides: by a point beside each half of each side.
fn cells_beside(cell: CellId) -> impl Iterator<Item = CellId> {
    let bounds = cell.bounds();
    let (width, height, level) = (bounds.width_rad(), bounds.height_rad(), cell.level());
    let beside = [(-0.25, 0.5), (1.25, 0.5), (0.25, -0.25), (0.75, -0.25), (0.25, 1.25), (0.75, 1.25)];
    beside.into_iter().filter_map(move |(u, v)| {
        let lat_rad = bounds.south_rad + v * height;
        let lon_rad = bounds.west_rad + u * width;
        // Across a pole there is no edge to close.
        (lat_rad.abs() < FRAC_PI_2).then(|| CellId::containing(lat_rad, lon_rad, level))
    })
}
