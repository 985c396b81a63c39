//! Features with surfaces of their own: sound faces, an outline under them, set at their height.
//!
//! Surfaces whose heights count from a known level stand at those heights, whatever the terrain; `base` in a recipe
//! sets their lowest point. Where nothing says what heights count from, the building's lowest point is set on the
//! terrain. Differences of height stay as they are.

use super::Rules;
use super::clean::{Footprint, Reason, clean};
use super::faces::{Face, Faces};
use super::outline::outline;
use super::place::{self, Ground};
use super::rules::Extent;
use crate::content::{Detail, DetailCorner, FaceGroup, FaceKind, Prism};
use crate::forest::CellId;
use crate::geodesy::VerticalDatum;
use crate::prepare::expression::WrongType;
use crate::prepare::model::Placement;
use crate::prepare::textures::Picture;
use crate::prepare::vector::{Feature, Shape, SurfaceKind};
use geo::{Distance, Euclidean, LineString, Point, Polygon};
use glam::DVec3;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::sync::Arc;

/// Colours of one object; further ones are drawn in the object's own.
const GROUPS_MAX: usize = 240;
/// A part is in the air when it begins this far above its building and above the terrain, metres.
const IN_AIR_M: f64 = 2.0;

/// Why a shape gives no prisms.
#[derive(Debug)]
pub enum Failed {
    /// Fall back to its footprint.
    Unsound(Reason),
    /// The recipe's expression does not fit its attributes.
    Attributes(WrongType),
}

/// Prisms, and the pictures that the textures of their details name.
pub type Pictured = (Vec<Prism>, Vec<Arc<Picture>>);

/// The prisms of a feature with surfaces, one for each part of its outline; their cells are still to be chosen.
pub fn prisms(
    feature: &Feature,
    shape: &Shape,
    rules: &Rules,
    ground: &Ground,
    notes: &mut BTreeSet<Reason>,
) -> Result<Pictured, Failed> {
    let faces = Faces::new(shape, notes).map_err(Failed::Unsound)?;
    let footprints = outline(&faces, &feature.polygons).map_err(Failed::Unsound)?;
    let base_m = rules.base_m(&feature.attributes).map_err(Failed::Attributes)?;
    let whole = feature.ground.as_ref().map(|points| points.as_slice());
    let raise_m = raise_m(shape, &footprints, whole, base_m, rules, ground);
    let details = split(&faces, &footprints, raise_m);
    let parts = footprints.into_iter().zip(details).filter(|(_, detail)| detail.triangles() > 0);
    let prisms: Vec<Prism> =
        parts.map(|(footprint, detail)| prism(footprint, detail, shape.lowest_m + raise_m, ground, notes)).collect();
    if prisms.is_empty() { Err(Failed::Unsound("no surface above the ground")) } else { Ok((prisms, faces.pictures)) }
}

/// The prism of a model that is set down: at its height, or its origin on the terrain.
pub fn set_down(
    model: &Placement,
    feature: &Feature,
    rules: &Rules,
    ground: &Ground,
    notes: &mut BTreeSet<Reason>,
) -> Result<Prism, Reason> {
    // The hull is of our own making, and may turn out clockwise under a mirror.
    let footprint = clean(&feature.polygons, &mut BTreeSet::new())?.into_iter().next().ok_or("no area")?;
    let origin_m = match model.height_m {
        Some(height_m) => height_m + rules.vertical.undulation_m(model.lat_rad, model.lon_rad),
        None => (ground.height_m)(model.lat_rad, model.lon_rad),
    };
    let detail = model.detail(origin_m)?;
    let mut prism = prism(footprint, detail, origin_m, ground, notes);
    // A model has no foundation: a tree's crown must not stand on a wall.
    let low_m = prism.detail.as_ref().and_then(Detail::height_range_m).map_or(prism.base_m, |range| range.0);
    prism.foundation_m = (prism.base_m - low_m).max(0.0);
    Ok(prism)
}

/// What to add to the source's heights, metres.
fn raise_m(
    shape: &Shape,
    footprints: &[Footprint],
    whole: Option<&[[f64; 2]]>,
    base_m: Option<f64>,
    rules: &Rules,
    ground: &Ground,
) -> f64 {
    let level_m = |base_m: Option<f64>, vertical: VerticalDatum| {
        let extent = Extent { height_m: 0.0, min_height_m: 0.0, base_m, to_eaves: false };
        place::ground_m(footprints, whole, &extent, vertical, ground)
    };
    match (base_m, shape.vertical.filter(|_| !rules.on_terrain)) {
        (None, Some(datum)) => level_m(Some(0.0), datum),
        (base_m, _) => level_m(base_m, rules.vertical) - shape.lowest_m,
    }
}

fn prism(
    footprint: Footprint,
    detail: Detail,
    building_m: f64,
    ground: &Ground,
    notes: &mut BTreeSet<Reason>,
) -> Prism {
    let center = place::center(&footprint);
    let (low_m, high_m) = detail.height_range_m().map_or((0.0, 0.0), |(low, high)| (f64::from(low), f64::from(high)));
    let own_m = (ground.height_m)(center.lat_rad, center.lon_rad);
    if own_m >= high_m {
        notes.insert("roof below the terrain");
    }
    let base_m = low_m.max(own_m).min(high_m - Prism::WALL_MIN_M).max(low_m);
    let in_air = low_m > building_m + IN_AIR_M && low_m > own_m + IN_AIR_M;
    let foundation_m = if in_air {
        base_m - low_m
    } else {
        let lowest_m = place::lowest_m(&footprint.rings[0], ground).min(low_m);
        base_m - lowest_m + (ground.error_m)(center.lat_rad, center.lon_rad)
    };
    Prism {
        id: 0,
        cell: CellId::containing(center.lat_rad, place::wrap(center.lon_rad), 0),
        rings: footprint.rings,
        roof: footprint.triangles,
        base_m: base_m as f32,
        top_m: high_m.max(base_m) as f32,
        foundation_m: foundation_m as f32,
        wall_color: [0; 3],
        roof_color: [0; 3],
        detail: Some(detail),
    }
}

/// The faces over each footprint: each triangle goes to the nearest.
fn split(faces: &Faces, footprints: &[Footprint], raise_m: f64) -> Vec<Detail> {
    let mut parts: Vec<Part> = footprints.iter().map(|_| Part::default()).collect();
    let outlines: Vec<Polygon> = footprints.iter().map(|footprint| local(faces, footprint)).collect();
    for face in &faces.faces {
        let Some(kind) = drawn_as(face.kind) else { continue };
        for &triangle in &face.triangles {
            let at = if outlines.len() == 1 { 0 } else { nearest(&outlines, faces, &triangle) };
            if let Some(part) = parts.get_mut(at) {
                part.push(faces, kind, face, triangle, raise_m);
            }
        }
    }
    parts.into_iter().map(Part::finish).collect()
}

fn drawn_as(kind: SurfaceKind) -> Option<FaceKind> {
    match kind {
        SurfaceKind::Wall => Some(FaceKind::Wall),
        SurfaceKind::Roof => Some(FaceKind::Roof),
        SurfaceKind::Other => Some(FaceKind::Other),
        SurfaceKind::Ground | SurfaceKind::Unseen => None,
    }
}

fn local(faces: &Faces, footprint: &Footprint) -> Polygon {
    let mut rings =
        footprint.rings.iter().map(|ring| LineString::new(ring.iter().map(|&p| faces.plane.to(p)).collect()));
    Polygon::new(rings.next().unwrap_or(LineString::new(Vec::new())), rings.collect())
}

fn nearest(outlines: &[Polygon], faces: &Faces, triangle: &[u32; 3]) -> usize {
    let middle: DVec3 = triangle.iter().map(|&at| faces.corners[at as usize]).sum::<DVec3>() / 3.0;
    let middle = Point::new(middle.x, middle.y);
    let distances = outlines.iter().map(|outline| Euclidean.distance(&middle, outline));
    distances.enumerate().min_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |(at, _)| at)
}

/// What a group of faces is, its colour, and its picture.
type Paint = (FaceKind, Option<[u8; 3]>, Option<u32>);
/// Where a corner lies in which picture, bit by bit.
type Place = Option<(u32, [u32; 2])>;

/// Faces of one paint.
#[derive(Default)]
struct Painted {
    triangles: Vec<[u32; 3]>,
    /// Colours of the texture, by area.
    sum: [f64; 3],
    area_m2: f64,
}

/// A detail in the making.
#[derive(Default)]
struct Part {
    corners: Vec<DetailCorner>,
    uvs: Vec<[f32; 2]>,
    numbers: HashMap<(u32, Place), u32>,
    groups: BTreeMap<Paint, Painted>,
}

impl Part {
    fn push(&mut self, faces: &Faces, kind: FaceKind, face: &Face, triangle: [u32; 3], raise_m: f64) {
        let area_m2 = faces.cross(&triangle).length() / 2.0;
        let room = self.groups.len() < GROUPS_MAX;
        let texture = face.texture.as_ref().filter(|_| room);
        let uv_of = |at: u32| texture.and_then(|texture| texture.uvs.get(&at)).copied();
        let uvs = triangle.map(|at| uv_of(at).unwrap_or_default());
        let triangle = triangle.map(|at| {
            let place = texture.and_then(|texture| Some((texture.picture, uv_of(at)?.map(f32::to_bits))));
            *self.numbers.entry((at, place)).or_insert_with(|| {
                self.uvs.push(uv_of(at).unwrap_or_default());
                let place = faces.corners[at as usize];
                let [lon_rad, lat_rad] = faces.plane.back(geo::Coord { x: place.x, y: place.y });
                self.corners.push(DetailCorner { lon_rad, lat_rad, height_m: (place.z + raise_m) as f32 });
                self.corners.len() as u32 - 1
            })
        });
        let color = face.color.filter(|_| room && texture.is_none());
        let group = self.groups.entry((kind, color, texture.map(|texture| texture.picture))).or_default();
        group.triangles.push(triangle);
        let mean = texture.and_then(|texture| faces.pictures.get(texture.picture as usize)?.mean(uvs));
        if let Some(mean) = mean {
            (0..3).for_each(|channel| group.sum[channel] += mean[channel] * area_m2);
            group.area_m2 += area_m2;
        }
    }

    fn finish(self) -> Detail {
        let groups = self.groups.into_iter().map(|((kind, color, texture), painted)| {
            let Painted { triangles, sum, area_m2 } = painted;
            let mean = (area_m2 > 0.0).then(|| sum.map(|sum| (sum / area_m2).round() as u8));
            FaceGroup { kind, color: color.or(mean), texture, triangles }
        });
        let groups: Vec<FaceGroup> = groups.collect();
        let textured = groups.iter().any(|group| group.texture.is_some());
        Detail { corners: self.corners, uvs: if textured { self.uvs } else { Vec::new() }, groups }
    }
}
