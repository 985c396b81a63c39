//! Building sets put into a world that stands: all else keeps its bytes, and whoever breaks it off finds the old world.
#![cfg(feature = "prepare")]
#![allow(clippy::unwrap_used, reason = "a test that cannot be set up fails")]

mod towns;

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use stoop::content::{Page, PageId, PageKind};
use stoop::forest::index::{IndexTree, Place};
use stoop::prepare::into::{IntoOptions, build_into};
use stoop::prepare::pipeline::BuildError;
use stoop::store::{Manifest, StoreError, World};
use stoop::units::ByteSize;
use towns::{make, recipe, set, sources, watched, world_text};

fn put(folder: &Path, world: &Path, sets: &str, on_step: &(dyn Fn() -> bool + Sync)) -> Result<Manifest, BuildError> {
    let options = IntoOptions { world: world.to_owned(), root: None, memory: ByteSize(64 << 20) };
    let text = format!("name = \"sets\"\n{sets}");
    watched(on_step, |control| build_into(&recipe(folder, &text), &options, control))
}

fn put_all(folder: &Path, world: &Path, sets: &str) -> Manifest {
    put(folder, world, sets, &|| true).unwrap()
}

/// Names and bytes of the files below a folder.
fn files(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    for entry in fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
        if entry.is_dir() {
            found.extend(files(&entry));
        } else {
            found.insert(entry.clone(), fs::read(&entry).unwrap());
        }
    }
    found
}

fn copy(from: &Path, to: &Path) {
    for (path, bytes) in files(from) {
        let path = to.join(path.strip_prefix(from).unwrap());
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, bytes).unwrap();
    }
}

/// All pages with their bytes.
fn pages(world: &World) -> BTreeMap<PageId, Vec<u8>> {
    let mut found = BTreeMap::new();
    for node in world.index().trees().flat_map(IndexTree::nodes) {
        let terrain = node.terrain().map(|terrain| (PageKind::Terrain, terrain.place));
        let imagery = node.imagery().map(|place| (PageKind::Imagery, place));
        let objects = node
            .objects()
            .map(|entry| (PageKind::Objects { collection: entry.collection, rep: entry.rep }, entry.place));
        for (kind, place) in terrain.into_iter().chain(imagery).chain(objects) {
            let id = PageId { cell: node.cell(), kind };
            found.insert(id, world.read(id, place).unwrap());
        }
    }
    found
}

fn without(mut pages: BTreeMap<PageId, Vec<u8>>, number: u8) -> BTreeMap<PageId, Vec<u8>> {
    pages.retain(|id, _| !matches!(id.kind, PageKind::Objects { collection, .. } if collection == number));
    pages
}

/// What the index tells, places apart.
fn told(world: &World) -> Vec<String> {
    let nodes = world.index().trees().flat_map(IndexTree::nodes);
    let of_node = |node: stoop::forest::index::Node<'_>| {
        let objects: Vec<_> =
            node.objects().map(|entry| (entry.collection, entry.rep, entry.dimension_m, entry.place.len)).collect();
        let terrain = node.terrain().map(|terrain| (terrain.error_m, terrain.place.len));
        let sizes = (node.height_range_m(), node.dimension_m(), node.reach_m());
        format!("{} {terrain:?} {:?} {sizes:?} {objects:?}", node.cell(), node.imagery().map(|place| place.len))
    };
    nodes.map(of_node).collect()
}

fn open_sound(dir: &Path) -> World {
    let world = World::open(dir).unwrap();
    assert_eq!(world.verify(&mut |_, _| {}).problems, [], "{}", dir.display());
    world
}

fn tops_m(world: &World, collection: u8) -> Vec<f32> {
    let mut tops = Vec::new();
    for (id, bytes) in pages(world) {
        if matches!(id.kind, PageKind::Objects { collection: number, rep: 0 } if number == collection) {
            let Page::Objects(page, _) = world.decode(id, Place { offset: 0, len: 0 }, &bytes).unwrap() else {
                panic!()
            };
            tops.extend(page.objects.iter().map(|object| object.top_m));
        }
    }
    tops
}

#[test]
fn a_set_that_is_added_comes_to_a_world_of_which_all_else_stays() {
    let sources = sources();
    let (folder, world) = (sources.path(), sources.path().join("world"));
    make(folder, &world, &set("west", "west.geojson"));
    let (before, before_files) = (open_sound(&world), files(&world));
    let sets = [set("east", "east.geojson"), set("both", "both.geojson"), set("near", "near.geojson")].concat();
    let manifest = put_all(folder, &world, &sets);
    let after = open_sound(&world);
    assert_eq!(*after.manifest(), manifest);
    let names: Vec<_> = manifest.collections.iter().map(|info| &*info.name).collect();
    assert_eq!(names, ["west", "east", "both", "near"]);
    let sources: Vec<_> = manifest.sources.iter().map(|source| &*source.file).collect();
    assert_eq!(
        sources,
        ["globe.tif", "a.tif", "b.tif", "c.tif", "west.geojson", "east.geojson", "both.geojson", "near.geojson"]
    );
    let mut pages_after = pages(&after);
    (1..=3).for_each(|number| pages_after = without(std::mem::take(&mut pages_after), number));
    assert_eq!(pages_after, pages(&before));
    let after_files = files(&world);
    for (path, bytes) in &before_files {
        assert!(after_files[path] == *bytes || path.ends_with("world.json"), "{}", path.display());
    }
    // Zones without new pages have no new files: east, west, and the two of "both".
    assert_eq!(manifest.additions.zones.len(), 3);
    assert_eq!((manifest.additions.generation, manifest.additions.unused_bytes), (1, 0));
    assert_eq!(tops_m(&after, 1).len(), 150);
}

/// What the index tells is what it would have been told had the world been made with all sets at once: sets stand on
/// the same ground here up to the terrain's error, so sizes are the same and heights within a metre.
#[test]
fn the_index_is_that_of_a_world_made_at_once() {
    let sources = sources();
    let folder = sources.path();
    let (grown, whole) = (folder.join("grown"), folder.join("whole"));
    let sets = [set("west", "west.geojson"), set("near", "near.geojson"), set("both", "both.geojson")];
    make(folder, &whole, &sets.concat());
    make(folder, &grown, "");
    put_all(folder, &grown, &[set("west", "low.geojson"), sets[1].clone()].concat());
    put_all(folder, &grown, &[sets[2].clone(), sets[0].clone()].concat());
    let (whole, grown) = (open_sound(&whole), open_sound(&grown));
    let both = || whole.index().trees().zip(grown.index().trees());
    let cells = |tree: &IndexTree| tree.nodes().map(|node| node.cell()).collect::<Vec<_>>();
    for (a, b) in both() {
        assert_eq!(cells(a), cells(b));
        for (a, b) in a.nodes().zip(b.nodes()) {
            let near = |a: f64, b: f64, by: f64| (a - b).abs() <= by;
            let entries = |node: &stoop::forest::index::Node<'_>| {
                node.objects().map(|entry| (entry.collection, entry.rep)).collect::<Vec<_>>()
            };
            assert_eq!(entries(&a), entries(&b), "{}", a.cell());
            assert!(near(a.height_range_m().0, b.height_range_m().0, 2.0), "{}", a.cell());
            assert!(near(a.height_range_m().1, b.height_range_m().1, 2.0), "{}", a.cell());
            assert!(near(a.dimension_m(), b.dimension_m(), 2.0) && near(a.reach_m(), b.reach_m(), 0.2), "{}", a.cell());
        }
    }
}

#[test]
fn a_set_of_a_known_name_is_replaced_and_leaves_no_trace_in_the_index() {
    let sources = sources();
    let (folder, world) = (sources.path(), sources.path().join("world"));
    make(folder, &world, &[set("west", "west.geojson"), set("near", "near.geojson")].concat());
    let before = open_sound(&world);
    let tall = before.index().trees().map(|tree| tree.root().dimension_m()).fold(0.0, f64::max);
    assert!(tall >= 300.0);
    // The set with the tower goes, one over the border comes.
    let manifest = put_all(folder, &world, &set("near", "both.geojson"));
    let after = open_sound(&world);
    assert_eq!(without(pages(&before), 1), without(pages(&after), 1));
    assert_eq!(tops_m(&after, 1).len(), 120);
    let low = after.index().trees().map(|tree| tree.root().dimension_m()).fold(0.0, f64::max);
    assert!(low < 50.0, "{low}");
    let gone: u64 = before.manifest().collections[1].bytes;
    assert_eq!((manifest.additions.unused_bytes, manifest.collections.len()), (gone, 2));
    assert!(manifest.height_range_m.1 < before.manifest().height_range_m.1 - 100.0);
    // And back: the index is again what it was, though its pages lie elsewhere.
    put_all(folder, &world, &set("near", "near.geojson"));
    let again = open_sound(&world);
    assert_eq!(without(pages(&before), 1), without(pages(&again), 1));
    let cells =
        |world: &World| world.index().trees().flat_map(IndexTree::nodes).map(|node| node.cell()).collect::<Vec<_>>();
    assert_eq!(cells(&before), cells(&again));
    assert_eq!(again.manifest().additions.generation, 2);
}

/// At each step the folder is copied as it lies on disk: that is what a process killed there leaves.
#[test]
fn broken_off_after_any_step_the_world_is_the_old_one() {
    let sources = sources();
    let (folder, world) = (sources.path(), sources.path().join("world"));
    make(folder, &world, &[set("west", "west.geojson"), set("near", "near.geojson")].concat());
    let old = World::open(&world).unwrap();
    let (old_told, old_pages) = (told(&old), pages(&old));
    let states = Mutex::new(Vec::new());
    let sets = [set("near", "both.geojson"), set("east", "east.geojson")].concat();
    let new_manifest = put(folder, &world, &sets, &|| {
        let mut states = states.lock().unwrap();
        let state = folder.join(format!("state-{}", states.len()));
        copy(&world, &state);
        // A world that is opened while it is changed is the old one too.
        assert_eq!(*World::open(&world).unwrap().manifest(), *old.manifest());
        states.push(state);
        true
    })
    .unwrap();
    let new = open_sound(&world);
    let (new_told, new_pages) = (told(&new), pages(&new));
    assert_ne!(new_told, old_told);
    let states = states.into_inner().unwrap();
    assert!(states.len() > 6, "{} states", states.len());
    for (at, state) in states.iter().enumerate() {
        // A manifest that did not get its name is no manifest.
        let _ = (at % 2 == 0).then(|| fs::write(state.join("world.json.new"), b"{ \"format\"").unwrap());
        let broken = open_sound(state);
        assert_eq!(told(&broken), old_told);
        assert_eq!(pages(&broken), old_pages);
        // The next change clears what lies about, and comes to the same world.
        assert_eq!(put_all(folder, state, &sets), new_manifest);
        let mended = open_sound(state);
        assert_eq!((told(&mended), pages(&mended)), (new_told.clone(), new_pages.clone()));
        let names = |dir: &Path| {
            files(dir).into_keys().map(|path| path.strip_prefix(dir).unwrap().to_owned()).collect::<Vec<_>>()
        };
        assert_eq!(names(state).iter().filter(|name| !name.ends_with("world.json.new")).count(), names(&world).len());
    }
    // Who had it open before reads on.
    assert_eq!(pages(&old), old_pages);
}

#[test]
fn a_change_that_is_stopped_leaves_no_file_and_goes_on_where_it_was() {
    let sources = sources();
    let (folder, world) = (sources.path(), sources.path().join("world"));
    make(folder, &world, &set("west", "west.geojson"));
    let before = files(&world);
    let steps = AtomicU64::new(0);
    let sets = set("east", "east.geojson");
    let stopped = put(folder, &world, &sets, &|| steps.fetch_add(1, Ordering::Relaxed) < 1);
    assert!(matches!(stopped, Err(BuildError::Stopped(_))));
    let mut after = files(&world);
    after.retain(|path, _| !path.ends_with("into.lock"));
    assert_eq!(before, after);
    assert!(folder.join("world.into.partial").exists());
    put_all(folder, &world, &sets);
    assert!(!folder.join("world.into.partial").exists());
    assert_eq!(open_sound(&world).manifest().collections.len(), 2);
}

#[test]
fn two_changes_at_once_and_recipes_with_more_than_sets_are_refused() {
    let sources = sources();
    let (folder, world) = (sources.path(), sources.path().join("world"));
    make(folder, &world, "");
    let held = stoop::store::WorldChange::begin(&world).unwrap();
    let refused = put(folder, &world, &set("east", "east.geojson"), &|| true).unwrap_err();
    assert!(matches!(refused, BuildError::Store(StoreError::Busy(_))), "{refused}");
    drop(held);
    let options = IntoOptions { world: world.clone(), root: None, memory: ByteSize(1 << 20) };
    let refused = watched(&|| true, |control| build_into(&recipe(folder, &world_text("")), &options, control));
    let text = refused.unwrap_err().to_string();
    assert!(text.contains("[[elevation]]") && text.contains("--out"), "{text}");
    let nowhere = IntoOptions { world: folder.join("nowhere"), ..options };
    let text = format!("name = \"sets\"\n{}", set("east", "east.geojson"));
    let refused = watched(&|| true, |control| build_into(&recipe(folder, &text), &nowhere, control)).unwrap_err();
    assert!(matches!(refused, BuildError::Store(StoreError::NotAWorld(_))), "{refused}");
}

#[test]
fn an_index_that_the_manifest_does_not_name_is_not_taken_for_it() {
    let sources = sources();
    let (folder, world) = (sources.path(), sources.path().join("world"));
    make(folder, &world, &set("east", "east.geojson"));
    put_all(folder, &world, &set("east", "east.geojson"));
    let manifest = World::open(&world).unwrap().manifest().clone();
    let zone = manifest.additions.zones[0].zone;
    fs::copy(world.join(format!("index/{zone:02}.idx")), world.join(format!("index/{zone:02}.g1.idx"))).unwrap();
    let text = World::open(&world).err().unwrap().to_string();
    assert!(text.contains(".g1.idx") && text.contains("not the index that the manifest names"), "{text}");
    assert!(World::open_paged(&world, 0).is_err());
}

/// Boston's buildings into the default world, on its own coarse terrain.
#[test]
fn boston_comes_to_the_default_world() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let file = root.join("../shared/data/boston/boston_buildings.geojson");
    if !file.exists() {
        println!("skipped: ../shared/data is not here");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let world = folder.path().join("world");
    copy(&root.join("tiles/default/world"), &world);
    let before = open_sound(&world);
    let sets = format!(
        "[[buildings]]\nname = \"boston\"\nfile = \"{}\"\nheight = \"storeys * 3.5\"\ndefault_height = 6\n",
        file.display()
    );
    let manifest = put_all(folder.path(), &world, &sets);
    let after = open_sound(&world);
    let number = manifest.collections.len() as u8 - 1;
    assert_eq!(manifest.collections[usize::from(number)].name, "boston");
    assert_eq!(pages(&before), without(pages(&after), number));
    assert_eq!(manifest.additions.zones.len(), 1);
    check_standing(&after, number);
}

/// The foot of the visible walls is the drawn ground in the middle of each, or above it where the whole's ground is.
fn check_standing(world: &World, number: u8) {
    let (mut checked, mut on_ground) = (0, 0);
    for node in world.index().trees().flat_map(IndexTree::nodes) {
        for entry in node.objects().filter(|entry| entry.collection == number) {
            let id = PageId { cell: node.cell(), kind: PageKind::Objects { collection: number, rep: entry.rep } };
            let Page::Objects(page, _) = world.load(id, entry.place).unwrap() else { panic!() };
            for object in page.objects.iter().step_by(50) {
                let at = stoop::forest::CellId::containing(object.lat_rad, object.lon_rad, 22);
                let ground = at.ancestors().find_map(|cell| Some((cell, world.index().find(cell)?.terrain()?)));
                let (cell, terrain) = ground.unwrap();
                let id = PageId { cell, kind: PageKind::Terrain };
                let Page::Terrain(terrain) = world.load(id, terrain.place).unwrap() else { panic!() };
                let ground_m = terrain.surface_height_m(object.lat_rad, object.lon_rad, 1.0).unwrap();
                checked += 1;
                on_ground += usize::from((f64::from(object.base_m) - ground_m).abs() < 0.1);
                assert!(f64::from(object.base_m) > ground_m - 0.1, "{} is {} m below", object.id, ground_m);
            }
        }
    }
    assert!(checked > 100 && on_ground * 10 > checked * 9, "{on_ground} of {checked}");
}
