//! Readers of raster formats: heights by blocks, pictures whole.

pub mod blocks;
pub mod georeference;
pub mod geotiff;
pub mod grid;
pub mod hgt;
pub mod netcdf;
pub mod netcdf_header;
pub mod picture;
pub mod samples;
#[cfg(test)]
pub mod test_files;
