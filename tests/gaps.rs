//! No building floats above the drawn ground or sinks into it, on steep ground, at every level of the terrain: in settled
//! frames and in frames where the terrain is late.
#![cfg(feature = "prepare")]
#![allow(clippy::unwrap_used, reason = "a test that cannot be set up fails")]

mod towns;

use std::collections::HashMap;
use std::fs;
use std::path::Path;
use stoop::camera::{Pose, View};
use stoop::cells::LiveTree;
use stoop::content::{Page, PageId, PageKind, Prism};
use stoop::engine::Lifts;
use stoop::forest::CellId;
use stoop::geodesy::Geodetic;
use stoop::select::{DrawObjects, DrawPiece, SelectParams, Selection, select};
use stoop::store::World;
use towns::{make_of, write_dem};

const WEST: f64 = -84.5;
const NORTH: f64 = 33.9;
const SIDE_DEG: f64 = 0.1;
const STEP_DEG: f64 = 0.0005;
/// Buildings along each side of the city.
const ACROSS: u32 = 50;
const PARAMS: SelectParams = SelectParams::DEFAULT;
const RECIPE: &str = r#"
name = "slopes"
[[elevation]]
file = "globe.tif"
vertical = "ellipsoid"
[[elevation]]
file = "slopes.tif"
vertical = "ellipsoid"
[[buildings]]
name = "town"
file = "town.geojson"
height = "height"
"#;

/// Slopes of up to a half, with gentler waves below them.
fn slopes_m(lon_deg: f64, lat_deg: f64) -> f64 {
    600.0 + 150.0 * (lon_deg * 160.0).sin() * (lat_deg * 140.0).cos() + 40.0 * (lon_deg * 900.0 + lat_deg * 700.0).sin()
}

fn building(at: u32) -> String {
    let spread = SIDE_DEG * 0.8 / f64::from(ACROSS);
    let lon = WEST + SIDE_DEG * 0.1 + spread * f64::from(at % ACROSS);
    let lat = NORTH - SIDE_DEG * 0.9 + spread * f64::from(at / ACROSS);
    let (e, n) = (lon + 1e-4 + 1e-5 * f64::from(at % 17), lat + 1e-4 + 1e-5 * f64::from(at % 13));
    let height = 4 + at * 7919 % 60;
    format!(
        r#"{{"type":"Feature","properties":{{"height":{height}}},"geometry":{{"type":"Polygon",
        "coordinates":[[[{lon},{lat}],[{e},{lat}],[{e},{n}],[{lon},{n}],[{lon},{lat}]]]}}}}"#
    )
}

fn world(folder: &Path) -> World {
    let at = |name: &str| folder.join(name);
    write_dem(&at("globe.tif"), [25, 13], [-180.0, 90.0, 15.0], |_, _| 500.0);
    let posts = (SIDE_DEG / STEP_DEG) as u32 + 1;
    write_dem(&at("slopes.tif"), [posts, posts], [WEST, NORTH, STEP_DEG], slopes_m);
    let town: Vec<_> = (0..ACROSS * ACROSS).map(building).collect();
    fs::write(at("town.geojson"), format!(r#"{{"type":"FeatureCollection","features":[{}]}}"#, town.join(",")))
        .unwrap();
    make_of(folder, &at("world"), RECIPE);
    World::open(&at("world")).unwrap()
}

/// All pages of a world, and the prisms of those of objects.
struct Pages {
    pages: Vec<Page>,
    prisms: HashMap<PageId, Vec<Prism>>,
}

fn pages(world: &World) -> Pages {
    let (mut pages, mut prisms) = (Vec::new(), HashMap::new());
    let index = world.index();
    for node in index.trees().flat_map(|tree| tree.nodes()) {
        let cell = node.cell();
        if let Some(terrain) = node.terrain() {
            pages.push(world.load(PageId { cell, kind: PageKind::Terrain }, terrain.place).unwrap());
        }
        for entry in node.objects() {
            let id = PageId { cell, kind: PageKind::Objects { collection: entry.collection, rep: entry.rep } };
            let bytes = world.read(id, entry.place).unwrap();
            prisms.insert(id, world.prisms(id, entry.place, &bytes).unwrap().prisms);
            pages.push(world.load(id, entry.place).unwrap());
        }
    }
    Pages { pages, prisms }
}

fn piece_at<'p>(pieces: &HashMap<CellId, &'p DrawPiece>, lat_rad: f64, lon_rad: f64) -> Option<&'p DrawPiece> {
    CellId::containing(lat_rad, lon_rad, 22).ancestors().find_map(|cell| pieces.get(&cell).copied())
}

/// The worst of a frame, px, and how many corners were looked at.
#[derive(Clone, Copy, Debug, Default)]
struct Worst {
    floats_px: f64,
    sinks_px: f64,
    corners: u32,
}

impl Worst {
    fn add(&mut self, other: Self) {
        self.floats_px = self.floats_px.max(other.floats_px);
        self.sinks_px = self.sinks_px.max(other.sinks_px);
        self.corners += other.corners;
    }
}

fn worst(view: &View, world: &World, selection: &Selection, pages: &Pages) -> Worst {
    let mut lifts = Lifts::default();
    let mut lifts_m: HashMap<PageId, Vec<f32>> = HashMap::new();
    lifts.follow(world.index(), selection, |page, lifts| _ = lifts_m.insert(page, lifts.to_vec()));
    let pieces: HashMap<CellId, &DrawPiece> = selection.pieces.iter().map(|piece| (piece.cell, piece)).collect();
    let ground_m = |lat_rad: f64, lon_rad: f64| {
        let piece = piece_at(&pieces, lat_rad, lon_rad)?;
        piece.terrain.surface_height_m(lat_rad, lon_rad, f64::from(piece.own))
    };
    let mut worst = Worst::default();
    for DrawObjects { page, objects } in &selection.objects {
        let prisms = &pages.prisms[&page.id()];
        for at in objects.iter().flat_map(Clone::clone).map(|at| at as usize) {
            let (object, prism) = (&page.objects[at], &prisms[at]);
            let lift_m = lifts_m.get(&page.id()).map_or(0.0, |lifts_m| f64::from(lifts_m[at]));
            let base_m = f64::from(object.base_m);
            let foot_m = base_m - f64::from(prism.foundation_m) + lift_m;
            let px_per_m = view.projected_px(1.0, view.eye().distance_m(object.place));
            if let Some(own_m) = ground_m(object.lat_rad, object.lon_rad) {
                // What is drawn of the ground is off by as much as its own error.
                let error_m = piece_at(&pieces, object.lat_rad, object.lon_rad).map_or(0.0, |piece| piece.error_m);
                let slack_m = f64::from(error_m) + 0.02;
                worst.sinks_px = worst.sinks_px.max((own_m - base_m - lift_m.max(0.0) - slack_m) * px_per_m);
            }
            for &[lon_rad, lat_rad] in prism.rings.iter().flatten() {
                let Some(ground_m) = ground_m(lat_rad, lon_rad) else { continue };
                worst.floats_px = worst.floats_px.max((foot_m - ground_m) * px_per_m);
                worst.corners += 1;
            }
        }
    }
    worst
}

#[test]
fn no_building_floats_or_sinks_whatever_level_of_the_terrain_is_drawn() {
    let folder = tempfile::tempdir().unwrap();
    let world = world(folder.path());
    let pages = pages(&world);
    let finest = pages.pages.iter().map(|page| if let Page::Terrain(page) = page { page.cell.level() } else { 0 });
    let finest = finest.max().unwrap();
    let mut late = Worst::default();
    for height_m in [900.0, 1_500.0, 4_000.0, 12_000.0] {
        let eye = Geodetic::from_degrees(NORTH - SIDE_DEG * 0.6, WEST + SIDE_DEG / 2.0, height_m);
        let view = View::new(Pose { eye, heading_rad: 0.3, pitch_rad: -0.7 }, 1.05, [640, 360]);
        for level in (0..=finest).rev() {
            let mut cells = LiveTree::default();
            for page in &pages.pages {
                if !matches!(page, Page::Terrain(terrain) if terrain.cell.level() > level) {
                    cells.insert(page);
                }
            }
            let selection = select(world.index(), &cells, &view, &PARAMS);
            let worst = worst(&view, &world, &selection, &pages);
            println!("{height_m} m, terrain to level {level}: {worst:?}");
            if level == finest {
                assert_eq!(selection.stats.debt_px, 0.0);
                assert!(worst.floats_px <= PARAMS.tolerance_px && worst.sinks_px <= PARAMS.tolerance_px, "{worst:?}");
            }
            late.add(worst);
        }
    }
    assert!(late.corners > 10_000, "{late:?}");
    assert!(late.floats_px <= PARAMS.tolerance_px && late.sinks_px <= PARAMS.tolerance_px, "{late:?}");
}
