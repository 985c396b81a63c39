//! What can be wrong with what people bring: one clear error that names the file, the place in it, and what to do.

use std::path::Path;

/// Bad input to the preparation of a world.
#[derive(Debug, thiserror::Error)]
pub enum PrepareError {
    #[error("{file}, line {line}: {what}")]
    Recipe { file: String, line: usize, what: String },
    #[error("{file}: not found; `file = {asked:?}` is taken relative to the recipe (or to --root)")]
    Missing { file: String, asked: String },
    #[error("{file}: cannot be read: {source}; check that it exists and that you may read it")]
    Read { file: String, source: std::io::Error },
    #[error("{file}: cannot be written: {source}; check the folder, your rights and the free space")]
    Write { file: String, source: std::io::Error },
    /// The bytes are not what the format promises: truncated, damaged, or another format.
    #[error("{file}, {place}: damaged or truncated: {what}; fetch the file again or repair it")]
    Damaged { file: String, place: String, what: String },
    #[error("{file}: has no georeference; {remedy}")]
    NoGeoreference { file: String, remedy: &'static str },
    #[error("{file}: coordinate system {crs:?} is not known: {what}; give `crs = \"EPSG:…\"` in the recipe")]
    UnknownCrs { file: String, crs: String, what: String },
    /// Sound, but of a kind that is not read.
    #[error("{file}, {place}: {what} is not supported; {remedy}")]
    Unsupported { file: String, place: String, what: String, remedy: String },
    /// Readable, but its values make no sense.
    #[error("{file}, {place}: {what}; {remedy}")]
    Value { file: String, place: String, what: String, remedy: String },
}

impl PrepareError {
    pub fn read(path: &Path, source: std::io::Error) -> Self {
        Self::Read { file: path.display().to_string(), source }
    }

    pub fn damaged(file: impl ToString, place: impl ToString, what: impl ToString) -> Self {
        Self::Damaged { file: file.to_string(), place: place.to_string(), what: what.to_string() }
    }

    pub fn unsupported(file: impl ToString, place: impl ToString, what: impl ToString, remedy: &str) -> Self {
        Self::Unsupported {
            file: file.to_string(),
            place: place.to_string(),
            what: what.to_string(),
            remedy: remedy.to_owned(),
        }
    }

    pub fn value(file: impl ToString, place: impl ToString, what: impl ToString, remedy: impl ToString) -> Self {
        Self::Value {
            file: file.to_string(),
            place: place.to_string(),
            what: what.to_string(),
            remedy: remedy.to_string(),
        }
    }
}
