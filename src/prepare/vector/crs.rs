//! Coordinates of any system to longitude and latitude.

use super::Feature;
use crate::geodesy::VerticalDatum;
use crate::prepare::PrepareError;
use proj::Proj;
use serde_json::Value;

/// Takes a file's coordinates to WGS84 longitude and latitude in degrees.
pub struct ToLonLat {
    /// `None` where they are that already.
    proj: Option<Proj>,
}

/// Names of what needs no transformation.
const LON_LAT: [&str; 4] = ["EPSG:4326", "OGC:CRS84", "CRS84", "WGS84"];

impl ToLonLat {
    pub fn new(file: &str, crs: Option<&str>) -> Result<Self, PrepareError> {
        let Some(crs) = crs.map(plain_name) else { return Ok(Self { proj: None }) };
        if LON_LAT.iter().any(|known| known.eq_ignore_ascii_case(&crs)) {
            return Ok(Self { proj: None });
        }
        let proj = Proj::new_known_crs(&crs, "EPSG:4326", None).map_err(|error| PrepareError::UnknownCrs {
            file: file.to_owned(),
            crs: crs.clone(),
            what: error.to_string(),
        })?;
        Ok(Self { proj: Some(proj) })
    }

    pub fn apply(&self, file: &str, feature: &mut Feature) -> Result<(), PrepareError> {
        let (Some(proj), number) = (&self.proj, feature.number) else { return Ok(()) };
        for point in feature.points_mut() {
            let (lon, lat) = proj.convert((point[0], point[1])).map_err(|error| {
                let remedy = "check the coordinates, and `crs` in the recipe";
                PrepareError::value(file, format!("feature {number}"), error, remedy)
            })?;
            *point = [lon, lat];
        }
        Ok(())
    }

    /// Longitude and latitude of a point, degrees.
    pub fn convert(&self, [x, y]: [f64; 2]) -> Result<[f64; 2], proj::ProjError> {
        let Some(proj) = &self.proj else { return Ok([x, y]) };
        proj.convert((x, y)).map(|(lon, lat)| [lon, lat])
    }
}

/// What the heights of a coordinate system count from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Heights {
    Above(VerticalDatum),
    /// A national system, within half a metre or so of mean sea level.
    National,
    /// It has none.
    Unknown,
}

/// Projections whose coordinates by custom come with heights of the national system: RD New with NAP, the Swiss ones
/// with LN02.
const WITH_NATIONAL_HEIGHTS: [&str; 3] = ["EPSG:28992", "EPSG:2056", "EPSG:21781"];

/// The horizontal part of a coordinate system, and what its heights count from. What PROJ does not know is left as it
/// is, for [`ToLonLat::new`] to complain of.
pub fn heights_of(name: &str) -> (String, Heights) {
    let name = plain_name(name);
    let parts = Proj::new(&name).map(|proj| {
        let text = proj.to_projjson(None, None, None).unwrap_or_default();
        serde_json::from_str::<Value>(&text).unwrap_or_default()
    });
    let Ok(system) = parts else { return (name, Heights::Unknown) };
    match system["type"].as_str() {
        Some("CompoundCRS") => {
            // PROJ leaves the codes of parts out where the whole has one: then the whole serves for its horizontal part.
            let [horizontal, vertical] = [0, 1].map(|part| &system["components"][part]);
            let heights = match (code(vertical).as_deref(), vertical["name"].as_str().unwrap_or_default()) {
                (Some("EPSG:5773"), _) | (_, "EGM96 height") => Heights::Above(VerticalDatum::Egm96),
                (Some("EPSG:3855"), _) | (_, "EGM2008 height") => Heights::Above(VerticalDatum::Egm2008),
                _ => Heights::National,
            };
            (code(horizontal).unwrap_or(name), heights)
        }
        Some("GeographicCRS") if system["coordinate_system"]["axis"].as_array().is_some_and(|axes| axes.len() == 3) => {
            (name, Heights::Above(VerticalDatum::Ellipsoid))
        }
        _ if WITH_NATIONAL_HEIGHTS.contains(&name.as_str()) => (name, Heights::National),
        _ => (name, Heights::Unknown),
    }
}

/// `EPSG:28992` of a system in PROJ's JSON.
fn code(system: &Value) -> Option<String> {
    let id = &system["id"];
    Some(format!("{}:{}", id["authority"].as_str()?, id["code"]))
}

/// `urn:ogc:def:crs:EPSG::3857` and `https://www.opengis.net/def/crs/EPSG/0/3857` as `EPSG:3857`; other names as they
/// are.
fn plain_name(name: &str) -> String {
    let path = name.split_once("opengis.net/def/crs/").map(|(_, path)| path.split('/'));
    let urn = name.strip_prefix("urn:ogc:def:crs:").map(|rest| rest.split(':'));
    let ends = |first: Option<&str>, last: Option<&str>| Some(format!("{}:{}", first?, last?));
    let plain = match (path, urn) {
        (Some(mut parts), _) => ends(parts.next(), parts.next_back()),
        (_, Some(mut parts)) => ends(parts.next(), parts.next_back()),
        _ => None,
    };
    plain.unwrap_or_else(|| name.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_old_geojson_files_are_understood() {
        assert_eq!(plain_name("urn:ogc:def:crs:EPSG::3857"), "EPSG:3857");
        assert_eq!(plain_name("urn:ogc:def:crs:OGC:1.3:CRS84"), "OGC:CRS84");
        assert_eq!(plain_name("EPSG:2056"), "EPSG:2056");
        assert_eq!(plain_name("https://www.opengis.net/def/crs/EPSG/0/7415"), "EPSG:7415");
        assert_eq!(plain_name("http://www.opengis.net/def/crs/OGC/1.3/CRS84"), "OGC:CRS84");
    }

    #[test]
    fn vertical_systems_are_told_from_the_horizontal() {
        let cases = [
            ("EPSG:7415", Heights::National),
            ("urn:ogc:def:crs:EPSG::2056", Heights::National),
            ("EPSG:4979", Heights::Above(VerticalDatum::Ellipsoid)),
            ("EPSG:9707", Heights::Above(VerticalDatum::Egm96)),
            ("EPSG:9518", Heights::Above(VerticalDatum::Egm2008)),
            ("EPSG:25832", Heights::Unknown),
            ("nonsense", Heights::Unknown),
        ];
        for (name, heights) in cases {
            assert_eq!(heights_of(name).1, heights, "{name}");
        }
        // Whichever name stands for the horizontal part, coordinates come out the same.
        let place = |crs: &str| ToLonLat::new("a file", Some(crs)).unwrap().convert([85_000.0, 447_000.0]).unwrap();
        let (whole, part) = (place(&heights_of("EPSG:7415").0), place("EPSG:28992"));
        assert!((0..2).all(|axis| (whole[axis] - part[axis]).abs() < 1e-7), "{whole:?} {part:?}");
    }
}
