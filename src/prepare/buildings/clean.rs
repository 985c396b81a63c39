//! Footprints made sound: closed, oriented, without repeated or idle points, without crossings, triangulated.

use crate::geodesy::{meridian_radius_m, prime_vertical_radius_m};
use crate::prepare::vector::{FootprintPolygon, Ring};
use geo::triangulate_delaunay::{DelaunayTriangulationConfig, TriangulateDelaunay};
use geo::{Area, BooleanOps, Coord, LineString, MultiPolygon, Polygon, TriangulateEarcut};
use std::collections::BTreeSet;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Points nearer than this to each other, or to the line between their neighbours, are one or idle; metres. Half of
/// what pages resolve.
pub const TOLERANCE_M: f64 = 0.005;
/// Smallest footprint that is kept, square metres.
pub const AREA_MIN_M2: f64 = 1e-3;
/// Points that the roof's indices can name.
const POINTS_MAX: usize = 1 << 16;

/// A sound footprint: one outer ring and its holes.
#[derive(Clone, Debug, PartialEq)]
pub struct Footprint {
    /// Longitude and latitude, radians: the outer ring counter-clockwise, then holes clockwise; not closed.
    pub rings: Vec<Vec<[f64; 2]>>,
    /// Triangles as indices into the rings laid end to end, counter-clockwise.
    pub triangles: Vec<[u16; 3]>,
    pub area_m2: f64,
}

/// Why a footprint was changed or set aside; the keys of the counts in the manifest.
pub type Reason = &'static str;

/// Local metres about a point of the footprint: good to 10⁻⁵ over a kilometre, and only used to clean and to measure.
#[derive(Clone, Copy, Debug)]
pub(super) struct Plane {
    origin: [f64; 2],
    metres: [f64; 2],
}

impl Plane {
    pub fn about(origin: [f64; 2]) -> Self {
        let (sin, cos) = origin[1].sin_cos();
        Self { origin, metres: [(prime_vertical_radius_m(sin) * cos).max(1.0), meridian_radius_m(sin)] }
    }

    pub fn to(self, p: [f64; 2]) -> Coord {
        Coord { x: (p[0] - self.origin[0]) * self.metres[0], y: (p[1] - self.origin[1]) * self.metres[1] }
    }

    pub fn back(self, p: Coord) -> [f64; 2] {
        [p.x / self.metres[0] + self.origin[0], p.y / self.metres[1] + self.origin[1]]
    }
}

/// A polygon of rings that are not closed, the outer one first; `None` without rings.
pub(super) fn polygon_of(rings: &[Vec<[f64; 2]>], to: impl Fn([f64; 2]) -> Coord) -> Option<Polygon> {
    let line = |ring: &Vec<[f64; 2]>| LineString::new(ring.iter().chain(ring.first()).map(|&p| to(p)).collect());
    let (outer, holes) = rings.split_first()?;
    Some(Polygon::new(line(outer), holes.iter().map(line).collect()))
}

/// Cleans a feature's polygons. What was repaired is added to `repaired`; an error says why nothing is left.
pub fn clean(polygons: &[FootprintPolygon], repaired: &mut BTreeSet<Reason>) -> Result<Vec<Footprint>, Reason> {
    let origin = polygons.iter().filter_map(|rings| rings.first()).flatten().find(|point| fault(point).is_none());
    let Some(origin) = origin else {
        let first = polygons.iter().flatten().flatten().next();
        return Err(first.and_then(fault).unwrap_or("no points"));
    };
    let plane = Plane::about(origin.map(f64::to_radians));
    let mut footprints = Vec::new();
    let mut failed: Option<Reason> = None;
    for rings in polygons {
        if let Some(reason) = rings.first().and_then(|ring| ring.iter().find_map(fault)) {
            failed = Some(reason);
            continue;
        }
        let parts = sound_rings(rings, plane, repaired).map(|polygon| without_crossings(polygon, repaired));
        for part in parts.unwrap_or_default() {
            match footprint(&part, plane) {
                Ok(Some(footprint)) => footprints.push(footprint),
                Ok(None) => failed = failed.or(Some("no area")),
                Err(reason) => failed = Some(reason),
            }
        }
    }
    match (footprints.is_empty(), failed) {
        (true, reason) => return Err(reason.unwrap_or("no area")),
        (false, Some(_)) => _ = repaired.insert("part without sound area dropped"),
        (false, None) => {}
    }
    Ok(footprints)
}

/// Why a point cannot be used.
pub(super) fn fault(point: &[f64; 2]) -> Option<Reason> {
    if !point[0].is_finite() || !point[1].is_finite() {
        Some("coordinates are no numbers")
    } else if point[0].abs() > 540.0 || point[1].abs() > 90.0 {
        Some("coordinates are not on the Earth")
    } else {
        None
    }
}

/// The rings in local metres, cleaned and oriented; `None` where no area is left.
fn sound_rings(rings: &[Ring], plane: Plane, repaired: &mut BTreeSet<Reason>) -> Option<Polygon> {
    let mut sound = Vec::with_capacity(rings.len());
    for (at, ring) in rings.iter().enumerate() {
        if at > 0 && ring.iter().any(|point| fault(point).is_some()) {
            repaired.insert("hole with coordinates not on the Earth dropped");
            continue;
        }
        let mut points = local(ring, plane);
        close(&mut points, repaired);
        drop_idle(&mut points, repaired);
        let area = signed_area(&points);
        // The halves of a figure eight have no area together, and are resolved below.
        if points.len() < 3 || area.abs() < AREA_MIN_M2 && (at > 0 || points.len() < 4) {
            if at == 0 {
                return None;
            }
            repaired.insert("hole without area dropped");
            continue;
        }
        // RFC 7946 wants outer rings counter-clockwise and holes clockwise.
        if (area > 0.0) != (at == 0) {
            points.reverse();
            repaired.insert("ring turned round");
        }
        sound.push(LineString::new(points));
    }
    let holes = sound.split_off(1.min(sound.len()));
    Some(Polygon::new(sound.pop()?, holes))
}

/// Local metres; longitudes continue across the antimeridian.
fn local(ring: &Ring, plane: Plane) -> Vec<Coord> {
    ring.iter()
        .map(|point| {
            let lon = point[0].to_radians();
            let turns = ((lon - plane.origin[0]) / TAU).round();
            plane.to([lon - turns * TAU, point[1].to_radians()])
        })
        .collect()
}

/// Takes the closing point away.
fn close(points: &mut Vec<Coord>, repaired: &mut BTreeSet<Reason>) {
    match (points.first().copied(), points.last().copied()) {
        (Some(first), Some(last)) if points.len() > 1 && first == last => {
            points.pop();
        }
        _ => {
            repaired.insert("ring closed");
        }
    }
}

/// Takes repeated points and points on the line between their neighbours away.
fn drop_idle(points: &mut Vec<Coord>, repaired: &mut BTreeSet<Reason>) {
    let before = points.len();
    points.dedup_by(|a, b| near(*a, *b));
    while points.len() > 1 && near(points[0], points[points.len() - 1]) {
        points.pop();
    }
    if points.len() < before {
        repaired.insert("repeated points dropped");
    }
    let before = points.len();
    loop {
        let count = points.len();
        let mut kept: Vec<Coord> = Vec::with_capacity(count);
        for at in 0..count {
            let previous = kept.last().copied().unwrap_or(points[count - 1]);
            let next = points[(at + 1) % count];
            if !is_idle(previous, points[at], next) {
                kept.push(points[at]);
            }
        }
        let done = kept.len() == count;
        *points = kept;
        if done || points.len() < 3 {
            break;
        }
    }
    if points.len() < before {
        repaired.insert("idle points dropped");
    }
}

fn near(a: Coord, b: Coord) -> bool {
    (a.x - b.x).hypot(a.y - b.y) < TOLERANCE_M
}

/// Whether a point lies on the line of its neighbours: between them, or at the tip of a spike without width.
fn is_idle(a: Coord, p: Coord, b: Coord) -> bool {
    let (dx, dy) = (b.x - a.x, b.y - a.y);
    let length = dx.hypot(dy);
    if length < TOLERANCE_M {
        return true;
    }
    ((p.x - a.x) * dy - (p.y - a.y) * dx).abs() / length < TOLERANCE_M / 2.0
}

fn signed_area(points: &[Coord]) -> f64 {
    let next = points.iter().cycle().skip(1);
    points.iter().zip(next).map(|(a, b)| a.x * b.y - b.x * a.y).sum::<f64>() / 2.0
}

/// The polygon itself where its rings do not cross; else the area that they enclose, less the holes.
fn without_crossings(polygon: Polygon, repaired: &mut BTreeSet<Reason>) -> Vec<Polygon> {
    if !crosses(&polygon) {
        return vec![polygon];
    }
    repaired.insert("crossing rings resolved");
    enclosed(&polygon).0
}

pub(super) fn enclosed(polygon: &Polygon) -> MultiPolygon {
    use geo::algorithm::bool_ops::{FillRule, unary_union};
    let alone = |ring: &LineString| Polygon::new(ring.clone(), Vec::new());
    let outer = alone(polygon.exterior());
    let outer = outer.union_with_fill_rule(&MultiPolygon::new(Vec::new()), FillRule::NonZero);
    if polygon.interiors().is_empty() {
        return outer;
    }
    let holes: Vec<Polygon> = polygon.interiors().iter().map(alone).collect();
    outer.difference_with_fill_rule(&unary_union(&holes), FillRule::NonZero)
}

/// Whether two edges of the rings cross or lie on each other, or rings touch in more than their own corners.
fn crosses(polygon: &Polygon) -> bool {
    let mut edges: Vec<Edge> = Vec::new();
    for (ring, line) in std::iter::once(polygon.exterior()).chain(polygon.interiors()).enumerate() {
        let count = line.0.len() - 1;
        edges.extend((0..count).map(|at| Edge { ring, at, last: count - 1, a: line.0[at], b: line.0[at + 1] }));
    }
    edges.sort_by(|e, f| e.low_x().total_cmp(&f.low_x()));
    for (i, e) in edges.iter().enumerate() {
        let high = e.a.x.max(e.b.x);
        if edges[i + 1..].iter().take_while(|f| f.low_x() <= high).any(|f| e.meets(f)) {
            return true;
        }
    }
    // A hole outside its outer ring crosses nothing, and still is none.
    polygon.interiors().iter().any(|hole| !inside(polygon.exterior(), hole.0[0]))
}

struct Edge {
    ring: usize,
    at: usize,
    last: usize,
    a: Coord,
    b: Coord,
}

impl Edge {
    fn low_x(&self) -> f64 {
        self.a.x.min(self.b.x)
    }

    fn is_beside(&self, other: &Self) -> bool {
        self.ring == other.ring
            && (self.at.abs_diff(other.at) == 1 || self.at.abs_diff(other.at) == self.last && self.last > 0)
    }

    fn meets(&self, other: &Self) -> bool {
        if self.a.y.max(self.b.y) < other.a.y.min(other.b.y) || other.a.y.max(other.b.y) < self.a.y.min(self.b.y) {
            return false;
        }
        // Neighbours share a point; folding back on each other was resolved before, as idle points.
        if self.is_beside(other) {
            return false;
        }
        let side = |e: &Self, p: Coord| (e.b.x - e.a.x) * (p.y - e.a.y) - (e.b.y - e.a.y) * (p.x - e.a.x);
        let (c, d) = (side(self, other.a), side(self, other.b));
        let (e, f) = (side(other, self.a), side(other, self.b));
        (c >= 0.0) != (d > 0.0) && (e >= 0.0) != (f > 0.0) || c * d < 0.0 && e * f < 0.0
    }
}

fn inside(ring: &LineString, p: Coord) -> bool {
    ring.lines().fold(false, |inside, line| {
        let (a, b) = (line.start, line.end);
        let crosses = (a.y > p.y) != (b.y > p.y) && p.x < (b.x - a.x) * (p.y - a.y) / (b.y - a.y) + a.x;
        inside != crosses
    })
}

/// Triangulates; `None` without area.
fn footprint(polygon: &Polygon, plane: Plane) -> Result<Option<Footprint>, Reason> {
    let area_m2 = polygon.unsigned_area();
    if area_m2 < AREA_MIN_M2 {
        return Ok(None);
    }
    let rings: Vec<&LineString> = std::iter::once(polygon.exterior()).chain(polygon.interiors()).collect();
    if rings.iter().map(|ring| ring.0.len() - 1).sum::<usize>() > POINTS_MAX {
        return Err("more than 65536 points");
    }
    let triangles = triangulate(polygon).ok_or("cannot be triangulated")?;
    let degrees = |ring: &&LineString| oriented(ring).map(|p| wrapped(plane.back(p), plane)).collect();
    Ok(Some(Footprint { rings: rings.iter().map(degrees).collect(), triangles, area_m2 }))
}

/// Counter-clockwise triangles as indices into the rings laid end to end, not closed, which must have no more points
/// than those can name; `None` where no triangles cover the polygon.
pub(super) fn triangulate(polygon: &Polygon) -> Option<Vec<[u16; 3]>> {
    let area_m2 = polygon.unsigned_area();
    ears(polygon, area_m2).or_else(|| delaunay(polygon, area_m2))
}

/// Ear clipping; `None` where the triangles do not cover the area.
fn ears(polygon: &Polygon, area_m2: f64) -> Option<Vec<[u16; 3]>> {
    let raw = polygon.earcut_triangles_raw();
    let points: Vec<Coord> = raw.vertices.iter().map(|p| Coord { x: p[0], y: p[1] }).collect();
    let triangles = raw.triangle_indices.chunks_exact(3).map(|triangle| [triangle[0], triangle[1], triangle[2]]);
    covering(triangles, &points, area_m2)
}

/// Constrained Delaunay triangles: slower, and more patient with rings that touch.
fn delaunay(polygon: &Polygon, area_m2: f64) -> Option<Vec<[u16; 3]>> {
    let rings = std::iter::once(polygon.exterior()).chain(polygon.interiors());
    let points: Vec<Coord> = rings.flat_map(oriented).collect();
    let nearest = |p: Coord| {
        let distance = |q: &Coord| (q.x - p.x).hypot(q.y - p.y);
        (0..points.len()).min_by(|&a, &b| distance(&points[a]).total_cmp(&distance(&points[b])))
    };
    let triangles = polygon.constrained_triangulation(DelaunayTriangulationConfig { snap_radius: 1e-6 }).ok()?;
    let indices = triangles.iter().map(|t| Some([nearest(t.v1())?, nearest(t.v2())?, nearest(t.v3())?]));
    covering(indices.collect::<Option<Vec<_>>>()?.into_iter(), &points, area_m2)
}

/// Turns triangles counter-clockwise; `None` where they do not cover the area.
fn covering(triangles: impl Iterator<Item = [usize; 3]>, points: &[Coord], area_m2: f64) -> Option<Vec<[u16; 3]>> {
    let mut turned = Vec::new();
    let mut covered = 0.0;
    for [a, b, c] in triangles {
        let area = signed_area(&[points[a], points[b], points[c]]);
        covered += area.abs();
        if area != 0.0 {
            turned.push(if area > 0.0 { [a, b, c] } else { [a, c, b] }.map(|at| at as u16));
        }
    }
    let is_covered = (covered - area_m2).abs() <= (1e-3 * area_m2).max(1e-2);
    (is_covered && !turned.is_empty()).then_some(turned)
}

fn oriented(ring: &LineString) -> impl Iterator<Item = Coord> + '_ {
    ring.0[..ring.0.len() - 1].iter().copied()
}

/// The middle of the plane lies within ±180°; points beyond keep on counting, so that the ring stays whole.
fn wrapped(point: [f64; 2], plane: Plane) -> [f64; 2] {
    let turns = ((plane.origin[0] + PI) / TAU).floor();
    [point[0] - turns * TAU, point[1].clamp(-FRAC_PI_2, FRAC_PI_2)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Metres about (24.9°E, 60.2°N) as degrees.
    fn degrees(rings: &[&[[f64; 2]]]) -> FootprintPolygon {
        let plane = Plane::about([24.9f64.to_radians(), 60.2f64.to_radians()]);
        let point = |p: &[f64; 2]| plane.back(Coord { x: p[0], y: p[1] }).map(f64::to_degrees);
        rings.iter().map(|ring| ring.iter().map(point).collect()).collect()
    }

    fn area(footprints: &[Footprint]) -> f64 {
        footprints.iter().map(|footprint| footprint.area_m2).sum()
    }

    fn cleaned(rings: &[&[[f64; 2]]]) -> (Result<Vec<Footprint>, Reason>, Vec<Reason>) {
        let mut repaired = BTreeSet::new();
        let outcome = clean(&[degrees(rings)], &mut repaired);
        (outcome, repaired.into_iter().collect())
    }

    const SQUARE: [[f64; 2]; 5] = [[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0], [0.0, 0.0]];

    #[test]
    fn a_sound_square_stays_as_it_is() {
        let (footprints, repaired) = cleaned(&[&SQUARE]);
        let footprints = footprints.unwrap();
        assert_eq!(repaired, Vec::<Reason>::new());
        assert_eq!(footprints[0].rings[0].len(), 4);
        assert_eq!(footprints[0].triangles.len(), 2);
        assert!((area(&footprints) - 100.0).abs() < 1e-3);
    }

    /// A ring, what is repaired in it, the area in square metres, and the parts that come of it.
    type Case<'a> = (&'a [[f64; 2]], &'a [Reason], f64, usize);

    #[test]
    fn each_fault_is_repaired_and_named() {
        let clockwise: Vec<_> = SQUARE.into_iter().rev().collect();
        let repeated = [[0.0, 0.0], [10.0, 0.0], [10.0, 0.001], [10.0, 5.0], [10.0, 10.0], [0.0, 10.0], [0.0, 0.0]];
        let spike = [[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [10.0, 30.0], [10.0, 10.0], [0.0, 10.0], [0.0, 0.0]];
        let bowtie = [[0.0, 0.0], [10.0, 10.0], [10.0, 0.0], [0.0, 10.0], [0.0, 0.0]];
        let cases: [Case; 5] = [
            (&SQUARE[..4], &["ring closed"], 100.0, 1),
            (&clockwise, &["ring turned round"], 100.0, 1),
            (&repeated, &["idle points dropped", "repeated points dropped"], 100.0, 1),
            (&spike, &["idle points dropped"], 100.0, 1),
            (&bowtie, &["crossing rings resolved"], 50.0, 2),
        ];
        for (ring, reasons, expected, parts) in cases {
            let (footprints, repaired) = cleaned(&[ring]);
            let footprints = footprints.unwrap();
            let repaired: Vec<_> =
                repaired.into_iter().filter(|r| reasons.contains(r) || *r != "ring turned round").collect();
            assert_eq!(repaired, reasons, "{ring:?}");
            assert!((area(&footprints) - expected).abs() < 0.02, "{ring:?}: {}", area(&footprints));
            assert_eq!(footprints.len(), parts);
        }
    }

    #[test]
    fn holes_count_where_they_are_holes() {
        let hole = [[2.0, 2.0], [2.0, 8.0], [8.0, 8.0], [8.0, 2.0], [2.0, 2.0]];
        let (footprints, repaired) = cleaned(&[&SQUARE, &hole]);
        assert!((area(&footprints.unwrap()) - 64.0).abs() < 1e-3);
        assert_eq!(repaired, Vec::<Reason>::new());
        let outside: Vec<_> = hole.iter().map(|p| [p[0] + 20.0, p[1]]).collect();
        let (footprints, _) = cleaned(&[&SQUARE, &outside]);
        assert!((area(&footprints.unwrap()) - 100.0).abs() < 1e-3);
        let across: Vec<_> = hole.iter().map(|p| [p[0] + 5.0, p[1]]).collect();
        let (footprints, _) = cleaned(&[&SQUARE, &across]);
        assert!((area(&footprints.unwrap()) - 82.0).abs() < 0.1);
    }

    #[test]
    fn what_cannot_be_mended_is_set_aside_by_reason() {
        let line = [[0.0, 0.0], [10.0, 0.0], [0.0, 0.0]];
        assert_eq!(cleaned(&[&line]).0, Err("no area"));
        assert_eq!(cleaned(&[&[]]).0, Err("no points"));
        assert_eq!(clean(&[], &mut BTreeSet::new()), Err("no points"));
        let nan = vec![vec![[0.0, 0.0], [f64::NAN, 1.0], [1.0, 1.0]]];
        assert_eq!(clean(&[nan], &mut BTreeSet::new()), Err("coordinates are no numbers"));
        let far = vec![vec![[0.0, 0.0], [1.0, 91.0], [1.0, 1.0]]];
        assert_eq!(clean(&[far], &mut BTreeSet::new()), Err("coordinates are not on the Earth"));
    }

    #[test]
    fn a_footprint_across_the_antimeridian_stays_whole() {
        let ring = vec![[179.9999, 10.0], [-179.9999, 10.0], [-179.9999, 10.0002], [179.9999, 10.0002]];
        let footprints = clean(&[vec![ring]], &mut BTreeSet::new()).unwrap();
        assert!((400.0..600.0).contains(&area(&footprints)), "{}", area(&footprints));
    }

    proptest! {
        #[test]
        fn any_ring_becomes_sound_or_is_set_aside(points in prop::collection::vec((-50i32..50, -50i32..50), 0..24)) {
            let ring: Vec<[f64; 2]> = points.iter().map(|&(x, y)| [f64::from(x), f64::from(y)]).collect();
            let (outcome, _) = cleaned(&[&ring]);
            for footprint in outcome.into_iter().flatten() {
                let flat: Vec<_> = footprint.rings.concat();
                prop_assert!(footprint.rings.iter().all(|ring| ring.len() >= 3));
                prop_assert!(footprint.triangles.iter().flatten().all(|&at| usize::from(at) < flat.len()));
                let plane = Plane::about([24.9f64.to_radians(), 60.2f64.to_radians()]);
                for triangle in &footprint.triangles {
                    let corners = triangle.map(|at| plane.to(flat[usize::from(at)]));
                    prop_assert!(signed_area(&corners) > -1e-5, "{}", signed_area(&corners));
                }
            }
        }
    }
}
