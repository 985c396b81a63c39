//! Objects into pages, part by part of a collection: planned, encoded, with their groups, counted and handed on.

use super::changeover::Item;
use super::pack::{PAGE_BYTES_MAX, PagePlan, plan};
use super::{
    ObjectsPage, Packing, PageSink, Placed, PrepareError, Progress, bytes_about, encode, item, largest_first, tree,
};
use crate::store::{CollectionInfo, RepInfo};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Pages of a collection so far.
pub struct Packed<'a, 's, E> {
    of: &'a Packing<'a>,
    level: u8,
    sink: &'a mut PageSink<'s, E>,
    reps: BTreeMap<u8, RepInfo>,
    large_objects: u64,
    /// Bytes that some pages took, and what had been estimated for them.
    taken: Option<[u64; 2]>,
    /// Of all outlines: west, south, east, north, radians.
    bounds_rad: [f64; 4],
    pub height_range_m: (f64, f64),
    /// Parts of textures that were scaled down, and that found no room.
    pub textures_scaled: u64,
    pub textures_lost: u64,
}

impl<'a, 's, E: From<PrepareError>> Packed<'a, 's, E> {
    /// Hands pages over at a level.
    pub fn new(of: &'a Packing<'a>, level: u8, sink: &'a mut PageSink<'s, E>) -> Self {
        Self {
            of,
            level,
            sink,
            reps: BTreeMap::new(),
            large_objects: 0,
            taken: None,
            bounds_rad: [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY],
            height_range_m: (f64::INFINITY, f64::NEG_INFINITY),
            textures_scaled: 0,
            textures_lost: 0,
        }
    }

    /// Makes pages of some objects. None of those that come later may live in a cell above or below one of these.
    pub fn add(&mut self, mut objects: Vec<Placed>) -> Result<(), E> {
        let items: Vec<Item> = objects.par_iter().map(item).collect();
        for (object, item) in objects.iter_mut().zip(&items) {
            object.prism.cell = item.home(self.level);
        }
        self.large_objects += items.iter().filter(|item| item.deepest < self.level).count() as u64;
        drop(items);
        objects.par_iter_mut().for_each(Placed::find_plain);
        objects.par_sort_by_cached_key(|object| (object.prism.cell, largest_first(&object.prism)));
        let corners = objects.iter().flat_map(|object| object.prism.rings.iter().flatten());
        self.bounds_rad =
            corners.fold(self.bounds_rad, |b, p| [b[0].min(p[0]), b[1].min(p[1]), b[2].max(p[0]), b[3].max(p[1])]);
        for page in pages(&objects, self.of, &mut self.taken)? {
            self.count(&page);
            (self.sink)(page)?;
        }
        Ok(())
    }

    fn count(&mut self, page: &ObjectsPage) {
        let info = self.reps.entry(page.rep).or_insert(RepInfo { rep: page.rep, ..RepInfo::default() });
        info.pages += 1;
        info.bytes += page.bytes.len() as u64;
        info.objects += page.objects;
        info.error_max_m = info.error_max_m.max(page.error_m);
        self.textures_scaled += page.textures_scaled;
        self.textures_lost += page.textures_lost;
        let range = &mut self.height_range_m;
        *range = (range.0.min(page.height_range_m.0), range.1.max(page.height_range_m.1));
    }

    /// What there is, of as many objects.
    pub fn finish(self, objects: u64) -> CollectionInfo {
        let reps: Vec<RepInfo> = self.reps.into_values().collect();
        let is_empty = self.bounds_rad[0] > self.bounds_rad[2];
        CollectionInfo {
            name: self.of.name.to_owned(),
            objects,
            pages: reps.iter().map(|rep| rep.pages).sum(),
            bytes: reps.iter().map(|rep| rep.bytes).sum(),
            reps,
            changeover_level: self.level,
            large_objects: self.large_objects,
            bounds_deg: if is_empty { [0.0; 4] } else { self.bounds_rad.map(f64::to_degrees) },
            ..CollectionInfo::default()
        }
    }
}

/// Packs objects, which must be ordered by cell, into pages and encodes them. `taken` is found out for the first ones.
fn pages(objects: &[Placed], of: &Packing<'_>, taken: &mut Option<[u64; 2]>) -> Result<Vec<ObjectsPage>, PrepareError> {
    let cells = objects.chunk_by(|a, b| a.prism.cell == b.prism.cell);
    let cells: Vec<&[Placed]> = cells.collect();
    let about = |objects: &[Placed]| objects.iter().map(|object| u64::from(bytes_about(object))).sum::<u64>();
    let sizes: Vec<_> = cells.iter().map(|objects| (objects[0].prism.cell, about(objects))).collect();
    let encode = |page: &PagePlan| encode(page, &cells, of.collection, of.name);
    let [took, estimated] = match *taken {
        Some(known) => known,
        None => {
            // A few pages show what the estimate is worth; then all are planned by it.
            let first = plan(&sizes, PAGE_BYTES_MAX);
            let samples: Vec<&PagePlan> = first.iter().step_by(first.len().div_ceil(8).max(1)).collect();
            let took = samples.par_iter().map(|page| encode(page).map(|page| page.bytes.len() as u64));
            let took: u64 = took.collect::<Result<Vec<_>, _>>()?.into_iter().sum();
            *taken.insert([took, samples.iter().map(|page| page.bytes).sum()])
        }
    };
    let scaled: Vec<_> = sizes.iter().map(|&(cell, bytes)| (cell, (bytes * took).div_ceil(estimated.max(1)))).collect();
    let plans = plan(&scaled, PAGE_BYTES_MAX);
    let pages: Result<Vec<_>, PrepareError> = plans.par_iter().map(encode).collect();
    let count = plans.len() as u64;
    (of.progress)(Progress { stage: "pages of buildings", item: of.name, done: count, total: count });
    tree::with_groups(pages?, &plans, &cells, of.collection, of.name, of.ground)
}
