//! Coordinates of any system to longitude and latitude.

use super::Feature;
use crate::prepare::PrepareError;
use proj::Proj;

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
}

/// `urn:ogc:def:crs:EPSG::3857` as `EPSG:3857`; other names as they are.
fn plain_name(name: &str) -> String {
    let Some(rest) = name.strip_prefix("urn:ogc:def:crs:") else { return name.to_owned() };
    let mut parts = rest.split(':');
    match (parts.next(), parts.next_back()) {
        (Some(authority), Some(code)) => format!("{authority}:{code}"),
        _ => name.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_old_geojson_files_are_understood() {
        assert_eq!(plain_name("urn:ogc:def:crs:EPSG::3857"), "EPSG:3857");
        assert_eq!(plain_name("urn:ogc:def:crs:OGC:1.3:CRS84"), "OGC:CRS84");
        assert_eq!(plain_name("EPSG:2056"), "EPSG:2056");
    }
}
