//! Textures from a file to the picture: each side of a made-up block shows its own, the right way up and not mirrored.
#![cfg(feature = "prepare")]
#![allow(
    clippy::unwrap_used,
    clippy::single_range_in_vec_init,
    reason = "tests fail by panicking; ranges are meant as ranges"
)]

mod scene;

use glam::DVec3;
use image::{Rgb, RgbImage};
use scene::{AOV, renderer, view};
use serde_json::{Value, json};
use std::path::Path;
use std::sync::Arc;
use stoop::content::{Atlas, AtlasFormat, DetailCorner, Page, Prism};
use stoop::geodesy::{Geodetic, VerticalDatum};
use stoop::prepare::buildings::{Gathered, Ground, gather};
use stoop::prepare::textures::{ATLAS_BYTES_MAX, Baked, Picture, bake};
use stoop::render::DrawOptions;
use stoop::select::{DrawObjects, Selection};
use stoop::store::{PrismPage, decode_atlas, decode_objects, decode_prisms, encode_objects};

const FLAT: Ground = Ground { height_m: &|_, _| 100.0, error_m: &|_, _| 0.0 };
/// A tile of the picture for each of south, east, north, west and roof.
const SIDES: [[u8; 3]; 5] = [[220, 40, 40], [40, 220, 40], [40, 40, 220], [220, 220, 40], [220, 40, 220]];
const TILE_PX: u32 = 64;

/// What a tile shows, from its lower left corner: black upper left, white upper right, its colour below.
fn tile(side: usize, right: f64, up: f64) -> [u8; 3] {
    match (right < 0.5, up < 0.5) {
        (_, true) => SIDES[side],
        (true, false) => [10, 10, 10],
        (false, false) => [250, 250, 250],
    }
}

fn painted() -> RgbImage {
    let part = |at: u32| (f64::from(at % TILE_PX) + 0.5) / f64::from(TILE_PX);
    RgbImage::from_fn(5 * TILE_PX, TILE_PX, |x, y| Rgb(tile((x / TILE_PX) as usize, part(x), 1.0 - part(y))))
}

/// A block of 10 × 6 × 4 m with a tile on each side.
fn block() -> Value {
    let ring = |side: u64| json!([[0, 4 * side, 4 * side + 1, 4 * side + 2, 4 * side + 3]]);
    let values: Vec<Value> = (0..5).map(ring).chain([json!([[null]])]).collect();
    let uvs: Vec<[f64; 2]> = (0..5)
        .flat_map(|side| {
            let (left, right) = (f64::from(side) / 5.0, f64::from(side + 1) / 5.0);
            [[left, 0.0], [right, 0.0], [right, 1.0], [left, 1.0]]
        })
        .collect();
    json!({
        "type": "CityJSON",
        "version": "2.0",
        "metadata": { "referenceSystem": "https://www.opengis.net/def/crs/EPSG/0/25832" },
        "transform": { "scale": [1.0, 1.0, 1.0], "translate": [500000.0, 5300000.0, 20.0] },
        "vertices": [
            [0, 0, 0], [10, 0, 0], [10, 6, 0], [0, 6, 0], [0, 0, 4], [10, 0, 4], [10, 6, 4], [0, 6, 4]
        ],
        "appearance": { "textures": [{ "type": "PNG", "image": "pictures/all.png" }], "vertices-texture": uvs },
        "CityObjects": { "b": { "type": "Building", "geometry": [{
            "type": "MultiSurface", "lod": "2",
            "boundaries": [
                [[0, 1, 5, 4]], [[1, 2, 6, 5]], [[2, 3, 7, 6]], [[3, 0, 4, 7]], [[4, 5, 6, 7]], [[0, 3, 2, 1]]
            ],
            "texture": { "photo": { "values": values } },
        }] } },
    })
}

fn gathered(city: &Value, picture: Option<&[u8]>) -> Gathered {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("a.city.json"), city.to_string()).unwrap();
    std::fs::create_dir(folder.path().join("pictures")).unwrap();
    let file = folder.path().join("pictures/all.png");
    match picture {
        Some(bytes) => std::fs::write(file, bytes).unwrap(),
        None => painted().save(file).unwrap(),
    }
    gathered_in(folder.path())
}

fn gathered_in(folder: &Path) -> Gathered {
    let section = toml::from_str("name = \"city\"\nfile = \"a.city.json\"").unwrap();
    let gathered = gather(&section, folder, VerticalDatum::Ellipsoid, &FLAT, &|_| ()).unwrap();
    // Pictures are read again for an atlas, while their folder is there.
    gathered.objects.iter().flat_map(|object| &object.pictures).for_each(|picture| drop(picture.read()));
    gathered
}

/// The block as a page, its pictures read in the folder.
fn stored(city: &Value) -> (Vec<u8>, Baked) {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("a.city.json"), city.to_string()).unwrap();
    std::fs::create_dir(folder.path().join("pictures")).unwrap();
    painted().save(folder.path().join("pictures/all.png")).unwrap();
    let gathered = gathered_in(folder.path());
    page_of(&gathered)
}

fn page_of(gathered: &Gathered) -> (Vec<u8>, Baked) {
    let mut prisms: Vec<Prism> = gathered.objects.iter().map(|object| object.prism.clone()).collect();
    let pictures: Vec<&[Arc<Picture>]> = gathered.objects.iter().map(|object| &*object.pictures).collect();
    let baked = bake(&mut prisms, &pictures).unwrap();
    let root = prisms[0].cell;
    let atlas = baked.atlas.clone();
    let page = PrismPage { root, collection: 0, rep: 0, error_m: 0.02, prisms, atlas };
    (encode_objects(&page, &[]).unwrap(), baked)
}

/// Metres east, north and up of the block's south-west corner.
fn local(corner: &DetailCorner, origin: Geodetic) -> DVec3 {
    let place = Geodetic { lat_rad: corner.lat_rad, lon_rad: corner.lon_rad, height_m: f64::from(corner.height_m) };
    (origin.ecef_from_enu().inverse() * place.to_ecef()).xyz()
}

/// Which side a face is, and where on it a point lies, from the left and from below as seen from outside.
fn on_side(point: DVec3, normal: DVec3) -> (usize, f64, f64) {
    let (x, y, z) = (point.x / 10.0, point.y / 6.0, point.z / 4.0);
    match () {
        () if normal.z > 0.9 => (4, x, y),
        () if normal.y < -0.9 => (0, x, z),
        () if normal.x > 0.9 => (1, y, z),
        () if normal.y > 0.9 => (2, 1.0 - x, z),
        () => (3, 1.0 - y, z),
    }
}

fn texel(atlas: &Atlas, uv: [f64; 2]) -> [u8; 3] {
    let [width, height] = atlas.size_px();
    let at = |part: f64, side: u32| (part * f64::from(side)) as usize;
    let first = 4 * (at(uv[1], height) * width as usize + at(uv[0], width));
    [0, 1, 2].map(|channel| atlas.mips()[0][first + channel])
}

#[test]
fn known_texels_lie_at_known_corners_of_a_decoded_page() {
    let (page, baked) = stored(&block());
    assert_eq!((baked.scaled, baked.lost), (0, 0));
    let page = decode_prisms(&page).unwrap();
    let atlas = decode_atlas(page.atlas.as_deref().unwrap()).unwrap();
    let detail = page.prisms[0].detail.as_ref().unwrap();
    let lowest = |of: &dyn Fn(&DetailCorner) -> f64| detail.corners.iter().map(of).fold(f64::INFINITY, f64::min);
    let origin = Geodetic { lat_rad: lowest(&|c| c.lat_rad), lon_rad: lowest(&|c| c.lon_rad), height_m: 100.0 };
    let mut seen = [0; 5];
    for group in &detail.groups {
        assert_eq!(group.texture, Some(0));
        for triangle in &group.triangles {
            let corners = triangle.map(|at| local(&detail.corners[at as usize], origin));
            let uvs = triangle.map(|at| detail.uvs[at as usize].map(f64::from));
            let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize();
            // At the corners, a little inwards.
            for first in 0..3 {
                let weights = [0, 1, 2].map(|at| if at == first { 0.8 } else { 0.1 });
                let point: DVec3 = (0..3).map(|at| corners[at] * weights[at]).sum();
                let uv = [0, 1].map(|axis| (0..3).map(|at| uvs[at][axis] * weights[at]).sum::<f64>());
                let (side, right, up) = on_side(point, normal);
                let (found, expected) = (texel(&atlas, uv), tile(side, right, up));
                assert!(
                    (0..3).all(|c| found[c].abs_diff(expected[c]) < 30),
                    "{side} {right} {up}: {found:?} {expected:?}"
                );
                seen[side] += 1;
            }
        }
    }
    assert_eq!(seen, [6; 5]);
    // Where the texture is absent the faces have its mean: two quarters of colour, one of black, one of white.
    let roof = detail.groups.iter().find(|group| group.kind == stoop::content::FaceKind::Roof).unwrap();
    let mean = [175, 85, 175];
    assert!((0..3).all(|c| roof.color.unwrap()[c].abs_diff(mean[c]) < 12), "{:?}", roof.color);
}

/// Luminance and the channels of a pixel.
fn pixel(rgba: &[u8], width: u32, x: f64, y: f64) -> [f64; 3] {
    let first = 4 * (y.round() as usize * width as usize + x.round() as usize);
    [0, 1, 2].map(|channel| f64::from(rgba[first + channel]))
}

#[test]
fn every_side_shows_its_tile_upright_and_not_mirrored() {
    let plain = shows_its_tiles(AtlasFormat::Rgba8).unwrap();
    for (format, times_smaller) in [(AtlasFormat::Bc7, 4), (AtlasFormat::Etc2, 8)] {
        match shows_its_tiles(format) {
            Some(bytes) => assert!(bytes * times_smaller < plain * 11 / 10, "{format:?}: {bytes} of {plain}"),
            None => println!("skipped: this adapter does not read {format:?}"),
        }
    }
}

/// The bytes of the atlas; `None` where the adapter cannot read it.
fn shows_its_tiles(format: AtlasFormat) -> Option<usize> {
    const SIZE_PX: u32 = 200;
    let (page, mut mesh) = decode_objects(&stored(&block()).0).unwrap();
    mesh.compress_atlas(format);
    let (atlas, uvs) = mesh.textures().unwrap();
    assert_eq!((uvs.len(), atlas.mips().len()), (mesh.vertices.len(), 4));
    let atlas_bytes = atlas.byte_len();
    let (lat, lon) = (page.objects[0].lat_rad.to_degrees(), page.objects[0].lon_rad.to_degrees());
    let page = Arc::new(page);
    let mut renderer = renderer();
    if !renderer.can_read(format) {
        return None;
    }
    let whole = Page::Objects(page.clone(), Arc::new(mesh));
    let bytes = renderer.upload(&whole).unwrap();
    assert_eq!((bytes, renderer.allocated_bytes()), (stoop::render::Renderer::gpu_bytes(&whole), bytes));
    let selection = Selection { objects: vec![DrawObjects { page, objects: vec![0..1] }], ..Selection::default() };
    let metre = 1.0 / 111_200.0;
    let east = metre / lat.to_radians().cos();
    let eyes = [
        ([lat - 25.0 * metre, lon, 102.0], [0.0, 0.0]),
        ([lat, lon + 25.0 * east, 102.0], [-90.0, 0.0]),
        ([lat + 25.0 * metre, lon, 102.0], [180.0, 0.0]),
        ([lat, lon - 25.0 * east, 102.0], [90.0, 0.0]),
        ([lat, lon, 125.0], [0.0, -90.0]),
    ];
    for (side, (eye, aim)) in eyes.into_iter().enumerate() {
        for aov in [false, true] {
            let view = view(eye, aim, 30.0, [SIZE_PX; 2]);
            renderer.draw(&view, &selection, &DrawOptions { aov, ..AOV }).unwrap();
            let rgba = renderer.read_color().unwrap();
            let middle = f64::from(SIZE_PX) / 2.0;
            let at = |right: f64, down: f64| pixel(&rgba, SIZE_PX, middle + right, middle + down);
            let (black, white) = (at(-15.0, -12.0), at(15.0, -12.0));
            for below in [at(-15.0, 12.0), at(15.0, 12.0)] {
                for channel in 0..3 {
                    let is_bright = SIDES[side][channel] > 100;
                    let share = below[channel] / white[channel];
                    assert_eq!(is_bright, share > 0.7, "side {side}: {below:?} below {white:?}");
                }
            }
            assert!((0..3).all(|c| black[c] < 0.4 * white[c]), "side {side}: {black:?} {white:?}");
        }
    }
    renderer.remove(whole.id());
    assert_eq!(renderer.allocated_bytes(), 0);
    Some(atlas_bytes)
}

#[test]
fn what_repeats_is_baked_and_what_is_mirrored_turns() {
    for (wrap, black_at) in [("wrap", [0.25, 1.25]), ("mirror", [0.25, 1.75])] {
        let mut city = block();
        city["appearance"]["textures"][0]["wrapMode"] = json!(wrap);
        // The south side shows the first tile's picture twice over: of a picture that is one tile only.
        city["appearance"]["vertices-texture"] = json!([[2.0, 0.0], [4.0, 0.0], [4.0, 1.0], [2.0, 1.0]]);
        let none = json!([[null]]);
        city["CityObjects"]["b"]["geometry"][0]["texture"]["photo"]["values"] =
            json!([[[0, 0, 1, 2, 3]], none, none, none, none, none]);
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("a.city.json"), city.to_string()).unwrap();
        std::fs::create_dir(folder.path().join("pictures")).unwrap();
        let one = image::imageops::crop_imm(&painted(), 0, 0, TILE_PX, TILE_PX).to_image();
        one.save(folder.path().join("pictures/all.png")).unwrap();
        let (page, _) = page_of(&gathered_in(folder.path()));
        let page = decode_prisms(&page).unwrap();
        let atlas = decode_atlas(page.atlas.as_deref().unwrap()).unwrap();
        let detail = page.prisms[0].detail.as_ref().unwrap();
        let group = detail.groups.iter().find(|group| group.texture.is_some()).unwrap();
        let of = |pick: &dyn Fn([f32; 2]) -> f32, most: bool| {
            let all = group.triangles.iter().flatten().map(|&at| f64::from(pick(detail.uvs[at as usize])));
            if most { all.fold(f64::MIN, f64::max) } else { all.fold(f64::MAX, f64::min) }
        };
        let (left, right) = (of(&|uv| uv[0], false), of(&|uv| uv[0], true));
        let (upper, lower) = (of(&|uv| uv[1], false), of(&|uv| uv[1], true));
        for at in [0.25, 0.75, 1.25, 1.75] {
            let found = texel(&atlas, [left + (right - left) * at / 2.0, upper + (lower - upper) * 0.25]);
            assert_eq!(found[1] < 100, black_at.contains(&at), "{wrap} at {at}: {found:?}");
        }
    }
}

#[test]
fn pictures_that_cannot_be_had_are_counted_and_faces_stay_plain() {
    let plain = |gathered: &Gathered, note: &str| {
        assert_eq!(gathered.repaired.get(note), Some(&1), "{note}: {:?}", gathered.repaired);
        let detail = gathered.objects[0].prism.detail.as_ref().unwrap();
        assert!(detail.triangles() == 10 && detail.uvs.is_empty());
        assert!(detail.groups.iter().all(|group| group.texture.is_none() && group.color.is_none()));
    };
    plain(&gathered(&block(), Some(b"no picture")), "picture of a texture damaged: plain colour");
    let mut elsewhere = block();
    elsewhere["appearance"]["textures"][0]["image"] = json!("nowhere.jpg");
    plain(&gathered(&elsewhere, None), "picture of a texture missing: plain colour");
    let mut cut = block();
    for side in 0..5 {
        cut["CityObjects"]["b"]["geometry"][0]["texture"]["photo"]["values"][side] = json!([[0, 0, 1, 2]]);
    }
    plain(&gathered(&cut, None), "texture coordinates that do not fit their surface: plain colour");
    let mut often = block();
    often["appearance"]["textures"][0]["wrapMode"] = json!("wrap");
    let corners: Vec<[f64; 2]> = (0..5).flat_map(|_| [[0.0, 0.0], [900.0, 0.0], [900.0, 1.0], [0.0, 1.0]]).collect();
    often["appearance"]["vertices-texture"] = json!(corners);
    plain(&gathered(&often, None), "texture repeated too often: plain colour");
    // Names of what is not there give no texture at all.
    let mut beyond = block();
    beyond["appearance"]["vertices-texture"] = json!([[0.0, 0.0]]);
    let gathered = gathered(&beyond, None);
    assert!(gathered.objects[0].prism.detail.as_ref().unwrap().groups.iter().all(|group| group.texture.is_none()));
}

#[test]
fn large_pictures_are_scaled_down_to_the_limit_of_a_page() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("a.city.json"), block().to_string()).unwrap();
    std::fs::create_dir(folder.path().join("pictures")).unwrap();
    let mut seed = 7u32;
    let noise = RgbImage::from_fn(5 * 512, 512, |_, _| {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        Rgb((seed >> 8).to_le_bytes()[..3].try_into().unwrap())
    });
    noise.save(folder.path().join("pictures/all.png")).unwrap();
    let (page, baked) = page_of(&gathered_in(folder.path()));
    assert_eq!((baked.scaled, baked.lost), (1, 0));
    let len = baked.atlas.unwrap().len();
    assert!((ATLAS_BYTES_MAX / 3..=ATLAS_BYTES_MAX).contains(&len), "{len}");
    assert!(page.len() < 128 << 10 && decode_objects(&page).is_ok());
}
