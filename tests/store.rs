//! The world format: what is written is read, what was harmed is told, and version 1 opens for ever.

#![allow(clippy::unwrap_used, reason = "a test may panic where its set-up fails")]

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use stoop::content::rtin::{Active, Diagonal};
use stoop::content::{IMAGERY_STORED_PX, Page, PageId, PageKind, Prism, TerrainPage, TerrainPost};
use stoop::forest::index::{IndexForest, IndexTree, NodeInfo, ObjectsEntry, Place, TerrainEntry};
use stoop::forest::{CellId, Zone};
use stoop::store::{
    CollectionInfo, Existing, Manifest, MemoryWriter, PrismPage, SourceInfo, StoreError, World, WorldWriter,
    encode_imagery, encode_objects, encode_terrain, height_step_m,
};

// ---- A small made-up world: one zone, terrain and imagery to level 2, three houses far below.

const LAT_DEG: f64 = 37.8;
const LON_DEG: f64 = -122.4;
const OBJECTS_LEVEL: u8 = 13;

fn at(level: u8) -> CellId {
    CellId::containing(LAT_DEG.to_radians(), LON_DEG.to_radians(), level)
}

fn height_m(lat_rad: f64, lon_rad: f64) -> f64 {
    800.0 * (lat_rad * 11.0).sin() + 600.0 * (lon_rad * 7.0).cos()
}

fn terrain(cell: CellId) -> TerrainPage {
    let diagonal = Diagonal::of(cell);
    let error_m = 4000.0 / f32::from(1u16 << (2 * cell.level()));
    let active = Active::corners().refine(diagonal, &|triangle| triangle.depth() < 8);
    let bounds = cell.bounds();
    let posts = active.posts().map(|(column, row)| {
        let place = bounds.at(f64::from(column) / 64.0, f64::from(row) / 64.0, 0.0);
        let own = height_m(place.lat_rad, place.lon_rad);
        let parent = if cell.level() == 0 { own } else { own + 50.0 * f64::from(column % 2) };
        TerrainPost { column, row, height_m: own as f32, parent_height_m: parent as f32, slope: [3, -4] }
    });
    let mut page = TerrainPage::from_posts(cell, error_m, posts.collect()).expect("a closed network");
    page.quantize(height_step_m(error_m));
    page
}

fn picture(cell: CellId) -> Vec<u8> {
    let side = IMAGERY_STORED_PX;
    let texel = |x: u32, y: u32| [(x * 255 / side) as u8, (y * 255 / side) as u8, 60 * (cell.level() + 1)];
    (0..side).flat_map(|y| (0..side).flat_map(move |x| texel(x, y))).collect()
}

fn houses(root: CellId) -> PrismPage {
    let cell = root.children().next().expect("a child");
    let center = cell.bounds().center();
    let metre = 1.0 / 6.378e6;
    let corner =
        |east: f64, north: f64| [center.lon_rad + east * metre / center.lat_rad.cos(), center.lat_rad + north * metre];
    let prisms = (0..3).map(|id| {
        let (x, y) = (40.0 * f64::from(id), 5.0);
        Prism {
            id: id * 1000,
            cell,
            rings: vec![vec![corner(x, y), corner(x + 20.0, y), corner(x + 20.0, y + 10.0), corner(x, y + 10.0)]],
            roof: vec![[0, 1, 2], [0, 2, 3]],
            base_m: 100.0,
            top_m: 112.0 + id as f32,
            foundation_m: 2.0,
            wall_color: [210, 200, 190],
            roof_color: [140, 70, 60],
            detail: None,
        }
    });
    PrismPage { root, collection: 0, rep: 0, error_m: 0.01, prisms: prisms.collect(), atlas: None }
}

/// Appends all pages and tells the index's cells.
fn write_pages(append: &mut dyn FnMut(Zone, &[u8]) -> Place) -> BTreeMap<CellId, NodeInfo> {
    let zone = at(0).zone();
    let mut cells = BTreeMap::new();
    let info =
        || NodeInfo { height_range_m: (-1500.0, 1500.0), dimension_m: 25.0, reach_m: 22.0, ..NodeInfo::default() };
    let first: Vec<CellId> = [at(0)].into_iter().chain(at(0).children()).chain(at(1).children()).collect();
    for cell in first {
        let page = terrain(cell);
        let bytes = encode_terrain(&page, height_step_m(page.error_m)).unwrap();
        let terrain = TerrainEntry { place: append(zone, &bytes), error_m: page.error_m };
        let imagery = append(zone, &encode_imagery(cell, &picture(cell), 60).unwrap());
        cells.insert(cell, NodeInfo { terrain: Some(terrain), imagery: Some(imagery), ..info() });
    }
    for level in 3..=OBJECTS_LEVEL {
        cells.insert(at(level), info());
    }
    let texts = [r#"{"name":"First"}"#, "{}", r#"{"name":"Third","levels":4}"#].map(String::from);
    let bytes = encode_objects(&houses(at(OBJECTS_LEVEL)), &texts).unwrap();
    let entry = ObjectsEntry { collection: 0, rep: 0, place: append(zone, &bytes), dimension_m: 25.0, error_m: 0.0 };
    cells.get_mut(&at(OBJECTS_LEVEL)).unwrap().objects.push(entry);
    cells
}

fn manifest() -> Manifest {
    Manifest {
        version: 0,
        name: "made up".into(),
        datum: String::new(),
        recipe_hash: "0123456789abcdef".into(),
        terrain: None,
        imagery: None,
        collections: vec![CollectionInfo {
            name: "houses".into(),
            objects: 3,
            pages: 0,
            bytes: 0,
            changeover_level: OBJECTS_LEVEL + 1,
            vgis_level: OBJECTS_LEVEL + 1,
            cost_curve: vec![],
            large_objects: 0,
            set_aside: BTreeMap::new(),
            repaired: BTreeMap::new(),
            bounds_deg: [-122.5, 37.7, -122.3, 37.9],
            attributes: vec!["name".into(), "levels".into()],
            reps: Vec::new(),
        }],
        sources: vec![SourceInfo {
            kind: "elevation".into(),
            file: "made-up.tif".into(),
            credit: "nobody".into(),
            licence: "CC0".into(),
            spacing_m: 1234.5,
            count: 9,
        }],
        height_range_m: (-1500.0, 1500.0),
        zones: vec![],
        index_bytes: 0,
        pack_bytes: 0,
        views: vec![],
        additions: Default::default(),
    }
}

fn tree(cells: &BTreeMap<CellId, NodeInfo>) -> IndexTree {
    IndexTree::build(at(0).zone(), cells).unwrap()
}

fn write_world(dir: &Path, existing: Existing) -> Result<(), StoreError> {
    let mut writer = WorldWriter::create(dir, existing)?;
    let cells = write_pages(&mut |zone, bytes| writer.append(zone, bytes).unwrap());
    writer.finish(manifest(), &[tree(&cells)])
}

fn memory_world() -> World {
    let mut writer = MemoryWriter::default();
    let cells = write_pages(&mut |zone, bytes| writer.append(zone, bytes).unwrap());
    writer.finish(manifest(), vec![tree(&cells)])
}

fn all_pages(index: &IndexForest) -> Vec<(PageId, Place)> {
    let mut pages = Vec::new();
    for node in index.trees().flat_map(IndexTree::nodes) {
        let mut add = |kind, place| pages.push((PageId { cell: node.cell(), kind }, place));
        node.terrain().into_iter().for_each(|terrain| add(PageKind::Terrain, terrain.place));
        node.imagery().into_iter().for_each(|place| add(PageKind::Imagery, place));
        node.objects().for_each(|o| add(PageKind::Objects { collection: o.collection, rep: o.rep }, o.place));
    }
    pages
}

fn objects_id() -> PageId {
    PageId { cell: at(OBJECTS_LEVEL), kind: PageKind::Objects { collection: 0, rep: 0 } }
}

// ---- Reading what was written.

#[test]
fn a_world_on_disk_is_the_world_in_memory() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("world");
    write_world(&path, Existing::Refuse).unwrap();
    let (world, memory) = (World::open(&path).unwrap(), memory_world());
    assert_eq!(world.manifest(), memory.manifest());
    assert_eq!(world.index().byte_len(), memory.index().byte_len());
    let pages = all_pages(world.index());
    assert_eq!(pages, all_pages(memory.index()));
    assert_eq!(pages.len(), 2 * 9 + 1);
    for (page, place) in pages {
        assert_eq!(world.place(page), Some(place));
        assert_eq!(world.read(page, place).unwrap(), memory.read(page, place).unwrap());
        assert_eq!(world.load(page, place).unwrap().id(), page);
    }
    for world in [world, memory] {
        let mut calls = 0;
        let verified = world.verify(&mut |_, _| calls += 1);
        assert_eq!((verified.problems.as_slice(), verified.pages, calls), (&[][..], 19, 1));
        assert_eq!(verified.nodes, 9 + u64::from(OBJECTS_LEVEL) - 2);
    }
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1, "nothing but the world");
}

#[test]
fn a_manifest_counts_what_is_there() {
    let world = memory_world();
    let manifest = world.manifest();
    assert_eq!((manifest.version, manifest.zones.as_slice()), (1, &[at(0).zone().index() as u8][..]));
    let terrain = manifest.terrain.as_ref().unwrap();
    assert_eq!((terrain.level_max, terrain.pages_by_level.as_slice()), (2, &[1, 4, 4][..]));
    let places = all_pages(world.index());
    let bytes: u64 = places.iter().map(|(_, place)| u64::from(place.len)).sum();
    assert_eq!(manifest.pack_bytes, bytes + 32);
    assert_eq!(manifest.collections[0].pages, 1);
}

// ---- Writing shows all or nothing.

#[test]
fn a_writer_that_is_dropped_leaves_nothing_and_a_world_is_not_lost() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("world");
    write_world(&path, Existing::Refuse).unwrap();
    assert!(matches!(WorldWriter::create(&path, Existing::Refuse), Err(StoreError::Exists(_))));
    let mut writer = WorldWriter::create(&path, Existing::Replace).unwrap();
    writer.append(at(0).zone(), b"half a page").unwrap();
    writer.sync().unwrap();
    drop(writer);
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);
    assert!(World::open(&path).unwrap().verify(&mut |_, _| {}).problems.is_empty());
    write_world(&path, Existing::Replace).unwrap();
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);
    assert!(World::open(&path).is_ok());
}

#[test]
fn a_directory_of_other_things_is_left_alone() {
    let dir = tempfile::tempdir().unwrap();
    fs::write(dir.path().join("thesis.tex"), "years of work").unwrap();
    for existing in [Existing::Refuse, Existing::Replace] {
        assert!(matches!(WorldWriter::create(dir.path(), existing), Err(StoreError::Occupied(_))));
    }
    let empty = dir.path().join("empty");
    fs::create_dir(&empty).unwrap();
    write_world(&empty, Existing::Refuse).unwrap();
    assert!(World::open(&empty).is_ok());
}

// ---- Harm.

/// A copy of the world with one file harmed.
struct Harmed {
    dir: tempfile::TempDir,
    file: PathBuf,
    bytes: Vec<u8>,
}

impl Harmed {
    fn new(file: &str) -> Self {
        let dir = tempfile::tempdir().unwrap();
        write_world(&dir.path().join("world"), Existing::Refuse).unwrap();
        let file = dir.path().join("world").join(file);
        let bytes = fs::read(&file).unwrap();
        Self { dir, file, bytes }
    }

    fn with(&self, change: impl FnOnce(&mut Vec<u8>)) -> Result<World, StoreError> {
        let mut bytes = self.bytes.clone();
        change(&mut bytes);
        // A new file each time: the old one may still be mapped.
        fs::remove_file(&self.file).unwrap();
        fs::write(&self.file, bytes).unwrap();
        World::open(&self.dir.path().join("world"))
    }
}

fn zone_file(folder: &str, extension: &str) -> String {
    format!("{folder}/{:02}.{extension}", at(0).zone().index())
}

#[test]
fn a_harmed_index_or_manifest_does_not_open_or_tells_the_same() {
    let sound = memory_world();
    for file in [zone_file("index", "idx"), "world.json".into()] {
        let harmed = Harmed::new(&file);
        for at in 0..harmed.bytes.len() {
            for flip in [1, 0x80] {
                match harmed.with(|bytes| bytes[at] ^= flip) {
                    Err(error) => {
                        let text = error.to_string();
                        assert!(text.contains(harmed.file.to_str().unwrap()) && text.contains(';'), "{text}");
                    }
                    Ok(world) => {
                        assert_eq!(world.manifest(), sound.manifest());
                        assert_eq!(all_pages(world.index()), all_pages(sound.index()));
                    }
                }
            }
            assert!(harmed.with(|bytes| bytes.truncate(at)).is_err(), "{file}: {at} bytes");
        }
    }
}

#[test]
fn a_harmed_pack_is_told_page_by_page_and_the_rest_is_sound() {
    let harmed = Harmed::new(&zone_file("packs", "pack"));
    let pages = all_pages(memory_world().index());
    for byte in (32..harmed.bytes.len()).step_by(harmed.bytes.len() / 40) {
        let world = harmed.with(|bytes| bytes[byte] ^= 0x10).unwrap();
        for &(page, place) in &pages {
            let hit = (place.offset..place.offset + u64::from(place.len)).contains(&(byte as u64));
            match world.load(page, place) {
                Ok(_) => assert!(!hit),
                Err(error) => {
                    let text = error.to_string();
                    assert!(hit && !error.is_transient(), "{text}");
                    for part in [".pack", &page.cell.to_string(), &place.offset.to_string(), "copy the file again"] {
                        assert!(text.contains(part), "{text}");
                    }
                }
            }
        }
        assert_eq!(world.verify(&mut |_, _| {}).problems.len(), 1);
    }
    let short = harmed.with(|bytes| bytes.truncate(bytes.len() / 2)).unwrap();
    let lost = pages.iter().filter(|&&(page, place)| short.load(page, place).is_err()).count();
    assert!(lost > 0 && lost < pages.len());
    let longer = harmed.with(|bytes| bytes.extend([0; 9])).unwrap();
    let problems = longer.verify(&mut |_, _| {}).problems;
    assert!(problems.iter().any(|problem| problem.what.contains("its pages end at")), "{problems:?}");
    let headless = harmed.with(|bytes| bytes[9] ^= 1).unwrap();
    assert!(matches!(headless.load(pages[0].0, pages[0].1), Err(StoreError::Pack { .. })));
    let gone = harmed.with(|_| {}).unwrap();
    fs::remove_file(&harmed.file).unwrap();
    assert!(gone.load(pages[0].0, pages[0].1).is_err());
}

#[test]
fn a_world_of_a_future_version_says_so() {
    let manifest = Harmed::new("world.json");
    let world = manifest.with(|bytes| {
        *bytes = String::from_utf8_lossy(bytes).replace("\"version\": 1", "\"version\": 3").into_bytes();
    });
    let text = world.err().unwrap().to_string();
    assert!(text.contains("version 3 is newer than this program") && text.contains("update stoop"), "{text}");
    let index = Harmed::new(&zone_file("index", "idx"));
    assert!(matches!(index.with(|bytes| bytes[4] = 2), Err(StoreError::FutureVersion { found: 2, .. })));
    let nothing = tempfile::tempdir().unwrap();
    assert!(matches!(World::open(nothing.path()), Err(StoreError::NotAWorld(_))));
    assert!(matches!(World::open(&nothing.path().join("nowhere")), Err(StoreError::NotAWorld(_))));
}

#[test]
fn bounds_that_grow_downwards_are_found() {
    let mut writer = MemoryWriter::default();
    let mut cells = write_pages(&mut |zone, bytes| writer.append(zone, bytes).unwrap());
    let child = cells.get_mut(&at(1)).unwrap();
    child.terrain.as_mut().unwrap().error_m = 9000.0;
    child.height_range_m = (-1500.0, 1600.0);
    cells.get_mut(&at(5)).unwrap().reach_m = 99.0;
    let world = writer.finish(manifest(), vec![tree(&cells)]);
    let problems = world.verify(&mut |_, _| {}).problems;
    for (cell, what) in [
        (at(1), "above its parent's"),
        (at(1), "its parent's range"),
        (at(5), "larger than its parent"),
        (at(1), "the index tells"),
    ] {
        assert!(problems.iter().any(|p| p.place == cell.to_string() && p.what.contains(what)), "{what}: {problems:?}");
    }
    assert_eq!(problems.len(), 4, "{problems:?}");
}

// ---- Indexes that are paged.

fn segment_id(root: CellId) -> PageId {
    PageId { cell: root, kind: PageKind::Segment }
}

/// Loads all segments that are absent, as a run does, page by page.
fn load_segments(world: &World) -> IndexForest {
    let mut index = world.index().clone();
    for tree in world.index().trees() {
        for absent in tree.absent_segments() {
            let id = segment_id(absent.root);
            assert_eq!(world.place(id), Some(absent.place));
            let Page::Segment(segment) = world.load(id, absent.place).unwrap() else { panic!("no segment") };
            assert_eq!((segment.byte_len(), Page::Segment(segment.clone()).id()), (absent.place.len as usize, id));
            index.insert_segment(segment).unwrap();
        }
    }
    index
}

#[test]
fn a_paged_index_becomes_the_whole_one_segment_by_segment() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("world");
    write_world(&path, Existing::Refuse).unwrap();
    let whole = World::open(&path).unwrap();
    assert!(whole.index().is_whole(), "a small world is all there");
    let file_bytes = fs::metadata(path.join(zone_file("index", "idx"))).unwrap().len();
    assert!(World::open_paged(&path, file_bytes).unwrap().index().is_whole());
    for paged in [World::open_paged(&path, file_bytes - 1).unwrap(), memory_world().paged(file_bytes - 1).unwrap()] {
        let bytes = paged.index().bytes();
        assert_eq!((bytes.directory, bytes.paged), (3 * 32, 0));
        assert_eq!((bytes.pinned, bytes.total()), ((9 + 3) * 32, whole.index().byte_len()));
        assert_eq!(all_pages(paged.index()).len(), 2 * 9);
        assert_eq!(paged.place(objects_id()), None);
        assert_eq!(all_pages(&load_segments(&paged)), all_pages(whole.index()));
        assert_eq!(all_pages(&paged.whole_index().unwrap()), all_pages(whole.index()));
        let verified = paged.verify(&mut |_, _| {});
        assert_eq!((verified.problems.as_slice(), verified.pages), (&[][..], 19));
        assert_eq!(verified.nodes, whole.verify(&mut |_, _| {}).nodes);
        // A page below is loaded by its place, without the index telling of it.
        let place = whole.place(objects_id()).unwrap();
        assert_eq!(paged.load(objects_id(), place).unwrap().id(), objects_id());
    }
    assert!(World::open_paged(&path, 0).unwrap().paged(u64::MAX).unwrap().index().is_whole());
    assert!(World::open_whole(&path).unwrap().index().is_whole());
}

#[test]
fn opening_touches_no_segment_below_and_a_broken_one_is_named_as_it_is_loaded() {
    let harmed = Harmed::new(&zone_file("index", "idx"));
    let sound = memory_world().paged(0).unwrap();
    let tree = sound.index().trees().next().unwrap();
    let below: Vec<_> = tree.absent_segments().collect();
    assert_eq!(below.iter().map(|segment| segment.root).collect::<Vec<_>>(), [at(6), at(12)]);
    for byte in 0..harmed.bytes.len() {
        let hit = below.iter().find(|segment| {
            (segment.place.offset..segment.place.offset + u64::from(segment.place.len)).contains(&(byte as u64))
        });
        assert!(harmed.with(|bytes| bytes[byte] ^= 0x40).is_err(), "byte {byte} is of no matter");
        let world = World::open_paged(&harmed.dir.path().join("world"), 0);
        let Some(hit) = hit else {
            assert!(world.is_err(), "byte {byte} is of no matter to the top");
            continue;
        };
        let world = world.unwrap();
        for segment in &below {
            match world.load(segment_id(segment.root), segment.place) {
                Ok(_) => assert_ne!(segment, hit),
                Err(error) => {
                    let text = error.to_string();
                    assert!(segment == hit && !error.is_transient(), "{text}");
                    for part in [".idx", &segment.root.to_string(), "prepare the world again"] {
                        assert!(text.contains(part), "{text}");
                    }
                }
            }
        }
        assert!(world.whole_index().is_err());
        assert_eq!(world.verify(&mut |_, _| {}).problems.len(), 1);
    }
}

#[test]
fn bytes_that_pass_for_a_segment_and_are_none_are_refused() {
    let world = memory_world().paged(0).unwrap();
    let tree = world.index().trees().next().unwrap();
    let below: Vec<_> = tree.absent_segments().collect();
    let bytes = world.read(segment_id(at(6)), below[0].place).unwrap();
    for (id, bytes) in [
        (segment_id(at(12)), &bytes[..]),
        (segment_id(at(7)), &bytes[..]),
        (segment_id(Zone::new(0).unwrap().root()), &bytes[..]),
        (segment_id(at(6)), &bytes[..bytes.len() - 1]),
        (segment_id(at(6)), &[]),
    ] {
        assert!(matches!(world.decode(id, below[0].place, bytes), Err(StoreError::Index { .. })), "{id:?}");
    }
    let beyond = Place { offset: 1 << 39, len: 32 };
    assert!(world.load(segment_id(at(6)), beyond).is_err());
}

/// Sums that are right over links that are wrong: what only a hostile writer makes.
#[test]
fn a_segment_whose_links_lead_elsewhere_is_refused_though_its_sum_is_right() {
    let harmed = Harmed::new(&zone_file("index", "idx"));
    let sound = memory_world().paged(0).unwrap();
    let segment = sound.index().trees().next().unwrap().absent_segments().next().unwrap();
    let from = segment.place.offset as usize;
    let records = from..from + segment.place.len as usize;
    for byte in records.clone() {
        let mut bytes = harmed.bytes.clone();
        bytes[byte] ^= 0x10;
        // The second entry of the table ends with the sum of the segment, the head with that of the table.
        let sum = xxhash_rust::xxh3::xxh3_64(&bytes[records.clone()]);
        bytes[32 + 64 - 8..32 + 64].copy_from_slice(&sum.to_le_bytes());
        let table_end = 32 + 3 * 32;
        let head = [&bytes[..24], &bytes[32..table_end]].concat();
        bytes[24..32].copy_from_slice(&xxhash_rust::xxh3::xxh3_64(&head).to_le_bytes());
        fs::remove_file(&harmed.file).unwrap();
        fs::write(&harmed.file, &bytes).unwrap();
        let world = World::open_paged(&harmed.dir.path().join("world"), 0).unwrap();
        match world.load(segment_id(segment.root), segment.place) {
            Ok(Page::Segment(found)) => {
                let mut index = world.index().clone();
                index.insert_segment(found).unwrap();
                assert!(index.trees().flat_map(IndexTree::nodes).all(|node| node.objects().count() < 256));
            }
            Ok(_) => panic!("no segment"),
            Err(error) => assert!(error.to_string().contains(&segment.root.to_string()), "{error}"),
        }
    }
}

// ---- Version 1, for ever.

fn fixture() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/world-v1")
}

/// The world under tests/data was written once by this file, with `STOOP_WRITE_FIXTURE=1`, and never changes.
#[test]
fn version_1_opens_for_ever() {
    if std::env::var_os("STOOP_WRITE_FIXTURE").is_some() {
        write_world(&fixture(), Existing::Replace).unwrap();
    }
    let world = World::open(&fixture()).expect("the world of version 1 belongs to the repository");
    assert_eq!(world.verify(&mut |_, _| {}).problems, []);
    let load = |page| world.load(page, world.place(page).unwrap()).unwrap();
    let heights = [(0, 10.0, -130.0), (1, 30.0, -120.0), (2, 37.8, -122.4), (2, 40.1, -116.2)];
    let expected = FIXTURE_HEIGHTS_M;
    for ((level, lat, lon), expected_m) in heights.into_iter().zip(expected) {
        let (lat_rad, lon_rad) = (f64::to_radians(lat), f64::to_radians(lon));
        let cell = CellId::containing(lat_rad, lon_rad, level);
        let Page::Terrain(page) = load(PageId { cell, kind: PageKind::Terrain }) else { panic!("no terrain") };
        let drawn_m = page.surface_height_m(lat_rad, lon_rad, 1.0).unwrap();
        assert!((drawn_m - expected_m).abs() < 1e-3, "{cell}: {drawn_m}");
    }
    let Page::Imagery(picture) = load(PageId { cell: at(2), kind: PageKind::Imagery }) else { panic!("no picture") };
    for (x, y) in [(1, 1), (128, 64), (200, 250)] {
        let texel = &picture.mips[0][(y * 258 + x) * 4..][..4];
        let source = [(x * 255 / 258) as u8, (y * 255 / 258) as u8, 180, 255];
        assert!(texel.iter().zip(source).all(|(a, b)| a.abs_diff(b) <= 6), "{texel:?} {source:?}");
    }
    let Page::Objects(page, mesh) = load(objects_id()) else { panic!("no objects") };
    let told: Vec<_> = page.objects.iter().map(|object| (object.id, object.base_m, object.top_m)).collect();
    assert_eq!(told, [(0, 100.0, 112.0), (1000, 100.0, 113.0), (2000, 100.0, 114.0)]);
    assert_eq!(mesh.indices.len(), 3 * 3 * (4 * 2 + 2));
    let place = world.place(objects_id()).unwrap();
    let bytes = world.read(objects_id(), place).unwrap();
    assert_eq!(world.attributes(objects_id(), place, &bytes).unwrap()[2], r#"{"name":"Third","levels":4}"#);
}

const FIXTURE_HEIGHTS_M: [f64; 4] = [-3063.0978, -1453.7328, 123.0045, 696.2214];

#[test]
fn worlds_are_read_from_many_threads() {
    let world = Arc::new(memory_world());
    let pages = all_pages(world.index());
    std::thread::scope(|scope| {
        for _ in 0..4 {
            scope.spawn(|| {
                pages.iter().for_each(|&(page, place)| assert_eq!(world.load(page, place).unwrap().id(), page))
            });
        }
    });
}
