//! What may be needed near a viewpoint, whatever the direction.

use crate::camera::{Pose, View};
use crate::cells::LiveTree;
use crate::content::{PageId, PageKind};
use crate::forest::index::{IndexForest, Place};
use crate::geodesy::Geodetic;
use crate::select::{FrontRegion, Rep, SelectParams, ground_demands, survey};
use std::collections::BTreeMap;
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};

/// The views that a layout is made for: nothing that asks for more can be flown by it.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct LayoutParams {
    /// Allowed screen-space error, pixels; above 0.
    pub tolerance_px: f64,
    /// Projected bounding dimension below which no object is drawn, pixels.
    pub threshold_px: f64,
    /// Pixels that one metre takes at one metre's distance: height of the viewport ÷ (2 tan(fov_y/2)).
    pub focal_px: f64,
}

impl LayoutParams {
    /// For viewports of a height, pixels, and a field of view of 60°.
    pub fn for_viewport(viewport_h_px: f64, tolerance_px: f64) -> Self {
        let focal_px = viewport_h_px / (2.0 * 30f64.to_radians().tan());
        Self { tolerance_px, threshold_px: SelectParams::DEFAULT.threshold_px, focal_px }
    }

    /// Whether a view asks for no more than these do: a wider one sees as much from the same pages.
    pub fn suffice(&self, view: &View, tolerance_px: f64, threshold_px: f64) -> bool {
        // Rounding of the same view is no more.
        let own = |px: f64| self.focal_px / px * (1.0 + 1e-9);
        view.focal_px() / tolerance_px <= own(self.tolerance_px)
            && view.focal_px() / threshold_px <= own(self.threshold_px)
    }
}

/// A place to look around from, which stands for all eyes no further off than `reach_m`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Viewpoint {
    pub eye: Geodetic,
    pub reach_m: f64,
}

/// By how much finer than asked for the survey looks: distances up to `reach_m` · 2 are resolved exactly, and what is
/// nearer is taken as if it were there.
const FINER: f64 = 2.0;

/// Directions from a viewpoint: the middles of the eight octants, so that none is left out.
pub fn directions(eye: Geodetic) -> [Pose; 8] {
    let pitch_rad = (1.0 / 3f64.sqrt()).asin();
    std::array::from_fn(|at| {
        let heading_rad = FRAC_PI_4 + FRAC_PI_2 * (at % 4) as f64;
        Pose { eye, heading_rad, pitch_rad: if at < 4 { -pitch_rad } else { pitch_rad } }
    })
}

/// The field of view of a square picture that holds an octant: its edges are 54.7° from its middle.
pub fn octant_fov_rad() -> f64 {
    2.0 * 2f64.sqrt().atan()
}

/// Side of such a picture with a focal length, pixels.
pub fn octant_px(focal_px: f64) -> f64 {
    2.0 * 2f64.sqrt() * focal_px
}

/// The pages that views of these parameters may want from anywhere near a viewpoint, by the finest that any of them wants.
pub fn wanted(index: &IndexForest, params: &LayoutParams, viewpoint: &Viewpoint) -> BTreeMap<PageId, Place> {
    let side_px = octant_px(params.focal_px).round().max(1.0) as u32;
    // The side is a whole number: the tolerance makes up for what that changes.
    let exact = f64::from(side_px) / octant_px(params.focal_px);
    let select = SelectParams {
        tolerance_px: params.tolerance_px * exact / FINER,
        threshold_px: params.threshold_px * exact / FINER,
        ..SelectParams::DEFAULT
    };
    let plain =
        SelectParams { tolerance_px: FINER * select.tolerance_px, threshold_px: FINER * select.threshold_px, ..select };
    let cells = LiveTree::default();
    let mut pages = BTreeMap::new();
    for pose in directions(viewpoint.eye) {
        let view = View::new(pose, octant_fov_rad(), [side_px; 2]);
        // What is far is wanted as views want it: finer cells of it may lie behind the horizon.
        survey(index, &cells, &view, &plain, plain.tolerance_px, |region| {
            let front = region.chain.get(region.front).filter(|_| region.kind != PageKind::Segment);
            pages.extend(front.map(|rep| (rep.page(), rep.place)));
        });
        survey(index, &cells, &view, &select, select.tolerance_px, |region| {
            if let Some(rep) = nearer(region, params, viewpoint.reach_m, view.focal_px()) {
                pages.insert(rep.page(), rep.place);
            }
        });
        pages.extend(ground_demands(index, &cells, &view, &select).iter().map(|demand| (demand.page, demand.place)));
    }
    pages
}

/// What an eye wants of a region that is nearer to it by `reach_m`.
fn nearer<'r>(region: &'r FrontRegion<'_>, params: &LayoutParams, reach_m: f64, focal_px: f64) -> Option<&'r Rep> {
    if region.kind == PageKind::Segment || region.px_per_m <= 0.0 {
        return None;
    }
    let distance_m = focal_px / region.px_per_m;
    let px_per_m = params.focal_px / (distance_m - reach_m).max(1.0);
    let absent_px = region.absent_px / region.px_per_m * px_per_m;
    let enough_px = match region.kind {
        PageKind::Objects { .. } => params.threshold_px,
        _ => params.tolerance_px,
    };
    if absent_px <= enough_px {
        return None;
    }
    region.chain.iter().find(|rep| rep.error_m * px_per_m <= params.tolerance_px).or(region.chain.last())
}
