//! Coordinate systems by PROJ.

use super::PrepareError;
use proj::Proj;
use std::cell::RefCell;
use std::collections::HashMap;

/// A horizontal coordinate system; cheap to clone and to share, transforms are made once a thread.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Crs {
    /// What PROJ understands: "EPSG:3857", "+proj=…", WKT; none is WGS84 longitude and latitude in degrees.
    definition: Option<String>,
}

/// Both ways between a coordinate system and WGS84.
struct Transforms {
    to_wgs84: Proj,
    from_wgs84: Proj,
}

thread_local! {
    /// PROJ's objects belong to one thread each. As many as there are systems in a recipe.
    static TRANSFORMS: RefCell<HashMap<String, Option<Transforms>>> = RefCell::new(HashMap::new());
}

const WGS84: &str = "EPSG:4326";

impl Crs {
    /// WGS84 longitude and latitude, degrees.
    pub fn wgs84() -> Self {
        Self { definition: None }
    }

    /// Checks that PROJ knows the system; `file` is for the message.
    pub fn new(definition: &str, file: &str) -> Result<Self, PrepareError> {
        let definition = definition.trim();
        if matches!(
            definition.to_ascii_uppercase().as_str(),
            "EPSG:4326" | "EPSG:4979" | "OGC:CRS84" | "CRS84" | "WGS84"
        ) {
            return Ok(Self::wgs84());
        }
        transforms(definition).map_err(|e| PrepareError::UnknownCrs {
            file: file.to_owned(),
            crs: definition.to_owned(),
            what: e.to_string(),
        })?;
        Ok(Self { definition: Some(definition.to_owned()) })
    }

    pub fn is_wgs84(&self) -> bool {
        self.definition.is_none()
    }

    /// WGS84 longitude and latitude in degrees of a place in this system; none where PROJ has none.
    pub fn to_lon_lat_deg(&self, x: f64, y: f64) -> Option<(f64, f64)> {
        self.apply(|t| &t.to_wgs84, x, y)
    }

    /// Easting and northing (or longitude and latitude) in this system of a WGS84 place in degrees.
    pub fn from_lon_lat_deg(&self, lon_deg: f64, lat_deg: f64) -> Option<(f64, f64)> {
        self.apply(|t| &t.from_wgs84, lon_deg, lat_deg)
    }

    fn apply(&self, way: fn(&Transforms) -> &Proj, x: f64, y: f64) -> Option<(f64, f64)> {
        let Some(definition) = &self.definition else { return Some((x, y)) };
        TRANSFORMS.with_borrow_mut(|all| {
            if !all.contains_key(definition) {
                all.insert(definition.clone(), transforms(definition).ok());
            }
            let (x, y) = way(all.get(definition)?.as_ref()?).convert((x, y)).ok()?;
            (x.is_finite() && y.is_finite()).then_some((x, y))
        })
    }
}

fn transforms(definition: &str) -> Result<Transforms, proj::ProjCreateError> {
    Ok(Transforms {
        to_wgs84: Proj::new_known_crs(definition, WGS84, None)?,
        from_wgs84: Proj::new_known_crs(WGS84, definition, None)?,
    })
}

/// Where the samples of a raster lie: x = a·col + b·row + c, y = d·col + e·row + f, in its coordinate system;
/// (col, row) whole at the samples (the centres of pixels).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Affine {
    pub a: f64,
    pub b: f64,
    pub c: f64,
    pub d: f64,
    pub e: f64,
    pub f: f64,
}

impl Affine {
    pub fn apply(&self, col: f64, row: f64) -> (f64, f64) {
        (self.a * col + self.b * row + self.c, self.d * col + self.e * row + self.f)
    }

    pub fn invert(&self, x: f64, y: f64) -> (f64, f64) {
        let det = self.a * self.e - self.b * self.d;
        let (x, y) = (x - self.c, y - self.f);
        ((self.e * x - self.b * y) / det, (self.a * y - self.d * x) / det)
    }

    /// Moves the origin by whole or part samples.
    pub fn shifted(&self, col: f64, row: f64) -> Self {
        let (c, f) = self.apply(col, row);
        Self { c, f, ..*self }
    }

    pub fn is_sound(&self) -> bool {
        [self.a, self.b, self.c, self.d, self.e, self.f].iter().all(|v| v.is_finite())
            && (self.a * self.e - self.b * self.d) != 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_unknown_system_is_named() {
        let error = Crs::new("EPSG:999999", "a.tif").expect_err("unknown").to_string();
        assert!(error.contains("a.tif") && error.contains("EPSG:999999") && error.contains("crs ="), "{error}");
        assert!(Crs::new("EPSG:4326", "a.tif").expect("known").is_wgs84());
    }

    #[test]
    fn web_mercator_comes_out_as_its_formula_says() {
        let crs = Crs::new("EPSG:3857", "a.tif").expect("known");
        let (x, y) = crs.from_lon_lat_deg(-122.4, 37.8).expect("inside");
        let radius = 6_378_137.0;
        assert!((x - radius * (-122.4f64).to_radians()).abs() < 1e-6);
        assert!((y - radius * (37.8f64.to_radians() / 2.0 + std::f64::consts::FRAC_PI_4).tan().ln()).abs() < 1e-6);
    }
}
