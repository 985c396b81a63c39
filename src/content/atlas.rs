//! Pictures on the faces of a page's details, side by side in one.

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

/// A decoded atlas: sRGB, rows from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct Atlas {
    width_px: u32,
    height_px: u32,
    /// RGBA8 of each level, finest first.
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
            Self { width_px, height_px, mips }
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

    /// RGBA8 of each level, finest first; level n has sides of `size_px >> n` texels.
    pub fn mips(&self) -> &[Vec<u8>] {
        &self.mips
    }

    pub fn byte_len(&self) -> usize {
        self.mips.iter().map(Vec::len).sum()
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
        assert!(Atlas::new(8, 16, &rgb[3..]).is_none());
        for (width, height) in [(0, 8), (12, 8), (8, 2048), (1024, 1024), (u32::MAX, u32::MAX)] {
            assert!(!Atlas::is_size(width, height), "{width} × {height}");
        }
    }
}
