//! The footprint of a shape: what its ground covers, else its roofs, else its convex hull.

use super::clean::{Footprint, Reason, clean};
use super::faces::{Face, Faces};
use crate::prepare::vector::{FootprintPolygon, SurfaceKind};
use geo::algorithm::bool_ops::unary_union;
use geo::{Area, ConvexHull, Coord, LineString, MultiPoint, Polygon};
use std::collections::BTreeSet;

/// Projections smaller than this cover nothing, square metres.
const AREA_MIN_M2: f64 = 0.01;

/// Sound footprints; `given` are the source's own polygons, which come after the ground's faces.
pub fn outline(faces: &Faces, given: &[FootprintPolygon]) -> Result<Vec<Footprint>, Reason> {
    let of_kind = |kind: SurfaceKind| cover(faces, &|face| face.kind == kind);
    let tries: [&dyn Fn() -> Vec<FootprintPolygon>; 4] =
        [&|| of_kind(SurfaceKind::Ground), &|| given.to_vec(), &|| of_kind(SurfaceKind::Roof), &|| hull(faces)];
    // What is mended in an outline of our own making is not the source's fault.
    let found = tries.iter().find_map(|polygons| clean(&polygons(), &mut BTreeSet::new()).ok());
    found.ok_or("surfaces without a footprint")
}

/// What some faces cover on the map.
fn cover(faces: &Faces, wanted: &dyn Fn(&Face) -> bool) -> Vec<FootprintPolygon> {
    let flat = |ring: &Vec<u32>| {
        let points = ring.iter().map(|&at| faces.corners[at as usize]);
        LineString::new(points.map(|point| Coord { x: point.x, y: point.y }).collect())
    };
    let polygons = faces.faces.iter().filter(|face| wanted(face)).filter_map(|face| {
        let outer = face.rings.first()?;
        let polygon = Polygon::new(flat(outer), face.rings[1..].iter().map(flat).collect());
        (polygon.unsigned_area() > AREA_MIN_M2).then_some(polygon)
    });
    let polygons: Vec<Polygon> = polygons.collect();
    unary_union(&polygons)
        .0
        .iter()
        .filter(|part| part.unsigned_area() > AREA_MIN_M2)
        .map(|p| degrees(faces, p))
        .collect()
}

fn hull(faces: &Faces) -> Vec<FootprintPolygon> {
    let points = faces.faces.iter().flat_map(|face| face.rings.iter().flatten());
    let points: MultiPoint = points.map(|&at| (faces.corners[at as usize].x, faces.corners[at as usize].y)).collect();
    vec![degrees(faces, &points.convex_hull())]
}

fn degrees(faces: &Faces, polygon: &Polygon) -> FootprintPolygon {
    let rings = std::iter::once(polygon.exterior()).chain(polygon.interiors());
    rings.map(|ring| ring.coords().map(|&point| faces.plane.back(point).map(f64::to_degrees)).collect()).collect()
}
