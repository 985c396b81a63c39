//! Skirts: as deep as the largest errors drawn on the two sides of a seam, in this frame.

use super::GroundPress;
use super::front::Piece;
use crate::forest::{CellId, Side};
use crate::geodesy::SEMI_MAJOR_M;

/// Rounding of positions in f32, as a share of a piece's size, and at least this much, metres.
const ROUNDING: f64 = 1e-6;
const DEPTH_MIN_M: f64 = 0.05;

/// Depth by piece, metres. Two surfaces that meet each lie within their error of the truth, so that their gap is at most
/// the sum of both errors; a piece takes the largest sum over its neighbours. `pieces` ascend by cell and lie apart.
pub fn depths_m(pieces: &[Piece], press: Option<&GroundPress>) -> Vec<f64> {
    let mut beside_m = vec![0.0f64; pieces.len()];
    for (at, piece) in pieces.iter().enumerate() {
        for neighbor in Side::ALL.into_iter().flat_map(|side| piece.cell.edge_neighbors(side)) {
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
            let rounding_m = DEPTH_MIN_M + ROUNDING * piece.terrain.rep.cell.bounds().height_rad() * SEMI_MAJOR_M;
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
