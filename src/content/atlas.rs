//! Pictures on the faces of a page's details, side by side in one.

use intel_tex_2::{RgbaSurface, bc7, etc1};

/// Texels along a side of an atlas, at most.
pub const ATLAS_SIDE_MAX: u32 = 1024;
/// Texels of an atlas at most: 2 MiB on the GPU, and a third of that for mips.
pub const ATLAS_TEXELS_MAX: u32 = 1 << 19;
/// Texels round each part that repeat its border.
pub const ATLAS_GUTTER_PX: u32 = 4;
/// Parts with their gutters begin and end at multiples of this, and so do atlases: then no texel of any mip holds two
/// parts, and filtering at a part's border meets its gutter alone.
pub const ATLAS_ALIGN_PX: u32 = 2 * ATLAS_GUTTER_PX;
/// Mips of an atlas: texels of the coarsest are as large as [`ATLAS_ALIGN_PX`].
pub const ATLAS_MIPS: u32 = ATLAS_ALIGN_PX.ilog2() + 1;
/// Texture coordinates of vertices without a texture. Others stay below: a gutter lies between them and the edge.
pub const NO_TEXTURE: [u16; 2] = [u16::MAX; 2];

/// Sides of the blocks that GPUs read compressed textures by, texels.
const BLOCK_PX: u32 = 4;

/// How the texels of an atlas are laid out for the GPU.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum AtlasFormat {
    /// 4 bytes a texel.
    #[default]
    Rgba8,
    /// Blocks of 4 × 4 texels in 16 bytes.
    Bc7,
    /// Blocks of 4 × 4 texels in 8 bytes: the part of ETC2 that is ETC1.
    Etc2,
}

impl AtlasFormat {
    /// Texels along a block's side, and bytes of a block.
    pub fn block(self) -> (u32, u32) {
        match self {
            Self::Rgba8 => (1, 4),
            Self::Bc7 => (BLOCK_PX, 16),
            Self::Etc2 => (BLOCK_PX, 8),
        }
    }
}

/// A decoded atlas: sRGB, rows from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct Atlas {
    width_px: u32,
    height_px: u32,
    format: AtlasFormat,
    /// Of each level, finest first.
    mips: Vec<Vec<u8>>,
}

impl Atlas {
    /// Of RGB8 texels, rows from the top; `None` where their number or the sides are not those of an atlas.
    pub fn new(width_px: u32, height_px: u32, rgb: &[u8]) -> Option<Self> {
        let is_sound = Self::is_size(width_px, height_px) && rgb.len() == 3 * (width_px * height_px) as usize;
        is_sound.then(|| {
            let finest = rgb.chunks_exact(3).flat_map(|texel| [texel[0], texel[1], texel[2], u8::MAX]).collect();
            let mut mips: Vec<Vec<u8>> = vec![finest];
            for level in 1..ATLAS_MIPS {
                let halved = halve(&mips[level as usize - 1], (width_px >> (level - 1)) as usize);
                mips.push(halved);
            }
            Self { width_px, height_px, format: AtlasFormat::Rgba8, mips }
        })
    }

    /// Whether an atlas may have these sides, texels.
    pub fn is_size(width_px: u32, height_px: u32) -> bool {
        let is_side = |side: u32| (1..=ATLAS_SIDE_MAX).contains(&side) && side.is_multiple_of(ATLAS_ALIGN_PX);
        is_side(width_px) && is_side(height_px) && width_px * height_px <= ATLAS_TEXELS_MAX
    }

    /// Width and height, texels.
    pub fn size_px(&self) -> [u32; 2] {
        [self.width_px, self.height_px]
    }

    pub fn format(&self) -> AtlasFormat {
        self.format
    }

    /// The same in blocks; one that is in blocks already stays as it is. Levels narrower than a block repeat their last
    /// texels.
    pub fn compressed(self, format: AtlasFormat) -> Self {
        if self.format != AtlasFormat::Rgba8 || format == AtlasFormat::Rgba8 {
            return self;
        }
        let level = |(level, texels): (u32, &Vec<u8>)| {
            let (width, height) = (self.width_px >> level, self.height_px >> level);
            compress(format, &in_blocks(texels, width, height), width.next_multiple_of(BLOCK_PX))
        };
        let mips = (0..).zip(&self.mips).map(level).collect();
        Self { format, mips, ..self }
    }

    /// Of each level in its format, finest first; level n has sides of `size_px >> n` texels.
    pub fn mips(&self) -> &[Vec<u8>] {
        &self.mips
    }

    pub fn byte_len(&self) -> usize {
        self.mips.iter().map(Vec::len).sum()
    }
}

/// RGBA8 texels with whole blocks on both sides.
fn in_blocks(texels: &[u8], width: u32, height: u32) -> Vec<u8> {
    let [wide, high] = [width, height].map(|side| side.next_multiple_of(BLOCK_PX));
    let texel = |x: u32, y: u32| {
        let at = 4 * (y.min(height - 1) * width + x.min(width - 1)) as usize;
        &texels[at..at + 4]
    };
    (0..high).flat_map(|y| (0..wide).flat_map(move |x| texel(x, y))).copied().collect()
}

/// `width`: a multiple of a block's side.
fn compress(format: AtlasFormat, rgba: &[u8], width: u32) -> Vec<u8> {
    let surface = RgbaSurface { data: rgba, width, height: rgba.len() as u32 / 4 / width, stride: 4 * width };
    match format {
        AtlasFormat::Rgba8 => rgba.to_vec(),
        AtlasFormat::Bc7 => bc7::compress_blocks(&bc7::opaque_very_fast_settings(), &surface),
        AtlasFormat::Etc2 => etc1::compress_blocks(&etc1::slow_settings(), &surface),
    }
}

/// Means of 2 × 2 texels; both sides are even.
fn halve(level: &[u8], width: usize) -> Vec<u8> {
    let mut halved = Vec::with_capacity(level.len() / 4);
    for rows in level.chunks_exact(8 * width) {
        let (upper, lower) = rows.split_at(4 * width);
        for (above, below) in upper.chunks_exact(8).zip(lower.chunks_exact(8)) {
            halved.extend((0..4).map(|channel| {
                let sum = [above[channel], above[channel + 4], below[channel], below[channel + 4]];
                ((sum.into_iter().map(u32::from).sum::<u32>() + 2) / 4) as u8
            }));
        }
    }
    halved
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mips_are_means_and_sides_are_checked() {
        let rgb: Vec<u8> = (0..16 * 8).flat_map(|at| if at % 16 < 8 { [200, 0, 10] } else { [0, 100, 10] }).collect();
        let atlas = Atlas::new(16, 8, &rgb).unwrap();
        assert_eq!(atlas.mips().iter().map(Vec::len).collect::<Vec<_>>(), [512, 128, 32, 8]);
        assert_eq!(atlas.mips()[3], [200, 0, 10, 255, 0, 100, 10, 255], "no texel holds two parts");
        assert_eq!(atlas.byte_len(), 680);
        let sizes = |format| {
            let compressed = atlas.clone().compressed(format);
            assert_eq!((compressed.format(), compressed.size_px()), (format, [16, 8]));
            assert_eq!(compressed.clone().compressed(AtlasFormat::Etc2), compressed, "blocks stay as they are");
            compressed.mips().iter().map(Vec::len).collect::<Vec<_>>()
        };
        assert_eq!(sizes(AtlasFormat::Bc7), [128, 32, 16, 16]);
        assert_eq!(sizes(AtlasFormat::Etc2), [64, 16, 8, 8]);
        assert!(Atlas::new(8, 16, &rgb[3..]).is_none());
        for (width, height) in [(0, 8), (12, 8), (8, 2048), (1024, 1024), (u32::MAX, u32::MAX)] {
            assert!(!Atlas::is_size(width, height), "{width} × {height}");
        }
    }
}
