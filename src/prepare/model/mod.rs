//! Models set down by a table: glTF or GLB, at longitudes and latitudes.

mod gltf;
mod table;

pub use table::read;

use super::PrepareError;
use super::buildings::Reason;
use super::textures::Picture;
use crate::content::{Detail, DetailCorner, FaceGroup, FaceKind};
use crate::geodesy::{Enu, Geodetic, Point};
use geo::{ConvexHull, MultiPoint};
use glam::{DVec2, DVec3};
use std::path::Path;
use std::sync::Arc;

/// Colours that are told apart in one model; faces of further ones get the last.
const COLORS_MAX: usize = 240;

/// Triangles of one colour (sRGB) or one picture, with that one's mean colour.
#[derive(Clone, Debug, PartialEq)]
pub struct Colored {
    pub color: [u8; 3],
    /// Which of the model's pictures.
    pub texture: Option<u32>,
    pub triangles: Vec<[u32; 3]>,
}

/// A model in metres east, north and up of the point that is set down; its own -z axis is north, y is up.
#[derive(Clone, Debug, PartialEq)]
pub struct Model {
    pub corners: Vec<DVec3>,
    /// Where each corner lies in the picture of its faces, right and down; (0, 0) without.
    pub uvs: Vec<[f32; 2]>,
    pub groups: Vec<Colored>,
    pub pictures: Vec<Arc<Picture>>,
    /// Convex hull on the map, counter-clockwise.
    pub hull: Vec<DVec2>,
}

/// A model at a place.
#[derive(Clone, Debug, PartialEq)]
pub struct Placement {
    pub model: Arc<Model>,
    pub lon_rad: f64,
    pub lat_rad: f64,
    /// Of the model's origin above the section's datum; without it the terrain carries the model.
    pub height_m: Option<f64>,
    /// Clockwise from north.
    pub heading_rad: f64,
    pub scale: f64,
}

impl Model {
    /// Reads a model and simplifies it so that it is off by no more than `error_m`; 0 leaves it as it is.
    pub fn read(path: &Path, error_m: f64) -> Result<Self, PrepareError> {
        gltf::read(path, error_m)
    }

    /// Of the corners that triangles use.
    fn new(corners: Vec<(DVec3, [f32; 2])>, mut groups: Vec<Colored>, pictures: Vec<Arc<Picture>>) -> Self {
        let mut number = vec![None; corners.len()];
        let mut used = Vec::new();
        for at in groups.iter_mut().flat_map(|group| &mut group.triangles).flatten() {
            *at = *number[*at as usize].get_or_insert_with(|| {
                used.push(corners[*at as usize]);
                used.len() as u32 - 1
            });
        }
        let (corners, uvs): (Vec<DVec3>, Vec<[f32; 2]>) = used.into_iter().unzip();
        let points: MultiPoint = corners.iter().map(|corner| (corner.x, corner.y)).collect();
        let hull = points.convex_hull();
        let mut hull: Vec<DVec2> = hull.exterior().coords().map(|point| DVec2::new(point.x, point.y)).collect();
        hull.pop();
        Self { corners, uvs, groups, pictures, hull }
    }
}

impl Placement {
    /// Longitude and latitude in radians and height above the model's origin of a point of the model.
    fn set_down(&self, point: DVec3) -> Geodetic {
        let (sin, cos) = self.heading_rad.sin_cos();
        let [x, y, z] = (point * self.scale).to_array();
        let turned = Point::<Enu>::new(DVec3::new(x * cos + y * sin, y * cos - x * sin, z));
        let origin = Geodetic { lat_rad: self.lat_rad, lon_rad: self.lon_rad, height_m: 0.0 };
        Geodetic::from_ecef(origin.ecef_from_enu() * turned)
    }

    /// The hull at its place, degrees.
    pub fn outline_deg(&self) -> Vec<[f64; 2]> {
        let place = |point: &DVec2| self.set_down(point.extend(0.0));
        self.model.hull.iter().map(place).map(|at| [at.lon_rad.to_degrees(), at.lat_rad.to_degrees()]).collect()
    }

    /// The model's faces, its origin at a height above the ellipsoid, metres.
    pub fn detail(&self, origin_m: f64) -> Result<Detail, Reason> {
        let corner = |&point: &DVec3| {
            let at = self.set_down(point);
            let height_m = (origin_m + point.z * self.scale) as f32;
            DetailCorner { lon_rad: at.lon_rad, lat_rad: at.lat_rad, height_m }
        };
        let group = |group: &Colored| FaceGroup {
            kind: FaceKind::Other,
            color: Some(group.color),
            texture: group.texture,
            triangles: group.triangles.clone(),
        };
        let textured = self.model.groups.iter().any(|group| group.texture.is_some());
        let detail = Detail {
            uvs: if textured { self.model.uvs.clone() } else { Vec::new() },
            corners: self.model.corners.iter().map(corner).collect(),
            groups: self.model.groups.iter().map(group).collect(),
        };
        if detail.triangles() == 0 { Err("model without faces") } else { Ok(detail) }
    }
}
