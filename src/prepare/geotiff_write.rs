//! Heights as a GeoTIFF: float32 metres in EPSG:4326, pixel is point (OGC GeoTIFF 1.1).

use super::PrepareError;
use crate::store::write_whole;
use std::path::Path;
use tiff::encoder::{TiffEncoder, colortype::Gray32Float};
use tiff::tags::Tag;

/// Version 1.1.0, three keys: model geographic, raster pixel-is-point, geographic CRS 4326.
const GEO_KEYS: [u16; 16] = [1, 1, 0, 3, 1024, 0, 1, 2, 1025, 0, 1, 2, 2048, 0, 1, 4326];

/// Writes `heights_m`, rows from the north, NaN where there is none; `north_west` is the first post's longitude and
/// latitude in degrees. The file appears under its name once it is whole.
pub fn write_geotiff(
    path: &Path,
    [columns, rows]: [u32; 2],
    north_west: [f64; 2],
    step_deg: f64,
    heights_m: &[f32],
) -> Result<(), PrepareError> {
    let written = write_whole(path, |file| -> Result<(), tiff::TiffError> {
        let mut encoder =
            TiffEncoder::new(file)?.with_compression(tiff::encoder::Compression::Deflate(Default::default()));
        let mut image = encoder.new_image::<Gray32Float>(columns, rows)?;
        let tags = image.encoder();
        tags.write_tag(Tag::ModelPixelScaleTag, &[step_deg, step_deg, 0.0][..])?;
        tags.write_tag(Tag::ModelTiepointTag, &[0.0, 0.0, 0.0, north_west[0], north_west[1], 0.0][..])?;
        tags.write_tag(Tag::GeoKeyDirectoryTag, &GEO_KEYS[..])?;
        tags.write_tag(Tag::GdalNodata, "nan")?;
        image.write_data(heights_m)
    });
    written.map_err(|error| {
        let source = match error {
            tiff::TiffError::IoError(source) => source,
            other => std::io::Error::other(other),
        };
        PrepareError::Write { file: path.display().to_string(), source }
    })
}
