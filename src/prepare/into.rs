//! `stoop-prepare RECIPE --into WORLD`: adds building sets to a world that stands, or replaces those of the same name.
//!
//! The objects stand on the world's own finest terrain, so no source of its elevation is needed. All other pages keep
//! their bytes; of the index only the zones change in which a set has pages, or had some.

use super::collections::{self, Collection};
use super::graft::Graft;
use super::pipeline::{BuildError, Control, done, half, too_many_collections};
use super::stage::Stages;
use super::task::Task;
use super::world_ground::WorldGround;
use super::{PrepareError, Recipe, assemble, recipe_hash};
use crate::forest::Zone;
use crate::forest::index::IndexTree;
use crate::store::{CollectionChange, Manifest, World, WorldChange};
use crate::units::ByteSize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;
use xxhash_rust::xxh3::Xxh3;

/// What to do.
#[derive(Clone, Debug)]
pub struct IntoOptions {
    /// The world to be changed.
    pub world: PathBuf,
    /// What the recipe's paths are relative to, when not its own folder.
    pub root: Option<PathBuf>,
    /// For decoded terrain, bytes.
    pub memory: ByteSize,
}

/// Adds or replaces the recipe's collections; returns the new manifest. Broken off at any point it leaves the world as
/// it was; finished collections are kept beside it, so that the same command goes on from there.
pub fn build_into(recipe: &Recipe, options: &IntoOptions, control: &Control) -> Result<Manifest, BuildError> {
    check_recipe(recipe)?;
    let root = options.root.as_deref().unwrap_or(recipe.root());
    let fingerprint = recipe_hash::of(recipe, root)?;
    let change = WorldChange::begin(&options.world)?;
    let old = change.world().manifest().clone();
    let hash = mixed(&old.recipe_hash, fingerprint.stages);
    let (stages, was_other) = Stages::open(&stages_beside(&options.world), hash)?;
    if was_other {
        (control.on_note)("the unfinished work beside the world was for other sets or sources: starting afresh");
    }
    let collections = collections_of(recipe, root, &change, half(options.memory), &stages, control)?;
    let started = Instant::now();
    let world_hash = mixed(&old.recipe_hash, fingerprint.world);
    let manifest = write(change, collections, half(options.memory), world_hash, &stages, control)?;
    let bytes = (manifest.pack_bytes + manifest.index_bytes).saturating_sub(old.pack_bytes + old.index_bytes);
    done(control, "write", &options.world.display().to_string(), 0, bytes, started, false);
    stages.remove()?;
    Ok(manifest)
}

/// Sets only: a terrain or a picture would change every page above it, and the objects that stand on it.
fn check_recipe(recipe: &Recipe) -> Result<(), PrepareError> {
    let others = [
        ("[[elevation]]", recipe.elevation.is_empty()),
        ("[[imagery]]", recipe.imagery.is_empty()),
        ("[[view]]", recipe.view.is_empty()),
    ];
    let what = match others.into_iter().find(|(_, is_empty)| !is_empty) {
        Some((section, _)) => format!("{section} cannot be put into a world that stands"),
        None if recipe.buildings.is_empty() => "there is nothing to put into the world".to_owned(),
        None => return Ok(()),
    };
    let remedy = "a recipe for --into holds [[buildings]] only; prepare the rest anew with --out";
    Err(PrepareError::value(recipe.path.display(), "the sections", what, remedy))
}

/// Stages of a change lie apart from those of the making of the same world.
fn stages_beside(world: &Path) -> PathBuf {
    let world = std::fs::canonicalize(world).unwrap_or_else(|_| world.to_owned());
    let mut name = world.file_name().unwrap_or_default().to_owned();
    name.push(".into");
    world.with_file_name(name)
}

/// What was there and what comes to it.
fn mixed(old: &str, new: u64) -> u64 {
    let mut hash = Xxh3::new();
    hash.update(old.as_bytes());
    hash.update(&new.to_le_bytes());
    hash.digest()
}

/// The recipe's collections by their number in the world: that of the one of the same name, or the next.
fn collections_of(
    recipe: &Recipe,
    root: &Path,
    change: &WorldChange,
    memory: ByteSize,
    stages: &Stages,
    control: &Control,
) -> Result<BTreeMap<u8, Collection>, BuildError> {
    let known = &change.world().manifest().collections;
    let ground = WorldGround::new(change.world(), memory);
    let vertical = collections::vertical_of(recipe);
    let mut next = known.len();
    let mut made = BTreeMap::new();
    for section in &recipe.buildings {
        let started = Instant::now();
        let number = known.iter().position(|info| info.name == section.name).unwrap_or_else(|| {
            next += 1;
            next - 1
        });
        let number = u8::try_from(number).ok().filter(|&number| number < u8::MAX);
        let number = number.ok_or_else(|| too_many_collections(recipe))?;
        let task = Task::new("objects", &section.name, 0, control.stop, control.on_progress);
        task.step()?;
        let kept = collections::kept(number.into(), stages)?;
        let resumed = kept.is_some();
        let collection = match kept {
            Some(collection) => collection,
            None => {
                let on_progress = control.on_progress;
                let check = || {
                    task.go_on()?;
                    ground.failure().map_or(Ok(()), |failure| Err(failure.into()))
                };
                let order = collections::Order { section, number, root, vertical, stages, on_progress };
                ground.with(|ground| collections::prepare(&order, ground, &check))?
            }
        };
        let info = &collection.info;
        done(control, "objects", &section.name, info.objects, info.bytes, started, resumed);
        made.insert(number, collection);
    }
    Ok(made)
}

/// Writes pages and index of each zone that changes, then the manifest.
fn write(
    mut change: WorldChange,
    collections: BTreeMap<u8, Collection>,
    memory: ByteSize,
    hash: u64,
    stages: &Stages,
    control: &Control,
) -> Result<Manifest, BuildError> {
    let world = change.world().manifest().clone();
    let replaced: Vec<u8> =
        collections.keys().copied().filter(|&number| usize::from(number) < world.collections.len()).collect();
    let changed: Vec<Zone> =
        Zone::all().filter(|&zone| is_changed(zone, change.world(), &collections, &replaced)).collect();
    let task = Task::new(
        "write into the world",
        change.world().name().display().to_string(),
        0,
        control.stop,
        control.on_progress,
    );
    let mut unused_bytes = 0;
    let mut roots: BTreeMap<Zone, assemble::Range> =
        change.world().index().trees().map(|tree| (tree.zone(), tree.root().height_range_m())).collect();
    for zone in changed {
        let mut graft = Graft::new(zone, change.world().index().tree(zone));
        replaced.iter().for_each(|&number| graft.remove(number));
        for (&number, collection) in &collections {
            collection.for_each_page(zone, stages, &mut |page| {
                task.step()?;
                let place = change.append(zone, &page.bytes)?;
                graft.add(number, &page, place);
                Ok(())
            })?;
        }
        unused_bytes += graft.unused_bytes;
        let tree = graft.finish(change.world(), &WorldGround::new(change.world(), memory))?;
        roots.insert(zone, tree.root().height_range_m());
        task.step()?;
        change.put_index(tree)?;
    }
    task.step()?;
    let mut manifest = world;
    manifest.recipe_hash = format!("{hash:016x}");
    manifest.height_range_m = height_range_m(manifest.height_range_m, &collections, roots.into_values());
    let changes = collections.into_iter().map(|(number, collection)| CollectionChange {
        number,
        info: collection.info,
        source: collection.source,
    });
    Ok(change.finish(manifest, changes.collect(), unused_bytes)?)
}

/// Whether a zone gets pages or loses some.
fn is_changed(zone: Zone, world: &World, collections: &BTreeMap<u8, Collection>, replaced: &[u8]) -> bool {
    let gets = collections.values().any(|collection| collection.is_in(zone));
    let nodes = || world.index().tree(zone).into_iter().flat_map(IndexTree::nodes);
    let loses = || nodes().any(|node| node.objects().any(|entry| replaced.contains(&entry.collection)));
    gets || (!replaced.is_empty() && loses())
}

/// The index tells whole metres, what was known before and comes now tells more exactly; both bound what is drawn.
fn height_range_m(
    old: assemble::Range,
    collections: &BTreeMap<u8, Collection>,
    roots: impl Iterator<Item = assemble::Range>,
) -> assemble::Range {
    let exact = collections.values().map(|collection| collection.height_range_m).fold(old, assemble::union);
    let (low_m, high_m) = roots.fold((f64::INFINITY, f64::NEG_INFINITY), assemble::union);
    (exact.0.max(low_m), exact.1.min(high_m))
}
