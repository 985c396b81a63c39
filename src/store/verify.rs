//! Looks at all of a world: every page, checksum, link and bound.

use super::StoreError;
use super::pack::{self, PageRange};
use super::world::World;
use super::writer::{Layer, layer};
use crate::content::{ObjectPage, Page, PageFile, PageId, PageKind, TerrainPage};
use crate::forest::Zone;
use crate::forest::index::{IndexForest, IndexTree, Node, Place};
use rayon::prelude::*;
use std::borrow::Cow;

/// Runs of pages that are read together, between two calls of the progress function; with the next bounds what is in
/// memory.
const BATCH: usize = 32;
/// Pages that lie end to end are read as one up to so many bytes, or are one that is longer.
const RUN_BYTES: u64 = 256 << 10;
/// Heights and sizes in the index are rounded outwards; pages may differ from what was measured by their units.
const SLACK_M: f64 = 0.02;

/// Something wrong.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Problem {
    /// The file or the cell.
    pub place: String,
    pub what: String,
}

/// The result of a check.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct Verified {
    pub nodes: u64,
    pub pages: u64,
    pub bytes: u64,
    /// Bytes of packs that belong to no page, in zones that were changed since the world was made.
    pub unused_bytes: u64,
    pub problems: Vec<Problem>,
}

impl Verified {
    fn add(&mut self, place: impl ToString, what: impl ToString) {
        self.problems.push(Problem { place: place.to_string(), what: what.to_string() });
    }
}

impl World {
    /// Checks everything that can be checked without the sources; `progress` gets pages done and pages in all.
    pub fn verify(&self, progress: &mut dyn FnMut(u64, u64)) -> Verified {
        let mut result = Verified::default();
        let mut tasks = Vec::new();
        let index = match self.whole_index() {
            Ok(index) => index,
            Err(error) => {
                result.add("index", error);
                return result;
            }
        };
        for tree in index.trees() {
            let mut places = Vec::new();
            for node in tree.nodes() {
                result.nodes += 1;
                check_children(&node, &mut result);
                places.extend(pages(&node));
            }
            self.check_coverage(tree.zone(), &places, &mut result);
            tasks.extend(places);
        }
        self.check_manifest(&index, &mut result);
        result.pages = tasks.len() as u64;
        result.bytes = tasks.iter().map(|(_, place)| u64::from(place.len)).sum();
        let mut done = 0;
        for batch in runs(tasks).chunks(BATCH) {
            result.problems.extend(self.check_runs(&index, batch));
            done += batch.iter().map(|run| run.pages.len() as u64).sum::<u64>();
            progress(done, result.pages);
        }
        result
    }

    fn check_runs(&self, index: &IndexForest, runs: &[Run]) -> Vec<Problem> {
        let ranges: Vec<PageRange<'_>> = runs.iter().map(Run::range).collect();
        let read = self.read_ranges(&ranges);
        let check = |(run, (range, read)): (&Run, (&PageRange<'_>, &Result<Vec<u8>, StoreError>))| {
            let bytes = |place| read.as_ref().ok()?.get(range.part(place)?);
            let pages = run.pages.iter().zip(&run.places);
            pages.flat_map(|(&page, &place)| self.check_stored(index, page, place, bytes(place))).collect::<Vec<_>>()
        };
        runs.par_iter().zip(ranges.par_iter().zip(&read)).flat_map_iter(check).collect()
    }

    /// `bytes`: where its run could be read; else each page tells for itself.
    fn check_stored(&self, index: &IndexForest, id: PageId, place: Place, bytes: Option<&[u8]>) -> Vec<Problem> {
        let read = bytes.map_or_else(|| self.read(id, place).map(Cow::Owned), |bytes| Ok(Cow::Borrowed(bytes)));
        match read {
            Ok(bytes) => self.check_page(index, id, place, &bytes),
            Err(error) => vec![Problem { place: id.cell.to_string(), what: error.to_string() }],
        }
    }

    fn check_page(&self, index: &IndexForest, id: PageId, place: Place, bytes: &[u8]) -> Vec<Problem> {
        let page = match self.decode(id, place, bytes) {
            Ok(page) => page,
            Err(error) => return vec![Problem { place: id.cell.to_string(), what: error.to_string() }],
        };
        let mut result = Verified::default();
        let Some(node) = index.find(id.cell) else { return Vec::new() };
        match page {
            Page::Terrain(page) => check_terrain(&node, &page, &mut result),
            Page::Imagery(_) | Page::Segment(_) => {}
            Page::Objects(page, _) => {
                check_objects(&node, &page, &mut result);
                match self.attributes(id, place, bytes) {
                    Err(error) => result.add(id.cell, error),
                    Ok(texts) if !texts.is_empty() && texts.len() != page.objects.len() => {
                        result.add(id.cell, format!("{} attributes for {} objects", texts.len(), page.objects.len()));
                    }
                    Ok(_) => {}
                }
            }
        }
        result.problems
    }

    /// Every byte of a pack belongs to exactly one page, or to none where a change took it away.
    fn check_coverage(&self, zone: Zone, places: &[(PageId, Place)], result: &mut Verified) {
        let name = self.source().pack_name(zone);
        let len = match self.source().pack_len(zone) {
            Ok(len) => len,
            Err(error) => return result.add(name.display(), error),
        };
        let files = self.manifest().additions.of(zone);
        let starts = files.map_or_else(|| vec![0], |files| files.starts().take(files.packs.len()).collect());
        let headers = starts.into_iter().map(|offset| Place { offset, len: pack::HEADER_BYTES as u32 });
        let mut sorted: Vec<Place> = places.iter().map(|&(_, place)| place).chain(headers).collect();
        sorted.sort_unstable_by_key(|place| place.offset);
        let mut end = 0;
        for place in sorted {
            if files.is_some() && place.offset > end {
                result.unused_bytes += place.offset - end;
            } else if place.offset != end {
                let what = if place.offset > end { "belong to no page" } else { "belong to two pages" };
                let (from, to) = (end.min(place.offset), end.max(place.offset));
                result.add(name.display(), format!("bytes {from} to {to} {what}"));
            }
            end = end.max(place.offset + u64::from(place.len));
        }
        if files.is_some() && end < len {
            result.unused_bytes += len - end;
        } else if end != len {
            result.add(name.display(), format!("it has {len} bytes, its pages end at {end}"));
        }
    }

    fn check_manifest(&self, index: &IndexForest, result: &mut Verified) {
        let manifest = self.manifest();
        let trees: Vec<IndexTree> = index.trees().cloned().collect();
        let layers = [
            ("terrain", &manifest.terrain, layer(&trees, Layer::Terrain)),
            ("imagery", &manifest.imagery, layer(&trees, Layer::Imagery)),
        ];
        for (name, told, found) in layers {
            if *told != found {
                result.add("world.json", format!("pages and bytes of {name} are not those of the index"));
            }
        }
        let bytes: u64 = index.trees().filter_map(|tree| self.source().pack_len(tree.zone()).ok()).sum();
        if bytes != manifest.pack_bytes {
            result.add("world.json", format!("it tells {} bytes of packs, there are {bytes}", manifest.pack_bytes));
        }
        let told = manifest.additions.unused_bytes;
        if result.unused_bytes != told {
            let what = format!("it tells {told} unused bytes, there are {}", result.unused_bytes);
            result.add("world.json", what);
        }
        for (at, collection) in manifest.collections.iter().enumerate() {
            let entries = trees.iter().flat_map(IndexTree::nodes).flat_map(|node| node.objects());
            let pages = entries.filter(|entry| usize::from(entry.collection) == at).count() as u64;
            if pages != collection.pages {
                let what = format!("collection {} has {} pages, {pages} are there", collection.name, collection.pages);
                result.add("world.json", what);
            }
        }
    }
}

/// Pages of a zone that lie end to end; at least one.
struct Run {
    pages: Vec<PageId>,
    places: Vec<Place>,
}

impl Run {
    fn range(&self) -> PageRange<'_> {
        let (first, last) = (self.places[0], self.places[self.places.len() - 1]);
        let place = Place { offset: first.offset, len: (last.offset - first.offset) as u32 + last.len };
        PageRange { zone: self.pages[0].cell.zone(), file: PageFile::Pack, place, pages: &self.places }
    }

    fn goes_on(&self, page: PageId, place: Place) -> bool {
        let Place { offset, len } = self.range().place;
        let is_next = self.pages[0].cell.zone() == page.cell.zone() && offset + u64::from(len) == place.offset;
        is_next && u64::from(len) + u64::from(place.len) <= RUN_BYTES
    }
}

fn runs(mut pages: Vec<(PageId, Place)>) -> Vec<Run> {
    pages.sort_by_key(|(page, place)| (page.cell.zone(), place.offset));
    let mut runs: Vec<Run> = Vec::new();
    for (page, place) in pages {
        match runs.last_mut().filter(|run| run.goes_on(page, place)) {
            Some(run) => {
                run.pages.push(page);
                run.places.push(place);
            }
            None => runs.push(Run { pages: vec![page], places: vec![place] }),
        }
    }
    runs
}

/// The pages of a node.
fn pages(node: &Node<'_>) -> Vec<(PageId, Place)> {
    let id = |kind| PageId { cell: node.cell(), kind };
    let terrain = node.terrain().map(|terrain| (id(PageKind::Terrain), terrain.place));
    let imagery = node.imagery().map(|place| (id(PageKind::Imagery), place));
    let objects = node
        .objects()
        .map(|entry| (id(PageKind::Objects { collection: entry.collection, rep: entry.rep }), entry.place));
    terrain.into_iter().chain(imagery).chain(objects).collect()
}

/// Bounds never grow from parent to child.
fn check_children(node: &Node<'_>, result: &mut Verified) {
    let (low_m, high_m) = node.height_range_m();
    if low_m > high_m {
        result.add(node.cell(), format!("its heights run from {low_m} m down to {high_m} m"));
    }
    for child in node.children() {
        let (child_low_m, child_high_m) = child.height_range_m();
        if child_low_m < low_m || child_high_m > high_m {
            result.add(child.cell(), "its heights leave its parent's range");
        }
        if child.dimension_m() > node.dimension_m() || child.reach_m() > node.reach_m() {
            result.add(child.cell(), "its objects are larger than its parent tells");
        }
        if let (Some(own), Some(parent)) = (child.terrain(), node.terrain()) {
            if own.error_m > parent.error_m {
                result.add(
                    child.cell(),
                    format!("its error, {} m, is above its parent's, {} m", own.error_m, parent.error_m),
                );
            }
        } else if child.terrain().is_some() {
            result.add(child.cell(), "it has terrain, its parent has none");
        }
        if child.imagery().is_some() && node.imagery().is_none() {
            result.add(child.cell(), "it has imagery, its parent has none");
        }
    }
}

fn check_terrain(node: &Node<'_>, page: &TerrainPage, result: &mut Verified) {
    let (low_m, high_m) = node.height_range_m();
    let told_m = node.terrain().map(|terrain| terrain.error_m);
    if told_m != Some(page.error_m) {
        result.add(node.cell(), format!("its page has an error of {} m, the index tells {told_m:?}", page.error_m));
    }
    let outside = |height_m: f32| f64::from(height_m) < low_m - SLACK_M || f64::from(height_m) > high_m + SLACK_M;
    if page.posts.iter().any(|post| outside(post.height_m)) {
        result.add(node.cell(), format!("heights leave the index's range of {low_m} to {high_m} m"));
    }
}

fn check_objects(node: &Node<'_>, page: &ObjectPage, result: &mut Verified) {
    let entry = node.objects().find(|entry| entry.collection == page.collection && entry.rep == page.rep);
    let Some(entry) = entry else { return };
    if f64::from(page.error_m) > entry.error_m + SLACK_M && page.rep > 0 {
        result.add(node.cell(), format!("rep {} has an error above what the index tells", page.rep));
    }
    // Groups may be larger than any object of theirs.
    let (told_m, reach_m) = match page.rep {
        0 => (entry.dimension_m.min(node.dimension_m()), node.reach_m()),
        _ => (f64::INFINITY, f64::INFINITY),
    };
    let (_, high_m) = node.height_range_m();
    for object in &page.objects {
        if f64::from(object.dimension_m) > told_m + SLACK_M || f64::from(object.reach_m) > reach_m + SLACK_M {
            result.add(node.cell(), format!("object {} is larger than the index tells", object.id));
        }
        if f64::from(object.top_m) > high_m + SLACK_M {
            result.add(node.cell(), format!("object {} is higher than the index tells", object.id));
        }
    }
}
