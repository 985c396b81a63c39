//! Groups in selection, over a made-up tree of pages: whatever is resident, no object is drawn twice, and none is left out
//! whose page or groups are there; the front is the coarsest within the tolerance; no page before its distance.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on should stop")]

mod made_up;

use made_up::{view, with_roots};
use proptest::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use stoop::camera::View;
use stoop::cells::LiveTree;
use stoop::content::{CellObjects, FIRST_GROUPS, Object, ObjectMesh, ObjectPage, Page, PageId, PageKind};
use stoop::forest::index::{IndexForest, IndexTree, NodeInfo, ObjectsBelow, ObjectsEntry, Place, TerrainEntry};
use stoop::forest::{CellId, Quadrant, Zone};
use stoop::select::{Demand, SelectParams, Selection, select, select_raised};

const PARAMS: SelectParams = SelectParams::DEFAULT;
const LAT_DEG: f64 = 33.755;
const LON_DEG: f64 = -84.39;
const DIMENSION_M: f64 = 1000.0;
/// Errors of the reps that each root has: two of its own objects, and groups by depth in the tree of pages.
const SIMPLER_M: f64 = 0.5;
const GROUPS_M: [&[f64]; 3] = [&[40.0, 80.0], &[10.0, 20.0], &[4.0]];
const LEVELS: [u8; 3] = [10, 12, 13];

/// The roots of pages: one, two below it, two below each of those.
fn roots() -> Vec<(CellId, usize)> {
    let top = CellId::containing(LAT_DEG.to_radians(), LON_DEG.to_radians(), LEVELS[0]);
    let mut roots = vec![(top, 0)];
    let down = |cell: CellId, by: u8, way: Quadrant| (0..by).fold(cell, |cell, _| cell.child(way).unwrap());
    for way in [Quadrant::SouthWest, Quadrant::NorthEast] {
        let middle = down(top, LEVELS[1] - LEVELS[0], way);
        roots.push((middle, 1));
        for way in [Quadrant::SouthEast, Quadrant::NorthWest] {
            roots.push((down(middle, LEVELS[2] - LEVELS[1], way), 2));
        }
    }
    roots.sort();
    roots
}

/// Reps at a root: number and error.
fn reps(depth: usize) -> Vec<(u8, f64)> {
    let groups = GROUPS_M[depth].iter().zip(FIRST_GROUPS..).map(|(&error_m, rep)| (rep, error_m));
    [(0, 0.0), (1, SIMPLER_M)].into_iter().chain(groups).collect()
}

fn id(cell: CellId, rep: u8) -> PageId {
    PageId { cell, kind: PageKind::Objects { collection: 0, rep } }
}

fn all_pages() -> Vec<PageId> {
    roots().into_iter().flat_map(|(cell, depth)| reps(depth).into_iter().map(move |(rep, _)| id(cell, rep))).collect()
}

fn world() -> IndexForest {
    let mut forest = IndexForest::default();
    for zone in Zone::all() {
        let mut cells: BTreeMap<CellId, NodeInfo> = BTreeMap::new();
        let mut offset = 64;
        let mut place = |len: u32| {
            offset += u64::from(len);
            Place::new(offset - u64::from(len), len).unwrap()
        };
        let terrain = Some(TerrainEntry { place: place(3000), error_m: 4000.0 });
        cells.insert(zone.root(), NodeInfo { terrain, height_range_m: (0.0, 120.0), ..NodeInfo::default() });
        for (root, depth) in roots().into_iter().filter(|(root, _)| root.zone() == zone) {
            for above in root.ancestors() {
                let info = cells.entry(above).or_default();
                (info.dimension_m, info.reach_m, info.height_range_m) = (DIMENSION_M, 40.0, (0.0, 120.0));
            }
            let info = cells.get_mut(&root).unwrap();
            info.below.push(ObjectsBelow { collection: 0, dimension_m: DIMENSION_M, alone: true });
            info.objects.extend(reps(depth).into_iter().map(|(rep, error_m)| {
                let dimension_m = if rep == 0 { DIMENSION_M } else { 0.0 };
                ObjectsEntry { collection: 0, rep, place: place(20_000), dimension_m, error_m }
            }));
        }
        forest.insert(IndexTree::build(zone, &cells).unwrap());
    }
    forest
}

/// A page with one large object for each part: of an own page for its root, of groups also for each root next below.
fn page(page: PageId) -> Page {
    let PageKind::Objects { rep, .. } = page.kind else { return made_up::page(page) };
    let mut parts = vec![page.cell];
    if rep >= FIRST_GROUPS {
        let below = roots().into_iter().map(|(cell, _)| cell);
        let below: Vec<CellId> = below.filter(|&cell| cell != page.cell && page.cell.contains(cell)).collect();
        parts.extend(below.iter().filter(|&&cell| !below.iter().any(|&above| above != cell && above.contains(cell))));
    }
    let objects: Vec<Object> = (0..).zip(&parts).map(|(at, &cell)| object(at, cell)).collect();
    let cells = (0..).zip(&parts).map(|(at, &cell)| CellObjects {
        cell,
        objects: at..at + 1,
        height_range_m: (10.0, 110.0),
        dimension_m: DIMENSION_M as f32,
    });
    let drawn = ObjectPage {
        root: page.cell,
        collection: 0,
        rep,
        error_m: 0.0,
        origin: page.cell.bounds().center().to_ecef(),
        cells: cells.collect(),
        objects,
        footprints: Default::default(),
        looks: Vec::new(),
    };
    Page::Objects(Arc::new(drawn), Arc::new(ObjectMesh::default()))
}

fn object(at: u32, cell: CellId) -> Object {
    let place = cell.bounds().center().at_height(10.0);
    Object {
        id: at,
        cell,
        place: place.to_ecef(),
        lat_rad: place.lat_rad,
        lon_rad: place.lon_rad,
        base_m: 10.0,
        top_m: 110.0,
        dimension_m: DIMENSION_M as f32,
        reach_m: 40.0,
        wall_color: [0; 3],
        roof_color: [0; 3],
        indices: at * 6..at * 6 + 6,
    }
}

/// How often each root's own objects are drawn, by their own pages or by groups.
fn drawn(selection: &Selection) -> BTreeMap<CellId, u32> {
    let mut times: BTreeMap<CellId, u32> = roots().into_iter().map(|(cell, _)| (cell, 0)).collect();
    for draw in &selection.objects {
        for at in draw.objects.iter().flat_map(Clone::clone) {
            let part = draw.page.objects[at as usize].cell;
            let is_for = |cell: CellId| match draw.page.rep >= FIRST_GROUPS && part != draw.page.root {
                true => part.contains(cell),
                false => part == cell,
            };
            times.iter_mut().filter(|(cell, _)| is_for(**cell)).for_each(|(_, times)| *times += 1);
        }
    }
    times
}

/// Straight down from a height; all roots are in the picture, far above the threshold.
fn above(height_m: f64) -> View {
    let center = roots()[0].0.bounds().center();
    view(center.lat_deg(), center.lon_deg(), height_m, 0.0, -90.0)
}

fn resident(index: &IndexForest, pages: &BTreeSet<PageId>) -> LiveTree {
    let mut cells = with_roots(index);
    pages.iter().for_each(|&id| cells.insert(&page(id)));
    cells
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]
    #[test]
    fn nothing_is_drawn_twice_and_nothing_left_out_that_is_there(
        kept in prop::collection::vec(any::<bool>(), all_pages().len()), height_m in 8_000.0..30_000.0f64,
        raised in 1.0..8.0f64,
    ) {
        let index = world();
        let pages: BTreeSet<PageId> =
            all_pages().into_iter().zip(&kept).filter(|(_, kept)| **kept).map(|(page, _)| page).collect();
        let selection = select_raised(&index, &resident(&index, &pages), &above(height_m), &PARAMS, raised);
        let times = drawn(&selection);
        prop_assert!(times.values().all(|&times| times <= 1), "{times:?}");
        for (&cell, &times) in &times {
            // The page that the front wants there: the root's own, or groups of it or of a root above.
            let wanted = selection.demands.iter().filter_map(|demand| match demand.page.kind {
                PageKind::Objects { rep, .. } if rep >= FIRST_GROUPS => Some(demand.page.cell),
                PageKind::Objects { .. } => Some(demand.page.cell).filter(|&root| root == cell),
                _ => None,
            });
            let wanted = wanted.filter(|root| root.contains(cell)).max_by_key(|root| root.level()).unwrap();
            let has_groups = roots().iter().any(|&(root, depth)| {
                let mut groups = reps(depth).into_iter().filter(|&(rep, _)| rep >= FIRST_GROUPS);
                root.contains(wanted) && groups.any(|(rep, _)| pages.contains(&id(root, rep)))
            });
            let is_own = |demand: &&Demand| demand.page == id(cell, 0) || demand.page == id(cell, 1);
            let has_own =
                selection.demands.iter().any(|demand| is_own(&demand)) && (0..2).any(|rep| pages.contains(&id(cell, rep)));
            prop_assert!(times == 1 || !(has_groups || has_own), "{cell} is left out");
        }
    }
}

#[test]
fn the_front_is_the_coarsest_within_the_tolerance_and_settles_without_debt() {
    let index = world();
    for height_m in [5_000.0, 8_000.0, 14_000.0, 20_000.0, 30_000.0] {
        let view = above(height_m);
        let mut cells = with_roots(&index);
        let selection = select(&index, &cells, &view, &PARAMS);
        assert!(selection.stats.debt_px > 0.0);
        for demand in &selection.demands {
            if !cells.contains(demand.page) {
                cells.insert(&page(demand.page));
            }
        }
        let settled = select(&index, &cells, &view, &PARAMS);
        let key = |selection: &Selection| selection.demands.iter().map(|demand| demand.page).collect::<BTreeSet<_>>();
        assert_eq!((settled.stats.debt_px, key(&settled)), (0.0, key(&selection)), "{height_m}");
        assert!(drawn(&settled).values().all(|&times| times == 1), "{height_m}");
        for draw in &settled.objects {
            let (_, depth) = roots().into_iter().find(|(cell, _)| *cell == draw.page.root).unwrap();
            let error_m = reps(depth).into_iter().find(|(rep, _)| *rep == draw.page.rep).unwrap().1;
            assert!(view.projected_px(error_m, height_m - 120.0) <= 1.3, "{height_m}: {error_m} m");
        }
    }
    // From afar the coarsest groups of all are one page.
    let far = select(&index, &with_roots(&index), &above(30_000.0), &PARAMS);
    let objects = far.demands.iter().filter(|demand| matches!(demand.page.kind, PageKind::Objects { .. }));
    assert_eq!(objects.count(), 1);
}

#[test]
fn finer_pages_stand_in_for_groups_without_debt_while_one_moves_away() {
    let index = world();
    let near: BTreeSet<PageId> = roots().into_iter().map(|(cell, _)| id(cell, 0)).collect();
    let selection = select(&index, &resident(&index, &near), &above(25_000.0), &PARAMS);
    assert!(drawn(&selection).values().all(|&times| times == 1));
    assert_eq!(selection.stats.debt_px, 0.0);
    assert!(selection.demands.iter().any(|demand| !near.contains(&demand.page)), "the groups are still asked for");
}

#[test]
fn no_page_is_asked_for_before_its_distance() {
    let index = world();
    let cells = with_roots(&index);
    for step in 0..200 {
        let height_m = 400.0 * 1.035f64.powi(step);
        let view = above(height_m);
        let selection = select(&index, &cells, &view, &PARAMS);
        let asked = selection.demands.iter().any(|demand| matches!(demand.page.kind, PageKind::Objects { .. }));
        // D = d · viewport_h / (2 · threshold · tan(fov/2)); boxes reach up to 120 m and half a reach about.
        let distance_m = DIMENSION_M * view.projected_px(1.0, 1.0) / PARAMS.threshold_px;
        if height_m - 200.0 > distance_m {
            assert!(!asked, "{height_m} m is beyond {distance_m} m");
        } else if height_m < distance_m {
            assert!(asked, "{height_m} m is within {distance_m} m");
        }
    }
}
