//! FlatGeobuf 3.

use super::crs::ToLonLat;
use super::feature::polygons_of;
use super::{Feature, ReadSummary, Visit};
use crate::prepare::PrepareError;
use flatgeobuf::{FallibleStreamingIterator, FeatureProperties, FgbFeature, FgbReader, GeometryType, Header};
use geozero::error::Result as GeozeroResult;
use geozero::{ColumnValue, PropertyProcessor, ToGeo};
use serde_json::{Map, Value};
use std::io::Read;

/// Reads all features in the file's order; the file's coordinate system, unless `crs` overrides it.
pub fn read(file: &str, reader: impl Read, crs: Option<&str>, visit: &mut Visit) -> Result<ReadSummary, PrepareError> {
    let malformed = |error: flatgeobuf::Error, features: u64| {
        PrepareError::damaged(file, format!("after {features} features"), format!("{error}; it must be FlatGeobuf"))
    };
    let opened = FgbReader::open(reader).map_err(|error| malformed(error, 0))?;
    check_type(file, &opened.header())?;
    let expected = opened.header().features_count();
    let own_crs = header_crs(&opened.header());
    let to_lon_lat = ToLonLat::new(file, crs.or(own_crs.as_deref()))?;
    let mut features = opened.select_all_seq().map_err(|error| malformed(error, 0))?;
    let mut count = 0;
    while let Some(raw) = features.next().map_err(|error| malformed(error, count))? {
        count += 1;
        let mut feature = convert(raw, count).map_err(|what| {
            PrepareError::value(file, format!("feature {count}"), what, "mend the feature or take it out of the file")
        })?;
        to_lon_lat.apply(file, &mut feature)?;
        visit(feature)?;
    }
    if count < expected {
        let what = format!("it ends after {count} of {expected} features");
        return Err(PrepareError::damaged(file, "its end", what));
    }
    Ok(ReadSummary { features: count, ..ReadSummary::default() })
}

/// Files of points or lines are refused at once.
fn check_type(file: &str, header: &Header) -> Result<(), PrepareError> {
    match header.geometry_type() {
        GeometryType::Unknown
        | GeometryType::Polygon
        | GeometryType::MultiPolygon
        | GeometryType::GeometryCollection => Ok(()),
        other => {
            let what = format!("its features are of type {other:?}");
            Err(PrepareError::value(file, "header", what, "buildings need Polygon or MultiPolygon"))
        }
    }
}

fn header_crs(header: &Header) -> Option<String> {
    let crs = header.crs()?;
    match (crs.org(), crs.code()) {
        (org, code) if code > 0 => Some(format!("{}:{code}", org.unwrap_or("EPSG"))),
        _ => crs.wkt().map(str::to_owned),
    }
}

fn convert(raw: &FgbFeature, number: u64) -> Result<Feature, String> {
    let mut properties = Properties::default();
    raw.process_properties(&mut properties).map_err(|error| error.to_string())?;
    let geometry = raw.to_geo().map_err(|error| error.to_string())?;
    let polygons = polygons_of(geometry)?;
    Ok(Feature { number, polygons, attributes: properties.0, ..Feature::default() })
}

#[derive(Default)]
struct Properties(Map<String, Value>);

impl PropertyProcessor for Properties {
    fn property(&mut self, _index: usize, name: &str, value: &ColumnValue) -> GeozeroResult<bool> {
        let value = match value {
            ColumnValue::Byte(v) => Value::from(*v),
            ColumnValue::UByte(v) => Value::from(*v),
            ColumnValue::Bool(v) => Value::from(*v),
            ColumnValue::Short(v) => Value::from(*v),
            ColumnValue::UShort(v) => Value::from(*v),
            ColumnValue::Int(v) => Value::from(*v),
            ColumnValue::UInt(v) => Value::from(*v),
            ColumnValue::Long(v) => Value::from(*v),
            ColumnValue::ULong(v) => Value::from(*v),
            ColumnValue::Float(v) => Value::from(*v),
            ColumnValue::Double(v) => Value::from(*v),
            ColumnValue::String(v) | ColumnValue::DateTime(v) => Value::from(*v),
            ColumnValue::Json(v) => serde_json::from_str(v).unwrap_or_else(|_| Value::from(*v)),
            ColumnValue::Binary(_) => return Ok(false),
        };
        self.0.insert(name.to_owned(), value);
        Ok(false)
    }
}
