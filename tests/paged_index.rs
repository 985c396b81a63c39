//! Worlds whose index comes in segments: what they settle to is what the whole index gives, segments come before what
//! is below them, and a world of a hundred million cells is flown over with a few of them in memory.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on should stop")]

mod earth;
mod made_up;

use made_up::{object_page, page, tops, view, with_roots};
use std::collections::BTreeSet;
use stoop::camera::View;
use stoop::cells::LiveTree;
use stoop::content::{Page, PageId, PageKind};
use stoop::engine::{Engine, EngineParams, FrameRequest, Mode, Source};
use stoop::forest::index::synthetic::{Near, SyntheticForest};
use stoop::forest::index::{IndexForest, IndexTree, NodeInfo, ObjectsEntry, Place, SEGMENT_LEVELS, TerrainEntry};
use stoop::forest::{CellId, LEVEL_MAX};
use stoop::geodesy::Geodetic;
use stoop::select::{
    Demand, ObjectsMode, SelectParams, Selection, Urgency, ground_demands, select, select_raised, survey,
};
use stoop::store::World;

const PARAMS: SelectParams = SelectParams { objects: ObjectsMode::Cells, ..SelectParams::DEFAULT };
const LAT_DEG: f64 = 33.755;
const LON_DEG: f64 = -84.39;

fn made_up_world(nodes: u64) -> SyntheticForest {
    let place = Geodetic::from_degrees(LAT_DEG, LON_DEG, 0.0);
    SyntheticForest::new(Near { place, finest_level: 19, radius_cells: 8 }, nodes).unwrap()
}

fn is_segment(page: PageId) -> bool {
    page.kind == PageKind::Segment
}

/// What a view settles to where all that it asks for comes: the selection, and rounds with something missing.
fn settle(
    index: &mut IndexForest,
    cells: &mut LiveTree,
    view: &View,
    bring: &dyn Fn(PageId, &mut IndexForest, &mut LiveTree),
) -> (Selection, Vec<Vec<Demand>>) {
    let mut rounds = Vec::new();
    for _ in 0..12 {
        let selection = select(index, cells, view, &PARAMS);
        let is_there = |id: PageId| if is_segment(id) { index.find(id.cell).is_some() } else { cells.contains(id) };
        let missing: Vec<Demand> = selection.demands.iter().filter(|demand| !is_there(demand.page)).copied().collect();
        if missing.is_empty() {
            return (selection, rounds);
        }
        missing.iter().for_each(|demand| bring(demand.page, index, cells));
        rounds.push(missing);
    }
    panic!("the front does not settle");
}

/// Pages as they are made up, segments from a whole index.
fn from_whole(whole: &IndexForest) -> impl Fn(PageId, &mut IndexForest, &mut LiveTree) + '_ {
    |id, index, cells| {
        if is_segment(id) {
            let mut segments = whole.tree(id.cell.zone()).unwrap().segments();
            index.insert_segment(segments.find(|segment| segment.root() == id.cell).unwrap().clone()).unwrap();
        } else if let PageKind::Objects { .. } = id.kind {
            cells.insert(&object_page(id.cell, id.cell.level() + 2, 9));
        } else {
            cells.insert(&page(id));
        }
    }
}

fn whole_of(made_up: &SyntheticForest) -> IndexForest {
    let mut index = IndexForest::default();
    for directory in made_up.index().trees().map(IndexTree::directory) {
        let segments = directory.entries().iter().map(|entry| made_up.segment(entry.root).unwrap());
        index.insert(IndexTree::whole(directory.clone(), segments.collect()).unwrap());
    }
    index
}

fn shown(selection: &Selection) -> Vec<(CellId, CellId, Option<CellId>)> {
    selection.pieces.iter().map(|piece| (piece.cell, piece.terrain.cell, piece.imagery)).collect()
}

/// Pages that a view wants beside those under the eye, which depend on what was there before.
fn visible_pages(selection: &Selection) -> Vec<(PageId, Place)> {
    let is_visible = |demand: &&Demand| !is_segment(demand.page) && demand.urgency == Urgency::Visible;
    selection.demands.iter().filter(is_visible).map(|demand| (demand.page, demand.place)).collect()
}

fn blocking_pages(selection: &Selection) -> BTreeSet<PageId> {
    let is_blocking = |demand: &&Demand| !is_segment(demand.page) && demand.urgency == Urgency::Blocking;
    selection.demands.iter().filter(is_blocking).map(|demand| demand.page).collect()
}

/// Objects far below the finest ground, in a segment of their own.
fn with_objects(levels: u8) -> IndexForest {
    let at = |level| CellId::containing(LAT_DEG.to_radians(), LON_DEG.to_radians(), level);
    let terrain = |level: u8| {
        let (place, error_m) = (Place { offset: u64::from(level) << 16, len: 900 }, 4000.0 / f32::from(1u16 << level));
        Some(TerrainEntry { place, error_m })
    };
    let objects = ObjectsEntry {
        collection: 0,
        rep: 0,
        place: Place { offset: 1 << 30, len: 5000 },
        dimension_m: 60.0,
        error_m: 0.0,
    };
    let cells = (0..=levels).map(|level| {
        let info = NodeInfo {
            terrain: if level <= 8 { terrain(level) } else { None },
            height_range_m: (0.0, 100.0),
            dimension_m: 60.0,
            reach_m: 60.0,
            objects: if level == levels { vec![objects] } else { vec![] },
            ..NodeInfo::default()
        };
        (at(level), info)
    });
    let mut index = IndexForest::default();
    index.insert(IndexTree::build(at(0).zone(), &cells.collect()).unwrap());
    index
}

#[test]
fn a_paged_index_settles_to_what_the_whole_one_gives() {
    let made_up = made_up_world(100_000);
    for (whole, heights_m) in
        [(whole_of(&made_up), [8e6, 400e3, 20e3, 1500.0, 40.0]), (with_objects(14), [8e6, 60e3, 6e3, 900.0, 150.0])]
    {
        let mut index = tops(&whole);
        let (mut paged_cells, mut whole_cells) = (with_roots(&index), with_roots(&whole));
        for height_m in heights_m {
            for pitch_deg in [-90.0, -20.0] {
                let view = view(LAT_DEG, LON_DEG, height_m, 30.0, pitch_deg);
                let (paged, _) = settle(&mut index, &mut paged_cells, &view, &from_whole(&whole));
                let (expected, _) = settle(&mut whole.clone(), &mut whole_cells, &view, &from_whole(&whole));
                assert_eq!(shown(&paged), shown(&expected), "{height_m} m, {pitch_deg}°");
                assert_eq!(visible_pages(&paged), visible_pages(&expected), "{height_m} m, {pitch_deg}°");
                assert!(blocking_pages(&paged).is_superset(&blocking_pages(&expected)));
                let objects =
                    |selection: &Selection| selection.objects.iter().map(|o| o.objects.clone()).collect::<Vec<_>>();
                assert_eq!(objects(&paged), objects(&expected));
                assert_eq!(
                    (paged.stats.debt_px, paged.stats.coverage),
                    (expected.stats.debt_px, expected.stats.coverage)
                );
                assert!(expected.demands.iter().all(|demand| !is_segment(demand.page)), "a whole index is not paged");
            }
        }
        assert!(index.bytes().paged > 0);
    }
}

#[test]
fn segments_come_before_all_pages_but_the_ground_and_never_before_those_above_them() {
    let made_up = made_up_world(100_000);
    let whole = whole_of(&made_up);
    let mut index = tops(&whole);
    let mut cells = with_roots(&index);
    let view = view(LAT_DEG, LON_DEG, 300.0, 0.0, -30.0);
    let (_, rounds) = settle(&mut index, &mut cells, &view, &from_whole(&whole));
    let levels = |round: &Vec<Demand>| -> BTreeSet<u8> {
        round.iter().filter(|demand| is_segment(demand.page)).map(|demand| demand.page.cell.level()).collect()
    };
    let levels: Vec<_> = rounds.iter().map(levels).collect();
    assert_eq!(levels[..3], [BTreeSet::from([6]), BTreeSet::from([12]), BTreeSet::from([18])], "{levels:?}");
    for round in &rounds {
        let visible: Vec<bool> =
            round.iter().filter(|d| d.urgency == Urgency::Visible).map(|d| is_segment(d.page)).collect();
        assert!(visible.is_sorted_by_key(|is_segment| !is_segment), "a page comes before a segment");
        let first_blocking = round.iter().find(|demand| demand.urgency == Urgency::Blocking);
        let under_eye = |demand: &Demand| {
            demand.page.cell.contains(CellId::containing(LAT_DEG.to_radians(), LON_DEG.to_radians(), LEVEL_MAX))
        };
        assert!(first_blocking.is_none_or(under_eye));
        if round.iter().any(|demand| is_segment(demand.page)) {
            assert!(first_blocking.is_some_and(|demand| is_segment(demand.page)), "the ground waits for its segment");
        }
    }
    // Once they are there the view goes on asking for those that it passes through, and for no others.
    let kept = select(&index, &cells, &view, &PARAMS).demands;
    let kept: BTreeSet<CellId> = kept.iter().filter(|d| is_segment(d.page)).map(|d| d.page.cell).collect();
    let asked: BTreeSet<CellId> = rounds.iter().flatten().filter(|d| is_segment(d.page)).map(|d| d.page.cell).collect();
    assert_eq!(kept, asked);
    assert!(kept.iter().all(|root| root.level().is_multiple_of(SEGMENT_LEVELS) && root.level() > 0));
    // From far away nothing of the index is asked for: the tops are enough.
    let far = made_up::view(LAT_DEG, LON_DEG, 20e6, 0.0, -90.0);
    assert!(select(&index, &cells, &far, &PARAMS).demands.iter().all(|demand| !is_segment(demand.page)));
}

#[test]
fn what_lacks_for_want_of_a_segment_is_debt_until_it_comes() {
    for (whole, height_m) in [(whole_of(&made_up_world(100_000)), 300.0), (with_objects(14), 150.0)] {
        let mut index = tops(&whole);
        let mut cells = with_roots(&index);
        let view = view(LAT_DEG, LON_DEG, height_m, 0.0, -90.0);
        let bring = from_whole(&whole);
        let mut lacked = 0;
        loop {
            let selection = select(&index, &cells, &view, &PARAMS);
            let is_there = |id: PageId| if is_segment(id) { index.find(id.cell).is_some() } else { cells.contains(id) };
            let missing: Vec<PageId> =
                selection.demands.iter().map(|demand| demand.page).filter(|&id| !is_there(id)).collect();
            if missing.is_empty() {
                assert_eq!((selection.stats.debt_px, selection.stats.coverage), (0.0, 1.0));
                break;
            }
            assert!(
                selection.stats.debt_px > 0.0 && selection.stats.coverage < 0.99,
                "{missing:?} {:?}",
                selection.stats
            );
            assert!(selection.stats.pages_missing > 0);
            lacked += 1;
            // Pages first: with all of them there, it is the segment alone that lacks.
            let pages: Vec<PageId> = missing.iter().copied().filter(|&id| !is_segment(id)).collect();
            let now = if pages.is_empty() { missing } else { pages };
            now.into_iter().for_each(|id| bring(id, &mut index, &mut cells));
        }
        assert!(lacked > 3);
    }
}

#[test]
fn surveys_show_the_segments_that_a_view_will_need() {
    let whole = whole_of(&made_up_world(100_000));
    let index = tops(&whole);
    let cells = with_roots(&index);
    let view = view(LAT_DEG, LON_DEG, 300.0, 0.0, -30.0);
    let mut shown = BTreeSet::new();
    survey(&index, &cells, &view, &PARAMS, PARAMS.tolerance_px, |region| {
        if region.kind == PageKind::Segment {
            assert_eq!((region.chain.len(), region.drawn, region.chain[0].cell), (1, None, region.cell));
            assert_eq!(Some(region.chain[0].place), index.segment(region.cell).map(|segment| segment.place));
            shown.insert(region.cell);
        }
    });
    let selection = select(&index, &cells, &view, &PARAMS);
    let asked = selection.demands.iter().filter(|d| is_segment(d.page) && d.urgency == Urgency::Visible);
    assert!(asked.clone().count() > 0 && asked.clone().all(|demand| shown.contains(&demand.page.cell)));
    let ground = ground_demands(&index, &cells, &view, &PARAMS);
    let first = ground.first().unwrap();
    assert!(is_segment(first.page) && first.urgency == Urgency::Blocking);
    // A raised tolerance needs less of the index too.
    let coarse = select_raised(&index, &cells, &view, &PARAMS, 1e5);
    let segments = |selection: &Selection| selection.demands.iter().filter(|demand| is_segment(demand.page)).count();
    assert!(segments(&coarse) <= segments(&selection));
}

#[test]
fn a_world_of_a_hundred_million_cells_is_seen_like_a_small_one() {
    let (small, large) = (made_up_world(100_000), made_up_world(100_000_000));
    let see = |made_up: &SyntheticForest| {
        let mut index = made_up.index().clone();
        let mut cells = with_roots(&index);
        let bring = |id: PageId, index: &mut IndexForest, cells: &mut LiveTree| {
            if is_segment(id) {
                index.insert_segment(made_up.segment(id.cell).unwrap()).unwrap();
            } else {
                cells.insert(&page(id));
            }
        };
        let seen: Vec<_> = [8e6, 200e3, 5e3, 100.0]
            .map(|height_m| {
                let view = view(LAT_DEG, LON_DEG, height_m, 0.0, -60.0);
                let (selection, _) = settle(&mut index, &mut cells, &view, &bring);
                (shown(&selection), selection.stats)
            })
            .into();
        (seen, index.bytes())
    };
    let ((small, small_bytes), (large, large_bytes)) = (see(&small), see(&large));
    assert_eq!(small, large, "what lies far away changes the view");
    assert_eq!(small_bytes.paged, large_bytes.paged);
    assert!(large_bytes.resident() < 16 << 20, "{large_bytes:?}");
}

// ---- Through the engine.

fn fly(source: Source, mode: Mode) -> (Vec<Vec<u8>>, f64) {
    let mut engine = Engine::new(source, EngineParams { mode, ..EngineParams::default() }).unwrap();
    let mut pictures = Vec::new();
    let mut debt_px = 0.0;
    for number in 0..20u32 {
        let view = earth::dive(f64::from(number.min(8)) / 8.0, 60.0, [160, 90]);
        let report = engine.frame(&FrameRequest { view, t_s: f64::from(number) / 60.0, ids: false }).unwrap();
        debt_px = report.debt_px;
        pictures.push(engine.picture().read_color().unwrap());
    }
    (pictures, debt_px)
}

#[test]
fn a_paged_world_on_disk_is_flown_to_the_same_pictures() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("world");
    earth::write(&path);
    let (whole, paged) = (World::open_whole(&path).unwrap(), World::open_paged(&path, 0).unwrap());
    assert!(whole.index().is_whole() && !paged.index().is_whole());
    let loads = |world: &World| {
        let absent = world.index().trees().flat_map(|tree| tree.absent_segments()).next()?;
        let id = PageId { cell: absent.root, kind: PageKind::Segment };
        Some(matches!(world.load(id, absent.place), Ok(Page::Segment(_))))
    };
    assert_eq!((loads(&whole), loads(&paged)), (None, Some(true)));
    let (expected, _) = fly(Source::of(whole), Mode::Settled);
    let (settled, debt_px) = fly(Source::of(paged), Mode::Settled);
    assert_eq!(settled.len(), expected.len());
    for (number, (one, other)) in settled.iter().zip(&expected).enumerate() {
        assert!(one == other, "picture {number} differs");
    }
    assert_eq!(debt_px, 0.0);
    // In lock-step it comes to the same end, a little later.
    let (last, debt_px) = fly(Source::of(World::open_paged(&path, 0).unwrap()), Mode::LockStep);
    assert_eq!(debt_px, 0.0);
    assert!(last.last() == expected.last());
}
