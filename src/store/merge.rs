//! Index and description of worlds that lie over one another.
//!
//! A page is that of the first world that has it, so pictures and terrain go on in another world only where those named
//! before end. Bounds hold for what is drawn: heights of the worlds whose terrain or objects lie in a subtree, errors
//! that never grow downwards.

use super::error::StoreError;
use super::manifest::{CollectionInfo, Manifest};
use super::stack::{Row, refused};
use super::views::bookmarks;
use super::world::World;
use super::writer::{Layer, layer};
use super::{Additions, NamedView};
use crate::forest::index::{
    IndexError, IndexForest, IndexTree, Node, NodeInfo, ObjectsBelow, ObjectsEntry, Place, TerrainEntry, mark_alone,
};
use crate::forest::{CellId, Zone};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use xxhash_rust::xxh3::Xxh3;

/// Worlds by bit.
type Worlds = u32;

const _: () = assert!(super::stack::STACK_WORLDS_MAX <= Worlds::BITS as usize);

pub(super) fn index(worlds: &[Arc<World>], first: &[u8], rows: &mut [Row]) -> Result<IndexForest, StoreError> {
    let zones: Vec<Zone> =
        Zone::all().filter(|&zone| worlds.iter().any(|world| world.index().tree(zone).is_some())).collect();
    let merge = |&zone: &Zone| {
        let mut row = rows[zone.index()].clone();
        let trees: Vec<Option<&IndexTree>> = worlds.iter().map(|world| world.index().tree(zone)).collect();
        let mut merge = Merge { trees, first, row: &mut row, cells: BTreeMap::new() };
        merge.gather();
        merge.bound();
        let mut nodes = merge.cells.into_iter().map(|(cell, known)| (cell, known.info)).collect();
        mark_alone(&mut nodes);
        // What does not fit is the sum: the last world is the one too many.
        let nowhere = || StoreError::NotAWorld(PathBuf::new());
        let too_much =
            |error: IndexError| worlds.last().map_or_else(nowhere, |world| refused(world, error.to_string()));
        Ok((IndexTree::build(zone, &nodes).map_err(too_much)?, row))
    };
    let merged: Vec<(IndexTree, Row)> = zones.par_iter().map(merge).collect::<Result<_, StoreError>>()?;
    let mut index = IndexForest::default();
    for (tree, row) in merged {
        rows[tree.zone().index()] = row;
        index.insert(tree);
    }
    Ok(index)
}

/// A zone while it is put together.
struct Merge<'a> {
    trees: Vec<Option<&'a IndexTree>>,
    first: &'a [u8],
    row: &'a mut Row,
    cells: BTreeMap<CellId, Known>,
}

/// What comes together in a cell.
#[derive(Default)]
struct Known {
    info: NodeInfo,
    terrain_world: Option<usize>,
    imagery_world: Option<usize>,
    /// In the worlds' own packs.
    imagery: Option<Place>,
    terrain: Option<TerrainEntry>,
    /// Heights by world, of those that have the cell.
    ranges_m: Vec<(usize, (f64, f64))>,
    /// Worlds with objects in the subtree.
    with_objects: Worlds,
}

impl Merge<'_> {
    fn gather(&mut self) {
        for world in 0..self.trees.len() {
            let Some(tree) = self.trees[world] else { continue };
            for node in tree.nodes() {
                let (objects, below) = (self.objects(world, &node), self.below(world, &node));
                let known = self.cells.entry(node.cell()).or_default();
                known.add(world, &node, objects);
                known.info.below.extend(below);
            }
        }
        for known in self.cells.values_mut() {
            known.set_places(self.row);
        }
    }

    fn objects(&self, world: usize, node: &Node<'_>) -> Vec<ObjectsEntry> {
        let start = self.row.starts[world];
        let entry = |entry: ObjectsEntry| ObjectsEntry {
            collection: entry.collection.wrapping_add(self.first[world]),
            place: Place { offset: entry.place.offset + start, ..entry.place },
            ..entry
        };
        node.objects().map(entry).collect()
    }

    fn below(&self, world: usize, node: &Node<'_>) -> Vec<ObjectsBelow> {
        let first = self.first[world];
        let moved = |below: ObjectsBelow| ObjectsBelow { collection: below.collection.wrapping_add(first), ..below };
        node.objects_below().map(moved).collect()
    }

    /// Heights and errors, from below.
    fn bound(&mut self) {
        let cells: Vec<CellId> = self.cells.keys().copied().collect();
        // Children come after their parents in the order of cells.
        for &cell in cells.iter().rev() {
            let range_m = self.range_m(cell);
            let Some(known) = self.cells.get_mut(&cell) else { continue };
            known.info.height_range_m = range_m;
            let objects = known.with_objects;
            let error_m = known.info.terrain.map_or(0.0, |terrain| terrain.error_m);
            let Some(parent) = cell.parent().and_then(|parent| self.cells.get_mut(&parent)) else { continue };
            parent.with_objects |= objects;
            if let Some(terrain) = &mut parent.info.terrain {
                terrain.error_m = terrain.error_m.max(error_m);
            }
            parent.below(range_m);
        }
    }

    fn range_m(&self, cell: CellId) -> (f64, f64) {
        let Some(known) = self.cells.get(&cell) else { return (0.0, 0.0) };
        let ground_m = self.ground_m(cell);
        let mut range_m = if known.info.height_range_m.0 <= known.info.height_range_m.1 {
            union(ground_m, known.info.height_range_m)
        } else {
            ground_m
        };
        for &(world, own_m) in &known.ranges_m {
            if known.with_objects & bit(world) != 0 {
                // Its objects may be set on that ground.
                range_m = union(range_m, union(own_m, (ground_m.0, ground_m.1 + own_m.1 - own_m.0)));
            }
        }
        range_m
    }

    /// Heights that the world whose terrain is drawn in a cell tells of it, or of the nearest cell above that it has.
    fn ground_m(&self, cell: CellId) -> (f64, f64) {
        let mut above = cell.ancestors().filter_map(|cell| self.cells.get(&cell));
        let Some(world) = above.find_map(|known| known.terrain_world) else { return (0.0, 0.0) };
        let of_world = |known: &Known| known.ranges_m.iter().find(|(at, _)| *at == world).map(|(_, range_m)| *range_m);
        cell.ancestors().filter_map(|cell| self.cells.get(&cell)).find_map(of_world).unwrap_or((0.0, 0.0))
    }
}

impl Known {
    fn add(&mut self, world: usize, node: &Node<'_>, objects: Vec<ObjectsEntry>) {
        if self.ranges_m.is_empty() {
            self.info.height_range_m = (f64::INFINITY, f64::NEG_INFINITY);
        }
        self.ranges_m.push((world, node.height_range_m()));
        if let (None, Some(terrain)) = (self.terrain_world, node.terrain()) {
            (self.terrain_world, self.terrain) = (Some(world), Some(terrain));
        }
        if let (None, Some(imagery)) = (self.imagery_world, node.imagery()) {
            (self.imagery_world, self.imagery) = (Some(world), Some(imagery));
        }
        if node.dimension_m() > 0.0 {
            self.with_objects |= bit(world);
        }
        self.info.dimension_m = self.info.dimension_m.max(node.dimension_m());
        self.info.reach_m = self.info.reach_m.max(node.reach_m());
        self.info.objects.extend(objects);
    }

    fn below(&mut self, range_m: (f64, f64)) {
        self.info.height_range_m = union(self.info.height_range_m, range_m);
    }

    /// Places in the whole: those of one world move together.
    fn set_places(&mut self, row: &mut Row) {
        let moved = |world: usize, place: Place, row: &Row| Place { offset: place.offset + row.starts[world], ..place };
        let (terrain, imagery) = (self.terrain_world.zip(self.terrain), self.imagery_world.zip(self.imagery));
        match (terrain, imagery) {
            (Some((a, terrain)), Some((b, imagery))) if a != b => {
                let [first, second] = row.splice([(a, terrain.place), (b, imagery)]);
                self.info.terrain = Some(TerrainEntry { place: first, ..terrain });
                self.info.imagery = Some(second);
            }
            _ => {
                self.info.terrain =
                    terrain.map(|(world, entry)| TerrainEntry { place: moved(world, entry.place, row), ..entry });
                self.info.imagery = imagery.map(|(world, place)| moved(world, place, row));
            }
        }
    }
}

fn bit(world: usize) -> Worlds {
    1 << world
}

fn union(a: (f64, f64), b: (f64, f64)) -> (f64, f64) {
    (a.0.min(b.0), a.1.max(b.1))
}

/// The description of the whole.
pub(super) fn manifest(worlds: &[Arc<World>], index: &IndexForest) -> Manifest {
    let trees: Vec<IndexTree> = index.trees().cloned().collect();
    let manifests = || worlds.iter().map(|world| world.manifest());
    let names: Vec<&str> = manifests().map(|manifest| manifest.name.as_str()).collect();
    let mut hash = Xxh3::new();
    manifests().for_each(|manifest| hash.update(manifest.recipe_hash.as_bytes()));
    let heights = index.trees().map(|tree| tree.root().height_range_m());
    let all = manifests().map(|manifest| manifest.height_range_m).chain(heights);
    let mut zones: Vec<u8> = trees.iter().map(|tree| tree.zone().index() as u8).collect();
    zones.sort_unstable();
    Manifest {
        version: Manifest::VERSION,
        name: names.join(" + "),
        datum: Manifest::DATUM.to_owned(),
        recipe_hash: format!("{:016x}", hash.digest()),
        terrain: layer(&trees, Layer::Terrain),
        imagery: layer(&trees, Layer::Imagery),
        collections: collections(worlds),
        sources: manifests().flat_map(|manifest| manifest.sources.clone()).collect(),
        height_range_m: all.fold((f64::INFINITY, f64::NEG_INFINITY), union),
        zones,
        index_bytes: manifests().map(|manifest| manifest.index_bytes).sum(),
        pack_bytes: manifests().map(|manifest| manifest.pack_bytes).sum(),
        views: views(worlds),
        additions: Additions::default(),
    }
}

/// Those of all worlds; a name that is taken gets its world's behind it, and then a number.
fn collections(worlds: &[Arc<World>]) -> Vec<CollectionInfo> {
    let mut all: Vec<CollectionInfo> = Vec::new();
    for world in worlds {
        for info in &world.manifest().collections {
            let plain = std::iter::once(info.name.clone());
            let of_world = format!("{} ({})", info.name, world.manifest().name);
            let numbered = (2..).map(|number| format!("{of_world} {number}"));
            let names = plain.chain(std::iter::once(of_world.clone())).chain(numbered);
            let free = names.into_iter().find(|name| all.iter().all(|other| other.name != *name));
            all.push(CollectionInfo { name: free.unwrap_or_default(), ..info.clone() });
        }
    }
    all
}

/// The views of each world; where some have none of their own, what would be offered of those alone, the globe apart.
fn views(worlds: &[Arc<World>]) -> Vec<NamedView> {
    if worlds.iter().all(|world| world.manifest().views.is_empty()) {
        return Vec::new();
    }
    let of_world = |world: &Arc<World>| bookmarks(world.manifest(), world.index()).into_iter().skip(1);
    worlds.iter().flat_map(of_world).collect()
}
