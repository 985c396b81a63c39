//! Byte sizes and numbers as people write them: `256MiB`, `1.5 GiB`, `4096`.

use std::fmt;
use std::str::FromStr;

/// A number of bytes; parses and prints binary multiples (KiB, MiB, GiB).
///
/// ```
/// # use stoop::units::ByteSize;
/// assert_eq!("256MiB".parse(), Ok(ByteSize(256 << 20)));
/// assert_eq!(ByteSize(1536).to_string(), "1.50 KiB");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Serialize, serde::Deserialize)]
#[serde(transparent)]
pub struct ByteSize(pub u64);

#[derive(Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0:?} is no size: write bytes, or a number with KiB, MiB or GiB, such as 256MiB")]
pub struct ByteSizeError(String);

const MULTIPLES: [(&str, u64); 3] = [("GiB", 1 << 30), ("MiB", 1 << 20), ("KiB", 1 << 10)];

impl FromStr for ByteSize {
    type Err = ByteSizeError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let bad = || ByteSizeError(text.to_owned());
        let trimmed = text.trim();
        let (digits, unit) = MULTIPLES
            .iter()
            .find_map(|(suffix, unit)| Some((trimmed.strip_suffix(suffix)?, *unit)))
            .unwrap_or((trimmed.strip_suffix('B').unwrap_or(trimmed), 1));
        let number: f64 = digits.trim().parse().map_err(|_| bad())?;
        let bytes = number * unit as f64;
        if !(0.0..=1e18).contains(&bytes) {
            return Err(bad());
        }
        Ok(Self(bytes.round() as u64))
    }
}

impl fmt::Display for ByteSize {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (suffix, unit) in MULTIPLES {
            if self.0 >= unit {
                return write!(f, "{:.2} {suffix}", self.0 as f64 / unit as f64);
            }
        }
        write!(f, "{} B", self.0)
    }
}

/// A finite number above 0; of arguments.
pub fn positive(text: &str) -> Result<f64, String> {
    number(text).and_then(|value| if value > 0.0 { Ok(value) } else { Err("must be above 0".into()) })
}

/// A finite number; of arguments.
pub fn number(text: &str) -> Result<f64, String> {
    match text.trim().parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        _ => Err("must be a number".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parses_what_people_write_and_refuses_the_rest() {
        for (text, bytes) in [("0", 0), ("17B", 17), ("1 KiB", 1024), ("1.5GiB", 3 << 29)] {
            assert_eq!(text.parse(), Ok(ByteSize(bytes)), "{text}");
        }
        for text in ["", "MiB", "-1", "1e30GiB", "12MB", "nan"] {
            assert!(text.parse::<ByteSize>().is_err(), "{text}");
        }
    }
}
