use super::*;
use crate::content::rtin::Diagonal;
use crate::content::{Surface, TerrainPage};
use crate::forest::{CellId, Zone};
use crate::geodesy::GeoBounds;
use crate::prepare::elevation::RefineGoals;
use crate::prepare::task::Task;
use std::collections::BTreeMap;
use std::sync::atomic::AtomicBool;

/// A flat sea with posts at every degree, and hills in a small square with posts at every hundredth.
struct Hills;

const SEA_DEG: f64 = 1.0;
const HILLS_DEG: f64 = 0.01;

fn hills() -> GeoBounds {
    GeoBounds::from_degrees(-84.5, 33.5, -83.5, 34.5)
}

impl Truth for Hills {
    fn height_m(&self, lat_rad: f64, lon_rad: f64) -> f64 {
        let (u, v) = hills().fractions(lat_rad, lon_rad);
        if !(0.0..=1.0).contains(&u) || !(0.0..=1.0).contains(&v) {
            return 0.0;
        }
        let rim = (u.min(1.0 - u).min(v).min(1.0 - v) * 10.0).min(1.0);
        rim * (300.0 + 200.0 * (u * 40.0).sin() * (v * 33.0).cos() + 40.0 * (u * 300.0).sin())
    }

    fn finest_spacing_rad(&self, bounds: &GeoBounds) -> Option<f64> {
        Some(if hills().intersects(bounds) { HILLS_DEG } else { SEA_DEG }.to_radians())
    }

    fn goals(&self, _: &GeoBounds) -> RefineGoals {
        RefineGoals { prune_error_m: 0.25, finest_error_m: None }
    }

    fn for_each_post(&self, bounds: &GeoBounds, visit: &mut dyn FnMut(f64, f64, f64)) {
        for (area, step) in [(GeoBounds::from_degrees(-180.0, -90.0, 180.0, 90.0), SEA_DEG), (hills(), HILLS_DEG)] {
            let Some(part) = area.intersection(bounds) else { continue };
            let index = |angle: f64| angle.to_degrees() / step;
            for row in (index(part.south_rad).ceil() as i64)..=(index(part.north_rad).floor() as i64) {
                for column in (index(part.west_rad).ceil() as i64)..=(index(part.east_rad).floor() as i64) {
                    let (lat, lon) = ((row as f64 * step).to_radians(), (column as f64 * step).to_radians());
                    visit(lat, lon, self.height_m(lat, lon));
                }
            }
        }
    }
}

fn plan_of(zone: Zone) -> ZonePlan {
    let stop = AtomicBool::new(false);
    let task = Task::new("terrain", "test", 0, &stop, &|_| {});
    Terrain { truth: &Hills, task: &task }.plan(zone).unwrap()
}

fn pages_of(plan: &ZonePlan) -> BTreeMap<CellId, TerrainPage> {
    let mut pages: BTreeMap<CellId, TerrainPage> = BTreeMap::new();
    for (&cell, cell_plan) in plan {
        let parent = cell.parent().and_then(|parent| pages.get(&parent));
        let page = build(&Hills, cell, cell_plan, parent);
        pages.insert(cell, page);
    }
    pages
}

#[test]
fn every_cell_keeps_its_error_at_every_source_post_and_grows_no_worse_downwards() {
    let zone = CellId::containing(34f64.to_radians(), -84f64.to_radians(), 0).zone();
    let plan = plan_of(zone);
    let pages = pages_of(&plan);
    let deepest = plan.keys().map(|cell| cell.level()).max();
    assert_eq!(deepest, Some(7), "45°/64/2⁷ is the first spacing below 0.01°");
    let mut tight = 0;
    for (&cell, page) in &pages {
        let surface = Surface::new(page, 1.0);
        let mut worst_m = 0.0f64;
        Hills.for_each_post(&cell.bounds(), &mut |lat, lon, truth_m| {
            worst_m = worst_m.max((surface.height_m(lat, lon).unwrap() - truth_m).abs());
        });
        assert!(worst_m <= f64::from(page.error_m), "{cell}: {worst_m} over {}", page.error_m);
        tight += usize::from(worst_m > 0.5 * f64::from(page.error_m));
        if let Some(parent) = cell.parent() {
            assert!(pages[&parent].error_m >= page.error_m, "{cell}");
        }
        let below: Vec<_> = cell.children().filter(|child| pages.contains_key(child)).collect();
        assert!(below.is_empty() || below.len() == cell.children().count(), "{cell} has some children only");
    }
    println!("{} cells, {tight} tight within 2×", pages.len());
}

#[test]
fn a_child_morphs_out_of_its_parents_surface() {
    let zone = CellId::containing(34f64.to_radians(), -84f64.to_radians(), 0).zone();
    let pages = pages_of(&plan_of(zone));
    for (&cell, page) in pages.iter().filter(|(cell, _)| cell.level() > 0) {
        let parent = &pages[&cell.parent().unwrap()];
        let (above, morphed) = (Surface::new(parent, 1.0), Surface::new(page, 0.0));
        let bounds = cell.bounds();
        for at in 0..100 {
            let place = bounds.at(f64::from(at % 10) / 9.7 + 0.01, f64::from(at / 10) / 9.3 + 0.013, 0.0);
            let (a, b) = (above.height_m(place.lat_rad, place.lon_rad), morphed.height_m(place.lat_rad, place.lon_rad));
            let (Some(a), Some(b)) = (a, b) else { continue };
            // Chords of coarse cells leave their parallels, so that near rows of posts it is not quite the same plane.
            assert!((a - b).abs() < 0.01 + 0.01 * f64::from(parent.error_m), "{cell}: {a} {b}");
        }
    }
}

#[test]
fn a_flat_sea_with_finer_cells_below_takes_a_handful_of_triangles() {
    let zone = CellId::containing(34f64.to_radians(), -84f64.to_radians(), 0).zone();
    let plan = plan_of(zone);
    let root = &plan[&zone.root()];
    let count = root.active.triangles(Diagonal::of(zone.root())).len();
    assert!(count < 2000, "{count}, {} m", root.error_m);
}
