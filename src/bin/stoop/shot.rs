//! `stoop shot`: one settled picture.

use crate::cli;
use std::path::PathBuf;
use std::process::ExitCode;

const EXAMPLES: &str = "\
Heights are metres above the WGS84 ellipsoid. The picture is taken once nothing is left to load.

Examples:
  stoop shot WORLD --lon-deg -84.39 --lat-deg 33.75 --height-m 3000 --out above.png
  stoop shot WORLD --lon-deg -84.39 --lat-deg 33.74 --height-m 600 --pitch-deg -20 --size 1280x720 --out city.png";

#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// Folder of the world
    world: PathBuf,
    /// Longitude of the eye, degrees east
    #[arg(long, allow_hyphen_values = true, value_parser = cli::longitude)]
    lon_deg: f64,
    /// Latitude of the eye, degrees north
    #[arg(long, allow_hyphen_values = true, value_parser = cli::latitude)]
    lat_deg: f64,
    /// Height of the eye above the ellipsoid, metres
    #[arg(long, allow_hyphen_values = true, value_parser = cli::number)]
    height_m: f64,
    /// Clockwise from north, degrees
    #[arg(long, default_value = "0", allow_hyphen_values = true, value_parser = cli::number)]
    heading_deg: f64,
    /// Up from the horizon, degrees; -90 looks straight down
    #[arg(long, default_value = "-90", allow_hyphen_values = true, value_parser = cli::latitude)]
    pitch_deg: f64,
    /// Field of view from top to bottom, degrees
    #[arg(long, default_value = "60", value_parser = cli::field_of_view)]
    fovy_deg: f64,
    /// Pixels
    #[arg(long, default_value = "640x360")]
    size: cli::SizePx,
    /// Allowed screen-space error, pixels of the given size
    #[arg(long, default_value = "1", value_parser = cli::positive)]
    tolerance_px: f64,
    /// Also write ids and linear depth into this folder (formats: stoop fly --help)
    #[arg(long, value_name = "DIR")]
    aov: Option<PathBuf>,
    /// The picture
    #[arg(long, value_name = "FILE.png")]
    out: PathBuf,
}

pub fn run(_arguments: Arguments) -> anyhow::Result<ExitCode> {
    Err(cli::NotYet::new("`stoop shot`", "update stoop").into())
}
