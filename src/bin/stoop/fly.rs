//! `stoop fly`: a headless flight.

use crate::cli;
use std::path::PathBuf;
use std::process::ExitCode;

#[derive(clap::Args)]
pub struct Arguments {
    /// Folder of the world
    world: PathBuf,
    /// The flight, JSON
    #[arg(long, value_name = "FILE")]
    path: PathBuf,
}

pub fn run(_arguments: Arguments) -> anyhow::Result<ExitCode> {
    Err(cli::NotYet::new("`stoop fly`", "update stoop").into())
}
