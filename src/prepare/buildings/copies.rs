//! `copies`: a collection set down at each place of a table, its middle at the place, turned by the heading, each
//! building on the terrain there.
//!
//! The collection is gathered once, on a ground of height 0. Its copies are moved on the ellipsoid by a rotation of
//! space, so lengths and angles stay. They are packed by cells that are wider than the collection: what lies in one of
//! them has page trees of its own, and no more than the copies that reach into it are in memory at a time.

use super::changeover::deepest_level;
use super::place::{self, Ground, wrap};
use super::{Gathered, Placed};
use crate::content::Prism;
use crate::forest::CellId;
use crate::geodesy::{Ecef, Enu, Geodetic, Point, SEMI_MAJOR_M, Transform};
use crate::prepare::PrepareError;
use crate::prepare::recipe::BuildingsSection;
use crate::prepare::source::{SourceFile, resolve};
use glam::DVec3;
use rayon::prelude::*;
use serde::Deserialize;
use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::FRAC_PI_2;
use std::path::Path;

/// The longest distance of an object from the collection's middle; what is wider cannot be set down as one piece.
const RADIUS_MAX_M: f64 = 500_000.0;
/// The note on copies whose roofs lie below the terrain where they are.
const BURIED: &str = "roof below the terrain";

/// A row of the table.
#[derive(Clone, Copy, Debug, Deserialize)]
struct Row {
    lon_deg: f64,
    lat_deg: f64,
    heading_deg: Option<f64>,
}

/// Where a copy's middle is to lie, and how it is turned.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CopyPlace {
    pub lat_rad: f64,
    pub lon_rad: f64,
    /// Clockwise, from how the source lies.
    pub heading_rad: f64,
}

/// The places of a section's copies; `None` where it has no table.
pub fn places(section: &BuildingsSection, root: &Path) -> Result<Option<Vec<CopyPlace>>, PrepareError> {
    let Some(file) = &section.copies else { return Ok(None) };
    if section.model.is_some() {
        let place = format!("[[objects]] {:?}", section.name);
        let remedy = "name all places in the table of the models";
        return Err(PrepareError::unsupported("the recipe", place, "`copies` of models", remedy));
    }
    let mut places = Vec::new();
    for file in resolve(root, file, &["csv"])? {
        read(&file, &mut places)?;
    }
    if places.is_empty() {
        let remedy = "give it a row lon_deg, lat_deg for each copy, or take `copies` out of the recipe";
        return Err(PrepareError::value(file, "the whole", "there is no place in it", remedy));
    }
    Ok(Some(places))
}

fn read(file: &SourceFile, places: &mut Vec<CopyPlace>) -> Result<(), PrepareError> {
    let mut rows = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(file.open()?);
    for row in rows.deserialize() {
        let row: Row = row.map_err(|error: csv::Error| {
            let line = error.position().map_or(1, csv::Position::line);
            let remedy = "name the columns lon_deg, lat_deg, heading_deg (which may be absent), and give numbers";
            PrepareError::value(file, format!("line {line}"), error, remedy)
        })?;
        let heading_deg = row.heading_deg.unwrap_or(0.0);
        if !(row.lon_deg.abs() <= 360.0 && row.lat_deg.abs() <= 90.0 && heading_deg.is_finite()) {
            let place = format!("place {} ({}, {})", places.len() + 1, row.lon_deg, row.lat_deg);
            let remedy = "longitudes are within ±360, latitudes within ±90 degrees";
            return Err(PrepareError::value(file, place, "it is not on the Earth", remedy));
        }
        places.push(CopyPlace {
            lat_rad: row.lat_deg.to_radians(),
            lon_rad: wrap(row.lon_deg.to_radians()),
            heading_rad: heading_deg.to_radians(),
        });
    }
    Ok(())
}

/// A collection to be set down, and where.
pub struct Copies<'g> {
    original: &'g [Placed],
    motions: Vec<Motion>,
    /// Objects of one copy, by their ids.
    features: u32,
    /// Level of the cells by which copies are packed.
    level: u8,
}

impl<'g> Copies<'g> {
    pub fn new(name: &str, gathered: &'g Gathered, places: &[CopyPlace]) -> Result<Self, PrepareError> {
        let wrong = |what: &str, remedy: &str| {
            PrepareError::value("the recipe", format!("[[buildings]] {name:?}, copies"), what, remedy)
        };
        let features = u32::try_from(gathered.features).unwrap_or(u32::MAX);
        if u64::from(features) * places.len() as u64 > u64::from(u32::MAX) {
            return Err(wrong("there are more than 4 billion objects", "make several collections of it"));
        }
        let middle = middle(&gathered.objects);
        let radius_m = radius_m(&gathered.objects, middle);
        if radius_m > RADIUS_MAX_M {
            return Err(wrong("the collection is wider than 1000 km", "set down a smaller one"));
        }
        let motions = places.iter().map(|place| Motion::new(middle, place)).collect();
        // A level more, so that turned objects, too, have their homes at this level or below.
        let deepest = places.iter().map(|place| deepest_level(place.lat_rad, place.lon_rad, 2.0 * radius_m)).min();
        let level = deepest.unwrap_or(0).saturating_sub(1);
        Ok(Self { original: &gathered.objects, motions, features, level })
    }

    /// Cells with objects, in their order, and the copies that these are of.
    pub fn cells(&self) -> BTreeMap<CellId, BTreeSet<usize>> {
        let of_copy = |at: usize| {
            let motion = &self.motions[at];
            self.original.iter().map(|object| (self.cell(object, motion), at)).collect::<BTreeSet<_>>()
        };
        let found: Vec<BTreeSet<_>> = (0..self.motions.len()).into_par_iter().map(of_copy).collect();
        let mut cells: BTreeMap<CellId, BTreeSet<usize>> = BTreeMap::new();
        for (cell, copy) in found.into_iter().flatten() {
            cells.entry(cell).or_default().insert(copy);
        }
        cells
    }

    /// The objects of some copies in one cell, in no order that means anything, and how many roofs are below the
    /// terrain there.
    pub fn in_cell(&self, cell: CellId, copies: &BTreeSet<usize>, ground: &Ground) -> (Vec<Placed>, u64) {
        let mut all = Vec::new();
        let mut buried = 0;
        for &at in copies {
            let motion = &self.motions[at];
            let first_id = at as u32 * self.features;
            let here = self.original.par_iter().filter(|object| self.cell(object, motion) == cell);
            let set_down: Vec<_> = here.map(|object| motion.set_down(object, first_id, ground)).collect();
            buried += set_down.iter().filter(|(_, is_buried)| *is_buried).count() as u64;
            all.extend(set_down.into_iter().map(|(object, _)| object));
        }
        (all, buried)
    }

    /// The cell of an object's box, once moved. The box is worked out only where its middle may lie in another cell than
    /// that of the box before.
    fn cell(&self, object: &Placed, motion: &Motion) -> CellId {
        let [lon, lat] = motion.moved([object.lon_rad, object.lat_rad]);
        let north = object.reach_m / SEMI_MAJOR_M * 1.01;
        let east = north / lat.cos().max(1e-9);
        let at = |lat: f64, lon: f64| CellId::containing(lat.clamp(-FRAC_PI_2, FRAC_PI_2), wrap(lon), self.level);
        let around = [(north, east), (north, -east), (-north, east), (-north, -east)];
        let first = at(lat, lon);
        if lat.abs() + north < FRAC_PI_2 && around.iter().all(|(up, right)| at(lat + up, lon + right) == first) {
            return first;
        }
        let outline = object.prism.rings.iter().flatten().copied();
        let detail = object.prism.detail.iter().flat_map(|detail| &detail.corners);
        let corners = outline.chain(detail.map(|corner| [corner.lon_rad, corner.lat_rad]));
        let moved = corners.map(|corner| {
            let [corner_lon, corner_lat] = motion.moved(corner);
            [lon + wrap(corner_lon - lon), corner_lat]
        });
        let center = place::bounds(moved).center();
        at(center.lat_rad, center.lon_rad)
    }
}

/// Counts the features of each copy, and the roofs that are below the terrain.
pub fn count(gathered: &mut Gathered, copies: u64, buried: u64) {
    gathered.features *= copies;
    for count in gathered.set_aside.values_mut().chain(gathered.repaired.values_mut()) {
        *count *= copies;
    }
    if buried > 0 {
        *gathered.repaired.entry(BURIED.to_owned()).or_default() += buried;
    }
}

/// Middle of the bounds of all outlines.
fn middle(objects: &[Placed]) -> Geodetic {
    let Some(first) = objects.first() else { return Geodetic { lat_rad: 0.0, lon_rad: 0.0, height_m: 0.0 } };
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for &[lon, lat] in objects.iter().flat_map(|object| object.prism.rings.iter().flatten()) {
        // Across the antimeridian, too, they count from one place.
        let p = [wrap(lon - first.lon_rad), lat];
        low = [low[0].min(p[0]), low[1].min(p[1])];
        high = [high[0].max(p[0]), high[1].max(p[1])];
    }
    let [lon_rad, lat_rad] = [0, 1].map(|axis| (low[axis] + high[axis]) / 2.0);
    Geodetic { lat_rad, lon_rad: wrap(first.lon_rad + lon_rad), height_m: 0.0 }
}

/// No point of any object is farther from the middle.
fn radius_m(objects: &[Placed], middle: Geodetic) -> f64 {
    let origin = middle.to_ecef().xyz();
    let far_m = |object: &Placed| {
        let place = Geodetic { lat_rad: object.lat_rad, lon_rad: object.lon_rad, height_m: 0.0 };
        place.to_ecef().xyz().distance(origin) + object.reach_m
    };
    objects.par_iter().map(far_m).reduce(|| 0.0, f64::max)
}

/// From the source's place to a copy's.
struct Motion {
    enu_from_source: Transform<Enu, Ecef>,
    target_from_enu: Transform<Ecef, Enu>,
    /// Cosine and sine of the heading.
    turn: [f64; 2],
}

impl Motion {
    fn new(middle: Geodetic, place: &CopyPlace) -> Self {
        let target = Geodetic { lat_rad: place.lat_rad, lon_rad: place.lon_rad, height_m: 0.0 };
        Self {
            enu_from_source: middle.ecef_from_enu().inverse(),
            target_from_enu: target.ecef_from_enu(),
            turn: [place.heading_rad.cos(), place.heading_rad.sin()],
        }
    }

    /// Longitude (within ±π) and latitude, radians. The ellipsoid bends otherwise elsewhere: at 10 km from the middle
    /// it is some centimetres off, which are left to the height.
    fn moved(&self, [lon_rad, lat_rad]: [f64; 2]) -> [f64; 2] {
        let from = Geodetic { lat_rad, lon_rad, height_m: 0.0 };
        let [x, y, z] = (self.enu_from_source * from.to_ecef()).xyz().to_array();
        let [cos, sin] = self.turn;
        let turned = Point::<Enu>::new(DVec3::new(x * cos + y * sin, y * cos - x * sin, z));
        let to = Geodetic::from_ecef(self.target_from_enu * turned);
        [to.lon_rad, to.lat_rad]
    }

    /// A point whose longitude goes on from another without a jump.
    fn moved_near(&self, corner: [f64; 2], first_lon: f64) -> [f64; 2] {
        let [lon, lat] = self.moved(corner);
        [first_lon + wrap(lon - first_lon), lat]
    }

    /// An object on the ground at its new place. Says whether its roof is below the terrain.
    fn set_down(&self, object: &Placed, first_id: u32, ground: &Ground) -> (Placed, bool) {
        let mut prism = Prism { id: first_id + object.prism.id, ..object.prism.clone() };
        let [first_lon, _] = self.moved([object.lon_rad, object.lat_rad]);
        for corner in prism.rings.iter_mut().flatten() {
            *corner = self.moved_near(*corner, first_lon);
        }
        for corner in prism.detail.iter_mut().flat_map(|detail| &mut detail.corners) {
            [corner.lon_rad, corner.lat_rad] = self.moved_near([corner.lon_rad, corner.lat_rad], first_lon);
        }
        let [lon, lat] = self.moved(object.ground_at);
        let ground_m = (ground.height_m)(lat, lon);
        let is_buried = place::raise(&mut prism, ground_m, ground);
        (object.moved(prism), is_buried)
    }
}
