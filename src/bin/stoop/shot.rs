//! `stoop shot`: one settled picture.

use crate::cli;
use crate::fly::write_aov;
use std::path::PathBuf;
use std::process::ExitCode;
use stoop::camera::{Pose, View};
use stoop::engine::{Engine, EngineParams, FrameRequest, Mode};
use stoop::geodesy::Geodetic;
use stoop::record::write_png;
use stoop::units::ByteSize;

const EXAMPLES: &str = "\
Heights are metres above the WGS84 ellipsoid. The picture is taken once nothing is left to load.

Examples:
  stoop shot WORLD --lon-deg -84.39 --lat-deg 33.75 --height-m 3000 --out above.png
  stoop shot WORLD --lon-deg -84.39 --lat-deg 33.74 --height-m 600 --pitch-deg -20 --size 1280x720 --out city.png";

#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// Folders or addresses (http://, https://, s3://) of worlds; several lie over one another, the first one uppermost
    #[arg(value_name = "WORLD", required = true)]
    worlds: Vec<PathBuf>,
    #[command(flatten)]
    cache: cli::CacheArguments,
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

impl Arguments {
    fn view(&self) -> View {
        let pose = Pose {
            eye: Geodetic::from_degrees(self.lat_deg, wrap_degrees(self.lon_deg), self.height_m),
            heading_rad: self.heading_deg.to_radians(),
            pitch_rad: self.pitch_deg.to_radians(),
        };
        View::new(pose, self.fovy_deg.to_radians(), self.size.0)
    }
}

pub fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    if let Some(folder) = &arguments.aov {
        cli::make_folder(folder)?;
    }
    let source = cli::open(&arguments.worlds, &arguments.cache)?;
    let params = EngineParams { tolerance_px: arguments.tolerance_px, mode: Mode::Settled, ..EngineParams::default() };
    let mut engine = Engine::new(source, params)?;
    let report = engine.frame(&FrameRequest { view: arguments.view(), t_s: 0.0, ids: arguments.aov.is_some() })?;
    write_png(&arguments.out, arguments.size.0, &engine.picture().read_color()?)?;
    if let Some(folder) = &arguments.aov {
        let name = arguments.out.file_stem().unwrap_or_default().to_string_lossy();
        write_aov(engine.picture(), folder, &name, arguments.size.0)?;
    }
    cli::say(&format!(
        "{}: {} cells, {} objects, {} triangles, drawn error {:.2} px, read {}\n",
        arguments.out.display(),
        report.cells_drawn,
        report.objects_drawn,
        report.triangles,
        report.raw_error_px,
        ByteSize(report.bytes_read)
    ));
    Ok(ExitCode::SUCCESS)
}

/// The same meridian from −180 to 180 degrees.
fn wrap_degrees(lon_deg: f64) -> f64 {
    (lon_deg + 180.0).rem_euclid(360.0) - 180.0
}
