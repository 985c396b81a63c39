//! GeoPackage: one of its tables of polygons.

use super::crs::ToLonLat;
use super::feature::polygons_of;
use super::{Feature, ReadSummary, Visit};
use crate::prepare::PrepareError;
use crate::prepare::source::SourceFile;
use geozero::ToGeo;
use geozero::wkb::GpkgWkb;
use rusqlite::types::ValueRef;
use rusqlite::{Connection, OpenFlags, Row};
use serde_json::{Map, Value};
use std::path::Path;

/// Rows without a geometry, and geometries that are no polygons.
const NO_GEOMETRY: &str = "row without a geometry";
const NO_POLYGON: &str = "geometry that is no polygon";
/// Kinds of geometry that hold polygons (GeoPackage 1.4, annex G).
const POLYGONAL: [&str; 4] = ["GEOMETRY", "POLYGON", "MULTIPOLYGON", "GEOMETRYCOLLECTION"];

/// A table of features.
struct Layer {
    table: String,
    geometry: String,
    crs: String,
}

/// Reads the features of the table `wanted`, or of the only one, in its order; the table's system, unless `crs` overrides
/// it.
pub fn read(
    file: &SourceFile,
    crs: Option<&str>,
    wanted: Option<&str>,
    visit: &mut Visit,
) -> Result<ReadSummary, PrepareError> {
    if file.inside.is_some() {
        let remedy = "unpack it: a GeoPackage is read in place";
        return Err(PrepareError::unsupported(file, "its place", "a GeoPackage inside a .zip", remedy));
    }
    let malformed =
        |error: rusqlite::Error| PrepareError::damaged(file, "its tables", format!("{error}; it must be a GeoPackage"));
    let database = open(&file.path).map_err(malformed)?;
    let layer = choose(file, layers(&database).map_err(malformed)?, wanted)?;
    let name = format!("{file}, layer {}", layer.table);
    let to_lon_lat = ToLonLat::new(&name, crs.or(Some(&layer.crs)))?;
    let sql = format!("SELECT * FROM {}", quoted(&layer.table));
    let mut statement = database.prepare(&sql).map_err(malformed)?;
    let columns: Vec<String> = statement.column_names().into_iter().map(str::to_owned).collect();
    let mut rows = statement.query([]).map_err(malformed)?;
    let mut summary = ReadSummary::default();
    let mut number = 0;
    while let Some(row) = rows.next().map_err(malformed)? {
        number += 1;
        match feature(row, &columns, &layer.geometry, number).map_err(malformed)? {
            Ok(mut feature) => {
                to_lon_lat.apply(&name, &mut feature)?;
                visit(feature)?;
                summary.features += 1;
            }
            Err(why) => *summary.kept_back.entry(why.to_owned()).or_default() += 1,
        }
    }
    Ok(summary)
}

/// Opens a database to be read, and leaves nothing beside it: SQLite would, where it is kept with a write-ahead log.
/// While such a log holds rows that are not in the file yet, they count.
fn open(path: &Path) -> rusqlite::Result<Connection> {
    let mut log = path.as_os_str().to_owned();
    log.push("-wal");
    let has_log = std::fs::metadata(log).is_ok_and(|log| log.len() > 0);
    let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    match path.to_str() {
        Some(name) if !has_log => {
            let name = name.replace('%', "%25").replace('?', "%3f").replace('#', "%23");
            let uri = format!("file:{name}?immutable=1");
            Connection::open_with_flags(uri, flags | OpenFlags::SQLITE_OPEN_URI)
        }
        _ => Connection::open_with_flags(path, flags),
    }
}

/// The table that is wanted, or the only one.
fn choose(file: &SourceFile, mut layers: Vec<Layer>, wanted: Option<&str>) -> Result<Layer, PrepareError> {
    let names = layers.iter().map(|layer| layer.table.as_str()).collect::<Vec<_>>().join(", ");
    let at = match wanted {
        Some(wanted) => layers.iter().position(|layer| layer.table == wanted),
        None => (layers.len() == 1).then_some(0),
    };
    match at {
        Some(at) => Ok(layers.swap_remove(at)),
        None if layers.is_empty() => {
            let what = "it has no layer of polygons";
            Err(PrepareError::value(file, "its tables", what, "buildings need Polygon or MultiPolygon"))
        }
        None => {
            let what = match wanted {
                Some(wanted) => format!("it has no layer {wanted} of polygons"),
                None => "it has several layers of polygons".to_owned(),
            };
            Err(PrepareError::value(file, "its tables", what, format!("set `layer` to one of {names}")))
        }
    }
}

fn layers(database: &Connection) -> rusqlite::Result<Vec<Layer>> {
    let mut statement = database.prepare(
        "SELECT g.table_name, g.column_name, upper(g.geometry_type_name), s.organization, s.organization_coordsys_id, \
         s.definition FROM gpkg_geometry_columns g LEFT JOIN gpkg_spatial_ref_sys s ON s.srs_id = g.srs_id \
         ORDER BY g.table_name",
    )?;
    let rows = statement.query_map([], |row| {
        let kind: String = row.get(2)?;
        let (organization, code): (Option<String>, Option<i64>) = (row.get(3)?, row.get(4)?);
        let crs = match (organization, code) {
            (Some(organization), Some(code)) if code > 0 && !organization.eq_ignore_ascii_case("none") => {
                format!("{}:{code}", organization.to_ascii_uppercase())
            }
            _ => row.get::<_, Option<String>>(5)?.unwrap_or_default(),
        };
        Ok((kind, Layer { table: row.get(0)?, geometry: row.get(1)?, crs }))
    })?;
    let mut layers = Vec::new();
    for row in rows {
        let (kind, layer) = row?;
        layers.extend(POLYGONAL.contains(&kind.as_str()).then_some(layer));
    }
    Ok(layers)
}

fn quoted(name: &str) -> String {
    format!("\"{}\"", name.replace('"', "\"\""))
}

/// A row's feature, or why it has none.
fn feature(
    row: &Row<'_>,
    columns: &[String],
    geometry: &str,
    number: u64,
) -> rusqlite::Result<Result<Feature, &'static str>> {
    let (mut polygons, mut attributes) = (Err(NO_GEOMETRY), Map::new());
    for (at, column) in columns.iter().enumerate() {
        let value = row.get_ref(at)?;
        if column == geometry {
            if let ValueRef::Blob(bytes) = value {
                polygons = GpkgWkb(bytes.to_vec())
                    .to_geo()
                    .map_err(|_| NO_POLYGON)
                    .and_then(|geometry| polygons_of(geometry).map_err(|_| NO_POLYGON));
            }
        } else if let Some(value) = attribute(value) {
            attributes.insert(column.clone(), value);
        }
    }
    Ok(polygons.map(|polygons| Feature { number, polygons, attributes, ..Feature::default() }))
}

/// NULL and binary values are left out.
fn attribute(value: ValueRef<'_>) -> Option<Value> {
    match value {
        ValueRef::Integer(number) => Some(Value::from(number)),
        ValueRef::Real(number) => Some(Value::from(number)),
        ValueRef::Text(text) => Some(Value::from(String::from_utf8_lossy(text).into_owned())),
        ValueRef::Null | ValueRef::Blob(_) => None,
    }
}
