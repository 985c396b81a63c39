//! What a single-seek layout gains: `cargo bench --bench layout -- WORLD LAYOUT [STORAGE…]`.
//!
//! Where the layout leaves out what is hidden: objects that are seen all the same. Then two tables, by the virtual clock, for
//! each storage model (hdd, wan and mobile by default). First, random crossings of
//! the layout's cells: seeks counted by the storage until all of a cell's set is there, and delays, against the packs and
//! against a Hilbert order. Then flights through the region, with and without looking ahead: detail debt, bytes, seeks, and
//! the frame rate of a renderer that waits for its pages.

use std::path::PathBuf;
use std::sync::Arc;
use stoop::camera::{FlightPath, Pose, View};
use stoop::content::{Page, PageId, PageKind};
use stoop::engine::{LOOKOUT_PX, Lookout, Source};
use stoop::layout::{Direction, Layout, LinearOrder, NavCell, SEEN_BELOW_M, Seen, hilbert_order, pages_of};
use stoop::paging::{PlannerParams, PolicyName};
use stoop::simulate::{Library, Setup, Simulation, fly};
use stoop::storage::StorageModel;
use stoop::store::World;
use stoop::units::ByteSize;

const CROSSINGS: usize = 10_000;
/// Room for the largest set of a city like San Francisco, not for all of it.
const FOOTPRINT_MIB: u64 = 400;
const STEP_S: f64 = 1.0 / 30.0;
/// Frames after which a crossing that has not all of its pages is given up: none may.
const FRAMES_MAX: usize = 3_000;
/// Places in each band from which it is looked for what sets leave out.
const PLACES: usize = 40;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|argument| !argument.starts_with("--")).collect();
    let [world, name, storage @ ..] = &arguments[..] else {
        println!("skipped: name a world and one of its layouts");
        return Ok(());
    };
    let models: Vec<StorageModel> = if storage.is_empty() {
        vec![StorageModel::HDD, StorageModel::WAN, StorageModel::MOBILE]
    } else {
        storage.iter().map(|name| name.parse()).collect::<Result<_, _>>()?
    };
    let open = || -> Result<Source, Box<dyn std::error::Error>> {
        let (source, refused) = Source::with_layout(World::open_whole(&PathBuf::from(world))?, name);
        refused.map_or(Ok(source), |refused| Err(refused.into()))
    };
    let source = open()?;
    let layout = source.layout.clone().ok_or("no layout")?;
    let library = || Library::new(source.index.clone(), source.reader.clone());
    let hilbert = hilbert_order(&pages_of(&source.index));
    println!("cells of {:.0} m, {} of them", layout.grid.side_m(), layout.grid.cell_count());
    cones(&source);
    hidden(open()?, &layout)?;
    println!("\n{CROSSINGS} random crossings\n");
    println!("| storage | pages from | seeks max | seeks mean | mean ms | p99 ms | max ms | KiB mean |");
    println!("|---|---|--:|--:|--:|--:|--:|--:|");
    for &storage in &models {
        for (kind, library) in kinds(&library, &layout, &hilbert)? {
            println!("| {storage} | {kind} | {} |", cross(&library, &layout, storage, Memory::Kept));
        }
        let library = library().with_layout(Some(layout.clone()));
        println!(
            "| {storage} | layout, the set alone in memory | {} |",
            cross(&library, &layout, storage, Memory::Dropped)
        );
    }
    println!("\nflights at 30 Hz, 1280 × 720, {FOOTPRINT_MIB} MiB\n");
    println!(
        "| storage | m/s | pages from | policy | debt px·s | peak px | seeks | MiB | fallbacks | waits: worst fps | mean fps |"
    );
    println!("|---|--:|---|---|--:|--:|--:|--:|--:|--:|--:|");
    for &storage in &models {
        for m_per_s in [30.0, 120.0] {
            let path = Arc::new(round_trip(&layout, m_per_s)?);
            for (kind, library) in kinds(&library, &layout, &hilbert)? {
                for policy in [PolicyName::Demand, PolicyName::Foresight] {
                    let flown = flown(&library, &path, storage, policy)?;
                    println!("| {storage} | {m_per_s} | {kind} | {policy} | {flown} |");
                }
            }
        }
    }
    Ok(())
}

/// Whether pages could be left out as their walls face away: the cones of the normals of their walls.
fn cones(source: &Source) {
    let (mut pages, mut narrow) = (0, 0);
    for (page, place) in pages_of(&source.index) {
        if let (PageKind::Objects { .. }, Ok(Page::Objects(_, mesh))) = (page.kind, source.reader.load(page, place)) {
            let walls: Vec<_> = mesh.vertices.iter().filter(|v| v.facing >> 15 == 0).map(|v| v.normal()).collect();
            let axis = walls.iter().fold(glam::DVec3::ZERO, |sum, normal| sum + *normal).normalize_or_zero();
            pages += 1;
            narrow += u32::from(!walls.is_empty() && walls.iter().all(|normal| normal.dot(axis) > 0.0));
        }
    }
    println!("pages of objects whose walls all face one half of the sky: {narrow} of {pages}");
}

/// Objects that pictures from random places show and their cells' sets leave out, where sets hold only what was seen from
/// the cells' viewpoints: pictures of twice the side, from places that no viewpoint is at.
fn hidden(source: Source, layout: &Layout) -> Result<(), Box<dyn std::error::Error>> {
    let low: Vec<NavCell> =
        layout.grid.cells().filter(|cell| layout.grid.band_m(cell.band).1 <= SEEN_BELOW_M).collect();
    if low.is_empty() {
        return Ok(());
    }
    let saved = 100.0 * layout.hidden.bytes as f64 / layout.hidden.of_bytes.max(1) as f64;
    println!("\nhidden in {} low cells: {saved:.1} % of the bytes of their sets\n", low.len());
    let footprint = ByteSize(1 << 30);
    let mut lookout = Lookout::new(source, &layout.params, 2 * LOOKOUT_PX, footprint)?;
    println!("| band m | places | objects seen | left out | share | cells of ground seen | left out |");
    println!("|---|--:|--:|--:|--:|--:|--:|");
    let mut random = Random(17);
    let mut bands: Vec<u32> = low.iter().map(|cell| cell.band).collect();
    bands.dedup();
    for band in bands {
        let of_band: Vec<NavCell> = low.iter().copied().filter(|cell| cell.band == band).collect();
        let (mut seen, mut missed, mut ground, mut ground_missed) = (0, 0, 0, 0);
        for _ in 0..PLACES {
            let cell = of_band[random.below(of_band.len())];
            let mut kept = Seen::default();
            let set = layout.set(cell);
            let is_ground = |page: &&PageId| matches!(page.kind, PageKind::Terrain | PageKind::Imagery);
            set.iter().filter(is_ground).for_each(|page| kept.add_ground(page.cell));
            let (looked, objects) = lookout.look(view(layout, cell, &mut random).pose.eye)?;
            seen += objects.len();
            missed += objects.iter().filter(|(page, _)| !set.iter().any(|kept| is_as_fine(*kept, *page))).count();
            ground += looked.ground().count();
            ground_missed +=
                looked.ground().filter(|&cell| !kept.shows(PageId { cell, kind: PageKind::Terrain })).count();
        }
        let (low_m, high_m) = layout.grid.band_m(band);
        let share = 100.0 * missed as f64 / seen.max(1) as f64;
        println!("| {low_m}–{high_m} | {PLACES} | {seen} | {missed} | {share:.2} % | {ground} | {ground_missed} |");
    }
    Ok(())
}

/// Whether a page shows what another one does no more coarsely: that page itself, a finer one in its place, or some below it.
fn is_as_fine(kept: PageId, page: PageId) -> bool {
    match (kept.kind, page.kind) {
        (PageKind::Objects { collection: a, rep: kept_rep }, PageKind::Objects { collection: b, rep }) => {
            let is_below = kept.cell != page.cell && page.cell.contains(kept.cell);
            a == b && (is_below || (kept.cell == page.cell && kept_rep <= rep))
        }
        _ => false,
    }
}

type Kinds = Vec<(&'static str, Library)>;

fn kinds(
    library: &dyn Fn() -> Library,
    layout: &Arc<Layout>,
    hilbert: &LinearOrder,
) -> Result<Kinds, Box<dyn std::error::Error>> {
    Ok(vec![
        ("layout", library().with_layout(Some(layout.clone()))),
        ("packs", library()),
        ("Hilbert", library().in_order(hilbert)?),
    ])
}

fn setup(storage: StorageModel, policy: PolicyName) -> Setup {
    let planner = PlannerParams { policy, ..PlannerParams::default() };
    Setup { planner, footprint: ByteSize(FOOTPRINT_MIB << 20), size_px: [1280, 720], ..Setup::new(storage, STEP_S) }
}

/// Numbers in a row, the same in every run (SplitMix64; Steele, Lea & Flood 2014).
struct Random(u64);

impl Random {
    fn below(&mut self, end: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut word = self.0;
        word = (word ^ word >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        word = (word ^ word >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((word ^ word >> 31) % end.max(1) as u64) as usize
    }

    fn share(&mut self) -> f64 {
        self.below(1 << 20) as f64 / f64::from(1 << 20)
    }
}

/// A view from somewhere in a cell.
fn view(layout: &Layout, cell: NavCell, random: &mut Random) -> View {
    let (low_m, high_m) = layout.grid.band_m(cell.band);
    let above_m = low_m + (0.02 + 0.96 * random.share()) * (high_m - low_m);
    let at = |from: u32, share: f64| f64::from(from) + 0.02 + 0.96 * share;
    let eye = layout.grid.eye(at(cell.column, random.share()), at(cell.row, random.share()), above_m);
    let heading_rad = std::f64::consts::TAU * random.share();
    View::new(Pose { eye, heading_rad, pitch_rad: -0.9 * random.share() }, 60f64.to_radians(), [1280, 720])
}

/// What is done with pages that a cell does not want.
#[derive(Clone, Copy, PartialEq)]
enum Memory {
    /// They stay as long as there is room.
    Kept,
    /// They go at once, as in the paper.
    Dropped,
}

/// Goes to a random neighbour again and again, waits there until the storage is at rest, and counts what that took.
fn cross(library: &Library, layout: &Layout, storage: StorageModel, memory: Memory) -> String {
    let mut random = Random(7);
    let mut simulation = Simulation::new(library, setup(storage, PolicyName::Demand)).expect("the footprint suffices");
    let grid = &layout.grid;
    let mut cell = NavCell { band: 0, row: grid.rows() / 2, column: grid.columns() / 2 };
    let (mut t_s, mut delays_s) = (0.0, Vec::with_capacity(CROSSINGS));
    let (mut most, mut seeks, mut bytes) = (0, 0, 0);
    for crossing in 0..=CROSSINGS {
        let before = simulation.traffic();
        let view = view(layout, cell, &mut random);
        let entered_s = t_s;
        for frame in 0.. {
            simulation.frame(&view, t_s);
            if simulation.is_settled() {
                break;
            }
            assert!(frame < FRAMES_MAX, "crossing {crossing} does not come to rest");
            t_s += STEP_S;
        }
        if crossing == 0 {
            // All that the cell needs, not what one view does: it is entered, not crossed into.
            for _ in 0..FRAMES_MAX {
                t_s += STEP_S;
                simulation.frame(&view, t_s);
            }
        }
        let after = simulation.traffic();
        let count = if storage.seek_only { after.seeks - before.seeks } else { after.requests - before.requests };
        if crossing > 0 {
            most = most.max(count);
            seeks += count;
            bytes += after.bytes - before.bytes;
            delays_s.push(t_s - entered_s);
        }
        if memory == Memory::Dropped {
            simulation.drop_unwanted();
        }
        t_s += STEP_S;
        let next = Direction::ALL[random.below(Direction::ALL.len())];
        cell = grid.neighbor(cell, next).unwrap_or(cell);
    }
    delays_s.sort_by(f64::total_cmp);
    let count = CROSSINGS as f64;
    format!(
        "{most} | {:.2} | {:.0} | {:.0} | {:.0} | {:.0}",
        seeks as f64 / count,
        1e3 * delays_s.iter().sum::<f64>() / count,
        1e3 * delays_s[CROSSINGS * 99 / 100],
        1e3 * delays_s[CROSSINGS - 1],
        bytes as f64 / count / 1024.0
    )
}

/// Along the middle of the region and back, through its second lowest band, turning on the way.
fn round_trip(layout: &Layout, m_per_s: f64) -> Result<FlightPath, Box<dyn std::error::Error>> {
    let grid = &layout.grid;
    let (columns, rows) = (f64::from(grid.columns()), f64::from(grid.rows()));
    let (low_m, high_m) = grid.band_m((grid.bands() as u32 - 1).min(1) * u32::from(grid.bands() > 2));
    let length = 2.0 * (columns + rows) * 0.8;
    let seconds = (length * grid.side_m() / m_per_s).min(120.0);
    let samples: Vec<[f64; 6]> = (0..=(seconds * 30.0) as usize)
        .map(|at| {
            let t_s = at as f64 * STEP_S;
            let turn = std::f64::consts::TAU * t_s * m_per_s / (length * grid.side_m());
            let above_m = low_m + (high_m - low_m) * (0.4 + 0.2 * (3.0 * turn).sin());
            let eye = grid.eye(columns * (0.5 - 0.4 * turn.cos()), rows * (0.5 + 0.4 * turn.sin()), above_m);
            let heading_deg = turn.to_degrees() + 30.0 * (5.0 * turn).sin();
            [t_s, eye.lon_rad.to_degrees(), eye.lat_rad.to_degrees(), eye.height_m, heading_deg, -20.0]
        })
        .collect();
    let columns = ["t_s", "lon_deg", "lat_deg", "height_m", "heading_deg", "pitch_deg"];
    let text = serde_json::json!({ "fovy_deg": 60, "hz": 30, "columns": columns, "samples": samples }).to_string();
    let file = std::env::temp_dir().join(format!("stoop-bench-layout-{}.json", std::process::id()));
    std::fs::write(&file, text)?;
    let path = FlightPath::load(&file);
    std::fs::remove_file(&file)?;
    Ok(path?)
}

fn flown(
    library: &Library,
    path: &Arc<FlightPath>,
    storage: StorageModel,
    policy: PolicyName,
) -> Result<String, Box<dyn std::error::Error>> {
    let (mut debt_px_s, mut peak_px, mut traffic, mut fallbacks) = (0.0, 0.0f64, (0, 0), 0);
    fly(library, path, setup(storage, policy), |frame, simulation| {
        // What is missing when a flight begins is the same for all.
        if frame.report.t_s >= 5.0 {
            debt_px_s += frame.report.debt_px * STEP_S;
            peak_px = peak_px.max(frame.report.debt_px);
        }
        let counters = simulation.traffic();
        traffic = (if storage.seek_only { counters.seeks } else { counters.requests }, counters.bytes);
        fallbacks = simulation.ride_counts().map_or(0, |counts| counts.fallbacks);
        true
    })?;
    let (mut worst_s, mut total_s, mut frames) = (0.0f64, 0.0, 0u32);
    let waiting = Setup { sync_reads: true, ..setup(storage, policy) };
    fly(library, path, waiting, |frame, _| {
        if frame.report.t_s >= 5.0 {
            worst_s = worst_s.max(STEP_S + frame.report.waited_s);
            total_s += STEP_S + frame.report.waited_s;
            frames += 1;
        }
        true
    })?;
    let fps = |seconds: f64| if seconds > 0.0 { 1.0 / seconds } else { 0.0 };
    Ok(format!(
        "{debt_px_s:.1e} | {peak_px:.1e} | {} | {:.1} | {fallbacks} | {:.1} | {:.1}",
        traffic.0,
        traffic.1 as f64 / f64::from(1 << 20),
        fps(worst_s),
        f64::from(frames) * fps(total_s)
    ))
}
