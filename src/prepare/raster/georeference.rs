//! Where a GeoTIFF says that it lies (OGC GeoTIFF 1.1, 19-008r4, annexes B and C).

use crate::prepare::PrepareError;
use crate::prepare::crs::{Affine, Crs};

/// The tags that place a GeoTIFF, as they are in the file.
#[derive(Clone, Debug, Default)]
pub struct GeoTags {
    pub pixel_scale: Vec<f64>,
    pub tiepoint: Vec<f64>,
    pub transformation: Vec<f64>,
    pub key_directory: Vec<u16>,
    pub double_params: Vec<f64>,
    pub ascii_params: String,
}

const GT_MODEL_TYPE: u16 = 1024;
const GT_RASTER_TYPE: u16 = 1025;
const GEODETIC_CRS: u16 = 2048;
const GEODETIC_CITATION: u16 = 2049;
const ELLIPSOID: u16 = 2056;
const ELLIPSOID_SEMI_MAJOR: u16 = 2057;
const ELLIPSOID_INV_FLATTENING: u16 = 2059;
const PROJECTED_CRS: u16 = 3072;
const USER_DEFINED: u16 = 32_767;
const MODEL_PROJECTED: u16 = 1;
const MODEL_GEOGRAPHIC: u16 = 2;
const PIXEL_IS_POINT: u16 = 2;
const WGS84_ELLIPSOID: u16 = 7030;

impl GeoTags {
    /// Samples' places in the file's own system, pixel centres for pixel-is-area; none without georeference.
    pub fn affine(&self) -> Option<Affine> {
        let corner = self.raster_affine()?;
        Some(if self.key(GT_RASTER_TYPE) == Some(PIXEL_IS_POINT) { corner } else { corner.shifted(0.5, 0.5) })
    }

    fn raster_affine(&self) -> Option<Affine> {
        if let [a, b, _, c, d, e, _, f, ..] = *self.transformation.as_slice() {
            return Some(Affine { a, b, c, d, e, f });
        }
        let ([sx, sy, ..], [col, row, _, x, y, ..]) = (self.pixel_scale.as_slice(), self.tiepoint.as_slice()) else {
            return None;
        };
        Some(Affine { a: *sx, b: 0.0, c: x - col * sx, d: 0.0, e: -sy, f: y + row * sy })
    }

    /// The file's system; none where it names none.
    pub fn crs(&self, file: &str) -> Option<Result<Crs, PrepareError>> {
        match self.key(GT_MODEL_TYPE)? {
            MODEL_PROJECTED => Some(self.projected(file)),
            MODEL_GEOGRAPHIC => Some(self.geographic(file)),
            other => Some(Err(unknown(file, &format!("GeoTIFF model type {other}")))),
        }
    }

    fn projected(&self, file: &str) -> Result<Crs, PrepareError> {
        match self.key(PROJECTED_CRS) {
            Some(code) if code != USER_DEFINED => Crs::new(&format!("EPSG:{code}"), file),
            _ => Err(unknown(file, "a user-defined projection")),
        }
    }

    fn geographic(&self, file: &str) -> Result<Crs, PrepareError> {
        if let Some(code) = self.key(GEODETIC_CRS).filter(|&code| code != USER_DEFINED) {
            return Crs::new(&format!("EPSG:{code}"), file);
        }
        if self.key(ELLIPSOID) == Some(WGS84_ELLIPSOID) {
            return Ok(Crs::wgs84());
        }
        match (self.double(ELLIPSOID_SEMI_MAJOR), self.double(ELLIPSOID_INV_FLATTENING)) {
            (Some(a), Some(rf)) if (a - 6_378_137.0).abs() < 1e-3 && (rf - 298.257_223_563).abs() < 1e-5 => {
                Ok(Crs::wgs84())
            }
            (Some(a), Some(rf)) => Crs::new(&format!("+proj=longlat +a={a} +rf={rf} +no_defs +type=crs"), file),
            _ => Err(unknown(file, &format!("a user-defined geographic system {:?}", self.ascii(GEODETIC_CITATION)))),
        }
    }

    /// (location, count, value) of a key.
    fn entry(&self, key: u16) -> Option<(u16, usize, u16)> {
        self.key_directory
            .chunks_exact(4)
            .skip(1)
            .find(|entry| entry[0] == key)
            .map(|entry| (entry[1], usize::from(entry[2]), entry[3]))
    }

    fn key(&self, key: u16) -> Option<u16> {
        self.entry(key).filter(|(location, ..)| *location == 0).map(|(.., value)| value)
    }

    fn double(&self, key: u16) -> Option<f64> {
        const DOUBLE_PARAMS: u16 = 34_736;
        let (_, _, index) = self.entry(key).filter(|(location, ..)| *location == DOUBLE_PARAMS)?;
        self.double_params.get(usize::from(index)).copied()
    }

    fn ascii(&self, key: u16) -> Option<&str> {
        const ASCII_PARAMS: u16 = 34_737;
        let (_, count, index) = self.entry(key).filter(|(location, ..)| *location == ASCII_PARAMS)?;
        let start = usize::from(index);
        self.ascii_params.get(start..start + count.saturating_sub(1))
    }
}

fn unknown(file: &str, what: &str) -> PrepareError {
    PrepareError::UnknownCrs { file: file.to_owned(), crs: what.to_owned(), what: "it has no EPSG code".to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tags(keys: &[[u16; 4]]) -> GeoTags {
        GeoTags {
            pixel_scale: vec![0.5, 0.25, 0.0],
            tiepoint: vec![0.0, 0.0, 0.0, 10.0, 50.0, 0.0],
            key_directory: [[1, 1, 0, keys.len() as u16]].iter().chain(keys).flatten().copied().collect(),
            ..Default::default()
        }
    }

    #[test]
    fn area_pixels_have_their_samples_at_their_centres() {
        let area = tags(&[[GT_RASTER_TYPE, 0, 1, 1]]).affine().expect("placed");
        assert_eq!(area.apply(0.0, 0.0), (10.25, 49.875));
        let point = tags(&[[GT_RASTER_TYPE, 0, 1, PIXEL_IS_POINT]]).affine().expect("placed");
        assert_eq!(point.apply(0.0, 0.0), (10.0, 50.0));
        assert_eq!(point.apply(2.0, 2.0), (11.0, 49.5));
        assert!(GeoTags::default().affine().is_none());
    }

    #[test]
    fn systems_are_read_from_keys() {
        let geographic = tags(&[[GT_MODEL_TYPE, 0, 1, 2], [GEODETIC_CRS, 0, 1, 4326]]);
        assert!(geographic.crs("a").expect("named").expect("known").is_wgs84());
        let mut user = tags(&[
            [GT_MODEL_TYPE, 0, 1, 2],
            [GEODETIC_CRS, 0, 1, USER_DEFINED],
            [ELLIPSOID_SEMI_MAJOR, 34_736, 1, 0],
            [ELLIPSOID_INV_FLATTENING, 34_736, 1, 1],
        ]);
        user.double_params = vec![6_378_137.0, 298.257_223_563];
        assert!(user.crs("a").expect("named").expect("known").is_wgs84());
        let odd = tags(&[[GT_MODEL_TYPE, 0, 1, 1], [PROJECTED_CRS, 0, 1, USER_DEFINED]]);
        assert!(odd.crs("a.tif").expect("named").expect_err("odd").to_string().contains("crs ="));
        assert!(tags(&[]).crs("a").is_none());
    }
}
