//! The laws of selection, over made-up worlds: no hole, only what is resident, the tolerance, no debt when settled, the
//! same cost at the poles, skirts, objects, the ground under the eye, determinism.

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

const PARAMS: SelectParams = SelectParams { tolerance_px: 1.0, threshold_px: 1.0, objects: ObjectsMode::Groups };
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
        let picture = piece.imagery.expect("the roots' pictures are resident");
        assert!(picture.contains(piece.cell) && cells.has_imagery(picture));
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
    #![proptest_config(ProptestConfig::with_cases(48))]

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
    let even = |lat_deg: f64, lon_deg: f64| dive_world(lat_deg, lon_deg, 16, 16);
    for height_m in [2_000.0, 20_000.0] {
        let cost = |lat_deg: f64| {
            let index = even(lat_deg, 10.0);
            let selection =
                settle(&index, &mut with_roots(&index), &view(lat_deg, 10.0, height_m, 45.0, -35.0), &PARAMS);
            let pages = selection.demands.iter().filter(|demand| demand.urgency == Urgency::Visible);
            (selection.pieces.len(), pages.map(|demand| u64::from(demand.place.len)).sum::<u64>())
        };
        let equator = cost(0.3);
        assert!(equator.0 >= 25, "{equator:?}");
        for lat_deg in [89.4, 89.99, -89.9, 75.0] {
            let pole = cost(lat_deg);
            assert!(pole.0 <= 3 * equator.0 && pole.1 <= 2 * equator.1, "{lat_deg}: {pole:?} against {equator:?}");
        }
    }
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
        for kind in [PageKind::Terrain, PageKind::Imagery] {
            assert!(blocking.contains(&PageId { cell: tree.root().cell(), kind }));
        }
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
