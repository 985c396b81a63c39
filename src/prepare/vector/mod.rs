//! Readers of footprints: GeoJSON (collections and one feature a line), FlatGeobuf (also inside a .zip) and
//! OpenStreetMap extracts. All stream features in longitude and latitude to a visitor.

mod crs;
mod feature;
mod flatgeobuf;
mod geojson;
pub mod osm;
mod osm_buildings;
mod zipped;

pub use feature::{Feature, FootprintPolygon, Ring};
pub use osm_buildings::OsmBuildingCounts;

use std::path::{Path, PathBuf};

/// Why a file of footprints could not be read.
#[derive(Debug, thiserror::Error)]
pub enum VectorError {
    #[error("{}: cannot be read: {source}; check the path and the permissions", file.display())]
    Io { file: PathBuf, source: std::io::Error },
    #[error(
        "{}: no reader for this kind of file; give .geojson, .json, .geojsonl, .fgb (also inside a .zip) or .osm.pbf",
        .0.display()
    )]
    UnknownFormat(PathBuf),
    #[error("{}: feature {number}: {what}", file.display())]
    Feature { file: PathBuf, number: u64, what: String },
    #[error("{}: {what}", file.display())]
    Malformed { file: PathBuf, what: String },
    #[error("{}: the coordinate system {crs:?} is not known to PROJ ({what}); name another by `crs` in the recipe", file.display())]
    UnknownCrs { file: PathBuf, crs: String, what: String },
    #[error("{}: feature {number}: its coordinates cannot be brought to longitude and latitude: {what}", file.display())]
    Projection { file: PathBuf, number: u64, what: String },
}

/// What a visitor of features gives back; an error stops the reading.
pub type Visit<'a> = dyn FnMut(Feature) -> Result<(), VectorError> + 'a;

/// What a file held besides the features that were visited.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ReadSummary {
    /// Features visited.
    pub features: u64,
    /// Features or outlines that the reader itself kept back, by reason.
    pub kept_back: std::collections::BTreeMap<String, u64>,
    pub osm: Option<OsmBuildingCounts>,
}

/// Reads all footprints of one file, in the file's order; numbers count from 1. `crs` overrides what the file says.
pub fn read_footprints(file: &Path, crs: Option<&str>, visit: &mut Visit) -> Result<ReadSummary, VectorError> {
    match Format::of(file)? {
        Format::GeoJson => geojson::read(file, zipped::plain(file)?, crs, visit),
        Format::FlatGeobuf => flatgeobuf::read(file, zipped::plain(file)?, crs, visit),
        Format::OsmPbf => osm_buildings::read(file, visit),
        Format::Zip => read_zip(file, crs, visit),
    }
}

fn read_zip(file: &Path, crs: Option<&str>, visit: &mut Visit) -> Result<ReadSummary, VectorError> {
    let mut total = ReadSummary::default();
    let mut found = false;
    for name in zipped::members(file)? {
        let inside = file.join(&name);
        let part = match Format::of(&inside) {
            Ok(Format::GeoJson) => {
                zipped::with_member(file, &name, |reader| geojson::read(&inside, reader, crs, visit))??
            }
            Ok(Format::FlatGeobuf) => {
                zipped::with_member(file, &name, |reader| flatgeobuf::read(&inside, reader, crs, visit))??
            }
            _ => continue,
        };
        found = true;
        total.features += part.features;
        for (reason, count) in part.kept_back {
            *total.kept_back.entry(reason).or_default() += count;
        }
    }
    if found {
        Ok(total)
    } else {
        Err(VectorError::Malformed { file: file.to_owned(), what: "the archive holds no .geojson and no .fgb".into() })
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Format {
    GeoJson,
    FlatGeobuf,
    OsmPbf,
    Zip,
}

impl Format {
    fn of(file: &Path) -> Result<Self, VectorError> {
        let extension = file.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
        match extension.as_str() {
            "geojson" | "json" | "geojsonl" | "geojsons" | "ndjson" => Ok(Self::GeoJson),
            "fgb" => Ok(Self::FlatGeobuf),
            "pbf" => Ok(Self::OsmPbf),
            "zip" => Ok(Self::Zip),
            _ => Err(VectorError::UnknownFormat(file.to_owned())),
        }
    }
}
