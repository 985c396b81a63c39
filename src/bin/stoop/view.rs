//! `stoop WORLD`: the viewer in a window.

use crate::cli;
use anyhow::Context;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::time::{Duration, Instant};
use stoop::camera::FlightPath;
use stoop::chart::Profile;
use stoop::engine::{EngineParams, Source};
use stoop::paging::{Gate, SlowReader, Stall};
use stoop::store::{World, bookmarks};
use stoop::units::ByteSize;
use stoop::window::{self, Bookmark, WindowOptions};

/// Where the default world lies, from this folder or one above the program or the current folder.
const DEFAULT_WORLDS: [&str; 2] = ["tiles/default/world", "share/stoop/default"];

#[derive(clap::Args)]
#[group(skip)]
pub struct Arguments {
    /// Folders or addresses (http://, https://, s3://) of worlds to open in a window, over one another, the first one
    /// uppermost; the default world when none is named
    #[arg(value_name = "WORLD")]
    worlds: Vec<PathBuf>,
    #[command(flatten)]
    cache: cli::CacheArguments,
    /// Size of the window, logical pixels [default: as it was last]
    #[arg(long)]
    size: Option<cli::SizePx>,
    /// Take tolerance, footprint and frame time from a profile as stoop-chart writes it; flags win
    #[arg(long, value_name = "FILE.json")]
    profile: Option<PathBuf>,
    /// Allowed screen-space error, pixels, 0.25 to 16 [default: the profile's, else as it was last, at first 1]
    #[arg(long, value_parser = tolerance_px)]
    tolerance_px: Option<f64>,
    /// Hard limit of the bytes held for pages, GPU arenas, decoding and index [default: the profile's, else as it was last,
    /// at first 256MiB]
    #[arg(long, value_parser = cli::bytes)]
    footprint: Option<ByteSize>,
    /// Frame time to hold by drawing coarser, milliseconds, or off [default: as it was last, at first 33]
    #[arg(long, value_name = "MS|off", value_parser = frame_ms)]
    frame_ms: Option<FrameMs>,
    /// Show this flight first, JSON (one dropped on the window is shown too); any movement by hand ends it, L and Esc too
    #[arg(long, value_name = "FILE")]
    path: Option<PathBuf>,
    /// When the window is closed, write a report of the session here, and frames.csv and timings.csv beside it
    #[arg(long, value_name = "FILE.json")]
    report: Option<PathBuf>,
    /// Make all reads hang from AT seconds on, FOR seconds long: shows what a bad network does
    #[arg(long, value_name = "AT,FOR")]
    stall_secs: Option<Stall>,
}

fn tolerance_px(text: &str) -> Result<f64, String> {
    let [low, high] = window::TOLERANCE_PX;
    let fits = cli::positive(text).ok().filter(|px| (low..=high).contains(px));
    fits.ok_or_else(|| format!("must be a number from {low} to {high}"))
}

/// The controls of the window, a line each.
pub fn controls() -> String {
    let widest = window::CONTROLS.iter().map(|(keys, _)| keys.chars().count()).max().unwrap_or(0);
    window::CONTROLS.iter().map(|(keys, does)| format!("  {keys:widest$}  {does}\n")).collect()
}

/// A frame time, or none.
#[derive(Clone, Copy, Debug)]
struct FrameMs(Option<f64>);

fn frame_ms(text: &str) -> Result<FrameMs, String> {
    if text == "off" {
        return Ok(FrameMs(None));
    }
    let [low, high] = window::FRAME_MS;
    cli::positive(text)
        .ok()
        .filter(|ms| (low..=high).contains(ms))
        .map(|ms| FrameMs(Some(ms)))
        .ok_or_else(|| format!("must be off or a number from {low} to {high}"))
}

pub fn run(arguments: Arguments, started: Instant) -> anyhow::Result<ExitCode> {
    // A session must not end without its report for want of a folder.
    if let Some(folder) = arguments.report.as_deref().and_then(Path::parent).filter(|folder| *folder != Path::new("")) {
        cli::make_folder(folder)?;
    }
    let profile = arguments.profile.as_deref().map(profile).transpose()?.unwrap_or_default();
    let folders = if arguments.worlds.is_empty() { vec![default_world()?] } else { arguments.worlds };
    let worlds = cli::open_worlds(&folders, &arguments.cache)?;
    let whole = match &worlds[..] {
        [world] => world.clone(),
        worlds => Arc::new(World::stack(worlds)?),
    };
    let mut source = Source::shared(&whole);
    let bookmarks = bookmarks(&source.manifest, &source.index).iter().map(Bookmark::of).collect();
    if let Some(stall) = arguments.stall_secs {
        source = stalled(source, stall);
    }
    window::run(WindowOptions {
        source,
        worlds,
        whole,
        bookmarks,
        size_px: arguments.size.map(|size| size.0),
        tolerance_px: arguments.tolerance_px.or(profile.tolerance_px),
        footprint: arguments.footprint.or(profile.footprint()),
        frame_ms: arguments.frame_ms.map(|frame_ms| frame_ms.0).or(profile.frame_ms.map(Some)),
        params: EngineParams::default(),
        replay: arguments.path.as_deref().map(FlightPath::load).transpose()?,
        report: arguments.report,
        started,
    })?;
    Ok(ExitCode::SUCCESS)
}

/// A profile whose settings the window can take.
fn profile(file: &Path) -> anyhow::Result<Profile> {
    let profile = Profile::load(file)?;
    let settings = [
        ("tolerance_px", profile.tolerance_px, window::TOLERANCE_PX),
        ("frame_ms", profile.frame_ms, window::FRAME_MS),
    ];
    for (key, value, [low, high]) in settings {
        if let Some(value) = value {
            let fits = (low..=high).contains(&value);
            anyhow::ensure!(fits, "{}: {key} is {value}, but a window takes {low} to {high}", file.display());
        }
    }
    Ok(profile)
}

/// The default world beside the program or the current folder.
fn default_world() -> anyhow::Result<PathBuf> {
    let program = std::env::current_exe().ok();
    let here = std::env::current_dir().ok();
    let starts = [here.as_deref(), program.as_deref().and_then(Path::parent)];
    starts
        .into_iter()
        .flatten()
        .flat_map(Path::ancestors)
        .flat_map(|folder| DEFAULT_WORLDS.map(|world| folder.join(world)))
        .find(|world| world.join("world.json").is_file())
        .context(
            "the default world is not here: start stoop in a clone of its repository, or name a world: `stoop WORLD` \
             (stoop-prepare makes one from your files)",
        )
}

fn stalled(source: Source, stall: Stall) -> Source {
    let gate = Arc::new(Gate::default());
    gate.stall(stall);
    Source { reader: Arc::new(SlowReader::new(source.reader.clone(), Duration::ZERO, gate)), ..source }
}
