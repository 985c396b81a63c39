//! A feature as its source has it.

use serde_json::{Map, Value};

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
