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
    "tif", "tiff", "hgt", "nc", "cdf", "png", "jpg", "jpeg", "geojson", "json", "geojsonl", "geojsons", "ndjson",
    "jsonl", "fgb", "shp", "gpkg", "pbf", "csv", "gltf", "glb",
];
/// What is read beside a shapefile, and beside a GeoPackage whose newest rows are not in it yet.
const PARTS: &[&str] = &["dbf", "prj", "cpg", "gpkg-wal"];

/// Counts up when stages of the same sources come out otherwise, so that a newer program does not take over old ones.
const STAGES_VERSION: u32 = 3;

/// What a recipe and its sources were.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fingerprint {
    /// xxh3 of the recipe's text and, of each source file, its name, its length, its beginning and its end; what the
    /// manifest keeps: the same on every machine.
    pub world: u64,
    /// Of that, the files' times of change and the program's version of stages: what kept stages are good for.
    pub stages: u64,
}

pub fn of(recipe: &Recipe, root: &Path) -> Result<Fingerprint, PrepareError> {
    let (mut world, mut times) = (Xxh3::new(), Xxh3::new());
    world.update(recipe.text.as_bytes());
    times.update(&STAGES_VERSION.to_le_bytes());
    let files = recipe.elevation.iter().map(|section| &section.file);
    let files = files.chain(recipe.imagery.iter().map(|section| &section.file));
    let files = files.chain(recipe.buildings.iter().map(|section| &section.file));
    let files = files.chain(recipe.buildings.iter().filter_map(|section| section.copies.as_ref()));
    let files = files.chain(recipe.buildings.iter().filter_map(|section| Some(&section.model.as_ref()?.file)));
    for file in files {
        let mut paths = Vec::new();
        for found in source::resolve(root, file, EXTENSIONS)? {
            // What lies in a .zip counts with it.
            if found.inside.is_none() && found.has_extension(&["shp", "gpkg"]) {
                let parts = found.siblings()?.into_iter().filter(|part| part.has_extension(PARTS));
                paths.extend(parts.map(|part| part.path));
            }
            paths.push(found.path);
        }
        paths.dedup();
        for path in paths {
            world.update(path.file_name().unwrap_or_default().as_encoded_bytes());
            add_file(&mut world, &mut times, &path).map_err(|source| PrepareError::read(&path, source))?;
        }
    }
    times.update(&world.digest().to_le_bytes());
    Ok(Fingerprint { world: world.digest(), stages: times.digest() })
}

fn add_file(world: &mut Xxh3, times: &mut Xxh3, path: &Path) -> std::io::Result<()> {
    let mut file = File::open(path)?;
    let known = file.metadata()?;
    world.update(&known.len().to_le_bytes());
    if let Ok(since) = known.modified()?.duration_since(std::time::UNIX_EPOCH) {
        times.update(&since.as_nanos().to_le_bytes());
    }
    let mut part = Vec::new();
    (&mut file).take(PART_BYTES).read_to_end(&mut part)?;
    file.seek(SeekFrom::Start(known.len().saturating_sub(PART_BYTES)))?;
    file.take(PART_BYTES).read_to_end(&mut part)?;
    world.update(&part);
    Ok(())
}
