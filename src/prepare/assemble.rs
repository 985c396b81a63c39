//! The last stage: finished pages into packs, index trees and manifest.

use super::Recipe;
use super::buildings::ObjectsPage;
use super::collections::Collection;
use super::pipeline::{BuildError, BuildOptions, Control, for_each_cell};
use super::stage::Stages;
use super::task::Task;
use crate::forest::index::{IndexTree, NodeInfo, ObjectsBelow, ObjectsEntry, Place, TerrainEntry, mark_alone};
use crate::forest::{CellId, Zone};
use crate::store::{Additions, Existing, Manifest, SourceInfo, StoreError, World, WorldWriter};
use std::collections::BTreeMap;
use std::path::Path;

/// Refuses a place where no world can be written, before any work is done.
pub fn check_target(out: &Path, replace: bool) -> Result<(), StoreError> {
    let holds_world = out.join("world.json").exists();
    if holds_world && !replace {
        return Err(StoreError::Exists(out.to_owned()));
    }
    let is_occupied = std::fs::read_dir(out).is_ok_and(|mut entries| entries.next().is_some());
    if out.is_file() || (is_occupied && !holds_world) {
        return Err(StoreError::Occupied(out.to_owned()));
    }
    Ok(())
}

/// Writes the world and puts it in its place.
pub fn world(
    recipe: &Recipe,
    hash: u64,
    options: &BuildOptions,
    stages: &Stages,
    sources: Vec<SourceInfo>,
    collections: Vec<Collection>,
    control: &Control,
) -> Result<Manifest, BuildError> {
    let task = Task::new(
        "write world",
        options.out.display().to_string(),
        Zone::COUNT as u64,
        control.stop,
        control.on_progress,
    );
    let existing = if options.replace { Existing::Replace } else { Existing::Refuse };
    let mut writer = WorldWriter::create(&options.out, existing)?;
    let mut trees = Vec::new();
    let mut height_range_m = (f64::INFINITY, f64::NEG_INFINITY);
    for zone in Zone::all() {
        task.step()?;
        let nodes = pages_of(zone, stages, &collections, &mut writer)?;
        if let Some(root) = nodes.get(&zone.root()) {
            height_range_m = union(height_range_m, root.height_range_m);
        }
        trees.push(IndexTree::build(zone, &nodes)?);
    }
    let manifest = Manifest {
        version: Manifest::VERSION,
        name: recipe.name.clone(),
        datum: Manifest::DATUM.to_owned(),
        recipe_hash: format!("{hash:016x}"),
        terrain: None,
        imagery: None,
        collections: collections.into_iter().map(|collection| collection.info).collect(),
        sources,
        height_range_m,
        zones: Vec::new(),
        index_bytes: 0,
        pack_bytes: 0,
        views: recipe.views(),
        additions: Additions::default(),
    };
    writer.finish(manifest, &trees)?;
    Ok(World::open(&options.out)?.manifest().clone())
}

/// Lowest and highest, metres.
pub(super) type Range = (f64, f64);

pub(super) fn union(a: Range, b: Range) -> Range {
    (a.0.min(b.0), a.1.max(b.1))
}

/// Appends the pages of a zone to its pack; returns what its index is to know.
fn pages_of(
    zone: Zone,
    stages: &Stages,
    collections: &[Collection],
    writer: &mut WorldWriter,
) -> Result<BTreeMap<CellId, NodeInfo>, BuildError> {
    let mut nodes: BTreeMap<CellId, NodeInfo> = BTreeMap::new();
    let mut grounds: BTreeMap<CellId, Range> = BTreeMap::new();
    for_each_cell(stages, zone, &mut |cell, pages| {
        let node = nodes.entry(cell).or_default();
        if let Some(terrain) = pages.terrain {
            let place = writer.append(zone, &terrain.bytes)?;
            node.terrain = Some(TerrainEntry { place, error_m: terrain.error_m });
            let (low, high) = terrain.height_range_m;
            grounds.insert(cell, (f64::from(low), f64::from(high)));
        }
        if let Some(imagery) = pages.imagery {
            let place = writer.append(zone, &imagery)?;
            node.imagery = Some(place);
        }
        Ok(())
    })?;
    let mut objects: BTreeMap<CellId, Range> = BTreeMap::new();
    for (number, collection) in collections.iter().enumerate() {
        collection.for_each_page(zone, stages, &mut |page| {
            let place = writer.append(zone, &page.bytes)?;
            add_objects(&mut nodes, &page, number as u8, place);
            let range = objects.entry(page.root).or_insert(page.height_range_m);
            *range = union(*range, page.height_range_m);
            Ok(())
        })?;
    }
    mark_alone(&mut nodes);
    close(&mut nodes, &grounds, &objects);
    Ok(nodes)
}

/// Tells a page's root of it, and, of the finest rep, all cells above of the size of its objects.
pub(super) fn add_objects(nodes: &mut BTreeMap<CellId, NodeInfo>, page: &ObjectsPage, collection: u8, place: Place) {
    let ObjectsPage { rep, error_m, dimension_m, .. } = *page;
    if rep == 0 {
        for cell in page.root.ancestors() {
            let node = nodes.entry(cell).or_default();
            node.dimension_m = node.dimension_m.max(dimension_m);
            node.reach_m = node.reach_m.max(page.reach_m);
        }
    }
    let node = nodes.entry(page.root).or_default();
    let dimension_m = if rep == 0 { dimension_m } else { 0.0 };
    node.objects.push(ObjectsEntry { collection, rep, place, dimension_m, error_m });
    if let Some(dimension_m) = page.below_dimension_m {
        node.below.push(ObjectsBelow { collection, dimension_m, alone: false });
    }
}

/// Height ranges of subtrees: of what is drawn there, which is the nearest ancestor's ground where a cell has none.
fn close(nodes: &mut BTreeMap<CellId, NodeInfo>, grounds: &BTreeMap<CellId, Range>, objects: &BTreeMap<CellId, Range>) {
    let ground = |cell: CellId| cell.ancestors().find_map(|above| grounds.get(&above).copied()).unwrap_or((0.0, 0.0));
    let cells: Vec<CellId> = nodes.keys().copied().collect();
    let mut ranges: BTreeMap<CellId, Range> = BTreeMap::new();
    // Children come after their parents in the order of cells.
    for &cell in cells.iter().rev() {
        let mut range = ground(cell);
        for more in [objects.get(&cell), ranges.get(&cell)].into_iter().flatten() {
            range = union(range, *more);
        }
        if let Some(parent) = cell.parent() {
            let above = ranges.entry(parent).or_insert(range);
            *above = union(*above, range);
        }
        if let Some(node) = nodes.get_mut(&cell) {
            node.height_range_m = range;
        }
    }
}
