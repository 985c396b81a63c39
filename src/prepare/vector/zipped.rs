//! Files plain and inside archives.

use super::VectorError;
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;
use zip::ZipArchive;

const READ_BUFFER_BYTES: usize = 256 << 10;

pub fn plain(file: &Path) -> Result<BufReader<File>, VectorError> {
    let opened = File::open(file).map_err(|source| VectorError::Io { file: file.to_owned(), source })?;
    Ok(BufReader::with_capacity(READ_BUFFER_BYTES, opened))
}

fn archive(file: &Path) -> Result<ZipArchive<BufReader<File>>, VectorError> {
    ZipArchive::new(plain(file)?).map_err(|error| broken(file, &error))
}

fn broken(file: &Path, error: &zip::result::ZipError) -> VectorError {
    VectorError::Malformed { file: file.to_owned(), what: format!("not a whole zip archive: {error}; get it again") }
}

/// Names of an archive's files, in order.
pub fn members(file: &Path) -> Result<Vec<String>, VectorError> {
    Ok(archive(file)?.file_names().map(str::to_owned).collect())
}

/// Streams one file of an archive.
pub fn with_member<T>(file: &Path, name: &str, read: impl FnOnce(&mut dyn Read) -> T) -> Result<T, VectorError> {
    let mut archive = archive(file)?;
    let member = archive.by_name(name).map_err(|error| broken(file, &error))?;
    Ok(read(&mut BufReader::with_capacity(READ_BUFFER_BYTES, member)))
}
