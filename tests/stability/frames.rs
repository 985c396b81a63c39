//! Single frames: thresholds, sizes of windows, ground above the eye.

use super::search::limit;
use super::settled::{settle, settle_with};
use super::table::{Row, digits};
use crate::made_up::{dive_world, error_m, page, view, with_roots};
use crate::scene;
use stoop::camera::View;
use stoop::cells::LiveTree;
use stoop::content::{Page, PageId, PageKind};
use stoop::forest::CellId;
use stoop::forest::index::IndexForest;
use stoop::geodesy::Geodetic;
use stoop::render::RenderError;
use stoop::select::{SelectParams, Selection, select};

const LAT_DEG: f64 = 33.0;
const LON_DEG: f64 = -84.0;
/// Movement that is not seen, px.
const UNSEEN_PX: f64 = 0.1;

/// A page of even heights, with posts so near each other that chords hardly cut into the Earth.
fn level_page(cell: CellId, height_m: f32, parent_m: f32) -> Page {
    const STRIDE: usize = 2;
    Page::Terrain(scene::terrain(cell, STRIDE, &|_, _| f64::from(height_m), &|_, _| f64::from(parent_m)))
}

/// Ground that rises by a level's error from each level to the next finer one, as far as that level's bound allows.
fn stepped(id: PageId) -> Page {
    let height_m = |level: u8| 0.9 * (error_m(0) - error_m(level));
    match id.kind {
        PageKind::Terrain => {
            let level = id.cell.level();
            level_page(id.cell, height_m(level), height_m(level.saturating_sub(1)))
        }
        _ => page(id),
    }
}

/// What is drawn at a place of the ground.
struct Drawn {
    page: CellId,
    morphed_m: f64,
    /// The page's own surface, without morph.
    own_m: f64,
}

fn drawn_at(selection: &Selection, place: Geodetic) -> Drawn {
    let cell = CellId::containing(place.lat_rad, place.lon_rad, stoop::forest::LEVEL_MAX);
    let piece = selection.pieces.iter().find(|piece| piece.cell.contains(cell)).unwrap();
    let height_m = |own: f64| piece.terrain.surface_height_m(place.lat_rad, place.lon_rad, own).unwrap();
    Drawn { page: piece.terrain.cell, morphed_m: height_m(f64::from(piece.own)), own_m: height_m(1.0) }
}

/// A trembling eye: what became of the picture from frame to frame.
#[derive(Default)]
struct Tremble {
    /// Frames that draw another page than the one before at some probe.
    switches: u32,
    /// Largest movements of the ground at the probes, px.
    morphed_px: f64,
    own_px: f64,
}

/// Places in view of an eye at about a height.
fn probes(height_m: f64) -> Vec<Geodetic> {
    let deg = height_m / 111e3;
    let place = |at: u32| {
        let (north, east) = (0.3 + 0.2 * f64::from(at / 4), 0.3 * (f64::from(at % 4) - 1.4));
        Geodetic::from_degrees(LAT_DEG + north * deg, LON_DEG + east * deg, 0.0)
    };
    (0..32).map(place).collect()
}

/// An eye that goes up and down by a share of its height, in all frames over the same resident pages.
fn tremble(index: &IndexForest, cells: &LiveTree, height_m: f64, share: f64) -> Tremble {
    let probes = probes(height_m);
    let mut found = Tremble::default();
    let mut before: Option<Vec<Drawn>> = None;
    for frame in 0..100u32 {
        let sign = if frame.is_multiple_of(2) { 1.0 } else { -1.0 };
        let view = view(LAT_DEG, LON_DEG, height_m * (1.0 + sign * share / 2.0), 0.0, -50.0);
        let selection = select(index, cells, &view, &SelectParams::DEFAULT);
        let now: Vec<Drawn> = probes.iter().map(|&place| drawn_at(&selection, place)).collect();
        let switches = |(old, new): (&Drawn, &Drawn)| old.page != new.page;
        found.switches += u32::from(before.iter().flatten().zip(&now).any(switches));
        for (at, (old, new)) in before.iter().flatten().zip(&now).enumerate() {
            let px_per_m = view.projected_px(1.0, view.eye().distance_m(probes[at].to_ecef()));
            found.morphed_px = found.morphed_px.max((old.morphed_m - new.morphed_m).abs() * px_per_m);
            found.own_px = found.own_px.max((old.own_m - new.own_m).abs() * px_per_m);
        }
        before = Some(now);
    }
    found
}

/// All that views from a little higher and lower need.
fn resident_round(index: &IndexForest, height_m: f64) -> LiveTree {
    let mut cells = with_roots(index);
    for share in [0.8, 0.9, 1.0, 1.1] {
        let view = view(LAT_DEG, LON_DEG, share * height_m, 0.0, -50.0);
        let (_, settled) = settle_with(index, &view, &SelectParams::DEFAULT, stepped);
        settled.demands.iter().for_each(|demand| cells.insert(&stepped(demand.page)));
    }
    cells
}

/// Heights at which some cell in view switches.
fn thresholds_m(index: &IndexForest) -> Vec<f64> {
    let steps = (0..40).map(|step| 3_000.0 * 1.06f64.powi(step));
    steps
        .filter_map(|from_m| {
            let cells = resident_round(index, from_m);
            let drawn = |height_m: f64| {
                let view = view(LAT_DEG, LON_DEG, height_m, 0.0, -50.0);
                let selection = select(index, &cells, &view, &SelectParams::DEFAULT);
                probes(from_m).into_iter().map(|place| drawn_at(&selection, place).page).collect::<Vec<_>>()
            };
            let (here, there_m) = (drawn(from_m), 1.06 * from_m);
            (here != drawn(there_m)).then(|| limit(from_m, there_m, |height_m| drawn(height_m) == here))
        })
        .collect()
}

/// Worlds under a trembling eye at some of their thresholds.
struct Thresholds {
    index: IndexForest,
    heights_m: Vec<(f64, LiveTree)>,
}

impl Thresholds {
    /// `imagery`: how fine its pictures are; those finer than the terrain make pieces smaller than its pages.
    fn new(imagery: u8) -> Self {
        let index = dive_world(LAT_DEG, LON_DEG, 14, imagery);
        let heights_m: Vec<(f64, LiveTree)> =
            thresholds_m(&index).into_iter().map(|height_m| (height_m, resident_round(&index, height_m))).collect();
        assert!(heights_m.len() >= 3, "{}", heights_m.len());
        Self { index, heights_m }
    }

    /// The worst of all thresholds.
    fn tremble(&self, share: f64) -> Tremble {
        let mut worst = Tremble::default();
        for (height_m, cells) in &self.heights_m {
            let found = tremble(&self.index, cells, *height_m, share);
            worst.switches = worst.switches.max(found.switches);
            worst.morphed_px = worst.morphed_px.max(found.morphed_px);
            worst.own_px = worst.own_px.max(found.own_px);
        }
        worst
    }
}

pub fn thresholds() -> Row {
    let (plain, split) = (Thresholds::new(4), Thresholds::new(9));
    let (small, in_parts) = (plain.tremble(0.001), split.tremble(0.001));
    assert!(small.switches >= 99 && small.own_px > 0.3, "{} {}", small.switches, small.own_px);
    // All pieces that pictures cut out of a page are morphed as the page is.
    let moved_px = small.morphed_px.max(in_parts.morphed_px);
    assert!(moved_px < 0.02 && in_parts.own_px > 0.3, "{moved_px} {}", in_parts.own_px);
    let largest_px = |share: f64| plain.tremble(share).morphed_px.max(split.tremble(share).morphed_px);
    let shares = [0.002, 0.005, 0.01, 0.02, 0.03, 0.05, 0.07, 0.1];
    let share = shares.into_iter().take_while(|&share| largest_px(share) < UNSEEN_PX).last().unwrap();
    assert!(share >= 0.02, "{share}");
    Row {
        case: "a level's threshold under a trembling eye (0.1 % of its height, 100 frames)",
        usual: format!(
            "levels switched at the threshold: in {} of 99 frames, and the ground jumps by {} px each time",
            small.switches,
            digits(small.own_px)
        ),
        ours: format!(
            "pages switch as often, but where they do they draw the same surface: it moves by {} px, also where pictures \
             finer than the terrain cut its pages in pieces",
            digits(moved_px)
        ),
        limit: format!("under {UNSEEN_PX} px up to {} % of the height from frame to frame", digits(100.0 * share)),
    }
}

/// Bytes of a picture as they are often counted.
fn picture_bytes_u32(side_px: u32) -> u32 {
    side_px.wrapping_mul(side_px).wrapping_mul(4)
}

pub fn windows() -> Row {
    assert_eq!(picture_bytes_u32(32_768), 0);
    assert!(View::new(view(0.0, 0.0, 1.0, 0.0, 0.0).pose, 1.0, [0, 0]).aspect().is_nan());
    let index = dive_world(LAT_DEG, LON_DEG, 18, 15);
    let settled = |size_px: [u32; 2]| {
        let pose = view(LAT_DEG, LON_DEG, 3_000.0, 30.0, -60.0).pose;
        let selection = settle(&index, &View::new(pose, 1.0, size_px), &SelectParams::DEFAULT).1;
        let stats = &selection.stats;
        assert!(
            stats.debt_px == 0.0 && stats.coverage == 1.0 && stats.raw_error_px.is_finite(),
            "{size_px:?}: {stats:?}"
        );
        selection.pieces.len()
    };
    let [one, usual, huge] = [[1, 1], [640, 360], [16_384, 16_384]].map(settled);
    assert!(0 < one && one < usual && usual < huge, "{one} {usual} {huge}");
    for odd in [[1, 16_384], [16_384, 1], [1 << 20, 1 << 20]] {
        assert!(settled(odd) > 0);
    }
    let mut renderer = scene::renderer();
    let globe = scene::bare_globe();
    let mut draw = |size_px: [u32; 2]| {
        let view = scene::view([10.0, 20.0, 2e7], [0.0, -90.0], 60.0, size_px);
        renderer.draw(&view, &globe, &scene::AOV)
    };
    assert!(matches!(draw([0, 0]), Err(RenderError::Size(0, 0, _))));
    let largest_px = (0..20).map(|power| 1 << power).take_while(|&side| draw([side, 1]).is_ok()).last().unwrap();
    assert!(largest_px >= 8192 && draw([1, 1]).is_ok() && draw([1, largest_px]).is_ok());
    let beyond = draw([largest_px + 1, 1]).unwrap_err();
    assert!(matches!(beyond, RenderError::Size(_, 1, most) if most == largest_px), "{beyond}");
    assert!(beyond.to_string().contains(&largest_px.to_string()), "{beyond}");
    Row {
        case: "windows from 1 × 1 to 16k",
        usual: "bytes of a picture in 32 bits: 32,768 × 32,768 px take 0 bytes; 0 × 0 px have no aspect".to_owned(),
        ours: format!(
            "fronts settle at 1 × 1 px ({one} pieces), 16,384 × 16,384 px ({huge}) and 2²⁰ × 2²⁰ px; 0 × 0 px is an error"
        ),
        limit: format!(
            "pictures {largest_px} px a side (what is asked of the adapter), beyond that an error that says so"
        ),
    }
}

const COARSE: u8 = 6;

/// How far drawn ground reaches above an eye, metres, where only a page of level [`COARSE`] is there and lies `buried_m` too
/// high; first without, then with the press.
fn over_eye_m(buried_m: f64) -> [f64; 2] {
    let index = dive_world(LAT_DEG, LON_DEG, 12, 4);
    let view = view(LAT_DEG, LON_DEG, 30.0, 0.0, -10.0);
    let coarse = CellId::containing(view.pose.eye.lat_rad, view.pose.eye.lon_rad, COARSE);
    let mut cells = with_roots(&index);
    let height_m = (30.0 + buried_m) as f32;
    cells.insert(&level_page(coarse, height_m, height_m));
    let selection = select(&index, &cells, &view, &SelectParams::DEFAULT);
    let drawn_m = drawn_at(&selection, view.pose.eye).morphed_m;
    let pressed_m = selection.press.map_or(0.0, |press| f64::from(press.depth_m));
    [drawn_m - 30.0, drawn_m - pressed_m - 30.0]
}

pub fn coarse_ground() -> Row {
    let [usual_m, ours_m] = over_eye_m(4_000.0);
    assert!(usual_m > 3_900.0 && (ours_m + 2.0).abs() < 1e-3, "{usual_m} {ours_m}");
    // Ground that is there to the metre is left where it is.
    assert!(over_eye_m(-20.0)[1] < -19.0);
    let most_m = limit(100.0, 1e9, |buried_m| over_eye_m(buried_m)[1] < -1.9);
    assert!(most_m > 1e5, "{most_m}");
    Row {
        case: "the eye under coarse ground, in a valley not yet loaded",
        usual: format!("the coarse page is drawn as it is: the eye is {} m under ground", digits(usual_m)),
        ours: format!("pressed down round the eye, to {} m below it", digits(-ours_m)),
        limit: format!("ground {} m too high (2 m below the eye to 10 cm)", digits(most_m)),
    }
}
