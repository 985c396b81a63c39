//! From source files to a world: whole, the same every time, resumable, and nothing half-written.
#![cfg(feature = "prepare")]
#![allow(clippy::unwrap_used, reason = "a test that cannot be set up fails")]

mod towns;

use std::cell::RefCell;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use stoop::content::{Page, PageId, PageKind};
use stoop::forest::CellId;
use stoop::geodesy::GeoBounds;
use stoop::prepare::Recipe;
use stoop::prepare::against::check_against;
use stoop::prepare::pipeline::{BuildError, BuildOptions, Control, StageDone, build};
use stoop::store::{Manifest, World};
use stoop::units::ByteSize;
use towns::write_dem;

const WEST: f64 = -84.9;
const NORTH: f64 = 34.1;
const STEP: f64 = 0.02;
const POSTS: u32 = 51;

fn hills_m(lon_deg: f64, lat_deg: f64) -> f64 {
    250.0 + 120.0 * (lon_deg * 31.0).sin() * (lat_deg * 23.0).cos() + 25.0 * (lon_deg * 170.0).sin()
}

fn write_picture(path: &Path, width: u32, height: u32) {
    image::RgbImage::from_fn(width, height, |x, y| image::Rgb([(x * 3) as u8, (y * 5) as u8, 90])).save(path).unwrap();
}

fn square(lon: f64, lat: f64, height: f64) -> String {
    let (e, n) = (lon + 2e-4, lat + 2e-4);
    format!(
        r#"{{"type":"Feature","properties":{{"height":{height},"name":"a"}},"geometry":{{"type":"Polygon",
        "coordinates":[[[{lon},{lat}],[{e},{lat}],[{e},{n}],[{lon},{n}],[{lon},{lat}]]]}}}}"#
    )
}

const RECIPE: &str = r#"
name = "made-up"
[[elevation]]
file = "globe.tif"
vertical = "ellipsoid"
[[elevation]]
file = "hills.tif"
vertical = "ellipsoid"
feather_m = 4000
[[imagery]]
file = "globe.png"
bounds_deg = [-180, -90, 180, 90]
[[imagery]]
file = "hills.png"
bounds_deg = [-84.9, 33.1, -83.9, 34.1]
[[buildings]]
name = "town"
file = "town.geojson"
height = "height"
"#;

/// Sources of a small world.
fn sources() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    write_dem(&at("globe.tif"), [25, 13], [-180.0, 90.0, 15.0], |lon, lat| if lat > 0.0 { lon.abs() } else { 0.0 });
    write_dem(&at("hills.tif"), [POSTS, POSTS], [WEST, NORTH, STEP], hills_m);
    write_picture(&at("globe.png"), 64, 32);
    write_picture(&at("hills.png"), 128, 128);
    let town: Vec<_> = (0..30).map(|i| square(-84.4 + f64::from(i) * 5e-4, 33.6, 5.0 + f64::from(i))).collect();
    let town = format!(r#"{{"type":"FeatureCollection","features":[{}]}}"#, town.join(","));
    fs::write(at("town.geojson"), town).unwrap();
    fs::write(at("made-up.toml"), RECIPE).unwrap();
    folder
}

/// What a build told.
#[derive(Default)]
struct Told {
    done: RefCell<Vec<StageDone>>,
    notes: RefCell<Vec<String>>,
}

/// Builds; stops when `stages` are done.
fn build_some(folder: &Path, out: &Path, stages: usize, told: &Told) -> Result<Manifest, BuildError> {
    let recipe = Recipe::read(&folder.join("made-up.toml"))?;
    let options = BuildOptions { out: out.to_owned(), root: None, memory: ByteSize(64 << 20), replace: false };
    let stop = AtomicBool::new(false);
    let control = Control {
        stop: &stop,
        on_progress: &|_| {},
        on_done: &|done| {
            told.done.borrow_mut().push(done.clone());
            stop.store(told.done.borrow().len() >= stages, Ordering::Relaxed);
        },
        on_note: &|note| told.notes.borrow_mut().push(note.to_owned()),
    };
    build(&recipe, &options, &control)
}

fn build_all(folder: &Path, out: &Path) -> Manifest {
    build_some(folder, out, usize::MAX, &Told::default()).unwrap()
}

/// Names and bytes of all files of a world.
fn files(world: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut files = Vec::new();
    for part in ["", "index", "packs"] {
        let mut paths: Vec<_> = fs::read_dir(world.join(part)).unwrap().map(|entry| entry.unwrap().path()).collect();
        paths.sort();
        let paths = paths.into_iter().filter(|path| path.is_file());
        files.extend(paths.map(|path| (path.strip_prefix(world).unwrap().to_owned(), fs::read(&path).unwrap())));
    }
    files
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<_> =
        fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

#[test]
fn a_made_up_world_is_whole_and_keeps_its_bounds() {
    let sources = sources();
    let out = sources.path().join("world");
    let manifest = build_all(sources.path(), &out);
    let world = World::open(&out).unwrap();
    let verified = world.verify(&mut |_, _| {});
    assert_eq!(verified.problems, []);
    assert_eq!(manifest.terrain.as_ref().unwrap().level_max, 6, "45°/64/2⁶ is the first spacing below 0.02°");
    assert_eq!(manifest.imagery.as_ref().unwrap().level_max, 5, "45°/256/2⁵ is the first texel below 1°/128");
    assert_eq!(manifest.terrain.as_ref().unwrap().pages_by_level[0], 32, "no zone is a hole");
    assert_eq!((manifest.collections[0].objects, manifest.sources.len()), (30, 5));
    let recipe = Recipe::read(&sources.path().join("made-up.toml")).unwrap();
    let report = check_against(&world, &recipe, None, 5000, 1, &|_| {}).unwrap();
    assert!(report.samples >= 5000 && report.comparisons > 2 * report.samples, "{report:?}");
    assert_eq!(report.violations, 0, "{:?}", report.examples);
    assert!(report.tightness.tight_share >= 0.5, "{:?}", report.tightness);
    let town = &report.buildings[0];
    assert_eq!((town.prisms, town.missing, town.surplus), (30, 0, 0));
    assert!(town.outline_worst_m <= 0.02 && town.height_worst_m <= 0.02, "{town:?}");
    assert_eq!(report, check_against(&world, &recipe, None, 5000, 1, &|_| {}).unwrap());
}

#[test]
fn posts_come_out_within_the_error_of_their_cell() {
    let sources = sources();
    let out = sources.path().join("world");
    build_all(sources.path(), &out);
    let world = World::open(&out).unwrap();
    for (row, column) in [(20, 20), (25, 31), (30, 17)] {
        let (lon, lat) = (WEST + f64::from(column) * STEP, NORTH - f64::from(row) * STEP);
        let (lon_rad, lat_rad) = (lon.to_radians(), lat.to_radians());
        let finest = world.index().find_deepest(CellId::containing(lat_rad, lon_rad, 22)).unwrap().cell();
        let node = finest.ancestors().filter_map(|cell| world.index().find(cell)).find(|node| node.terrain().is_some());
        let node = node.unwrap();
        let id = PageId { cell: node.cell(), kind: PageKind::Terrain };
        let Page::Terrain(page) = world.load(id, node.terrain().unwrap().place).unwrap() else { panic!("no terrain") };
        let drawn_m = page.surface_height_m(lat_rad, lon_rad, 1.0).unwrap();
        assert!((drawn_m - hills_m(lon, lat)).abs() <= f64::from(page.error_m), "{drawn_m} at {lon} {lat}");
    }
}

#[test]
fn pages_of_siblings_lie_together_and_imagery_behind_terrain() {
    let sources = sources();
    let out = sources.path().join("world");
    build_all(sources.path(), &out);
    let world = World::open(&out).unwrap();
    for node in world.index().trees().flat_map(|tree| tree.nodes()) {
        let mut end = None;
        for child in node.children() {
            let places = [child.terrain().map(|terrain| terrain.place), child.imagery()];
            for place in places.into_iter().flatten() {
                assert!(end.is_none_or(|end| end == place.offset), "{}", child.cell());
                end = Some(place.offset + u64::from(place.len));
            }
        }
    }
}

#[test]
fn the_gutter_of_a_picture_continues_into_its_neighbour() {
    let sources = sources();
    let out = sources.path().join("world");
    build_all(sources.path(), &out);
    let world = World::open(&out).unwrap();
    let load = |cell: CellId| {
        let place = world.index().find(cell).and_then(|node| node.imagery()).expect("a picture");
        match world.load(PageId { cell, kind: PageKind::Imagery }, place).unwrap() {
            Page::Imagery(page) => page,
            _ => panic!("no picture"),
        }
    };
    // Zone roots 18 and 19 touch at 45°W.
    let bounds = |lon: f64| GeoBounds::from_degrees(lon, 20.0, lon, 20.0);
    let [west, east] = [-60.0, -30.0].map(|lon| {
        let at = bounds(lon);
        load(CellId::containing(at.south_rad, at.west_rad, 0))
    });
    for row in [40, 129, 200] {
        let texel = |page: &stoop::content::ImageryPage, column: usize| {
            let at = (row * 258 + column) * 4;
            page.mips[0][at..at + 3].to_vec()
        };
        for (a, b) in [(texel(&west, 257), texel(&east, 1)), (texel(&west, 256), texel(&east, 0))] {
            let differs = a.iter().zip(&b).map(|(a, b)| a.abs_diff(*b)).max().unwrap();
            assert!(differs <= 12, "row {row}: {a:?} {b:?}");
        }
    }
}

#[test]
fn a_stopped_build_goes_on_and_ends_in_the_same_world() {
    let sources = sources();
    let (whole, resumed) = (sources.path().join("whole"), sources.path().join("resumed"));
    build_all(sources.path(), &whole);
    let stopped = build_some(sources.path(), &resumed, 7, &Told::default());
    assert!(matches!(stopped, Err(BuildError::Stopped(_))), "{stopped:?}");
    assert!(!resumed.exists(), "nothing half-written");
    let told = Told::default();
    build_some(sources.path(), &resumed, usize::MAX, &told).unwrap();
    assert_eq!(told.done.borrow().iter().filter(|done| done.resumed).count(), 6, "six zones after the sources");
    assert_eq!(files(&whole), files(&resumed));
    let left: Vec<_> = names(sources.path()).into_iter().filter(|name| name.contains("resumed")).collect();
    assert_eq!(left, ["resumed"], "stage files are gone");
}

#[test]
fn other_sources_start_afresh_with_a_note() {
    let sources = sources();
    let out = sources.path().join("world");
    assert!(build_some(sources.path(), &out, 4, &Told::default()).is_err());
    write_dem(&sources.path().join("hills.tif"), [POSTS, POSTS], [WEST, NORTH, STEP], |lon, lat| {
        hills_m(lon, lat) + 1.0
    });
    let told = Told::default();
    build_some(sources.path(), &out, usize::MAX, &told).unwrap();
    assert_eq!(told.notes.borrow().len(), 1);
    assert!(told.done.borrow().iter().all(|done| !done.resumed));
}

#[test]
fn a_world_is_not_overwritten_and_bad_input_leaves_nothing() {
    let sources = sources();
    let out = sources.path().join("world");
    fs::create_dir(&out).unwrap();
    fs::write(out.join("letter.txt"), "dear").unwrap();
    let error = build_some(sources.path(), &out, usize::MAX, &Told::default()).unwrap_err().to_string();
    assert!(error.contains("not empty"), "{error}");
    fs::remove_dir_all(&out).unwrap();
    fs::remove_file(sources.path().join("hills.tif")).unwrap();
    let before = names(sources.path());
    let error = build_some(sources.path(), &out, usize::MAX, &Told::default()).unwrap_err().to_string();
    assert!(error.contains("hills.tif"), "{error}");
    assert_eq!(names(sources.path()), before);
}

#[test]
fn a_truncated_source_is_named_and_leaves_nothing() {
    let sources = sources();
    let path = sources.path().join("hills.tif");
    let bytes = fs::read(&path).unwrap();
    fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
    let before = names(sources.path());
    let error = build_some(sources.path(), &sources.path().join("world"), usize::MAX, &Told::default());
    let error = error.unwrap_err().to_string();
    assert!(error.contains("hills.tif"), "{error}");
    assert_eq!(names(sources.path()), before);
}

#[test]
fn the_recipes_here_are_sound() {
    for name in ["dive-city20k", "dive-city471", "california", "dive-california-sf"] {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/recipes/{name}.toml"));
        Recipe::read(&path).unwrap();
    }
}
