//! Readers of footprints: GeoJSON (collections and one feature a line), FlatGeobuf and shapefiles (also inside a .zip),
//! GeoPackage, OpenStreetMap extracts and CityJSON. All stream features in longitude and latitude to a visitor.

mod cityjson;
mod crs;
mod feature;
mod flatgeobuf;
mod geojson;
mod geopackage;
pub mod osm;
mod osm_buildings;
mod shapefile;
mod sniff;

pub use feature::{Feature, FootprintPolygon, Ring, Shape, Surface, SurfaceKind, SurfaceTexture};
pub use osm_buildings::OsmBuildingCounts;

use super::PrepareError;
use super::source::SourceFile;
use crate::geodesy::VerticalDatum;

/// Endings of the files that hold footprints.
pub const EXTENSIONS: [&str; 10] =
    ["geojson", "json", "geojsonl", "geojsons", "ndjson", "jsonl", "fgb", "shp", "gpkg", "osm.pbf"];

/// What a visitor of features gives back; an error stops the reading.
pub type Visit<'a> = dyn FnMut(Feature) -> Result<(), PrepareError> + 'a;

/// What a file held besides the features that were visited.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ReadSummary {
    /// Features visited.
    pub features: u64,
    /// Features or outlines that the reader itself kept back, by reason.
    pub kept_back: std::collections::BTreeMap<String, u64>,
    pub osm: Option<OsmBuildingCounts>,
}

/// What a recipe says about how to read a file.
#[derive(Clone, Copy, Debug, Default)]
pub struct ReadOptions<'a> {
    /// Overrides what the file says.
    pub crs: Option<&'a str>,
    /// The table of a GeoPackage that has several.
    pub layer: Option<&'a str>,
    /// Level of detail to take of CityJSON; by default the highest.
    pub lod: Option<f64>,
    /// What the heights of surfaces count from; overrides what the file says.
    pub vertical: Option<VerticalDatum>,
}

/// Reads all footprints of one file, in the file's order; numbers count from 1.
pub fn read_footprints(
    file: &SourceFile,
    options: &ReadOptions,
    visit: &mut Visit,
) -> Result<ReadSummary, PrepareError> {
    let format = Format::of(file)?;
    let ReadOptions { crs, layer, lod, .. } = *options;
    if let Some(layer) = layer.filter(|_| format != Format::GeoPackage) {
        let remedy = "leave `layer` out: only a GeoPackage has layers";
        return Err(PrepareError::unsupported(file, "its kind", format!("a layer ({layer}) of such a file"), remedy));
    }
    if let Some(lod) = lod.filter(|_| format != Format::CityJson) {
        let remedy = "leave `lod` out: only CityJSON has levels of detail";
        return Err(PrepareError::unsupported(file, "its kind", format!("lod {lod} of such a file"), remedy));
    }
    match format {
        Format::GeoJson => geojson::read(&file.to_string(), file.open()?, crs, visit),
        Format::CityJson => cityjson::read(file, options, visit),
        Format::FlatGeobuf => flatgeobuf::read(&file.to_string(), file.open()?, crs, visit),
        Format::Shapefile => shapefile::read(file, crs, visit),
        Format::GeoPackage => geopackage::read(file, crs, layer, visit),
        Format::OsmPbf => osm_buildings::read(file, visit),
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Format {
    GeoJson,
    CityJson,
    FlatGeobuf,
    Shapefile,
    GeoPackage,
    OsmPbf,
}

impl Format {
    fn of(file: &SourceFile) -> Result<Self, PrepareError> {
        if file.has_extension(&["fgb"]) {
            Ok(Self::FlatGeobuf)
        } else if file.has_extension(&["shp"]) {
            Ok(Self::Shapefile)
        } else if file.has_extension(&["gpkg"]) {
            Ok(Self::GeoPackage)
        } else if file.has_extension(&["pbf"]) {
            Ok(Self::OsmPbf)
        } else if file.has_extension(&EXTENSIONS) {
            Ok(if sniff::is_cityjson(file.open()?) { Self::CityJson } else { Self::GeoJson })
        } else {
            let remedy = "give .geojson, .json (GeoJSON or CityJSON), .geojsonl, .fgb, .shp (also inside a .zip), .gpkg or .osm.pbf";
            Err(PrepareError::unsupported(file, "its name", "this kind of file of footprints", remedy))
        }
    }
}
