//! What the subcommands share: values as people write them, and errors of one line.

use std::fmt;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use stoop::engine::Source;
use stoop::store::World;
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

/// Opens worlds that are to lie over one another.
pub fn open_worlds(folders: &[PathBuf]) -> anyhow::Result<Vec<Arc<World>>> {
    folders.iter().map(|folder| Ok(Arc::new(World::open(folder)?))).collect()
}

/// One world or several over one another, for the engine.
pub fn open(folders: &[PathBuf]) -> anyhow::Result<Source> {
    Ok(Source::over(&open_worlds(folders)?)?)
}

/// The same with the whole index in memory, for walks that must see everything.
pub fn open_whole(folders: &[PathBuf]) -> anyhow::Result<World> {
    match folders {
        [folder] => Ok(World::open_whole(folder)?),
        folders => Ok(World::stack(&open_worlds(folders)?)?),
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
