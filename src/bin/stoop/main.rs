//! The program `stoop`: flies worlds and tells what is in them.

mod check;
mod cli;
mod export;
#[cfg(feature = "prepare")]
mod export_terrain;
mod fly;
mod info;
mod place;
mod probe;
mod shot;
#[cfg(feature = "window")]
mod view;

use clap::{Parser, Subcommand};
use std::process::ExitCode;
use std::time::Instant;

/// Flies from the whole Earth to a doorstep over worlds that stoop-prepare made.
#[derive(Parser)]
#[command(name = "stoop", version, args_conflicts_with_subcommands = true, after_help = help())]
struct Arguments {
    #[command(subcommand)]
    command: Option<Command>,
    #[cfg(feature = "window")]
    #[command(flatten)]
    view: view::Arguments,
}

const EXAMPLES: &str = "\
Without a command the viewer opens a window on WORLD; press H there for its controls.

Examples:
  stoop
  stoop WORLD --tolerance-px 2 --footprint 512MiB
  stoop EARTH CITY MORE
  stoop fly tiles/default/world --path tiles/default/helsinki.json --frames pictures --every-secs 1
  stoop shot tiles/default/world --lon-deg 24.95 --lat-deg 60.17 --height-m 2000 --pitch-deg -60 --out city.png
  stoop info tiles/default/world
  stoop https://example.org/worlds/alps --cache ~/.cache/stoop

Worlds behind addresses: WORLD may be http://HOST/FOLDER, https://HOST/FOLDER or s3://BUCKET/FOLDER, wherever one is
taken. The server must answer requests for byte ranges (nginx, Apache, Caddy, S3 and most others do); nothing is listed.
Requests that fail are tried again, and given up after 30 s; pages that did not come are asked for again later, and
coarser ones are drawn meanwhile. A file that changes on the server while it is open is not read on: open the world
again. For s3:// these variables count: AWS_REGION (else us-east-1), AWS_ENDPOINT_URL (for servers other than Amazon's),
AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY, AWS_SESSION_TOKEN; without keys requests are not signed, as public buckets
want it. HTTP_PROXY, HTTPS_PROXY and NO_PROXY are followed.";

fn help() -> String {
    #[cfg(feature = "window")]
    return format!("{EXAMPLES}\n\nIn the window:\n{}", view::controls());
    #[cfg(not(feature = "window"))]
    EXAMPLES.to_owned()
}

#[derive(Subcommand)]
enum Command {
    /// A headless flight: pictures, figures per frame, a report
    Fly(Box<fly::Arguments>),
    /// One settled picture
    Shot(shot::Arguments),
    /// What is in a world: layers, levels, pages, bytes, objects
    Info(info::Arguments),
    /// Verify every page, checksum, bound and link, or the world against its sources
    Check(check::Arguments),
    /// Ground height, finest cell and objects at a place
    Probe(probe::Arguments),
    /// Write a collection as GeoJSON or terrain as GeoTIFF
    Export(export::Arguments),
}

fn main() -> ExitCode {
    let started = Instant::now();
    let arguments = match Arguments::try_parse() {
        Ok(arguments) => arguments,
        Err(error) => return cli::explain_usage(&error),
    };
    match run(arguments, started) {
        Ok(code) => code,
        Err(error) => cli::explain(&error),
    }
}

#[cfg_attr(not(feature = "window"), expect(unused_variables, reason = "only the window tells its first frame"))]
fn run(arguments: Arguments, started: Instant) -> anyhow::Result<ExitCode> {
    match arguments.command {
        Some(Command::Fly(arguments)) => fly::run(*arguments),
        Some(Command::Shot(arguments)) => shot::run(arguments),
        Some(Command::Info(arguments)) => info::run(arguments),
        Some(Command::Check(arguments)) => check::run(arguments),
        Some(Command::Probe(arguments)) => probe::run(arguments),
        Some(Command::Export(arguments)) => export::run(arguments),
        #[cfg(feature = "window")]
        None => view::run(arguments.view, started),
        #[cfg(not(feature = "window"))]
        None => {
            Err(cli::NotYet::new("the window (built without it)", "fly headless with `stoop fly WORLD --path FILE`")
                .into())
        }
    }
}
