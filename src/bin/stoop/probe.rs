//! `stoop probe`.

use crate::cli;
use crate::place::{Standing, finest_imagery, ground, objects_at};
use anyhow::Context;
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use stoop::geodesy::{Geodetic, VerticalDatum};
use stoop::store::World;

const EXAMPLES: &str = "\
Heights are metres above the WGS84 ellipsoid, and above the EGM96 geoid. error_m bounds the distance of the finest
surface from the truth; texel_m is the ground size of a texel along the meridian.
FILE.csv has a header that names the columns lon_deg and lat_deg; others are ignored.

Examples:
  stoop probe tiles/default/world --lon-deg 24.9525 --lat-deg 60.1695
  stoop probe WORLD --points places.csv --json";

#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// Folders or addresses (http://, https://, s3://) of worlds; several lie over one another, the first one uppermost
    #[arg(value_name = "WORLD", required = true)]
    worlds: Vec<PathBuf>,
    #[command(flatten)]
    cache: cli::CacheArguments,
    /// Longitude, degrees east
    #[arg(long, allow_hyphen_values = true, value_parser = cli::longitude, requires = "lat_deg")]
    lon_deg: Option<f64>,
    /// Latitude, degrees north
    #[arg(long, allow_hyphen_values = true, value_parser = cli::latitude, requires = "lon_deg")]
    lat_deg: Option<f64>,
    /// Many places
    #[arg(long, value_name = "FILE.csv", conflicts_with = "lon_deg")]
    points: Option<PathBuf>,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

/// What stands at a place.
#[derive(Serialize)]
struct Probed {
    lon_deg: f64,
    lat_deg: f64,
    /// Above the ellipsoid; null where the world has no terrain.
    ground_m: Option<f64>,
    ground_above_geoid_m: Option<f64>,
    terrain_cell: Option<String>,
    error_m: Option<f32>,
    imagery_cell: Option<String>,
    texel_m: Option<f64>,
    objects: Vec<Standing>,
}

pub fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let places = match (&arguments.points, arguments.lon_deg, arguments.lat_deg) {
        (Some(file), _, _) => read_points(file)?,
        (None, Some(lon_deg), Some(lat_deg)) => vec![[lon_deg, lat_deg]],
        _ => return Err(cli::WrongUsage("name a place: --lon-deg X --lat-deg Y, or --points FILE.csv".into()).into()),
    };
    let world = cli::open_whole(&arguments.worlds, &arguments.cache)?;
    let probed = places.iter().map(|&place| probe(&world, place)).collect::<anyhow::Result<Vec<_>>>()?;
    if arguments.json {
        cli::sayln!("{}", serde_json::to_string_pretty(&probed)?);
    } else {
        probed.iter().for_each(print);
    }
    Ok(ExitCode::SUCCESS)
}

fn probe(world: &World, [lon_deg, lat_deg]: [f64; 2]) -> anyhow::Result<Probed> {
    let place = Geodetic::from_degrees(lat_deg, lon_deg, 0.0);
    let ground = ground(world, place)?;
    let undulation_m = VerticalDatum::Egm96.undulation_m(place.lat_rad, place.lon_rad);
    let imagery = finest_imagery(world, place);
    Ok(Probed {
        lon_deg,
        lat_deg,
        ground_m: ground.as_ref().map(|ground| ground.height_m),
        ground_above_geoid_m: ground.as_ref().map(|ground| ground.height_m - undulation_m),
        terrain_cell: ground.as_ref().map(|ground| ground.cell.to_string()),
        error_m: ground.as_ref().map(|ground| ground.error_m),
        imagery_cell: imagery.map(|(cell, _)| cell.to_string()),
        texel_m: imagery.map(|(_, texel_m)| texel_m),
        objects: objects_at(world, place)?,
    })
}

fn read_points(file: &Path) -> anyhow::Result<Vec<[f64; 2]>> {
    let text = std::fs::read_to_string(file).with_context(|| format!("cannot read {}", file.display()))?;
    let mut lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    let (_, header) = lines.next().with_context(|| format!("{} is empty: it needs a header", file.display()))?;
    let column = |name: &str| {
        header.split(',').position(|cell| cell.trim() == name).with_context(|| {
            format!("{}, line 1: no column {name}: name the columns lon_deg and lat_deg", file.display())
        })
    };
    let (lon, lat) = (column("lon_deg")?, column("lat_deg")?);
    lines
        .map(|(at, line)| {
            let cells: Vec<_> = line.split(',').collect();
            let value = |column: usize, parse: fn(&str) -> Result<f64, String>| {
                let cell = cells.get(column).copied().unwrap_or_default();
                parse(cell).map_err(|why| anyhow::anyhow!("{}, line {}: {cell:?} {why}", file.display(), at + 1))
            };
            Ok([value(lon, cli::longitude)?, value(lat, cli::latitude)?])
        })
        .collect()
}

fn print(probed: &Probed) {
    cli::sayln!("{:.6} {:.6}", probed.lon_deg, probed.lat_deg);
    match (probed.ground_m, probed.ground_above_geoid_m, &probed.terrain_cell, probed.error_m) {
        (Some(ellipsoid_m), Some(geoid_m), Some(cell), Some(error_m)) => {
            cli::sayln!("  ground {ellipsoid_m:.2} m above the ellipsoid, {geoid_m:.2} m above the geoid (EGM96)");
            cli::sayln!("  terrain cell {cell}, error at most {error_m:.3} m");
        }
        _ => cli::sayln!("  no terrain here"),
    }
    if let (Some(cell), Some(texel_m)) = (&probed.imagery_cell, probed.texel_m) {
        cli::sayln!("  imagery cell {cell}, texel {texel_m:.2} m");
    }
    for object in &probed.objects {
        cli::sayln!(
            "  {} {}: {:.2} to {:.2} m, in cell {}",
            object.collection,
            object.id,
            object.base_m,
            object.top_m,
            object.cell
        );
        for (name, value) in object.attributes.as_object().into_iter().flatten() {
            cli::sayln!("    {name} = {value}");
        }
    }
}
