//! ESRI shapefiles: `.shp` with its `.dbf`, and `.prj` and `.cpg` where they are there.

use super::crs::ToLonLat;
use super::feature::polygons_of;
use super::{Feature, ReadSummary, Visit};
use crate::prepare::PrepareError;
use crate::prepare::source::{ReadSeek, SourceFile};
use serde_json::{Map, Value};
use shapefile::dbase::{self, FieldValue, Record, encoding::EncodingRs, encoding_rs};
use shapefile::{Shape, ShapeReader};

/// Records without a shape, and shapes that are no polygons.
const NO_SHAPE: &str = "record without a shape";
const NO_POLYGON: &str = "shape that is no polygon";

/// Reads all polygons in the file's order; the system of its `.prj`, unless `crs` overrides it.
pub fn read(file: &SourceFile, crs: Option<&str>, visit: &mut Visit) -> Result<ReadSummary, PrepareError> {
    let name = file.to_string();
    let malformed = |what: String, count: u64| {
        PrepareError::damaged(&name, format!("after {count} records"), format!("{what}; it must be a shapefile"))
    };
    let parts = file.siblings()?;
    let own_crs = text_of(&parts, "prj")?;
    let to_lon_lat = ToLonLat::new(&name, crs.or(own_crs.as_deref()))?;
    let shapes = ShapeReader::new(file.open()?).map_err(|error| malformed(error.to_string(), 0))?;
    let mut reader = shapefile::Reader::new(shapes, open_table(file, &parts)?);
    let mut summary = ReadSummary::default();
    for (before, record) in (0..).zip(reader.iter_shapes_and_records()) {
        let (shape, record) = record.map_err(|error| malformed(error.to_string(), before))?;
        let polygons = match shape {
            Shape::NullShape => Err(NO_SHAPE),
            shape => geo::Geometry::try_from(shape)
                .map_err(|_| NO_POLYGON)
                .and_then(|geometry| polygons_of(geometry).map_err(|_| NO_POLYGON)),
        };
        match polygons {
            Ok(polygons) => {
                let attributes = attributes(record);
                let mut feature = Feature { number: before + 1, polygons, attributes, ..Feature::default() };
                to_lon_lat.apply(&name, &mut feature)?;
                visit(feature)?;
                summary.features += 1;
            }
            Err(why) => *summary.kept_back.entry(why.to_owned()).or_default() += 1,
        }
    }
    Ok(summary)
}

/// What the part with an extension says, where it is there.
fn text_of(parts: &[SourceFile], extension: &str) -> Result<Option<String>, PrepareError> {
    let part = parts.iter().find(|part| part.has_extension(&[extension]));
    let text = part.map(SourceFile::read).transpose()?;
    Ok(text.map(|text| String::from_utf8_lossy(&text).trim().to_owned()))
}

/// The attributes, in the encoding of the `.cpg` beside them, or as they say themselves.
fn open_table(file: &SourceFile, parts: &[SourceFile]) -> Result<dbase::Reader<Box<dyn ReadSeek>>, PrepareError> {
    let Some(table) = parts.iter().find(|part| part.has_extension(&["dbf"])) else {
        return Err(PrepareError::value(
            file,
            "its .dbf",
            "is not there",
            "put it beside the .shp, with the same name",
        ));
    };
    let label = text_of(parts, "cpg")?;
    let builder = dbase::ReaderBuilder::new();
    let builder = match label.as_deref().and_then(encoding) {
        Some(encoding) => builder.with_encoding(EncodingRs::from(encoding)),
        None => builder,
    };
    builder
        .build(table.open()?)
        .map_err(|error| PrepareError::damaged(table, "its head", format!("{error}; it must be a dBase table")))
}

/// `UTF-8`, `ISO-8859-1`, or a bare code page such as `1252`.
fn encoding(label: &str) -> Option<&'static encoding_rs::Encoding> {
    let page = label.trim_start_matches(|c: char| !c.is_ascii_digit());
    encoding_rs::Encoding::for_label(label.as_bytes())
        .or_else(|| encoding_rs::Encoding::for_label(format!("windows-{page}").as_bytes()))
}

fn attributes(record: Record) -> Map<String, Value> {
    record.into_iter().filter_map(|(name, value)| Some((name, attribute(value)?))).collect()
}

/// Empty fields are left out.
fn attribute(value: FieldValue) -> Option<Value> {
    Some(match value {
        FieldValue::Character(text) => Value::from(text?),
        FieldValue::Memo(text) => Value::from(text),
        FieldValue::Numeric(number) => number_value(number?),
        FieldValue::Float(number) => number_value(f64::from(number?)),
        FieldValue::Double(number) | FieldValue::Currency(number) => number_value(number),
        FieldValue::Integer(number) => Value::from(number),
        FieldValue::Logical(flag) => Value::from(flag?),
        FieldValue::Date(date) => Value::from(date?.to_string()),
        FieldValue::DateTime(_) => return None,
    })
}

/// dBase keeps whole numbers as decimals too.
fn number_value(number: f64) -> Value {
    const EXACT_MAX: f64 = 9_007_199_254_740_992.0;
    if number.fract() == 0.0 && number.abs() <= EXACT_MAX { Value::from(number as i64) } else { Value::from(number) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn code_pages_are_known_by_the_names_that_programs_write() {
        assert_eq!(encoding("UTF-8").map(|known| known.name()), Some("UTF-8"));
        assert_eq!(encoding("1252").map(|known| known.name()), Some("windows-1252"));
        assert_eq!(encoding("ANSI 1250").map(|known| known.name()), Some("windows-1250"));
        assert_eq!(encoding("none"), None);
    }

    #[test]
    fn numbers_stay_whole_where_they_are() {
        assert_eq!(attribute(FieldValue::Numeric(Some(12.0))), Some(Value::from(12)));
        assert_eq!(attribute(FieldValue::Numeric(Some(12.5))), Some(Value::from(12.5)));
        assert_eq!(attribute(FieldValue::Numeric(None)), None);
    }
}
