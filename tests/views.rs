//! Bookmarks of worlds of any kind: the globe first, and nothing that a viewer could not show.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on should stop")]

use std::collections::BTreeMap;
use std::path::Path;
use stoop::camera::{Pose, View};
use stoop::forest::index::{IndexForest, IndexTree, NodeInfo, ObjectsEntry, Place, TerrainEntry};
use stoop::forest::{CellId, Zone};
use stoop::geodesy::Geodetic;
use stoop::store::{CollectionInfo, HOME_HEIGHT_M, Manifest, NamedView, StoreError, World, bookmarks};

const HEIGHT_RANGE_M: (f64, f64) = (100.0, 300.0);

fn named(name: &str, lat_deg: f64, lon_deg: f64) -> NamedView {
    let name = name.to_owned();
    NamedView { name, lon_deg, lat_deg, height_m: 500.0, heading_deg: 20.0, pitch_deg: -10.0 }
}

/// `bounds_deg`: west, south, east, north.
fn collection(name: &str, objects: u64, bounds_deg: [f64; 4]) -> CollectionInfo {
    CollectionInfo {
        name: name.into(),
        objects,
        pages: 1,
        bytes: 0,
        changeover_level: 14,
        vgis_level: 14,
        cost_curve: vec![],
        large_objects: 0,
        set_aside: BTreeMap::new(),
        repaired: BTreeMap::new(),
        bounds_deg,
        attributes: vec![],
        reps: vec![],
    }
}

fn manifest(collections: Vec<CollectionInfo>, views: Vec<NamedView>) -> Manifest {
    Manifest {
        version: Manifest::VERSION,
        name: "made up".into(),
        datum: Manifest::DATUM.into(),
        recipe_hash: "0".into(),
        terrain: None,
        imagery: None,
        collections,
        sources: vec![],
        height_range_m: HEIGHT_RANGE_M,
        zones: vec![],
        index_bytes: 0,
        pack_bytes: 0,
        views,
        additions: Default::default(),
    }
}

/// Terrain down to the named cells, and pages of collection 0 in them.
fn index(cells: &[CellId]) -> IndexForest {
    let mut zones: BTreeMap<Zone, BTreeMap<CellId, NodeInfo>> = BTreeMap::new();
    for cell in cells.iter().flat_map(|cell| cell.ancestors()) {
        let terrain = TerrainEntry { place: Place::new(64, 100).unwrap(), error_m: 1.0 };
        let mut node = NodeInfo { terrain: Some(terrain), height_range_m: HEIGHT_RANGE_M, ..NodeInfo::default() };
        if cells.contains(&cell) {
            let place = Place::new(256, 100).unwrap();
            node.objects.push(ObjectsEntry { collection: 0, rep: 0, place, dimension_m: 10.0, error_m: 0.0 });
        }
        zones.entry(cell.zone()).or_default().insert(cell, node);
    }
    let mut index = IndexForest::default();
    zones.iter().for_each(|(zone, nodes)| index.insert(IndexTree::build(*zone, nodes).unwrap()));
    index
}

fn at(lat_deg: f64, lon_deg: f64, level: u8) -> CellId {
    CellId::containing(lat_deg.to_radians(), lon_deg.to_radians(), level)
}

fn view(named: &NamedView) -> View {
    let eye = Geodetic::from_degrees(named.lat_deg, named.lon_deg, named.height_m);
    let pose = Pose { eye, heading_rad: named.heading_deg.to_radians(), pitch_rad: named.pitch_deg.to_radians() };
    View::new(pose, 60f64.to_radians(), [1000, 1000])
}

fn names(views: &[NamedView]) -> Vec<&str> {
    views.iter().map(|view| &*view.name).collect()
}

fn is_globe(view: &NamedView, lat_deg: f64, lon_deg: f64) {
    assert_eq!((&*view.name, view.height_m, view.heading_deg, view.pitch_deg), ("Globe", HOME_HEIGHT_M, 0.0, -90.0));
    let off = (view.lat_deg - lat_deg).abs().max((view.lon_deg - lon_deg).abs());
    assert!(off < 0.5, "{view:?} is not above {lat_deg} {lon_deg}");
}

/// All of a rectangle at a height is in the picture, its middle in the picture's, and it fills a good part.
fn shows(named: &NamedView, bounds_deg: [f64; 4], height_m: f64) {
    let [west, south, east, north] = bounds_deg;
    let view = view(named);
    let px = |lat, lon| view.project_px(Geodetic::from_degrees(lat, lon, height_m).to_ecef()).unwrap();
    let mut spread = 0f64;
    for (lat, lon) in [(south, west), (south, east), (north, west), (north, east)] {
        let [x, y] = px(lat, lon);
        assert!((0.0..=1000.0).contains(&x) && (0.0..=1000.0).contains(&y), "{named:?}: a corner at {x} {y}");
        spread = spread.max((x - 500.0).abs()).max((y - 500.0).abs());
    }
    assert!(spread > 150.0, "{named:?}: {spread} px from the middle at most");
    let [x, y] = px((south + north) / 2.0, (west + east) / 2.0);
    assert!((x - 500.0).hypot(y - 500.0) < 1.0, "{named:?}: the middle at {x} {y}");
}

#[test]
fn an_empty_world_has_the_globe() {
    let views = bookmarks(&manifest(vec![], vec![]), &IndexForest::default());
    assert_eq!(views.len(), 1);
    is_globe(&views[0], 30.0, 10.0);
}

#[test]
fn a_world_without_collections_is_seen_above_its_finest_data() {
    let inset = [at(-33.01, 151.01, 12), at(-33.02, 151.2, 12), at(50.0, 10.0, 5)];
    let views = bookmarks(&manifest(vec![], vec![]), &index(&inset));
    assert_eq!(views.len(), 1);
    is_globe(&views[0], -33.0, 151.1);
    // Data of one fineness all round the Earth have no middle.
    let round: Vec<CellId> = (0..8).map(|k| at(1.0, 45.0 * f64::from(k) - 160.0, 6)).collect();
    is_globe(&bookmarks(&manifest(vec![], vec![]), &index(&round))[0], 30.0, 10.0);
}

#[test]
fn named_views_follow_the_globe_and_take_the_place_of_collections() {
    let city = collection("city", 9, [24.9, 60.1, 25.1, 60.3]);
    let own = vec![named("B", 37.8, -122.4), named("A", 60.0, 25.0)];
    let views = bookmarks(&manifest(vec![city], own.clone()), &index(&[at(60.2, 25.0, 12)]));
    assert_eq!(views[1..], own);
    is_globe(&views[0], 60.2, 25.0);
}

#[test]
fn each_collection_with_objects_is_shown_whole() {
    let all = [
        ("city", [24.9, 60.1, 25.1, 60.3]),
        ("kiosk", [24.5, 60.5, 24.5, 60.5]),
        ("long street", [24.0, 61.0, 24.3, 61.001]),
        ("country", [20.0, 60.0, 26.0, 65.0]),
        ("fiji", [179.8, -17.2, 180.2, -16.8]),
        ("polar station", [10.0, 89.9, 50.0, 89.95]),
    ];
    for (name, bounds) in all {
        let [west, south, east, north] = bounds;
        let index = index(&[at((south + north) / 2.0, (west + east) / 2.0, 13)]);
        let manifest = manifest(vec![collection("empty", 0, [0.0; 4]), collection(name, 9, bounds)], vec![]);
        let views = bookmarks(&manifest, &index);
        assert_eq!(names(&views), ["Globe", name]);
        assert!(views[1].height_m > HEIGHT_RANGE_M.1, "{:?}", views[1]);
        if name != "kiosk" {
            shows(&views[1], bounds, 200.0);
        }
        if name == "city" {
            assert!((views[1].pitch_deg + 45.0).abs() < 0.5 && views[1].heading_deg.abs() < 0.5, "{:?}", views[1]);
        }
    }
}

#[test]
fn a_collection_on_both_sides_of_the_antimeridian_is_looked_at_there() {
    let both = collection("taveuni", 9, [-179.99, -17.0, 179.99, -16.7]);
    let cells = [at(-16.85, 179.95, 10), at(-16.85, -179.95, 10)];
    let views = bookmarks(&manifest(vec![both], vec![]), &index(&cells));
    assert!(views[1].lon_deg.abs() > 179.8 && views[1].height_m < 100_000.0, "{:?}", views[1]);
    assert!((views[0].lat_deg + 16.85).abs() < 0.1 && views[0].lon_deg.abs() > 179.5, "{:?}", views[0]);
}

#[test]
fn collections_all_round_the_earth_and_broken_bounds_give_sane_views() {
    let round = collection("capitals", 200, [-175.0, -41.0, 179.0, 64.0]);
    let cells: Vec<CellId> = (0..8).map(|k| at(10.0, 45.0 * f64::from(k) - 160.0, 10)).collect();
    let far = [collection("one", 1, [0.0, 0.0, 1.0, 1.0]), collection("two", 2, [178.0, 0.0, 179.0, 1.0])];
    let broken = [[5.0, 1.0, 4.0, 2.0], [f64::NAN; 4], [1e300, 0.0, 2e300, 1.0], [0.0, -100.0, 1.0, 100.0]]
        .map(|bounds| collection("broken", 9, bounds));
    let collections: Vec<_> = [round].into_iter().chain(far.clone()).chain(broken).collect();
    let views = bookmarks(&manifest(collections, vec![]), &index(&cells));
    assert_eq!(names(&views), ["Globe", "capitals", "one", "two"]);
    assert_eq!(views[1].pitch_deg, -90.0);
    assert!(views.iter().all(|view| view.check().is_ok()), "{views:?}");
    // Two collections on opposite sides have no middle: the larger is what the globe shows.
    is_globe(&bookmarks(&manifest(far.to_vec(), vec![]), &index(&cells))[0], 0.5, 178.5);
}

#[test]
fn manifests_keep_views_and_refuse_senseless_ones() {
    let file = Path::new("world.json");
    let with = manifest(vec![], vec![named("Here", 1.0, 2.0)]);
    assert_eq!(Manifest::parse(&with.to_bytes(), file).unwrap(), with);
    let without = manifest(vec![], vec![]);
    assert!(!String::from_utf8(without.to_bytes()).unwrap().contains("views"));
    assert_eq!(Manifest::parse(&without.to_bytes(), file).unwrap(), without);
    let error = Manifest::parse(&manifest(vec![], vec![named("Here", 91.0, 2.0)]).to_bytes(), file).unwrap_err();
    assert!(matches!(error, StoreError::Manifest { .. }) && error.to_string().contains("lat_deg = 91"), "{error}");
}

#[test]
fn worlds_that_were_prepared_have_sane_bookmarks() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let of = |world: &str| {
        let world = World::open(&root.join(world)).unwrap();
        bookmarks(world.manifest(), world.index())
    };
    let default = of("tiles/default/world");
    assert_eq!(names(&default), ["Globe", "Helsinki", "Golden Gate"]);
    is_globe(&default[0], 60.17, 24.94);
    let before_there_were_views = of("tests/data/world-v1");
    assert_eq!(names(&before_there_were_views), ["Globe", "houses"]);
    // Its ground is from -1500 to 1500 m.
    shows(&before_there_were_views[1], [-122.5, 37.7, -122.3, 37.9], 0.0);
}
