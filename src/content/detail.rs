//! Detailed shapes: triangle meshes that stand for a prism's roof and for its walls above the base.

use super::objects::{Look, ObjectMesh, ObjectVertex};
use crate::geodesy::{Ecef, Enu, Geodetic, Point, Transform};
use glam::DVec3;
use std::collections::HashMap;

/// What a face of a building is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum FaceKind {
    Wall,
    Roof,
    /// Doors, windows, undersides of what juts out: like a wall, and no facade is painted on it.
    Other,
}

/// A corner of a detail.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DetailCorner {
    pub lon_rad: f64,
    pub lat_rad: f64,
    /// Above the ellipsoid, metres.
    pub height_m: f32,
}

/// Faces of one kind and colour.
#[derive(Clone, Debug, PartialEq)]
pub struct FaceGroup {
    pub kind: FaceKind,
    /// sRGB; without it the object's own colour of walls or of the roof.
    /// Of faces with a texture, the mean of that: what they have where the texture is absent.
    pub color: Option<[u8; 3]>,
    /// The picture on its faces, where they have one: in a page 0, the atlas; before, which of those that are given with
    /// the object.
    pub texture: Option<u32>,
    /// Indices of corners, counter-clockwise from outside.
    pub triangles: Vec<[u32; 3]>,
}

/// The mesh of one object. Faces on the ground, which nobody sees, are not part of it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Detail {
    pub corners: Vec<DetailCorner>,
    /// Where each corner lies in the picture of its faces: right and down from the upper left corner, as parts of the
    /// sides; 0 to 1 in an atlas. Empty where no face has a texture. Corners that differ in this are not one.
    pub uvs: Vec<[f32; 2]>,
    pub groups: Vec<FaceGroup>,
}

impl Detail {
    /// Lowest and highest corner above the ellipsoid, metres; `None` without corners.
    pub fn height_range_m(&self) -> Option<(f32, f32)> {
        let heights = || self.corners.iter().map(|corner| corner.height_m);
        let low = heights().min_by(f32::total_cmp)?;
        Some((low, heights().max_by(f32::total_cmp)?))
    }

    /// Triangles of all groups.
    pub fn triangles(&self) -> usize {
        self.groups.iter().map(|group| group.triangles.len()).sum()
    }
}

/// Where an object's mesh goes, and what its walls and roof look like.
pub(super) struct Canvas<'a> {
    pub origin: Point<Ecef>,
    /// Index of the object in the page.
    pub object: u16,
    /// Frame in which its normals are given.
    pub ecef_from_enu: Transform<Ecef, Enu>,
    pub wall_color: [u8; 3],
    pub roof_color: [u8; 3],
    pub mesh: &'a mut ObjectMesh,
    /// Looks of the page beyond one for each object.
    pub looks: &'a mut Looks,
}

/// Looks of a page: colours that faces have instead of their object's.
#[derive(Debug)]
pub(super) struct Looks {
    /// Objects of the page: their own looks come first.
    objects: usize,
    more: Vec<Look>,
}

impl Looks {
    pub fn new(objects: usize) -> Self {
        Self { objects, more: Vec::new() }
    }

    /// The number of a look that has these colours. A page whose numbers are used up gives the object's own.
    fn number(&mut self, look: Look, first: usize) -> u16 {
        let own = look.object;
        let at = self.more[first..].iter().position(|known| *known == look).map_or(self.more.len(), |at| first + at);
        let Ok(number) = u16::try_from(self.objects + at) else { return own };
        if at == self.more.len() {
            self.more.push(look);
        }
        number
    }

    pub fn finish(self) -> Vec<Look> {
        self.more
    }
}

impl Canvas<'_> {
    /// Appends a detail's triangles; those that name no corner or have no area are left out.
    pub fn draw(&mut self, detail: &Detail) {
        let enu_from_ecef = self.ecef_from_enu.inverse().rotation();
        let positions: Vec<DVec3> = detail.corners.iter().map(|corner| self.position(corner)).collect();
        let first = self.looks.more.len();
        let mut drawn: HashMap<(u32, u16, u16, bool), u32> = HashMap::new();
        for group in &detail.groups {
            let look = self.look(group, first);
            for triangle in &group.triangles {
                let Some([a, b, c]) = corners(&positions, triangle) else { continue };
                let normal = enu_from_ecef * (b - a).cross(c - a);
                if normal.length_squared() == 0.0 {
                    continue;
                }
                let facing = ObjectVertex::facing(normal, group.kind != FaceKind::Wall);
                for &at in triangle {
                    let uv = group.texture.and_then(|_| detail.uvs.get(at as usize));
                    let vertex = *drawn.entry((at, look, facing, uv.is_some())).or_insert_with(|| {
                        let position_m = positions[at as usize].as_vec3().to_array();
                        self.mesh.vertices.push(ObjectVertex { position_m, look, facing });
                        uv.into_iter().for_each(|uv| self.mesh.texture_last(*uv));
                        self.mesh.vertices.len() as u32 - 1
                    });
                    self.mesh.indices.push(vertex);
                }
            }
        }
    }

    fn position(&self, corner: &DetailCorner) -> DVec3 {
        let &DetailCorner { lon_rad, lat_rad, height_m } = corner;
        Geodetic { lat_rad, lon_rad, height_m: f64::from(height_m) }.to_ecef().xyz() - self.origin.xyz()
    }

    fn look(&mut self, group: &FaceGroup, first: usize) -> u16 {
        let own = Look { object: self.object, wall_color: self.wall_color, roof_color: self.roof_color };
        let look = match (group.kind, group.color) {
            (FaceKind::Wall, Some(color)) => Look { wall_color: color, ..own },
            (FaceKind::Roof, Some(color)) => Look { roof_color: color, ..own },
            // What is no wall takes the second colour.
            (FaceKind::Other, color) => Look { roof_color: color.unwrap_or(own.wall_color), ..own },
            (_, None) => return self.object,
        };
        self.looks.number(look, first)
    }
}

fn corners(positions: &[DVec3], triangle: &[u32; 3]) -> Option<[DVec3; 3]> {
    let [a, b, c] = triangle.map(|at| positions.get(at as usize).copied());
    Some([a?, b?, c?])
}
