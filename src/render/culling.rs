//! What of a selection the drawn view sees: a selection may have been made for an older view and hold the whole Earth.

use crate::camera::{Frustum, View};
use crate::geodesy::{Ecef, HorizonCone, OrientedBox, Point};
use crate::select::{DrawPiece, GroundPress};
use glam::DVec3;

/// Least depth of skirts as a share of the distance: a few roundings of f32.
pub(super) const SEAM: f32 = 1e-6;
/// How far skirts lean outwards at most for each metre of depth; the same constant stands in terrain.wgsl.
const STEEPEST: f64 = 8.0;

pub(super) struct Sight {
    eye: Point<Ecef>,
    frustum: Frustum,
    horizon: HorizonCone,
    press_m: f64,
}

impl Sight {
    /// `lowest_m`: no ground lies below this height above the ellipsoid, metres.
    pub fn new(view: &View, press: Option<GroundPress>, lowest_m: f64) -> Self {
        Self {
            eye: view.eye(),
            frustum: view.frustum(),
            horizon: HorizonCone::new(view.eye(), (-lowest_m).max(0.0)),
            press_m: press.map_or(0.0, |press| f64::from(press.depth_m).max(0.0)),
        }
    }

    /// False when a piece lies wholly out of the view or behind the horizon.
    pub fn sees(&self, piece: &DrawPiece) -> bool {
        let bounds = self.with_skirts(piece);
        self.frustum.meets(&bounds) && !self.horizon.hides_box(&bounds)
    }

    /// The piece's box, grown by its skirts and by how far the ground is pressed down.
    fn with_skirts(&self, piece: &DrawPiece) -> OrientedBox {
        let around = &piece.around;
        let far_m = (around.center - self.eye).xyz().length() + around.half_m.length();
        let skirt_m = f64::from(piece.skirt_m).max(f64::from(SEAM) * far_m);
        let bounds = piece.cell.bounds();
        let lean = bounds.south_rad.abs().max(bounds.north_rad.abs()).tan().abs().min(STEEPEST);
        let grown_m = skirt_m * lean.hypot(1.0) + self.press_m;
        OrientedBox { half_m: around.half_m + DVec3::splat(grown_m), ..*around }
    }
}

#[cfg(test)]
mod tests {
    use super::super::layout::TERRAIN_WGSL;
    use super::STEEPEST;

    #[test]
    fn skirts_lean_as_far_as_the_shader_lets_them() {
        assert!(TERRAIN_WGSL.contains(&format!("const STEEPEST: f32 = {STEEPEST:.1};")));
    }
}
