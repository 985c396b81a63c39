//! The laws of the forest (zones, cells, thinning, neighbours, least sides, linked cells).

use proptest::prelude::*;
use std::collections::{BTreeMap, HashSet};
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};
use stoop::cells::{linked_cells, linked_cells_at, quadrant_at};
use stoop::forest::{CellId, LEVEL_MAX, Quadrant, Side, Zone, columns, thinning};
use stoop::geodesy::{Ecef, Geodetic, Point};

fn cells_of(level: u8) -> impl Iterator<Item = CellId> {
    Zone::all().flat_map(move |zone| {
        (0..1 << level)
            .flat_map(move |y| (0..columns(zone, level, y)).filter_map(move |x| CellId::new(zone, level, x, y)))
    })
}

fn any_level() -> impl Strategy<Value = u8> {
    prop_oneof![0..=LEVEL_MAX, 0..=6u8]
}

/// Latitudes everywhere, and more of them near poles and where rows thin.
fn any_lat() -> impl Strategy<Value = f64> {
    let near_pole = (0.0f64..1.0, any::<bool>()).prop_map(|(t, north)| {
        let lat_rad = FRAC_PI_2 - 1e-8 * 1e8f64.powf(t) * FRAC_PI_4;
        if north { lat_rad } else { -lat_rad }
    });
    let near_thinning = (1..20i32, -1.0f64..1.0, 0.0f64..12.0).prop_map(|(k, side, digits)| {
        (0.5f64.powi(k).acos() + side * 10f64.powf(-digits)).clamp(-FRAC_PI_2, FRAC_PI_2)
    });
    prop_oneof![2 => -FRAC_PI_2..=FRAC_PI_2, 2 => near_pole, 1 => near_thinning]
}

fn any_cell() -> impl Strategy<Value = CellId> {
    (any_level(), any_lat(), -PI..PI).prop_map(|(level, lat, lon)| CellId::containing(lat, lon, level))
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn the_parent_of_a_child_is_the_cell(cell in any_cell()) {
        let children: Vec<_> = cell.children().collect();
        let expected = if cell.level() == LEVEL_MAX {
            0
        } else {
            4 - [false, true].iter().filter(|&&north| cell.child_row_is_thinned(north)).count()
        };
        prop_assert_eq!(children.len(), expected);
        // A cell has four children, or three where k grows; round a pole k always grows in one row only.
        prop_assert!(expected == 0 || expected == 3 || expected == 4);
        for child in children {
            prop_assert_eq!(child.parent(), Some(cell));
            prop_assert_eq!(child.quadrant().and_then(|quadrant| cell.child(quadrant)), Some(child));
            prop_assert!(cell.contains(child) && !child.contains(cell));
            let (outer, inner) = (cell.bounds(), child.bounds());
            prop_assert!(outer.west_rad <= inner.west_rad && inner.east_rad <= outer.east_rad);
            prop_assert!(outer.south_rad <= inner.south_rad && inner.north_rad <= outer.north_rad);
        }
    }

    #[test]
    fn k_grows_by_at_most_one_to_the_child_rows(cell in any_cell()) {
        for child in cell.children() {
            prop_assert!((cell.thinning()..=cell.thinning() + 1).contains(&child.thinning()));
        }
    }

    #[test]
    fn a_point_is_in_exactly_one_cell_of_a_level(level in any_level(), lat in any_lat(), lon in -PI..PI) {
        let cell = CellId::containing(lat, lon, level);
        let holds = |cell: CellId| {
            let b = cell.bounds();
            let below_north = if cell.touches_pole(Side::North) { lat <= b.north_rad } else { lat < b.north_rad };
            b.south_rad <= lat && below_north && b.west_rad <= lon && lon < b.east_rad
        };
        prop_assert!(holds(cell), "{cell} {lat} {lon}");
        for neighbor in cell.neighbors() {
            prop_assert!(!holds(neighbor), "{neighbor} {lat} {lon}");
        }
        for above in 0..=level {
            prop_assert_eq!(cell.ancestor(above), Some(CellId::containing(lat, lon, above)));
        }
    }

    #[test]
    fn a_corner_is_in_the_cell_north_and_east_of_it(cell in any_cell()) {
        let b = cell.bounds();
        prop_assert_eq!(CellId::containing(b.south_rad, b.west_rad, cell.level()), cell);
        prop_assert_eq!(CellId::containing(b.south_rad, b.west_rad + 2.0 * PI, cell.level()).level(), cell.level());
    }

    #[test]
    fn a_cell_survives_its_ordinal(cell in any_cell(), bits in any::<u64>()) {
        prop_assert_eq!(CellId::from_u64(cell.to_u64()), Some(cell));
        let (x, y) = cell.xy();
        prop_assert_eq!(CellId::new(cell.zone(), cell.level(), x, y), Some(cell));
        // Any bits either name a cell that gives them back, or none.
        for bits in [bits, cell.to_u64() ^ 1 << (bits % 64)] {
            if let Some(other) = CellId::from_u64(bits) {
                let (x, y) = other.xy();
                prop_assert_eq!(CellId::new(other.zone(), other.level(), x, y), Some(other));
                prop_assert_eq!(other.to_u64(), bits);
            }
        }
    }

    #[test]
    fn a_subtree_is_a_contiguous_range(cell in any_cell(), other in any_cell()) {
        prop_assert_eq!(cell.subtree().contains(&other), cell.contains(other));
        for child in cell.children() {
            prop_assert!(cell < child && child.subtree().end() <= cell.subtree().end());
        }
    }

    #[test]
    fn widths_keep_their_bound(cell in any_cell()) {
        let (b, sides) = (cell.bounds(), cell.sides_m());
        let equatorward = b.south_rad.abs().min(b.north_rad.abs());
        let width = b.width_rad() * equatorward.cos() / b.height_rad();
        prop_assert!((0.5 - 1e-9..=1.0 + 1e-9).contains(&width), "{cell}: {width}");
        let width_m = sides.south_m.max(sides.north_m) / sides.height_m;
        prop_assert!((0.5..=1.007).contains(&width_m), "{cell}: {width_m}");
    }

    #[test]
    fn neighbors_are_symmetric(cell in any_cell()) {
        let neighbors = cell.neighbors();
        prop_assert!(!neighbors.contains(&cell));
        prop_assert_eq!(neighbors.iter().collect::<HashSet<_>>().len(), neighbors.len());
        for neighbor in neighbors {
            prop_assert_eq!(neighbor.level(), cell.level());
            prop_assert!(neighbor.neighbors().contains(&cell), "{cell} {neighbor}");
            prop_assert!(neighbor.thinning().abs_diff(cell.thinning()) <= 1);
        }
    }

    #[test]
    fn edge_neighbors_are_symmetric(cell in any_cell()) {
        for side in Side::ALL {
            let back = match side {
                _ if cell.touches_pole(side) => side,
                Side::West => Side::East,
                Side::East => Side::West,
                Side::South => Side::North,
                Side::North => Side::South,
            };
            let across = cell.edge_neighbors(side);
            prop_assert!((1..=2).contains(&across.len()));
            for neighbor in across {
                prop_assert!(neighbor.edge_neighbors(back).contains(&cell), "{cell} {side:?} {neighbor}");
                prop_assert!(cell.neighbors().contains(&neighbor));
            }
        }
    }

    #[test]
    fn the_least_side_is_that_of_the_neighbourhood(cell in any_cell()) {
        let round = cell.neighbors().into_iter().chain([cell]);
        let least = round.fold(f64::INFINITY, |least, near| {
            let sides = near.sides_m();
            let south = if near.touches_pole(Side::South) { f64::INFINITY } else { sides.south_m };
            let north = if near.touches_pole(Side::North) { f64::INFINITY } else { sides.north_m };
            least.min(south).min(north).min(sides.height_m)
        });
        let l_q = cell.l_q_m();
        // Widths here are differences of edges: at level 22 good to 10⁻⁹.
        prop_assert!(l_q <= least * (1.0 + 1e-9), "{cell}: {l_q} {least}");
        let polar = cell.touches_pole(Side::South) || cell.touches_pole(Side::North);
        let bounds = cell.bounds();
        let part = match cell.level() {
            0..5 => 0.5,
            _ if polar => 0.973,
            _ if bounds.width_rad() > 0.01 => 0.99,
            _ => 0.999,
        };
        prop_assert!(l_q >= part * least, "{cell}: {} {least}", l_q / least);
    }

    /// An object's box (reach × reach, just under what its cell allows) against the quadrants that it really touches.
    #[test]
    fn linked_cells_miss_no_object(
        level in any_level(), lat in any_lat(), lon in -PI..PI, snap in 0..6u8, part in 0.0f64..1.0,
    ) {
        let (lat, lon) = snapped(level, lat, lon, snap);
        let home = CellId::containing(lat, lon, level);
        let part = 1.0 - part * part * part;
        let half_m = home.l_q_m() * part * (1.0 - 1e-12) / 2.0;
        for (lat_rad, lon_rad) in footprint(lat, lon, half_m) {
            let linked = linked_cells_at(lat_rad, lon_rad, level);
            prop_assert!(
                linked.contains(&home),
                "an object of {home} (half {half_m} m) reaches {lat_rad} {lon_rad} in {}", linked[0]
            );
        }
    }
}

/// Moves a place to an edge or the middle of its cell, where objects just reach or just do not.
fn snapped(level: u8, lat: f64, lon: f64, how: u8) -> (f64, f64) {
    let b = CellId::containing(lat, lon, level).bounds();
    let inside = |low: f64, high: f64| low + (high - low) * (1.0 - 1e-9);
    match how {
        1 => (b.south_rad, b.west_rad),
        2 => (inside(b.south_rad, b.north_rad), b.west_rad),
        3 => (lat, b.west_rad),
        4 => (b.south_rad, lon),
        5 => (inside(b.south_rad, b.north_rad), inside(b.west_rad, b.east_rad)),
        _ => (lat, lon),
    }
}

/// Places on the ellipsoid in the square of half side `half_m` in the local frame of a place.
fn footprint(lat_rad: f64, lon_rad: f64, half_m: f64) -> Vec<(f64, f64)> {
    let frame = Geodetic { lat_rad, lon_rad, height_m: 0.0 }.ecef_from_enu();
    let steps = 6;
    let mut places = Vec::new();
    for row in -steps..=steps {
        for column in -steps..=steps {
            let (east, north) = (f64::from(column) / 6.0 * half_m, f64::from(row) / 6.0 * half_m);
            let on_plane: Point<Ecef> = frame * Point::new(glam::DVec3::new(east, north, 0.0));
            if let Some(point) = down_to_ellipsoid(on_plane, frame.rotation().z_axis) {
                let place = Geodetic::from_ecef(point);
                places.push((place.lat_rad, place.lon_rad));
            }
        }
    }
    places
}

/// Where the line through `from` along `up` meets the ellipsoid first when coming from above.
fn down_to_ellipsoid(from: Point<Ecef>, up: glam::DVec3) -> Option<Point<Ecef>> {
    use stoop::geodesy::{SEMI_MAJOR_M, SEMI_MINOR_M};
    let scale = 1.0 / glam::DVec3::new(SEMI_MAJOR_M, SEMI_MAJOR_M, SEMI_MINOR_M);
    let (p, d) = (from.xyz() * scale, up * scale);
    let (a, b, c) = (d.dot(d), p.dot(d), p.dot(p) - 1.0);
    let root = b * b - a * c;
    // Up is outward: the root with the larger parameter, written so that nothing cancels.
    (root >= 0.0).then(|| Point::new(from.xyz() - up * (c / (b + root.sqrt()))))
}

#[test]
fn the_cells_of_a_level_cover_the_sphere_once() {
    for level in 0..=7 {
        let mut sum = 0.0;
        let mut count = 0usize;
        for cell in cells_of(level) {
            let b = cell.bounds();
            sum += b.width_rad() * (b.north_rad.sin() - b.south_rad.sin());
            count += 1;
        }
        assert!((sum - 4.0 * PI).abs() < 1e-9, "level {level}: {sum}");
        let by_rows: usize =
            Zone::all().map(|zone| (0..1u32 << level).map(|y| columns(zone, level, y) as usize).sum::<usize>()).sum();
        assert_eq!(count, by_rows);
    }
}

#[test]
fn k_grows_by_at_most_one_from_row_to_row() {
    for zone in [0, 24].into_iter().filter_map(Zone::new) {
        for level in 0..=12u8 {
            for y in 1..1u32 << level {
                assert!(thinning(zone, level, y).abs_diff(thinning(zone, level, y - 1)) <= 1, "{zone:?} {level} {y}");
            }
        }
    }
}

#[test]
fn neighbors_are_all_cells_that_touch() {
    for level in 0..=4 {
        let cells: Vec<_> = cells_of(level).collect();
        for &cell in &cells {
            let expected: HashSet<_> =
                cells.iter().copied().filter(|&other| other != cell && touch(cell, other)).collect();
            let found: HashSet<_> = cell.neighbors().into_iter().collect();
            assert_eq!(found, expected, "{cell}");
            for side in [Side::South, Side::North] {
                if !cell.touches_pole(side) {
                    let edges: HashSet<_> = expected.iter().copied().filter(|&o| share_edge(cell, o, side)).collect();
                    assert_eq!(cell.edge_neighbors(side).into_iter().collect::<HashSet<_>>(), edges, "{cell} {side:?}");
                }
            }
        }
    }
}

/// In columns and rows of the level, unthinned.
fn grid_span(cell: CellId) -> [i64; 4] {
    let b = cell.bounds();
    let unit = FRAC_PI_4 / f64::from(1u32 << cell.level());
    [b.west_rad + PI, b.east_rad + PI, b.south_rad + FRAC_PI_2, b.north_rad + FRAC_PI_2]
        .map(|v| (v / unit).round() as i64)
}

fn touch(a: CellId, b: CellId) -> bool {
    let polar = |side| a.touches_pole(side) && b.touches_pole(side);
    if polar(Side::South) || polar(Side::North) {
        return true;
    }
    let ([aw, ae, as_, an], [bw, be, bs, bn]) = (grid_span(a), grid_span(b));
    let round = 8 << a.level();
    as_ <= bn && bs <= an && [-round, 0, round].iter().any(|turn| aw <= be + turn && bw + turn <= ae)
}

fn share_edge(a: CellId, b: CellId, side: Side) -> bool {
    let ([aw, ae, as_, an], [bw, be, bs, bn]) = (grid_span(a), grid_span(b));
    let meet = if side == Side::North { an == bs } else { as_ == bn };
    meet && aw < be && bw < ae
}

#[test]
fn linked_cells_have_exactly_these_counts() {
    for level in 0..=6 {
        let mut counts = BTreeMap::new();
        for cell in cells_of(level) {
            for quadrant in Quadrant::ALL {
                let linked = linked_cells(cell, quadrant);
                let side = if quadrant.is_north() { Side::North } else { Side::South };
                let beyond = cell.edge_neighbors(side)[0];
                let expected = if cell.touches_pole(side) {
                    8..=8
                } else if beyond.thinning() < cell.thinning() {
                    5..=5
                } else if beyond.thinning() > cell.thinning() {
                    3..=4
                } else {
                    4..=4
                };
                assert!(expected.contains(&linked.len()), "{cell} {quadrant:?}: {linked:?}");
                assert_eq!(linked[0], cell);
                for &near in &linked[1..] {
                    assert!(cell.neighbors().contains(&near), "{cell} {near}");
                }
                *counts.entry(linked.len()).or_insert(0) += 1;
            }
        }
        // Each pole has eight cells with two quadrants at it.
        assert_eq!(counts.get(&8), Some(&32), "level {level}: {counts:?}");
    }
}

#[test]
fn objects_in_cells_without_a_largest_reach_would_be_missed() {
    // The naive way, one cell a query: an object of 30 m whose centre lies 1 m beyond the cell's edge.
    let cell = CellId::containing(0.7, 0.3, 16);
    let edge = cell.bounds().east_rad;
    let center = edge + 1.0 / 6.4e6;
    let home = CellId::containing(0.7, center, 16);
    let query = edge - 5.0 / 6.4e6;
    assert_ne!(home, CellId::containing(0.7, query, 16));
    assert!(linked_cells_at(0.7, query, 16).contains(&home));
    assert!(quadrant_at(cell, 0.7, query).is_east());
}

#[test]
fn objects_larger_than_the_least_side_would_be_missed() {
    let missed = |part: f64| {
        let home = CellId::containing(0.9, 0.3, 14);
        let b = home.bounds();
        let corner = (b.north_rad - 1e-12, b.west_rad);
        footprint(corner.0, corner.1, home.l_q_m() * part / 2.0)
            .into_iter()
            .filter(|&(lat_rad, lon_rad)| !linked_cells_at(lat_rad, lon_rad, 14).contains(&home))
            .count()
    };
    assert_eq!(missed(0.999_999), 0);
    assert!(missed(1.3) > 0);
}

#[test]
fn fifty_metres_give_level_16_at_the_equator() {
    let deepest = (0..=LEVEL_MAX).rev().find(|&level| CellId::containing(0.001, 0.3, level).l_q_m() > 50.0);
    assert_eq!(deepest, Some(16));
}
