//! Selections over made-up worlds whose pages are all there.

use crate::made_up::{Plan, build, page, with_roots};
use stoop::camera::View;
use stoop::cells::LiveTree;
use stoop::content::{Page, PageId};
use stoop::forest::CellId;
use stoop::forest::index::IndexForest;
use stoop::geodesy::{Geodetic, SEMI_MAJOR_M};
use stoop::select::{SelectParams, Selection, select};

/// Rounds of demands after which a front must have settled.
const ROUNDS_MAX: u32 = 4;

/// Loads all that a view demands; gives what is resident then, and the selection.
pub fn settle(index: &IndexForest, view: &View, params: &SelectParams) -> (LiveTree, Selection) {
    settle_with(index, view, params, page)
}

/// The same with other pages.
pub fn settle_with(
    index: &IndexForest,
    view: &View,
    params: &SelectParams,
    page: impl Fn(PageId) -> Page,
) -> (LiveTree, Selection) {
    let mut cells = with_roots(index);
    for _ in 0..ROUNDS_MAX {
        let selection = select(index, &cells, view, params);
        let missing: Vec<PageId> =
            selection.demands.iter().map(|demand| demand.page).filter(|&id| !cells.contains(id)).collect();
        if missing.is_empty() {
            return (cells, selection);
        }
        missing.into_iter().for_each(|id| cells.insert(&page(id)));
    }
    panic!("the front does not settle");
}

/// A world as fine as `finest` within a distance of a place, and coarse elsewhere.
pub fn even_world(lat_deg: f64, lon_deg: f64, within_m: f64, finest: u8) -> IndexForest {
    let place = Geodetic::from_degrees(lat_deg, lon_deg, 0.0).to_ecef();
    let refines = move |cell: CellId| {
        let bounds = cell.bounds();
        let apart_m = bounds.center().to_ecef().distance_m(place);
        cell.level() < 2 || (cell.level() < finest && apart_m < within_m + bounds.height_rad() * SEMI_MAJOR_M)
    };
    build(&Plan { terrain_refines: refines, imagery_refines: refines, object_roots: Vec::new() })
}
