//! A picture that faces refer to: looked at once for its size and a thumbnail, read again when an atlas is made.

use crate::prepare::buildings::Reason;
use crate::prepare::source::SourceFile;
use image::{ImageReader, Limits, RgbImage, imageops};
use std::io::Cursor;
use std::sync::{Arc, OnceLock};

/// Sides of a picture, texels, at most.
const SIDE_MAX: u32 = 16_384;
/// Sides of the thumbnail that stays in memory: 12 KiB a picture.
const THUMB_PX: u32 = 64;
const MISSING: Reason = "picture of a texture missing: plain colour";
const DAMAGED: Reason = "picture of a texture damaged: plain colour";

/// What is seen beyond a picture's borders.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Wrap {
    /// Its border, drawn out.
    Clamp,
    Repeat,
    Mirror,
}

#[derive(Debug)]
enum Source {
    File(SourceFile),
    Texels(Arc<RgbImage>),
}

#[derive(Debug)]
pub struct Picture {
    source: Source,
    pub wrap: Wrap,
    look: OnceLock<Result<Look, Reason>>,
}

#[derive(Debug)]
struct Look {
    size_px: [u32; 2],
    thumb: RgbImage,
}

/// The same only where it is the same one.
impl PartialEq for Picture {
    fn eq(&self, other: &Self) -> bool {
        std::ptr::eq(self, other)
    }
}

impl Wrap {
    /// After how many pictures it begins anew; `None` where it does not.
    pub fn period(self) -> Option<f32> {
        match self {
            Self::Clamp => None,
            Self::Repeat => Some(1.0),
            Self::Mirror => Some(2.0),
        }
    }

    /// The texel that is seen at a place, of `count` (above 0) along a side.
    pub fn texel(self, at: i64, count: i64) -> i64 {
        match self {
            Self::Clamp => at.clamp(0, count - 1),
            Self::Repeat => at.rem_euclid(count),
            Self::Mirror => {
                let at = at.rem_euclid(2 * count);
                if at < count { at } else { 2 * count - 1 - at }
            }
        }
    }
}

impl Picture {
    /// A PNG or JPEG, read when it is needed.
    pub fn of_file(file: SourceFile, wrap: Wrap) -> Self {
        Self { source: Source::File(file), wrap, look: OnceLock::new() }
    }

    pub fn of_texels(texels: RgbImage, wrap: Wrap) -> Self {
        Self { source: Source::Texels(Arc::new(texels)), wrap, look: OnceLock::new() }
    }

    /// The texels, rows from the top; the reason where there are none.
    pub fn read(&self) -> Result<Arc<RgbImage>, Reason> {
        let file = match &self.source {
            Source::Texels(texels) if texels.width() > 0 && texels.height() > 0 => return Ok(texels.clone()),
            Source::Texels(_) => return Err(DAMAGED),
            Source::File(file) => file,
        };
        let bytes = file.read().map_err(|_| MISSING)?;
        let mut reader = ImageReader::new(Cursor::new(bytes)).with_guessed_format().map_err(|_| DAMAGED)?;
        let mut limits = Limits::default();
        (limits.max_image_width, limits.max_image_height) = (Some(SIDE_MAX), Some(SIDE_MAX));
        reader.limits(limits);
        let texels = reader.decode().map_err(|_| DAMAGED)?.into_rgb8();
        if texels.width() == 0 || texels.height() == 0 { Err(DAMAGED) } else { Ok(Arc::new(texels)) }
    }

    fn look(&self) -> Result<&Look, Reason> {
        let look = self.look.get_or_init(|| {
            let texels = self.read()?;
            let [width, height] = [texels.width(), texels.height()];
            let thumb = imageops::thumbnail(&*texels, width.min(THUMB_PX), height.min(THUMB_PX));
            Ok(Look { size_px: [width, height], thumb })
        });
        look.as_ref().map_err(|reason| *reason)
    }

    /// Width and height, texels; the reason where it cannot be read.
    pub fn size_px(&self) -> Result<[u32; 2], Reason> {
        self.look().map(|look| look.size_px)
    }

    /// Mean colour of a triangle of the picture, sRGB of 255; by the thumbnail.
    pub fn mean(&self, uvs: [[f32; 2]; 3]) -> Option<[f64; 3]> {
        /// Samples along a side of the triangle.
        const STEPS: u32 = 12;
        let thumb = &self.look().ok()?.thumb;
        let (mut sum, mut count) = ([0.0; 3], 0.0);
        for (row, column) in (0..STEPS).flat_map(|row| (0..STEPS - row).map(move |column| (row, column))) {
            // Middles of equal small triangles.
            let [a, b] = [row, column].map(|at| (at as f32 + 1.0 / 3.0) / STEPS as f32);
            let at = |axis: usize| uvs[0][axis] + a * (uvs[1][axis] - uvs[0][axis]) + b * (uvs[2][axis] - uvs[0][axis]);
            let texel = |axis: usize, side: u32| {
                let at = (at(axis) * side as f32).floor() as i64;
                self.wrap.texel(at, i64::from(side)) as u32
            };
            let seen = thumb.get_pixel(texel(0, thumb.width()), texel(1, thumb.height()));
            (0..3).for_each(|channel| sum[channel] += f64::from(seen.0[channel]));
            count += 1.0;
        }
        Some(sum.map(|sum| sum / count))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wraps_go_on_as_they_say() {
        let seen = |wrap: Wrap| (-4..8).map(|at| wrap.texel(at, 3)).collect::<Vec<_>>();
        assert_eq!(seen(Wrap::Clamp), [0, 0, 0, 0, 0, 1, 2, 2, 2, 2, 2, 2]);
        assert_eq!(seen(Wrap::Repeat), [2, 0, 1, 2, 0, 1, 2, 0, 1, 2, 0, 1]);
        assert_eq!(seen(Wrap::Mirror), [2, 2, 1, 0, 0, 1, 2, 2, 1, 0, 0, 1]);
    }

    #[test]
    fn means_are_of_the_triangle() {
        let half = RgbImage::from_fn(256, 128, |x, _| image::Rgb(if x < 128 { [200, 0, 0] } else { [0, 0, 100] }));
        let picture = Picture::of_texels(half, Wrap::Repeat);
        assert_eq!(picture.size_px(), Ok([256, 128]));
        assert_eq!(picture.mean([[0.0, 0.0], [0.5, 0.0], [0.0, 1.0]]), Some([200.0, 0.0, 0.0]));
        assert_eq!(picture.mean([[1.5, 0.0], [1.99, 0.0], [1.5, 1.0]]), Some([0.0, 0.0, 100.0]));
        let missing = SourceFile { path: "no/such/picture.jpg".into(), inside: None };
        let missing = Picture::of_file(missing, Wrap::Clamp);
        assert_eq!((missing.size_px(), missing.mean([[0.0; 2]; 3])), (Err(MISSING), None));
    }
}
