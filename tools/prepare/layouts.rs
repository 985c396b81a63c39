//! The single-seek layouts of a recipe: made of the world once it is there.

use super::Shown;
use anyhow::Context;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;
use stoop::engine::{LOOKOUT_PX, Lookout, Source};
use stoop::geodesy::{GeoBounds, Geodetic};
use stoop::layout::{
    BuildError, Builder, Built, ByStorage, CurvePoint, Delays, LayoutParams, SEEN_BELOW_M, Verdict, Witness,
};
use stoop::prepare::{LayoutSection, Progress, Recipe};
use stoop::storage::StorageModel;
use stoop::store::{Manifest, World};
use stoop::units::ByteSize;

/// What the pictures that tell the hidden from the seen are drawn within.
const LOOKOUT_FOOTPRINT: ByteSize = ByteSize(1 << 30);

/// Makes each `[[layout]]` of a recipe over a world in a folder.
pub fn build(recipe: &Recipe, world: &Path, shown: &Shown, stop: &AtomicBool) -> anyhow::Result<()> {
    for section in &recipe.layout {
        let world = World::open_whole(world)?;
        let started = Instant::now();
        let builder = builder(section, &world)
            .with_context(|| format!("{}: [[layout]] {:?}", recipe.path.display(), section.name))?;
        let mut witness = witness(&builder, &world)?;
        let progress = |item: &str, done: usize, of: usize| {
            shown.progress(&Progress { stage: "layout", item, done: done as u64, total: of as u64 });
            !stop.load(Ordering::Relaxed)
        };
        let built = match builder.build(&mut witness, &progress) {
            Err(BuildError::Stopped) => return Err(Stopped.into()),
            built => built?,
        };
        shown.layout(section, &built, started.elapsed().as_secs_f64());
    }
    Ok(())
}

/// Stopped by the user: nothing of the layout was kept.
#[derive(Debug, thiserror::Error)]
#[error("stopped; the world is whole, the layout was not written: the same command with --into makes it")]
pub struct Stopped;

fn builder<'w>(section: &LayoutSection, world: &'w World) -> anyhow::Result<Builder<'w>> {
    let storage: StorageModel = section.storage.parse()?;
    let views = &world.manifest().views;
    let start = |view: &stoop::store::NamedView| Geodetic::from_degrees(view.lat_deg, view.lon_deg, view.height_m);
    Ok(Builder {
        world,
        name: section.name.clone(),
        params: LayoutParams::for_viewport(section.viewport_h_px, section.tolerance_px),
        region: region(section, world.manifest())?,
        bands_m: section.altitude_bands_m.clone(),
        storage,
        max_redundancy: section.max_redundancy,
        side_m: section.side_m,
        starts: views.iter().map(start).collect(),
    })
}

fn region(section: &LayoutSection, manifest: &Manifest) -> anyhow::Result<GeoBounds> {
    let named = || {
        let name = section.collection.as_deref().unwrap_or_default();
        let known: Vec<&str> = manifest.collections.iter().map(|info| info.name.as_str()).collect();
        let found = manifest.collections.iter().find(|info| info.name == name);
        found
            .map(|info| info.bounds_deg)
            .with_context(|| format!("no collection is named {name:?}: name one of {known:?}, or write region_deg"))
    };
    let [west, south, east, north] = section.region_deg.map_or_else(named, Ok)?;
    Ok(GeoBounds::from_degrees(west, south, east, north))
}

/// Who sees what is hidden, where a band asks for that.
fn witness(builder: &Builder<'_>, world: &World) -> anyhow::Result<Option<Box<dyn Witness>>> {
    if !builder.bands_m.windows(2).any(|band| band[1] <= SEEN_BELOW_M) {
        return Ok(None);
    }
    let source = Source::of(World::open(world.name())?);
    let lookout = Lookout::new(source, &builder.params, LOOKOUT_PX, LOOKOUT_FOOTPRINT)
        .context("bands below 50 m need pictures of what is in sight; leave them out of altitude_bands_m otherwise")?;
    Ok(Some(Box::new(lookout)))
}

impl Shown {
    fn layout(&self, section: &LayoutSection, built: &Built, seconds: f64) {
        self.clear();
        if self.json {
            let line = serde_json::json!({
                "event": "layout", "name": section.name, "storage": section.storage, "seconds": seconds,
                "curve": built.curve, "point": built.point, "by_storage": built.by_storage, "hidden": built.hidden,
                "file": built.file, "file_bytes": built.file_bytes, "head_bytes": built.head_bytes,
                "answer": answer(section, built),
            });
            println!("{line}");
            return;
        }
        self.line(&format!("layout {}: {seconds:.1} s, by the storage model {}", section.name, section.storage));
        if !built.curve.is_empty() {
            self.line(&header());
            built.curve.iter().for_each(|point| self.line(&row(point)));
        }
        if let Some(point) = &built.point {
            self.line("taken, all crossings:");
            self.line(&header());
            self.line(&row(point));
            self.line("crossings, ms in the mean and at worst:");
            storages(built).iter().for_each(|line| self.line(line));
        }
        if built.hidden.of_pages > 0 {
            let share = 100.0 * built.hidden.bytes as f64 / built.hidden.of_bytes.max(1) as f64;
            self.line(&format!("hidden below {SEEN_BELOW_M} m: {share:.1} % of the bytes of sets"));
        }
        self.line(&answer(section, built));
    }
}

fn header() -> String {
    let columns = [
        ("side m", 7),
        ("cells", 7),
        ("redundancy", 11),
        ("lemma 1", 8),
        ("run mean", 11),
        ("lemma 2", 11),
        ("run max", 11),
        ("set max", 11),
        ("ms mean", 8),
        ("worst", 7),
        ("packs mean", 11),
        ("worst", 7),
        ("seeks", 6),
        ("file", 11),
    ];
    columns.map(|(name, width)| format!("{name:>width$}")).concat()
}

fn row(point: &CurvePoint) -> String {
    let size = |bytes: f64| format!("{:>11}", ByteSize(bytes as u64).to_string());
    let (layout, packs) = (&point.layout, &point.packs);
    [
        format!("{:7.0}{:7}", point.side_m, point.cells),
        format!("{:11.1}{:8.1}", point.redundancy, point.predicted.redundancy),
        size(point.run_bytes_mean),
        size(point.predicted.run_bytes),
        size(point.run_bytes_max),
        size(point.set_bytes_max),
        format!("{:8.1}{:7.1}", layout.mean_s * 1e3, layout.max_s * 1e3),
        format!("{:11.1}{:7.1}{:6.1}", packs.mean_s * 1e3, packs.max_s * 1e3, packs.seeks_mean),
        size(point.layout_bytes),
    ]
    .concat()
}

/// What the layout would gain on each kind of storage.
fn storages(built: &Built) -> Vec<String> {
    let line = |by: &ByStorage| {
        let ms = |delays: &Delays| format!("{:8.1} {:8.1}", delays.mean_s * 1e3, delays.max_s * 1e3);
        let said = match by.verdict {
            Verdict::Pays { .. } => "pays",
            Verdict::Useless { .. } => "gains little",
        };
        format!(
            "  {:8} layout {}   packs {}   Hilbert {}   seeks 1 : {:.1} : {:.1}   {said}",
            by.storage,
            ms(&by.layout),
            ms(&by.packs),
            ms(&by.hilbert),
            by.packs.seeks_mean,
            by.hilbert.seeks_mean
        )
    };
    built.by_storage.iter().map(line).collect()
}

/// What was decided, and why.
fn answer(section: &LayoutSection, built: &Built) -> String {
    let percent = |share: f64| 100.0 * share;
    match (&built.point, built.verdict, &built.file) {
        (Some(point), verdict, Some(file)) => {
            let gain = match verdict {
                Some(Verdict::Pays { mean, worst }) => {
                    format!(
                        "crossings take {:.0} % less time in the mean, {:.0} % in the worst case",
                        percent(mean),
                        percent(worst)
                    )
                }
                Some(Verdict::Useless { mean, worst }) => format!(
                    "it was asked for by hand, and gains little on {}: {:.0} % in the mean, {:.0} % in the worst case",
                    section.storage,
                    percent(mean),
                    percent(worst)
                ),
                None => String::new(),
            };
            format!(
                "written: {} ({}, {} in memory, {} entries); cells of {:.0} m; {gain}",
                file.display(),
                ByteSize(built.file_bytes),
                ByteSize(built.head_bytes),
                built.entries,
                point.side_m
            )
        }
        (Some(point), Some(Verdict::Useless { mean, worst }), None) => format!(
            "not written, it is not worth its bytes on {}: with cells of {:.0} m and {:.1} times the bytes crossings take {:.0} % less time in the mean, {:.0} % in the worst case; side_m in the recipe makes it all the same",
            section.storage,
            point.side_m,
            point.redundancy,
            percent(mean),
            percent(worst)
        ),
        _ => format!(
            "not written: no cells keep within a redundancy of {}; the least possible is {:.1}: raise max_redundancy, or leave the lowest bands out",
            section.max_redundancy,
            built.least_redundancy.unwrap_or(f64::INFINITY)
        ),
    }
}
