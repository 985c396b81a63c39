//! What a recipe and its sources were: a world made of the same has the same hash.

use super::{PrepareError, Recipe, source};
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;
use xxhash_rust::xxh3::Xxh3;

/// Bytes at the beginning and at the end of a source file that count.
const PART_BYTES: u64 = 1 << 16;
/// What may lie in a folder that a recipe names.
const EXTENSIONS: &[&str] = &[
    "tif", "tiff", "hgt", "nc", "cdf", "png", "jpg", "jpeg", "geojson", "json", "geojsonl", "ndjson", "fgb", "pbf",
    "csv",
];

/// xxh3 of the recipe's text and, of each source file, its name, its length, its beginning and its end.
pub fn of(recipe: &Recipe, root: &Path) -> Result<u64, PrepareError> {
    let mut sum = Xxh3::new();
    sum.update(recipe.text.as_bytes());
    let files = recipe.elevation.iter().map(|section| &section.file);
    let files = files.chain(recipe.imagery.iter().map(|section| &section.file));
    let files = files.chain(recipe.buildings.iter().map(|section| &section.file));
    let files = files.chain(recipe.buildings.iter().filter_map(|section| section.copies.as_ref()));
    for file in files {
        let mut paths: Vec<_> = source::resolve(root, file, EXTENSIONS)?.into_iter().map(|found| found.path).collect();
        paths.dedup();
        for path in paths {
            sum.update(path.file_name().unwrap_or_default().as_encoded_bytes());
            add_file(&mut sum, &path).map_err(|source| PrepareError::read(&path, source))?;
        }
    }
    Ok(sum.digest())
}

fn add_file(sum: &mut Xxh3, path: &Path) -> std::io::Result<()> {
    let mut file = File::open(path)?;
    let len = file.metadata()?.len();
    sum.update(&len.to_le_bytes());
    if let Ok(since) = file.metadata()?.modified()?.duration_since(std::time::UNIX_EPOCH) {
        sum.update(&since.as_nanos().to_le_bytes());
    }
    let mut part = Vec::new();
    (&mut file).take(PART_BYTES).read_to_end(&mut part)?;
    file.seek(SeekFrom::Start(len.saturating_sub(PART_BYTES)))?;
    file.take(PART_BYTES).read_to_end(&mut part)?;
    sum.update(&part);
    Ok(())
}
