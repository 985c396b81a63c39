//! A profile: the settings that suit a machine and a storage, as `stoop-chart` recommends them and `stoop` takes them.

use crate::units::ByteSize;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// A larger file is no profile, bytes.
const FILE_BYTES_MAX: u64 = 1 << 20;

/// Settings, and where they come from. Keys that are missing leave a setting as it would be without the profile.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Profile {
    /// Allowed screen-space error, px; above 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tolerance_px: Option<f64>,
    /// Hard limit of all bytes held; above 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub footprint_bytes: Option<u64>,
    /// Frame time to hold in a window and live, ms; above 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frame_ms: Option<f64>,
    /// What they were chosen for, and how; for people.
    #[serde(default)]
    pub world: String,
    #[serde(default)]
    pub storage: String,
    #[serde(default)]
    pub why: String,
    #[serde(default)]
    pub command: String,
}

#[derive(Debug, thiserror::Error)]
pub enum ProfileError {
    #[error("cannot read the profile {}: {source}", file.display())]
    Read { file: PathBuf, source: std::io::Error },
    #[error("{}: no profile: {source}; stoop-chart writes one as DIR/profile.json", file.display())]
    Json { file: PathBuf, source: serde_json::Error },
    #[error("{}: no profile: it is larger than {}", file.display(), ByteSize(FILE_BYTES_MAX))]
    TooLarge { file: PathBuf },
    #[error("{}: {key} is {value}, but should be above 0", file.display())]
    Setting { file: PathBuf, key: &'static str, value: f64 },
}

impl Profile {
    pub fn load(file: &Path) -> Result<Self, ProfileError> {
        let fail = |source| ProfileError::Read { file: file.to_owned(), source };
        if std::fs::metadata(file).map_err(fail)?.len() > FILE_BYTES_MAX {
            return Err(ProfileError::TooLarge { file: file.to_owned() });
        }
        Self::parse(&std::fs::read_to_string(file).map_err(fail)?, file)
    }

    /// `file` is for messages only.
    pub fn parse(text: &str, file: &Path) -> Result<Self, ProfileError> {
        let profile: Self =
            serde_json::from_str(text).map_err(|source| ProfileError::Json { file: file.to_owned(), source })?;
        let settings = [
            ("tolerance_px", profile.tolerance_px),
            ("footprint_bytes", profile.footprint_bytes.map(|bytes| bytes as f64)),
            ("frame_ms", profile.frame_ms),
        ];
        for (key, value) in settings {
            if let Some(value) = value.filter(|value| !(value.is_finite() && *value > 0.0)) {
                return Err(ProfileError::Setting { file: file.to_owned(), key, value });
            }
        }
        Ok(profile)
    }

    pub fn footprint(&self) -> Option<ByteSize> {
        self.footprint_bytes.map(ByteSize)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_profile_comes_back_and_broken_ones_are_named() {
        let parse = |text: &str| Profile::parse(text, Path::new("p.json"));
        let profile = Profile { tolerance_px: Some(1.5), footprint_bytes: Some(1 << 25), ..Profile::default() };
        assert_eq!(parse(&serde_json::to_string(&profile).unwrap()).unwrap(), profile);
        assert_eq!(parse("{}").unwrap(), Profile::default());
        let broken = [
            ("{", "no profile"),
            (r#"{"tolerance_px": 0}"#, "tolerance_px is 0"),
            (r#"{"footprint_bytes": 0}"#, "footprint_bytes is 0"),
            (r#"{"frame_ms": -3}"#, "frame_ms is -3"),
            (r#"{"tolerance": 1}"#, "tolerance"),
        ];
        for (text, said) in broken {
            let message = parse(text).unwrap_err().to_string();
            assert!(message.contains("p.json") && message.contains(said), "{message}");
        }
    }
}
