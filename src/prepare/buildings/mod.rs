//! Footprints → pages of objects: read → clean, size and place (in parallel) → choose the changeover level → pack →
//! encode (in parallel).

mod changeover;
mod clean;
mod color;
mod copies;
mod faces;
mod groups;
mod outline;
mod pack;
mod packed;
mod place;
mod plain;
mod roof;
mod rules;
mod shape;
mod tree;

pub use changeover::{Changeover, Item, choose, deepest_level};
pub use clean::{AREA_MIN_M2, Footprint, Reason, TOLERANCE_M, clean};
use copies::Copies;
use packed::Packed;
use plain::Plain;

pub use pack::{PAGE_BYTES_MAX, PagePlan, plan};
pub use place::Ground;
pub use rules::{Extent, HEIGHT_MAX_M, Rules, STOREY_M, storeys_by_area};

use super::model::Model;
use super::recipe::BuildingsSection;
use super::source::{SourceFile, resolve};
use super::textures::{Picture, bake, texels};
use super::vector::{EXTENSIONS, Feature, OsmBuildingCounts, ReadOptions, read_footprints};
use super::{OnProgress, PrepareError, Progress};
use crate::content::Prism;
use crate::forest::{CellId, LEVEL_MAX};
use crate::geodesy::VerticalDatum;
use crate::store::{CollectionInfo, EncodeError, PrismPage, SourceInfo, encode_objects};
use rayon::prelude::*;
use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Arc;

/// Features that are worked on as one task.
const BATCH: usize = 1024;
/// Batches that may wait between the reader and the workers.
const BATCHES_WAITING: usize = 4;
/// Bounds the distance between what pages hold and the cleaned source: points dropped and positions quantized.
pub const ERROR_M: f32 = 0.02;

/// Of JPEG, about.
const TEXELS_PER_BYTE: u64 = 6;
/// An object's textures count with no more than this in the plan of pages: there they are scaled down.
const TEXTURE_BYTES_MAX: u64 = 12 << 10;

/// A collection, ready to be written.
#[derive(Clone, Debug)]
pub struct PreparedCollection {
    pub info: CollectionInfo,
    pub source: SourceInfo,
    /// Ordered by root.
    pub pages: Vec<ObjectsPage>,
    /// What an OpenStreetMap extract held.
    pub osm: Option<OsmBuildingCounts>,
}

/// A page of objects as it will be stored.
#[derive(Clone, Debug)]
pub struct ObjectsPage {
    pub root: CellId,
    pub rep: u8,
    /// How far it may be off the finest rep, metres; 0 for that.
    pub error_m: f64,
    pub bytes: Vec<u8>,
    pub objects: u64,
    /// Largest bounding dimension, metres.
    pub dimension_m: f64,
    /// Largest reach, metres.
    pub reach_m: f64,
    /// Lowest and highest drawn height above the ellipsoid, foundations included, metres.
    pub height_range_m: (f64, f64),
    /// Of the finest rep: largest bounding dimension of all objects of the collection from the root down, metres.
    pub below_dimension_m: Option<f64>,
    /// Objects whose textures were scaled down to fit, and those that lost some for want of room.
    pub textures_scaled: u64,
    pub textures_lost: u64,
}

/// One prism of a collection, with what is kept of its feature.
#[derive(Clone, Debug, PartialEq)]
pub struct Placed {
    pub prism: Prism,
    /// A JSON object.
    pub attributes: String,
    pub lat_rad: f64,
    pub lon_rad: f64,
    pub reach_m: f64,
    /// Longitude and latitude of where the ground of its building is asked for, radians.
    ground_at: [f64; 2],
    /// Those that the textures of its detail name.
    pub pictures: Vec<Arc<Picture>>,
    /// What it shows of them; 0 where all objects of a page share them.
    texels: u64,
    /// What stands for its detail from afar.
    plain: Option<Box<Plain>>,
}

/// Prisms of a whole collection, and what happened to its features.
#[derive(Clone, Debug, Default)]
pub struct Gathered {
    pub objects: Vec<Placed>,
    /// Features with at least one prism.
    pub features: u64,
    pub set_aside: BTreeMap<String, u64>,
    pub repaired: BTreeMap<String, u64>,
    pub attributes: BTreeSet<String>,
    pub osm: Option<OsmBuildingCounts>,
}

/// What there is to tell of a collection whose pages have been handed on.
#[derive(Clone, Debug)]
pub struct CollectionSummary {
    pub info: CollectionInfo,
    pub source: SourceInfo,
    /// What an OpenStreetMap extract held.
    pub osm: Option<OsmBuildingCounts>,
    /// Lowest and highest drawn height above the ellipsoid, metres; the first above the second where nothing is drawn.
    pub height_range_m: (f64, f64),
}

/// Prepares the collection of a section. `vertical` is what its bases count from where the section does not say;
/// `collection` its index in the manifest.
pub fn prepare_collection(
    section: &BuildingsSection,
    root: &Path,
    vertical: VerticalDatum,
    ground: &Ground,
    collection: u8,
    progress: OnProgress<'_>,
) -> Result<PreparedCollection, PrepareError> {
    let mut pages = Vec::new();
    let mut keep = |page| {
        pages.push(page);
        Ok(())
    };
    let of = Packing { name: &section.name, collection, ground, progress };
    let CollectionSummary { info, source, osm, .. } =
        prepare_pages::<PrepareError>(section, root, vertical, &of, &mut keep)?;
    Ok(PreparedCollection { info, source, pages, osm })
}

/// What all pages of a collection have in common.
pub struct Packing<'a> {
    pub name: &'a str,
    pub collection: u8,
    pub ground: &'a Ground<'a>,
    pub progress: OnProgress<'a>,
}

/// Takes pages as they are made, ordered by root, the coarsest of a root first.
pub type PageSink<'s, E> = dyn FnMut(ObjectsPage) -> Result<(), E> + 's;

/// Prepares the collection of a section and hands its pages on, so that those of many copies need not be held at once.
pub fn prepare_pages<E: From<PrepareError>>(
    section: &BuildingsSection,
    root: &Path,
    vertical: VerticalDatum,
    of: &Packing<'_>,
    sink: &mut PageSink<'_, E>,
) -> Result<CollectionSummary, E> {
    let places = copies::places(section, root)?;
    let flat = Ground { height_m: &|_, _| 0.0, error_m: &|_, _| 0.0 };
    let ground = if places.is_some() { &flat } else { of.ground };
    let mut gathered = gather(section, root, vertical, ground, of.progress)?;
    gathered.objects.par_sort_by_key(|object| (spatial_order(object.lat_rad, object.lon_rad), object.prism.id));
    let items: Vec<Item> = gathered.objects.par_iter().map(item).collect();
    let changeover = choose(&items);
    drop(items);
    let mut packed = Packed::new(of, changeover.level, sink);
    match places {
        None => packed.add(std::mem::take(&mut gathered.objects))?,
        Some(places) => {
            let copies = Copies::new(&section.name, &gathered, &places)?;
            let cells = copies.cells();
            let (total, mut buried) = (cells.len() as u64, 0);
            for (done, (cell, of_cell)) in cells.into_iter().enumerate() {
                (of.progress)(Progress { stage: "copies", item: of.name, done: done as u64, total });
                let (objects, buried_here) = copies.in_cell(cell, &of_cell, of.ground);
                buried += buried_here;
                packed.add(objects)?;
            }
            copies::count(&mut gathered, places.len() as u64, buried);
        }
    }
    let height_range_m = packed.height_range_m;
    for (note, count) in [
        ("textures scaled down to fit their page", packed.textures_scaled),
        ("textures without room in their page: plain colour", packed.textures_lost),
    ] {
        if count > 0 {
            *gathered.repaired.entry(note.to_owned()).or_default() += count;
        }
    }
    let info = packed.finish(gathered.features);
    let info = CollectionInfo {
        vgis_level: changeover.vgis_level,
        cost_curve: changeover.curve,
        set_aside: gathered.set_aside,
        repaired: gathered.repaired,
        attributes: gathered.attributes.into_iter().collect(),
        ..info
    };
    let source = SourceInfo {
        kind: "buildings".into(),
        file: section.file.clone(),
        credit: section.credit.clone(),
        licence: section.licence.clone(),
        spacing_m: 0.0,
        count: gathered.features,
    };
    Ok(CollectionSummary { info, source, osm: gathered.osm, height_range_m })
}

/// Reads, cleans, sizes and places all features of a section. Cells are not chosen yet; ids count the features that
/// are kept, in the order of the files.
pub fn gather(
    section: &BuildingsSection,
    root: &Path,
    vertical: VerticalDatum,
    ground: &Ground,
    progress: OnProgress<'_>,
) -> Result<Gathered, PrepareError> {
    let rules = Rules::new(section, section.vertical.unwrap_or(vertical))?;
    let model = match &section.model {
        Some(model) => Some(Arc::new(Model::read(&root.join(&model.file), model.error_m)?)),
        None => None,
    };
    let files = resolve(root, &section.file, if model.is_some() { &["csv"] } else { &EXTENSIONS })?;
    let mut gathered = Gathered::default();
    for file in &files {
        gather_file(section, file, model.clone(), &rules, ground, &mut gathered, progress)?;
    }
    Ok(gathered)
}

/// The reader runs beside the workers, at most a few batches ahead.
fn gather_file(
    section: &BuildingsSection,
    file: &SourceFile,
    model: Option<Arc<Model>>,
    rules: &Rules,
    ground: &Ground,
    gathered: &mut Gathered,
    progress: OnProgress<'_>,
) -> Result<(), PrepareError> {
    let (sender, batches) = crossbeam_channel::bounded::<Vec<Feature>>(BATCHES_WAITING);
    let name = file.to_string();
    let options = ReadOptions {
        crs: section.crs.as_deref(),
        layer: section.layer.as_deref(),
        lod: rules::lod(section)?,
        vertical: section.vertical,
    };
    let summary = std::thread::scope(|scope| {
        let reader = std::thread::Builder::new().name("read footprints".into()).spawn_scoped(scope, move || {
            let mut batch = Vec::with_capacity(BATCH);
            let mut visit = |feature| {
                batch.push(feature);
                if batch.len() == BATCH {
                    // A worker that went away has an error of its own to tell.
                    let _ = sender.send(std::mem::replace(&mut batch, Vec::with_capacity(BATCH)));
                }
                Ok(())
            };
            let read = match model {
                Some(model) => super::model::read(file, model, &mut visit),
                None => read_footprints(file, &options, &mut visit),
            };
            let _ = sender.send(batch);
            read
        });
        let reader = reader.map_err(|source| PrepareError::read(&file.path, source))?;
        for batch in batches {
            let made: Vec<_> = batch.par_iter().map(|feature| make(feature, &name, rules, ground)).collect();
            for made in made {
                gathered.add(made?, rules);
            }
            progress(Progress { stage: "buildings", item: &section.name, done: gathered.features, total: 0 });
        }
        reader.join().unwrap_or_else(|_| Err(PrepareError::damaged(&name, "the whole", "its reader failed")))
    })?;
    for (reason, count) in summary.kept_back {
        *gathered.set_aside.entry(reason).or_default() += count;
    }
    gathered.osm = summary.osm.or(gathered.osm);
    Ok(())
}

/// What became of one feature.
struct Made {
    objects: Vec<Placed>,
    names: Vec<String>,
    notes: BTreeSet<clean::Reason>,
    set_aside: Option<clean::Reason>,
    own_colors: serde_json::Map<String, serde_json::Value>,
}

fn make(feature: &Feature, file: &str, rules: &Rules, ground: &Ground) -> Result<Made, PrepareError> {
    let mut notes = feature.notes.clone();
    let mut made = Made {
        objects: Vec::new(),
        names: Vec::new(),
        notes: BTreeSet::new(),
        set_aside: None,
        own_colors: serde_json::Map::new(),
    };
    let wrong_value = |wrong| {
        let place = format!("feature {}", feature.number);
        PrepareError::value(file, place, wrong, "mend the feature, or name another attribute in the recipe")
    };
    if let Some(model) = &feature.model {
        match shape::set_down(model, feature, rules, ground, &mut notes) {
            Ok(prism) => made.keep(vec![prism], &model.model.pictures, feature, rules, notes),
            Err(reason) => made.set_aside = Some(reason),
        }
        return Ok(made);
    }
    let shaped = feature.shape.as_ref().map(|shape| shape::prisms(feature, shape, rules, ground, &mut notes));
    let unsound = match shaped {
        Some(Ok((prisms, pictures))) => {
            made.keep(prisms, &pictures, feature, rules, notes);
            return Ok(made);
        }
        Some(Err(shape::Failed::Attributes(wrong))) => return Err(wrong_value(wrong)),
        Some(Err(shape::Failed::Unsound(reason))) => Some(reason),
        None => None,
    };
    let footprints = match clean(&feature.polygons, &mut notes) {
        Ok(footprints) => footprints,
        Err(reason) => {
            made.set_aside = Some(unsound.unwrap_or(reason));
            return Ok(made);
        }
    };
    if unsound.is_some() {
        notes.insert("surfaces unsound: drawn up from the footprint");
    }
    let area_m2 = footprints.iter().map(|footprint| footprint.area_m2).sum();
    let extent = rules.extent(&feature.attributes, area_m2, &mut notes).map_err(wrong_value)?;
    let whole = feature.ground.as_ref().map(|points| points.as_slice());
    let ground_m = place::ground_m(&footprints, whole, &extent, rules.vertical, ground);
    let roof = rules.roof(&feature.attributes, &mut notes);
    let drawn_up = |footprint| match &roof {
        Some(roof) => place::roofed(footprint, &extent, roof, ground_m, ground, &mut notes),
        None => place::prism(footprint, &extent, ground_m, ground, &mut notes),
    };
    let prisms = footprints.into_iter().map(drawn_up).collect();
    made.keep(prisms, &[], feature, rules, notes);
    Ok(made)
}

impl Made {
    fn keep(
        &mut self,
        prisms: Vec<Prism>,
        pictures: &[Arc<Picture>],
        feature: &Feature,
        rules: &Rules,
        notes: BTreeSet<clean::Reason>,
    ) {
        let attributes = rules.kept(feature);
        let rings = prisms.iter().filter_map(|prism| prism.rings.first());
        let at = place::ground_at(rings, feature.ground.as_ref().map(|points| points.as_slice()));
        let ground_at = [at.lon_rad, at.lat_rad];
        let placed = |prism| Placed::new(prism, pictures, attributes.clone(), ground_at);
        self.objects = prisms.into_iter().map(placed).collect();
        // All copies of a model in a page share its textures.
        if feature.model.is_some() {
            self.objects.iter_mut().for_each(|object| object.texels = 0);
        }
        self.names = feature.attributes.keys().filter(|name| rules.keeps(name)).cloned().collect();
        self.own_colors = rules.color_attributes(&feature.attributes);
        self.notes = notes;
    }
}

impl Gathered {
    fn add(&mut self, made: Made, rules: &Rules) {
        if let Some(reason) = made.set_aside {
            *self.set_aside.entry(reason.to_owned()).or_default() += 1;
            return;
        }
        for note in made.notes {
            *self.repaired.entry(note.to_owned()).or_default() += 1;
        }
        self.attributes.extend(made.names);
        let id = self.features as u32;
        self.features += 1;
        let (wall_color, roof_color) = rules.colors(&made.own_colors, id);
        self.objects.extend(made.objects.into_iter().map(|mut object| {
            object.prism = Prism { id, wall_color, roof_color, ..object.prism };
            object
        }));
    }
}

impl Placed {
    fn new(prism: Prism, pictures: &[Arc<Picture>], attributes: String, ground_at: [f64; 2]) -> Self {
        let (lat_rad, lon_rad, reach_m) = place_of(&prism);
        let texels = texels(&prism, pictures);
        let pictures = pictures.to_vec();
        Self { lat_rad, lon_rad, reach_m, attributes, pictures, texels, prism, ground_at, plain: None }
    }

    /// The same elsewhere.
    fn moved(&self, prism: Prism) -> Self {
        let (lat_rad, lon_rad, reach_m) = place_of(&prism);
        Self { lat_rad, lon_rad, reach_m, prism, plain: None, ..self.clone() }
    }

    /// Once its cell and number are known: what stands for its detail from afar.
    fn find_plain(&mut self) {
        self.plain = plain::of(&self.prism).map(Box::new);
    }

    /// Largest side of its box, height included, metres.
    fn dimension_m(&self) -> f64 {
        self.reach_m.max(f64::from(self.prism.top_m) - f64::from(self.prism.base_m))
    }

    /// The object without its detail.
    fn plain(&self) -> &Prism {
        self.plain.as_ref().map_or(&self.prism, |plain| &plain.prism)
    }

    /// How far that is off, metres; 0 where there is no detail.
    fn plain_error_m(&self) -> f64 {
        self.plain.as_ref().map_or(0.0, |plain| plain.error_m)
    }
}

/// Middle of a prism's box, radians, and its reach, metres.
fn place_of(prism: &Prism) -> (f64, f64, f64) {
    let footprint = prism.footprint();
    let reach_m = footprint.sides_m[0].max(footprint.sides_m[1]);
    (footprint.lat_rad, place::wrap(footprint.lon_rad), reach_m)
}

/// A key that keeps near places near: the finest cell.
pub fn spatial_order(lat_rad: f64, lon_rad: f64) -> CellId {
    CellId::containing(lat_rad, lon_rad, LEVEL_MAX)
}

fn item(object: &Placed) -> Item {
    Item::new(object.lat_rad, object.lon_rad, object.reach_m, bytes_about(object))
}

/// Bytes that an object takes in a page, about; pages are planned again by what they really take.
fn bytes_about(object: &Placed) -> u32 {
    let corners: usize = object.prism.rings.iter().map(Vec::len).sum();
    let detail = object.prism.detail.as_ref().map_or(0, |detail| 4 * detail.corners.len() + 2 * detail.triangles());
    let textures = (object.texels / TEXELS_PER_BYTE).min(TEXTURE_BYTES_MAX) as usize;
    (16 + 4 * corners + detail + textures + object.attributes.len() / 4) as u32
}

fn encode(plan: &PagePlan, cells: &[&[Placed]], collection: u8, name: &str) -> Result<ObjectsPage, PrepareError> {
    let objects: Vec<&Placed> = plan.cells.iter().flat_map(|&at| cells[at]).collect();
    let mut prisms: Vec<Prism> = objects.iter().map(|object| object.prism.clone()).collect();
    let pictures: Vec<&[Arc<Picture>]> = objects.iter().map(|object| &*object.pictures).collect();
    let baked = bake(&mut prisms, &pictures).map_err(|error| unstorable(plan.root, error, name))?;
    let page = PrismPage { root: plan.root, collection, rep: 0, error_m: ERROR_M, prisms, atlas: baked.atlas };
    let page = encode_page(page, &texts(&objects), name)?;
    Ok(ObjectsPage { textures_scaled: baked.scaled, textures_lost: baked.lost, ..page })
}

fn unstorable(root: CellId, error: EncodeError, name: &str) -> PrepareError {
    PrepareError::value(name, format!("page of cell {root}"), error, "split the collection in two")
}

/// A page with what the index is to know of it.
fn encode_page(page: PrismPage, attributes: &[String], name: &str) -> Result<ObjectsPage, PrepareError> {
    let bytes = encode_objects(&page, attributes).map_err(|error| unstorable(page.root, error, name))?;
    let prisms = &page.prisms;
    let largest = |size: &dyn Fn(&Prism) -> f64| prisms.iter().map(size).fold(0.0, f64::max);
    let low = prisms.iter().map(|prism| f64::from(prism.base_m) - f64::from(prism.foundation_m));
    let high = prisms.iter().map(|prism| f64::from(prism.top_m));
    Ok(ObjectsPage {
        root: page.root,
        rep: page.rep,
        error_m: if page.rep == 0 { 0.0 } else { f64::from(page.error_m) },
        objects: prisms.len() as u64,
        dimension_m: largest(&Prism::dimension_m),
        reach_m: largest(&Prism::reach_m),
        height_range_m: (low.fold(f64::INFINITY, f64::min), high.fold(f64::NEG_INFINITY, f64::max)),
        below_dimension_m: None,
        textures_scaled: 0,
        textures_lost: 0,
        bytes,
    })
}

/// Within a cell the largest come first: from afar those above the threshold are one run, and one draw call.
fn largest_first(prism: &Prism) -> (Reverse<u64>, u32) {
    (Reverse((prism.dimension_m() * 100.0) as u64), prism.id)
}

/// A JSON text for each object, or none at all where all are empty.
fn texts(objects: &[&Placed]) -> Vec<String> {
    if objects.iter().all(|object| object.attributes == "{}") {
        return Vec::new();
    }
    objects.iter().map(|object| object.attributes.clone()).collect()
}
