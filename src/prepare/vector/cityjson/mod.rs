//! CityJSON (1.0 to 2.0) and CityJSONSeq: buildings and the like with their surfaces in three dimensions.
//!
//! A file is a document; of a sequence one feature is in memory at a time.

mod document;
mod pictures;
mod surfaces;

use super::crs::{Heights, ToLonLat, heights_of};
use super::{Feature, ReadOptions, ReadSummary, Shape, SurfaceKind, Visit};
use crate::geodesy::VerticalDatum;
use crate::prepare::PrepareError;
use crate::prepare::source::SourceFile;
use document::{CityObject, Document, Quantization};
use pictures::Pictures;
use serde_json::{Map, Value};
use std::collections::{BTreeSet, HashMap};
use std::sync::Arc;
use surfaces::Scene;

/// What lies on the ground is the terrain's and the imagery's to show.
const GROUND_COVER: [&str; 9] =
    ["LandUse", "PlantCover", "Railway", "Road", "Square", "TINRelief", "TransportSquare", "WaterBody", "Waterway"];
/// Parents above a part that are followed; the format knows two.
const GENERATIONS_MAX: usize = 8;

/// Reads all city objects that have surfaces and are no ground cover.
pub fn read(file: &SourceFile, options: &ReadOptions, visit: &mut Visit) -> Result<ReadSummary, PrepareError> {
    let pictures = Pictures::beside(file);
    let mut reader =
        Reader { file: file.to_string(), options, head: None, summary: ReadSummary::default(), objects: 0, pictures };
    for document in serde_json::Deserializer::from_reader(file.open()?).into_iter::<Document>() {
        let document = document.map_err(|error| {
            let place = format!("after {} objects", reader.objects);
            PrepareError::damaged(&reader.file, place, format!("{error}; it must be CityJSON"))
        })?;
        reader.take(document, visit)?;
    }
    match reader.head {
        Some(_) => Ok(reader.summary),
        None => Err(PrepareError::damaged(file, "the whole", "it is empty; it must be CityJSON")),
    }
}

struct Reader<'a> {
    file: String,
    options: &'a ReadOptions<'a>,
    head: Option<Head>,
    summary: ReadSummary,
    /// City objects that were looked at.
    objects: u64,
    pictures: Pictures,
}

/// What the features of a sequence take from its first document.
struct Head {
    to_lon_lat: ToLonLat,
    heights: Heights,
    transform: Option<Quantization>,
}

impl Reader<'_> {
    fn take(&mut self, document: Document, visit: &mut Visit) -> Result<(), PrepareError> {
        if self.head.is_none() {
            self.head = Some(self.head_of(&document)?);
        }
        let Some(head) = &self.head else { return Ok(()) };
        let transform = document.transform.or(head.transform);
        let vertices: Vec<[f64; 3]> = document.vertices.iter().map(|&vertex| unpacked(transform, vertex)).collect();
        let place = |[x, y, z]: [f64; 3]| match head.to_lon_lat.convert([x, y]) {
            Ok([lon, lat]) => [lon, lat, z],
            Err(_) => [f64::NAN; 3],
        };
        let places: Vec<[f64; 3]> = vertices.iter().map(|&vertex| place(vertex)).collect();
        let pictures = self.pictures.of(&document.appearance);
        let scene = Scene {
            pictures: &pictures,
            appearance: &document.appearance,
            templates: &document.templates,
            vertices: &vertices,
            places: &places,
            place: &place,
        };
        let names = document.objects.iter().enumerate();
        let by_name: HashMap<&str, usize> = names.map(|(at, entry)| (entry.0.as_str(), at)).collect();
        let mut found = found(&document.objects, &by_name, &scene, self.options.lod, head.heights);
        for (at, (name, object)) in document.objects.iter().enumerate() {
            self.objects += 1;
            match std::mem::replace(&mut found[at], Found::Nothing) {
                Found::Feature(feature) => {
                    self.summary.features += 1;
                    let attributes = inherited(object, &document.objects, &by_name);
                    visit(Feature { number: self.objects, id: Some(name.clone()), attributes, ..*feature })?;
                }
                Found::KeptBack(reason) => *self.summary.kept_back.entry(reason).or_default() += 1,
                Found::Nothing => {}
            }
        }
        Ok(())
    }

    fn head_of(&self, document: &Document) -> Result<Head, PrepareError> {
        if document.kind.as_deref() != Some("CityJSON") {
            let what = format!("its type is {:?}, not CityJSON", document.kind.as_deref().unwrap_or("absent"));
            return Err(PrepareError::damaged(&self.file, "type", what));
        }
        let version = document.version.as_deref().unwrap_or("absent");
        if !["1.0", "1.1", "2.0"].iter().any(|known| version.starts_with(known)) {
            let remedy = "convert it to version 2.0, with cjio for example";
            return Err(PrepareError::unsupported(&self.file, "version", format!("version {version:?}"), remedy));
        }
        let Some(crs) = self.options.crs.or(document.metadata.reference_system.as_deref()) else {
            let remedy = "give `crs = \"EPSG:…\"` in the recipe";
            return Err(PrepareError::NoGeoreference { file: self.file.clone(), remedy });
        };
        let (horizontal, heights) = heights_of(crs);
        let heights = self.options.vertical.map_or(heights, Heights::Above);
        let to_lon_lat = ToLonLat::new(&self.file, Some(&horizontal))?;
        Ok(Head { to_lon_lat, heights, transform: document.transform })
    }
}

fn unpacked(transform: Option<Quantization>, vertex: [f64; 3]) -> [f64; 3] {
    transform.map_or(vertex, |by| std::array::from_fn(|axis| vertex[axis] * by.scale[axis] + by.translate[axis]))
}

/// What becomes of a city object.
enum Found {
    /// Without number, name and attributes.
    Feature(Box<Feature>),
    KeptBack(String),
    /// Its parts stand for it.
    Nothing,
}

/// All objects of a document, in its order.
fn found(
    objects: &[(String, CityObject)],
    by_name: &HashMap<&str, usize>,
    scene: &Scene,
    lod: Option<f64>,
    heights: Heights,
) -> Vec<Found> {
    let lods: Vec<Option<f64>> = objects.iter().map(|(_, object)| chosen_lod(object, scene, lod)).collect();
    let mut shapes: Vec<Found> = Vec::with_capacity(objects.len());
    for ((_, object), own) in objects.iter().zip(&lods) {
        let of_parts = object.children.iter().filter_map(|name| lods[*by_name.get(name.as_str())?]);
        let of_parts = of_parts.max_by(f64::total_cmp);
        shapes.push(match (own, of_parts) {
            _ if GROUND_COVER.contains(&object.kind.as_str()) => {
                Found::KeptBack(format!("{}: shown by terrain and imagery", object.kind))
            }
            (Some(own), parts) if parts.is_none_or(|parts| parts <= *own) => shaped(object, scene, *own, lod, heights),
            (_, Some(_)) => Found::Nothing,
            _ => Found::KeptBack("no geometry".into()),
        });
    }
    let families: Vec<usize> = (0..objects.len()).map(|at| oldest(at, objects, by_name)).collect();
    settle_families(&mut shapes, &families);
    shapes
}

/// The level asked for or the nearest below it, else the lowest; by default the highest.
fn chosen_lod(object: &CityObject, scene: &Scene, asked: Option<f64>) -> Option<f64> {
    let lods = || object.geometry.iter().filter_map(|geometry| scene.lod(geometry));
    let asked = asked.unwrap_or(f64::INFINITY);
    lods().filter(|lod| *lod <= asked).max_by(f64::total_cmp).or_else(|| lods().min_by(f64::total_cmp))
}

fn shaped(object: &CityObject, scene: &Scene, lod: f64, asked: Option<f64>, heights: Heights) -> Found {
    let of_lod = |wanted: &dyn Fn(f64) -> bool| {
        let geometries = object.geometry.iter().filter(|geometry| scene.lod(geometry).is_some_and(wanted));
        geometries.flat_map(|geometry| scene.surfaces(geometry)).collect::<Vec<_>>()
    };
    let mut surfaces = of_lod(&|own| own == lod);
    if surfaces.is_empty() {
        return Found::KeptBack("no surfaces".into());
    }
    let mut feature = Feature::default();
    if asked.is_some_and(|asked| asked != lod) {
        feature.notes.insert("level of detail asked for is absent: another taken");
    }
    let outlines = if lod < 1.0 { std::mem::take(&mut surfaces) } else { of_lod(&|own| own < 1.0) };
    let flat = |ring: Vec<[f64; 3]>| ring.into_iter().map(|[lon, lat, _]| [lon, lat]).collect();
    feature.polygons = outlines.into_iter().map(|surface| surface.rings.into_iter().map(flat).collect()).collect();
    if !surfaces.is_empty() {
        if heights.are_taken_for_egm96() {
            feature.notes.insert("heights of a national system taken as above EGM96");
        }
        let lowest_m = lowest_m(&surfaces);
        feature.shape = Some(Shape { surfaces, vertical: heights.datum(), lowest_m });
    }
    Found::Feature(Box::new(feature))
}

fn lowest_m(surfaces: &[super::Surface]) -> f64 {
    let heights =
        surfaces.iter().filter(|s| s.kind != Some(SurfaceKind::Unseen)).flat_map(|s| s.rings.iter().flatten());
    heights.map(|point| point[2]).filter(|height| height.is_finite()).fold(f64::INFINITY, f64::min)
}

/// The first ancestor of an object that the document holds.
fn oldest(mut at: usize, objects: &[(String, CityObject)], by_name: &HashMap<&str, usize>) -> usize {
    for _ in 0..GENERATIONS_MAX {
        let parent = objects[at].1.parents.first().and_then(|name| by_name.get(name.as_str()));
        match parent {
            Some(&parent) if parent != at => at = parent,
            _ => break,
        }
    }
    at
}

/// Parts of one building share its lowest point and its ground.
fn settle_families(shapes: &mut [Found], families: &[usize]) {
    let mut wholes: HashMap<usize, Whole> = HashMap::new();
    for (found, family) in shapes.iter().zip(families) {
        let Found::Feature(feature) = found else { continue };
        let Some(shape) = &feature.shape else { continue };
        let whole = wholes.entry(*family).or_insert(Whole { lowest_m: f64::INFINITY, points: Vec::new(), parts: 0 });
        whole.lowest_m = whole.lowest_m.min(shape.lowest_m);
        whole.points.extend(box_of(&shape.surfaces));
        whole.parts += 1;
    }
    let shared = wholes.into_iter().filter(|(_, whole)| whole.parts > 1);
    let shared: HashMap<usize, _> = shared.map(|(at, whole)| (at, (whole.lowest_m, Arc::new(whole.points)))).collect();
    for (found, family) in shapes.iter_mut().zip(families) {
        let (Found::Feature(feature), Some((lowest_m, points))) = (found, shared.get(family)) else { continue };
        feature.ground = Some(points.clone());
        if let Some(shape) = &mut feature.shape {
            shape.lowest_m = *lowest_m;
        }
    }
}

/// A building of one part or several.
struct Whole {
    lowest_m: f64,
    /// Corners of its parts' boxes, degrees.
    points: Vec<[f64; 2]>,
    parts: usize,
}

/// Two corners round the surfaces, degrees; none round nothing.
fn box_of(surfaces: &[super::Surface]) -> Vec<[f64; 2]> {
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for point in surfaces.iter().flat_map(|surface| surface.rings.iter().flatten()) {
        for axis in 0..2 {
            low[axis] = low[axis].min(point[axis]);
            high[axis] = high[axis].max(point[axis]);
        }
    }
    if low[0] <= high[0] && low[1] <= high[1] { vec![low, high] } else { Vec::new() }
}

/// An object's own attributes and kind, then those of its parents that it does not have itself.
fn inherited(
    object: &CityObject,
    objects: &[(String, CityObject)],
    by_name: &HashMap<&str, usize>,
) -> Map<String, Value> {
    let mut attributes = object.attributes.clone().unwrap_or_default();
    attributes.entry("type").or_insert_with(|| object.kind.as_str().into());
    let mut parents: Vec<&str> = object.parents.iter().map(String::as_str).collect();
    let mut seen: BTreeSet<&str> = BTreeSet::new();
    while let Some(name) = parents.pop() {
        if !seen.insert(name) || seen.len() > GENERATIONS_MAX {
            continue;
        }
        let Some((_, parent)) = by_name.get(name).and_then(|&at| objects.get(at)) else { continue };
        for (key, value) in parent.attributes.iter().flatten() {
            attributes.entry(key.as_str()).or_insert_with(|| value.clone());
        }
        parents.extend(parent.parents.iter().map(String::as_str));
    }
    attributes
}

impl Heights {
    fn are_taken_for_egm96(self) -> bool {
        self == Self::National
    }

    /// What heights count from; `None` where nothing says.
    fn datum(self) -> Option<VerticalDatum> {
        match self {
            Self::Above(datum) => Some(datum),
            Self::National => Some(VerticalDatum::Egm96),
            Self::Unknown => None,
        }
    }
}
