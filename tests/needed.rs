//! Over-modelling: what a picture needs is bounded by what its settled frame draws, and follows the view.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on should stop")]

mod towns;

use std::collections::BTreeMap;
use std::f64::consts::FRAC_PI_2;
use stoop::camera::{Pose, View};
use stoop::content::PageKind;
use stoop::engine::Source;
use stoop::forest::CellId;
use stoop::geodesy::Geodetic;
use stoop::select::{Needed, Seen, SelectParams, Urgency, needed, needed_and_seen};
use stoop::simulate::{Frame, Library, Setup, Simulation};
use stoop::storage::StorageModel;
use stoop::store::World;

fn view(height_m: f64, heading_deg: f64, pitch_deg: f64) -> View {
    let eye = Geodetic::from_degrees(33.55, -84.35, height_m);
    let pose = Pose { eye, heading_rad: heading_deg.to_radians(), pitch_rad: pitch_deg.to_radians() };
    View::new(pose, 60f64.to_radians(), [640, 360])
}

/// A frame with all that its front asks for.
fn settled<'a>(library: &'a Library, view: &View) -> (Simulation<'a>, Frame) {
    settled_with(library, view, Setup::new(StorageModel::SSD, 0.1))
}

fn settled_with<'a>(library: &'a Library, view: &View, setup: Setup) -> (Simulation<'a>, Frame) {
    let mut simulation = Simulation::new(library, setup).unwrap();
    for step in 0..100 {
        let frame = simulation.frame(view, f64::from(step) * 0.1);
        if simulation.is_settled() {
            return (simulation, frame);
        }
    }
    panic!("the view did not settle");
}

fn library(folder: &tempfile::TempDir) -> Library {
    let at = folder.path().join("world");
    towns::make(folder.path(), &at, &towns::set("west", "west.geojson"));
    let source = Source::of(World::open(&at).unwrap());
    Library::new(source.index.clone(), source.reader.clone())
}

/// What a coarse page has beyond a narrow view is not drawn, and what it has in it is.
#[test]
fn a_page_that_reaches_far_beyond_the_view_is_drawn_in_parts() {
    let folder = towns::sources();
    let library = library(&folder);
    let (height_m, half_rad) = (30_000.0, 4f64.to_radians());
    let pose = Pose { eye: Geodetic::from_degrees(33.55, -84.35, height_m), heading_rad: 0.0, pitch_rad: -FRAC_PI_2 };
    let view = View::new(pose, 2.0 * half_rad, [360, 360]);
    let mut setup = Setup::new(StorageModel::SSD, 0.1);
    setup.tolerance_px = 4.0;
    let (_, frame) = settled_with(&library, &view, setup);
    let pieces = &frame.selection.pieces;
    let whole: usize = pieces
        .iter()
        .map(|piece| (piece.terrain.cell, piece.terrain.triangles.len()))
        .collect::<BTreeMap<_, _>>()
        .into_values()
        .sum();
    let drawn: usize = pieces.iter().map(|piece| piece.terrain.cut(piece.cell).surface_len as usize / 3).sum();
    assert!(whole > 400 && 3 * drawn < whole, "{drawn} of {whole}");
    assert!(pieces.iter().all(|piece| view.frustum().meets(&piece.around)));
    let reach_deg = (0.98 * height_m * half_rad.tan() / 6_378_137.0).to_degrees();
    for at in 0..400 {
        let (u, v) = (f64::from(at % 20) / 9.5 - 1.0, f64::from(at / 20) / 9.5 - 1.0);
        let (lat, lon) = (33.55 + v * reach_deg, -84.35 + u * reach_deg / 33.55f64.to_radians().cos());
        let place = CellId::containing(lat.to_radians(), lon.to_radians(), 20);
        assert_eq!(pieces.iter().filter(|piece| piece.cell.contains(place)).count(), 1, "{lat} {lon}");
    }
}

fn needs(library: &Library, view: &View, tolerance_px: f64) -> Needed {
    needed(&library.index, view, &SelectParams { tolerance_px, ..SelectParams::DEFAULT }, library)
}

#[test]
fn a_settled_frame_draws_all_that_is_needed_and_little_more() {
    let folder = towns::sources();
    let library = library(&folder);
    let views = [(400.0, 0.0, -10.0), (3_000.0, 200.0, -60.0), (40_000.0, 90.0, -90.0), (2e6, 0.0, -70.0)];
    for (height_m, heading_deg, pitch_deg) in views {
        let view = view(height_m, heading_deg, pitch_deg);
        let (simulation, frame) = settled(&library, &view);
        let modelled = simulation.modelled(&frame);
        let needs = needs(&library, &view, 1.0);
        assert!(needs.triangles() > 0 && needs.triangles() == modelled.needed_triangles);
        assert!(modelled.drawn_triangles >= needs.triangles(), "{height_m}: {modelled:?}");
        assert!(needs.view_cut_triangles <= needs.terrain_triangles, "{height_m}: {needs:?}");
        assert!(needs.view_cut_triangles > 0 && needs.page_triangles >= needs.terrain_triangles);
        let seen = modelled.seen_triangles.unwrap();
        assert!(0 < seen && seen <= needs.triangles(), "{height_m}: {modelled:?}");
        assert!((1..=modelled.needed_bytes).contains(&modelled.seen_bytes.unwrap()), "{height_m}: {modelled:?}");
        // Exact distances are no less than those of boxes: no page is finer than the front's.
        let front = &frame.selection.demands;
        for page in needs.pages.keys() {
            let is_wanted = front.iter().any(|demand| {
                demand.urgency >= Urgency::Visible
                    && demand.page.kind == page.kind
                    && page.cell.contains(demand.page.cell)
            });
            assert!(is_wanted, "{height_m}: {page:?}");
        }
    }
}

#[test]
fn what_is_needed_follows_view_and_tolerance() {
    let folder = towns::sources();
    let library = library(&folder);
    let north = view(400.0, 0.0, -5.0);
    let high = view(60_000.0, 0.0, -60.0);
    assert_eq!(needs(&library, &view(2_000.0, 0.0, 80.0), 1.0), Needed::default(), "the sky needs nothing");
    let [fine, asked, coarse] = [0.25, 1.0, 8.0].map(|px| needs(&library, &high, px).triangles());
    assert!(fine > asked && asked > coarse, "{fine} {asked} {coarse}");
    let objects =
        |needs: &Needed| needs.pages.keys().filter(|page| matches!(page.kind, PageKind::Objects { .. })).count();
    assert!(objects(&needs(&library, &north, 1.0)) > 0);
    // Facing south, the town is behind the eye.
    let away = view(400.0, 180.0, -10.0);
    assert_eq!((objects(&needs(&library, &away, 1.0)), needs(&library, &away, 1.0).object_triangles), (0, 0));
}

fn sees(library: &Library, view: &View) -> (Needed, Seen) {
    needed_and_seen(&library.index, view, &SelectParams::DEFAULT, library)
}

#[test]
fn houses_hide_what_is_behind_them_and_nothing_from_above() {
    let folder = towns::sources();
    let library = library(&folder);
    let (needs, seen) = sees(&library, &view(3_000.0, 0.0, -90.0));
    assert_eq!(seen.object_triangles, needs.object_triangles, "roofs are next to each other from above");
    // Along the row, whose first house is the tallest and stands before the others.
    let eye = Geodetic::from_degrees(33.6001, -84.4010, 75.0);
    let pose = Pose { eye, heading_rad: 90f64.to_radians(), pitch_rad: 0.0 };
    let (needs, seen) = sees(&library, &View::new(pose, 60f64.to_radians(), [640, 360]));
    assert!(0 < seen.object_triangles && 2 * seen.object_triangles < needs.object_triangles, "{seen:?} {needs:?}");
    assert!(seen.pages.iter().all(|page| needs.pages.get(page.0) == Some(page.1)));
}
