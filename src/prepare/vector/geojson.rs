//! GeoJSON (RFC 7946): a collection, or features one after the other. Streamed: one feature is in memory at a time.

use super::crs::ToLonLat;
use super::{Feature, FootprintPolygon, ReadSummary, Visit};
use crate::prepare::PrepareError;
use geojson::GeometryValue;
use serde::de::{DeserializeSeed, Deserializer, Error as _, MapAccess, SeqAccess, Visitor};
use serde_json::{Map, Value};
use std::fmt;
use std::io::Read;

/// Reads all features. Degrees of WGS84, unless `crs` or the file's own (older) `crs` member says otherwise.
pub fn read(file: &str, reader: impl Read, crs: Option<&str>, visit: &mut Visit) -> Result<ReadSummary, PrepareError> {
    let mut state = State {
        file,
        to_lon_lat: ToLonLat::new(file, crs)?,
        crs_is_given: crs.is_some(),
        visit,
        features: 0,
        without_geometry: 0,
        failed: None,
    };
    let mut json = serde_json::Deserializer::from_reader(reader);
    loop {
        let outcome = Document(&mut state).deserialize(&mut json);
        if let Some(failed) = state.failed.take() {
            return Err(failed);
        }
        outcome.map_err(|error| state.malformed(&error))?;
        if json.end().is_ok() {
            break;
        }
    }
    let mut kept_back = std::collections::BTreeMap::new();
    if state.without_geometry > 0 {
        kept_back.insert("no geometry".to_owned(), state.without_geometry);
    }
    Ok(ReadSummary { features: state.features, kept_back, osm: None })
}

struct State<'a, 'v> {
    file: &'a str,
    to_lon_lat: ToLonLat,
    crs_is_given: bool,
    visit: &'a mut Visit<'v>,
    features: u64,
    without_geometry: u64,
    /// The error behind serde's, which can only carry a text.
    failed: Option<PrepareError>,
}

impl State<'_, '_> {
    fn malformed(&self, error: &serde_json::Error) -> PrepareError {
        let features = self.features + self.without_geometry;
        PrepareError::damaged(self.file, format!("after {features} features"), format!("{error}; it must be GeoJSON"))
    }

    fn feature_error(&self, number: u64, what: String) -> PrepareError {
        let remedy = "mend the feature or take it out of the file";
        PrepareError::value(self.file, format!("feature {number}"), what, remedy)
    }

    fn take(&mut self, value: Value) -> Result<(), PrepareError> {
        let number = self.features + self.without_geometry + 1;
        let raw = serde_json::from_value::<geojson::Feature>(value)
            .map_err(|error| self.feature_error(number, error.to_string()))?;
        let Some(geometry) = raw.geometry else {
            self.without_geometry += 1;
            return Ok(());
        };
        let mut polygons = Vec::new();
        collect(geometry.value, &mut polygons).map_err(|what| self.feature_error(number, what))?;
        let id = raw.id.map(|id| match id {
            geojson::feature::Id::String(text) => text,
            geojson::feature::Id::Number(number) => number.to_string(),
        });
        let mut feature =
            Feature { number, id, polygons, attributes: raw.properties.unwrap_or_default(), ..Feature::default() };
        self.to_lon_lat.apply(self.file, &mut feature)?;
        self.features += 1;
        (self.visit)(feature)
    }

    fn set_crs(&mut self, member: &Value) -> Result<(), PrepareError> {
        let Some(name) = member.pointer("/properties/name").and_then(Value::as_str) else { return Ok(()) };
        if self.crs_is_given {
            return Ok(());
        }
        if self.features > 0 {
            let what = format!("its coordinate system {name:?} comes after its features");
            return Err(PrepareError::value(self.file, "crs", what, "name it by `crs` in the recipe"));
        }
        self.to_lon_lat = ToLonLat::new(self.file, Some(name))?;
        Ok(())
    }

    /// Hands an error past serde.
    fn outcome<E: serde::de::Error>(&mut self, result: Result<(), PrepareError>) -> Result<(), E> {
        result.map_err(|error| {
            let text = error.to_string();
            self.failed = Some(error);
            E::custom(text)
        })
    }
}

/// Polygons of a geometry; other shapes are an error that says what was found.
fn collect(value: GeometryValue, polygons: &mut Vec<FootprintPolygon>) -> Result<(), String> {
    let points = |rings: geojson::PolygonType| -> Result<FootprintPolygon, String> {
        rings.into_iter().map(|ring| ring.iter().map(point).collect()).collect()
    };
    match value {
        GeometryValue::Polygon { coordinates } => polygons.push(points(coordinates)?),
        GeometryValue::MultiPolygon { coordinates } => {
            for rings in coordinates {
                polygons.push(points(rings)?);
            }
        }
        GeometryValue::GeometryCollection { geometries } => {
            for geometry in geometries {
                collect(geometry.value, polygons)?;
            }
        }
        other => {
            return Err(format!(
                "its geometry is a {}, and a building needs a Polygon or MultiPolygon",
                other.type_name()
            ));
        }
    }
    Ok(())
}

fn point(position: &geojson::Position) -> Result<[f64; 2], String> {
    match position.as_slice() {
        [x, y, ..] => Ok([*x, *y]),
        short => Err(format!("a position has {} numbers, and it needs two", short.len())),
    }
}

/// A top-level object: a collection, whose features are taken one by one, or a feature.
struct Document<'s, 'a, 'v>(&'s mut State<'a, 'v>);

impl<'de> DeserializeSeed<'de> for Document<'_, '_, '_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_map(self)
    }
}

impl<'de> Visitor<'de> for Document<'_, '_, '_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("a GeoJSON FeatureCollection or Feature")
    }

    fn visit_map<M: MapAccess<'de>>(self, mut map: M) -> Result<(), M::Error> {
        let mut others = Map::new();
        let mut has_features = false;
        while let Some(key) = map.next_key::<String>()? {
            match key.as_str() {
                "features" => {
                    map.next_value_seed(Features(&mut *self.0))?;
                    has_features = true;
                }
                "crs" => {
                    let member = map.next_value()?;
                    let outcome = self.0.set_crs(&member);
                    self.0.outcome(outcome)?;
                }
                _ => {
                    others.insert(key, map.next_value()?);
                }
            }
        }
        match others.get("type").and_then(Value::as_str) {
            Some("FeatureCollection") if has_features => Ok(()),
            Some("FeatureCollection") => Err(M::Error::custom("the collection has no `features`")),
            Some("Feature") => {
                let outcome = self.0.take(Value::Object(others));
                self.0.outcome(outcome)
            }
            Some(other) => Err(M::Error::custom(format!("its type is {other:?}, not FeatureCollection or Feature"))),
            None => Err(M::Error::custom("it has no `type`")),
        }
    }
}

struct Features<'s, 'a, 'v>(&'s mut State<'a, 'v>);

impl<'de> DeserializeSeed<'de> for Features<'_, '_, '_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_seq(self)
    }
}

impl<'de> Visitor<'de> for Features<'_, '_, '_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("a list of features")
    }

    fn visit_seq<S: SeqAccess<'de>>(self, mut seq: S) -> Result<(), S::Error> {
        while let Some(value) = seq.next_element::<Value>()? {
            let outcome = self.0.take(value);
            self.0.outcome(outcome)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read_text(text: &str) -> Result<Vec<Feature>, PrepareError> {
        let mut features = Vec::new();
        read("a.geojson", text.as_bytes(), None, &mut |feature| {
            features.push(feature);
            Ok(())
        })?;
        Ok(features)
    }

    const SQUARE: &str = r#""geometry":{"coordinates":[[[0,0],[1,0],[1,1],[0,0]]],"type":"Polygon"}"#;

    #[test]
    fn collections_and_lines_of_features_are_read() {
        let feature = format!(r#"{{"type":"Feature","id":7,"properties":{{"height":3}},{SQUARE}}}"#);
        let collection = format!(r#"{{"features":[{feature},{feature}],"type":"FeatureCollection"}}"#);
        for text in [collection, format!("{feature}\n{feature}\n")] {
            let features = read_text(&text).unwrap();
            assert_eq!(features.len(), 2);
            assert_eq!(features[1].number, 2);
            assert_eq!(features[0].id.as_deref(), Some("7"));
            assert_eq!(features[0].polygons[0][0].len(), 4);
            assert_eq!(features[0].attributes["height"], 3);
        }
    }

    #[test]
    fn wrong_types_are_named_with_their_feature() {
        let good = format!(r#"{{"type":"Feature","properties":null,{SQUARE}}}"#);
        let cases = [
            (r#"{"type":"Feature","properties":{},"geometry":{"type":"Point","coordinates":[1,2]}}"#, "Point"),
            (r#"{"type":"Feature","properties":{},"geometry":{"type":"Polygn","coordinates":[]}}"#, "Polygn"),
            (r#"{"type":"Feature","properties":{},"geometry":{"type":"Polygon","coordinates":[["a"]]}}"#, ""),
            (r#"{"type":"Feature","properties":{},"geometry":{"type":"Polygon","coordinates":[[[1]]]}}"#, ""),
            (r#"{"type":"Feture","properties":{},"geometry":null}"#, "Feture"),
            ("7", ""),
        ];
        for (bad, names) in cases {
            let text = format!(r#"{{"type":"FeatureCollection","features":[{good},{bad}]}}"#);
            let error = read_text(&text).unwrap_err().to_string();
            assert!(error.contains("feature 2") && error.contains("a.geojson") && error.contains(names), "{error}");
        }
    }

    #[test]
    fn what_is_not_geojson_is_an_error() {
        for text in ["", "[]", "{}", "7", r#"{"type":"Topology"}"#, r#"{"type":"FeatureCollection"}"#, "{\"type\""] {
            assert!(read_text(text).is_err(), "{text}");
        }
    }

    #[test]
    fn an_older_crs_member_is_followed() {
        let text = r#"{"type":"FeatureCollection","crs":{"type":"name","properties":{"name":"urn:ogc:def:crs:EPSG::3857"}},
            "features":[{"type":"Feature","properties":{},"geometry":{"type":"Polygon",
            "coordinates":[[[111319.4908,0],[222638.9816,0],[222638.9816,111325.1429]]]}}]}"#;
        let features = read_text(text).unwrap();
        for (point, expected) in features[0].polygons[0][0].iter().zip([[1.0, 0.0], [2.0, 0.0], [2.0, 1.0]]) {
            assert!((point[0] - expected[0]).abs() < 1e-7 && (point[1] - expected[1]).abs() < 1e-7, "{point:?}");
        }
    }
}
