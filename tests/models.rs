//! Models set down by a table: places, headings, scales, heights, colours, and how far a simplified one is off.
#![cfg(feature = "prepare")]
#![allow(clippy::unwrap_used, reason = "a test that cannot go on should stop")]

use glam::DVec3;
use serde_json::json;
use std::path::Path;
use stoop::content::Detail;
use stoop::geodesy::{Geodetic, VerticalDatum};
use stoop::prepare::buildings::{Gathered, Ground, Placed, gather};
use stoop::prepare::model::Model;
use stoop::prepare::{PrepareError, Recipe};

const HILL: Ground = Ground { height_m: &|_, _| 100.0, error_m: &|_, _| 0.5 };

/// A file of glTF with its buffer beside it: positions (y up, metres), triangles, and one red material.
fn write_gltf(folder: &Path, positions: &[[f32; 3]], triangles: &[[u16; 3]], node: serde_json::Value) {
    let mut bytes: Vec<u8> = positions.iter().flatten().flat_map(|value| value.to_le_bytes()).collect();
    let start = bytes.len();
    bytes.extend(triangles.iter().flatten().flat_map(|index| index.to_le_bytes()));
    let bound = |pick: fn(f32, f32) -> f32| {
        [0, 1, 2].map(|axis| positions.iter().map(|position| position[axis]).reduce(pick).unwrap())
    };
    let file = json!({
        "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "nodes": [0] }], "nodes": [node],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 1, "material": 0 }] }],
        "materials": [{ "pbrMetallicRoughness": { "baseColorFactor": [1.0, 0.0, 0.2158605, 1.0] } }],
        "buffers": [{ "uri": "model.bin", "byteLength": bytes.len() }],
        "bufferViews": [
            { "buffer": 0, "byteOffset": 0, "byteLength": start },
            { "buffer": 0, "byteOffset": start, "byteLength": bytes.len() - start },
        ],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": positions.len(), "type": "VEC3",
              "min": bound(f32::min), "max": bound(f32::max) },
            { "bufferView": 1, "componentType": 5123, "count": triangles.len() * 3, "type": "SCALAR" },
        ],
    });
    std::fs::write(folder.join("model.gltf"), file.to_string()).unwrap();
    std::fs::write(folder.join("model.bin"), bytes).unwrap();
}

/// An arrow on the floor that points to -z, 4 m long and 2 m wide, and a mast of 3 m.
const ARROW: [[f32; 3]; 4] = [[-1.0, 0.0, 2.0], [1.0, 0.0, 2.0], [0.0, 0.0, -2.0], [0.0, 3.0, 2.0]];
const FACES: [[u16; 3]; 4] = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];

fn try_gather(folder: &Path, table: &str, keys: &str) -> Result<Gathered, PrepareError> {
    std::fs::write(folder.join("places.csv"), table).unwrap();
    let text =
        format!("name = \"w\"\n[[objects]]\nname = \"m\"\nfile = \"model.gltf\"\nplace = \"places.csv\"\n{keys}");
    let recipe = Recipe::parse(&text, &folder.join("r.toml"))?;
    gather(&recipe.buildings[0], folder, VerticalDatum::Ellipsoid, &HILL, &|_| ())
}

fn detail(placed: &Placed) -> &Detail {
    placed.prism.detail.as_ref().unwrap()
}

/// Corners east, north and up of a place on the ellipsoid, metres.
fn around(placed: &Placed, lon_deg: f64, lat_deg: f64) -> Vec<DVec3> {
    let origin = Geodetic::from_degrees(lat_deg, lon_deg, 0.0);
    let enu_from_ecef = origin.ecef_from_enu().inverse();
    let corners = detail(placed).corners.iter().map(|c| (c.lon_rad, c.lat_rad, f64::from(c.height_m)));
    corners
        .map(|(lon_rad, lat_rad, height_m)| {
            let flat = (enu_from_ecef * Geodetic { lat_rad, lon_rad, height_m: 0.0 }.to_ecef()).xyz();
            DVec3::new(flat.x, flat.y, height_m)
        })
        .collect()
}

fn assert_corner(corners: &[DVec3], expected: [f64; 3]) {
    let nearest = corners.iter().map(|corner| corner.distance(DVec3::from(expected))).fold(f64::INFINITY, f64::min);
    assert!(nearest < 0.002, "{expected:?} not in {corners:?}");
}

#[test]
fn models_stand_where_the_table_says() {
    let folder = tempfile::tempdir().unwrap();
    write_gltf(folder.path(), &ARROW, &FACES, json!({ "mesh": 0 }));
    let table = "name, lon_deg, lat_deg, height_m, heading_deg, scale\n\
        plain, 24.9, 60.2, , , \n\
        east, 24.9, 60.2, 7.5, 90, 2\n\
        south, -70, -33, 7.5, 180,\n";
    let gathered = try_gather(folder.path(), table, "").unwrap();
    assert_eq!((gathered.features, gathered.objects.len()), (3, 3), "{:?}", gathered.set_aside);
    // On the terrain, the tip to the north.
    let plain = around(&gathered.objects[0], 24.9, 60.2);
    assert_corner(&plain, [0.0, 2.0, 100.0]);
    assert_corner(&plain, [1.0, -2.0, 100.0]);
    assert_corner(&plain, [0.0, -2.0, 103.0]);
    let east = around(&gathered.objects[1], 24.9, 60.2);
    assert_corner(&east, [4.0, 0.0, 7.5]);
    assert_corner(&east, [-4.0, 0.0, 13.5]);
    assert_corner(&east, [-4.0, -2.0, 7.5]);
    assert_corner(&around(&gathered.objects[2], -70.0, -33.0), [0.0, -2.0, 7.5]);
    for placed in &gathered.objects {
        let group = &detail(placed).groups[0];
        assert_eq!((group.color, group.triangles.len()), (Some([255, 0, 128]), 4));
        assert!(placed.attributes.contains("\"name\""));
    }
    assert!((gathered.objects[1].reach_m - 8.0).abs() < 0.01, "{}", gathered.objects[1].reach_m);
}

#[test]
fn nodes_move_their_meshes_and_mirrors_keep_faces_outwards() {
    let folder = tempfile::tempdir().unwrap();
    // Half a turn about the vertical, up 5 m, mirrored in x.
    let node = json!({ "mesh": 0, "translation": [0, 5, 0], "rotation": [0, 1, 0, 0], "scale": [-1, 1, 1] });
    write_gltf(folder.path(), &ARROW, &FACES, node);
    let gathered = try_gather(folder.path(), "lon_deg,lat_deg,height_m\n8,47,0\n", "").unwrap();
    let corners = around(&gathered.objects[0], 8.0, 47.0);
    assert_corner(&corners, [0.0, -2.0, 5.0]);
    assert_corner(&corners, [0.0, 2.0, 8.0]);
    let faces = detail(&gathered.objects[0]).groups[0].triangles.iter().map(|t| t.map(|at| corners[at as usize]));
    let volume: f64 = faces.map(|[a, b, c]| a.dot(b.cross(c)) / 6.0).sum();
    assert!((volume - 4.0 * 2.0 / 2.0 * 3.0 / 3.0).abs() < 0.01, "{volume}");
}

#[test]
fn a_simplified_model_is_off_by_no_more_than_asked() {
    let folder = tempfile::tempdir().unwrap();
    // A dome of 5 m in 24 × 48 quads, and its floor left open.
    let (rings, steps) = (24u16, 48u16);
    let at = |ring: u16, step: u16| {
        let (up, round) = (f32::from(ring) / f32::from(rings) * 1.5, f32::from(step) / f32::from(steps));
        let (sin, cos) = (round * std::f32::consts::TAU).sin_cos();
        [5.0 * up.cos() * cos, 5.0 * up.sin(), -5.0 * up.cos() * sin]
    };
    let positions: Vec<[f32; 3]> = (0..=rings).flat_map(|ring| (0..steps).map(move |step| at(ring, step))).collect();
    let index = |ring: u16, step: u16| ring * steps + step % steps;
    let quad = |ring: u16, step: u16| {
        let [a, b, c, d] = [index(ring, step), index(ring, step + 1), index(ring + 1, step + 1), index(ring + 1, step)];
        [[a, b, c], [a, c, d]]
    };
    let triangles: Vec<[u16; 3]> =
        (0..rings).flat_map(|ring| (0..steps).flat_map(move |step| quad(ring, step))).collect();
    write_gltf(folder.path(), &positions, &triangles, json!({ "mesh": 0 }));
    let file = folder.path().join("model.gltf");
    let count = |model: &Model| model.groups.iter().map(|group| group.triangles.len()).sum::<usize>();
    let whole = Model::read(&file, 0.0).unwrap();
    assert_eq!(count(&whole), triangles.len());
    let mut last = triangles.len();
    for error_m in [0.02, 0.1, 0.4] {
        let model = Model::read(&file, error_m).unwrap();
        assert!(count(&model) < last, "{error_m}: {}", count(&model));
        last = count(&model);
        // Middles of faces lie furthest inside of the sphere.
        let faces =
            model.groups.iter().flat_map(|group| &group.triangles).map(|t| t.map(|at| model.corners[at as usize]));
        let off = faces.map(|[a, b, c]| ((a + b + c) / 3.0).length()).map(|r| 5.0 - r);
        let most = off.fold(0.0, f64::max);
        // The mean of squared distances is what meshoptimizer bounds: single places may be twice as far off.
        assert!(most <= 2.0 * error_m + 0.03, "{error_m}: {most}");
        // The border stays.
        let border = model.corners.iter().filter(|corner| corner.z.abs() < 1e-6).count();
        assert_eq!(border, usize::from(steps), "{error_m}");
    }
}

#[test]
fn wrong_tables_and_models_say_where_and_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    write_gltf(folder.path(), &ARROW, &FACES, json!({ "mesh": 0 }));
    let cases = [
        ("lon,lat_deg\n1,2\n", "lon_deg"),
        ("lon_deg,lat_deg\n1,\n", "line 2"),
        ("lon_deg,lat_deg\n1,2\n1,95\n", "line 3"),
        ("lon_deg,lat_deg,heading_deg\n1,2,north\n", "heading_deg"),
        ("lon_deg,lat_deg,scale\n1,2,0\n", "scale"),
        ("lon_deg,lat_deg\n1,2,3\n", "places.csv"),
    ];
    for (table, says) in cases {
        let error = try_gather(folder.path(), table, "").unwrap_err().to_string();
        assert!(error.contains("places.csv") && error.contains(says), "{table:?}: {error}");
    }
    std::fs::write(folder.path().join("model.gltf"), "{").unwrap();
    let error = try_gather(folder.path(), "lon_deg,lat_deg\n1,2\n", "").unwrap_err().to_string();
    assert!(error.contains("model.gltf"), "{error}");
    std::fs::remove_file(folder.path().join("model.gltf")).unwrap();
    let error = try_gather(folder.path(), "lon_deg,lat_deg\n1,2\n", "").unwrap_err().to_string();
    assert!(error.contains("model.gltf"), "{error}");
}

#[test]
fn a_textured_model_has_its_picture_by_the_factor_and_each_half_its_own() {
    let folder = tempfile::tempdir().unwrap();
    // A wall of 4 × 2 m that looks south and leans, so that it has an outline: v runs down from the top, u beyond one repeats the picture.
    write_gltf(
        folder.path(),
        &[[-2.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 2.0, -1.0], [-2.0, 2.0, -1.0]],
        &[[0, 1, 2], [0, 2, 3]],
        json!({ "mesh": 0 }),
    );
    let file = folder.path().join("model.gltf");
    let mut gltf: serde_json::Value = serde_json::from_slice(&std::fs::read(&file).unwrap()).unwrap();
    let uvs: Vec<u8> = [[3.0f32, 1.0], [4.0, 1.0], [4.0, 0.0], [3.0, 0.0]]
        .iter()
        .flatten()
        .flat_map(|part| part.to_le_bytes())
        .collect();
    std::fs::write(folder.path().join("uvs.bin"), &uvs).unwrap();
    gltf["buffers"].as_array_mut().unwrap().push(json!({ "uri": "uvs.bin", "byteLength": uvs.len() }));
    gltf["bufferViews"].as_array_mut().unwrap().push(json!({ "buffer": 1, "byteLength": uvs.len() }));
    gltf["accessors"]
        .as_array_mut()
        .unwrap()
        .push(json!({ "bufferView": 2, "componentType": 5126, "count": 4, "type": "VEC2" }));
    gltf["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = json!(2);
    gltf["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = json!({ "index": 0 });
    gltf["textures"] = json!([{ "source": 0 }]);
    gltf["images"] = json!([{ "uri": "half.png" }]);
    std::fs::write(&file, gltf.to_string()).unwrap();
    let half = image::RgbImage::from_fn(16, 16, |x, _| image::Rgb(if x < 8 { [200, 100, 250] } else { [20, 10, 0] }));
    half.save(folder.path().join("half.png")).unwrap();
    let gathered = try_gather(folder.path(), "lon_deg,lat_deg,height_m\n8,47,0\n", "").unwrap();
    assert_eq!(gathered.objects.len(), 1, "{:?}", gathered.set_aside);
    let placed = &gathered.objects[0];
    let (detail, corners) = (detail(placed), around(placed, 8.0, 47.0));
    assert_eq!((detail.groups.len(), detail.groups[0].texture), (1, Some(0)));
    for (corner, uv) in corners.iter().zip(&detail.uvs) {
        let expected = [(corner.x + 2.0) / 4.0, 1.0 - corner.z / 2.0];
        assert!((0..2).all(|axis| (f64::from(uv[axis]) - expected[axis]).abs() < 1e-5), "{corner} {uv:?}");
    }
    let texels = placed.pictures[0].read().unwrap();
    assert_eq!(texels.get_pixel(0, 0).0, [200, 0, 125], "by the factor");
    assert_eq!(texels.get_pixel(15, 0).0, [20, 0, 0]);
    // What is cut out by alpha stays plain.
    gltf["materials"][0]["alphaMode"] = json!("MASK");
    std::fs::write(&file, gltf.to_string()).unwrap();
    let gathered = try_gather(folder.path(), "lon_deg,lat_deg,height_m\n8,47,0\n", "").unwrap();
    assert!(gathered.objects[0].prism.detail.as_ref().unwrap().groups.iter().all(|group| group.texture.is_none()));
}
