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
    /// Folder or address (http://, https://, s3://) of the world
    world: PathBuf,
    #[command(flatten)]
    cache: cli::CacheArguments,
    /// The recipe that the world was prepared from
    #[arg(long, value_name = "RECIPE.toml")]
    against: Option<PathBuf>,
    /// What relative paths in the recipe are relative to; its own folder by default
    #[arg(long, value_name = "DIR", requires = "against")]
    root: Option<PathBuf>,
    /// Source posts to draw
    #[arg(long, default_value = "100000", requires = "against")]
    samples: u64,
    /// Seed of the random draw of posts
    #[arg(long, default_value = "0", requires = "against")]
    seed: u64,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

pub fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let world = cli::open_whole(std::slice::from_ref(&arguments.world), &arguments.cache)?;
    match &arguments.against {
        None => verify(&world, arguments.json),
        Some(recipe) => against(&world, recipe, &arguments),
    }
}

fn verify(world: &World, json: bool) -> anyhow::Result<ExitCode> {
    let report = world.verify(&mut |_, _| {});
    if json {
        cli::sayln!("{}", serde_json::to_string_pretty(&report)?);
    } else {
        cli::sayln!("{} nodes, {} pages, {} bytes verified", report.nodes, report.pages, report.bytes);
        for problem in &report.problems {
            cli::sayln!("{}: {}", problem.place, problem.what);
        }
        cli::sayln!("{}", if report.problems.is_empty() { "clean" } else { "not clean" });
    }
    Ok(cli::clean(report.problems.is_empty()))
}

#[cfg(feature = "prepare")]
fn against(world: &World, recipe: &std::path::Path, arguments: &Arguments) -> anyhow::Result<ExitCode> {
    use stoop::prepare::{Recipe, against::check_against};
    let recipe = Recipe::read(recipe)?;
    let report = check_against(world, &recipe, arguments.root.as_deref(), arguments.samples, arguments.seed, &|_| {})?;
    if arguments.json {
        cli::sayln!("{}", serde_json::to_string_pretty(&report)?);
    } else {
        print_against(&report);
    }
    let lost = report.buildings.iter().any(|set| set.missing + set.surplus > 0);
    let far = report.reps.iter().any(|rep| rep.violations > 0);
    Ok(cli::clean(report.violations == 0 && !lost && !far))
}

#[cfg(feature = "prepare")]
fn print_against(report: &stoop::prepare::against::AgainstReport) {
    cli::sayln!("{} places, {} comparisons, {} violations", report.samples, report.comparisons, report.violations);
    cli::sayln!("finest cells: largest error {:.3} m, mean {:.3} m", report.finest_worst_m, report.finest_mean_m);
    cli::sayln!("level  comparisons  violations  worst measured / declared");
    for level in &report.levels {
        cli::sayln!(
            "{:>5}  {:>11}  {:>10}  {:>12.3}",
            level.level,
            level.comparisons,
            level.violations,
            level.worst_ratio
        );
    }
    let tight = &report.tightness;
    cli::sayln!(
        "tight within 2×: {} of {} land cells ({:.0} %), median measured / declared {:.3}",
        tight.tight_cells,
        tight.land_cells,
        tight.tight_share * 100.0,
        tight.median_ratio
    );
    for set in &report.buildings {
        cli::sayln!(
            "{} rep {}: {} prisms, {} missing, {} surplus; outline off by {:.3} m at most, {:.4} m in the mean; \
             height {:.3} m, {:.4} m",
            set.name,
            set.rep,
            set.prisms,
            set.missing,
            set.surplus,
            set.outline_worst_m,
            set.outline_mean_m,
            set.height_worst_m,
            set.height_mean_m
        );
    }
    for rep in &report.reps {
        cli::sayln!(
            "{} rep {}: {} pages, {} samples of roofs, {} of drawn ones; off by {:.3} m at most, {:.3} of what its page \
             declares; drawn ones {:.3}; {} violations; worst in cell {} at {:.6} {:.6}",
            rep.name,
            rep.rep,
            rep.pages,
            rep.samples,
            rep.drawn_samples,
            rep.worst_m,
            rep.worst_ratio,
            rep.drawn_worst_ratio,
            rep.violations,
            rep.worst_cell,
            rep.worst_lon_deg,
            rep.worst_lat_deg
        );
    }
    for violation in &report.examples {
        cli::sayln!(
            "violation: cell {} at {:.6} {:.6}: drawn {:.3} m, truth {:.3} m, declared {:.3} m",
            violation.cell,
            violation.lon_deg,
            violation.lat_deg,
            violation.drawn_m,
            violation.truth_m,
            violation.error_m
        );
    }
}

#[cfg(not(feature = "prepare"))]
fn against(_: &World, _: &std::path::Path, _: &Arguments) -> anyhow::Result<ExitCode> {
    Err(cli::NotYet::new("--against without the feature `prepare`", "build stoop with it").into())
}
