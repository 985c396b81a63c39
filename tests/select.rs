//! The laws of selection, over made-up worlds: no hole, only what is resident, the tolerance, no debt when settled, the
//! same cost at the poles, skirts, objects, the ground under the eye, determinism.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on should stop")]

mod made_up;

use glam::DVec3;
use made_up::{dive_world, page, view, with_roots};
use proptest::prelude::*;
use std::collections::BTreeSet;
use stoop::camera::View;
use stoop::cells::LiveTree;
use stoop::content::{PageId, PageKind};
use stoop::forest::index::IndexForest;
use stoop::forest::{CellId, LEVEL_MAX, Side};
use stoop::geodesy::{Ecef, Geodetic, OrientedBox, Point, SEMI_MAJOR_M, SEMI_MINOR_M};
use stoop::select::{DrawPiece, ObjectsMode, SelectParams, Selection, Urgency, select, select_raised};

const PARAMS: SelectParams = SelectParams::DEFAULT;
const LAT_DEG: f64 = 33.755;
const LON_DEG: f64 = -84.39;

/// Loads all that is demanded until nothing more is.
fn settle(index: &IndexForest, cells: &mut LiveTree, view: &View, params: &SelectParams) -> Selection {
    for _ in 0..4 {
        let selection = select(index, cells, view, params);
        let missing: Vec<_> = selection.demands.iter().filter(|demand| !cells.contains(demand.page)).collect();
        if missing.is_empty() {
            return selection;
        }
        missing.iter().for_each(|demand| cells.insert(&page(demand.page)));
    }
    panic!("the front does not settle");
}

/// Where rays through a grid of pixels first meet the ellipsoid.
fn ground_in_view(view: &View, columns: u32, rows: u32) -> Vec<Geodetic> {
    let (focal, [width, height]) = (view.focal_px(), view.size_px.map(f64::from));
    let scale = DVec3::new(1.0 / SEMI_MAJOR_M, 1.0 / SEMI_MAJOR_M, 1.0 / SEMI_MINOR_M);
    let mut places = Vec::new();
    for at in 0..columns * rows {
        let x = (f64::from(at % columns) + 0.5) / f64::from(columns) * width - width / 2.0;
        let y = (f64::from(at / columns) + 0.5) / f64::from(rows) * height - height / 2.0;
        let way = view.ecef_from_view().rotation() * DVec3::new(x, -y, -focal).normalize();
        let (from, along) = (view.eye().xyz() * scale, way * scale);
        let (a, b, c) = (along.length_squared(), from.dot(along), from.length_squared() - 1.0);
        let discriminant = b * b - a * c;
        if discriminant > 0.0 && -b - discriminant.sqrt() > 0.0 {
            let t = (-b - discriminant.sqrt()) / a;
            places.push(Geodetic::from_ecef(Point::<Ecef>::new(view.eye().xyz() + way * t)));
        }
    }
    places
}

fn pieces_over(pieces: &[DrawPiece], place: Geodetic) -> usize {
    let cell = CellId::containing(place.lat_rad, place.lon_rad, LEVEL_MAX);
    pieces.iter().filter(|piece| piece.cell.contains(cell)).count()
}

fn assert_pieces_are_sound(selection: &Selection, cells: &LiveTree) {
    let mut ascending: Vec<CellId> = selection.pieces.iter().map(|piece| piece.cell).collect();
    ascending.sort();
    for pair in ascending.windows(2) {
        assert!(!pair[0].contains(pair[1]), "{} lies over {}", pair[0], pair[1]);
    }
    for piece in &selection.pieces {
        assert!(piece.terrain.cell.contains(piece.cell), "{} is not cut from {}", piece.cell, piece.terrain.cell);
        assert!(cells.contains(PageId { cell: piece.terrain.cell, kind: PageKind::Terrain }));
        assert!(piece.imagery.is_none_or(|picture| picture.contains(piece.cell) && cells.has_imagery(picture)));
        assert!((0.0..=1.0).contains(&piece.own) && piece.skirt_m > 0.0);
    }
}

fn any_view() -> impl Strategy<Value = View> {
    (-89.99..89.99, -180.0..180.0, 0.5f64..7.2, 0.0..360.0, -90.0..20.0).prop_map(
        |(lat, lon, log_height, heading, pitch): (f64, f64, f64, f64, f64)| {
            view(lat, lon, 10f64.powf(log_height), heading, pitch)
        },
    )
}

/// A view round the place that the world is fine at.
fn near_view() -> impl Strategy<Value = View> {
    (0.0..360.0f64, 0.0..2.0f64, 0.5f64..6.0, 0.0..360.0, -90.0..10.0).prop_map(
        |(direction, heights_off, log_height, heading, pitch)| {
            let height_m = 10f64.powf(log_height);
            let off_deg = (heights_off * height_m / 111_000.0).min(20.0);
            let (sin, cos) = direction.to_radians().sin_cos();
            view(LAT_DEG + off_deg * cos, LON_DEG + off_deg * sin, height_m, heading, pitch)
        },
    )
}

fn residency(index: &IndexForest, seed: u64, share: u64) -> LiveTree {
    let mut cells = with_roots(index);
    let mut state = seed | 1;
    for node in index.trees().flat_map(|tree| tree.nodes()) {
        for (kind, exists) in
            [(PageKind::Terrain, node.terrain().is_some()), (PageKind::Imagery, node.imagery().is_some())]
        {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            if exists && (state >> 33) % 100 < share {
                cells.insert(&page(PageId { cell: node.cell(), kind }));
            }
        }
    }
    cells
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn whatever_is_resident_all_ground_in_view_is_drawn_once(
        view in prop_oneof![any_view(), near_view()], seed in any::<u64>(), share in 0u64..100
    ) {
        let index = dive_world(LAT_DEG, LON_DEG, 13, 11);
        let cells = residency(&index, seed, share);
        let selection = select(&index, &cells, &view, &PARAMS);
        assert_pieces_are_sound(&selection, &cells);
        for place in ground_in_view(&view, 24, 18) {
            prop_assert_eq!(pieces_over(&selection.pieces, place), 1, "{:?}", place);
        }
    }

    #[test]
    fn a_settled_front_keeps_the_tolerance_and_owes_nothing(
        view in prop_oneof![any_view(), near_view()], tolerance_px in 0.5f64..8.0
    ) {
        let index = dive_world(LAT_DEG, LON_DEG, 13, 15);
        let mut cells = with_roots(&index);
        let params = SelectParams { tolerance_px, ..PARAMS };
        let before = select(&index, &cells, &view, &params).stats;
        let settled = settle(&index, &mut cells, &view, &params);
        assert_pieces_are_sound(&settled, &cells);
        let stats = &settled.stats;
        prop_assert_eq!((stats.debt_px, stats.excess_max_px, stats.excess_p99_px, stats.pages_missing), (0.0, 0.0, 0.0, 0));
        prop_assert_eq!(stats.coverage, 1.0);
        prop_assert!(before.debt_px >= 0.0 && (before.debt_px == 0.0) == (before.coverage == 1.0));
        for piece in &settled.pieces {
            // A cell lies in its own box and in those of all cells above it.
            let distance_m = piece
                .cell
                .ancestors()
                .map(|cell| {
                    let (low_m, high_m) = index.find_deepest(cell).unwrap().height_range_m();
                    OrientedBox::around(&cell.bounds(), low_m, high_m).distance_m(view.eye())
                })
                .fold(0.0, f64::max);
            let own = f64::from(piece.own);
            let parent = piece.terrain.cell.parent().map_or(piece.terrain.error_m, |parent| made_up::error_m(parent.level()));
            let error_m = own * f64::from(piece.terrain.error_m) + (1.0 - own) * f64::from(parent);
            let finer = index.find(piece.terrain.cell).unwrap().children().any(|child| child.terrain().is_some());
            let drawn_px = view.projected_px(error_m, distance_m);
            prop_assert!(
                !finer || drawn_px <= tolerance_px * (1.0 + 1e-5),
                "{} from {}: {drawn_px} px, own {own}", piece.cell, piece.terrain.cell
            );
        }
    }

    #[test]
    fn skirts_close_every_seam(view in near_view(), seed in any::<u64>()) {
        let index = dive_world(LAT_DEG, LON_DEG, 12, 10);
        let cells = residency(&index, seed, 50);
        let selection = select(&index, &cells, &view, &PARAMS);
        let error_m = |piece: &DrawPiece| {
            let own = f64::from(piece.own);
            let parent = piece.terrain.cell.parent().map_or(piece.terrain.error_m, |parent| made_up::error_m(parent.level()));
            own * f64::from(piece.terrain.error_m) + (1.0 - own) * f64::from(parent)
        };
        for piece in &selection.pieces {
            for beside in Side::ALL.into_iter().flat_map(|side| piece.cell.edge_neighbors(side)) {
                for other in selection.pieces.iter().filter(|other| other.cell.contains(beside)) {
                    let gap_m = (error_m(piece) + error_m(other)) * (1.0 - 1e-5);
                    prop_assert!(f64::from(piece.skirt_m) >= gap_m && f64::from(other.skirt_m) >= gap_m);
                }
            }
        }
    }

    #[test]
    fn a_raised_tolerance_asks_for_less_and_hides_no_debt(view in near_view(), factor in 1.5f64..6.0) {
        let index = dive_world(LAT_DEG, LON_DEG, 13, 15);
        let mut cells = with_roots(&index);
        let asked = select(&index, &cells, &view, &PARAMS);
        let raised = select_raised(&index, &cells, &view, &PARAMS, factor * PARAMS.tolerance_px);
        prop_assert!(raised.demands.len() <= asked.demands.len());
        prop_assert!((raised.stats.debt_px - asked.stats.debt_px).abs() <= 1e-6 * asked.stats.debt_px);
        settle(&index, &mut cells, &view, &SelectParams { tolerance_px: factor * PARAMS.tolerance_px, ..PARAMS });
        let drawn = select_raised(&index, &cells, &view, &PARAMS, factor * PARAMS.tolerance_px);
        let exact = select(&index, &cells, &view, &PARAMS);
        prop_assert!(drawn.stats.debt_px <= asked.stats.debt_px + 1e-9);
        prop_assert!(exact.stats.debt_px <= drawn.stats.debt_px + 1e-9);
    }
}

#[test]
fn the_same_input_gives_the_same_selection() {
    let index = dive_world(LAT_DEG, LON_DEG, 13, 12);
    let view = view(LAT_DEG - 0.05, LON_DEG, 3000.0, 10.0, -20.0);
    let describe = |selection: Selection| {
        let pieces: Vec<_> = selection
            .pieces
            .iter()
            .map(|piece| (piece.cell, piece.terrain.cell, piece.imagery, piece.own, piece.skirt_m))
            .collect();
        (pieces, selection.demands, selection.press, selection.stats)
    };
    let first = describe(select(&index, &residency(&index, 5, 40), &view, &PARAMS));
    let second = describe(select(&index, &residency(&index, 5, 40), &view, &PARAMS));
    assert_eq!(first, second);
    assert!(!first.1.is_empty());
}

#[test]
fn a_world_that_is_even_costs_the_same_at_a_pole() {
    let even = |lat_deg: f64, lon_deg: f64| {
        let place = Geodetic::from_degrees(lat_deg, lon_deg, 0.0).to_ecef();
        let refines = move |cell: CellId| {
            let bounds = cell.bounds();
            let apart_m = bounds.center().to_ecef().distance_m(place);
            cell.level() < 2 || (cell.level() < 12 && apart_m < 50_000.0 + bounds.height_rad() * SEMI_MAJOR_M)
        };
        made_up::build(&made_up::Plan { terrain_refines: refines, imagery_refines: refines, object_roots: Vec::new() })
    };
    let cost = |index: &IndexForest, lat_deg: f64, (height_m, pitch_deg, heading_deg): (f64, f64, f64)| {
        let view = view(lat_deg, 10.0, height_m, heading_deg, pitch_deg);
        let selection = settle(index, &mut with_roots(index), &view, &PARAMS);
        let pages = selection.demands.iter().filter(|demand| demand.urgency == Urgency::Visible);
        [selection.pieces.len() as f64, pages.map(|demand| f64::from(demand.place.len)).sum::<f64>()]
    };
    let equator = even(0.3, 10.0);
    for lat_deg in [89.4, 89.8, 89.99, -89.9, -75.0] {
        let pole = even(lat_deg, 10.0);
        let (mut worst, mut sums) = ([0.0f64; 2], [[0.0f64; 2]; 2]);
        for height_m in [1_000.0, 3_000.0, 8_000.0] {
            for pitch_deg in [-90.0, -60.0, -40.0, -20.0] {
                for heading_deg in [0.0, 30.0, 45.0, 90.0, 200.0, 300.0] {
                    let at = (height_m, pitch_deg, heading_deg);
                    let (there, here) = (cost(&pole, lat_deg, at), cost(&equator, 0.3, at));
                    if here[0] >= 25.0 {
                        for what in 0..2 {
                            worst[what] = worst[what].max(there[what] / here[what]);
                            sums[0][what] += there[what];
                            sums[1][what] += here[what];
                        }
                    }
                }
            }
        }
        let mean = [sums[0][0] / sums[1][0], sums[0][1] / sums[1][1]];
        println!("{lat_deg}: cells and bytes against the equator's: mean {mean:.2?}, worst {worst:.2?}");
        assert!(worst[0] <= 3.0 && mean[1] <= 2.0, "{lat_deg}: {worst:?}, {mean:?}");
        // Next to the pole itself the eight rows of cells round it have 0.58 of the equator's area on average, which
        // is 1.7 times the pages, all of one length here; where a picture ends among them adds to it.
        let limit = if lat_deg > 89.9 { 2.4 } else { 2.0 };
        assert!(worst[1] <= limit, "{lat_deg}: {worst:?}");
    }
}

/// A world with pages of objects round the place, rooted at level 14.
fn city() -> IndexForest {
    let center = CellId::containing(LAT_DEG.to_radians(), LON_DEG.to_radians(), 14);
    let object_roots = center.neighbors().into_iter().chain([center]).collect();
    let refines = |cell: CellId| cell.level() < 3 || (cell.level() < 13 && made_up::is_near(cell, LAT_DEG, LON_DEG));
    made_up::build(&made_up::Plan { terrain_refines: refines, imagery_refines: refines, object_roots })
}

#[test]
fn objects_are_paged_and_drawn_from_the_threshold_on() {
    let index = city();
    let is_objects = |page: PageId| matches!(page.kind, PageKind::Objects { .. });
    for (height_m, threshold_px) in [(300.0, 1.0), (3_000.0, 4.0), (20_000.0, 1.0), (50_000.0, 1.0)] {
        let view = view(LAT_DEG - 0.001, LON_DEG, height_m, 20.0, -60.0);
        let params = SelectParams { threshold_px, ..PARAMS };
        let mut cells = with_roots(&index);
        let first = select(&index, &cells, &view, &params);
        let settled = settle(&index, &mut cells, &view, &params);
        let demanded = settled.demands.iter().filter(|demand| is_objects(demand.page)).count();
        let possible = view.projected_px(60.0, height_m - 200.0) >= threshold_px;
        assert_eq!(demanded > 0, possible, "{height_m} m, {threshold_px} px");
        if possible {
            assert!(first.stats.debt_px > settled.stats.debt_px && first.stats.objects_drawn == 0);
        }
        let mut drawn = 0;
        for draw in &settled.objects {
            assert!(draw.objects.windows(2).all(|pair| pair[0].end < pair[1].start), "ascending and apart");
            let is_drawn = |at: u32| draw.objects.iter().any(|range| range.contains(&at));
            drawn += draw.objects.iter().map(|range| range.end - range.start).sum::<u32>();
            for (at, object) in draw.page.objects.iter().enumerate() {
                let px = view.projected_px(object.dimension_m.into(), view.eye().distance_m(object.place));
                let in_picture = view
                    .project_px(object.place)
                    .is_some_and(|[x, y]| (0.0..640.0).contains(&x) && (0.0..360.0).contains(&y));
                if px < threshold_px {
                    assert!(!is_drawn(at as u32), "an object of {px} px is drawn");
                } else if in_picture {
                    assert!(is_drawn(at as u32), "an object of {px} px in the picture is not drawn");
                }
            }
        }
        let stats = &settled.stats;
        assert_eq!((stats.objects_drawn, stats.objects_tested), (drawn, drawn + stats.objects_culled));
    }
}

#[test]
fn a_raised_threshold_hides_no_debt() {
    let index = city();
    let view = view(LAT_DEG, LON_DEG, 6_000.0, 0.0, -90.0);
    let cells = with_roots(&index);
    let objects_wanted = |selection: &Selection| {
        selection.demands.iter().filter(|demand| matches!(demand.page.kind, PageKind::Objects { .. })).count()
    };
    let asked = select(&index, &cells, &view, &PARAMS);
    let raised = select_raised(&index, &cells, &view, &PARAMS, 8.0);
    assert!(objects_wanted(&asked) > 0 && objects_wanted(&raised) == 0);
    assert!((asked.stats.debt_px - raised.stats.debt_px).abs() < 1e-9 * asked.stats.debt_px);
}

#[test]
fn the_modes_draw_what_they_say() {
    let index = city();
    let view = view(LAT_DEG, LON_DEG, 10_000.0, 0.0, -90.0);
    let drawn = |objects: ObjectsMode| {
        let params = SelectParams { objects, threshold_px: 1.0, ..PARAMS };
        settle(&index, &mut with_roots(&index), &view, &params).stats.objects_drawn
    };
    assert_eq!(drawn(ObjectsMode::Off), 0);
    assert_eq!(drawn(ObjectsMode::Flat), 9 * 16 * 9);
    assert!(drawn(ObjectsMode::Cells) < drawn(ObjectsMode::Flat) && drawn(ObjectsMode::Cells) > 0);
    assert_eq!(drawn(ObjectsMode::Groups), drawn(ObjectsMode::Cells));
}

#[test]
fn finer_pages_stand_in_for_a_missing_one() {
    let index = dive_world(LAT_DEG, LON_DEG, 14, 14);
    let mut cells = with_roots(&index);
    let near = view(LAT_DEG, LON_DEG, 20_000.0, 0.0, -90.0);
    let fine = settle(&index, &mut cells, &near, &PARAMS);
    let finest =
        |selection: &Selection| selection.pieces.iter().filter_map(|piece| piece.imagery).map(CellId::level).max();
    let back = select(&index, &cells, &view(LAT_DEG, LON_DEG, 45_000.0, 0.0, -90.0), &PARAMS);
    assert!(back.stats.pages_missing > 0);
    assert_eq!(finest(&back), finest(&fine), "the pages of the nearer view are drawn, not the root's");
    assert_pieces_are_sound(&back, &cells);
}

#[test]
fn the_chain_under_the_eye_and_the_roots_come_first() {
    let index = dive_world(LAT_DEG, LON_DEG, 14, 10);
    let up = view(LAT_DEG, LON_DEG, 50.0, 0.0, 80.0);
    let selection = select(&index, &with_roots(&index), &up, &PARAMS);
    let blocking: BTreeSet<PageId> = selection
        .demands
        .iter()
        .filter(|demand| demand.urgency == Urgency::Blocking)
        .map(|demand| demand.page)
        .collect();
    for tree in index.trees() {
        assert!(blocking.contains(&PageId { cell: tree.root().cell(), kind: PageKind::Terrain }));
    }
    let under = CellId::containing(LAT_DEG.to_radians(), LON_DEG.to_radians(), 14);
    for cell in under.ancestors() {
        assert!(blocking.contains(&PageId { cell, kind: PageKind::Terrain }), "{cell}");
    }
    let ranks: Vec<Urgency> = selection.demands.iter().map(|demand| demand.urgency).collect();
    assert!(ranks.is_sorted_by(|a, b| a >= b));
    let pages: BTreeSet<PageId> = selection.demands.iter().map(|demand| demand.page).collect();
    assert_eq!(pages.len(), selection.demands.len(), "each page once");
}

#[test]
fn ground_above_the_eye_is_pressed() {
    let index = dive_world(LAT_DEG, LON_DEG, 14, 3);
    let mut cells = with_roots(&index);
    settle(&index, &mut cells, &view(LAT_DEG, LON_DEG, 20.0, 0.0, 0.0), &PARAMS);
    let below = select(&index, &cells, &view(LAT_DEG, LON_DEG, 5.0, 0.0, 0.0), &PARAMS);
    let press = below.press.expect("ground at 10 m lies over an eye at 5 m");
    let drawn_m = cells.surface_height_m(LAT_DEG.to_radians(), LON_DEG.to_radians()).unwrap();
    assert!((9.0..=10.0).contains(&drawn_m), "a page's corners are at 10 m, its flat triangles sink between them");
    assert!((f64::from(press.depth_m) - (drawn_m - 3.0)).abs() < 1e-3);
    assert!(press.radius_m >= 50.0);
    let above = select(&index, &cells, &view(LAT_DEG, LON_DEG, 5000.0, 0.0, 0.0), &PARAMS);
    assert_eq!(above.press, None);
}
