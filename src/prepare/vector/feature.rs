//! A feature as its source has it.

use crate::geodesy::VerticalDatum;
use crate::prepare::model::Placement;
use crate::prepare::textures::Picture;
use serde_json::{Map, Value};
use std::collections::BTreeSet;
use std::sync::Arc;

/// Longitude and latitude of its points in degrees, as in the source: closed or not, either way round.
pub type Ring = Vec<[f64; 2]>;

/// The outer ring, then holes.
pub type FootprintPolygon = Vec<Ring>;

/// One building (or the like) of a source, before cleaning.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Feature {
    /// Place in the file, counted from 1.
    pub number: u64,
    pub id: Option<String>,
    pub polygons: Vec<FootprintPolygon>,
    pub attributes: Map<String, Value>,
    /// Parts of one building share the footprint, degrees, that decides how high their common ground lies.
    pub ground: Option<std::sync::Arc<Vec<[f64; 2]>>>,
    /// Its surfaces, where the source has them; the polygons are then only what it can fall back to.
    pub shape: Option<Shape>,
    /// A model set down there, with its hull as polygon.
    pub model: Option<Placement>,
    /// What its reader had to assume; counted beside what is repaired.
    pub notes: BTreeSet<&'static str>,
}

/// A feature in three dimensions.
#[derive(Clone, Debug, PartialEq)]
pub struct Shape {
    pub surfaces: Vec<Surface>,
    /// What heights count from; where nothing says, only their differences count.
    pub vertical: Option<VerticalDatum>,
    /// Lowest point of the building that this is, or is a part of, metres.
    pub lowest_m: f64,
}

/// A face of a feature.
#[derive(Clone, Debug, PartialEq)]
pub struct Surface {
    /// Longitude and latitude in degrees, height in metres: the outer ring counter-clockwise from outside, then holes;
    /// closed or not.
    pub rings: Vec<Vec<[f64; 3]>>,
    /// Where the source does not say, its slope tells.
    pub kind: Option<SurfaceKind>,
    /// sRGB.
    pub color: Option<[u8; 3]>,
    pub texture: Option<SurfaceTexture>,
}

/// A picture on a surface.
#[derive(Clone, Debug, PartialEq)]
pub struct SurfaceTexture {
    pub picture: Arc<Picture>,
    /// Ring by ring, where each point lies in the picture: right and down from the upper left corner, as parts of the
    /// sides.
    pub uvs: Vec<Vec<[f32; 2]>>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum SurfaceKind {
    Wall,
    Roof,
    Ground,
    /// Seen from outside, and none of these.
    Other,
    /// Inside, or there to close a volume only.
    Unseen,
}

impl Feature {
    /// All points of all rings.
    pub fn points_mut(&mut self) -> impl Iterator<Item = &mut [f64; 2]> {
        self.polygons.iter_mut().flatten().flatten()
    }
}

/// The polygons of a geometry; what is none of these is said.
pub fn polygons_of(geometry: geo::Geometry) -> Result<Vec<FootprintPolygon>, String> {
    let mut polygons = Vec::new();
    collect(geometry, &mut polygons)?;
    Ok(polygons)
}

fn collect(geometry: geo::Geometry, polygons: &mut Vec<FootprintPolygon>) -> Result<(), String> {
    match geometry {
        geo::Geometry::Polygon(polygon) => polygons.push(rings(&polygon)),
        geo::Geometry::MultiPolygon(parts) => polygons.extend(parts.iter().map(rings)),
        geo::Geometry::GeometryCollection(parts) => {
            for part in parts {
                collect(part, polygons)?;
            }
        }
        _ => return Err("its geometry is no Polygon or MultiPolygon".into()),
    }
    Ok(())
}

fn rings(polygon: &geo::Polygon) -> FootprintPolygon {
    std::iter::once(polygon.exterior())
        .chain(polygon.interiors())
        .map(|ring| ring.coords().map(|point| [point.x, point.y]).collect())
        .collect()
}
