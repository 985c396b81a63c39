//! Single-seek layouts over a made-up town: sets hold what views want, a crossing is one read, broken files are refused.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on should stop")]

mod towns;
mod web;

use std::collections::HashSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::{Arc, OnceLock};
use stoop::camera::{Pose, View};
use stoop::cells::LiveTree;
use stoop::content::{PageId, PageKind};
use stoop::engine::{Engine, EngineParams, FrameRequest, Lookout, Source};
use stoop::geodesy::GeoBounds;
use stoop::layout::{
    BuildError, Builder, Built, Direction, Layout, LayoutParams, NavCell, Witness, hilbert_order, pages_of,
};
use stoop::paging::{PlannerParams, PolicyName};
use stoop::select::{SelectParams, Urgency, select};
use stoop::simulate::{Library, Setup, Simulation};
use stoop::storage::{Faults, StorageModel};
use stoop::store::{LAYOUT_BLOCK_BYTES, StoreError, World};
use stoop::units::ByteSize;
use web::Web;

const STEP_S: f64 = 1.0 / 30.0;
const SIZE_PX: [u32; 2] = [320, 180];
/// Room for the largest set and little more, MiB beyond the least footprint: what is not wanted must go.
const FOOTPRINT_MORE: u64 = 40;

/// Over the western town, 300 houses in a row.
fn region() -> GeoBounds {
    GeoBounds::from_degrees(-84.405, 33.59, -84.255, 33.61)
}

fn builder<'w>(world: &'w World, name: &str, bands_m: &[f64]) -> Builder<'w> {
    Builder {
        world,
        name: name.to_owned(),
        params: LayoutParams::for_viewport(180.0, 1.0),
        region: region(),
        bands_m: bands_m.to_vec(),
        storage: StorageModel::HDD,
        max_redundancy: 100.0,
        side_m: Some(300.0),
        starts: Vec::new(),
    }
}

fn made(world: &Path, name: &str, bands_m: &[f64]) -> Built {
    let world = World::open_whole(world).unwrap();
    let built = builder(&world, name, bands_m).build(&mut None, &|_, _, _| true).unwrap();
    assert!(built.file.as_ref().is_some_and(|file| file.exists()));
    built
}

/// A folder with a world, and the layout `high` in it.
fn folder() -> &'static Path {
    static FOLDER: OnceLock<tempfile::TempDir> = OnceLock::new();
    let folder = FOLDER.get_or_init(|| {
        let folder = towns::sources();
        image::RgbImage::from_fn(256, 128, |x, y| image::Rgb([(x / 2) as u8, 2 * y as u8, 90]))
            .save(folder.path().join("globe.png"))
            .unwrap();
        // 3.5 m a texel along the town.
        image::RgbImage::from_fn(4096, 1024, |x, y| image::Rgb([(x / 16) as u8, (y / 4) as u8, 90]))
            .save(folder.path().join("town.png"))
            .unwrap();
        let picture = |file: &str, bounds: &str| format!("[[imagery]]\nfile = \"{file}\"\nbounds_deg = {bounds}\n");
        let sets =
            picture("globe.png", "[-180, -90, 180, 90]") + &picture("town.png", "[-84.41, 33.585, -84.25, 33.625]");
        towns::make(folder.path(), &folder.path().join("world"), &(sets + &towns::set("west", "west.geojson")));
        made(&folder.path().join("world"), "high", &[50.0, 150.0, 400.0]);
        folder
    });
    folder.path()
}

fn world() -> PathBuf {
    folder().join("world")
}

/// A world of its own that a test may break.
fn copied() -> tempfile::TempDir {
    let copy = tempfile::tempdir().unwrap();
    for name in ["index", "packs", "layouts"] {
        fs::create_dir(copy.path().join(name)).unwrap();
        for file in fs::read_dir(world().join(name)).unwrap() {
            let file = file.unwrap().path();
            fs::copy(&file, copy.path().join(name).join(file.file_name().unwrap())).unwrap();
        }
    }
    fs::copy(world().join("world.json"), copy.path().join("world.json")).unwrap();
    copy
}

fn opened(world: &Path, name: &str) -> (Source, Arc<Layout>) {
    let (source, refused) = Source::with_layout(World::open_whole(world).unwrap(), name);
    assert_eq!(refused, None);
    let layout = source.layout.clone().unwrap();
    (source, layout)
}

fn library(source: &Source) -> Library {
    Library::new(source.index.clone(), source.reader.clone()).with_layout(source.layout.clone())
}

/// SplitMix64 (Steele, Lea & Flood 2014).
struct Random(u64);

impl Random {
    fn below(&mut self, end: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut word = self.0;
        word = (word ^ word >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        word = (word ^ word >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((word ^ word >> 31) % end as u64) as usize
    }

    fn share(&mut self) -> f64 {
        self.below(1 << 20) as f64 / f64::from(1 << 20)
    }
}

fn view(layout: &Layout, cell: NavCell, random: &mut Random) -> View {
    let (low_m, high_m) = layout.grid.band_m(cell.band);
    let at = |from: u32, share: f64| f64::from(from) + 0.01 + 0.98 * share;
    let above_m = low_m + (0.01 + 0.98 * random.share()) * (high_m - low_m);
    let eye = layout.grid.eye(at(cell.column, random.share()), at(cell.row, random.share()), above_m);
    let heading_rad = std::f64::consts::TAU * random.share();
    View::new(Pose { eye, heading_rad, pitch_rad: 0.3 - 1.8 * random.share() }, 60f64.to_radians(), SIZE_PX)
}

fn random_cell(layout: &Layout, random: &mut Random) -> NavCell {
    layout.grid.cell(random.below(layout.grid.cell_count()))
}

/// Whether a page is in a set, or pages of the same kind are that cover it.
fn is_served(set: &HashSet<PageId>, page: PageId, levels: u8) -> bool {
    let finer = |rep: u8| match page.kind {
        PageKind::Objects { collection, .. } => PageId { kind: PageKind::Objects { collection, rep }, ..page },
        _ => page,
    };
    let is_in = match page.kind {
        PageKind::Objects { rep, .. } => (0..=rep).any(|rep| set.contains(&finer(rep))),
        _ => set.contains(&page),
    };
    is_in || (levels > 0 && page.cell.children().all(|cell| is_served(set, PageId { cell, ..page }, levels - 1)))
}

#[test]
fn a_set_holds_what_any_view_from_its_cell_wants() {
    let (source, layout) = opened(&world(), "high");
    let mut random = Random(3);
    let (mut wanted, mut kinds) = (0, HashSet::new());
    let mut missed = Vec::new();
    for _ in 0..400 {
        let cell = random_cell(&layout, &mut random);
        let set: HashSet<PageId> = layout.set(cell).into_iter().collect();
        let view = view(&layout, cell, &mut random);
        let front = select(&source.index, &LiveTree::default(), &view, &SelectParams::DEFAULT);
        for demand in front.demands.iter().filter(|demand| demand.urgency == Urgency::Visible) {
            if !is_served(&set, demand.page, 3) {
                missed.push((demand.page, cell));
            }
            wanted += 1;
            kinds.insert(std::mem::discriminant(&demand.page.kind));
        }
    }
    assert!(wanted > 2_000 && kinds.len() == 3, "{wanted} of {} kinds", kinds.len());
    // Cells of the Earth's size that just reach over the horizon are seen from some places of a cell and not from others.
    assert!(missed.len() * 500 <= wanted, "{} of {wanted}: {missed:?}", missed.len());
}

#[test]
fn runs_hold_the_pages_of_the_packs_from_block_to_block() {
    let mut world = World::open_whole(&world()).unwrap();
    let layout = Layout::parse(&world.open_layout("high").unwrap()).unwrap();
    let grid = &layout.grid;
    let mut runs = 0;
    for from in grid.cells() {
        for to in Direction::ALL.into_iter().filter_map(|direction| grid.neighbor(from, direction)) {
            let (before, after): (HashSet<PageId>, HashSet<PageId>) =
                (layout.set(from).into_iter().collect(), layout.set(to).into_iter().collect());
            let run = layout.run(from, to);
            let added: HashSet<PageId> = run.iter().map(|(page, _)| *page).collect();
            assert_eq!(added, after.difference(&before).copied().collect());
            let Some((_, first)) = run.first() else { continue };
            assert_eq!(first.offset % LAYOUT_BLOCK_BYTES, 0);
            for pair in run.windows(2) {
                assert_eq!(pair[0].1.offset + u64::from(pair[0].1.len), pair[1].1.offset, "no gaps");
                assert!(pair[0].0.cell.level() <= pair[1].0.cell.level(), "the coarse come first");
            }
            if runs % 50 == 0 {
                for &(page, place) in &run {
                    let packed = world.place(page).unwrap();
                    assert_eq!(world.read(page, place).unwrap(), world.read(page, packed).unwrap());
                    world.load(page, place).unwrap();
                }
            }
            runs += 1;
        }
    }
    assert!(runs > 100, "{runs}");
}

/// Views in random neighbours, one after the other; `each` is told what the storage counted for a crossing, and the debt
/// after it.
fn cross(
    library: &Library,
    layout: &Layout,
    (storage, more_mib): (StorageModel, u64),
    crossings: usize,
    mut each: impl FnMut(u64, f64),
) {
    let planner = PlannerParams { policy: PolicyName::Demand, ..PlannerParams::default() };
    let footprint = ByteSize(Simulation::least_footprint(&library.index).0 + (more_mib << 20));
    let setup = Setup { planner, footprint, size_px: SIZE_PX, ..Setup::new(storage, STEP_S) };
    let mut simulation = Simulation::new(library, setup).unwrap();
    let (mut random, mut t_s) = (Random(5), 0.0);
    let mut cell = NavCell { band: 0, row: 3, column: 0 };
    for crossing in 0..=crossings {
        let before = simulation.traffic();
        let view = view(layout, cell, &mut random);
        let mut debt_px = simulation.frame(&view, t_s).report.debt_px;
        for _ in 0..600 {
            if simulation.is_settled() {
                break;
            }
            t_s += STEP_S;
            debt_px = simulation.frame(&view, t_s).report.debt_px;
        }
        assert!(simulation.is_settled(), "crossing {crossing} comes to rest");
        let after = simulation.traffic();
        let seeks = if storage.seek_only { after.seeks - before.seeks } else { after.requests - before.requests };
        if crossing > 0 {
            each(seeks, debt_px);
        } else {
            // All that the first cell needs, not what a single view does.
            for _ in 0..90 {
                t_s += STEP_S;
                simulation.frame(&view, t_s);
            }
        }
        // Only what the cell wants stays, so that each crossing has something to read.
        if storage == StorageModel::WAN {
            simulation.drop_unwanted();
        }
        t_s += STEP_S;
        // To and fro along the town, so that other pages are wanted, and dropped.
        let along = if crossing / 45 % 2 == 0 { Direction::East } else { Direction::West };
        let way = [along, Direction::ALL[random.below(6)]][random.below(2)];
        cell = layout.grid.neighbor(cell, way).unwrap_or(cell);
    }
}

#[test]
fn no_crossing_costs_more_than_one_seek_and_none_leaves_debt() {
    let (source, layout) = opened(&world(), "high");
    for storage in [StorageModel::HDD, StorageModel::WAN] {
        let (mut read, mut most, mut debts) = (0, 0, Vec::new());
        cross(&library(&source), &layout, (storage, FOOTPRINT_MORE), 600, |seeks, debt_px| {
            most = most.max(seeks);
            read += seeks;
            debts.extend((debt_px > 0.01).then_some(debt_px));
        });
        assert!(debts.is_empty(), "{read} reads, at most {most} each; debt at rest: {debts:?}");
        assert!(most == 1 && read > 50, "{read} reads, at most {most} each");
    }
    // Where sets do not fit, the packs help out: nothing is lost but the single seek.
    let mut most = 0;
    cross(&library(&source), &layout, (StorageModel::HDD, FOOTPRINT_MORE / 2), 200, |seeks, debt_px| {
        most = most.max(seeks);
        assert!(debt_px < 0.01, "{debt_px} px at rest");
    });
    assert!(most > 1, "{most}");
    // From the packs the same takes more: the figures above are not those of a world of one page.
    let packs = Library::new(source.index.clone(), source.reader.clone());
    let hilbert = Library::new(source.index.clone(), source.reader.clone());
    let hilbert = hilbert.in_order(&hilbert_order(&pages_of(&source.index))).unwrap();
    for linear in [packs, hilbert] {
        let mut most = 0;
        cross(&linear, &layout, (StorageModel::HDD, FOOTPRINT_MORE), 300, |seeks, debt_px| {
            most = most.max(seeks);
            assert!(debt_px < 0.01, "{debt_px} px at rest");
        });
        assert!(most > 1, "{most}");
    }
}

#[test]
fn diagonals_and_jumps_are_left_to_the_packs_and_counted() {
    let (source, layout) = opened(&world(), "high");
    let library = library(&source);
    let setup = Setup { size_px: SIZE_PX, ..Setup::new(StorageModel::SSD, STEP_S) };
    let mut simulation = Simulation::new(&library, setup).unwrap();
    let cells = [(2, 2, 0), (3, 3, 0), (3, 4, 0), (9, 1, 0), (9, 1, 1)];
    let mut t_s = 0.0;
    for (column, row, band) in cells {
        let view = view(&layout, NavCell { band, row, column }, &mut Random(1));
        for _ in 0..20 {
            simulation.frame(&view, t_s);
            t_s += STEP_S;
        }
        assert!(simulation.is_settled());
    }
    let counts = simulation.ride_counts().unwrap();
    // The entry, the diagonal, the jump; one step north, one up.
    assert_eq!((counts.crossings, counts.fallbacks, counts.crossing_seeks_max), (2, 3, 1), "{counts:?}");
}

#[test]
fn what_goes_wrong_with_a_run_comes_from_the_packs() {
    let (source, layout) = opened(&world(), "high");
    let library = library(&source);
    let faults = Faults { errors: 0.2, corrupt: 0.1, ..Faults::NONE };
    let setup = Setup { faults, seed: 9, size_px: SIZE_PX, ..Setup::new(StorageModel::SSD, STEP_S) };
    let mut simulation = Simulation::new(&library, setup).unwrap();
    let (mut random, mut t_s, mut failed) = (Random(11), 0.0, 0);
    let mut cell = random_cell(&layout, &mut random);
    for _ in 0..150 {
        let view = view(&layout, cell, &mut random);
        for _ in 0..10 {
            let frame = simulation.frame(&view, t_s);
            failed += frame.report.failed;
            t_s += STEP_S;
        }
        cell = layout.grid.neighbor(cell, Direction::ALL[random.below(6)]).unwrap_or(cell);
    }
    assert!(failed > 20, "{failed}");
}

fn refusal(world: &Path, name: &str) -> String {
    let (source, refused) = Source::with_layout(World::open_whole(world).unwrap(), name);
    assert!(source.layout.is_none());
    // The packs serve.
    let mut engine = Engine::new(source, EngineParams::default()).unwrap();
    let (_, layout) = opened(&self::world(), "high");
    let view = view(&layout, layout.grid.cell(0), &mut Random(2));
    engine.frame(&FrameRequest { view, t_s: 0.0, ids: false }).unwrap();
    assert!(engine.frame(&FrameRequest { view, t_s: 1.0, ids: false }).unwrap().bytes_read < 1 << 20);
    refused.unwrap()
}

#[test]
fn a_broken_file_or_one_of_another_build_is_refused_and_the_packs_serve() {
    let copy = copied();
    let file = copy.path().join("layouts/high.seek");
    let whole = fs::read(&file).unwrap();
    let broken = |at: usize| {
        let mut bytes = whole.clone();
        bytes[at] ^= 4;
        fs::write(&file, bytes).unwrap();
        refusal(copy.path(), "high")
    };
    for (at, cause) in [(1, "does not begin like a layout"), (4, "newer"), (10, "checksum"), (100, "checksum")] {
        let said = broken(at);
        assert!(said.contains(cause) && said.contains("high.seek"), "{said}");
    }
    for len in [0, 40, 100, whole.len() - 1] {
        fs::write(&file, &whole[..len]).unwrap();
        let said = refusal(copy.path(), "high");
        assert!(said.contains("cut short") || said.contains("its header tells"), "{said}");
    }
    let mut longer = whole.clone();
    longer.push(0);
    fs::write(&file, longer).unwrap();
    assert!(refusal(copy.path(), "high").contains("its header tells"));
    fs::write(&file, &whole).unwrap();
    assert!(refusal(copy.path(), "none").contains("there is no such layout"));
    assert!(refusal(copy.path(), "../high").contains("no name of a layout"));
    // Another build of the world: the same pages, another manifest.
    towns::make(folder(), &copy.path().join("other"), &towns::set("west", "west.geojson"));
    fs::create_dir(copy.path().join("other/layouts")).unwrap();
    fs::copy(&file, copy.path().join("other/layouts/high.seek")).unwrap();
    assert!(refusal(&copy.path().join("other"), "high").contains("another build"));
}

#[test]
fn a_flipped_byte_in_a_run_costs_its_page_alone() {
    let copy = copied();
    let file = copy.path().join("layouts/high.seek");
    let mut world = World::open_whole(copy.path()).unwrap();
    let layout = Layout::parse(&world.open_layout("high").unwrap()).unwrap();
    let grid = &layout.grid;
    let find = |from| {
        let next = Direction::ALL.into_iter().filter_map(move |direction| grid.neighbor(from, direction));
        next.map(move |to| (from, to))
    };
    let (from, to) = grid.cells().flat_map(find).find(|&(from, to)| layout.run(from, to).len() > 2).unwrap();
    let run = layout.run(from, to);
    // The file ends with its blocks, so that the last ones tell where the first begins.
    let mut bytes = fs::read(&file).unwrap();
    let needle = world.read(run[1].0, run[1].1).unwrap();
    for at in bytes
        .windows(needle.len())
        .enumerate()
        .filter(|(_, part)| *part == needle)
        .map(|(at, _)| at)
        .collect::<Vec<_>>()
    {
        bytes[at + 40] ^= 1;
    }
    fs::write(&file, bytes).unwrap();
    let mut world = World::open_whole(copy.path()).unwrap();
    world.open_layout("high").unwrap();
    let error = world.load(run[1].0, run[1].1).unwrap_err();
    assert!(matches!(error, StoreError::Page { .. }) && error.to_string().contains("high.seek"), "{error}");
    assert!(world.load(run[0].0, run[0].1).is_ok());
    // In flight the pack gives it.
    let (source, layout) = opened(copy.path(), "high");
    let mut engine = Engine::new(source, EngineParams::default()).unwrap();
    let (mut t_s, mut failed) = (0.0, 0);
    let mut random = Random(2);
    let views = [from, to].map(|cell| view(&layout, cell, &mut random));
    for view in views.iter().flat_map(|view| std::iter::repeat_n(*view, 12)) {
        failed += engine.frame(&FrameRequest { view, t_s, ids: false }).unwrap().failed;
        t_s += 1.0;
    }
    let at_rest = engine.frame(&FrameRequest { view: views[1], t_s, ids: false }).unwrap();
    assert!(failed > 0 && at_rest.debt_px < 0.01, "{failed} failed, {} px", at_rest.debt_px);
    assert_eq!(engine.ride_counts().unwrap().crossings, 1);
}

#[test]
fn over_a_network_a_crossing_is_one_request() {
    let web = Web::serve(folder());
    let (source, refused) = Source::with_layout(World::open(&web.url("world")).unwrap(), "high");
    assert_eq!(refused, None);
    let layout = source.layout.clone().unwrap();
    let planner = PlannerParams { policy: PolicyName::Demand, ..PlannerParams::default() };
    let mut engine = Engine::new(source, EngineParams { planner, ..EngineParams::default() }).unwrap();
    let (mut random, mut t_s) = (Random(21), 0.0);
    let mut cell = NavCell { band: 0, row: 3, column: 0 };
    let mut requests = 0;
    for crossing in 0..40 {
        let view = view(&layout, cell, &mut random);
        let frames = if crossing == 0 { 40 } else { 3 };
        web.take_asked();
        let mut report = None;
        for _ in 0..frames {
            report = Some(engine.frame(&FrameRequest { view, t_s, ids: false }).unwrap());
            t_s += STEP_S;
        }
        assert!(report.unwrap().debt_px < 0.01);
        let asked = web.take_asked();
        if crossing > 0 {
            assert!(asked.len() <= 1, "{asked:?}");
            assert!(asked.iter().all(|asked| asked.path == "world/layouts/high.seek"), "{asked:?}");
            requests += asked.len();
        }
        let east = layout.grid.neighbor(cell, Direction::East);
        cell = east.unwrap_or_else(|| layout.grid.neighbor(cell, Direction::ALL[random.below(4)]).unwrap_or(cell));
    }
    assert!(requests > 5, "{requests}");
    assert!(engine.take_failures().is_empty());
}

#[test]
fn a_limit_that_cannot_be_met_makes_no_file_and_says_the_least() {
    let copy = copied();
    let world = World::open_whole(copy.path()).unwrap();
    let chosen = Builder { side_m: None, max_redundancy: 1e-3, ..builder(&world, "never", &[50.0, 150.0, 400.0]) };
    let built = chosen.build(&mut None, &|_, _, _| true).unwrap();
    assert!(built.file.is_none() && built.point.is_none() && built.least_redundancy.unwrap() > 1e-3);
    assert!(built.curve.len() >= 6 && built.curve.is_sorted_by(|a, b| a.side_m > b.side_m));
    // Where the limit is that of the curve's first side, that one is taken.
    let limit = built.curve[0].redundancy * 1.2;
    let met = Builder { max_redundancy: limit, ..chosen };
    let built = met.build(&mut None, &|_, _, _| true).unwrap();
    assert!(built.point.unwrap().redundancy <= limit && built.by_storage.len() == StorageModel::ALL.len());
    let stopped = met.build(&mut None, &|_, _, _| false);
    assert!(matches!(stopped, Err(BuildError::Stopped)));
    let huge = Builder { side_m: Some(0.01), ..met };
    assert!(matches!(huge.build(&mut None, &|_, _, _| true), Err(BuildError::TooManyCells { .. })));
}

#[test]
fn what_is_hidden_is_left_out_of_low_bands() {
    let copy = copied();
    let world = World::open_whole(copy.path()).unwrap();
    let low = builder(&world, "low", &[2.0, 12.0, 60.0]);
    let lookout = Lookout::new(Source::of(World::open(copy.path()).unwrap()), &low.params, 64, ByteSize(128 << 20));
    let mut witness: Option<Box<dyn Witness>> = Some(Box::new(lookout.unwrap()));
    let small = Builder { region: GeoBounds::from_degrees(-84.402, 33.598, -84.396, 33.602), ..low };
    let seen = small.build(&mut witness, &|_, _, _| true).unwrap();
    assert!(seen.hidden.of_pages > 0 && seen.hidden.pages < seen.hidden.of_pages, "{:?}", seen.hidden);
    let layout = opened(copy.path(), "low").1;
    let all = small.draft(300.0, None, &mut None, &|_, _, _| true).unwrap();
    for cell in layout.grid.cells() {
        let set: HashSet<PageId> = layout.set(cell).into_iter().collect();
        let whole: HashSet<PageId> = all.set(cell).unwrap().iter().map(|&number| all.pages.get(number).0).collect();
        assert!(set.is_subset(&whole));
        // In the upper band nothing is left out.
        assert!(cell.band == 0 || set == whole);
    }
}

#[test]
fn recipes_and_programs_make_and_fly_layouts() {
    let copy = copied();
    let file = |name: &str| copy.path().join(name);
    let recipe = "name = \"layouts\"\n[[layout]]\nname = \"made\"\ncollection = \"west\"\n\
                  altitude_bands_m = [50, 150, 400]\nviewport_h_px = 180\nside_m = 400\nstorage = \"hdd\"\n";
    fs::write(file("recipe.toml"), recipe).unwrap();
    let run = |program: &str, arguments: &[&str]| {
        let output = Command::new(program).args(arguments).current_dir(copy.path()).output().unwrap();
        let said = [&output.stdout[..], &output.stderr[..]].concat();
        (output.status.success(), String::from_utf8(said).unwrap())
    };
    let (done, said) = run(env!("CARGO_BIN_EXE_stoop-prepare"), &["recipe.toml", "--into", "."]);
    assert!(done && said.contains("written:") && said.contains("redundancy"), "{said}");
    let rows: Vec<String> = (0..=120)
        .map(|at| format!("[{}, {}, 33.6, 250, 90, -30]", f64::from(at) / 30.0, -84.4 + f64::from(at) * 1e-4))
        .collect();
    let path = format!(
        r#"{{"fovy_deg":60,"hz":30,"columns":["t_s","lon_deg","lat_deg","height_m","heading_deg","pitch_deg"],"samples":[{}]}}"#,
        rows.join(",")
    );
    fs::write(file("path.json"), path).unwrap();
    let fly = |more: &[&str]| {
        let common = ["fly", ".", "--path", "path.json", "--size", "320x180", "--report", "report.json"];
        let (done, said) = run(env!("CARGO_BIN_EXE_stoop"), &[&common[..], more].concat());
        assert!(done, "{said}");
        let report: serde_json::Value = serde_json::from_slice(&fs::read(file("report.json")).unwrap()).unwrap();
        (report, said)
    };
    for mode in [&["--virtual", "hdd"][..], &[], &["--policy", "vgis"]] {
        let (report, said) = fly(&[&["--layout", "made"], mode].concat());
        let count = |key: &str| report[key].as_u64().unwrap_or_else(|| panic!("{key}: {said}"));
        assert!((2..=4).contains(&count("crossings")), "{said}");
        assert!(count("crossing_seeks_max") <= 1 && count("layout_fallbacks") == 1, "{said}");
    }
    let (report, said) = fly(&["--layout", "gone", "--virtual", "hdd"]);
    assert!(report["crossings"].is_null() && said.contains("there is no such layout"), "{said}");
    // Views that ask for more than a layout is made for are left to the packs.
    let (report, _) = fly(&["--layout", "made", "--virtual", "hdd", "--tolerance-px", "0.5"]);
    assert_eq!(report["crossings"].as_u64(), Some(0));
    let (done, said) = run(env!("CARGO_BIN_EXE_stoop"), &["fly", ".", ".", "--path", "path.json", "--layout", "made"]);
    assert!(!done && said.contains("one world"), "{said}");
}
