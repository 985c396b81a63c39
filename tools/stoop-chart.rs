//! The program `stoop-chart`: speed against accuracy, as a page.

#[cfg_attr(feature = "prepare", path = "chart/sources.rs")]
#[cfg_attr(not(feature = "prepare"), path = "chart/no_sources.rs")]
mod sources;
mod world;

use anyhow::Context;
use clap::Parser;
use indicatif::{ProgressBar, ProgressStyle};
use sources::Sources;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use stoop::camera::FlightPath;
use stoop::chart::{
    Figure, Flight, Flown, PAGE_FILE, PICTURES_MAX, RUNS_MAX, Report, Sweep, cost_by_distance, figure_of_rows, fly_all,
    fly_live, frame_time_figures, frame_times, height_errors, picture_errors, redundancy_by_delay,
};
use stoop::engine::{GroundProbe, Source};
use stoop::geodesy::Geodetic;
use stoop::paging::PolicyName;
use stoop::simulate::Library;
use stoop::storage::{Faults, StorageModel};
use stoop::units::{ByteSize, number, positive};
use world::WorldArguments;

const DETAILS: &str = "\
Flies WORLD by the virtual clock with all settings asked for, and writes into DIR:
  index.html     one self-contained page: charts, tables, and a recommendation at its end
  *.csv          the numbers of each chart; runs.csv has a line for each run
  data.json      the same as JSON
  profile.json   the recommended settings: stoop WORLD --profile DIR/profile.json
The same arguments give the same CSV to the byte, on every machine (timings.csv apart).

Of each list the first value is the base, which stands while others vary: policies by tolerances, by footprints and by
speeds over each storage model; frame sizes; and tolerances by footprints on the first storage model, which should be the
one at hand. Storage models: hdd, ssd, lan, wan, mobile, or LATENCY_MS,MB_PER_S,PARALLEL; see `stoop fly --help`.

Examples:
  stoop-chart WORLD --path dive.json --out charts
  stoop-chart WORLD --path dive.json --live --pictures 12 --out charts
  stoop-chart WORLD --path dive.json --against recipe.toml --out charts
  stoop-chart WORLD --path dive.json street.json --storage 'wan;20,50,4' --tolerance-px 1,0.5,2,4 --out charts";

/// Charts speed against accuracy: runs flights with many settings and writes a page about them.
#[derive(Parser)]
#[command(name = "stoop-chart", version, after_help = DETAILS)]
struct Arguments {
    #[command(flatten)]
    world: WorldArguments,
    /// Flights, JSON
    #[arg(long = "path", value_name = "FILE", required = true, num_args = 1..)]
    paths: Vec<PathBuf>,
    /// Policies, commas between them
    #[arg(long, value_delimiter = ',', default_values = PolicyName::ALL.map(PolicyName::name))]
    policy: Vec<PolicyName>,
    /// Storage models, semicolons between them
    #[arg(long, value_delimiter = ';', default_values = ["ssd", "lan", "wan"])]
    storage: Vec<StorageModel>,
    /// Allowed screen-space errors, pixels
    #[arg(long, value_name = "PX,...", value_delimiter = ',', value_parser = positive, default_values = ["1", "0.5", "2", "4"])]
    tolerance_px: Vec<f64>,
    /// Footprints
    #[arg(long, value_name = "SIZE,...", value_delimiter = ',', default_values = ["256MiB", "32MiB", "48MiB", "96MiB"])]
    footprint: Vec<ByteSize>,
    /// How many times as fast as its file says a flight is flown
    #[arg(long, value_name = "TIMES,...", value_delimiter = ',', value_parser = positive, default_values = ["1", "3", "10"])]
    speed: Vec<f64>,
    /// Frame sizes, pixels
    #[arg(long, value_name = "WxH,...", value_delimiter = ',', value_parser = size_px, default_values = ["640x360", "1280x720"])]
    size: Vec<[u32; 2]>,
    /// Seconds from frame to frame
    #[arg(long, value_name = "S", default_value_t = 1.0 / 30.0, value_parser = positive)]
    step_secs: f64,
    /// Make reads go wrong; see `stoop fly --help`
    #[arg(long, value_name = "KEY=VALUE,...")]
    faults: Option<Faults>,
    /// Seed of --faults
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Also compare so many pictures of each flight and tolerance with the settled ones, by FLIP and RMS; needs a GPU, or
    /// a driver that draws by the processor
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=i64::from(PICTURES_MAX)))]
    pictures: Option<u32>,
    /// Also fly live on this machine over the first storage model, so many times as fast as the flights' files say: each
    /// tolerance, each policy, and one that waits
    #[arg(long, value_name = "TIMES", num_args = 0..=1, default_missing_value = "1", value_parser = positive)]
    live: Option<f64>,
    /// Where frame cost against distance is counted, degrees [default: the middle of the largest set of objects]
    #[arg(long, value_name = "LON,LAT", value_parser = place)]
    over: Option<(f64, f64)>,
    /// Also measure how far the drawn ground is off the sources of this recipe, that the world was prepared from
    #[arg(long, value_name = "RECIPE.toml")]
    against: Option<PathBuf>,
    /// What relative paths in the recipe are relative to; its own folder by default
    #[arg(long, value_name = "DIR", requires = "against")]
    root: Option<PathBuf>,
    /// Also draw rows of these CSV files: x, y, and the name of the curve where there are several
    #[arg(long, value_name = "FILE.csv", num_args = 1..)]
    rows: Vec<PathBuf>,
    /// Also draw what this single-seek layout of the world was chosen by: redundancy against delay
    #[arg(long, value_name = "NAME")]
    layout: Option<String>,
    /// Folder to write to
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

fn size_px(text: &str) -> Result<[u32; 2], String> {
    let side = |digits: &str| digits.parse::<u32>().ok().filter(|side| (1..=8192).contains(side));
    let sides = text.split_once('x').and_then(|(width, height)| Some([side(width)?, side(height)?]));
    sides.ok_or_else(|| format!("{text:?} is no size in pixels: write WIDTHxHEIGHT, each 1 to 8192, such as 640x360"))
}

/// Longitude and latitude, degrees.
fn place(text: &str) -> Result<(f64, f64), String> {
    let (lon, lat) = text.split_once(',').ok_or_else(|| format!("{text:?} is no place: write LON,LAT in degrees"))?;
    match (number(lon)?, number(lat)?) {
        (lon, lat) if lon.abs() <= 180.0 && lat.abs() <= 90.0 => Ok((lon, lat)),
        _ => Err("longitudes are from -180 to 180, latitudes from -90 to 90".into()),
    }
}

fn main() -> ExitCode {
    let arguments = match Arguments::try_parse() {
        Ok(arguments) => arguments,
        Err(error) if error.use_stderr() => return refuse(&error),
        Err(help) => return if help.print().is_ok() { ExitCode::SUCCESS } else { ExitCode::FAILURE },
    };
    match run(arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("stoop-chart: {error:#}");
            ExitCode::FAILURE
        }
    }
}

/// Wrong usage in one line.
fn refuse(error: &clap::Error) -> ExitCode {
    let text = error.to_string();
    // Clap adds usage and hints in paragraphs of their own.
    let said = text.split("\n\nUsage:").next().and_then(|said| said.split("\n\nFor more").next()).unwrap_or(&text);
    let said: Vec<&str> = said.trim_start_matches("error: ").split_whitespace().collect();
    eprintln!("stoop-chart: {}; see --help", said.join(" "));
    ExitCode::from(2)
}

fn run(arguments: Arguments) -> anyhow::Result<()> {
    let source = open(&arguments)?;
    let sweep = sweep(&arguments, &source)?;
    let against = arguments.against.as_ref();
    let sources = against.map(|recipe| Sources::open(recipe, arguments.root.as_deref())).transpose()?;
    let runs = sweep.runs();
    anyhow::ensure!(runs.len() <= RUNS_MAX, "{} runs are more than {RUNS_MAX}: name fewer values", runs.len());
    let library = Library::new(source.index.clone(), source.reader.clone());
    let bar = progress(runs.len() as u64)?;
    let flown = fly_all(&library, &sweep, &runs, &|| bar.inc(1))?;
    bar.finish_and_clear();
    let (mut further, mut times) = (Vec::new(), Vec::new());
    if let Some(place) = city(&arguments, &source) {
        let (size_px, tolerance_px) = (sweep.sizes_px[0], sweep.tolerances_px[0]);
        further.push(cost_by_distance(&library, place, size_px, tolerance_px)?);
    }
    if let Some(sources) = &sources {
        further.push(heights(sources, &library, &sweep, &flown)?);
    }
    if let Some(count) = arguments.pictures {
        eprintln!("comparing pictures");
        further.push(picture_errors(&library, &source, &sweep, count)?);
    }
    if let Some(speed) = arguments.live {
        let live = fly_live(&source, &sweep, speed, &|flight| eprintln!("live: {flight}"))?;
        times = frame_times(&sweep, &live);
        further.extend(frame_time_figures(&sweep, &live));
    }
    if let (Some(name), Some(layout)) = (&arguments.layout, &source.layout) {
        further.extend(redundancy_by_delay(name, layout));
    }
    for file in &arguments.rows {
        further.push(figure_of_rows(file)?);
    }
    let (world, command) = (source.manifest.name.clone(), command());
    let report =
        Report { world: &world, command: &command, sweep: &sweep, flown: &flown, further, frame_times: &times };
    let profile = report.write(&arguments.out)?;
    println!("{}", arguments.out.join(PAGE_FILE).display());
    if let (Some(tolerance_px), Some(footprint)) = (profile.tolerance_px, profile.footprint()) {
        println!("on {}: {tolerance_px} px, {footprint}: {}", profile.storage, profile.why);
    }
    Ok(())
}

/// How far the drawn ground is off the sources.
fn heights(sources: &Sources, library: &Library, sweep: &Sweep, flown: &[Flown]) -> anyhow::Result<Figure> {
    eprintln!("comparing heights");
    let figure = height_errors(library, sweep, flown, sources)?;
    sources.check()?;
    Ok(figure)
}

/// On the ground: where it was asked for, else the middle of the largest set of objects; `None` in a world without any.
fn city(arguments: &Arguments, source: &Source) -> Option<Geodetic> {
    let middle = || {
        let largest =
            source.manifest.collections.iter().max_by_key(|info| info.objects).filter(|info| info.objects > 0)?;
        let [west, south, east, north] = largest.bounds_deg;
        Some(((west + east) / 2.0, (south + north) / 2.0))
    };
    let (lon_deg, lat_deg) = arguments.over.or_else(middle)?;
    let ground = Geodetic::from_degrees(lat_deg, lon_deg, 0.0);
    Some(ground.at_height(GroundProbe::new(source).height_m(ground.lat_rad, ground.lon_rad)))
}

fn open(arguments: &Arguments) -> anyhow::Result<Source> {
    let world = arguments.world.open("stoop-chart")?;
    let Some(name) = &arguments.layout else { return Ok(Source::of(world)) };
    let (source, refused) = Source::with_layout(world, name);
    refused.map_or(Ok(source), |refused| Err(anyhow::anyhow!(refused)))
}

fn sweep(arguments: &Arguments, source: &Source) -> anyhow::Result<Sweep> {
    let ground = GroundProbe::new(source);
    let flight = |file: &PathBuf| load_flight(file, &ground);
    Ok(Sweep {
        flights: arguments.paths.iter().map(flight).collect::<anyhow::Result<_>>()?,
        policies: arguments.policy.clone(),
        storages: arguments.storage.clone(),
        tolerances_px: arguments.tolerance_px.clone(),
        footprints: arguments.footprint.clone(),
        speeds: arguments.speed.clone(),
        sizes_px: arguments.size.clone(),
        step_s: arguments.step_secs,
        seed: arguments.seed,
        faults: arguments.faults.unwrap_or_default(),
    })
}

fn load_flight(file: &Path, ground: &GroundProbe<'_>) -> anyhow::Result<Flight> {
    let path = FlightPath::load(file)?;
    let arrivals_s = path.arrivals_s(|lat_rad, lon_rad| ground.height_m(lat_rad, lon_rad));
    let name = file.file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into_owned());
    Ok(Flight { name, path: Arc::new(path), arrivals_s })
}

fn progress(runs: u64) -> anyhow::Result<ProgressBar> {
    let style =
        ProgressStyle::with_template("{pos} of {len} flights {wide_bar} {eta} left").context("the progress bar")?;
    Ok(ProgressBar::new(runs).with_style(style))
}

/// What was typed, less the folder that is written to.
fn command() -> String {
    let mut words = vec!["stoop-chart".to_owned()];
    let mut typed = std::env::args().skip(1);
    while let Some(word) = typed.next() {
        if word == "--out" {
            typed.next();
        } else if !word.starts_with("--out=") {
            let is_plain = word.chars().all(|c| c.is_alphanumeric() || "-_./:=,".contains(c));
            words.push(if is_plain { word } else { format!("'{word}'") });
        }
    }
    words.join(" ")
}
