//! Building sets from real files: what is in, how high, and where it lives.
#![cfg(feature = "prepare")]

use std::path::{Path, PathBuf};
use stoop::content::Prism;
use stoop::forest::CellId;
use stoop::geodesy::VerticalDatum;
use stoop::prepare::buildings::{Gathered, Ground, PreparedCollection, gather, prepare_collection};
use stoop::prepare::recipe::BuildingsSection;
use stoop::store::{FOOTPRINT_UNIT_MAX_M, OBJECT_HEIGHT_UNIT_M, decode_attributes, decode_prisms};

fn data() -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data");
    if folder.is_dir() {
        return Some(folder);
    }
    println!("skipped: ../shared/data is not here");
    None
}

fn section(file: &str, keys: &str) -> BuildingsSection {
    toml::from_str(&format!("name = \"city\"\nfile = \"{file}\"\n{keys}")).expect("a sound section")
}

const FLAT: Ground = Ground { height_m: &|_, _| 100.0, error_m: &|_, _| 0.5 };

fn gathered(root: &Path, file: &str, keys: &str) -> Gathered {
    gather(&section(file, keys), root, VerticalDatum::Ellipsoid, &FLAT, &|_| ()).expect("sound input")
}

fn prepared(root: &Path, file: &str, keys: &str) -> PreparedCollection {
    prepare_collection(&section(file, keys), root, VerticalDatum::Ellipsoid, &FLAT, 0, &|_| ()).expect("sound input")
}

/// Heights of the features, ascending.
fn heights(gathered: &Gathered) -> Vec<f64> {
    let mut by_id = std::collections::BTreeMap::new();
    for object in &gathered.objects {
        let prism = &object.prism;
        by_id.insert(prism.id, f64::from(prism.top_m) - f64::from(prism.base_m));
    }
    let mut heights: Vec<f64> = by_id.into_values().collect();
    heights.sort_by(f64::total_cmp);
    heights
}

fn median(sorted: &[f64]) -> f64 {
    sorted[sorted.len() / 2]
}

fn print_counts(name: &str, gathered: &Gathered) {
    println!("{name}: {} features, {} prisms", gathered.features, gathered.objects.len());
    println!("  set aside {:?}", gathered.set_aside);
    println!("  repaired {:?}", gathered.repaired);
}

#[test]
fn the_dives_cities_are_in_with_their_heights() {
    let Some(data) = data() else { return };
    for (file, count, middle) in [("city471.geojson", 471, 45.0), ("city20k.geojson", 20_000, 12.0)] {
        let city = gathered(&data.join("dive"), file, "height = \"height\"");
        print_counts(file, &city);
        assert_eq!(city.features, count);
        let heights = heights(&city);
        assert!((median(&heights) - middle).abs() < 1.0, "{}", median(&heights));
        assert!((heights[heights.len() - 1] - 312.0).abs() < 1.0);
    }
}

#[test]
fn san_franciscos_footprints_are_in() {
    let Some(data) = data() else { return };
    let city = gathered(&data.join("sf"), "sf_footprints.fgb.zip", "");
    print_counts("sf", &city);
    assert_eq!(city.features + city.set_aside.values().sum::<u64>(), 85_849);
    assert!(city.features >= 85_849 - 5);
    assert_eq!(city.repaired["height from the footprint's area"], city.features);
}

#[test]
fn bostons_storeys_become_heights() {
    let Some(data) = data() else { return };
    let city = gathered(&data.join("boston"), "boston_buildings.geojson", "height = \"storeys * 3.5\"");
    print_counts("boston", &city);
    assert_eq!(city.features + city.set_aside.values().sum::<u64>(), 22_099);
    let heights = heights(&city);
    assert!((heights[heights.len() - 1] - 62.0 * 3.5).abs() < 0.01);
    // The source has 0.3 storeys somewhere; none becomes a default of at least one.
    assert!((heights[0] - 0.3 * 3.5).abs() < 0.01, "{}", heights[0]);
}

#[test]
fn manhattans_parts_keep_their_buildings() {
    let Some(data) = data() else { return };
    let city = gathered(&data.join("manhattan"), "manhattan_buildings.geojson", "");
    print_counts("manhattan", &city);
    assert_eq!(city.features + city.set_aside.values().sum::<u64>(), 19_903);
    let heights = heights(&city);
    assert!((heights[0] - 0.30).abs() < 0.01 && (median(&heights) - 17.29).abs() < 0.02);
    assert!((heights[heights.len() - 1] - 377.6).abs() < 0.06, "{}", heights[heights.len() - 1]);
}

#[test]
fn monacos_buildings_are_counted() {
    let Some(data) = data() else { return };
    let city = gathered(&data.join("monaco"), "monaco-latest-without-changesets.osm.pbf", "");
    print_counts("monaco", &city);
    let osm = city.osm.expect("counts of the extract");
    println!("  {osm:?}");
    assert_eq!((osm.buildings, osm.with_height, osm.with_levels), (1_215, 42, 456));
}

#[test]
fn every_object_is_in_the_page_of_its_cell_and_fits_it() {
    let Some(data) = data() else { return };
    let sets = [
        ("dive", "city20k.geojson", "height = \"height\"\nbase = \"base\""),
        ("manhattan", "manhattan_buildings.geojson", ""),
        ("monaco", "monaco-latest-without-changesets.osm.pbf", ""),
    ];
    for (folder, file, keys) in sets {
        let city = prepared(&data.join(folder), file, keys);
        let info = &city.info;
        println!(
            "{file}: {} objects, {} pages, {} bytes, level {} (VGIS {}), {} large",
            info.objects, info.pages, info.bytes, info.changeover_level, info.vgis_level, info.large_objects
        );
        for point in &info.cost_curve {
            println!("  {point:?}");
        }
        let finest = || city.pages.iter().filter(|page| page.rep == 0);
        let roots: std::collections::HashSet<CellId> = finest().map(|page| page.root).collect();
        assert_eq!(roots.len(), finest().count());
        let mut ids = std::collections::HashSet::new();
        for page in finest() {
            let decoded = decode_prisms(&page.bytes).unwrap();
            assert_eq!(decode_attributes(&page.bytes).unwrap().len(), decoded.prisms.len());
            assert_eq!(decoded.prisms.len() as u64, page.objects);
            for prism in &decoded.prisms {
                ids.insert(prism.id);
                let nearest = prism.cell.ancestors().find(|cell| roots.contains(cell));
                assert_eq!(nearest, Some(page.root));
                check_home(prism, info.changeover_level);
            }
            assert!(page.bytes.len() <= 128 << 10, "{}", page.bytes.len());
        }
        assert_eq!(ids.len() as u64, info.objects);
    }
}

/// Its centre lies in its cell, up to what is quantized, and its reach is below the cell's L_q.
fn check_home(prism: &Prism, changeover_level: u8) {
    let (footprint, bounds) = (prism.footprint(), prism.cell.bounds());
    let (u, v) = bounds.fractions(footprint.lat_rad, footprint.lon_rad);
    let slack = 2.0 * FOOTPRINT_UNIT_MAX_M / prism.cell.l_q_m();
    assert!((-slack..=1.0 + slack).contains(&u) && (-slack..=1.0 + slack).contains(&v), "{u} {v}");
    assert!(prism.reach_m() < prism.cell.l_q_m() + 4.0 * FOOTPRINT_UNIT_MAX_M);
    assert!(prism.cell.level() <= changeover_level);
    if prism.cell.level() < changeover_level {
        let below = CellId::containing(footprint.lat_rad, footprint.lon_rad, prism.cell.level() + 1);
        assert!(prism.reach_m() > below.l_q_m() - 4.0 * FOOTPRINT_UNIT_MAX_M);
    }
}

#[test]
fn what_is_stored_is_what_was_read() {
    let Some(data) = data() else { return };
    let (root, file, keys) = (data.join("dive"), "city471.geojson", "height = \"height\"\nbase = \"base\"");
    let source = gathered(&root, file, keys);
    let city = prepared(&root, file, keys);
    let mut stored = vec![None; source.objects.len()];
    for page in &city.pages {
        let prisms = decode_prisms(&page.bytes).unwrap().prisms;
        for (prism, text) in prisms.into_iter().zip(decode_attributes(&page.bytes).unwrap()) {
            let at = prism.id as usize;
            stored[at] = Some((prism, text));
        }
    }
    for object in &source.objects {
        let (prism, text) = stored[object.prism.id as usize].as_ref().expect("every object is stored");
        assert_eq!(*text, object.attributes);
        assert!((prism.top_m - object.prism.top_m).abs() <= OBJECT_HEIGHT_UNIT_M as f32);
        assert!((prism.base_m - object.prism.base_m).abs() <= OBJECT_HEIGHT_UNIT_M as f32);
        assert_eq!(prism.roof, object.prism.roof);
        for (a, b) in prism.rings.concat().iter().zip(object.prism.rings.concat()) {
            let north_m = (a[1] - b[1]) * 6.4e6;
            let east_m = (a[0] - b[0]) * 6.4e6 * a[1].cos();
            assert!(north_m.hypot(east_m) <= 1.5 * FOOTPRINT_UNIT_MAX_M, "{north_m} {east_m}");
        }
    }
}

#[test]
fn a_wrong_type_in_a_file_is_one_clear_error() {
    let folder = tempfile::tempdir().unwrap();
    let feature = |geometry: &str, properties: &str| {
        format!(
            r#"{{"type":"FeatureCollection","features":[{{"type":"Feature","properties":{properties},"geometry":{geometry}}}]}}"#
        )
    };
    let square = r#"{"type":"Polygon","coordinates":[[[0,0],[1e-4,0],[1e-4,1e-4],[0,0]]]}"#;
    let gather_from = |file: &str, keys: &str| {
        gather(&section(file, keys), folder.path(), VerticalDatum::Ellipsoid, &FLAT, &|_| ()).unwrap_err().to_string()
    };
    let cases = [
        (feature(r#"{"type":"Point","coordinates":[0,0]}"#, "{}"), "Point"),
        (feature(r#"{"type":"Polygon","coordinates":[[["a",0]]]}"#, "{}"), "feature 1"),
        (feature(square, r#"{"height":[1]}"#), "height"),
        ("{\"type\":\"FeatureCollection\",\"features\":[".to_owned(), "GeoJSON"),
        ("P5 a picture".to_owned(), "GeoJSON"),
    ];
    for (text, names) in cases {
        std::fs::write(folder.path().join("a.geojson"), text).unwrap();
        let error = gather_from("a.geojson", "");
        println!("{error}");
        assert!(error.contains("a.geojson") && error.contains(names), "{error}");
    }
    assert!(gather_from("a.geojson", "crs = \"EPSG:99999999\"").contains("EPSG:99999999"));
    std::fs::write(folder.path().join("b.shp"), "x").unwrap();
    std::fs::write(folder.path().join("c.fgb"), "x").unwrap();
    std::fs::write(folder.path().join("d.osm.pbf"), "x").unwrap();
    std::fs::write(folder.path().join("e.zip"), "x").unwrap();
    for file in ["absent.geojson", "b.shp", "c.fgb", "d.osm.pbf", "e.zip"] {
        let error = gather_from(file, "");
        println!("{error}");
        assert!(error.contains(file), "{error}");
    }
}

#[test]
fn swellendams_buildings_come_from_one_table_of_a_geopackage() {
    let Some(data) = data() else { return };
    let folder = data.join("swellendam");
    let refused = gather(&section("training_data.gpkg", ""), &folder, VerticalDatum::Ellipsoid, &FLAT, &|_| ());
    let told = refused.err().unwrap().to_string();
    assert!(told.contains("buildings, restaurants, schools"), "{told}");
    let town = gathered(&folder, "training_data.gpkg", "layer = \"buildings\"\nlevels = \"building:levels\"");
    print_counts("Swellendam", &town);
    let set_aside: u64 = town.set_aside.values().sum();
    assert_eq!(town.features + set_aside, 4_708);
    assert!(set_aside < 30, "{:?}", town.set_aside);
}
