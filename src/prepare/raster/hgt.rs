//! SRTM's .hgt tiles: one degree square, big-endian i16 metres, the name gives the south-west corner
//! (NASA SRTM, "SRTM Topography", §2.1.2). Posts on all four borders.

use super::blocks::{Block, BlockLayout, BlockReader};
use super::samples::{Conditions, SampleKind, block_of_i16};
use crate::prepare::PrepareError;
use crate::prepare::crs::Affine;
use crate::prepare::source::SourceFile;

/// One tile; a block is the whole of it.
#[derive(Debug)]
pub struct Hgt {
    file: SourceFile,
    conditions: Conditions,
    side: u32,
    pub affine: Affine,
}

/// Posts a side of 3″ and 1″ tiles.
const SIDES: [u32; 2] = [1201, 3601];

impl Hgt {
    pub fn open(file: &SourceFile, conditions: Conditions) -> Result<Self, PrepareError> {
        SampleKind::I16.check_nodata(conditions.nodata, &file.to_string())?;
        let (south, west) = corner_deg(&file.name()).ok_or_else(|| {
            PrepareError::value(file, "its name", "gives no south-west corner", "name it like N37W123.hgt")
        })?;
        let bytes = file.bytes()?;
        let side = SIDES.into_iter().find(|&s| u64::from(s * s) * 2 == bytes).ok_or_else(|| {
            let what =
                format!("{bytes} bytes are neither {} (3″) nor {} (1″)", side_bytes(SIDES[0]), side_bytes(SIDES[1]));
            PrepareError::damaged(file, "its length", what)
        })?;
        let step = 1.0 / f64::from(side - 1);
        let affine = Affine { a: step, b: 0.0, c: west, d: 0.0, e: -step, f: south + 1.0 };
        Ok(Self { file: file.clone(), conditions, side, affine })
    }
}

fn side_bytes(side: u32) -> u32 {
    side * side * 2
}

impl BlockReader for Hgt {
    fn layout(&self) -> BlockLayout {
        BlockLayout { rows: self.side, cols: self.side, block_rows: self.side, block_cols: self.side }
    }

    fn read(&self, _block: u32) -> Result<Block, PrepareError> {
        let bytes = self.file.read()?;
        if bytes.len() != side_bytes(self.side) as usize {
            return Err(PrepareError::damaged(&self.file, "its length", format!("{} bytes", bytes.len())));
        }
        let posts = bytes.chunks_exact(2).map(|pair| i16::from_be_bytes([pair[0], pair[1]])).collect();
        block_of_i16(posts, &self.conditions).map_err(|bad| {
            bad.into_error(&self.file.to_string(), bad.index as u32 / self.side, bad.index as u32 % self.side)
        })
    }
}

/// South and west in degrees of a name such as N37W123.hgt.
fn corner_deg(name: &str) -> Option<(f64, f64)> {
    let name = name.to_ascii_uppercase();
    let (signs, rest) = match name.as_bytes().first()? {
        b'N' => (1.0, &name[1..]),
        b'S' => (-1.0, &name[1..]),
        _ => return None,
    };
    let letter = rest.find(['E', 'W'])?;
    let south: f64 = rest[..letter].parse().ok()?;
    let digits: String = rest[letter + 1..].chars().take_while(char::is_ascii_digit).collect();
    let west: f64 = digits.parse().ok()?;
    let west = if rest.as_bytes()[letter] == b'W' { -west } else { west };
    (south <= 90.0 && west.abs() <= 180.0).then_some((signs * south, west))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_give_corners() {
        assert_eq!(corner_deg("N37W123.hgt"), Some((37.0, -123.0)));
        assert_eq!(corner_deg("s01e006.SRTMGL1.hgt"), Some((-1.0, 6.0)));
        assert_eq!(corner_deg("dem.hgt"), None);
        assert_eq!(corner_deg("N37.hgt"), None);
    }
}
