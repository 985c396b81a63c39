//! Worlds over one another: one index, each page from its own world, all sets on the ground that is drawn.
#![cfg(feature = "prepare")]
#![allow(clippy::unwrap_used, reason = "a test that cannot be set up fails")]

mod towns;

use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};
use stoop::camera::{Pose, View};
use stoop::content::{ObjectPage, Page, PageId, PageKind};
use stoop::engine::{Engine, EngineParams, FrameRequest, Live, Mode, Pace, Source};
use stoop::forest::index::IndexTree;
use stoop::geodesy::Geodetic;
use stoop::render::Renderer;
use stoop::select::CollectionSet;
use stoop::store::{StoreError, World, bookmarks, finest_terrain};
use towns::{make, make_of, pages, set, sources};

fn picture(path: &Path, color: [u8; 3]) {
    image::RgbImage::from_pixel(64, 32, image::Rgb(color)).save(path).unwrap();
}

/// Two worlds: one with hills and a picture in the west, one with a plain of 300 m, hills in the east, another picture
/// that goes deeper, and sets in both, one of the name of the first world's.
fn two() -> (tempfile::TempDir, Vec<Arc<World>>) {
    let folder = sources();
    picture(&folder.path().join("red.png"), [200, 40, 40]);
    picture(&folder.path().join("blue.png"), [40, 40, 200]);
    towns::write_dem(&folder.path().join("plain.tif"), [25, 13], [-180.0, 90.0, 15.0], |_, _| 300.0);
    let elevation = |file: &str| format!("[[elevation]]\nfile = \"{file}\"\nvertical = \"ellipsoid\"\n");
    let imagery = |file: &str, bounds: &str| format!("[[imagery]]\nfile = \"{file}\"\nbounds_deg = [{bounds}]\n");
    let globe = "-180, -90, 180, 90";
    let west = [
        "name = \"one\"\n".to_owned(),
        elevation("globe.tif"),
        elevation("a.tif"),
        imagery("red.png", globe),
        set("town", "west.geojson"),
    ];
    let east = [
        "name = \"two\"\n".to_owned(),
        elevation("plain.tif"),
        elevation("c.tif"),
        imagery("blue.png", globe),
        imagery("blue.png", "-85, 33, -84, 34"),
        imagery("red.png", "24, 59.5, 26, 61"),
        set("town", "near.geojson"),
        set("east", "east.geojson"),
    ];
    let worlds = [("one", west.concat()), ("two", east.concat())].map(|(name, text)| {
        make_of(folder.path(), &folder.path().join(name), &text);
        Arc::new(World::open(&folder.path().join(name)).unwrap())
    });
    (folder, worlds.to_vec())
}

fn objects(world: &World, collection: u8) -> Vec<Arc<ObjectPage>> {
    let of_it = |id: &PageId| matches!(id.kind, PageKind::Objects { collection: number, .. } if number == collection);
    let load = |(id, place)| match world.load(id, place).unwrap() {
        Page::Objects(page, _) => page,
        _ => panic!("no objects"),
    };
    pages(world).into_iter().filter(|(id, _)| of_it(id)).map(load).collect()
}

/// Height and error of the finest surface, metres.
fn ground_m(world: &World, lat_rad: f64, lon_rad: f64) -> (f64, f64) {
    let (cell, terrain) = finest_terrain(world.index(), lat_rad, lon_rad).unwrap();
    let id = PageId { cell, kind: PageKind::Terrain };
    let Page::Terrain(page) = world.load(id, terrain.place).unwrap() else { panic!("no terrain") };
    (page.surface_height_m(lat_rad, lon_rad, 1.0).unwrap(), f64::from(terrain.error_m))
}

#[test]
fn every_page_is_that_of_the_first_world_that_has_it() {
    let (_folder, worlds) = two();
    let whole = World::stack(&worlds).unwrap();
    let alone: Vec<_> = worlds.iter().map(|world| pages(world)).collect();
    let mut counts = [0; 2];
    let mut mixed = 0;
    for (id, place) in pages(&whole) {
        assert_eq!(whole.load(id, place).unwrap().id(), id);
        if matches!(id.kind, PageKind::Objects { .. }) {
            continue;
        }
        let from = alone.iter().position(|pages| pages.iter().any(|(known, _)| *known == id)).unwrap();
        let (_, own) = alone[from].iter().find(|(known, _)| *known == id).unwrap();
        assert_eq!(whole.read(id, place).unwrap(), worlds[from].read(id, *own).unwrap());
        counts[from] += 1;
        mixed += u32::from(place.offset >= 1 << 39);
    }
    assert!(counts.iter().all(|&count| count > 10), "{counts:?}");
    // Below the first world's picture there is its own terrain with the other's finer picture, and the reverse.
    assert!(mixed >= 4, "{mixed}");
    for cell in alone.iter().flatten().map(|(id, _)| id.cell) {
        assert!(whole.index().find(cell).is_some(), "{cell}");
    }
}

#[test]
fn bounds_never_grow_downwards_and_hold_what_is_drawn() {
    let (_folder, worlds) = two();
    let whole = World::stack(&worlds).unwrap();
    for node in whole.index().trees().flat_map(IndexTree::nodes) {
        for child in node.children() {
            let ((low, high), (child_low, child_high)) = (node.height_range_m(), child.height_range_m());
            assert!(low <= child_low && child_high <= high, "{}", child.cell());
            assert!(child.dimension_m() <= node.dimension_m() && child.reach_m() <= node.reach_m());
            if let (Some(own), Some(parent)) = (child.terrain(), node.terrain()) {
                assert!(own.error_m <= parent.error_m, "{}", child.cell());
            }
            assert!(child.terrain().is_none() || node.terrain().is_some());
            assert!(child.imagery().is_none() || node.imagery().is_some());
        }
        if let Some(terrain) = node.terrain() {
            let id = PageId { cell: node.cell(), kind: PageKind::Terrain };
            let Page::Terrain(page) = whole.load(id, terrain.place).unwrap() else { panic!("no terrain") };
            assert!(page.error_m <= terrain.error_m);
            let (low_m, high_m) = node.height_range_m();
            let inside = |height_m: f32| (low_m - 0.1..=high_m + 0.1).contains(&f64::from(height_m));
            assert!(page.posts.iter().all(|post| inside(post.height_m)), "{}", node.cell());
        }
        for entry in node.objects() {
            let kind = PageKind::Objects { collection: entry.collection, rep: entry.rep };
            let Page::Objects(page, _) = whole.load(PageId { cell: node.cell(), kind }, entry.place).unwrap() else {
                panic!("no objects")
            };
            let (_, high_m) = node.height_range_m();
            assert!(page.objects.iter().all(|object| f64::from(object.top_m) <= high_m + 0.1), "{}", node.cell());
            // Blocks are as large as they are: their error bounds them.
            let is_told = |dimension_m: f32| f64::from(dimension_m) <= entry.dimension_m + 0.1;
            assert!(entry.rep > 0 || page.objects.iter().all(|object| is_told(object.dimension_m)));
            assert!(f64::from(page.error_m) <= entry.error_m + 0.1 || entry.rep == 0);
        }
    }
}

/// The second world's plain lies 250 m above the first one's hills, where one of its towns stands.
#[test]
fn sets_of_both_stand_on_the_ground_that_is_drawn() {
    let (_folder, worlds) = two();
    let whole = World::stack(&worlds).unwrap();
    let names: Vec<_> = whole.manifest().collections.iter().map(|info| info.name.clone()).collect();
    assert_eq!(names, ["town", "town (two)", "east"]);
    let mut moved = 0;
    for (collection, own) in [(0, (0, 0)), (1, (1, 0)), (2, (1, 1))] {
        let (pages, own_pages) = (objects(&whole, collection), objects(&worlds[own.0], own.1));
        let count = |pages: &[Arc<ObjectPage>]| pages.iter().map(|page| page.objects.len()).sum::<usize>();
        assert_eq!((count(&pages), pages.len()), (count(&own_pages), own_pages.len()));
        for (page, own_page) in pages.iter().zip(&own_pages) {
            assert_eq!((page.collection, page.root), (collection, own_page.root));
            for (object, own) in page.objects.iter().zip(&own_page.objects) {
                // Bases were taken from the sources: drawn ground of the own world is off them by its error.
                let (ground_m, error_m) = ground_m(&whole, object.lat_rad, object.lon_rad);
                let slack_m = error_m + 0.1;
                let off_m = (f64::from(object.base_m) - ground_m).abs();
                assert!(slack_m < 30.0 && off_m < slack_m, "{} at {ground_m}, {error_m}", object.base_m);
                let high = |object: &stoop::content::Object| object.top_m - object.base_m;
                assert!((f64::from(high(object)) - f64::from(high(own))).abs() < slack_m);
                moved += u32::from((object.base_m - own.base_m).abs() > 100.0);
            }
            // No corner floats.
            for (cell, object) in page.cells.iter().flat_map(|cell| cell.objects.clone().map(move |at| (cell, at))) {
                let object = &page.objects[object as usize];
                let (ground_m, error_m) = ground_m(&whole, object.lat_rad, object.lon_rad);
                assert!(f64::from(cell.height_range_m.0) <= ground_m + error_m + 0.1);
            }
        }
    }
    assert_eq!(moved, 100, "the town that the plain carried");
}

#[test]
fn prisms_and_attributes_are_those_of_the_right_world() {
    let (_folder, worlds) = two();
    let whole = World::stack(&worlds).unwrap();
    let mut seen = [0; 3];
    for (id, place) in pages(&whole) {
        // Groups and simpler outlines carry no attributes.
        let PageKind::Objects { collection, rep: 0 } = id.kind else { continue };
        let bytes = whole.read(id, place).unwrap();
        let prisms = whole.prisms(id, place, &bytes).unwrap();
        let Page::Objects(page, _) = whole.load(id, place).unwrap() else { panic!("no objects") };
        let tops = |page: &ObjectPage| page.objects.iter().map(|object| object.top_m).collect::<Vec<_>>();
        assert_eq!(prisms.prisms.iter().map(|prism| prism.top_m).collect::<Vec<_>>(), tops(&page));
        assert_eq!((prisms.collection, prisms.id()), (collection, id));
        let texts = whole.attributes(id, place, &bytes).unwrap();
        assert_eq!(texts.len(), prisms.prisms.len());
        let tallest =
            texts.iter().filter_map(|text| text.split([':', '}']).nth(1)?.parse::<f64>().ok()).fold(0.0, f64::max);
        let expected = [40.0, 300.0, 60.0][usize::from(collection)];
        assert_eq!(tallest, expected, "{texts:?}");
        seen[usize::from(collection)] += 1;
    }
    assert!(seen.iter().all(|&count| count > 0));
    // A page that lies at another's place is told by its own file and offset.
    let (id, place) =
        pages(&whole).into_iter().find(|(id, _)| id.kind == PageKind::Objects { collection: 2, rep: 0 }).unwrap();
    let other = PageId { kind: PageKind::Objects { collection: 1, rep: 0 }, ..id };
    let error = whole.load(other, place).err().unwrap();
    assert!(
        matches!(&error, StoreError::Page { file, .. } if file.components().any(|part| part.as_os_str() == "two")),
        "{error}"
    );
}

#[test]
fn a_world_more_changes_no_page_of_the_others() {
    let (folder, mut worlds) = two();
    let before = World::stack(&worlds).unwrap();
    make(folder.path(), &folder.path().join("three"), &set("both", "both.geojson"));
    worlds.push(Arc::new(World::open(&folder.path().join("three")).unwrap()));
    let after = before.stack_further(&worlds).unwrap();
    for (id, place) in pages(&before) {
        // By the places of before and by those of now, each may still be under way.
        let bytes = before.read(id, place).unwrap();
        assert_eq!(after.read(id, place).unwrap(), bytes);
        let now = after.place(id).unwrap();
        assert_eq!(after.read(id, now).unwrap(), bytes);
        assert!(after.load(id, place).is_ok() && after.load(id, now).is_ok());
    }
    assert_eq!(after.manifest().collections.len(), 4);
    assert!(pages(&after).len() > pages(&before).len());
    // From one world to two as well.
    let one = World::stack(&worlds[..1]).unwrap();
    let two = worlds[0].stack_further(&worlds[..2]).unwrap();
    for (id, place) in pages(&one) {
        assert_eq!(worlds[0].read(id, place).unwrap(), two.read(id, place).unwrap());
    }
}

#[test]
fn what_cannot_lie_over_another_says_so() {
    let (folder, worlds) = two();
    let paged = Arc::new(World::open_paged(&folder.path().join("two"), 0).unwrap());
    let text = World::stack(&[worlds[0].clone(), paged]).err().unwrap().to_string();
    assert!(text.contains("two") && text.contains("too large") && text.contains("open it alone"), "{text}");
    let many = vec![worlds[0].clone(); stoop::store::STACK_WORLDS_MAX + 1];
    let text = World::stack(&many).err().unwrap().to_string();
    assert!(text.contains("one more than the 16"), "{text}");
    assert!(World::stack(&many[..16]).is_ok());
}

/// Both rows of houses in the west, a few pixels large each.
fn wide_view() -> View {
    let near = view(-84.395, 33.6, 2500.0);
    View::new(near.pose, near.fov_y_rad, [640, 360])
}

fn view(lon_deg: f64, lat_deg: f64, height_m: f64) -> View {
    let pose = Pose { eye: Geodetic::from_degrees(lat_deg, lon_deg, height_m), heading_rad: 0.0, pitch_rad: -1.2 };
    View::new(pose, 1.0, [160, 90])
}

#[test]
fn both_sets_are_drawn_and_a_flight_over_them_has_no_hole() {
    let (_folder, worlds) = two();
    let source = Source::over(&worlds).unwrap();
    let home = bookmarks(&source.manifest, &source.index);
    assert_eq!(home.len(), 4, "{home:?}");
    let settled = EngineParams { mode: Mode::Settled, ..EngineParams::default() };
    let mut still = Engine::new(source.clone(), settled).unwrap();
    for (lon_deg, lat_deg, least) in [(-84.39, 33.6, 30), (-84.40, 33.62, 30), (24.91, 60.17, 30)] {
        let request = FrameRequest { view: view(lon_deg, lat_deg - 0.002, 900.0), t_s: 0.0, ids: false };
        let report = still.frame(&request).unwrap();
        assert!(report.objects_drawn > least, "{lon_deg} {lat_deg}: {report:?}");
        assert_eq!((report.failed, report.pages_missing), (0, 0));
    }
    let mut engine = Engine::new(source, EngineParams::default()).unwrap();
    let mut holes = 0;
    for frame in 0..60 {
        let way = f64::from(frame) / 59.0;
        let height_m = 2.0e6f64.powf(1.0 - way) * 700f64.powf(way);
        let view = view(-84.40 + 0.01 * way, 33.60 + 0.015 * way, height_m);
        let request = FrameRequest { view, t_s: f64::from(frame) / 30.0, ids: frame % 6 == 0 };
        let mut report = engine.frame(&request).unwrap();
        if request.ids {
            engine.audit(&request, &mut report).unwrap();
            holes += report.holes.unwrap();
        }
        assert_eq!(report.failed, 0);
    }
    assert_eq!(holes, 0);
}

#[test]
fn a_hidden_set_is_neither_read_nor_drawn_and_comes_back() {
    let (_folder, worlds) = two();
    let source = Source::over(&worlds).unwrap();
    let hidden = CollectionSet::NONE.with(0).with(1);
    let settled = EngineParams { mode: Mode::Settled, ..EngineParams::default() };
    let request = FrameRequest { view: wide_view(), t_s: 0.0, ids: false };
    let drawn = |hidden| {
        let mut engine = Engine::new(source.clone(), EngineParams { hidden, ..settled }).unwrap();
        let report = engine.frame(&request).unwrap();
        (report.objects_drawn, report.bytes_read)
    };
    let (all, first, second, none) =
        (drawn(CollectionSet::NONE), drawn(hidden.without(0)), drawn(hidden.without(1)), drawn(hidden));
    assert!(first.0 > 20 && second.0 > 20, "{first:?} {second:?}");
    assert_eq!((all.0, none.0), (first.0 + second.0, 0));
    assert!(none.1 < first.1 && none.1 < second.1 && first.1.max(second.1) < all.1);
}

/// As in a window: the world is added between two frames, and what was drawn stays drawn.
#[test]
fn a_world_is_added_while_flying() {
    let (folder, worlds) = two();
    make(folder.path(), &folder.path().join("three"), &set("both", "both.geojson"));
    let third = Arc::new(World::open(&folder.path().join("three")).unwrap());
    let params = EngineParams::default();
    let (source, view) = (Source::shared(&worlds[0]), wide_view());
    let limits = Live::gpu_limits(&source, &params).unwrap();
    let mut live = Live::start(source, params, Renderer::new(limits).unwrap(), view, Box::new(|| {})).unwrap();
    let mut t_s = 0.0;
    let mut settle = |live: &mut Live, view: &View| {
        let started = Instant::now();
        loop {
            t_s += 1.0 / 30.0;
            let report = live.frame(view, t_s, Pace::Resting).unwrap();
            assert_eq!((report.failed, live.take_messages()), (0, Vec::new()));
            let stats = &live.list().selection.stats;
            if live.list().view.pose == view.pose && stats.pages_missing == 0 && !live.has_uploads() && t_s > 1.0 {
                return report.objects_drawn;
            }
            assert!(started.elapsed() < Duration::from_secs(120), "{stats:?}");
        }
    };
    let alone = settle(&mut live, &view);
    let (pages, mut whole) = (live.list().pages.terrain.resident, worlds[0].clone());
    for count in 2..=3 {
        let all: Vec<_> = worlds.iter().chain([&third]).take(count).cloned().collect();
        whole = Arc::new(whole.stack_further(&all).unwrap());
        live.set_source(Source::shared(&whole)).unwrap();
    }
    let started = Instant::now();
    let both = loop {
        let drawn = settle(&mut live, &view);
        // The list of the new source may be on its way still.
        if drawn > alone + 20 || started.elapsed() > Duration::from_secs(120) {
            break drawn;
        }
    };
    assert!(alone > 20 && both > alone + 20, "{alone} alone, {both} with the second world's");
    assert!(live.list().pages.terrain.resident >= pages, "what was resident stays");
    assert_eq!(live.source().manifest.collections.len(), 4);
    let away = view_at(-90.0, 39.998);
    assert!(settle(&mut live, &away) > 20, "the third world's");
}

fn view_at(lon_deg: f64, lat_deg: f64) -> View {
    view(lon_deg, lat_deg, 900.0)
}
