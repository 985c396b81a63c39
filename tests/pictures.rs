//! Golden pictures: what the passes look like. A missing reference fails; set STOOP_WRITE_GOLDEN=1 to write it, and
//! look at it. On a difference the picture and the difference are written to target/golden.

#![allow(
    clippy::unwrap_used,
    clippy::single_range_in_vec_init,
    reason = "tests fail by panicking; ranges are meant as ranges"
)]

mod scene;

use image::RgbaImage;
use scene::{AOV, imagery, land_m, painted_globe, piece, renderer, terrain, view};
use std::path::{Path, PathBuf};
use stoop::camera::View;
use stoop::content::{ObjectPage, Page, Prism};
use stoop::forest::CellId;
use stoop::geodesy::GeoBounds;
use stoop::render::{DrawOptions, Renderer};
use stoop::select::{DrawObjects, Selection};

const SIZE_PX: [u32; 2] = [320, 180];
/// Drivers round differently: means over all channels, of 255, and the share of pixels that differ visibly.
const MEAN_ALLOWED: f64 = 0.8;
const VISIBLE: u8 = 24;
const SHARE_ALLOWED: f64 = 0.01;

fn golden(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden").join(name).with_extension("png")
}

/// Mean difference of the channels, and the share of pixels with a visible one.
fn difference(a: &RgbaImage, b: &RgbaImage) -> (f64, f64) {
    let pixels = f64::from(a.width() * a.height());
    let (mut sum, mut visible) = (0u64, 0u32);
    for (p, q) in a.pixels().zip(b.pixels()) {
        let apart = [0, 1, 2].map(|c| p.0[c].abs_diff(q.0[c]));
        sum += apart.iter().map(|&d| u64::from(d)).sum::<u64>();
        visible += u32::from(apart.iter().any(|&d| d > VISIBLE));
    }
    (sum as f64 / (3.0 * pixels), f64::from(visible) / pixels)
}

fn write_failure(name: &str, actual: &RgbaImage, reference: &RgbaImage) -> PathBuf {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("target/golden");
    std::fs::create_dir_all(&folder).unwrap();
    actual.save(folder.join(format!("{name}.actual.png"))).unwrap();
    let mut apart = actual.clone();
    for (p, q) in apart.pixels_mut().zip(reference.pixels()) {
        (0..3).for_each(|c| p.0[c] = p.0[c].abs_diff(q.0[c]).saturating_mul(8));
    }
    apart.save(folder.join(format!("{name}.difference.png"))).unwrap();
    folder
}

fn check(name: &str, renderer: &mut Renderer, view: &View, selection: &Selection) {
    renderer.draw(view, selection, &DrawOptions { aov: false, ..AOV }).unwrap();
    let [width, height] = view.size_px;
    let actual = RgbaImage::from_raw(width, height, renderer.read_color().unwrap()).unwrap();
    let path = golden(name);
    if std::env::var_os("STOOP_WRITE_GOLDEN").is_some() {
        actual.save(&path).unwrap();
        return;
    }
    let reference = image::open(&path)
        .unwrap_or_else(|cause| panic!("{}: {cause}; STOOP_WRITE_GOLDEN=1 writes it", path.display()))
        .to_rgba8();
    assert_eq!(actual.dimensions(), reference.dimensions(), "{name}");
    let (mean, share) = difference(&actual, &reference);
    if mean > MEAN_ALLOWED || share > SHARE_ALLOWED {
        let folder = write_failure(name, &actual, &reference);
        panic!("{name}: mean {mean:.2}, {:.2} % visibly apart; see {}", share * 100.0, folder.display());
    }
}

#[test]
fn the_globe_from_ten_thousand_kilometres() {
    let mut renderer = renderer();
    let selection = painted_globe(&mut renderer);
    check("globe", &mut renderer, &view([35.0, 20.0, 1e7], [0.0, -90.0], 70.0, SIZE_PX), &selection);
}

#[test]
fn the_limb_from_a_hundred_kilometres_and_the_horizon_from_ten() {
    let mut renderer = renderer();
    let selection = painted_globe(&mut renderer);
    check("limb", &mut renderer, &view([35.0, 20.0, 1.5e5], [30.0, -12.0], 60.0, SIZE_PX), &selection);
    check("horizon", &mut renderer, &view([35.0, 20.0, 1e4], [30.0, -8.0], 60.0, SIZE_PX), &selection);
}

const LAT: f64 = 60.17;
const LON: f64 = 24.94;

fn knolls(lat: f64, lon: f64) -> f64 {
    let (x, y) = ((lon - LON.to_radians()) * 3.2e6, (lat - LAT.to_radians()) * 6.4e6);
    let far = ((x * x + y * y).sqrt() / 2500.0 - 0.6).clamp(0.0, 3.0);
    20.0 + far * far * (90.0 + 60.0 * (x / 900.0).sin() * (y / 1300.0).cos())
}

/// Streets on a lawn.
fn plan(lat: f64, lon: f64) -> [u8; 3] {
    let on_street = |v: f64| (v / 60.0).rem_euclid(1.0) < 0.2;
    let (x, y) = ((lon - LON.to_radians()) * 3.2e6, (lat - LAT.to_radians()) * 6.4e6);
    if on_street(x) || on_street(y) { [110, 110, 114] } else { [104, 122, 84] }
}

fn house(id: u32, column: i32, row: i32) -> Prism {
    let (lat, lon) = (LAT.to_radians(), LON.to_radians());
    let hash = (column * 7 + row * 13).rem_euclid(11);
    let place = |x: f64, y: f64| {
        [lon + (f64::from(column) * 60.0 + 16.0 + x) / 3.2e6, lat + (f64::from(row) * 60.0 + 16.0 + y) / 6.4e6]
    };
    let depth = 22.0 + f64::from(hash);
    Prism {
        id,
        cell: CellId::containing(lat, lon, 12),
        rings: vec![vec![place(0.0, 0.0), place(36.0, 0.0), place(36.0, depth), place(0.0, depth)]],
        roof: vec![[0, 1, 2], [0, 2, 3]],
        base_m: 20.0,
        top_m: 32.0 + 3.0 * hash as f32,
        foundation_m: 5.0,
        wall_color: [214 - 5 * hash as u8, 196 - 6 * hash as u8, 160 - 6 * hash as u8],
        roof_color: [128, 88 + 2 * hash as u8, 78],
        detail: None,
    }
}

fn town(renderer: &mut Renderer) -> Selection {
    let mut selection = painted_globe(renderer);
    let (lat, lon) = (LAT.to_radians(), LON.to_radians());
    let near = CellId::containing(lat, lon, 12);
    let (center, reach) = (near.bounds().center(), 0.004);
    let around = GeoBounds {
        west_rad: center.lon_rad - 2.0 * reach,
        south_rad: center.lat_rad - reach,
        east_rad: center.lon_rad + 2.0 * reach,
        north_rad: center.lat_rad + reach,
    };
    selection.pieces.clear();
    let sides = near.bounds();
    for north in -2..=2 {
        for east in -2..=2 {
            let lat = center.lat_rad + f64::from(north) * sides.height_rad();
            let lon = center.lon_rad + f64::from(east) * sides.width_rad();
            let cell = CellId::containing(lat, lon, 12);
            assert!(around.intersects(&cell.bounds()));
            renderer.upload(&imagery(cell, &plan)).unwrap();
            selection.pieces.push(piece(cell, &terrain(cell, 1, &knolls, &knolls), Some(cell)));
        }
    }
    let prisms = (-12..12)
        .flat_map(|row| (-12..12).map(move |column| house(((row + 12) * 24 + column + 12) as u32, column, row)));
    let (page, mesh) = ObjectPage::from_prisms(near, 0, 0, 0.0, prisms.collect());
    let (page, count) = (std::sync::Arc::new(page), 24 * 24);
    renderer.upload(&Page::Objects(page.clone(), mesh.into())).unwrap();
    selection.objects.push(DrawObjects { page, objects: vec![0..count] });
    selection
}

#[test]
fn a_town_from_above_its_roofs_and_from_its_street() {
    let mut renderer = renderer();
    let selection = town(&mut renderer);
    check("town", &mut renderer, &view([LAT - 0.006, LON - 0.006, 320.0], [30.0, -18.0], 60.0, SIZE_PX), &selection);
    check("street", &mut renderer, &view([LAT - 0.002, LON + 0.0001, 22.0], [2.0, 4.0], 60.0, SIZE_PX), &selection);
}

#[test]
fn plain_ground_is_tinted_by_height() {
    let mut renderer = renderer();
    let mut selection = Selection::default();
    for cell in stoop::forest::Zone::all().map(stoop::forest::Zone::root) {
        selection.pieces.push(piece(cell, &terrain(cell, 1, &land_m, &land_m), None));
    }
    check("plain", &mut renderer, &view([35.0, 20.0, 3e6], [0.0, -60.0], 60.0, SIZE_PX), &selection);
}
