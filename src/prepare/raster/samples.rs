//! From a file's samples to heights: voids marked, held between limits, and refused where they cannot be heights.

use super::blocks::{Block, VOID_I16};
use crate::prepare::PrepareError;

/// What a recipe and a file say of a source's samples.
#[derive(Clone, Copy, Debug, Default)]
pub struct Conditions {
    /// Samples with this value have no data.
    pub nodata: Option<f64>,
    /// Heights are held between these, metres.
    pub clamp_m: Option<[f64; 2]>,
}

/// No place on Earth is higher or deeper, metres.
const PLAUSIBLE_M: f64 = 20_000.0;

/// A sample that can be no height: index in the block, and value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BadHeight {
    pub index: usize,
    pub value: f64,
}

/// The kinds of samples that files have.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SampleKind {
    pub name: &'static str,
    low: f64,
    high: f64,
    whole: bool,
}

impl SampleKind {
    pub const U8: Self = Self::whole("u8", 0.0, 255.0);
    pub const I8: Self = Self::whole("i8", -128.0, 127.0);
    pub const U16: Self = Self::whole("u16", 0.0, 65_535.0);
    pub const I16: Self = Self::whole("i16", -32_768.0, 32_767.0);
    pub const U32: Self = Self::whole("u32", 0.0, 4_294_967_295.0);
    pub const I32: Self = Self::whole("i32", -2_147_483_648.0, 2_147_483_647.0);
    pub const F32: Self = Self { name: "f32", low: -f32::MAX as f64, high: f32::MAX as f64, whole: false };
    pub const F64: Self = Self { name: "f64", low: f64::MIN, high: f64::MAX, whole: false };

    const fn whole(name: &'static str, low: f64, high: f64) -> Self {
        Self { name, low, high, whole: true }
    }

    /// Whether a sample can have this value.
    pub fn can_be(&self, value: f64) -> bool {
        if !value.is_finite() {
            return !self.whole;
        }
        value >= self.low && value <= self.high && !(self.whole && value.fract() != 0.0)
    }

    /// Refuses a recipe's nodata that no sample can have: it would never match.
    pub fn check_nodata(&self, nodata: Option<f64>, file: &str) -> Result<(), PrepareError> {
        match nodata.filter(|&value| !self.can_be(value)) {
            Some(value) => {
                let what = format!("nodata = {value} cannot occur in samples of {}", self.name);
                Err(PrepareError::value(
                    file,
                    "samples",
                    what,
                    "give the value that the file really has, or leave `nodata` out",
                ))
            }
            None => Ok(()),
        }
    }
}

/// Whole samples stay two bytes wide.
pub fn block_of_i16(mut samples: Vec<i16>, conditions: &Conditions) -> Result<Block, BadHeight> {
    if conditions.clamp_m.is_some_and(|limits| limits.iter().any(|v| v.fract() != 0.0)) {
        return block_of(samples.iter().map(|&h| if h == VOID_I16 { f64::NAN } else { f64::from(h) }), conditions);
    }
    let nodata = conditions.nodata.filter(|&v| SampleKind::I16.can_be(v)).map_or(VOID_I16, |v| v as i16);
    let limit = |v: f64| v.clamp(-PLAUSIBLE_M, PLAUSIBLE_M) as i16;
    let clamp = conditions.clamp_m.map(|[low, high]| (limit(low), limit(high)));
    for (index, sample) in samples.iter_mut().enumerate() {
        if *sample == nodata || *sample == VOID_I16 {
            *sample = VOID_I16;
            continue;
        }
        if f64::from(*sample).abs() > PLAUSIBLE_M {
            return Err(BadHeight { index, value: f64::from(*sample) });
        }
        if let Some((low, high)) = clamp {
            *sample = (*sample).clamp(low, high);
        }
    }
    Ok(Block::I16(samples))
}

/// Any other samples; NaN and infinite ones have no data.
pub fn block_of(samples: impl Iterator<Item = f64>, conditions: &Conditions) -> Result<Block, BadHeight> {
    let nodata = conditions.nodata.map(|v| v as f32);
    let mut heights = Vec::with_capacity(samples.size_hint().0);
    for (index, value) in samples.enumerate() {
        if !value.is_finite() || nodata == Some(value as f32) {
            heights.push(f32::NAN);
            continue;
        }
        if value.abs() > PLAUSIBLE_M {
            return Err(BadHeight { index, value });
        }
        let [low, high] = conditions.clamp_m.unwrap_or([-PLAUSIBLE_M, PLAUSIBLE_M]);
        heights.push(value.clamp(low, high) as f32);
    }
    Ok(Block::F32(heights))
}

impl BadHeight {
    /// The error for a sample at a row and a column of a file.
    pub fn into_error(self, file: &str, row: u32, col: u32) -> PrepareError {
        let what = format!("{} is no height on Earth in metres", self.value);
        let remedy = format!("if it marks posts without data, give `nodata = {}` in the recipe", self.value);
        PrepareError::value(file, format!("row {row}, column {col}"), what, remedy)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn voids_are_marked_and_heights_clamped() {
        let conditions = Conditions { nodata: Some(-9999.0), clamp_m: Some([0.0, 100.0]) };
        let block = block_of_i16(vec![-5, 7, 300, -9999, i16::MIN], &conditions).expect("sound");
        assert_eq!((0..5).map(|i| block.get(i)).collect::<Vec<_>>(), [Some(0.0), Some(7.0), Some(100.0), None, None]);
        let block = block_of([-5.0, 7.5, -9999.0, f64::NAN].into_iter(), &conditions).expect("sound");
        assert_eq!((0..4).map(|i| block.get(i)).collect::<Vec<_>>(), [Some(0.0), Some(7.5), None, None]);
    }

    #[test]
    fn what_can_be_no_height_is_refused() {
        let plain = Conditions::default();
        assert_eq!(block_of([1.0, 3.4e38].into_iter(), &plain).expect_err("huge").index, 1);
        assert_eq!(block_of_i16(vec![3, 32_767], &plain).expect_err("huge").value, 32_767.0);
        let error = BadHeight { index: 1, value: 32_767.0 }.into_error("a.tif", 0, 1).to_string();
        assert!(error.contains("a.tif, row 0, column 1") && error.contains("nodata = 32767"), "{error}");
    }

    #[test]
    fn a_nodata_that_cannot_occur_is_refused() {
        assert!(SampleKind::I16.check_nodata(Some(-99_999.0), "a.tif").is_err());
        assert!(SampleKind::U8.check_nodata(Some(0.5), "a.tif").is_err());
        assert!(SampleKind::F32.check_nodata(Some(-99_999.0), "a.tif").is_ok());
    }
}
