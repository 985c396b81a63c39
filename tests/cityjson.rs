//! CityJSON: what real files hold stands where they say, and every version, template and fault of a made-up one.
#![cfg(feature = "prepare")]
#![allow(clippy::unwrap_used, reason = "a test that cannot go on should stop")]

use glam::DVec3;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use stoop::content::{Detail, FaceKind};
use stoop::geodesy::{Geodetic, VerticalDatum};
use stoop::prepare::PrepareError;
use stoop::prepare::buildings::{Gathered, Ground, Placed, gather};

const FLAT: Ground = Ground { height_m: &|_, _| 100.0, error_m: &|_, _| 0.5 };

fn try_gather(root: &Path, file: &str, keys: &str) -> Result<Gathered, PrepareError> {
    let section = toml::from_str(&format!("name = \"city\"\nfile = \"{file}\"\n{keys}")).unwrap();
    gather(&section, root, VerticalDatum::Ellipsoid, &FLAT, &|_| ())
}

/// The folder of real files; says so where it is not there.
fn data() -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().map(|up| up.join("shared/data/cityjson"));
    let found = folder.filter(|folder| folder.is_dir()).last();
    if found.is_none() {
        println!("skipped: shared/data/cityjson is not there");
    }
    found
}

fn id(placed: &Placed) -> String {
    let attributes: Value = serde_json::from_str(&placed.attributes).unwrap();
    attributes["id"].as_str().unwrap().to_owned()
}

fn detail(placed: &Placed) -> &Detail {
    placed.prism.detail.as_ref().unwrap()
}

/// Corners of a detail in the tangent plane at a place, metres.
fn local(detail: &Detail, at: Geodetic) -> Vec<DVec3> {
    let enu_from_ecef = at.ecef_from_enu().inverse();
    let corner = |corner: &stoop::content::DetailCorner| {
        let place = Geodetic { lat_rad: corner.lat_rad, lon_rad: corner.lon_rad, height_m: f64::from(corner.height_m) };
        (enu_from_ecef * place.to_ecef()).xyz()
    };
    detail.corners.iter().map(corner).collect()
}

fn middle(placed: &Placed) -> Geodetic {
    Geodetic { lat_rad: placed.lat_rad, lon_rad: placed.lon_rad, height_m: f64::from(placed.prism.base_m) }
}

/// Volume under the faces by the divergence theorem, from a point on the floor: all faces but a level floor.
fn volume_above_m3(placed: &Placed, floor: Geodetic) -> f64 {
    let corners = local(detail(placed), floor);
    let triangles = detail(placed).groups.iter().flat_map(|group| &group.triangles);
    triangles.map(|t| t.map(|at| corners[at as usize])).map(|[a, b, c]| a.dot(b.cross(c)) / 6.0).sum()
}

fn volume_m3(placed: &Placed) -> f64 {
    let (low_m, _) = detail(placed).height_range_m().unwrap();
    volume_above_m3(placed, Geodetic { height_m: f64::from(low_m), ..middle(placed) })
}

/// A file's object with the heights of its corners and the box of its coordinates.
struct Source {
    name: String,
    heights_m: Vec<f64>,
}

fn sources(file: &Path) -> Vec<Source> {
    let city: Value = serde_json::from_slice(&std::fs::read(file).unwrap()).unwrap();
    let transform = |axis: usize, key: &str| city["transform"][key][axis].as_f64().unwrap();
    let (scale, shift) = (transform(2, "scale"), transform(2, "translate"));
    fn indices(nested: &Value, found: &mut Vec<usize>) {
        match nested {
            Value::Array(parts) => parts.iter().for_each(|part| indices(part, found)),
            other => found.extend(other.as_u64().map(|at| at as usize)),
        }
    }
    let objects = city["CityObjects"].as_object().unwrap().iter();
    objects
        .map(|(name, object)| {
            let mut found = Vec::new();
            object["geometry"].as_array().into_iter().flatten().for_each(|g| indices(&g["boundaries"], &mut found));
            let height = |at: &usize| city["vertices"][at][2].as_f64().unwrap() * scale + shift;
            Source { name: name.clone(), heights_m: found.iter().map(height).collect() }
        })
        .collect()
}

/// Every corner stands at a height that the file has for that object, and the highest of the file is there.
fn assert_heights(gathered: &Gathered, file: &Path, datum: VerticalDatum) {
    let sources = sources(file);
    for placed in &gathered.objects {
        let name = id(placed);
        let source = sources.iter().find(|source| source.name == name).unwrap();
        let own: Vec<f64> = detail(placed).corners.iter().map(|corner| f64::from(corner.height_m)).collect();
        // The undulation changes by less than a centimetre over a building.
        let at_m = datum.undulation_m(placed.lat_rad, placed.lon_rad);
        for height_m in &own {
            let nearest = source.heights_m.iter().map(|h| (h + at_m - height_m).abs()).fold(f64::INFINITY, f64::min);
            assert!(nearest < 0.02, "{name}: {height_m} is {nearest} m off all corners");
        }
        assert!((f64::from(placed.prism.top_m) - own.iter().copied().fold(f64::MIN, f64::max)).abs() < 1e-3);
        assert!(f64::from(placed.prism.base_m) < f64::from(placed.prism.top_m));
    }
    // Over all parts of an outline, the file's highest corner is there.
    for source in &sources {
        let of_it = gathered.objects.iter().filter(|placed| id(placed) == source.name);
        let top = of_it.clone().map(|placed| f64::from(placed.prism.top_m)).fold(f64::NEG_INFINITY, f64::max);
        if let Some(placed) = of_it.into_iter().next() {
            let at_m = datum.undulation_m(placed.lat_rad, placed.lon_rad);
            let highest = source.heights_m.iter().copied().fold(f64::NEG_INFINITY, f64::max) + at_m;
            assert!((top - highest).abs() < 0.02, "{}: {top} {highest}", source.name);
        }
    }
}

#[test]
fn delft_stands_where_its_file_says() {
    let Some(folder) = data() else { return };
    let gathered = try_gather(&folder, "delft.json", "").unwrap();
    let kept_back: u64 = gathered.set_aside.values().sum();
    assert_eq!(gathered.features + kept_back, 570, "{:?}", gathered.set_aside);
    assert_eq!(gathered.set_aside["Road: shown by terrain and imagery"], 143);
    let of_kind = |kind: &str| {
        let named =
            gathered.objects.iter().filter(|placed| placed.attributes.contains(&format!("\"type\":\"{kind}\"")));
        named.map(id).collect::<std::collections::BTreeSet<_>>().len()
    };
    assert_eq!((of_kind("Building"), of_kind("Bridge")), (160, 3));
    assert_heights(&gathered, &folder.join("delft.json"), VerticalDatum::Egm96);
    // All buildings are blocks: their volume is their area times their height, with all faces closed. A building may
    // have an outline of several parts.
    let of_building = |placed: &&Placed| placed.attributes.contains("\"type\":\"Building\"");
    let mut volumes: BTreeMap<String, (f64, f64)> = BTreeMap::new();
    let mut floors: BTreeMap<String, Geodetic> = BTreeMap::new();
    for placed in gathered.objects.iter().filter(of_building) {
        let (low_m, high_m) = detail(placed).height_range_m().unwrap();
        let floor = floors.entry(id(placed)).or_insert(Geodetic { height_m: f64::from(low_m), ..middle(placed) });
        let corners = local(detail(placed), *floor);
        let roofs = detail(placed).groups.iter().filter(|group| group.kind == FaceKind::Roof);
        let triangles = roofs.flat_map(|group| &group.triangles).map(|t| t.map(|at| corners[at as usize]));
        let area_m2: f64 = triangles.map(|[a, b, c]| (b - a).cross(c - a).z / 2.0).sum();
        let volume = volumes.entry(id(placed)).or_default();
        volume.0 += volume_above_m3(placed, *floor);
        volume.1 += area_m2 * f64::from(high_m - low_m);
        assert!(placed.prism.foundation_m >= placed.prism.base_m - low_m);
    }
    for (name, (found, expected)) in volumes {
        assert!((found - expected).abs() < 0.05 + 0.002 * expected, "{name}: {found} {expected}");
    }
}

#[test]
fn zurich_keeps_its_parts_and_their_roofs() {
    let Some(folder) = data() else { return };
    let gathered = try_gather(&folder, "zurich_subset_lod2.json", "").unwrap();
    assert_eq!((gathered.features, gathered.set_aside.len()), (161, 0), "{:?}", gathered.set_aside);
    assert_eq!(gathered.repaired["heights of a national system taken as above EGM96"], 161);
    assert_heights(&gathered, &folder.join("zurich_subset_lod2.json"), VerticalDatum::Egm96);
    // Parts carry what their building says.
    assert!(gathered.objects.iter().all(|placed| placed.attributes.contains("\"Herkunft\"")));
    let sloping = gathered.objects.iter().filter(|placed| {
        let corners = local(detail(placed), middle(placed));
        let roofs = detail(placed).groups.iter().filter(|group| group.kind == FaceKind::Roof);
        roofs.flat_map(|group| &group.triangles).any(|t| {
            let [a, b, c] = t.map(|at| corners[at as usize]);
            (b - a).cross(c - a).normalize().z < 0.95
        })
    });
    assert!(sloping.count() > 50);
}

#[test]
fn rotterdam_needs_its_system_named() {
    let Some(folder) = data() else { return };
    let error = try_gather(&folder, "rotterdam/rotterdam_subset.json", "").unwrap_err().to_string();
    assert!(error.contains("rotterdam_subset.json") && error.contains("crs ="), "{error}");
    let gathered = try_gather(&folder, "rotterdam/rotterdam_subset.json", "crs = \"EPSG:7415\"").unwrap();
    assert_eq!(gathered.features, 16);
    assert_heights(&gathered, &folder.join("rotterdam/rotterdam_subset.json"), VerticalDatum::Egm96);
    let own = try_gather(&folder, "rotterdam/rotterdam_subset.json", "crs = \"EPSG:7415\"\nvertical = \"ellipsoid\"")
        .unwrap();
    assert_heights(&own, &folder.join("rotterdam/rotterdam_subset.json"), VerticalDatum::Ellipsoid);
}

/// Eight corners of a block of 10 × 6 × 4 m at a place in UTM 32N, quantized to millimetres: floor, then ceiling.
const BLOCK: [[i64; 3]; 8] = [
    [0, 0, 0],
    [10_000, 0, 0],
    [10_000, 6_000, 0],
    [0, 6_000, 0],
    [0, 0, 4_000],
    [10_000, 0, 4_000],
    [10_000, 6_000, 4_000],
    [0, 6_000, 4_000],
];

/// Floor, ceiling, south, east, north, west, counter-clockwise from outside.
fn block_faces() -> Value {
    json!([[[0, 3, 2, 1]], [[4, 5, 6, 7]], [[0, 1, 5, 4]], [[1, 2, 6, 5]], [[2, 3, 7, 6]], [[3, 0, 4, 7]]])
}

fn city(version: &str, system: &str, objects: Value) -> Value {
    json!({
        "type": "CityJSON",
        "version": version,
        "metadata": { "referenceSystem": system },
        "transform": { "scale": [0.001, 0.001, 0.001], "translate": [500000.0, 5300000.0, 20.0] },
        "CityObjects": objects,
        "vertices": BLOCK,
    })
}

fn solid(lod: Value) -> Value {
    json!({ "type": "Solid", "lod": lod, "boundaries": [block_faces()] })
}

const UTM: &str = "https://www.opengis.net/def/crs/EPSG/0/25832";

fn gathered_of(city: &Value, keys: &str) -> Result<Gathered, PrepareError> {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("a.city.json"), city.to_string()).unwrap();
    try_gather(folder.path(), "a.city.json", keys)
}

/// That the one object is the block, its lowest point at this height.
fn assert_block(gathered: &Gathered, low_m: f64) {
    assert_eq!(gathered.objects.len(), 1, "{:?}", gathered.set_aside);
    let placed = &gathered.objects[0];
    let (low, high) = detail(placed).height_range_m().unwrap();
    assert!((f64::from(low) - low_m).abs() < 0.01 && (f64::from(high - low) - 4.0).abs() < 1e-3, "{low} {high}");
    // On the central meridian a metre of the map is 1/0.9996 m.
    assert!((volume_m3(placed) - 240.0 / 0.9996 / 0.9996).abs() < 0.5, "{}", volume_m3(placed));
    assert_eq!(detail(placed).triangles(), 10);
    let of_kind =
        |kind| detail(placed).groups.iter().filter(|g| g.kind == kind).map(|g| g.triangles.len()).sum::<usize>();
    assert_eq!((of_kind(FaceKind::Wall), of_kind(FaceKind::Roof)), (8, 2));
    let [east_m, north_m] = placed.prism.footprint().sides_m;
    assert!((east_m - 10.0).abs() < 0.02 && (north_m - 6.0).abs() < 0.02, "{east_m} {north_m}");
}

#[test]
fn all_versions_and_kinds_give_the_same_block() {
    let building = |geometry: Value| json!({ "b": { "type": "Building", "geometry": [geometry] } });
    let kinds = [
        solid(json!("2")),
        json!({ "type": "MultiSurface", "lod": "2", "boundaries": block_faces() }),
        json!({ "type": "CompositeSurface", "lod": "2.2", "boundaries": block_faces() }),
        json!({ "type": "MultiSolid", "lod": "1", "boundaries": [[block_faces()]] }),
        json!({ "type": "CompositeSolid", "lod": "1", "boundaries": [[block_faces()]] }),
        // Cavities are not seen.
        json!({ "type": "Solid", "lod": "3", "boundaries": [block_faces(), [[[0, 1, 2, 3]], [[4, 6, 5]]]] }),
    ];
    for geometry in kinds {
        // Nothing says what the heights count from, so that the terrain carries the block.
        assert_block(&gathered_of(&city("2.0", UTM, building(geometry)), "").unwrap(), 100.0);
    }
    let old = city("1.0", "urn:ogc:def:crs:EPSG::25832", building(solid(json!(2))));
    assert_block(&gathered_of(&old, "").unwrap(), 100.0);
    assert_block(
        &gathered_of(&city("1.1", UTM, building(solid(json!("2")))), "vertical = \"ellipsoid\"").unwrap(),
        20.0,
    );
    assert_block(&gathered_of(&city("2.0", UTM, building(solid(json!("2")))), "base = 55").unwrap(), 55.0);
    let plain = json!({
        "type": "CityJSON", "version": "1.1", "metadata": { "referenceSystem": UTM },
        "CityObjects": building(solid(json!("2"))),
        "vertices": BLOCK.map(|[x, y, z]| [500000.0 + x as f64 / 1e3, 5300000.0 + y as f64 / 1e3, z as f64 / 1e3]),
    });
    assert_block(&gathered_of(&plain, "").unwrap(), 100.0);
}

#[test]
fn a_sequence_gives_a_building_a_line() {
    let folder = tempfile::tempdir().unwrap();
    let mut head = city("2.0", UTM, json!({}));
    head["vertices"] = json!([]);
    let feature = |name: &str| {
        let object = json!({ "type": "Building", "attributes": { "name": name }, "geometry": [solid(json!("1.2"))] });
        json!({ "type": "CityJSONFeature", "id": name, "CityObjects": { name: object }, "vertices": BLOCK })
    };
    let lines = [head, feature("one"), feature("two")].map(|line| line.to_string()).join("\n");
    std::fs::write(folder.path().join("a.city.jsonl"), lines).unwrap();
    let gathered = try_gather(folder.path(), "a.city.jsonl", "").unwrap();
    assert_eq!(gathered.objects.iter().map(id).collect::<Vec<_>>(), ["one", "two"]);
}

#[test]
fn templates_are_turned_and_set_down() {
    let mut file = city("2.0", UTM, json!({}));
    file["geometry-templates"] = json!({
        "templates": [{ "type": "MultiSurface", "lod": "2", "boundaries": block_faces() }],
        "vertices-templates": BLOCK.map(|corner| corner.map(|mm| mm as f64 / 1e3)),
    });
    // A quarter turn, so that the long side runs north, and twice as high.
    let matrix = json!([0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 2, 0, 0, 0, 0, 1]);
    let instance =
        json!({ "type": "GeometryInstance", "template": 0, "boundaries": [6], "transformationMatrix": matrix });
    file["CityObjects"] = json!({ "t": { "type": "CityFurniture", "geometry": [instance] } });
    let gathered = gathered_of(&file, "vertical = \"ellipsoid\"").unwrap();
    let placed = &gathered.objects[0];
    let [east_m, north_m] = placed.prism.footprint().sides_m;
    assert!((east_m - 6.0).abs() < 0.02 && (north_m - 10.0).abs() < 0.02, "{east_m} {north_m}");
    let (low_m, high_m) = detail(placed).height_range_m().unwrap();
    assert!((low_m - 24.0).abs() < 1e-2 && (high_m - 32.0).abs() < 1e-2, "{low_m} {high_m}");
}

#[test]
fn semantics_materials_and_levels_of_detail_count() {
    let mut rich = solid(json!("2.2"));
    rich["semantics"] = json!({
        "surfaces": [{ "type": "GroundSurface" }, { "type": "RoofSurface" }, { "type": "WallSurface" }, { "type": "Door" }],
        "values": [[0, 1, 2, 2, 3, null]],
    });
    rich["material"] = json!({ "day": { "values": [[null, 1, null, null, 0, null]] } });
    let plan = json!({ "type": "MultiSurface", "lod": "0", "boundaries": [[[0, 1, 2, 3]]] });
    let mut file =
        city("2.0", UTM, json!({ "b": { "type": "Building", "geometry": [plan, solid(json!("1")), rich] } }));
    file["appearance"] = json!({ "materials": [
        { "name": "wood", "diffuseColor": [0.4, 0.2, 0.0] }, { "name": "tiles", "diffuseColor": [1.0, 0.0, 0.0] },
    ] });
    let gathered = gathered_of(&file, "").unwrap();
    let groups: Vec<_> =
        detail(&gathered.objects[0]).groups.iter().map(|g| (g.kind, g.color, g.triangles.len())).collect();
    let expected =
        [(FaceKind::Wall, None, 6), (FaceKind::Roof, Some([255, 0, 0]), 2), (FaceKind::Other, Some([102, 51, 0]), 2)];
    assert_eq!(groups, expected);
    assert_block(&gathered_of(&file, "lod = 1").unwrap(), 100.0);
    let between = gathered_of(&file, "lod = \"1.3\"").unwrap();
    assert_eq!(between.repaired["level of detail asked for is absent: another taken"], 1);
    let flat = gathered_of(&file, "lod = 0\nheight = 9").unwrap();
    assert!(flat.objects[0].prism.detail.is_none() && flat.objects[0].prism.top_m == 109.0);
}

#[test]
fn a_parent_that_is_only_a_plan_is_shown_by_its_parts() {
    let plan = json!({ "type": "MultiSurface", "lod": "0", "boundaries": [[[0, 1, 2, 3]]] });
    let objects = json!({
        "whole": { "type": "Building", "attributes": { "street": "Markt" }, "children": ["part"], "geometry": [plan] },
        "part": { "type": "BuildingPart", "parents": ["whole"], "geometry": [solid(json!("2.2"))] },
        "empty": { "type": "Building" },
        "road": { "type": "Road", "geometry": [plan] },
    });
    let gathered = gathered_of(&city("2.0", UTM, objects), "").unwrap();
    assert_block(&gathered, 100.0);
    assert!(gathered.objects[0].attributes.contains("Markt"));
    assert_eq!(gathered.set_aside.values().sum::<u64>(), 2, "{:?}", gathered.set_aside);
}

#[test]
fn unsound_faces_are_mended_or_dropped_by_name() {
    let building = |faces: Value| {
        let geometry = json!({ "type": "MultiSurface", "lod": "2", "boundaries": faces });
        city("2.0", UTM, json!({ "b": { "type": "Building", "geometry": [geometry] } }))
    };
    let with = |more: Value| {
        let mut faces = block_faces();
        faces.as_array_mut().unwrap().push(more);
        gathered_of(&building(faces), "").unwrap()
    };
    let cases = [
        (json!([[0, 1, 0, 1]]), "surface without area dropped"),
        (json!([[0, 1, 99]]), "surface without points dropped"),
        (json!([[4, 5, 6, 7]]), "surface given twice dropped"),
    ];
    for (face, note) in cases {
        let gathered = with(face);
        assert_eq!(gathered.repaired.get(note), Some(&1), "{note}: {:?}", gathered.repaired);
        assert_block(&gathered, 100.0);
    }
    // Inside out, and with single faces turned: the same block.
    for which in [vec![0, 1, 2, 3, 4, 5], vec![2], vec![1, 4]] {
        let mut faces = block_faces();
        for at in which {
            faces[at][0].as_array_mut().unwrap().reverse();
        }
        let gathered = gathered_of(&building(faces), "").unwrap();
        assert_eq!(gathered.repaired["surfaces turned outwards"], 1);
        assert_block(&gathered, 100.0);
    }
    // A figure eight on a wall is two triangles of a quarter each.
    let mut faces = block_faces();
    faces[2] = json!([[0, 5, 1, 4]]);
    let eight = gathered_of(&building(faces), "").unwrap();
    assert_eq!(eight.repaired.get("crossing rings of a surface resolved"), Some(&1), "{:?}", eight.repaired);
    // Nothing sound at all, with and without a plan to fall back to.
    let bad = json!({ "type": "MultiSurface", "lod": "2", "boundaries": [[[0, 1, 0]]] });
    let plan = json!({ "type": "MultiSurface", "lod": "0", "boundaries": [[[0, 1, 2, 3]]] });
    let objects =
        json!({ "a": { "type": "Building", "geometry": [bad] }, "b": { "type": "Building", "geometry": [bad, plan] } });
    let gathered = gathered_of(&city("2.0", UTM, objects), "height = 7").unwrap();
    assert_eq!((gathered.features, gathered.set_aside["no sound surface"]), (1, 1));
    assert_eq!(gathered.repaired["surfaces unsound: drawn up from the footprint"], 1);
    assert!(gathered.objects[0].prism.detail.is_none());
}

#[test]
fn what_cannot_be_read_says_where_and_what_to_do() {
    let building = json!({ "b": { "type": "Building", "geometry": [solid(json!("2"))] } });
    let future = gathered_of(&city("3.0", UTM, building.clone()), "").unwrap_err().to_string();
    assert!(future.contains("a.city.json") && future.contains("3.0") && future.contains("cjio"), "{future}");
    let unknown = gathered_of(&city("2.0", "EPSG:999999", building.clone()), "").unwrap_err().to_string();
    assert!(unknown.contains("999999"), "{unknown}");
    let mut cut = city("2.0", UTM, building).to_string();
    cut.truncate(cut.len() - 20);
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("a.city.json"), cut).unwrap();
    let cut = try_gather(folder.path(), "a.city.json", "").unwrap_err().to_string();
    assert!(cut.contains("a.city.json") && cut.contains("EOF"), "{cut}");
    let layer = gathered_of(&city("2.0", UTM, json!({})), "layer = \"x\"").unwrap_err().to_string();
    assert!(layer.contains("layer"), "{layer}");
    let lod = gathered_of(&city("2.0", UTM, json!({})), "lod = \"fine\"").unwrap_err().to_string();
    assert!(lod.contains("lod"), "{lod}");
}
