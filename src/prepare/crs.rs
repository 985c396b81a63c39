//! Coordinate systems by PROJ, and control grids that make them fast.

use super::PrepareError;
use crate::geodesy::GeoBounds;
use proj::Proj;
use std::cell::RefCell;
use std::collections::HashMap;
use std::f64::consts::TAU;

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

/// A smooth map of the plane by values at a regular grid of control points, bilinear between them.
#[derive(Debug)]
struct ControlGrid {
    /// West and south (or first column and row) of the rectangle, and its control points' spacing.
    origin: [f64; 2],
    step: [f64; 2],
    across: usize,
    values: Vec<[f64; 2]>,
}

/// Grids are doubled until they are good enough, up to this many cells a side.
const MAX_CONTROL_CELLS: usize = 1024;

impl ControlGrid {
    /// A grid over `low`…`high` that is nowhere (at the middles of its cells) further than `tolerance` from `exact`;
    /// none if that takes too many points or `exact` fails somewhere.
    fn fit(
        low: [f64; 2],
        high: [f64; 2],
        tolerance: [f64; 2],
        exact: &dyn Fn(f64, f64) -> Option<[f64; 2]>,
    ) -> Option<Self> {
        let mut grid = Self::sample(low, high, 8, exact)?;
        loop {
            let cells = (grid.across - 1) * 2;
            if cells > MAX_CONTROL_CELLS {
                return None;
            }
            let finer = Self::sample(low, high, cells, exact)?;
            let close = (0..finer.values.len()).all(|i| {
                let at: [f64; 2] = [i % finer.across, i / finer.across].map(|k| k as f64);
                let [x, y] = [0, 1].map(|a| finer.origin[a] + at[a] * finer.step[a]);
                let [u, v] = grid.at(x, y);
                (u - finer.values[i][0]).abs() <= tolerance[0] && (v - finer.values[i][1]).abs() <= tolerance[1]
            });
            grid = finer;
            if close {
                return Some(grid);
            }
        }
    }

    fn sample(
        low: [f64; 2],
        high: [f64; 2],
        cells: usize,
        exact: &dyn Fn(f64, f64) -> Option<[f64; 2]>,
    ) -> Option<Self> {
        let step = [0, 1].map(|a| (high[a] - low[a]) / cells as f64);
        let across = cells + 1;
        let values = (0..across * across)
            .map(|i| exact(low[0] + (i % across) as f64 * step[0], low[1] + (i / across) as f64 * step[1]))
            .collect::<Option<Vec<_>>>()?;
        Some(Self { origin: low, step, across, values })
    }

    /// The value at a place; outside the rectangle the border's cell goes on.
    fn at(&self, x: f64, y: f64) -> [f64; 2] {
        let place = |v: f64, a: usize| {
            let t = (v - self.origin[a]) / self.step[a];
            let cell = t.floor().clamp(0.0, (self.across - 2) as f64);
            (cell as usize, t - cell)
        };
        let ((i, s), (j, t)) = (place(x, 0), place(y, 1));
        let at = |i: usize, j: usize| self.values[j * self.across + i];
        let (p, q, r, o) = (at(i, j), at(i + 1, j), at(i, j + 1), at(i + 1, j + 1));
        [0, 1].map(|a| (p[a] * (1.0 - s) + q[a] * s) * (1.0 - t) + (r[a] * (1.0 - s) + o[a] * s) * t)
    }
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

/// Between the samples of a raster (col, row; fractions between them) and latitude and longitude.
#[derive(Debug)]
pub enum Placement {
    /// Rows along parallels, columns along meridians.
    Geographic {
        west_deg: f64,
        lon_step_deg: f64,
        first_lat_deg: f64,
        lat_step_deg: f64,
        cols: f64,
    },
    Warped(Box<Warp>),
}

/// A raster in another system, or turned.
#[derive(Debug)]
pub struct Warp {
    crs: Crs,
    affine: Affine,
    /// Longitudes are counted from here, so that none jumps inside the raster.
    center_lon_deg: f64,
    /// (longitude from the centre, latitude; degrees) → (col, row); exact where it would take too many points.
    forward: Option<ControlGrid>,
    inverse: Option<ControlGrid>,
    low_deg: [f64; 2],
    high_deg: [f64; 2],
}

/// Control grids are this close to PROJ, in samples of the raster.
pub const CONTROL_TOLERANCE: f64 = 1e-3;

impl Placement {
    /// For `cols` × `rows` samples; `file` is for messages.
    pub fn new(crs: Crs, affine: Affine, cols: u32, rows: u32, file: &str) -> Result<Self, PrepareError> {
        if !affine.is_sound() {
            let what = "its georeference gives samples no size or no place";
            return Err(PrepareError::value(file, "georeference", what, "give bounds_deg, or correct the file"));
        }
        if crs.is_wgs84() && affine.b == 0.0 && affine.d == 0.0 && affine.a > 0.0 {
            let beyond = affine.f.abs().max((affine.f + affine.e * f64::from(rows - 1)).abs());
            if beyond > 90.0 + affine.e.abs() {
                let what = format!("its latitudes reach {beyond:.3}°");
                return Err(PrepareError::value(file, "georeference", what, "give the right crs in the recipe"));
            }
            return Ok(Self::Geographic {
                west_deg: affine.c,
                lon_step_deg: affine.a,
                first_lat_deg: affine.f,
                lat_step_deg: affine.e,
                cols: f64::from(cols),
            });
        }
        Ok(Self::Warped(Box::new(Warp::new(crs, affine, cols, rows, file)?)))
    }

    /// (col, row) of a place, perhaps outside the raster; none far outside.
    pub fn locate(&self, lat_rad: f64, lon_rad: f64) -> Option<(f64, f64)> {
        match self {
            Self::Geographic { west_deg, lon_step_deg, first_lat_deg, lat_step_deg, cols } => {
                let half_deg = lon_step_deg * cols / 2.0;
                let from_center = wrap_deg(lon_rad.to_degrees() - west_deg - half_deg);
                let col = (from_center + half_deg) / lon_step_deg;
                Some((col, (lat_rad.to_degrees() - first_lat_deg) / lat_step_deg))
            }
            Self::Warped(warp) => warp.locate(lat_rad.to_degrees(), lon_rad.to_degrees()),
        }
    }

    /// Latitude and longitude (−π to π) of a sample.
    pub fn lat_lon_rad(&self, col: f64, row: f64) -> (f64, f64) {
        match self {
            Self::Geographic { west_deg, lon_step_deg, first_lat_deg, lat_step_deg, .. } => {
                let lat_deg = (first_lat_deg + row * lat_step_deg).clamp(-90.0, 90.0);
                (lat_deg.to_radians(), wrap_deg(west_deg + col * lon_step_deg).to_radians())
            }
            Self::Warped(warp) => {
                let (lon_deg, lat_deg) = warp.lon_lat_deg(col, row);
                (lat_deg.to_radians(), wrap_deg(lon_deg).to_radians())
            }
        }
    }

    /// Bounds of the rectangle between two samples' places; cut at the antimeridian.
    pub fn bounds(&self, low: (f64, f64), high: (f64, f64)) -> Vec<GeoBounds> {
        match self {
            Self::Geographic { west_deg, lon_step_deg, first_lat_deg, lat_step_deg, .. } => {
                let lat = |row: f64| (first_lat_deg + row * lat_step_deg).clamp(-90.0, 90.0);
                let (one, other) = (lat(low.1), lat(high.1));
                let (west, east) = (west_deg + low.0 * lon_step_deg, west_deg + high.0 * lon_step_deg);
                cut_at_antimeridian(west, one.min(other), east, one.max(other))
            }
            Self::Warped(warp) => warp.bounds(low, high),
        }
    }

    /// North–south and east–west size of a sample's step on the ground, as angles at the Earth's surface, radians;
    /// for a geographic raster the second is a difference of longitude (times cos φ on the ground).
    pub fn steps_rad(&self) -> (f64, f64) {
        match self {
            Self::Geographic { lon_step_deg, lat_step_deg, .. } => {
                (lat_step_deg.abs().to_radians(), lon_step_deg.to_radians())
            }
            Self::Warped(warp) => warp.steps_rad(),
        }
    }

    pub fn is_geographic(&self) -> bool {
        matches!(self, Self::Geographic { .. })
    }
}

impl Warp {
    fn new(crs: Crs, affine: Affine, cols: u32, rows: u32, file: &str) -> Result<Self, PrepareError> {
        let (last_col, last_row) = (f64::from(cols.max(2) - 1), f64::from(rows.max(2) - 1));
        let place = |col: f64, row: f64| {
            let (x, y) = affine.apply(col, row);
            crs.to_lon_lat_deg(x, y)
        };
        let outside = || {
            let what = "it lies outside its coordinate system";
            PrepareError::value(file, "georeference", what, "give the right crs in the recipe")
        };
        let (center_lon_deg, _) = place(last_col / 2.0, last_row / 2.0).ok_or_else(outside)?;
        let relative = |(lon, lat): (f64, f64)| [wrap_deg(lon - center_lon_deg), lat];
        let (mut low_deg, mut high_deg) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        const EDGE_SAMPLES: usize = 33;
        for i in 0..EDGE_SAMPLES * EDGE_SAMPLES {
            let at = |k: usize| k as f64 / (EDGE_SAMPLES - 1) as f64;
            let (u, v) = (at(i % EDGE_SAMPLES), at(i / EDGE_SAMPLES));
            // Half a sample beyond, where pixels of pictures end.
            let p = relative(place(u * (last_col + 1.0) - 0.5, v * (last_row + 1.0) - 0.5).ok_or_else(outside)?);
            low_deg = [0, 1].map(|a| low_deg[a].min(p[a]));
            high_deg = [0, 1].map(|a| high_deg[a].max(p[a]));
        }
        // A border between two samples bulges by far less than this.
        let margin = [0, 1].map(|a| (high_deg[a] - low_deg[a]) * 1e-3);
        for pole in [-90.0, 90.0] {
            let inside = crs.from_lon_lat_deg(center_lon_deg, pole).map(|(x, y)| affine.invert(x, y));
            if inside.is_some_and(|(col, row)| (0.0..=last_col).contains(&col) && (0.0..=last_row).contains(&row)) {
                (low_deg[0], high_deg[0]) = (-180.0, 180.0);
                (low_deg[1], high_deg[1]) = (low_deg[1].min(pole), high_deg[1].max(pole));
            }
        }
        let (low_deg, high_deg) = (
            [(low_deg[0] - margin[0]).max(-180.0), (low_deg[1] - margin[1]).max(-90.0)],
            [(high_deg[0] + margin[0]).min(180.0), (high_deg[1] + margin[1]).min(90.0)],
        );
        let mut warp = Self { crs, affine, center_lon_deg, forward: None, inverse: None, low_deg, high_deg };
        let tolerance_deg = {
            let (ns, _) = warp.steps_rad();
            let tolerance = CONTROL_TOLERANCE * ns.to_degrees();
            let cos = low_deg[1].abs().max(high_deg[1].abs()).to_radians().cos().max(1e-3);
            [tolerance / cos.max(0.2), tolerance]
        };
        let forward = ControlGrid::fit(low_deg, high_deg, [CONTROL_TOLERANCE; 2], &|x, y| warp.exact_locate(x, y));
        let inverse = ControlGrid::fit([-1.0, -1.0], [last_col + 1.0, last_row + 1.0], tolerance_deg, &|col, row| {
            Some(relative(place_in(&warp, col, row)?))
        });
        (warp.forward, warp.inverse) = (forward, inverse);
        Ok(warp)
    }

    fn exact_locate(&self, lon_from_center_deg: f64, lat_deg: f64) -> Option<[f64; 2]> {
        let (x, y) = self.crs.from_lon_lat_deg(wrap_deg(lon_from_center_deg + self.center_lon_deg), lat_deg)?;
        let (col, row) = self.affine.invert(x, y);
        Some([col, row])
    }

    fn locate(&self, lat_deg: f64, lon_deg: f64) -> Option<(f64, f64)> {
        let lon = wrap_deg(lon_deg - self.center_lon_deg);
        let inside = |v: f64, a: usize| v >= self.low_deg[a] && v <= self.high_deg[a];
        if !inside(lon, 0) || !inside(lat_deg, 1) {
            return None;
        }
        let [col, row] = match &self.forward {
            Some(grid) => grid.at(lon, lat_deg),
            None => self.exact_locate(lon, lat_deg)?,
        };
        Some((col, row))
    }

    fn lon_lat_deg(&self, col: f64, row: f64) -> (f64, f64) {
        match &self.inverse {
            Some(grid) => {
                let [lon, lat] = grid.at(col, row);
                (lon + self.center_lon_deg, lat)
            }
            None => place_in(self, col, row).unwrap_or((self.center_lon_deg, 0.0)),
        }
    }

    fn bounds(&self, low: (f64, f64), high: (f64, f64)) -> Vec<GeoBounds> {
        if self.high_deg[1] >= 90.0 || self.low_deg[1] <= -90.0 {
            return self.whole_bounds();
        }
        let (mut west, mut south, mut east, mut north) =
            (f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY);
        const STEPS: u32 = 32;
        for i in 0..=STEPS {
            for j in 0..=STEPS {
                let mix = |a: f64, b: f64, k: u32| a + (b - a) * f64::from(k) / f64::from(STEPS);
                let (lon, lat) = self.lon_lat_deg(mix(low.0, high.0, i), mix(low.1, high.1, j));
                let lon = wrap_deg(lon - self.center_lon_deg);
                (west, south, east, north) = (west.min(lon), south.min(lat), east.max(lon), north.max(lat));
            }
        }
        let margin = (north - south) * 1e-3;
        let center = self.center_lon_deg;
        cut_at_antimeridian(west + center, (south - margin).max(-90.0), east + center, (north + margin).min(90.0))
    }

    fn whole_bounds(&self) -> Vec<GeoBounds> {
        let center = self.center_lon_deg;
        cut_at_antimeridian(self.low_deg[0] + center, self.low_deg[1], self.high_deg[0] + center, self.high_deg[1])
    }

    /// Measured at the middle.
    fn steps_rad(&self) -> (f64, f64) {
        let lat = (self.low_deg[1] + self.high_deg[1]) / 2.0;
        let delta_deg = 1e-5;
        let jacobian = || {
            let origin = self.exact_locate(0.0, lat)?;
            let north = self.exact_locate(0.0, lat + if lat > 0.0 { -delta_deg } else { delta_deg })?;
            let east = self.exact_locate(delta_deg / lat.to_radians().cos().max(1e-6), lat)?;
            let length = |p: [f64; 2]| (p[0] - origin[0]).hypot(p[1] - origin[1]);
            Some((delta_deg.to_radians() / length(north), delta_deg.to_radians() / length(east)))
        };
        jacobian().unwrap_or((1.0, 1.0))
    }
}

fn place_in(warp: &Warp, col: f64, row: f64) -> Option<(f64, f64)> {
    let (x, y) = warp.affine.apply(col, row);
    warp.crs.to_lon_lat_deg(x, y)
}

/// −180 (included) to 180.
fn wrap_deg(deg: f64) -> f64 {
    if (-180.0..=180.0).contains(&deg) { deg } else { (deg + 180.0).rem_euclid(360.0) - 180.0 }
}

/// Degrees to bounds; a rectangle across ±180° gives two, one all the way round gives the whole circle.
fn cut_at_antimeridian(west: f64, south: f64, east: f64, north: f64) -> Vec<GeoBounds> {
    if east - west >= 360.0 - 1e-9 {
        return vec![GeoBounds::from_degrees(-180.0, south, 180.0, north)];
    }
    let turns = ((west + 180.0) / 360.0).floor() * 360.0;
    let (west, east) = (west - turns, east - turns);
    if (east - 180.0).to_radians() <= TAU * 1e-12 {
        return vec![GeoBounds::from_degrees(west, south, east.min(180.0), north)];
    }
    vec![
        GeoBounds::from_degrees(west, south, 180.0, north),
        GeoBounds::from_degrees(-180.0, south, east - 360.0, north),
    ]
}

/// Whether two rectangles share more ground than a border of `width_rad`.
pub fn overlap(a: &GeoBounds, b: &GeoBounds, width_rad: f64) -> bool {
    a.intersection(b).is_some_and(|shared| shared.width_rad() > width_rad && shared.height_rad() > width_rad)
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

    /// Control grids against PROJ itself at places between their nodes, UTM at its zone's edge included.
    #[test]
    fn control_grids_keep_their_tolerance() {
        for (crs, x, y, step) in [
            ("EPSG:32631", 200_000.0, 6_500_000.0, 10.0),
            ("EPSG:3857", -13_630_156.0, 4_553_034.0, 6.0),
            ("EPSG:2056", 2_600_000.0, 1_200_000.0, 0.5),
        ] {
            let affine = Affine { a: step, b: 0.0, c: x, d: 0.0, e: -step, f: y };
            let placement = Placement::new(Crs::new(crs, "t").expect("known"), affine, 4000, 3000, "t").expect("sound");
            let Placement::Warped(warp) = &placement else { panic!("warped") };
            assert!(warp.forward.is_some() && warp.inverse.is_some(), "{crs}");
            for i in 0..500 {
                let (col, row) = (f64::from(i * 7919 % 3999) + 0.37, f64::from(i * 104_729 % 2999) + 0.71);
                let (x, y) = affine.apply(col, row);
                let (lon, lat) = warp.crs.to_lon_lat_deg(x, y).expect("inside");
                let (c, r) = placement.locate(lat.to_radians(), lon.to_radians()).expect("inside");
                assert!((c - col).abs() < 1e-2 && (r - row).abs() < 1e-2, "{crs}: {c} {col}, {r} {row}");
                let (lat2, lon2) = placement.lat_lon_rad(col, row);
                let (c2, r2) = placement.locate(lat2, lon2).expect("inside");
                assert!((c2 - col).abs() < 1e-2 && (r2 - row).abs() < 1e-2, "{crs}");
            }
        }
    }

    #[test]
    fn rectangles_are_cut_at_the_antimeridian() {
        assert_eq!(cut_at_antimeridian(170.0, 0.0, 190.0, 1.0).len(), 2);
        assert_eq!(cut_at_antimeridian(190.0, 0.0, 200.0, 1.0)[0], GeoBounds::from_degrees(-170.0, 0.0, -160.0, 1.0));
        assert_eq!(cut_at_antimeridian(0.0, 0.0, 360.0, 1.0)[0], GeoBounds::from_degrees(-180.0, 0.0, 180.0, 1.0));
        assert_eq!(cut_at_antimeridian(170.0, 0.0, 180.0, 1.0).len(), 1);
    }
}
