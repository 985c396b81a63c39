//! From a recipe's section to lattices of posts: every file opened, and those that share a lattice joined.

use crate::prepare::PrepareError;
use crate::prepare::crs::{Affine, Crs};
use crate::prepare::placement::Placement;
use crate::prepare::raster::blocks::{BlockCache, BlockReader};
use crate::prepare::raster::geotiff::{GeoTiff, TiffHeights};
use crate::prepare::raster::grid::{HeightGrid, Tile};
use crate::prepare::raster::hgt::Hgt;
use crate::prepare::raster::netcdf::NetCdf;
use crate::prepare::raster::samples::Conditions;
use crate::prepare::recipe::ElevationSection;
use crate::prepare::source::{SourceFile, resolve};
use std::path::Path;

/// What elevation is read from.
pub const EXTENSIONS: [&str; 6] = ["tif", "tiff", "hgt", "nc", "cdf", "grd"];

/// One open file.
pub struct HeightFile {
    pub file: SourceFile,
    pub crs: Crs,
    pub affine: Affine,
    pub reader: Box<dyn BlockReader>,
}

/// Opens all files of a section.
pub fn open_all(section: &ElevationSection, root: &Path) -> Result<Vec<HeightFile>, PrepareError> {
    resolve(root, &section.file, &EXTENSIONS)?.iter().map(|file| open(section, file)).collect()
}

fn open(section: &ElevationSection, file: &SourceFile) -> Result<HeightFile, PrepareError> {
    let conditions = Conditions { nodata: section.nodata, clamp_m: section.clamp_m };
    let given = section.crs.as_deref().map(|crs| Crs::new(crs, &file.to_string())).transpose()?;
    if file.has_extension(&["hgt"]) {
        let hgt = Hgt::open(file, conditions)?;
        let (crs, affine) = (given.unwrap_or_else(Crs::wgs84), hgt.affine);
        return Ok(HeightFile { file: file.clone(), crs, affine, reader: Box::new(hgt) });
    }
    if file.has_extension(&["nc", "cdf", "grd"]) {
        let grid = NetCdf::open(file, section.layer.as_deref(), conditions)?;
        let (crs, affine) = (given.unwrap_or_else(Crs::wgs84), grid.affine);
        return Ok(HeightFile { file: file.clone(), crs, affine, reader: Box::new(grid) });
    }
    if !file.has_extension(&["tif", "tiff"]) {
        let remedy = format!("give one of .{}, or a .zip with such", EXTENSIONS.join(", ."));
        return Err(PrepareError::unsupported(file, "its name", "elevation of this format", &remedy));
    }
    let tiff = GeoTiff::open(file)?;
    let no_place = || PrepareError::NoGeoreference {
        file: file.to_string(),
        remedy: "write its place into it: gdal_translate -a_srs EPSG:… -a_ullr WEST NORTH EAST SOUTH",
    };
    let affine = tiff.affine().ok_or_else(no_place)?;
    let crs = match given {
        Some(crs) => crs,
        None => tiff.geo.crs(&file.to_string()).ok_or_else(|| PrepareError::UnknownCrs {
            file: file.to_string(),
            crs: String::new(),
            what: "the file names none".to_owned(),
        })??,
    };
    Ok(HeightFile { file: file.clone(), crs, affine, reader: Box::new(TiffHeights::new(tiff, conditions)?) })
}

/// Origins may be off the common lattice by this part of a step, and steps by as much over a whole tile.
const LATTICE_TOLERANCE: f64 = 0.02;

/// Joins files that share a lattice into one grid, so that there is no seam between them; the others stay apart.
pub fn join(files: Vec<HeightFile>, cache: &mut BlockCache) -> Result<Vec<HeightGrid>, PrepareError> {
    let mut groups: Vec<Vec<(i64, i64, HeightFile)>> = Vec::new();
    for file in files {
        match groups.iter_mut().find_map(|group| Some((lattice_offset(&group[0].2, &file)?, group))) {
            Some(((row, col), group)) => group.push((row, col, file)),
            None => groups.push(vec![(0, 0, file)]),
        }
    }
    groups.into_iter().map(|group| build(group, cache)).collect()
}

/// Rows and columns from one file's first post to another's, if they share a lattice.
fn lattice_offset(base: &HeightFile, other: &HeightFile) -> Option<(i64, i64)> {
    if base.crs != other.crs {
        return None;
    }
    let layout = other.reader.layout();
    let corners = [(0.0, 0.0), (f64::from(layout.cols), 0.0), (0.0, f64::from(layout.rows))];
    let offsets = corners.map(|(col, row)| {
        let (x, y) = other.affine.apply(col, row);
        let (base_col, base_row) = base.affine.invert(x, y);
        (base_row - row, base_col - col)
    });
    let (row, col) = (offsets[0].0.round(), offsets[0].1.round());
    let close = |(r, c): &(f64, f64)| (r - row).abs() < LATTICE_TOLERANCE && (c - col).abs() < LATTICE_TOLERANCE;
    (offsets.iter().all(close) && row.abs() < 1e9 && col.abs() < 1e9).then_some((row as i64, col as i64))
}

fn build(group: Vec<(i64, i64, HeightFile)>, cache: &mut BlockCache) -> Result<HeightGrid, PrepareError> {
    let first_row = group.iter().map(|g| g.0).min().unwrap_or(0);
    let first_col = group.iter().map(|g| g.1).min().unwrap_or(0);
    let (crs, affine) = (group[0].2.crs.clone(), group[0].2.affine.shifted(first_col as f64, first_row as f64));
    let name = group[0].2.file.to_string();
    let mut tiles = Vec::with_capacity(group.len());
    for (row, col, file) in group {
        let layout = file.reader.layout();
        let (row, col) = ((row - first_row) as u32, (col - first_col) as u32);
        tiles.push(Tile { row, col, layout, first_slot: cache.add(file.reader) });
    }
    let rows = tiles.iter().map(|t| t.row + t.layout.rows).max().unwrap_or(0);
    let cols = tiles.iter().map(|t| t.col + t.layout.cols).max().unwrap_or(0);
    let placement = Placement::new(crs, affine, cols, rows, &name)?;
    Ok(HeightGrid::new(placement, rows, cols, tiles))
}
