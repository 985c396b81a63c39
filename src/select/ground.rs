//! The ground under the eye: its chain of cells is demanded before all else, and where the drawn surface would bury the
//! eye it is pressed down.

use super::GroundPress;
use super::demands::DemandList;
use super::front::step_terrain;
use super::layer::Layer;
use super::sight::Sight;
use crate::cells::LiveTree;
use crate::content::POSTS;
use crate::forest::index::IndexForest;
use crate::forest::{CellId, LEVEL_MAX};
use crate::geodesy::{OrientedBox, meridian_radius_m};
use std::f64::consts::{PI, TAU};

/// The drawn ground stays at least this far below the eye, metres.
pub const CLEARANCE_M: f64 = 2.0;
/// The pit has slopes of about 1 in this, and is at least as wide as two triangles of the drawn page.
const DEPTHS_PER_RADIUS: f64 = 10.0;
const SIDES_PER_RADIUS: f64 = 2.0;
const RADIUS_MIN_M: f64 = 50.0;

impl GroundPress {
    /// Whether the ground would lie above the eye; else it only comes too close.
    pub fn buries_eye(&self) -> bool {
        f64::from(self.depth_m) > CLEARANCE_M
    }
}

/// The surface that is drawn below the eye.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ground {
    height_m: f64,
    /// The longest side of a triangle of its page: only vertices are pressed down, and those round the eye must be.
    spacing_m: f64,
}

impl Ground {
    /// The press that takes this ground below an eye, if it needs one.
    pub fn press(&self, eye_height_m: f64) -> Option<GroundPress> {
        let depth_m = self.height_m - (eye_height_m - CLEARANCE_M);
        let radius_m = (DEPTHS_PER_RADIUS * depth_m).max(SIDES_PER_RADIUS * self.spacing_m).max(RADIUS_MIN_M);
        (depth_m > 0.0).then_some(GroundPress { depth_m: depth_m as f32, radius_m: radius_m as f32 })
    }
}

/// Goes down the cells under the eye, in view or not, demands their terrain, and finds the surface drawn there; `None`
/// where no terrain is resident.
pub fn under_eye(index: &IndexForest, cells: &LiveTree, sight: &Sight<'_>, demands: &mut DemandList) -> Option<Ground> {
    let eye = sight.view.pose.eye;
    let finest = CellId::containing(eye.lat_rad, eye.lon_rad, LEVEL_MAX);
    let mut layer = Layer::default();
    let mut next = index.tree(finest.zone()).map(|tree| tree.root());
    let mut distance_m = 0.0;
    while let Some(node) = next {
        let (low_m, high_m) = node.height_range_m();
        let around = OrientedBox::around(&node.cell().bounds(), low_m, high_m);
        distance_m = around.distance_m(sight.eye).max(distance_m);
        let px_per_m = sight.view.projected_px(1.0, distance_m);
        if !layer.front_is_settled() {
            demands.ground(&node);
            node.paged_segment().into_iter().for_each(|segment| demands.ground_segment(segment, false));
        }
        step_terrain(&mut layer, &node, cells, px_per_m, sight);
        if layer.front_is_settled() && layer.front_is_drawn() {
            break;
        }
        if !layer.front_is_settled() {
            let absent = node.absent_children().find(|segment| segment.root.contains(finest));
            absent.into_iter().for_each(|segment| demands.ground_segment(segment, true));
        }
        next = finest
            .ancestor(node.cell().level() + 1)
            .and_then(CellId::quadrant)
            .and_then(|quadrant| node.child(quadrant));
    }
    let drawn = layer.drawn()?;
    let bounds = drawn.rep.cell.bounds();
    // π and −π are the same meridian; cells know it as −π.
    let lon_rad = if eye.lon_rad >= PI { eye.lon_rad - TAU } else { eye.lon_rad };
    let page = cells.terrain(drawn.rep.cell)?;
    let height_m = page.surface_height_m(eye.lat_rad, lon_rad, drawn.own)?;
    let post_m = meridian_radius_m(eye.lat_rad.sin()) * bounds.height_rad() / (POSTS - 1) as f64;
    Some(Ground { height_m, spacing_m: post_m * page.longest_side_posts() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ground_above_the_eye_is_pressed_below_it() {
        let ground = Ground { height_m: 300.0, spacing_m: 1000.0 };
        assert_eq!(ground.press(302.0), None);
        let press = ground.press(260.0).unwrap();
        assert_eq!((press.depth_m, press.radius_m), (42.0, 2000.0));
        assert_eq!(ground.press(-2000.0).unwrap().radius_m, 23020.0);
    }
}
