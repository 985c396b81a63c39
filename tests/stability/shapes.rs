//! Footprints that are hardly any, poles, and the antimeridian.

use super::search::limit;
use super::settled::{even_world, settle};
use super::table::{Row, digits, grouped};
use geo::{Coord, LineString, Polygon, TriangulateEarcut};
use std::collections::BTreeSet;
use stoop::content::{ObjectPage, Prism};
use stoop::forest::{CellId, Zone, columns};
use stoop::geodesy::{Course, Geodetic, meridian_radius_m, prime_vertical_radius_m};
use stoop::prepare::buildings::clean;
use stoop::select::SelectParams;

const LAT_DEG: f64 = 50.0;
const LON_DEG: f64 = 10.0;

/// A place from metres east and north, degrees.
fn degrees([x_m, y_m]: [f64; 2]) -> [f64; 2] {
    let (sin, cos) = LAT_DEG.to_radians().sin_cos();
    let lon = (x_m / (prime_vertical_radius_m(sin) * cos)).to_degrees();
    [LON_DEG + lon, LAT_DEG + (y_m / meridian_radius_m(sin)).to_degrees()]
}

/// A footprint as files have it, in metres, and what it should become.
struct Outline {
    rings: Vec<Vec<[f64; 2]>>,
    area_m2: f64,
    /// Of each place in the grid: whether it is inside.
    holds: fn(f64, f64) -> bool,
}

fn in_square(x: f64, y: f64) -> bool {
    (0.0..20.0).contains(&x) && (0.0..20.0).contains(&y)
}

fn outlines() -> Vec<Outline> {
    let square = |rings: Vec<Vec<[f64; 2]>>| Outline { rings, area_m2: 400.0, holds: in_square };
    let [a, b, c, d] = [[0.0, 0.0], [20.0, 0.0], [20.0, 20.0], [0.0, 20.0]];
    vec![
        // Every corner three times.
        square(vec![vec![a, a, a, b, b, b, c, c, c, d, d, d, a]]),
        // A spike without width, 80 m long.
        square(vec![vec![a, b, c, [100.0, 20.0], c, d, a]]),
        // A spike into the inside.
        square(vec![vec![a, b, c, [10.0, 20.0], [10.0, 7.0], [10.0, 20.0], d, a]]),
        // Points on the edges, hardly off them.
        square(vec![vec![a, [5.0, 1e-4], [10.0, -1e-4], b, [20.0, 10.0], c, d, [1e-4, 9.0], a]]),
        // The wrong way round, not closed, and gone round twice.
        square(vec![vec![a, d, c, b]]),
        square(vec![vec![a, b, c, d, a, b, c, d, a]]),
        // A figure eight: half of it is wound the other way.
        Outline {
            rings: vec![vec![a, c, b, d, a]],
            area_m2: 200.0,
            holds: |x, y| in_square(x, y) && (x - 10.0).abs() > (y - 10.0).abs(),
        },
        // A hook, from a corner that does not see all others.
        Outline {
            rings: vec![vec![[0.0, 0.0], [20.0, 0.0], [20.0, 20.0], [15.0, 20.0], [15.0, 5.0], [0.0, 5.0], [0.0, 0.0]]],
            area_m2: 175.0,
            holds: |x, y| in_square(x, y) && (y < 5.0 || x >= 15.0),
        },
        // A courtyard that touches a corner of the outline.
        Outline {
            rings: vec![vec![a, b, c, d, a], vec![a, [4.0, 10.0], [10.0, 4.0], a]],
            area_m2: 358.0,
            holds: |x, y| in_square(x, y) && !(x + y < 14.0 && x < 2.5 * y && y < 2.5 * x),
        },
    ]
}

fn twice_area(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// A fan from the first corner.
fn fan_m2(outline: &Outline) -> f64 {
    let ring = &outline.rings[0];
    ring.windows(2).map(|pair| twice_area(ring[0], pair[0], pair[1]).abs() / 2.0).sum()
}

/// Ears cut off the rings as they come.
fn ears_m2(outline: &Outline) -> f64 {
    let line = |ring: &Vec<[f64; 2]>| LineString::new(ring.iter().map(|&[x, y]| Coord { x, y }).collect());
    let polygon = Polygon::new(line(&outline.rings[0]), outline.rings[1..].iter().map(line).collect());
    let area = |t: geo::Triangle| twice_area(t.v1().into(), t.v2().into(), t.v3().into()).abs() / 2.0;
    polygon.earcut_triangles().into_iter().map(area).sum()
}

/// Crossings of edges to the east, both ends counted, as many libraries had it once.
fn crossings_hold(outline: &Outline, x: f64, y: f64) -> bool {
    let edges = outline.rings.iter().flat_map(|ring| ring.windows(2));
    let crossed = edges.filter(|edge| {
        let [[x0, y0], [x1, y1]] = [edge[0], edge[1]];
        (y0.min(y1)..=y0.max(y1)).contains(&y) && x <= x0 + (y - y0) / (y1 - y0) * (x1 - x0)
    });
    crossed.count() % 2 == 1
}

/// Places between −1 m and 22 m; their rows go through corners.
fn grid() -> impl Iterator<Item = [f64; 2]> {
    (0..46 * 24).map(|at| [f64::from(at % 46) * 0.5 - 0.77, f64::from(at / 46) - 1.0])
}

/// What preparation makes of an outline: the area of all its triangles, and objects that can be asked.
fn prepared(rings: &[Vec<[f64; 2]>]) -> Option<(f64, f64, ObjectPage)> {
    let rings = rings.iter().map(|ring| ring.iter().map(|&at| degrees(at)).collect()).collect();
    let footprints = clean(&[rings], &mut BTreeSet::new()).ok()?;
    let place = Geodetic::from_degrees(LAT_DEG, LON_DEG, 0.0);
    let cell = CellId::containing(place.lat_rad, place.lon_rad, 12);
    let (mut drawn_m2, mut told_m2) = (0.0, 0.0);
    let prisms = footprints.into_iter().enumerate().map(|(id, footprint)| {
        let corners: Vec<[f64; 2]> = footprint.rings.iter().flatten().map(|&at| metres(at)).collect();
        let area = |t: &[u16; 3]| {
            let [a, b, c] = t.map(|at| corners[usize::from(at)]);
            twice_area(a, b, c) / 2.0
        };
        drawn_m2 += footprint.triangles.iter().map(area).sum::<f64>();
        told_m2 += footprint.area_m2;
        Prism {
            id: id as u32,
            cell,
            rings: footprint.rings,
            roof: footprint.triangles,
            base_m: 0.0,
            top_m: 10.0,
            foundation_m: 0.0,
            wall_color: [0; 3],
            roof_color: [0; 3],
            detail: None,
        }
    });
    let prisms = prisms.collect();
    Some((drawn_m2, told_m2, ObjectPage::from_prisms(cell, 0, 0, 0.0, prisms).0))
}

fn metres([lon_rad, lat_rad]: [f64; 2]) -> [f64; 2] {
    let (sin, cos) = LAT_DEG.to_radians().sin_cos();
    let (lon, lat) = (lon_rad - LON_DEG.to_radians(), lat_rad - LAT_DEG.to_radians());
    [lon * prime_vertical_radius_m(sin) * cos, lat * meridian_radius_m(sin)]
}

fn holds(page: &ObjectPage, at_m: [f64; 2]) -> bool {
    let [lon, lat] = degrees(at_m);
    (0..page.objects.len()).any(|which| page.footprint_holds(which, lat.to_radians(), lon.to_radians(), 0.0))
}

pub fn footprints() -> Row {
    let outlines = outlines();
    let is_off = |area_m2: f64, outline: &Outline| (area_m2 - outline.area_m2).abs() > 0.01 * outline.area_m2;
    let count =
        |area_m2: fn(&Outline) -> f64| outlines.iter().filter(|outline| is_off(area_m2(outline), outline)).count();
    let (fans, ears) = (count(fan_m2), count(ears_m2));
    assert!(fans >= 3 && ears >= 1, "{fans} {ears}");
    let (mut crossed, mut wrong, mut asked) = (0, 0, 0);
    for (number, outline) in outlines.iter().enumerate() {
        let (drawn_m2, told_m2, page) = prepared(&outline.rings).unwrap();
        assert!(!is_off(drawn_m2, outline) && !is_off(told_m2, outline), "{number}: {drawn_m2} {told_m2} m²");
        for [x, y] in grid() {
            // 2 cm and more from any outline, so that rounding says nothing.
            let near = [[0.02, 0.0], [-0.02, 0.0], [0.0, 0.02], [0.0, -0.02]];
            let inside = (outline.holds)(x, y);
            if near.iter().any(|[dx, dy]| (outline.holds)(x + dx, y + dy) != inside) {
                continue;
            }
            asked += 1;
            crossed += u32::from(crossings_hold(outline, x, y) != inside);
            wrong += u32::from(holds(&page, [x, y]) != inside);
        }
    }
    assert!(crossed > 20 && wrong == 0 && asked > 5_000, "{crossed} and {wrong} of {asked}");
    let needle = |width_m: f64| vec![vec![[0.0, 0.0], [50.0, 0.0], [50.0, width_m], [0.0, width_m], [0.0, 0.0]]];
    let is_kept = |width_m: f64| {
        prepared(&needle(width_m)).is_some_and(|(drawn_m2, ..)| (drawn_m2 / (50.0 * width_m) - 1.0).abs() < 0.01)
    };
    let narrowest_m = limit(1.0, 1e-5, is_kept);
    assert!(narrowest_m < 0.01, "{narrowest_m}");
    Row {
        case: "footprints with spikes, crossings, repeated points, touching holes",
        usual: format!(
            "of {} outlines a fan gets {fans} areas wrong and cut ears {ears}; counted crossings get {crossed} of \
             {} points wrong",
            outlines.len(),
            grouped(asked)
        ),
        ours: format!("all areas to 1 %, {wrong} points wrong"),
        limit: format!(
            "walls {} m apart, over 50 m; thinner footprints are set aside and counted",
            digits(narrowest_m)
        ),
    }
}

/// Cells of a level within a distance of a pole where every row has as many as the equator's.
fn unthinned_cells(level: u8, within_m: f64) -> f64 {
    let row_m = meridian_radius_m(1.0) * 45f64.to_radians() / f64::from(1u32 << level);
    (within_m / row_m).ceil() * 8.0 * f64::from(1u32 << level)
}

/// Most cells on the same ground as one at the equator, over all rows of a level.
fn most_cells_for_one(level: u8) -> f64 {
    let zone = |row: u32| Zone::all().find(|zone| zone.row() == row).unwrap();
    let area_m2 = |cell: CellId| {
        let sides = cell.sides_m();
        (sides.south_m + sides.north_m) / 2.0 * sides.height_m
    };
    let (tropics, polar) = (zone(2), zone(3));
    let here_m2 = area_m2(CellId::new(tropics, level, 0, 0).unwrap());
    let rows = 0..1u32 << level;
    // Where columns are thinned cells are wide again: the worst rows are those before, and the last.
    let rows =
        rows.filter(|&y| y + 1 == 1 << level || columns(polar, level, y) != columns(polar, level, y + 1) || y == 0);
    rows.map(|y| here_m2 / area_m2(CellId::new(polar, level, 0, y).unwrap())).fold(0.0, f64::max)
}

pub fn poles_and_antimeridian() -> Row {
    // 40 km across the antimeridian at Fiji.
    let (from, to) = (Geodetic::from_degrees(-17.0, 179.8, 0.0), Geodetic::from_degrees(-17.0, -179.8, 0.0));
    let usual_m = (to.lon_rad - from.lon_rad).abs() * from.lat_rad.cos() * 6_371_000.0;
    let ours_m = Course::between(from, to).distance_m;
    assert!(usual_m > 3e7 && (42e3..43e3).contains(&ours_m), "{usual_m} {ours_m}");
    let [west, east] = [from, to].map(|place| CellId::containing(place.lat_rad, place.lon_rad, 6));
    assert!(west.neighbors().into_iter().any(|cell| cell == east), "cells there are neighbours");
    let within_m = 50_000.0;
    let (level, round) = (12, unthinned_cells(12, within_m));
    let row_m = meridian_radius_m(0.0) * 45f64.to_radians() / f64::from(1u32 << level);
    let usual = round / (std::f64::consts::PI * (within_m / row_m).powi(2));
    assert!(usual > 100.0, "{usual}");
    let drawn = |lat_deg: f64| {
        let index = even_world(lat_deg, 10.0, within_m, level);
        let views = [0.0, 45.0, 200.0].map(|heading| crate::made_up::view(lat_deg, 10.0, 8_000.0, heading, -60.0));
        views.map(|view| settle(&index, &view, &SelectParams::DEFAULT).1.pieces.len()).iter().sum::<usize>() as f64
    };
    let ours = drawn(89.99) / drawn(0.3);
    assert!(ours < 3.0, "{ours}");
    let most = (3..=14).map(most_cells_for_one).fold(0.0, f64::max);
    assert!(most < 4.0, "{most}");
    Row {
        case: "poles and antimeridian",
        usual: format!(
            "differences of longitude: {} m for {} m across 180°; rows of as many cells as the equator's: {} times \
             the cells within 50 km of a pole",
            digits(usual_m),
            digits(ours_m),
            digits(usual)
        ),
        ours: format!(
            "geodesics and neighbours go across; a view of the pole draws {} times the cells of one of the equator",
            digits(ours)
        ),
        limit: format!("no row has more than {} times the equator's cells for its ground", digits(most)),
    }
}
