//! Surfaces in three dimensions made sound: welded, triangulated in their planes, turned outwards, told by their slope.

use super::clean::{Plane, Reason, enclosed, fault};
use crate::prepare::textures::{Picture, REPEATS_MAX};
use crate::prepare::vector::{Shape, Surface, SurfaceKind, SurfaceTexture};
use geo::{Area, Coord, LineString, Polygon, TriangulateEarcut};
use glam::DVec3;
use std::collections::{BTreeSet, HashMap, HashSet};
use std::sync::Arc;

/// Points nearer than this are one, metres.
const WELD_M: f64 = 1e-3;
/// Smaller faces are dropped, square metres.
const AREA_MIN_M2: f64 = 1e-4;
/// Faces whose corners lie further than this from their plane are counted, metres.
const PLANE_M: f64 = 0.1;
/// Faces steeper than this (cosine of the angle between normal and vertical) are walls: 84°.
const WALL_COS: f64 = 0.1;
/// Faces that look down lie on the ground when they lie within this of the lowest point, metres.
const GROUND_M: f64 = 0.3;

/// Texture coordinates are no larger than this.
const UV_MAX: f32 = 1e4;

/// A face in one plane, or nearly so.
#[derive(Clone, Debug)]
pub struct Face {
    /// `Unseen` until its slope is told, where the source does not say.
    pub kind: SurfaceKind,
    pub color: Option<[u8; 3]>,
    /// Indices of corners: the outer ring counter-clockwise from outside, then holes; not closed.
    pub rings: Vec<Vec<u32>>,
    pub triangles: Vec<[u32; 3]>,
    /// Unit length, outwards.
    pub normal: DVec3,
    pub texture: Option<FaceTexture>,
}

/// The picture on a face.
#[derive(Clone, Debug)]
pub struct FaceTexture {
    /// Which of the shape's pictures.
    pub picture: u32,
    /// Where its corners lie in the picture, right and down.
    pub uvs: HashMap<u32, [f32; 2]>,
}

/// A feature's faces in local metres.
#[derive(Clone, Debug)]
pub struct Faces {
    pub plane: Plane,
    /// East, north (in `plane`) and height as in the source, metres.
    pub corners: Vec<DVec3>,
    pub faces: Vec<Face>,
    /// Those that its textures name.
    pub pictures: Vec<Arc<Picture>>,
}

impl Faces {
    /// All sound faces of a shape; an error says why there is none. What was repaired or dropped is noted.
    pub fn new(shape: &Shape, notes: &mut BTreeSet<Reason>) -> Result<Self, Reason> {
        let sound = |point: &&[f64; 3]| is_sound(point);
        let first = shape.surfaces.iter().flat_map(|surface| surface.rings.iter().flatten()).find(sound);
        let plane =
            Plane::about(first.map(|p| [p[0].to_radians(), p[1].to_radians()]).ok_or("surfaces without points")?);
        let mut weld = Weld { plane, corners: Vec::new(), by_place: HashMap::new() };
        let mut faces = Vec::new();
        let mut pictures = Vec::new();
        let mut seen = HashSet::new();
        for surface in shape.surfaces.iter().filter(|surface| surface.kind != Some(SurfaceKind::Unseen)) {
            match face(surface, &mut weld) {
                Ok((mut face, note)) => {
                    notes.extend(note);
                    let texture = surface.texture.as_ref();
                    match texture.map(|texture| textured(texture, surface, &face, &mut weld, &mut pictures)) {
                        Some(Ok(texture)) => face.texture = Some(texture),
                        Some(Err(reason)) => _ = notes.insert(reason),
                        None => {}
                    }
                    if seen.insert(fingerprint(&face)) {
                        faces.push(face);
                    } else {
                        notes.insert("surface given twice dropped");
                    }
                }
                Err(reason) => _ = notes.insert(reason),
            }
        }
        if faces.is_empty() {
            return Err("no sound surface");
        }
        let mut all = Self { plane, corners: weld.corners, faces, pictures };
        if all.turn_outwards() {
            notes.insert("surfaces turned outwards");
        }
        all.tell_by_slope(shape);
        Ok(all)
    }

    /// Neighbours are made to agree, then each connected part looks outwards. Says whether anything was turned.
    fn turn_outwards(&mut self) -> bool {
        let mut neighbours: HashMap<(u32, u32), Vec<(usize, bool)>> = HashMap::new();
        for (at, face) in self.faces.iter().enumerate() {
            for ring in &face.rings {
                for (&a, &b) in ring.iter().zip(ring.iter().cycle().skip(1)) {
                    neighbours.entry((a.min(b), a.max(b))).or_default().push((at, a < b));
                }
            }
        }
        let mut links: Vec<Vec<(usize, bool)>> = vec![Vec::new(); self.faces.len()];
        for pair in neighbours.values() {
            if let [(a, along_a), (b, along_b)] = pair[..] {
                links[a].push((b, along_a == along_b));
                links[b].push((a, along_a == along_b));
            }
        }
        let mut turned: Vec<Option<bool>> = vec![None; self.faces.len()];
        let mut any = false;
        for start in 0..self.faces.len() {
            if turned[start].is_none() {
                let part = connected(start, &links, &mut turned);
                let inwards = self.looks_inwards(&part, &links);
                for (at, flip) in part {
                    if flip != inwards {
                        self.faces[at].turn();
                        any = true;
                    }
                }
            }
        }
        any
    }

    /// Whether a part, some of its faces turned, looks inwards on the whole: by its roofs and floors where they are
    /// named; a closed one by its volume; else as most of its faces did in the source.
    fn looks_inwards(&self, part: &[(usize, bool)], links: &[Vec<(usize, bool)>]) -> bool {
        let sign = |flip: bool| if flip { -1.0 } else { 1.0 };
        let sum = |value: &dyn Fn(&Face) -> f64| -> f64 {
            part.iter().map(|&(at, flip)| sign(flip) * value(&self.faces[at])).sum()
        };
        let up_m2 = sum(&|face| match face.kind {
            SurfaceKind::Roof => face.normal.z * self.area_m2(face),
            SurfaceKind::Ground => -face.normal.z * self.area_m2(face),
            _ => 0.0,
        });
        if up_m2.abs() > AREA_MIN_M2 {
            return up_m2 < 0.0;
        }
        let edges = |face: &Face| face.rings.iter().map(Vec::len).sum::<usize>();
        if part.iter().all(|&(at, _)| links[at].len() == edges(&self.faces[at])) {
            let from = self.corners[self.faces[part[0].0].rings[0][0] as usize];
            return sum(&|face| self.volume_m3(face, from)) < 0.0;
        }
        sum(&|face| self.area_m2(face)) < 0.0
    }

    fn area_m2(&self, face: &Face) -> f64 {
        face.triangles.iter().map(|t| self.cross(t).length() / 2.0).sum()
    }

    /// The normal of a triangle, as long as twice its area.
    pub fn cross(&self, triangle: &[u32; 3]) -> DVec3 {
        let [a, b, c] = triangle.map(|at| self.corners[at as usize]);
        (b - a).cross(c - a)
    }

    fn volume_m3(&self, face: &Face, from: DVec3) -> f64 {
        face.triangles.iter().map(|t| (self.corners[t[0] as usize] - from).dot(self.cross(t)) / 6.0).sum()
    }

    /// Heights of a face's corners, metres.
    pub fn heights_m<'a>(&'a self, face: &'a Face) -> impl Iterator<Item = f64> + 'a {
        face.rings.iter().flatten().map(|&corner| self.corners[corner as usize].z)
    }

    fn tell_by_slope(&mut self, shape: &Shape) {
        let named: Vec<bool> = self.faces.iter().map(|face| face.kind != SurfaceKind::Unseen).collect();
        let kinds: Vec<SurfaceKind> = self.faces.iter().map(|face| self.kind_by_slope(face, shape.lowest_m)).collect();
        for ((face, kind), named) in self.faces.iter_mut().zip(kinds).zip(named) {
            if !named {
                face.kind = kind;
            }
        }
    }

    fn kind_by_slope(&self, face: &Face, lowest_m: f64) -> SurfaceKind {
        let up = face.normal.z;
        let on_ground = || self.heights_m(face).all(|height_m| height_m < lowest_m + GROUND_M);
        match () {
            () if up > WALL_COS => SurfaceKind::Roof,
            () if up > -WALL_COS => SurfaceKind::Wall,
            () if on_ground() => SurfaceKind::Ground,
            () => SurfaceKind::Other,
        }
    }
}

impl Face {
    fn turn(&mut self) {
        self.normal = -self.normal;
        self.rings.iter_mut().for_each(|ring| ring.reverse());
        self.triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
    }
}

/// The faces that can be reached over edges of two, and whether each has to be turned to agree with the first.
fn connected(start: usize, links: &[Vec<(usize, bool)>], turned: &mut [Option<bool>]) -> Vec<(usize, bool)> {
    let mut part = vec![(start, false)];
    turned[start] = Some(false);
    let mut next = 0;
    while let Some(&(at, flip)) = part.get(next) {
        next += 1;
        for &(other, disagrees) in &links[at] {
            if turned[other].is_none() {
                turned[other] = Some(flip != disagrees);
                part.push((other, flip != disagrees));
            }
        }
    }
    part
}

fn is_sound(point: &[f64; 3]) -> bool {
    fault(&[point[0], point[1]]).is_none() && point[2].abs() < 1e5
}

/// The same for faces over the same corners, whichever way they look.
fn fingerprint(face: &Face) -> Vec<u32> {
    let mut corners: Vec<u32> = face.rings.iter().flatten().copied().collect();
    corners.sort_unstable();
    corners
}

/// Makes one of points that are near each other.
struct Weld {
    plane: Plane,
    corners: Vec<DVec3>,
    by_place: HashMap<[i64; 3], u32>,
}

impl Weld {
    fn corner(&mut self, point: &[f64; 3]) -> u32 {
        let flat = self.plane.to([point[0].to_radians(), point[1].to_radians()]);
        self.local(DVec3::new(flat.x, flat.y, point[2]))
    }

    fn local(&mut self, place: DVec3) -> u32 {
        let key = place.to_array().map(|metres| (metres / WELD_M).round() as i64);
        *self.by_place.entry(key).or_insert_with(|| {
            self.corners.push(place);
            self.corners.len() as u32 - 1
        })
    }

    /// Corners of a ring, repeated ones once, not closed.
    fn ring(&mut self, points: &[[f64; 3]]) -> Vec<u32> {
        let mut ring: Vec<u32> = points.iter().map(|point| self.corner(point)).collect();
        ring.dedup();
        while ring.len() > 1 && ring.first() == ring.last() {
            ring.pop();
        }
        ring
    }

    fn at(&self, corner: u32) -> DVec3 {
        self.corners[corner as usize]
    }
}

/// A surface as a face with triangles; an error says why it is dropped.
fn face(surface: &Surface, weld: &mut Weld) -> Result<(Face, Option<Reason>), Reason> {
    if surface.rings.iter().flatten().next().is_none() {
        return Err("surface without points dropped");
    }
    if !surface.rings.iter().flatten().all(is_sound) {
        return Err("surface with points not on the Earth dropped");
    }
    let mut rings: Vec<Vec<u32>> = surface.rings.iter().map(|ring| weld.ring(ring)).collect();
    let normal = rings.first().and_then(|ring| normal(ring, weld)).ok_or("surface without area dropped")?;
    let mut at = 0;
    // Slivers of holes go.
    rings.retain(|ring| {
        at += 1;
        at == 1 || ring.len() >= 3 && doubled_area(ring, weld).length() / 2.0 >= AREA_MIN_M2
    });
    let sheet = Sheet::new(weld.at(rings[0][0]), normal);
    let bent = rings.iter().flatten().any(|&corner| sheet.off_m(weld.at(corner)) > PLANE_M);
    let note: Option<Reason> = bent.then_some("surface is not plane: triangulated as it is");
    // Its slope is to tell where the source does not.
    let kind = surface.kind.unwrap_or(SurfaceKind::Unseen);
    let polygon = sheet.polygon(&rings, weld);
    let (triangles, note) = match ears(&polygon, &rings.concat()) {
        Some(triangles) => (triangles, note),
        None => (resolved(&polygon, &sheet, weld)?, Some("crossing rings of a surface resolved")),
    };
    Ok((Face { kind, color: surface.color, rings, triangles, normal, texture: None }, note))
}

/// The texture of a surface at the corners of its face; an error says why it is not kept.
fn textured(
    texture: &SurfaceTexture,
    surface: &Surface,
    face: &Face,
    weld: &mut Weld,
    pictures: &mut Vec<Arc<Picture>>,
) -> Result<FaceTexture, Reason> {
    texture.picture.size_px()?;
    let fits = texture.uvs.len() == surface.rings.len()
        && texture.uvs.iter().zip(&surface.rings).all(|(uvs, ring)| uvs.len() == ring.len());
    if !fits || !texture.uvs.iter().flatten().flatten().all(|part| part.abs() < UV_MAX) {
        return Err("texture coordinates that do not fit their surface: plain colour");
    }
    let mut uvs: HashMap<u32, [f32; 2]> = HashMap::new();
    for (point, &uv) in surface.rings.iter().flatten().zip(texture.uvs.iter().flatten()) {
        uvs.entry(weld.corner(point)).or_insert(uv);
    }
    if face.triangles.iter().flatten().any(|corner| !uvs.contains_key(corner)) {
        return Err("texture of a surface with crossing rings: plain colour");
    }
    let wrap = texture.picture.wrap;
    for axis in 0..2 {
        let low = uvs.values().map(|uv| uv[axis]).fold(f32::INFINITY, f32::min);
        let high = uvs.values().map(|uv| uv[axis]).fold(f32::NEG_INFINITY, f32::max);
        if high - low > REPEATS_MAX {
            return Err("texture repeated too often: plain colour");
        }
        // What repeats may as well be taken from the first of the repeated pictures.
        let shift = wrap.period().map_or(0.0, |period| (low / period).floor() * period);
        uvs.values_mut().for_each(|uv| uv[axis] -= shift);
    }
    let known = pictures.iter().position(|picture| Arc::ptr_eq(picture, &texture.picture));
    let picture = known.unwrap_or(pictures.len()) as u32;
    if known.is_none() {
        pictures.push(texture.picture.clone());
    }
    Ok(FaceTexture { picture, uvs })
}

/// Newell's normal: its length is twice the ring's area.
fn doubled_area(ring: &[u32], weld: &Weld) -> DVec3 {
    let Some(&first) = ring.first() else { return DVec3::ZERO };
    let from = weld.at(first);
    ring.windows(2).map(|edge| (weld.at(edge[0]) - from).cross(weld.at(edge[1]) - from)).sum()
}

/// The unit normal of a ring; `None` where it has no area. The halves of a figure eight have none together: there the
/// largest triangle of two neighbours and the first corner tells.
fn normal(ring: &[u32], weld: &Weld) -> Option<DVec3> {
    let large = |doubled: &DVec3| doubled.length() / 2.0 >= AREA_MIN_M2;
    let from = weld.at(*ring.first()?);
    let triangles = ring.windows(2).map(|edge| (weld.at(edge[0]) - from).cross(weld.at(edge[1]) - from));
    let largest = triangles.max_by(|a, b| a.length_squared().total_cmp(&b.length_squared()));
    let whole = Some(doubled_area(ring, weld)).filter(large);
    whole.or(largest.filter(large)).map(|doubled| doubled.normalize())
}

/// A plane with axes in it; `u × v` is its normal.
struct Sheet {
    origin: DVec3,
    normal: DVec3,
    u: DVec3,
    v: DVec3,
}

impl Sheet {
    fn new(origin: DVec3, normal: DVec3) -> Self {
        let u = normal.any_orthonormal_vector();
        Self { origin, normal, u, v: normal.cross(u) }
    }

    fn off_m(&self, point: DVec3) -> f64 {
        (point - self.origin).dot(self.normal).abs()
    }

    fn polygon(&self, rings: &[Vec<u32>], weld: &Weld) -> Polygon {
        let flat = |&corner: &u32| {
            let from = weld.at(corner) - self.origin;
            Coord { x: from.dot(self.u), y: from.dot(self.v) }
        };
        let mut lines = rings.iter().map(|ring| LineString::new(ring.iter().map(flat).collect()));
        let outer = lines.next().unwrap_or(LineString::new(Vec::new()));
        Polygon::new(outer, lines.collect())
    }

    fn back(&self, point: Coord) -> DVec3 {
        self.origin + self.u * point.x + self.v * point.y
    }
}

/// Triangles over a polygon whose corners, ring by ring, have these numbers; `None` where they do not cover it.
fn ears(polygon: &Polygon, corners: &[u32]) -> Option<Vec<[u32; 3]>> {
    let raw = polygon.earcut_triangles_raw();
    let mut covered_m2 = 0.0;
    let mut triangles = Vec::with_capacity(raw.triangle_indices.len() / 3);
    for triangle in raw.triangle_indices.chunks_exact(3) {
        let [a, b, c] = [0, 1, 2].map(|at| raw.vertices.get(triangle[at]).copied());
        let ([ax, ay], [bx, by], [cx, cy]) = (a?, b?, c?);
        let doubled = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay);
        covered_m2 += doubled.abs() / 2.0;
        let [a, b, c] = [0, 1, 2].map(|at| corners.get(triangle[at]).copied());
        let (a, b, c) = (a?, b?, c?);
        if doubled != 0.0 {
            triangles.push(if doubled > 0.0 { [a, b, c] } else { [a, c, b] });
        }
    }
    let area_m2 = polygon.unsigned_area();
    let is_covered = (covered_m2 - area_m2).abs() <= (1e-3 * area_m2).max(1e-3);
    (is_covered && !triangles.is_empty()).then_some(triangles)
}

/// Triangles over what crossing rings enclose, with new corners where they cross.
fn resolved(polygon: &Polygon, sheet: &Sheet, weld: &mut Weld) -> Result<Vec<[u32; 3]>, Reason> {
    let mut triangles = Vec::new();
    for part in enclosed(polygon).0 {
        let lines = std::iter::once(part.exterior()).chain(part.interiors());
        let points = lines.flat_map(|line| line.0.iter().take(line.0.len().saturating_sub(1)));
        let corners: Vec<u32> = points.map(|&point| weld.local(sheet.back(point))).collect();
        triangles.extend(ears(&part, &corners).into_iter().flatten());
    }
    if triangles.is_empty() { Err("surface that cannot be triangulated dropped") } else { Ok(triangles) }
}
