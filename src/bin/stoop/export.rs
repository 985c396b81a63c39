//! `stoop export`.

use crate::cli;
use crate::place::for_each_objects_page;
use anyhow::Context;
use serde_json::json;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use stoop::content::{PageId, PageKind, Prism};
use stoop::store::{World, write_whole};

const EXAMPLES: &str = "\
GeoJSON: longitudes and latitudes in degrees; each feature has its attributes, and base_m and top_m above the WGS84
ellipsoid. GeoTIFF: heights above the ellipsoid as float32 metres in EPSG:4326 at the post spacing of level L, drawn
from the finest terrain at or above that level.

Examples:
  stoop export WORLD --collection helsinki --out helsinki.geojson
  stoop export WORLD --terrain --bounds -122.6,37.7,-122.3,37.9 --level 11 --out bay.tif";

#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// Folder or address (http://, https://, s3://) of the world
    world: PathBuf,
    #[command(flatten)]
    cache: cli::CacheArguments,
    /// Write this collection
    #[arg(long, value_name = "NAME", conflicts_with = "terrain", required_unless_present = "terrain")]
    collection: Option<String>,
    /// Which approximation of the objects; 0 is the finest
    #[arg(long, default_value = "0", conflicts_with = "terrain")]
    rep: u8,
    /// Write terrain
    #[arg(long, requires = "bounds", requires = "level")]
    terrain: bool,
    /// Degrees: west,south,east,north
    #[arg(long, value_name = "W,S,E,N", allow_hyphen_values = true, conflicts_with = "collection")]
    bounds: Option<cli::BoundsDeg>,
    /// Level of the forest, 0 to 22: posts are 45 / 64 / 2^L degrees apart
    #[arg(long, value_name = "L", conflicts_with = "collection", value_parser = clap::value_parser!(u8).range(0..=22))]
    level: Option<u8>,
    /// The file to write: .geojson or .tif
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
}

pub fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let world = cli::open_whole(std::slice::from_ref(&arguments.world), &arguments.cache)?;
    if let Some(name) = &arguments.collection {
        let count = write_collection(&world, name, arguments.rep, &arguments.out)?;
        cli::sayln!("{count} features written to {}", arguments.out.display());
    } else if let (Some(cli::BoundsDeg(bounds)), Some(level)) = (arguments.bounds, arguments.level) {
        let [width, height] = write_terrain(&world, bounds, level, &arguments.out)?;
        cli::sayln!("{width} × {height} posts written to {}", arguments.out.display());
    }
    Ok(ExitCode::SUCCESS)
}

#[cfg(feature = "prepare")]
use crate::export_terrain::write as write_terrain;

#[cfg(not(feature = "prepare"))]
fn write_terrain(_: &World, _: [f64; 4], _: u8, _: &Path) -> anyhow::Result<[u32; 2]> {
    Err(cli::NotYet::new("GeoTIFF without the feature `prepare`", "build stoop with it").into())
}

fn write_collection(world: &World, name: &str, rep: u8, out: &Path) -> anyhow::Result<u64> {
    let collections = &world.manifest().collections;
    let at = collections.iter().position(|info| info.name == name).with_context(|| {
        let names: Vec<_> = collections.iter().map(|info| info.name.as_str()).collect();
        format!(
            "the world has no collection {name:?}: it has {}",
            if names.is_empty() { "none".into() } else { names.join(", ") }
        )
    })?;
    let mut count = 0;
    write_whole(out, |file| -> anyhow::Result<()> {
        write!(file, "{{\"type\":\"FeatureCollection\",\"features\":[")?;
        for_each_objects_page(world, &|_| true, &mut |root, entry| {
            if usize::from(entry.collection) != at || entry.rep != rep {
                return Ok(());
            }
            let id = PageId { cell: root, kind: PageKind::Objects { collection: entry.collection, rep } };
            let bytes = world.read(id, entry.place)?;
            let attributes = world.attributes(id, entry.place, &bytes)?;
            // A collection without attributes has no list of them.
            let texts = attributes.iter().map(String::as_str).chain(std::iter::repeat("{}"));
            for (prism, text) in world.prisms(id, entry.place, &bytes)?.prisms.iter().zip(texts) {
                let separator = if count == 0 { "\n" } else { ",\n" };
                write!(file, "{separator}{}", feature(prism, text))?;
                count += 1;
            }
            Ok(())
        })?;
        anyhow::ensure!(count > 0 || rep == 0, "collection {name:?} has no rep {rep}: 0 is the finest");
        writeln!(file, "\n]}}")?;
        Ok(())
    })
    .with_context(|| format!("cannot write {}", out.display()))?;
    Ok(count)
}

fn feature(prism: &Prism, attributes: &str) -> serde_json::Value {
    let mut properties: serde_json::Map<_, _> = serde_json::from_str(attributes).unwrap_or_default();
    properties.insert("base_m".into(), json!(metres(prism.base_m)));
    properties.insert("top_m".into(), json!(metres(prism.top_m)));
    let degrees = |[lon, lat]: &[f64; 2]| json!([rounded(lon.to_degrees()), rounded(lat.to_degrees())]);
    let rings: Vec<Vec<_>> =
        prism.rings.iter().map(|ring| ring.iter().chain(ring.first()).map(degrees).collect()).collect();
    json!({
        "type": "Feature",
        "id": prism.id,
        "geometry": { "type": "Polygon", "coordinates": rings },
        "properties": properties,
    })
}

/// To a millimetre.
fn metres(value: f32) -> f64 {
    (f64::from(value) * 1e3).round() / 1e3
}

/// To 10⁻⁹ degrees, 0.1 mm.
fn rounded(degrees: f64) -> f64 {
    (degrees * 1e9).round() / 1e9
}
