//! A picture file on the ground.

use super::PictureSource;
use crate::geodesy::{GeoBounds, SEMI_MAJOR_M};
use crate::prepare::PrepareError;
use crate::prepare::crs::{Affine, Crs};
use crate::prepare::placement::Placement;
use crate::prepare::raster::geotiff::GeoTiff;
use crate::prepare::raster::picture::{self, Light, Picture};
use crate::prepare::recipe::ImagerySection;
use crate::prepare::source::SourceFile;
use crate::store::SourceInfo;

/// A picture with a place.
pub struct GeoPicture {
    picture: Picture,
    placement: Placement,
    texel_rad: f64,
    /// East–west step: of longitude for a geographic picture, else like `texel_rad`.
    across_rad: f64,
    bounds: Vec<GeoBounds>,
    /// Width of the seam, texels.
    feather_texels: f64,
    /// Edges that have one: first and last column, first and last row.
    seams: [bool; 4],
    info: SourceInfo,
}

/// Width of the default seam, texels.
const DEFAULT_FEATHER_TEXELS: f64 = 8.0;
/// Pictures that end this near to a pole end there.
const NEAR_POLE_DEG: f64 = 89.999;
/// Near the poles a texel spans many columns of a geographic picture: no more samples than this are taken.
const MAX_TAPS: u32 = 64;

impl GeoPicture {
    /// `take(cols, rows)` refuses pictures that memory has no room for.
    pub fn open(
        section: &ImagerySection,
        file: &SourceFile,
        take: &mut dyn FnMut(u32, u32) -> Result<(), PrepareError>,
    ) -> Result<Self, PrepareError> {
        let crs = section.crs.as_deref().map(|crs| Crs::new(crs, &file.to_string())).transpose()?;
        if file.has_extension(&["tif", "tiff"]) {
            let tiff = GeoTiff::open(file)?;
            let (cols, rows) = (tiff.layout.cols, tiff.layout.rows);
            take(cols, rows)?;
            let (crs, affine) = tiff_place(section, &tiff, crs)?;
            let nodata = section.nodata.or(tiff.nodata);
            return Self::new(section, file, Place { crs, affine, cols, rows }, |wraps| {
                picture::read_tiff(&tiff, nodata, wraps)
            });
        }
        let (cols, rows) = picture::plain_size(file)?;
        take(cols, rows)?;
        let bounds = section.bounds_deg.ok_or_else(|| no_place(file))?;
        let place = Place { crs: Crs::wgs84(), affine: affine_of(bounds, cols, rows), cols, rows };
        Self::new(section, file, place, |wraps| picture::read_plain(file, wraps))
    }

    fn new(
        section: &ImagerySection,
        file: &SourceFile,
        place: Place,
        read: impl FnOnce(bool) -> Result<Picture, PrepareError>,
    ) -> Result<Self, PrepareError> {
        let Place { crs, affine, cols, rows } = place;
        let placement = Placement::new(crs, affine, cols, rows, &file.to_string())?;
        let wraps = placement.is_geographic() && (affine.a * f64::from(cols) - 360.0).abs() < affine.a * 0.01;
        let picture = read(wraps)?;
        let (texel_rad, across_rad) = placement.steps_rad();
        let texel_m = texel_rad * SEMI_MAJOR_M;
        let feather_texels = section.feather_m.map_or(DEFAULT_FEATHER_TEXELS, |m| m / texel_m);
        let half = f64::from(cols.min(rows)) / 4.0;
        Ok(Self {
            bounds: placement.bounds((-0.5, -0.5), (f64::from(cols) - 0.5, f64::from(rows) - 0.5)),
            seams: Self::open_edges(&placement, wraps, rows),
            picture,
            placement,
            texel_rad,
            across_rad,
            feather_texels: feather_texels.min(half),
            info: SourceInfo {
                kind: "imagery".to_owned(),
                file: section.file.clone(),
                credit: section.credit.clone(),
                licence: section.licence.clone(),
                spacing_m: texel_m,
                count: u64::from(cols) * u64::from(rows),
            },
        })
    }

    /// Smoothstep over the seams' width.
    fn seam(&self, col: f64, row: f64) -> f64 {
        if self.feather_texels <= 0.0 {
            return 1.0;
        }
        let (cols, rows) = (f64::from(self.picture.cols()), f64::from(self.picture.rows()));
        let from_edges = [col + 0.5, cols - 0.5 - col, row + 0.5, rows - 0.5 - row];
        let nearest = from_edges.iter().zip(self.seams).filter(|(_, seam)| *seam).map(|(d, _)| *d);
        let t = (nearest.fold(f64::INFINITY, f64::min) / self.feather_texels).clamp(0.0, 1.0);
        t * t * (3.0 - 2.0 * t)
    }

    /// Edges need a seam but where the picture goes round the Earth or ends at a pole.
    fn open_edges(placement: &Placement, wraps: bool, rows: u32) -> [bool; 4] {
        let polar = |row: f64| {
            placement.is_geographic() && placement.lat_lon_rad(0.0, row).0.abs() > NEAR_POLE_DEG.to_radians()
        };
        [!wraps, !wraps, !polar(-0.5), !polar(f64::from(rows) - 0.5)]
    }

    /// Takes the seams away from edges along which others of the same set go on.
    pub fn join(set: &mut [Self]) {
        for index in 0..set.len() {
            let seams = [0, 1, 2, 3].map(|edge| set[index].seams[edge] && !Self::goes_on(set, index, edge));
            set[index].seams = seams;
        }
    }

    /// Whether beyond all of an edge there is another picture.
    fn goes_on(set: &[Self], index: usize, edge: usize) -> bool {
        const PLACES: u32 = 17;
        let own = &set[index];
        let (cols, rows) = (f64::from(own.picture.cols()), f64::from(own.picture.rows()));
        (0..PLACES).all(|i| {
            let along = (f64::from(i) + 0.5) / f64::from(PLACES);
            let (x, y) = (along * cols - 0.5, along * rows - 0.5);
            let (col, row) = [(-1.5, y), (cols + 0.5, y), (x, -1.5), (x, rows + 0.5)][edge];
            let (lat_rad, lon_rad) = own.placement.lat_lon_rad(col, row);
            set.iter().enumerate().any(|(other, picture)| other != index && picture.at(lat_rad, lon_rad).is_some())
        })
    }

    /// (col, row) of a place on the picture.
    fn at(&self, lat_rad: f64, lon_rad: f64) -> Option<(f64, f64)> {
        let (col, row) = self.placement.locate(lat_rad, lon_rad)?;
        let (cols, rows) = (f64::from(self.picture.cols()), f64::from(self.picture.rows()));
        /// A hair's breadth outside is on the edge.
        const EDGE: f64 = 1e-6;
        let beyond = |v: f64, end: f64| v < -0.5 - EDGE || v > end - 0.5 + EDGE;
        (!beyond(row, rows) && (self.picture.wraps || !beyond(col, cols))).then_some((col, row))
    }
}

impl PictureSource for GeoPicture {
    fn color(&self, lat_rad: f64, lon_rad: f64, texel_rad: f64) -> Option<[u8; 4]> {
        let (col, row) = self.at(lat_rad, lon_rad)?;
        let shrink = if self.placement.is_geographic() { lat_rad.cos().max(1e-4) } else { 1.0 };
        let (wide, high) = (texel_rad / (self.across_rad * shrink), texel_rad / self.texel_rad);
        // The mip whose texel fits the lesser side, then as many samples as the sides need.
        let mip = wide.min(high).max(1.0).log2().floor();
        let taps = |side: f64| ((side / mip.exp2()).ceil() as u32).clamp(1, MAX_TAPS);
        let (across, down) = (taps(wide), taps(high));
        let (width, height) = (if across > 1 { wide } else { 0.0 }, if down > 1 { high } else { 0.0 });
        let mut sum = Light::default();
        for j in 0..down {
            let y = row + height * ((f64::from(j) + 0.5) / f64::from(down) - 0.5);
            for i in 0..across {
                let x = col + width * ((f64::from(i) + 0.5) / f64::from(across) - 0.5);
                self.picture.add(&mut sum, mip as usize, x, y);
            }
        }
        let [r, g, b, coverage] = sum.to_rgba((across * down) as f32);
        let coverage = (f64::from(coverage) * self.seam(col, row)).round() as u8;
        (coverage > 0).then_some([r, g, b, coverage])
    }

    fn texel_rad(&self) -> f64 {
        self.texel_rad
    }

    fn bounds(&self) -> Vec<GeoBounds> {
        self.bounds.clone()
    }

    fn info(&self) -> SourceInfo {
        self.info.clone()
    }
}

struct Place {
    crs: Crs,
    affine: Affine,
    cols: u32,
    rows: u32,
}

/// `bounds_deg` overrides the file's own place.
fn tiff_place(section: &ImagerySection, tiff: &GeoTiff, crs: Option<Crs>) -> Result<(Crs, Affine), PrepareError> {
    if let Some(bounds) = section.bounds_deg {
        return Ok((Crs::wgs84(), affine_of(bounds, tiff.layout.cols, tiff.layout.rows)));
    }
    let file = tiff.file().to_string();
    let affine = tiff.affine().ok_or_else(|| no_place(tiff.file()))?;
    let named = match crs {
        Some(crs) => crs,
        None => tiff.geo.crs(&file).ok_or_else(|| PrepareError::UnknownCrs {
            file: file.clone(),
            crs: String::new(),
            what: "the file names none".to_owned(),
        })??,
    };
    Ok((named, affine))
}

fn no_place(file: &SourceFile) -> PrepareError {
    let remedy = "give `bounds_deg = [west, south, east, north]`, the degrees of its outer edges";
    PrepareError::NoGeoreference { file: file.to_string(), remedy }
}

/// Pixel centres of a plate carrée picture between outer edges.
fn affine_of([west, south, east, north]: [f64; 4], cols: u32, rows: u32) -> Affine {
    let (a, e) = ((east - west) / f64::from(cols), (south - north) / f64::from(rows));
    Affine { a, b: 0.0, c: west, d: 0.0, e, f: north }.shifted(0.5, 0.5)
}
