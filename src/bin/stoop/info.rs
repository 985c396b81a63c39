//! `stoop info`.

use crate::cli;
use anyhow::Context;
use serde_json::json;
use std::path::PathBuf;
use std::process::ExitCode;
use stoop::content::FIRST_GROUPS;
use stoop::forest::ZONE_DEG;
use stoop::store::{CollectionInfo, LayerInfo, NamedView};
use stoop::units::ByteSize;

const EXAMPLES: &str = "\
Spacings are along the meridian, in metres; sizes in bytes.

Examples:
  stoop info tiles/default/world
  stoop info WORLD --json";

#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// Folders or addresses (http://, https://, s3://) of worlds; several lie over one another, the first one uppermost
    #[arg(value_name = "WORLD", required = true)]
    worlds: Vec<PathBuf>,
    #[command(flatten)]
    cache: cli::CacheArguments,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

/// Metres along the meridian that a degree takes, on the sphere of the Earth's mean radius.
const DEGREE_M: f64 = 111_195.0;

pub fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let world = match &arguments.worlds[..] {
        [world] => cli::open_world(world, &arguments.cache)?,
        worlds => cli::open_whole(worlds, &arguments.cache)?,
    };
    let manifest = world.manifest();
    if arguments.json {
        let mut value = serde_json::to_value(manifest).context("the manifest as JSON")?;
        value["views"] = json!(manifest.views);
        value["index_resident_bytes"] = json!(world.index().byte_len());
        cli::sayln!("{}", serde_json::to_string_pretty(&value)?);
        return Ok(ExitCode::SUCCESS);
    }
    cli::sayln!("{}: format {}, {}", manifest.name, manifest.version, manifest.datum);
    let (low_m, high_m) = manifest.height_range_m;
    cli::sayln!("heights {low_m:.1} to {high_m:.1} m, {} zones", manifest.zones.len());
    cli::sayln!("packs {}, index {}", ByteSize(manifest.pack_bytes), ByteSize(manifest.index_bytes));
    let additions = &manifest.additions;
    if !additions.is_none() {
        let unused = ByteSize(additions.unused_bytes);
        cli::sayln!("changed {} times since it was made, {unused} of the packs unused", additions.generation);
    }
    for (name, layer, across) in [("terrain", &manifest.terrain, 64.0), ("imagery", &manifest.imagery, 256.0)] {
        match layer {
            Some(layer) => print_layer(name, layer, across),
            None => cli::sayln!("\n{name}: none"),
        }
    }
    for collection in &manifest.collections {
        print_collection(collection);
    }
    if !manifest.views.is_empty() {
        cli::sayln!("\nviews");
    }
    for view in &manifest.views {
        print_view(view);
    }
    cli::sayln!("\nsources");
    for source in &manifest.sources {
        let spacing = if source.spacing_m > 0.0 { format!("{:.2} m, ", source.spacing_m) } else { String::new() };
        cli::sayln!("  {} {}: {spacing}{} {}", source.kind, source.file, source.count, unit_of(&source.kind));
        if !source.credit.is_empty() || !source.licence.is_empty() {
            cli::sayln!("    {} ({})", source.credit, source.licence);
        }
    }
    Ok(ExitCode::SUCCESS)
}

fn print_view(view: &NamedView) {
    cli::sayln!(
        "  {}: {:.5} {:.5} degrees, {:.1} m, heading {:.1}, pitch {:.1}",
        view.name,
        view.lon_deg,
        view.lat_deg,
        view.height_m,
        view.heading_deg,
        view.pitch_deg
    );
}

fn unit_of(kind: &str) -> &'static str {
    match kind {
        "buildings" | "objects" => "features",
        _ => "samples",
    }
}

/// `across`: posts or texels along a cell's side.
fn print_layer(name: &str, layer: &LayerInfo, across: f64) {
    let pages: u64 = layer.pages_by_level.iter().sum();
    let bytes: u64 = layer.bytes_by_level.iter().sum();
    cli::sayln!("\n{name}: {pages} pages, {}", ByteSize(bytes));
    cli::sayln!("  level  spacing_m      pages        bytes");
    for (level, (pages, bytes)) in layer.pages_by_level.iter().zip(&layer.bytes_by_level).enumerate() {
        let spacing_m = ZONE_DEG * DEGREE_M / f64::from(1u32 << level) / across;
        cli::sayln!("  {level:>5}  {spacing_m:>9.2}  {pages:>9}  {bytes:>11}");
    }
}

fn print_collection(info: &CollectionInfo) {
    cli::sayln!(
        "\ncollection {}: {} objects in {} pages, {}",
        info.name,
        info.objects,
        info.pages,
        ByteSize(info.bytes)
    );
    let [west, south, east, north] = info.bounds_deg;
    cli::sayln!("  from {west:.5} {south:.5} to {east:.5} {north:.5} degrees");
    cli::sayln!(
        "  changeover level {} (by the rule for one size: {}), {} objects in coarser cells",
        info.changeover_level,
        info.vgis_level,
        info.large_objects
    );
    if !info.reps.is_empty() {
        cli::sayln!("  rep              pages         bytes    objects  error_m");
        for rep in &info.reps {
            let kind = if rep.rep < FIRST_GROUPS { "objects" } else { "groups" };
            cli::sayln!(
                "  {:>3} {kind:<8} {:>9} {:>13} {:>10} {:>8.2}",
                rep.rep,
                rep.pages,
                rep.bytes,
                rep.objects,
                rep.error_max_m
            );
        }
    }
    cli::sayln!("  work of a query   level     cells   objects     large     pages      cost");
    for point in &info.cost_curve {
        let chosen = if point.level == info.changeover_level { " <" } else { "" };
        cli::sayln!(
            "                    {:>5} {:>9.2} {:>9.2} {:>9.2} {:>9.3} {:>9.2}{chosen}",
            point.level,
            point.cells,
            point.objects,
            point.large_objects,
            point.pages,
            point.cost
        );
    }
    for (what, counts) in [("repaired", &info.repaired), ("set aside", &info.set_aside)] {
        for (reason, count) in counts {
            cli::sayln!("  {what}: {count} ({reason})");
        }
    }
    if !info.attributes.is_empty() {
        cli::sayln!("  attributes: {}", info.attributes.join(", "));
    }
}
