//! The table of places: CSV with `lon_deg` and `lat_deg`, and where it has them `height_m`, `heading_deg` and `scale`;
//! other columns are attributes.

use super::{Model, Placement};
use crate::prepare::PrepareError;
use crate::prepare::source::SourceFile;
use crate::prepare::vector::{Feature, ReadSummary, Visit};
use serde_json::{Map, Value};
use std::sync::Arc;

const OWN: [&str; 5] = ["lon_deg", "lat_deg", "height_m", "heading_deg", "scale"];
/// Models are not blown up further than this.
const SCALE_MAX: f64 = 1e4;

/// Reads a feature with a model for each row.
pub fn read(file: &SourceFile, model: Arc<Model>, visit: &mut Visit) -> Result<ReadSummary, PrepareError> {
    let damaged = |place: String, error: csv::Error| PrepareError::damaged(file, place, error);
    let mut rows = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(file.open()?);
    let names = rows.headers().map_err(|error| damaged("line 1".into(), error))?.clone();
    let column = |name: &str| names.iter().position(|known| known == name);
    for name in &OWN[..2] {
        if column(name).is_none() {
            let remedy =
                "name the columns lon_deg, lat_deg, height_m, heading_deg, scale; the last three may be absent";
            return Err(PrepareError::value(file, "line 1", format!("there is no column {name}"), remedy));
        }
    }
    let mut summary = ReadSummary::default();
    for row in rows.records() {
        let row = row.map_err(|error| damaged(format!("after {} rows", summary.features), error))?;
        let line = row.position().map_or(0, csv::Position::line);
        let number = |name: &str| -> Result<Option<f64>, PrepareError> {
            let Some(text) = column(name).and_then(|at| row.get(at)).filter(|text| !text.is_empty()) else {
                return Ok(None);
            };
            let number = text.parse().ok().filter(|number: &f64| number.is_finite());
            number.map(Some).ok_or_else(|| {
                PrepareError::value(
                    file,
                    format!("line {line}, {name}"),
                    format!("{text:?} is no number"),
                    "mend the row",
                )
            })
        };
        let needed = |name: &str, most: f64| {
            number(name)?.filter(|value| value.abs() <= most).ok_or_else(|| {
                let what = format!("{name} is missing or beyond ±{most}");
                PrepareError::value(file, format!("line {line}"), what, "mend the row")
            })
        };
        let placement = Placement {
            model: model.clone(),
            lon_rad: needed("lon_deg", 360.0)?.to_radians(),
            lat_rad: needed("lat_deg", 90.0)?.to_radians(),
            height_m: number("height_m")?,
            heading_rad: number("heading_deg")?.unwrap_or(0.0).to_radians(),
            scale: number("scale")?.unwrap_or(1.0),
        };
        if !(placement.scale > 0.0 && placement.scale <= SCALE_MAX) {
            let what = format!("scale {} is not above 0 and at most {SCALE_MAX}", placement.scale);
            return Err(PrepareError::value(file, format!("line {line}"), what, "mend the row"));
        }
        summary.features += 1;
        visit(Feature {
            number: summary.features,
            polygons: vec![vec![placement.outline_deg()]],
            attributes: attributes(&names, &row),
            model: Some(placement),
            ..Feature::default()
        })?;
    }
    Ok(summary)
}

fn attributes(names: &csv::StringRecord, row: &csv::StringRecord) -> Map<String, Value> {
    let cells = names.iter().zip(row).filter(|(name, text)| !OWN.contains(name) && !text.is_empty());
    cells.map(|(name, text)| (name.to_owned(), Value::from(text))).collect()
}
