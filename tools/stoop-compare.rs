//! The program `stoop-compare`: policies over flights and storage models, by the virtual clock.

mod world;

use anyhow::Context;
use clap::Parser;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use stoop::camera::FlightPath;
use stoop::chart::{Case, Flight, csv, markdown, run};
use stoop::engine::{GroundProbe, Source};
use stoop::paging::{PlannerParams, PolicyName, PolicyParams};
use stoop::simulate::{Library, Setup};
use stoop::storage::{Faults, StorageModel};
use stoop::units::{ByteSize, positive};
use world::WorldArguments;

const DETAILS: &str = "\
Writes runs.csv, a line for each run, and table.md, the best variant of each policy side by side, into DIR.

The grid is JSON: for each label a list of variants, {\"LABEL\": [{\"policy\": NAME, \"params\": {...}}, ...]}; params are
those of the policy itself. Labels come in the order of the file.

Example:
  stoop-compare WORLD --paths tests/paths --grid tools/policy-grid.json --out out/compare";

/// Compares policies over flights and storage models by the virtual clock.
#[derive(Parser)]
#[command(name = "stoop-compare", version, after_help = DETAILS)]
struct Arguments {
    #[command(flatten)]
    world: WorldArguments,
    /// Flights: files, or folders of them
    #[arg(long, required = true, num_args = 1..)]
    paths: Vec<PathBuf>,
    /// Storage models, semicolons between them: hdd, ssd, lan, wan, mobile, or LATENCY_MS,MB_PER_S,PARALLEL
    #[arg(long, value_delimiter = ';', default_values = ["hdd", "ssd", "lan", "wan", "mobile"])]
    storage: Vec<StorageModel>,
    /// Labels and their variants; without it each policy as it is
    #[arg(long, value_name = "FILE")]
    grid: Option<PathBuf>,
    /// Only these labels of the grid
    #[arg(long, value_delimiter = ',')]
    only: Vec<String>,
    /// Footprints
    #[arg(long, value_delimiter = ',', default_value = "256MiB")]
    footprint: Vec<ByteSize>,
    /// Allowed screen-space error, pixels
    #[arg(long, default_value_t = 1.0, value_parser = positive)]
    tolerance_px: f64,
    /// Width and height, pixels
    #[arg(long, num_args = 2, default_values_t = [640, 360], value_parser = clap::value_parser!(u32).range(1..=8192))]
    size: Vec<u32>,
    /// Seconds from frame to frame
    #[arg(long, default_value_t = 1.0 / 60.0, value_parser = positive)]
    step_secs: f64,
    /// Load intermediate levels too
    #[arg(long)]
    no_level_skip: bool,
    /// Each frame reads what it lacks and waits for it
    #[arg(long)]
    sync_reads: bool,
    /// Make reads go wrong; see `stoop fly --help`
    #[arg(long)]
    faults: Option<Faults>,
    /// Seed of --faults
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Folder to write to
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

fn main() -> anyhow::Result<()> {
    let arguments = Arguments::parse();
    let source = Source::of(arguments.world.open("stoop-compare")?);
    let flights = load_flights(&arguments.paths, &source)?;
    let variants = variants(arguments.grid.as_deref(), &arguments.only)?;
    let cases = cases(&arguments, &flights, &variants);
    eprintln!("{} runs over {} flights", cases.len(), flights.len());
    let library = Library::new(source.index.clone(), source.reader.clone());
    let outcomes = run(&library, &flights, &cases)?;
    std::fs::create_dir_all(&arguments.out).with_context(|| format!("cannot make {}", arguments.out.display()))?;
    write(&arguments.out.join("runs.csv"), &csv(&flights, &cases, &outcomes))?;
    let table = markdown(&flights, &cases, &outcomes);
    write(&arguments.out.join("table.md"), &table)?;
    print!("{table}");
    Ok(())
}

fn write(file: &Path, text: &str) -> anyhow::Result<()> {
    std::fs::write(file, text).with_context(|| format!("cannot write {}", file.display()))
}

fn load_flights(paths: &[PathBuf], source: &Source) -> anyhow::Result<Vec<Flight>> {
    let mut files = Vec::new();
    for path in paths {
        if path.is_dir() {
            let listed = std::fs::read_dir(path).with_context(|| format!("cannot list {}", path.display()))?;
            let mut inside: Vec<PathBuf> = listed.filter_map(|entry| Some(entry.ok()?.path())).collect();
            inside.retain(|file| file.extension().is_some_and(|ext| ext == "json"));
            inside.sort();
            files.extend(inside);
        } else {
            files.push(path.clone());
        }
    }
    let ground = GroundProbe::new(source);
    let load = |file: &PathBuf| {
        let path = FlightPath::load(file)?;
        let arrivals_s = path.arrivals_s(|lat_rad, lon_rad| ground.height_m(lat_rad, lon_rad));
        let name = file.file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into_owned());
        Ok(Flight { name, path: Arc::new(path), arrivals_s })
    };
    files.iter().map(load).collect()
}

/// A label, its parameters in short, and the planner.
struct Variant {
    label: String,
    name: String,
    planner: PlannerParams,
}

fn variants(grid: Option<&Path>, only: &[String]) -> anyhow::Result<Vec<Variant>> {
    let mut variants = match grid {
        None => PolicyName::ALL.map(|policy| of_policy(policy.name(), policy, &Value::Null)).into_iter().collect(),
        Some(file) => read_grid(file)?,
    };
    variants.retain(|variant| only.is_empty() || only.contains(&variant.label));
    anyhow::ensure!(!variants.is_empty(), "nothing to run: --only names labels of the grid, or policies without one");
    Ok(variants)
}

fn of_policy(label: &str, policy: PolicyName, params: &Value) -> Variant {
    let name = if params.is_null() { String::new() } else { params.to_string().replace(['{', '}', '"'], "") };
    Variant { label: label.to_owned(), name, planner: PlannerParams { policy, ..PlannerParams::default() } }
}

/// A variant as the grid has it.
#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    policy: PolicyName,
    #[serde(default)]
    params: Value,
}

fn read_grid(file: &Path) -> anyhow::Result<Vec<Variant>> {
    let text = std::fs::read_to_string(file).with_context(|| format!("cannot read {}", file.display()))?;
    let bad = || format!("{}: no grid; see --help", file.display());
    let labels: serde_json::Map<String, Value> = serde_json::from_str(&text).with_context(bad)?;
    let mut variants = Vec::new();
    for (label, list) in labels {
        for Entry { policy, params } in serde_json::from_value::<Vec<Entry>>(list).with_context(bad)? {
            let mut variant = of_policy(&label, policy, &params);
            if !params.is_null() {
                let params = serde_json::json!({ policy.name(): params });
                variant.planner.params = serde_json::from_value::<PolicyParams>(params).with_context(bad)?;
            }
            variants.push(variant);
        }
    }
    Ok(variants)
}

fn cases(arguments: &Arguments, flights: &[Flight], variants: &[Variant]) -> Vec<Case> {
    let mut cases = Vec::new();
    for flight in 0..flights.len() {
        for &storage in &arguments.storage {
            for &footprint in &arguments.footprint {
                for variant in variants {
                    let planner = PlannerParams { level_skip: !arguments.no_level_skip, ..variant.planner };
                    let setup = Setup {
                        planner,
                        footprint,
                        faults: arguments.faults.unwrap_or_default(),
                        seed: arguments.seed,
                        sync_reads: arguments.sync_reads,
                        tolerance_px: arguments.tolerance_px,
                        size_px: [arguments.size[0], arguments.size[1]],
                        ..Setup::new(storage, arguments.step_secs)
                    };
                    let (label, name) = (variant.label.clone(), variant.name.clone());
                    cases.push(Case { flight, label, variant: name, setup });
                }
            }
        }
    }
    cases
}
