//! The same footprints from GeoJSON, a shapefile and a GeoPackage are the same collection, whatever the system and the
//! encoding they are kept in.
#![cfg(feature = "prepare")]
#![allow(clippy::unwrap_used, reason = "a test that cannot go on should stop")]

use rusqlite::{Connection, params};
use shapefile::dbase::{FieldName, FieldValue, Record, TableWriterBuilder, encoding::EncodingRs, encoding_rs};
use shapefile::{Point, Polygon, PolygonRing};
use std::f64::consts::FRAC_PI_4;
use std::io::Write;
use std::path::Path;
use std::process::Command;
use stoop::geodesy::VerticalDatum;
use stoop::prepare::PrepareError;
use stoop::prepare::buildings::{Gathered, Ground, Placed, gather};

const FLAT: Ground = Ground { height_m: &|_, _| 100.0, error_m: &|_, _| 0.5 };
const SPHERE_M: f64 = 6_378_137.0;
/// Footprints are kept to a centimetre or so; the ways there may round otherwise.
const NEAR_M: f32 = 0.05;

struct Building {
    ring: Vec<[f64; 2]>,
    height_m: f64,
    name: String,
}

fn buildings() -> Vec<Building> {
    let square = |n: u32, side_deg: f64| {
        let (west, south) = (8.5 + 0.001 * f64::from(n % 20), 47.3 + 0.001 * f64::from(n / 20));
        let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.0, 0.0]];
        corners.map(|[x, y]| [west + side_deg * x, south + side_deg * y]).to_vec()
    };
    (0..100)
        .map(|n| Building {
            ring: square(n, 1e-4 + 1e-6 * f64::from(n)),
            height_m: 5.0 + f64::from(n) / 4.0,
            name: format!("Zürich {n}"),
        })
        .collect()
}

fn mercator([lon_deg, lat_deg]: [f64; 2]) -> [f64; 2] {
    let north = (FRAC_PI_4 + lat_deg.to_radians() / 2.0).tan().ln();
    [SPHERE_M * lon_deg.to_radians(), SPHERE_M * north]
}

fn write_geojson(file: &Path, buildings: &[Building]) {
    let features = buildings.iter().map(|building| {
        serde_json::json!({
            "type": "Feature",
            "properties": { "height": building.height_m, "name": building.name },
            "geometry": { "type": "Polygon", "coordinates": [building.ring] },
        })
    });
    let all = serde_json::json!({ "type": "FeatureCollection", "features": features.collect::<Vec<_>>() });
    std::fs::write(file, all.to_string()).unwrap();
}

/// In Web Mercator, with names in Windows-1252.
fn write_shapefile(file: &Path, buildings: &[Building]) {
    let named = |name: &str| FieldName::try_from(name).unwrap();
    let table = TableWriterBuilder::with_encoding(EncodingRs::from(encoding_rs::WINDOWS_1252))
        .add_numeric_field(named("height"), 10, 3)
        .add_character_field(named("name"), 40);
    let mut writer = shapefile::Writer::from_path(file, table).unwrap();
    for building in buildings {
        let corners = building.ring.iter().map(|&corner| {
            let [x, y] = mercator(corner);
            Point::new(x, y)
        });
        let mut record = Record::default();
        record.insert("height".into(), FieldValue::Numeric(Some(building.height_m)));
        record.insert("name".into(), FieldValue::Character(Some(building.name.clone())));
        writer.write_shape_and_record(&Polygon::new(PolygonRing::Outer(corners.collect())), &record).unwrap();
    }
    drop(writer);
    std::fs::write(file.with_extension("CPG"), "1252").unwrap();
    let system = proj::Proj::new("EPSG:3857").unwrap();
    std::fs::write(file.with_extension("prj"), system.to_projjson(None, None, None).unwrap()).unwrap();
}

/// The head and the well-known binary of a polygon (GeoPackage 1.4, §2.1.3).
fn geopackage_blob(ring: impl ExactSizeIterator<Item = [f64; 2]>) -> Vec<u8> {
    let mut blob = b"GP\0\x01".to_vec();
    blob.extend(3857i32.to_le_bytes());
    blob.push(1);
    blob.extend([3u32.to_le_bytes(), 1u32.to_le_bytes(), (ring.len() as u32).to_le_bytes()].concat());
    ring.for_each(|[x, y]| blob.extend([x.to_le_bytes(), y.to_le_bytes()].concat()));
    blob
}

/// A table of buildings with a row without a geometry, another one, and one of points that are none of our business.
fn write_geopackage(file: &Path, buildings: &[Building]) {
    let database = Connection::open(file).unwrap();
    database
        .execute_batch(
            "CREATE TABLE gpkg_spatial_ref_sys (srs_name TEXT, srs_id INTEGER, organization TEXT,
                 organization_coordsys_id INTEGER, definition TEXT);
             INSERT INTO gpkg_spatial_ref_sys VALUES ('Web Mercator', 3857, 'epsg', 3857, 'undefined');
             CREATE TABLE gpkg_geometry_columns (table_name TEXT, column_name TEXT, geometry_type_name TEXT,
                 srs_id INTEGER, z INTEGER, m INTEGER);
             INSERT INTO gpkg_geometry_columns VALUES ('b \"east\"', 'geom', 'MULTIPOLYGON', 3857, 0, 0),
                 ('a', 'shape', 'Polygon', 3857, 0, 0), ('trees', 'geom', 'POINT', 3857, 0, 0);
             CREATE TABLE a (fid INTEGER PRIMARY KEY, shape BLOB, height REAL, name TEXT);
             CREATE TABLE \"b \"\"east\"\"\" (fid INTEGER PRIMARY KEY, height REAL, geom BLOB, name TEXT);
             CREATE TABLE trees (fid INTEGER PRIMARY KEY, geom BLOB);
             INSERT INTO trees VALUES (1, x'00');
             INSERT INTO a (fid, name) VALUES (1000, 'without a shape');",
        )
        .unwrap();
    let transaction = database.unchecked_transaction().unwrap();
    for (at, building) in buildings.iter().enumerate() {
        let blob = geopackage_blob(building.ring.iter().map(|&corner| mercator(corner)));
        let tables = ["a (shape", "\"b \"\"east\"\"\" (geom"];
        for table in &tables[..1 + usize::from(at < 3)] {
            let sql = format!("INSERT INTO {table}, height, name) VALUES (?1, ?2, ?3)");
            database.execute(&sql, params![blob, building.height_m, building.name]).unwrap();
        }
    }
    transaction.commit().unwrap();
}

fn try_gather(root: &Path, file: &str, keys: &str) -> Result<Gathered, PrepareError> {
    let section = toml::from_str(&format!("name = \"city\"\nfile = \"{file}\"\n{keys}")).unwrap();
    gather(&section, root, VerticalDatum::Ellipsoid, &FLAT, &|_| ())
}

fn gathered(root: &Path, file: &str, keys: &str) -> Gathered {
    try_gather(root, file, keys).unwrap()
}

fn name(placed: &Placed) -> String {
    let attributes: serde_json::Value = serde_json::from_str(&placed.attributes).unwrap();
    attributes["name"].as_str().unwrap().to_owned()
}

fn assert_alike(one: &Gathered, other: &Gathered, what: &str) {
    assert_eq!((one.features, one.objects.len()), (other.features, other.objects.len()), "{what}");
    for (one, other) in one.objects.iter().zip(&other.objects) {
        assert!((one.prism.top_m - other.prism.top_m).abs() < NEAR_M, "{what}");
        assert!((one.prism.base_m - other.prism.base_m).abs() < NEAR_M, "{what}");
        assert_eq!(name(one), name(other), "{what}");
        assert!((one.reach_m - other.reach_m).abs() < NEAR_M.into(), "{what}");
    }
}

#[test]
fn all_formats_give_the_same_buildings() {
    let folder = tempfile::tempdir().unwrap();
    let buildings = buildings();
    write_geojson(&folder.path().join("a.geojson"), &buildings);
    write_shapefile(&folder.path().join("b.shp"), &buildings);
    write_geopackage(&folder.path().join("c.gpkg"), &buildings);
    let expected = gathered(folder.path(), "a.geojson", "");
    assert_eq!(expected.features, 100);
    assert_alike(&gathered(folder.path(), "b.shp", ""), &expected, "shapefile");
    let geopackage = gathered(folder.path(), "c.gpkg", "layer = \"a\"");
    assert_alike(&geopackage, &expected, "GeoPackage");
    assert_eq!(gathered(folder.path(), "c.gpkg", "layer = 'b \"east\"'").features, 3);
    assert!(geopackage.set_aside.iter().any(|(why, count)| why == "row without a geometry" && *count == 1));
    // A .zip that holds the parts of the shapefile, as they are offered for download.
    let mut zip = zip::ZipWriter::new(std::fs::File::create(folder.path().join("d.zip")).unwrap());
    for part in ["b.shp", "b.shx", "b.dbf", "b.prj", "b.CPG"] {
        zip.start_file(format!("data/{part}"), zip::write::SimpleFileOptions::default()).unwrap();
        zip.write_all(&std::fs::read(folder.path().join(part)).unwrap()).unwrap();
    }
    zip.finish().unwrap();
    assert_alike(&gathered(folder.path(), "d.zip", ""), &expected, "zipped shapefile");
}

/// Prepares a world of one file of buildings; gives the hash of what it was made of.
fn prepare(folder: &Path, file: &str) -> String {
    let (recipe, out) = (folder.join("recipe.toml"), folder.join("world"));
    std::fs::write(&recipe, format!("name = \"city\"\n[[buildings]]\nname = \"houses\"\nfile = \"{file}\"\n")).unwrap();
    let ran = Command::new(env!("CARGO_BIN_EXE_stoop-prepare")).arg(&recipe).arg("--out").arg(&out).output().unwrap();
    assert!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stderr));
    let manifest: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(out.join("world.json")).unwrap()).unwrap();
    std::fs::remove_dir_all(out).unwrap();
    manifest["recipe_hash"].to_string()
}

#[test]
fn a_folder_of_shapefiles_becomes_a_world_and_all_its_parts_count() {
    let folder = tempfile::tempdir().unwrap();
    let shapes = folder.path().join("shapes");
    std::fs::create_dir(&shapes).unwrap();
    write_shapefile(&shapes.join("b.shp"), &buildings());
    let first = prepare(folder.path(), "shapes");
    assert_eq!(first, prepare(folder.path(), "shapes"));
    let mut higher = buildings();
    higher[7].height_m += 1.0;
    write_shapefile(&shapes.join("b.shp"), &higher);
    assert_ne!(first, prepare(folder.path(), "shapes"), "only the .dbf differs");
}

/// 20,000 buildings of the test city, written by other libraries' writers.
#[test]
fn a_city_is_the_same_from_a_shapefile_and_a_geopackage() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data/dive/city20k.geojson");
    if !file.is_file() {
        println!("skipped: {} is not here", file.display());
        return;
    }
    let collection: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(&file).unwrap()).unwrap();
    let building = |feature: &serde_json::Value| Building {
        ring: serde_json::from_value(feature["geometry"]["coordinates"][0].clone()).unwrap(),
        height_m: feature["properties"]["height"].as_f64().unwrap(),
        name: String::new(),
    };
    let buildings: Vec<Building> = collection["features"].as_array().unwrap().iter().map(building).collect();
    let folder = tempfile::tempdir().unwrap();
    write_shapefile(&folder.path().join("b.shp"), &buildings);
    write_geopackage(&folder.path().join("c.gpkg"), &buildings);
    let heights = |gathered: &Gathered| {
        let mut heights: Vec<f32> = gathered.objects.iter().map(|o| o.prism.top_m - o.prism.base_m).collect();
        heights.sort_by(f32::total_cmp);
        heights
    };
    let (one, other) = (gathered(folder.path(), "b.shp", ""), gathered(folder.path(), "c.gpkg", "layer = \"a\""));
    assert_eq!((one.features, other.features), (20_000, 20_000));
    assert_eq!(heights(&one), heights(&other));
    assert_eq!(heights(&one).len(), 20_000);
    assert!((heights(&one)[10_000] - 12.0).abs() < 1.0);
}

#[test]
fn a_geopackage_is_read_without_a_trace() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("50 % of #1?.gpkg");
    write_geopackage(&file, &buildings());
    let database = Connection::open(&file).unwrap();
    database.pragma_update(None, "journal_mode", "wal").unwrap();
    drop(database);
    let names = || {
        let entries = std::fs::read_dir(folder.path()).unwrap();
        let mut names: Vec<_> = entries.map(|entry| entry.unwrap().file_name()).collect();
        names.sort();
        names
    };
    let read = || gathered(folder.path(), "50 % of #1?.gpkg", "layer = \"a\"").features;
    let (before, bytes) = (names(), std::fs::read(&file).unwrap());
    assert_eq!((read(), names(), std::fs::read(&file).unwrap()), (100, before, bytes));
    // Another program has it open, and has not yet moved its newest rows into the file.
    let editor = Connection::open(&file).unwrap();
    editor.execute("DELETE FROM a WHERE fid BETWEEN 1001 AND 1010", []).unwrap();
    assert_eq!(read(), 90);
}

#[test]
fn broken_files_are_told_by_name() {
    let folder = tempfile::tempdir().unwrap();
    write_shapefile(&folder.path().join("b.shp"), &buildings());
    write_geopackage(&folder.path().join("c.gpkg"), &buildings());
    let error_with = |file: &str, keys: &str| try_gather(folder.path(), file, keys).err().unwrap().to_string();
    let error = |file: &str| error_with(file, "layer = \"a\"");
    assert!(error_with("c.gpkg", "").contains("several layers") && error_with("c.gpkg", "").contains("a, b \"east\""));
    assert!(error_with("c.gpkg", "layer = \"trees\"").contains("no layer trees"));
    assert!(error("b.shp").contains("leave `layer` out"));
    let error = |file: &str| error_with(file, if file == "b.shp" { "" } else { "layer = \"a\"" });
    for (file, kept) in [("b.shp", 0.4), ("b.dbf", 0.4), ("c.gpkg", 0.3)] {
        let path = folder.path().join(file);
        let whole = std::fs::read(&path).unwrap();
        std::fs::write(&path, &whole[..(whole.len() as f64 * kept) as usize]).unwrap();
        let told = error(if file == "b.dbf" { "b.shp" } else { file });
        println!("{told}");
        assert!(told.contains("b.shp") || told.contains("b.dbf") || told.contains("c.gpkg"), "{told}");
        std::fs::write(&path, whole).unwrap();
    }
    std::fs::remove_file(folder.path().join("b.dbf")).unwrap();
    assert!(error("b.shp").contains(".dbf"));
    std::fs::write(folder.path().join("e.gpkg"), "no database").unwrap();
    assert!(error("e.gpkg").contains("GeoPackage"));
}
