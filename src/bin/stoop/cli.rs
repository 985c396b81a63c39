//! What the subcommands share: values as people write them, and errors of one line.

use std::fmt;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use stoop::engine::Source;
use stoop::store::{CACHE_LIMIT, DiskCache, OpenOptions, World};
use stoop::units::ByteSize;

pub use stoop::units::{number, positive};

/// Exit status for wrong usage; 1 stands for work that failed.
pub const USAGE: u8 = 2;

/// Something that is planned and that this version cannot do.
#[derive(Debug)]
pub struct NotYet {
    what: String,
    instead: String,
}

impl NotYet {
    /// Only of programs built without some of their features.
    #[cfg_attr(all(feature = "window", feature = "prepare"), allow(dead_code))]
    pub fn new(what: impl Into<String>, instead: impl Into<String>) -> Self {
        Self { what: what.into(), instead: instead.into() }
    }
}

impl fmt::Display for NotYet {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} is not supported by this version: {}", self.what, self.instead)
    }
}

impl std::error::Error for NotYet {}

/// Arguments that parse one by one and make no sense together.
#[derive(Debug)]
pub struct WrongUsage(pub String);

impl fmt::Display for WrongUsage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for WrongUsage {}

/// Prints an error in one line and chooses the exit status.
pub fn explain(error: &anyhow::Error) -> ExitCode {
    eprintln!("stoop: {}", one_line(&with_causes(error)));
    if error.is::<NotYet>() || error.is::<WrongUsage>() { ExitCode::from(USAGE) } else { ExitCode::FAILURE }
}

/// The message and its causes, less those that the message tells already.
fn with_causes(error: &anyhow::Error) -> String {
    let mut said = String::new();
    for cause in error.chain().map(ToString::to_string) {
        if said.is_empty() {
            said = cause;
        } else if !said.contains(&cause) {
            said = format!("{said}: {cause}");
        }
    }
    said
}

/// Help and version as they are; errors of usage in one line.
pub fn explain_usage(error: &clap::Error) -> ExitCode {
    if !error.use_stderr() {
        return if error.print().is_ok() { ExitCode::SUCCESS } else { ExitCode::FAILURE };
    }
    let text = error.to_string();
    // Clap adds usage and hints in paragraphs of their own.
    let said = text.split("\n\nUsage:").next().and_then(|said| said.split("\n\nFor more").next()).unwrap_or(&text);
    let said = one_line(said.trim_start_matches("error: "));
    eprintln!("stoop: {}; see --help", said.trim_end_matches('.'));
    ExitCode::from(USAGE)
}

fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// A picture's size as people write it: `640x360`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SizePx(pub [u32; 2]);

impl std::str::FromStr for SizePx {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let side = |digits: &str| digits.parse::<u32>().ok().filter(|side| (1..=8192).contains(side));
        text.split_once('x').and_then(|(width, height)| Some(Self([side(width)?, side(height)?]))).ok_or_else(|| {
            format!("{text:?} is no size in pixels: write WIDTHxHEIGHT, each 1 to 8192, such as 640x360")
        })
    }
}

/// A number from −90 to 90.
pub fn latitude(text: &str) -> Result<f64, String> {
    number(text).and_then(|value| if value.abs() <= 90.0 { Ok(value) } else { Err("must be from -90 to 90".into()) })
}

/// A number from −360 to 360.
pub fn longitude(text: &str) -> Result<f64, String> {
    number(text).and_then(|value| if value.abs() <= 360.0 { Ok(value) } else { Err("must be from -360 to 360".into()) })
}

/// A field of view: above 0 and below 180 degrees.
pub fn field_of_view(text: &str) -> Result<f64, String> {
    positive(text).and_then(|value| if value < 180.0 { Ok(value) } else { Err("must be below 180".into()) })
}

/// Bytes with KiB, MiB or GiB.
pub fn bytes(text: &str) -> Result<ByteSize, String> {
    text.parse().map_err(|error: stoop::units::ByteSizeError| error.to_string())
}

/// Makes sure that a folder is there to write into.
pub fn make_folder(folder: &std::path::Path) -> anyhow::Result<()> {
    use anyhow::Context;
    std::fs::create_dir_all(folder)
        .with_context(|| format!("cannot make the folder {}: check its place and rights", folder.display()))
}

/// What worlds behind addresses are read through.
#[derive(clap::Args)]
#[group(skip)]
pub struct CacheArguments {
    /// Keep what is read of worlds behind addresses in this folder, and read it there: also while the server does not
    /// answer
    #[arg(long, value_name = "DIR")]
    cache: Option<PathBuf>,
    /// What the cache may take on the disk; what was not used for longest goes first [default: 1GiB]
    #[arg(long, value_name = "SIZE", value_parser = bytes, requires = "cache")]
    cache_limit: Option<ByteSize>,
}

impl CacheArguments {
    fn options(&self) -> anyhow::Result<OpenOptions> {
        let limit = self.cache_limit.unwrap_or(CACHE_LIMIT);
        let cache = self.cache.as_deref().map(|folder| DiskCache::open(folder, limit)).transpose()?;
        Ok(OpenOptions { cache: cache.map(Arc::new), ..OpenOptions::default() })
    }
}

fn open_told(world: &Path, options: &OpenOptions) -> anyhow::Result<World> {
    let world = World::open_with(world, options)?;
    if let Some(notice) = world.notice() {
        eprintln!("stoop: {notice}");
    }
    Ok(world)
}

/// Opens one world.
pub fn open_world(world: &Path, cache: &CacheArguments) -> anyhow::Result<World> {
    open_told(world, &cache.options()?)
}

/// Opens worlds that are to lie over one another.
pub fn open_worlds(worlds: &[PathBuf], cache: &CacheArguments) -> anyhow::Result<Vec<Arc<World>>> {
    let options = cache.options()?;
    worlds.iter().map(|world| Ok(Arc::new(open_told(world, &options)?))).collect()
}

/// One world or several over one another, for the engine.
pub fn open(worlds: &[PathBuf], cache: &CacheArguments) -> anyhow::Result<Source> {
    Ok(Source::over(&open_worlds(worlds, cache)?)?)
}

/// The same with the whole index in memory, for walks that must see everything.
pub fn open_whole(worlds: &[PathBuf], cache: &CacheArguments) -> anyhow::Result<World> {
    match worlds {
        [world] => open_told(world, &OpenOptions { resident_max_bytes: u64::MAX, ..cache.options()? }),
        worlds => Ok(World::stack(&open_worlds(worlds, cache)?)?),
    }
}

/// Writes to standard output; a closed pipe is no failure of the work that was done.
pub fn say(text: &str) {
    use std::io::Write;
    let _ = std::io::stdout().write_all(text.as_bytes());
}

/// West, south, east, north in degrees as people write them: `-122.6,37.7,-122.3,37.9`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoundsDeg(pub [f64; 4]);

impl std::str::FromStr for BoundsDeg {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let bad = || format!("{text:?} are no bounds: write WEST,SOUTH,EAST,NORTH in degrees, west below east");
        let numbers: Vec<f64> = text.split(',').map(number).collect::<Result<_, _>>().map_err(|_| bad())?;
        let [west, south, east, north] = numbers.try_into().map_err(|_| bad())?;
        let fits = west < east && south < north && west >= -180.0 && east <= 180.0 && south >= -90.0 && north <= 90.0;
        fits.then_some(Self([west, south, east, north])).ok_or_else(bad)
    }
}

/// The exit status of a check.
pub fn clean(is_clean: bool) -> ExitCode {
    if is_clean { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// Prints a line to standard output; see [`say`].
macro_rules! sayln {
    ($($part:tt)*) => { $crate::cli::say(&format!("{}\n", format_args!($($part)*))) };
}
pub(crate) use sayln;
