//! The classes of pages that the lemmas speak of, from a real world.

use super::lemma::RepClass;
use super::sets::Pages;
use crate::content::{PageId, PageKind};
use crate::forest::CellId;
use crate::forest::index::IndexForest;
use crate::geodesy::SEMI_MAJOR_M;
use crate::select::ground_page;
use std::collections::BTreeMap;

/// Pages of about the same error.
#[derive(Default)]
struct Class {
    pages: f64,
    error_m: f64,
    bytes: f64,
    area_m2: f64,
}

/// Terrain and pictures by level, objects by rep: each is wanted from where its own error is the tolerance to where that
/// of the next coarser class is. `focal_px` is over the tolerance.
pub fn classes(index: &IndexForest, pages: &Pages, focal_px: f64) -> Vec<RepClass> {
    let mut by_layer: BTreeMap<u8, BTreeMap<u8, Class>> = BTreeMap::new();
    for &(page, place) in pages.list() {
        let Some((layer, fineness, error_m)) = class_of(index, page) else { continue };
        let class = by_layer.entry(layer).or_default().entry(fineness).or_default();
        class.pages += 1.0;
        class.error_m += error_m;
        class.bytes += f64::from(place.len);
        class.area_m2 += area_m2(page.cell);
    }
    by_layer.values().flat_map(|layer| rings(layer, focal_px)).collect()
}

/// `layer` is ordered from the finest on.
fn rings(layer: &BTreeMap<u8, Class>, focal_px: f64) -> Vec<RepClass> {
    let radii_m: Vec<f64> = layer.values().map(|class| class.error_m / class.pages * focal_px).collect();
    let ring = |(at, class): (usize, &Class)| RepClass {
        in_m: if at == 0 { 0.0 } else { radii_m[at] },
        // The coarsest is wanted as far as it reaches.
        out_m: radii_m.get(at + 1).copied().unwrap_or(f64::MAX / 4.0),
        bytes: class.bytes,
        area_m2: class.area_m2.max(1.0),
    };
    layer.values().enumerate().map(ring).collect()
}

/// Layer, place from the finest on, error.
fn class_of(index: &IndexForest, page: PageId) -> Option<(u8, u8, f64)> {
    let node = index.find(page.cell)?;
    match page.kind {
        PageKind::Terrain => Some((0, u8::MAX - page.cell.level(), ground_page(&node, page.kind)?.1)),
        PageKind::Imagery => Some((1, u8::MAX - page.cell.level(), ground_page(&node, page.kind)?.1)),
        PageKind::Objects { collection, rep } => {
            let entry = node.objects().find(|entry| entry.collection == collection && entry.rep == rep)?;
            Some((2, rep, entry.error_m))
        }
        PageKind::Segment => None,
    }
}

fn area_m2(cell: CellId) -> f64 {
    let bounds = cell.bounds();
    let wide_rad = bounds.width_rad() * bounds.center().lat_rad.cos();
    wide_rad * bounds.height_rad() * SEMI_MAJOR_M * SEMI_MAJOR_M
}
