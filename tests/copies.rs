//! A collection set down again and again: where its copies stand, how they are turned, and what is counted.
#![cfg(feature = "prepare")]
#![allow(clippy::unwrap_used, reason = "a test that cannot go on should stop")]

mod towns;

use glam::DVec2;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;
use stoop::content::Prism;
use stoop::forest::CellId;
use stoop::geodesy::{Geodetic, VerticalDatum};
use stoop::prepare::PrepareError;
use stoop::prepare::buildings::{Ground, PreparedCollection, prepare_collection};
use stoop::prepare::recipe::BuildingsSection;
use stoop::store::{World, decode_attributes, decode_prisms};
use towns::{make, sources};

const HOUSES: usize = 60;
/// Of the source: longitude and latitude of its middle, degrees.
const MIDDLE_DEG: [f64; 2] = [-71.06, 42.36];
/// Over the antimeridian, turned by a quarter, and at home.
const PLACES: [(f64, f64, f64); 3] = [(180.0, -17.0, 0.0), (24.94, 60.17, 90.0), (-71.06, 42.36, 0.0)];

/// Hills, metres above the ellipsoid.
fn hills_m(lat_rad: f64, lon_rad: f64) -> f64 {
    assert!(lon_rad.abs() <= std::f64::consts::PI, "terrain is asked for within ±π");
    200.0 + 50.0 * (lat_rad * 9e3).sin() + 30.0 * (lon_rad * 7e3).cos()
}

const HILLS: Ground = Ground { height_m: &hills_m, error_m: &|_, _| 0.25 };

/// A line that is no house, and L-shaped houses in rows about the middle, each of its own size, which a base 1 km up must not carry away.
fn write_town(path: &Path) {
    let house = |at: usize| {
        let (column, row) = (at % 10, at / 10);
        let west = MIDDLE_DEG[0] + (column as f64 - 4.7) * 8e-4;
        let south = MIDDLE_DEG[1] + (row as f64 - 2.7) * 6e-4;
        let (long, short) = (3e-4 + at as f64 * 2e-6, 1.5e-4);
        let ring = [[0.0, 0.0], [long, 0.0], [long, short], [short, short], [short, long], [0.0, long], [0.0, 0.0]];
        let ring = ring.map(|[x, y]| [west + x, south + y]);
        serde_json::json!({
            "type": "Feature", "properties": { "height": 5 + at, "base": 1000, "number": at },
            "geometry": { "type": "Polygon", "coordinates": [ring] },
        })
    };
    let line = [[-71.06, 42.36], [-71.061, 42.36], [-71.06, 42.36]];
    let line = serde_json::json!({
        "type": "Feature", "properties": {}, "geometry": { "type": "Polygon", "coordinates": [line] },
    });
    let features: Vec<_> = (0..HOUSES).map(house).chain([line]).collect();
    fs::write(path, serde_json::json!({ "type": "FeatureCollection", "features": features }).to_string()).unwrap();
}

fn table(places: &[(f64, f64, f64)]) -> String {
    let rows = places.iter().map(|(lon, lat, heading)| format!("{lon}, {lat}, {heading}\n"));
    "lon_deg, lat_deg, heading_deg\n".to_owned() + &rows.collect::<String>()
}

fn try_prepared(table: Option<&str>, ground: &Ground) -> Result<PreparedCollection, PrepareError> {
    let folder = tempfile::tempdir().unwrap();
    write_town(&folder.path().join("town.geojson"));
    let mut keys = "name = \"town\"\nfile = \"town.geojson\"\n".to_owned();
    match table {
        Some(table) => {
            fs::write(folder.path().join("places.csv"), table).unwrap();
            keys += "base = \"base\"\ncopies = \"places.csv\"\n";
        }
        None => keys += "attributes = [\"number\"]\n",
    }
    let section: BuildingsSection = toml::from_str(&keys).unwrap();
    prepare_collection(&section, folder.path(), VerticalDatum::Ellipsoid, ground, 0, &|_| ())
}

fn prepared(places: &[(f64, f64, f64)]) -> PreparedCollection {
    try_prepared(Some(&table(places)), &HILLS).unwrap()
}

/// Of the finest rep: the root of its page, the object and its attributes, by its number in the collection.
fn objects(prepared: &PreparedCollection) -> BTreeMap<u32, (CellId, Prism, String)> {
    let mut found = BTreeMap::new();
    for page in prepared.pages.iter().filter(|page| page.rep == 0) {
        let prisms = decode_prisms(&page.bytes).unwrap().prisms;
        for (prism, text) in prisms.into_iter().zip(decode_attributes(&page.bytes).unwrap()) {
            assert!(found.insert(prism.id, (page.root, prism, text)).is_none(), "an object twice");
        }
    }
    found
}

/// Corners east and north of a place, metres.
fn around(prism: &Prism, [lon_deg, lat_deg]: [f64; 2]) -> Vec<DVec2> {
    let enu_from_ecef = Geodetic::from_degrees(lat_deg, lon_deg, 0.0).ecef_from_enu().inverse();
    let corners = prism.rings.iter().flatten();
    corners
        .map(|&[lon_rad, lat_rad]| (enu_from_ecef * Geodetic { lat_rad, lon_rad, height_m: 0.0 }.to_ecef()).xyz())
        .map(|point| point.truncate())
        .collect()
}

fn assert_same_ring(one: &[DVec2], other: &[DVec2], what: &str) {
    assert_eq!(one.len(), other.len(), "{what}");
    let far = |p: &DVec2, ring: &[DVec2]| ring.iter().map(|q| p.distance(*q)).fold(f64::INFINITY, f64::min);
    let worst_m = one.iter().map(|p| far(p, other)).fold(0.0, f64::max);
    assert!(worst_m < 0.05, "{what}: {worst_m} m off");
}

#[test]
fn copies_lie_turned_about_their_places_with_all_lengths_kept() {
    let original = objects(&try_prepared(None, &HILLS).unwrap());
    let copies = objects(&prepared(&PLACES));
    assert_eq!((original.len(), copies.len()), (HOUSES, 3 * HOUSES));
    let all = original.values().flat_map(|(_, prism, _)| prism.rings.iter().flatten());
    let (low, high) = all.fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(low, high), &[lon, lat]| {
        (low.min(DVec2::new(lon, lat)), high.max(DVec2::new(lon, lat)))
    });
    let middle = ((low + high) / 2.0).to_array().map(f64::to_degrees);
    for (&id, (_, prism, text)) in &copies {
        let (lon, lat, heading_deg) = PLACES[id as usize / HOUSES];
        let (_, from, of_original) = &original[&(id % HOUSES as u32)];
        // Clockwise from above.
        let turn = DVec2::from_angle(-heading_deg.to_radians());
        let expected: Vec<DVec2> = around(from, middle).into_iter().map(|p| turn.rotate(p)).collect();
        assert_same_ring(&around(prism, [lon, lat]), &expected, &format!("object {id}"));
        let number = |text: &str| serde_json::from_str::<serde_json::Value>(text).unwrap()["number"].clone();
        assert_eq!(number(text), number(of_original));
    }
}

#[test]
fn copies_stand_on_the_terrain_where_they_are_whatever_their_base() {
    for (id, (_, prism, _)) in objects(&prepared(&PLACES)) {
        let [lon, lat] = [0, 1].map(|axis| {
            let values = || prism.rings[0].iter().map(|corner| corner[axis]);
            (values().fold(f64::INFINITY, f64::min) + values().fold(f64::NEG_INFINITY, f64::max)) / 2.0
        });
        let ground_m = hills_m(lat, wrapped(lon));
        let height_m = 5.0 + f64::from(id % HOUSES as u32);
        // The hills rise by at most 7 cm a metre; the place is kept to a few centimetres.
        assert!((f64::from(prism.base_m) - ground_m).abs() < 0.02, "{id}: {} on {ground_m}", prism.base_m);
        assert!((f64::from(prism.top_m - prism.base_m) - height_m).abs() < 0.03, "{id}");
        let foot_m = f64::from(prism.base_m - prism.foundation_m);
        for &[lon, lat] in &prism.rings[0] {
            assert!(foot_m <= hills_m(lat, wrapped(lon)) + 0.02, "{id}: a corner floats");
        }
    }
}

fn wrapped(lon_rad: f64) -> f64 {
    use std::f64::consts::PI;
    (lon_rad + PI).rem_euclid(2.0 * PI) - PI
}

#[test]
fn copies_look_like_the_collection_itself() {
    let plain = objects(&try_prepared(None, &HILLS).unwrap());
    for (id, (_, copy, _)) in objects(&prepared(&PLACES)) {
        let (_, prism, _) = &plain[&(id % HOUSES as u32)];
        assert_eq!((copy.wall_color, copy.roof_color), (prism.wall_color, prism.roof_color));
        assert_eq!(copy.roof, prism.roof);
    }
}

#[test]
fn each_copy_has_page_trees_of_its_own_and_is_whole_over_the_antimeridian() {
    // Two copies overlap.
    let places = [PLACES[0], PLACES[1], PLACES[2], (-71.0585, 42.36, 30.0)];
    let prepared = prepared(&places);
    let keys: Vec<(CellId, u8)> = prepared.pages.iter().map(|page| (page.root, u8::MAX - page.rep)).collect();
    assert!(keys.windows(2).all(|pair| pair[0] < pair[1]), "in order, none twice");
    let mut copies_of: BTreeMap<CellId, BTreeSet<usize>> = BTreeMap::new();
    let mut sides = BTreeSet::new();
    for (id, (root, prism, _)) in objects(&prepared) {
        assert!(root.contains(prism.cell));
        let footprint = prism.footprint();
        let home = CellId::containing(footprint.lat_rad, wrapped(footprint.lon_rad), prism.cell.level());
        assert_eq!(home, prism.cell, "{id}");
        copies_of.entry(root).or_default().insert(id as usize / HOUSES);
        if (id as usize) < HOUSES {
            sides.insert(root.zone().index() % 8);
            let width_rad = prism.rings[0].iter().map(|c| c[0]).fold(f64::NEG_INFINITY, f64::max)
                - prism.rings[0].iter().map(|c| c[0]).fold(f64::INFINITY, f64::min);
            assert!(width_rad < 1e-3, "{id} goes round the Earth");
        }
    }
    assert_eq!(sides, BTreeSet::from([0, 7]), "on both sides of the antimeridian");
    for (root, copies) in &copies_of {
        assert!(copies.len() == 1 || *copies == BTreeSet::from([2, 3]), "{root}: {copies:?}");
        for (other, of_other) in &copies_of {
            assert!(!root.contains(*other) || !copies.is_disjoint(of_other), "{root} holds {other}");
        }
    }
}

#[test]
fn all_copies_are_counted() {
    let prepared = prepared(&PLACES);
    let info = &prepared.info;
    assert_eq!((info.objects, prepared.source.count), (3 * HOUSES as u64, 3 * HOUSES as u64));
    assert_eq!(info.reps[0].objects, 3 * HOUSES as u64);
    assert_eq!(info.pages as usize, prepared.pages.len());
    assert_eq!(info.bytes, prepared.pages.iter().map(|page| page.bytes.len() as u64).sum::<u64>());
    assert_eq!(info.set_aside.values().copied().collect::<Vec<_>>(), [3], "{:?}", info.set_aside);
}

#[test]
fn wrong_tables_name_the_file_and_the_line() {
    let cases = [
        ("lon_deg, heading_deg\n1, 2\n", "lat_deg"),
        ("lon_deg, lat_deg\n1, 2\n3, north\n", "line 3"),
        ("lon_deg, lat_deg\n1, 2\n3, 97\n", "place 2"),
        ("lon_deg, lat_deg\nNaN, 2\n", "place 1"),
        ("lon_deg, lat_deg\n", "no place"),
    ];
    for (table, expected) in cases {
        let error = try_prepared(Some(table), &HILLS).unwrap_err().to_string();
        assert!(error.contains(expected) && error.contains("places.csv"), "{error}");
    }
}

#[test]
fn a_world_of_copies_is_whole() {
    let folder = sources();
    fs::write(folder.path().join("places.csv"), table(&[(-84.4, 33.7, 45.0), (24.95, 60.2, 0.0), (180.0, 0.0, 9.0)]))
        .unwrap();
    let set = "[[buildings]]\nname = \"low\"\nfile = \"low.geojson\"\nheight = \"height\"\ncopies = \"places.csv\"\n";
    let world = folder.path().join("world");
    let manifest = make(folder.path(), &world, set);
    assert_eq!(manifest.collections[0].objects, 600);
    let opened = World::open(&world).unwrap();
    let zones = opened.index().trees().filter(|tree| tree.root().dimension_m() > 0.0).count();
    assert!(zones >= 4, "{zones} zones with objects");
    let verified = opened.verify(&mut |_, _| ());
    assert!(verified.problems.is_empty(), "{:?}", verified.problems);
}
