//! `stoop info`.

use std::process::ExitCode;

#[derive(clap::Args)]
pub struct Arguments {}

pub fn run(_arguments: Arguments) -> anyhow::Result<ExitCode> {
    Err(crate::cli::NotYet::new("`stoop info`", "update stoop").into())
}
