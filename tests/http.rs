//! Worlds behind addresses, over a web server in this process: the same bytes as in a folder, one request for a run of
//! pages, one version of each file, and nothing that hangs or is lost when the server goes wrong.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on should stop")]

mod towns;
mod web;

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};
use stoop::camera::{Pose, View};
use stoop::content::{PageFile, PageId, PageKind};
use stoop::engine::{Engine, EngineParams, FrameReport, FrameRequest, Mode, Source};
use stoop::forest::Zone;
use stoop::forest::index::Place;
use stoop::geodesy::Geodetic;
use stoop::store::{DiskCache, OpenOptions, PageRange, StoreError, World};
use stoop::units::ByteSize;
use towns::pages;
use web::{Manners, Web};

/// Longer than any machine needs for what a test waits for.
const LONG: Duration = Duration::from_secs(180);
const SIZE_PX: [u32; 2] = [160, 90];
const MIB: u64 = 1 << 20;

/// A folder with two worlds, `one` and `two`.
fn worlds() -> &'static Path {
    static WORLDS: OnceLock<tempfile::TempDir> = OnceLock::new();
    let folder = WORLDS.get_or_init(|| {
        let folder = towns::sources();
        let picture = image::RgbImage::from_fn(256, 128, |x, y| image::Rgb([(x / 2) as u8, 2 * y as u8, 90]));
        picture.save(folder.path().join("globe.png")).unwrap();
        let globe = "[[imagery]]\nfile = \"globe.png\"\nbounds_deg = [-180, -90, 180, 90]\n";
        let near = "[[imagery]]\nfile = \"globe.png\"\nbounds_deg = [-85, 33, -84, 34]\n";
        let one = globe.to_owned() + near + &towns::set("west", "west.geojson") + &towns::set("east", "east.geojson");
        towns::make(folder.path(), &folder.path().join("one"), &one);
        towns::make(folder.path(), &folder.path().join("two"), &towns::set("near", "near.geojson"));
        folder
    });
    folder.path()
}

fn local() -> World {
    World::open_whole(&worlds().join("one")).unwrap()
}

/// A server of both worlds, and the address of the first.
fn served() -> (Web, PathBuf) {
    let web = Web::serve(worlds());
    let url = web.url("one");
    (web, url)
}

/// Some page of the first town.
fn a_page(world: &World) -> (PageId, Place) {
    pages(world).into_iter().rfind(|(id, _)| matches!(id.kind, PageKind::Objects { .. })).unwrap()
}

fn pack_of(page: PageId) -> String {
    format!("one/packs/{:02}.pack", page.cell.zone().index())
}

/// Down to the first town; `way` from 0 to 1.
fn view(way: f64) -> View {
    let eye = Geodetic::from_degrees(33.595, -84.39, 3e6 * (400f64 / 3e6).powf(way));
    let pose = Pose { eye, heading_rad: 0.2, pitch_rad: -1.5 + 0.9 * way };
    View::new(pose, 60f64.to_radians(), SIZE_PX)
}

fn engine(world: World, mode: Mode) -> Engine {
    Engine::new(Source::of(world), EngineParams { mode, ..EngineParams::default() }).unwrap()
}

fn frame(engine: &mut Engine, way: f64, t_s: f64) -> FrameReport {
    engine.frame(&FrameRequest { view: view(way), t_s, ids: false }).unwrap()
}

/// Flies down and gives the sum of requests, of bytes read, and of failures; the last frame's picture is that of the end.
fn fly(engine: &mut Engine, frames: u32) -> (u64, u64, u64) {
    let reports = (0..=frames).map(|at| frame(engine, f64::from(at) / f64::from(frames), f64::from(at) / 60.0));
    reports.fold((0, 0, 0), |sum, report| (sum.0 + report.requests, sum.1 + report.bytes_read, sum.2 + report.failed))
}

fn picture(world: World) -> Vec<u8> {
    let mut engine = engine(world, Mode::Settled);
    fly(&mut engine, 3);
    engine.picture().read_color().unwrap()
}

/// Frames of the end of the flight on the real clock until `done`; gives their sums of requests, bytes and failures.
fn until(engine: &mut Engine, start: Instant, done: impl Fn(&FrameReport, u64) -> bool) -> (u64, u64, u64) {
    let (begun, mut sum) = (Instant::now(), (0, 0, 0));
    loop {
        let report = frame(engine, 1.0, 1.0 + start.elapsed().as_secs_f64());
        sum = (sum.0 + report.requests, sum.1 + report.bytes_read, sum.2 + report.failed);
        if done(&report, sum.2) {
            return sum;
        }
        assert!(begun.elapsed() < LONG, "{report:?}");
    }
}

fn is_sharp(report: &FrameReport) -> bool {
    report.pages_missing == 0 && report.debt_px == 0.0 && report.in_flight == 0 && report.objects_drawn > 0
}

/// Requests for pages.
fn page_requests(web: &Web) -> Vec<web::Asked> {
    web.take_asked().into_iter().filter(|asked| asked.path.contains("/packs/")).collect()
}

fn bytes_of(asked: &[web::Asked]) -> u64 {
    asked.iter().map(|asked| asked.range.as_ref().map_or(0, |range| range.end - range.start)).sum()
}

#[test]
fn every_page_is_the_same_as_in_the_folder() {
    let (web, url) = served();
    let (local, remote) = (local(), World::open_whole(&url).unwrap());
    assert_eq!(local.manifest(), remote.manifest());
    assert!(remote.is_remote() && remote.notice().is_none() && !local.is_remote());
    let known = pages(&local);
    assert_eq!(known, pages(&remote));
    assert!(known.len() > 200);
    for &(id, place) in &known {
        assert_eq!(local.read(id, place).unwrap(), remote.read(id, place).unwrap(), "{id:?}");
        assert_eq!(remote.load(id, place).unwrap().id(), id);
    }
    assert!(web.take_asked().iter().all(|asked| asked.range.is_some() || asked.path == "one/world.json"));
    let verified = remote.verify(&mut |_, _| {});
    assert!(verified.problems.is_empty() && verified.pages == known.len() as u64, "{:?}", verified.problems);
}

#[test]
fn a_world_opens_with_one_request_for_its_manifest_and_one_for_each_index() {
    let (web, url) = served();
    let world = World::open(&url).unwrap();
    let asked = web.take_asked();
    let indexes: BTreeSet<&str> =
        asked.iter().map(|asked| &*asked.path).filter(|path| path.contains("/index/")).collect();
    assert_eq!(indexes.len(), world.manifest().zones.len());
    // The manifest is looked at once more when all is open.
    assert_eq!(asked.len(), indexes.len() + 2);
}

#[test]
fn the_index_may_be_paged_over_the_network() {
    let (_web, url) = served();
    let (local, remote) = (World::open_paged(&worlds().join("one"), 0).unwrap(), World::open_paged(&url, 0).unwrap());
    assert!(!remote.index().is_whole());
    let mut segments = 0;
    for tree in local.index().trees() {
        for entry in tree.directory().entries() {
            let id = PageId { cell: entry.root, kind: PageKind::Segment };
            let place = Place { offset: entry.offset, len: entry.byte_len() as u32 };
            assert_eq!(local.read(id, place).unwrap(), remote.read(id, place).unwrap());
            assert_eq!(remote.load(id, place).unwrap().id(), id);
            segments += 1;
        }
    }
    assert!(segments > remote.index().trees().count());
    let whole = remote.whole_index().unwrap();
    assert_eq!(whole.byte_len(), self::local().index().byte_len());
}

#[test]
fn a_run_of_pages_is_one_request() {
    for mode in [Mode::LockStep, Mode::Settled] {
        let (web, url) = served();
        let world = World::open(&url).unwrap();
        let pictures = world.index().trees().filter(|tree| tree.root().imagery().is_some()).count() as u64;
        drop(web.take_asked());
        let mut engine = engine(world, mode);
        let (requests, bytes, failed) = fly(&mut engine, 30);
        let asked = page_requests(&web);
        // The zones' pictures are read for the world image too, which is none of the request manager's.
        assert_eq!((asked.len() as u64, failed), (requests + pictures, 0), "{mode:?}");
        assert_eq!(bytes_of(&asked), bytes, "{mode:?}");
        let pages = engine.frame(&FrameRequest { view: view(1.0), t_s: 2.0, ids: false }).unwrap().resident_pages;
        assert!(requests < pages, "{requests} requests for {pages} pages");
    }
}

#[test]
fn pictures_are_the_same_as_over_the_folder() {
    let (_web, url) = served();
    assert!(picture(World::open(&url).unwrap()) == picture(local()));
}

#[test]
fn a_live_flight_ends_with_everything_drawn() {
    let (web, url) = served();
    web.delay(Duration::from_millis(5));
    let mut engine = engine(World::open(&url).unwrap(), Mode::Live);
    let pictures = page_requests(&web);
    let start = Instant::now();
    let flown = fly(&mut engine, 60);
    let ended = until(&mut engine, start, |report, _| is_sharp(report));
    assert_eq!((flown.2 + ended.2, engine.take_failures().len()), (0, 0));
    let asked = page_requests(&web);
    // Runs that were cancelled before their turn were never asked for.
    assert!(!asked.is_empty() && asked.len() as u64 <= flown.0 + ended.0);
    // What was read before the flight is counted in its first frame.
    assert_eq!(bytes_of(&asked) + bytes_of(&pictures), flown.1 + ended.1);
}

#[test]
fn frames_go_on_while_the_server_is_dead_and_all_comes_when_it_is_back() {
    let (web, url) = served();
    let mut engine = engine(World::open(&url).unwrap(), Mode::Live);
    let start = Instant::now();
    frame(&mut engine, 0.0, 0.0);
    web.behave(Manners::Dead);
    fly(&mut engine, 30);
    let failed = until(&mut engine, start, |report, failed| failed > 0 && report.pages_missing > 0).2;
    let told = engine.take_failures();
    assert!(failed > 0 && told.iter().all(|text| text.contains(url.to_str().unwrap())), "{told:?}");
    web.behave(Manners::Good);
    until(&mut engine, start, |report, _| is_sharp(report));
    let settled = picture(local());
    assert!(engine.picture().read_color().unwrap() == settled, "nothing is left out in the end");
}

#[test]
fn an_engine_ends_while_the_server_hangs() {
    let (web, url) = served();
    let mut engine = engine(World::open(&url).unwrap(), Mode::Live);
    web.delay(Duration::from_secs(3600));
    fly(&mut engine, 10);
    let begun = Instant::now();
    drop(engine);
    assert!(begun.elapsed() < LONG);
}

#[test]
fn a_changed_file_is_an_error_and_none_of_its_bytes_are_given() {
    for manners in [Manners::Good, Manners::IgnoresIfMatch, Manners::WeakETag, Manners::NoETag] {
        let (web, url) = served();
        web.behave(manners);
        let world = World::open(&url).unwrap();
        let (id, place) = a_page(&world);
        world.read(id, place).unwrap();
        web.change(&pack_of(id));
        for _ in 0..2 {
            let error = world.read(id, place).unwrap_err();
            assert!(matches!(error, StoreError::Changed { .. }) && !error.is_transient(), "{manners:?}: {error}");
            assert!(error.to_string().contains("open it again") && error.to_string().contains("packs/"), "{error}");
        }
        // Files of other zones are what they were; opened again, all is.
        let (other, at) = pages(&world).into_iter().find(|(other, _)| other.cell.zone() != id.cell.zone()).unwrap();
        world.read(other, at).unwrap();
        World::open(&url).unwrap().read(id, place).unwrap();
    }
}

#[test]
fn nothing_of_a_changed_world_is_drawn() {
    let (web, url) = served();
    let mut engine = engine(World::open(&url).unwrap(), Mode::Settled);
    let before = frame(&mut engine, 0.0, 0.0);
    let world = local();
    pages(&world).iter().map(|page| pack_of(page.0)).collect::<BTreeSet<_>>().iter().for_each(|pack| web.change(pack));
    let report = frame(&mut engine, 1.0, 1.0);
    assert!(report.failed > 0 && report.resident_pages <= before.resident_pages, "{report:?}");
    assert!(engine.take_failures().iter().all(|text| text.contains("has changed on the server")));
}

#[test]
fn a_world_that_changes_while_it_is_opened_is_opened_as_one_of_both() {
    let (one, two) = (worlds().join("one"), worlds().join("two"));
    let manifests = [&one, &two].map(|folder| World::open(folder).unwrap().manifest().clone());
    let mut seen = [0; 2];
    let requests = manifests[0].zones.len() + 2;
    for after in (0..4).chain(requests - 2..requests + 1) {
        let web = Web::serve(&one);
        web.move_after(after, &two);
        let url = format!("{}/", web.address());
        let world = World::open_whole(Path::new(&url)).unwrap();
        let which = manifests.iter().position(|manifest| manifest == world.manifest()).unwrap();
        seen[which] += 1;
        // Only what was read whole before the change is of the old one.
        assert_eq!(which == 0, after >= requests, "{after}");
        if which == 1 {
            assert!(world.verify(&mut |_, _| {}).problems.is_empty());
        }
    }
    assert!(seen[0] > 0 && seen[1] > 0);
}

/// Opens and reads a page; the error's text.
fn failure(url: &Path) -> (String, bool) {
    let read = || {
        let world = World::open(url)?;
        let (id, place) = a_page(&local());
        world.read(id, place)
    };
    let error = read().unwrap_err();
    assert!(error.to_string().starts_with("http://"), "{error}");
    (error.to_string(), error.is_transient())
}

#[test]
fn what_is_wrong_is_told_with_the_address_and_the_remedy() {
    let (web, url) = served();
    for (manners, said, is_transient) in [
        (Manners::Status(500), "the server answers 500; check the network", true),
        (Manners::Status(503), "the server answers 503", true),
        (Manners::Status(403), "does not let it be read", false),
        (Manners::Status(401), "does not let it be read", false),
        (Manners::Status(400), "the server answers 400", false),
        (Manners::Status(404), "there is no world.json", false),
        (Manners::Dead, "check the network and the address", true),
        (Manners::BreaksOff, "check the network and the address", true),
        (Manners::IgnoresRange, "sends whole files only", false),
    ] {
        web.behave(manners);
        let (text, transient) = failure(&url);
        let said = if manners == Manners::Status(404) { "no world here" } else { said };
        assert!(text.contains(said) && transient == is_transient, "{manners:?}: {text}");
        assert!(!text.contains("html"), "{text}");
    }
    web.behave(Manners::Good);
    World::open(&url).unwrap();
    let (text, _) = failure(&web.url("nowhere"));
    assert!(text.contains("no world here") && text.contains("nowhere"), "{text}");
    let nobody = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let (text, transient) = failure(Path::new(&format!("http://{nobody}/w")));
    assert!(text.contains("no connection") && transient, "{text}");
    let error = World::open(Path::new("ftp://host/w")).err().unwrap().to_string();
    assert!(error.contains("ftp") && error.contains("s3://BUCKET"), "{error}");
}

#[test]
fn bytes_that_do_not_come_are_asked_for_again() {
    for manners in [Manners::BreaksOff, Manners::Status(500), Manners::Status(429), Manners::Dead] {
        let (web, url) = served();
        let world = World::open(&url).unwrap();
        let (id, place) = a_page(&world);
        drop(web.take_asked());
        web.behave_for(2, manners);
        assert_eq!(world.read(id, place).unwrap(), local().read(id, place).unwrap(), "{manners:?}");
        assert_eq!(web.take_asked().len(), 3, "{manners:?}");
    }
}

#[test]
fn fewer_bytes_than_announced_are_no_page() {
    let (web, url) = served();
    let world = World::open(&url).unwrap();
    let (id, place) = a_page(&world);
    web.behave(Manners::Short);
    let error = world.read(id, place).unwrap_err();
    assert!(error.is_transient() && error.to_string().contains("bytes came"), "{error}");
    web.behave(Manners::Good);
    world.read(id, place).unwrap();
    // Beyond the end of the file there is nothing, now and later; the file may end inside of what is asked for.
    let len = fs::metadata(worlds().join(pack_of(id))).unwrap().len();
    for offset in [len + 1000, len - 5] {
        let error = world.read(id, Place { offset, len: 100 }).unwrap_err();
        assert!(!error.is_transient() && error.to_string().contains("it ends before"), "{error}");
    }
}

#[test]
fn a_missing_pack_costs_its_pages_only() {
    let copy = tempfile::tempdir().unwrap();
    copy_folder(&worlds().join("one"), &copy.path().join("one"));
    let (id, place) = a_page(&local());
    fs::remove_file(copy.path().join(pack_of(id))).unwrap();
    let web = Web::serve(copy.path());
    let world = World::open(&web.url("one")).unwrap();
    let error = world.read(id, place).unwrap_err();
    assert!(!error.is_transient() && error.to_string().contains("not on the server"), "{error}");
    let (other, at) = pages(&world).into_iter().find(|(other, _)| other.cell.zone() != id.cell.zone()).unwrap();
    world.read(other, at).unwrap();
}

fn copy_folder(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for file in fs::read_dir(from).unwrap().map(|file| file.unwrap().path()) {
        let target = to.join(file.file_name().unwrap());
        if file.is_dir() { copy_folder(&file, &target) } else { assert!(fs::copy(&file, &target).is_ok()) }
    }
}

#[test]
fn files_that_a_change_added_are_found_and_read_as_one_row() {
    let copy = tempfile::tempdir().unwrap();
    let folder = copy.path().join("one");
    copy_folder(&worlds().join("one"), &folder);
    let text = format!("name = \"sets\"\n{}", towns::set("near", "near.geojson"));
    let recipe = stoop::prepare::Recipe::parse(&text, &worlds().join("into.toml")).unwrap();
    let options = stoop::prepare::into::IntoOptions { world: folder.clone(), root: None, memory: ByteSize(64 << 20) };
    towns::watched(&|| true, |control| stoop::prepare::into::build_into(&recipe, &options, control)).unwrap();
    let web = Web::serve(copy.path());
    let (near, far) = (World::open(&folder).unwrap(), World::open(&web.url("one")).unwrap());
    assert_eq!((near.manifest().additions.generation, pages(&near)), (1, pages(&far)));
    for (id, place) in pages(&near) {
        assert_eq!(near.read(id, place).unwrap(), far.read(id, place).unwrap(), "{id:?}");
    }
    // The last page of the first pack and the first of the second, as one run: a request for each file.
    let files = near.manifest().additions.zones.iter().find(|files| files.packs.len() == 2).unwrap();
    let (zone, starts) = (Zone::new(files.zone).unwrap(), files.packs[0].bytes);
    let mut places: Vec<Place> =
        pages(&near).iter().filter(|page| page.0.cell.zone() == zone).map(|page| page.1).collect();
    places.sort_by_key(|place| place.offset);
    let second = places.iter().position(|place| place.offset >= starts).unwrap();
    let pair = &places[second - 1..=second];
    let len = (pair[1].offset + u64::from(pair[1].len) - pair[0].offset) as u32;
    let range = PageRange { zone, file: PageFile::Pack, place: Place { offset: pair[0].offset, len }, pages: pair };
    drop(web.take_asked());
    assert_eq!(near.read_range(&range).unwrap(), far.read_range(&range).unwrap());
    assert_eq!(web.take_asked().len(), 2);
    // Such a world is changed where it lies.
    let options = stoop::prepare::into::IntoOptions { world: web.url("one"), ..options };
    let refused = towns::watched(&|| true, |control| stoop::prepare::into::build_into(&recipe, &options, control));
    let text = refused.unwrap_err().to_string();
    assert!(text.contains("cannot be changed"), "{text}");
}

#[test]
fn near_and_far_worlds_lie_over_one_another() {
    let web = Web::serve(worlds());
    let open = |names: [PathBuf; 2]| {
        let worlds: Vec<Arc<World>> = names.iter().map(|name| Arc::new(World::open(name).unwrap())).collect();
        World::stack(&worlds).unwrap()
    };
    let near = open([worlds().join("two"), worlds().join("one")]);
    let mixed = open([web.url("two"), worlds().join("one")]);
    assert!(mixed.is_remote());
    assert_eq!(pages(&near), pages(&mixed));
    for (id, place) in pages(&near) {
        let bytes = near.read(id, place).unwrap();
        assert_eq!(bytes, mixed.read(id, place).unwrap());
        let range = PageRange { zone: id.cell.zone(), file: PageFile::Pack, place, pages: &[place] };
        assert_eq!(bytes, mixed.read_range(&range).unwrap());
    }
    // Terrain of the one with pictures of the other: neighbours that are read as one run, from two worlds.
    let mut spliced: Vec<(PageId, Place)> =
        pages(&mixed).into_iter().filter(|(_, place)| place.offset >= 1 << 39).collect();
    spliced.sort_by_key(|(id, place)| (id.cell.zone(), place.offset));
    let pair = spliced.windows(2).find(|pair| pair[0].1.offset + u64::from(pair[0].1.len) == pair[1].1.offset).unwrap();
    let places = [pair[0].1, pair[1].1];
    let place = Place { offset: places[0].offset, len: places[0].len + places[1].len };
    let range = PageRange { zone: pair[0].0.cell.zone(), file: PageFile::Pack, place, pages: &places };
    let both: Vec<u8> = pair.iter().flat_map(|&(id, place)| near.read(id, place).unwrap()).collect();
    assert_eq!(mixed.read_range(&range).unwrap(), both);
    assert!(picture(mixed) == picture(near));
}

fn kept_in(folder: &Path, limit: u64) -> OpenOptions {
    let cache = DiskCache::open(folder, ByteSize(limit)).unwrap();
    OpenOptions { cache: Some(Arc::new(cache)), ..OpenOptions::default() }
}

fn on_disk(folder: &Path) -> u64 {
    let files = fs::read_dir(folder).unwrap().map(|file| file.unwrap().metadata().unwrap().len());
    files.map(|len| len.next_multiple_of(4096)).sum()
}

#[test]
fn a_world_flown_once_is_read_from_the_cache_and_opens_while_the_server_is_dead() {
    let (web, url) = served();
    let folder = tempfile::tempdir().unwrap();
    let open = || World::open_with(&url, &kept_in(folder.path(), 64 * MIB)).unwrap();
    let first = picture(open());
    assert!(!page_requests(&web).is_empty());
    let world = open();
    assert!(world.notice().is_none());
    assert!(picture(world) == first);
    let asked = web.take_asked();
    assert!(asked.iter().all(|asked| asked.path == "one/world.json"), "{asked:?}");
    web.behave(Manners::Dead);
    let world = open();
    let notice = world.notice().unwrap();
    assert!(notice.contains("from the cache") && notice.contains(url.to_str().unwrap()), "{notice}");
    assert!(picture(world) == first);
    // What was never read is missing, and comes with the server.
    let world = open();
    let zone = a_page(&world).0.cell.zone();
    let elsewhere = pages(&world).into_iter().filter(|page| page.0.cell.zone() != zone);
    let (id, place) = elsewhere.max_by_key(|page| page.0.cell.level()).unwrap();
    assert!(world.read(id, place).is_err_and(|error| error.is_transient()));
    web.behave(Manners::Good);
    assert_eq!(world.read(id, place).unwrap(), local().read(id, place).unwrap());
}

#[test]
fn pages_are_found_in_the_cache_whatever_run_they_came_in() {
    let (web, url) = served();
    let folder = tempfile::tempdir().unwrap();
    let world = World::open_with(&url, &kept_in(folder.path(), 64 * MIB)).unwrap();
    let zone = a_page(&world).0.cell.zone();
    let mut places: Vec<Place> =
        pages(&world).iter().filter(|page| page.0.cell.zone() == zone).map(|page| page.1).collect();
    places.sort_by_key(|place| place.offset);
    let read = |pages: &[Place]| {
        let (first, last) = (pages[0], pages[pages.len() - 1]);
        let len = (last.offset + u64::from(last.len) - first.offset) as u32;
        let place = Place { offset: first.offset, len };
        world.read_range(&PageRange { zone, file: PageFile::Pack, place, pages }).unwrap()
    };
    let whole = read(&places[2..10]);
    drop(web.take_asked());
    let inner = read(&places[4..7]);
    let at = (places[4].offset - places[2].offset) as usize;
    assert_eq!(inner, whole[at..at + inner.len()]);
    assert!(web.take_asked().is_empty());
    // Of a run that begins inside only the rest is asked for, in one request.
    read(&places[8..14]);
    let asked = web.take_asked();
    assert_eq!(asked.len(), 1);
    assert_eq!(asked[0].range, Some(places[10].offset..places[13].offset + u64::from(places[13].len)));
}

#[test]
fn the_cache_keeps_its_limit_and_reads_anew_what_is_broken() {
    let (web, url) = served();
    let folder = tempfile::tempdir().unwrap();
    let world = World::open_with(&url, &kept_in(folder.path(), MIB)).unwrap();
    let expected = local();
    for (id, place) in pages(&world) {
        assert_eq!(world.read(id, place).unwrap(), expected.read(id, place).unwrap());
        assert!(on_disk(folder.path()) <= MIB);
    }
    drop(world);
    // A byte of every entry is flipped.
    for file in fs::read_dir(folder.path()).unwrap().map(|file| file.unwrap().path()) {
        let mut bytes = fs::read(&file).unwrap();
        if let Some(last) = bytes.last_mut().filter(|_| file.extension().is_some_and(|end| end == "stoop")) {
            *last ^= 1;
            fs::write(&file, bytes).unwrap();
        }
    }
    drop(web.take_asked());
    let world = World::open_with(&url, &kept_in(folder.path(), MIB)).unwrap();
    let known = pages(&world);
    for &(id, place) in known.iter().rev().take(50) {
        assert_eq!(world.read(id, place).unwrap(), expected.read(id, place).unwrap());
    }
    assert_eq!(page_requests(&web).len(), 50);
}

#[test]
fn a_world_that_changed_is_not_mixed_with_what_is_kept_of_it() {
    let (web, url) = served();
    let folder = tempfile::tempdir().unwrap();
    let open = || World::open_with(&url, &kept_in(folder.path(), 64 * MIB)).unwrap();
    let world = open();
    let (id, place) = a_page(&world);
    world.read(id, place).unwrap();
    web.change(&pack_of(id));
    // The manifest is the same; what is kept is of the version that it was read with.
    let world = open();
    world.read(id, place).unwrap();
    let of_zone = |page: &&(PageId, Place)| page.0.cell.zone() == id.cell.zone() && page.1 != place;
    let known = pages(&world);
    let (other, at) = *known.iter().find(of_zone).unwrap();
    assert!(matches!(world.read(other, at), Err(StoreError::Changed { .. })));
    // Opened again it is the new version, and nothing of the old one is used.
    let world = open();
    drop(web.take_asked());
    world.read(id, place).unwrap();
    world.read(other, at).unwrap();
    assert_eq!(page_requests(&web).len(), 2);
}

fn stoop(arguments: &[&str], variables: &[(&str, &str)]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_stoop"));
    for name in ["AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY", "AWS_SESSION_TOKEN"] {
        command.env_remove(name);
    }
    command.args(arguments).envs(variables.iter().copied()).output().unwrap()
}

fn said(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

#[test]
fn the_programs_take_addresses_and_buckets() {
    let (web, url) = served();
    let (url, cache) = (url.to_str().unwrap(), tempfile::tempdir().unwrap());
    let kept = cache.path().join("kept");
    let local = stoop(&["info", worlds().join("one").to_str().unwrap()], &[]);
    assert!(local.status.success());
    let arguments = ["info", url, "--cache", kept.to_str().unwrap(), "--cache-limit", "16MiB"];
    assert_eq!(said(&stoop(&arguments, &[]).stdout), said(&local.stdout));
    // A bucket is a folder of the server.
    let variables = [("AWS_ENDPOINT_URL", &*web.address()), ("AWS_REGION", "eu-north-1")];
    assert_eq!(said(&stoop(&["info", "s3://one"], &variables).stdout), said(&local.stdout));
    // Buckets of another server have nothing to do with what is kept of this one's.
    let bucket = ["info", "s3://one", "--cache", kept.to_str().unwrap()];
    assert_eq!(said(&stoop(&bucket, &variables).stdout), said(&local.stdout));
    let nobody = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let other = stoop(&bucket, &[("AWS_ENDPOINT_URL", &*format!("http://{nobody}"))]);
    assert!(!other.status.success() && said(&other.stderr).contains("no connection"), "{}", said(&other.stderr));
    let keys = [("AWS_ACCESS_KEY_ID", "me"), ("AWS_SECRET_ACCESS_KEY", "secret")];
    let signed = stoop(&["info", "s3://one/"], &[&variables[..], &keys[..]].concat());
    assert_eq!(said(&signed.stdout), said(&local.stdout), "{}", said(&signed.stderr));
    let probe = ["--lon-deg", "-84.39", "--lat-deg", "33.6"];
    let far = stoop(&[&["probe", url], &probe[..]].concat(), &[]);
    let near = stoop(&[&["probe", worlds().join("one").to_str().unwrap()], &probe[..]].concat(), &[]);
    assert!(far.status.success() && far.stdout == near.stdout, "{}", said(&far.stderr));
    web.behave(Manners::Dead);
    let offline = stoop(&arguments, &[]);
    assert_eq!(said(&offline.stdout), said(&local.stdout));
    assert!(said(&offline.stderr).contains("from the cache"), "{}", said(&offline.stderr));
    let lost = stoop(&["info", url], &[]);
    let text = said(&lost.stderr);
    assert!(!lost.status.success() && text.lines().count() == 1 && text.contains("check the network"), "{text}");
    let lost = stoop(&["info", "s3://one"], &variables);
    assert!(said(&lost.stderr).contains("s3://one/world.json"), "{}", said(&lost.stderr));
}
