//! `stoop-prepare`: source files → world.

#[path = "prepare/layouts.rs"]
mod layouts;

use anyhow::Context;
use clap::Parser;
use indicatif::{MultiProgress, ProgressBar, ProgressStyle};
use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use stoop::prepare::into::{self, IntoOptions};
use stoop::prepare::pipeline::{self, BuildError, BuildOptions, Control, StageDone};
use stoop::prepare::{PrepareError, Progress, Recipe};
use stoop::store::{LayerInfo, Manifest};
use stoop::units::ByteSize;

/// Outlines come and go by the million: a fifth of the time with the system's allocator.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

const EXAMPLES: &str = "\
Examples:
  stoop-prepare tests/recipes/dive-city20k.toml --out dive.world
  stoop-prepare tiles/default/recipe.toml --out earth.world --root SOURCES --memory 2GiB --jobs 8
  stoop-prepare recipe.toml --out city.world --json | jq .
  stoop-prepare buildings.toml --into earth.world

Keys of a recipe (lengths in metres), besides name:
  all sections  file crs nodata credit licence
  [[elevation]] vertical layer feather_m clamp_m prune_error_m finest_error_m
  [[imagery]]   bounds_deg feather_m heights texel_m (of a painted .osm.pbf)
  [[buildings]] name height base vertical levels default_height min_height roof color id attributes

  [[layout]]    name collection region_deg altitude_bands_m tolerance_px viewport_h_px
                storage max_redundancy side_m

A [[layout]] is a single-seek layout for stoop fly --layout NAME: cells over the ground
by bands of altitude, and for each step from one to the next all that it adds in one
run. The side of the cells is the knee of redundancy against waiting by the storage
model, unless side_m tells it; the curve is printed. Where the layout would gain too
little, or take more than max_redundancy times the bytes of its pages, none is written
and the reason is said. A recipe of layouts alone makes them for a world with --into.

With --into objects stand on the world's own finest terrain. New pages and indexes
go into new files, and the manifest that names them is renamed into place last: a
change that is broken off at any point leaves the world as it was. What a replaced
set took of the packs stays on disk, unused, until the world is prepared anew
(stoop info tells the bytes).

A stopped build (Ctrl-C, a full disk) keeps its finished stages in DIR.partial;
the same command goes on from there. Exit status: 0 done, 1 failed, 130 stopped.";

/// Prepares a world from elevation models, imagery and building files, as a recipe says.
#[derive(Parser)]
#[command(version, after_help = EXAMPLES)]
struct Args {
    /// What the world is made of (TOML)
    recipe: PathBuf,
    /// Folder of the world to be written
    #[arg(long, value_name = "DIR", required_unless_present = "into")]
    out: Option<PathBuf>,
    /// Put the recipe's [[buildings]] into this world instead of making a new one: a set of a new name is added, one of
    /// a known name is replaced; all else stays as it is, byte for byte
    #[arg(long, value_name = "WORLD", conflicts_with_all = ["out", "replace"])]
    into: Option<PathBuf>,
    /// Folder that the recipe's paths are relative to [default: the recipe's own]
    #[arg(long, value_name = "DIR")]
    root: Option<PathBuf>,
    /// Worker threads [default: one for each processor]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    jobs: Option<u16>,
    /// Memory for decoded sources, in bytes or with KiB, MiB, GiB
    #[arg(long, value_name = "SIZE", default_value = "512MiB")]
    memory: ByteSize,
    /// Replace a world that is already in DIR, once the new one is whole
    #[arg(long)]
    replace: bool,
    /// Print one JSON object a line for each event instead of progress bars
    #[arg(long)]
    json: bool,
}

fn main() -> std::process::ExitCode {
    let args = Args::parse();
    match run(&args) {
        Ok(()) => std::process::ExitCode::SUCCESS,
        Err(error) => {
            let build = error.downcast_ref::<BuildError>();
            let stopped =
                build.is_some_and(|error| matches!(error, BuildError::Stopped(_))) || error.is::<layouts::Stopped>();
            // The library's messages are whole; those of the program are chains.
            let is_whole = build.is_some() || error.is::<PrepareError>();
            let message = if is_whole { error.to_string() } else { format!("{error:#}") };
            if args.json {
                println!("{}", serde_json::json!({ "event": "error", "stopped": stopped, "message": message }));
            }
            eprintln!("stoop-prepare: {message}");
            std::process::ExitCode::from(if stopped { 130 } else { 1 })
        }
    }
}

fn run(args: &Args) -> anyhow::Result<()> {
    if let Some(jobs) = args.jobs {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(usize::from(jobs));
        pool.build_global().context("the worker threads cannot be started; ask for fewer with --jobs")?;
    }
    let recipe = Recipe::read(&args.recipe)?;
    let stop = Arc::new(AtomicBool::new(false));
    let on_signal = Arc::clone(&stop);
    // The second Ctrl-C does not wait: stage files are renamed when whole, so nothing can be left half-written.
    let handler = move || {
        if on_signal.swap(true, Ordering::Relaxed) {
            std::process::exit(130);
        }
    };
    ctrlc::set_handler(handler).context("Ctrl-C cannot be caught")?;
    let started = Instant::now();
    let shown = Shown::new(args.json);
    let control = Control {
        stop: &stop,
        on_progress: &|progress| shown.progress(&progress),
        on_done: &|done| shown.done(done),
        on_note: &|note| shown.note(note),
    };
    let ((Some(world), _) | (None, Some(world))) = (&args.into, &args.out) else {
        anyhow::bail!("name the world to be written with --out, or the one to be changed with --into");
    };
    if recipe.has_sources() || args.into.is_none() {
        let manifest = prepare(args, &recipe, &control)?;
        shown.finish(&manifest, started.elapsed());
    }
    layouts::build(&recipe, world, &shown, &stop)
}

fn prepare(args: &Args, recipe: &Recipe, control: &Control) -> anyhow::Result<Manifest> {
    let (root, memory) = (args.root.clone(), args.memory);
    Ok(match (&args.into, &args.out) {
        (Some(world), _) => into::build_into(recipe, &IntoOptions { world: world.clone(), root, memory }, control)?,
        (None, Some(out)) => {
            let options = BuildOptions { out: out.clone(), root, memory, replace: args.replace };
            pipeline::build(recipe, &options, control)?
        }
        (None, None) => anyhow::bail!("name the world to be written with --out, or the one to be changed with --into"),
    })
}

/// Progress bars, or JSON lines.
struct Shown {
    json: bool,
    bars: MultiProgress,
    by_stage: Mutex<HashMap<&'static str, ProgressBar>>,
}

impl Shown {
    fn new(json: bool) -> Self {
        Self { json, bars: MultiProgress::new(), by_stage: Mutex::default() }
    }

    fn progress(&self, progress: &Progress<'_>) {
        if self.json {
            return;
        }
        let Ok(mut bars) = self.by_stage.lock() else { return };
        let bar = bars.entry(progress.stage).or_insert_with(|| self.bars.add(new_bar(progress.stage)));
        bar.set_length(progress.total.max(progress.done));
        bar.set_position(progress.done);
        bar.set_message(progress.item.to_owned());
    }

    fn done(&self, done: &StageDone) {
        self.clear();
        if self.json {
            let mut line = serde_json::json!(done);
            line["event"] = "stage".into();
            println!("{line}");
            return;
        }
        let how = if done.resumed { " (taken over)" } else { "" };
        self.line(&format!(
            "{:6} {:40} {:>10} {:>12} {:8.2} s{how}",
            done.stage,
            done.item,
            done.count,
            ByteSize(done.bytes).to_string(),
            done.seconds
        ));
    }

    fn note(&self, note: &str) {
        if self.json {
            println!("{}", serde_json::json!({ "event": "note", "message": note }));
        } else {
            self.line(&format!("note: {note}"));
        }
    }

    fn clear(&self) {
        if let Ok(mut bars) = self.by_stage.lock() {
            bars.drain().for_each(|(_, bar)| bar.finish_and_clear());
        }
    }

    fn line(&self, text: &str) {
        self.bars.suspend(|| println!("{text}"));
    }

    fn finish(&self, manifest: &Manifest, took: Duration) {
        let seconds = took.as_secs_f64();
        if self.json {
            println!("{}", serde_json::json!({ "event": "world", "seconds": seconds, "manifest": manifest }));
            return;
        }
        print_sources(manifest);
        print_layer("terrain", manifest.terrain.as_ref());
        print_layer("imagery", manifest.imagery.as_ref());
        manifest.collections.iter().for_each(print_collection);
        println!("packs {}, indexes {}, {seconds:.1} s", ByteSize(manifest.pack_bytes), ByteSize(manifest.index_bytes));
        if manifest.additions.unused_bytes > 0 {
            println!("unused in the packs: {}", ByteSize(manifest.additions.unused_bytes));
        }
    }
}

fn new_bar(stage: &'static str) -> ProgressBar {
    let bar = ProgressBar::new(0).with_prefix(stage);
    // The template is fixed; were it wrong, a plain bar would do.
    if let Ok(style) = ProgressStyle::with_template("{prefix:16} {bar:30} {pos}/{len} {msg} {eta}") {
        bar.set_style(style);
    }
    bar
}

fn print_sources(manifest: &Manifest) {
    println!("sources:");
    for source in &manifest.sources {
        let spacing = if source.spacing_m > 0.0 { format!(", {:.1} m", source.spacing_m) } else { String::new() };
        println!(
            "  {:10} {} ({} samples or features{spacing}) {}",
            source.kind, source.file, source.count, source.credit
        );
    }
}

fn print_layer(name: &str, layer: Option<&LayerInfo>) {
    let Some(layer) = layer else { return };
    println!(
        "{name}: {} pages, {}",
        layer.pages_by_level.iter().sum::<u64>(),
        ByteSize(layer.bytes_by_level.iter().sum())
    );
    for (level, (pages, bytes)) in layer.pages_by_level.iter().zip(&layer.bytes_by_level).enumerate() {
        println!("  level {level:2}: {pages:8} pages {:>12}", ByteSize(*bytes).to_string());
    }
}

fn print_collection(collection: &stoop::store::CollectionInfo) {
    println!(
        "{}: {} objects in {} pages, {}; changeover level {} (one-size rule: {}), {} large objects above it",
        collection.name,
        collection.objects,
        collection.pages,
        ByteSize(collection.bytes),
        collection.changeover_level,
        collection.vgis_level,
        collection.large_objects
    );
    for rep in &collection.reps {
        println!(
            "  rep {:>2}: {:>6} pages {:>12} {:>9} {}, error up to {:.2} m",
            rep.rep,
            rep.pages,
            ByteSize(rep.bytes).to_string(),
            rep.objects,
            if rep.rep < stoop::content::FIRST_GROUPS { "objects" } else { "blocks and landmarks" },
            rep.error_max_m
        );
    }
    for point in &collection.cost_curve {
        println!(
            "  level {:2}: cost {:10.2} = cells {:.2} + objects {:.2} + large {:.2} + pages {:.2}",
            point.level, point.cost, point.cells, point.objects, point.large_objects, point.pages
        );
    }
    for (what, counts) in [("set aside", &collection.set_aside), ("repaired", &collection.repaired)] {
        for (reason, count) in counts {
            println!("  {what}: {count} {reason}");
        }
    }
}
