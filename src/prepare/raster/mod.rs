//! Readers of raster formats.
