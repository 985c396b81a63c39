//! Small worlds made of files: a globe with three hilly squares, and towns on them.
#![allow(clippy::unwrap_used, reason = "a test that cannot be set up fails")]
#![allow(dead_code, reason = "each test program uses its own part")]

use std::fs;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use stoop::content::{PageId, PageKind};
use stoop::forest::index::{IndexTree, Place};
use stoop::prepare::Recipe;
use stoop::prepare::pipeline::{BuildOptions, Control, build};
use stoop::store::{Manifest, World};
use stoop::units::ByteSize;

/// A square of `side_deg` that holds a height.
fn square(lon: f64, lat: f64, side_deg: f64, height_m: f64) -> String {
    let (e, n) = (lon + side_deg, lat + side_deg);
    format!(
        r#"{{"type":"Feature","properties":{{"height":{height_m}}},"geometry":{{"type":"Polygon",
        "coordinates":[[[{lon},{lat}],[{e},{lat}],[{e},{n}],[{lon},{n}],[{lon},{lat}]]]}}}}"#
    )
}

/// A town of `count` houses in a row; its first one is `tallest_m` high.
pub fn town(lon: f64, lat: f64, count: usize, tallest_m: f64) -> String {
    let height_m = |at: usize| if at == 0 { tallest_m } else { 5.0 + (at % 7) as f64 };
    let houses: Vec<_> = (0..count).map(|at| square(lon + at as f64 * 5e-4, lat, 2e-4, height_m(at))).collect();
    format!(r#"{{"type":"FeatureCollection","features":[{}]}}"#, houses.join(","))
}

pub fn set(name: &str, file: &str) -> String {
    format!("[[buildings]]\nname = \"{name}\"\nfile = \"{file}\"\nheight = \"height\"\n")
}

/// A globe with three hilly squares, and towns on them.
pub fn sources() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| fs::write(folder.path().join(name), text).unwrap();
    write("west.geojson", &town(-84.4, 33.6, 300, 40.0));
    write("low.geojson", &town(-84.4, 33.6, 200, 30.0));
    write("near.geojson", &town(-84.41, 33.62, 100, 300.0));
    write("east.geojson", &town(24.9, 60.17, 150, 60.0));
    // Across the border of two zones.
    write("both.geojson", &town(-90.02, 40.0, 120, 25.0));
    let at = |name: &str| folder.path().join(name);
    write_dem(&at("globe.tif"), [145, 73], [-180.0, 90.0, 2.5], |lon, lat| {
        40.0 + 20.0 * (lon + lat).to_radians().sin()
    });
    for (name, west, north) in [("a.tif", -84.9, 34.1), ("b.tif", -90.5, 40.5), ("c.tif", 24.4, 60.7)] {
        write_dem(&at(name), [51, 51], [west, north, 0.02], |lon, lat| {
            50.0 + 20.0 * (lon * 31.0).sin() + 9.0 * lat.cos()
        });
    }
    folder
}

/// Posts from the north-western corner on, `step` degrees apart.
pub fn write_dem(
    path: &Path,
    [width, height]: [u32; 2],
    [west, north, step]: [f64; 3],
    height_m: impl Fn(f64, f64) -> f64,
) {
    use tiff::encoder::TiffEncoder;
    use tiff::encoder::colortype::Gray32Float;
    use tiff::tags::Tag;
    let place = |at: u32| (west + f64::from(at % width) * step, north - f64::from(at / width) * step);
    let posts: Vec<f32> = (0..width * height).map(|at| height_m(place(at).0, place(at).1) as f32).collect();
    let mut encoder = TiffEncoder::new(fs::File::create(path).unwrap()).unwrap();
    let mut image = encoder.new_image::<Gray32Float>(width, height).unwrap();
    let tags = image.encoder();
    tags.write_tag(Tag::ModelPixelScaleTag, &[step, step, 0.0][..]).unwrap();
    tags.write_tag(Tag::ModelTiepointTag, &[0.0, 0.0, 0.0, west, north, 0.0][..]).unwrap();
    let keys = [1u16, 1, 0, 3, 1024, 0, 1, 2, 1025, 0, 1, 2, 2048, 0, 1, 4326];
    tags.write_tag(Tag::GeoKeyDirectoryTag, &keys[..]).unwrap();
    image.write_data(&posts).unwrap();
}

pub fn recipe(folder: &Path, text: &str) -> Recipe {
    Recipe::parse(text, &folder.join("recipe.toml")).unwrap()
}

pub fn world_text(sets: &str) -> String {
    let source = |file: &str| format!("[[elevation]]\nfile = \"{file}\"\nvertical = \"ellipsoid\"\n");
    let sources: String = ["globe.tif", "a.tif", "b.tif", "c.tif"].into_iter().map(source).collect();
    format!("name = \"made-up\"\n{sources}{sets}")
}

/// Runs with a control that tells each step.
pub fn watched<T>(on_step: &(dyn Fn() -> bool + Sync), run: impl FnOnce(&Control) -> T) -> T {
    let stop = AtomicBool::new(false);
    let step = |progress: stoop::prepare::Progress<'_>| {
        if progress.stage == "write into the world" && !on_step() {
            stop.store(true, Ordering::Relaxed);
        }
    };
    run(&Control { stop: &stop, on_progress: &step, on_done: &|_| {}, on_note: &|_| {} })
}

pub fn make(folder: &Path, out: &Path, sets: &str) -> Manifest {
    make_of(folder, out, &world_text(sets))
}

/// Prepares the world of a recipe's text.
pub fn make_of(folder: &Path, out: &Path, text: &str) -> Manifest {
    let options = BuildOptions { out: out.to_owned(), root: None, memory: ByteSize(64 << 20), replace: true };
    watched(&|| true, |control| build(&recipe(folder, text), &options, control)).unwrap()
}

/// All pages of a world, and where they lie.
pub fn pages(world: &World) -> Vec<(PageId, Place)> {
    let mut found = Vec::new();
    for node in world.index().trees().flat_map(IndexTree::nodes) {
        let mut add = |kind, place| found.push((PageId { cell: node.cell(), kind }, place));
        node.terrain().into_iter().for_each(|terrain| add(PageKind::Terrain, terrain.place));
        node.imagery().into_iter().for_each(|place| add(PageKind::Imagery, place));
        node.objects().for_each(|o| add(PageKind::Objects { collection: o.collection, rep: o.rep }, o.place));
    }
    found
}
