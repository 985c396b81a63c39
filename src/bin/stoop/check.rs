//! `stoop check`.

use crate::cli;
use std::path::PathBuf;
use std::process::ExitCode;
use stoop::store::World;

const EXAMPLES: &str = "\
Without --against: reads every page and verifies checksums, bounds, links and that no byte of a pack is unaccounted.
With --against: draws source posts by chance, and compares the drawn surface of every level there with the truth that
the recipe's sources give; compares footprints and heights of objects with theirs. Exit status 1 when anything is wrong.

Examples:
  stoop check tiles/default/world
  stoop check WORLD --against recipe.toml --samples 100000 --seed 7 --json";

#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// Folder of the world
    world: PathBuf,
    /// The recipe that the world was prepared from
    #[arg(long, value_name = "RECIPE.toml")]
    against: Option<PathBuf>,
    /// What relative paths in the recipe are relative to; its own folder by default
    #[arg(long, value_name = "DIR", requires = "against")]
    root: Option<PathBuf>,
    /// Source posts to draw
    #[arg(long, default_value = "100000", requires = "against")]
    samples: u64,
    /// Of the chance that draws them
    #[arg(long, default_value = "0", requires = "against")]
    seed: u64,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

pub fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let world = World::open(&arguments.world)?;
    match &arguments.against {
        None => verify(&world, arguments.json),
        Some(recipe) => against(&world, recipe, &arguments),
    }
}

fn verify(world: &World, json: bool) -> anyhow::Result<ExitCode> {
    let report = world.verify(&mut |_| {});
    if json {
        println!("{}", serde_json::to_string_pretty(&report)?);
    } else {
        println!("{} pages, {} bytes verified", report.pages, report.bytes);
        for fault in &report.faults {
            println!("fault: {fault}");
        }
        println!("{}", if report.faults.is_empty() { "clean" } else { "not clean" });
    }
    Ok(cli::clean(report.faults.is_empty()))
}

#[cfg(feature = "prepare")]
fn against(world: &World, recipe: &std::path::Path, arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let report =
        stoop::prepare::check_against(world, recipe, arguments.root.as_deref(), arguments.samples, arguments.seed)?;
    if arguments.json {
        println!("{}", serde_json::to_string_pretty(&report)?);
    } else {
        print!("{report}");
    }
    Ok(cli::clean(report.is_clean()))
}

#[cfg(not(feature = "prepare"))]
fn against(_: &World, _: &std::path::Path, _: &Arguments) -> anyhow::Result<ExitCode> {
    Err(cli::NotYet::new("--against without the feature `prepare`", "build stoop with it").into())
}
