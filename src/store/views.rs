//! Named views of a world, and what a viewer offers to fly to.

use super::{CollectionInfo, Manifest};
use crate::forest::index::{IndexForest, IndexTree, Node};
use crate::forest::{CellId, LEVEL_MAX};
use crate::geodesy::{Ecef, Enu, GeoBounds, Geodetic, Point};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::f64::consts::{PI, TAU};

/// A place of the eye and a direction, with a name for people.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct NamedView {
    pub name: String,
    /// −360 to 360, degrees east.
    pub lon_deg: f64,
    /// −90 to 90, degrees north.
    pub lat_deg: f64,
    /// Above the ellipsoid, metres; see [`VIEW_HEIGHT_M`].
    pub height_m: f64,
    /// −360 to 360, clockwise from north.
    #[serde(default)]
    pub heading_deg: f64,
    /// −90 to 90, up from the horizon; −90 looks straight down.
    #[serde(default = "NamedView::straight_down_deg")]
    pub pitch_deg: f64,
}

/// Lowest and highest eye of a named view: from the deepest sea floor to where the Earth is a disc of 7 degrees.
pub const VIEW_HEIGHT_M: [f64; 2] = [-12_000.0, 100_000_000.0];
/// Characters of a view's name: what a button holds.
pub const VIEW_NAME_MAX: usize = 64;

impl NamedView {
    /// Where an eye looks that nobody told otherwise.
    pub fn straight_down_deg() -> f64 {
        -90.0
    }

    /// What is wrong with it, in words that name the key.
    pub fn check(&self) -> Result<(), String> {
        if self.name.trim().is_empty() || self.name.chars().count() > VIEW_NAME_MAX {
            return Err(format!("name = {:?} is not of 1 to {VIEW_NAME_MAX} characters", self.name));
        }
        let [low_m, high_m] = VIEW_HEIGHT_M;
        let ranges = [
            ("lon_deg", self.lon_deg, -360.0, 360.0),
            ("lat_deg", self.lat_deg, -90.0, 90.0),
            ("height_m", self.height_m, low_m, high_m),
            ("heading_deg", self.heading_deg, -360.0, 360.0),
            ("pitch_deg", self.pitch_deg, -90.0, 90.0),
        ];
        match ranges.into_iter().find(|(_, value, low, high)| !(*low..=*high).contains(value)) {
            Some((key, value, low, high)) => Err(format!("{key} = {value} is not from {low} to {high}")),
            None => Ok(()),
        }
    }

    fn straight_down(name: &str, place: Geodetic) -> Self {
        Self {
            name: name.to_owned(),
            lon_deg: place.lon_deg(),
            lat_deg: place.lat_deg(),
            height_m: place.height_m,
            heading_deg: 0.0,
            pitch_deg: Self::straight_down_deg(),
        }
    }

    /// From `eye` to `target`, both Earth-centred; the eye must not be above the target.
    fn towards(name: &str, eye: Point<Ecef>, target: Point<Ecef>) -> Self {
        let place = Geodetic::from_ecef(eye);
        let ahead = (place.ecef_from_enu().inverse() * (target - eye)).xyz();
        Self {
            heading_deg: ahead.x.atan2(ahead.y).to_degrees(),
            pitch_deg: ahead.z.atan2(ahead.x.hypot(ahead.y)).to_degrees(),
            ..Self::straight_down(name, place)
        }
    }
}

/// From how high the home view looks down, metres: the whole disc of the Earth, with room round it.
pub const HOME_HEIGHT_M: f64 = 12_000_000.0;
/// Where the home view is of a world whose data lie all round the Earth: Europe and Africa, degrees.
const HOME_ANYWHERE_DEG: [f64; 2] = [30.0, 10.0];
/// Mean length of the directions to several places below which they have no middle: 60 degrees apart from it.
const MIDDLE_MIN: f64 = 0.5;
/// Nodes of an index that are looked through for the finest data; larger worlds open with [`HOME_ANYWHERE_DEG`].
const FINEST_NODES_MAX: u64 = 1 << 20;
/// Distance from which a ball is seen whole, in its radii: 60 degrees across.
const DISTANCE_IN_RADII: f64 = 2.0;
/// A single kiosk is not looked at from nearer than twice this, metres.
const RADIUS_MIN_M: f64 = 50.0;
/// Larger collections are looked at from straight above: the Earth's curve would hide half of them.
const OBLIQUE_RADIUS_MAX_M: f64 = 1_000_000.0;
/// How far above the highest ground below it an eye is put, metres.
const CLEARANCE_M: f64 = 10.0;

/// What a viewer of a world offers: the globe first, then the world's own views; where it has none, one of each
/// collection that has objects.
pub fn bookmarks(manifest: &Manifest, index: &IndexForest) -> Vec<NamedView> {
    let mut views = vec![home(manifest, index)];
    if manifest.views.is_empty() {
        views.extend(extents(manifest, index).map(|(info, bounds)| overview(&info.name, &bounds, index)));
        views.retain(|view| view.check().is_ok());
    } else {
        views.extend(manifest.views.iter().cloned());
    }
    views
}

/// The whole Earth, from above the middle of the collections, else of the finest data.
fn home(manifest: &Manifest, index: &IndexForest) -> NamedView {
    let centers: Vec<DVec3> = extents(manifest, index).map(|(_, bounds)| bounds.center().up()).collect();
    let largest = || {
        let (_, bounds) = extents(manifest, index).max_by_key(|(info, _)| info.objects)?;
        Some(bounds.center())
    };
    let [lat_deg, lon_deg] = HOME_ANYWHERE_DEG;
    let middle = middle(&centers).or_else(largest).or_else(|| middle(&finest(index)));
    let place = middle.unwrap_or(Geodetic::from_degrees(lat_deg, lon_deg, 0.0));
    NamedView::straight_down("Globe", place.at_height(HOME_HEIGHT_M))
}

/// The place that all directions are within about 60 degrees of.
fn middle(directions: &[DVec3]) -> Option<Geodetic> {
    let mean = directions.iter().sum::<DVec3>() / directions.len().max(1) as f64;
    // Directions are ellipsoid normals: their latitude is the geodetic one.
    let lat_rad = mean.z.atan2(mean.x.hypot(mean.y));
    (mean.length() >= MIDDLE_MIN).then(|| Geodetic { lat_rad, lon_rad: mean.y.atan2(mean.x), height_m: 0.0 })
}

/// Directions to the cells of the finest level that holds data.
fn finest(index: &IndexForest) -> Vec<DVec3> {
    if index.node_count() > FINEST_NODES_MAX || !index.is_whole() {
        return Vec::new();
    }
    let cells = || {
        let nodes = index.trees().flat_map(IndexTree::nodes);
        nodes.filter(|node| node.terrain().is_some() || node.imagery().is_some()).map(|node| node.cell())
    };
    let level = cells().map(CellId::level).max().unwrap_or(0);
    cells().filter(|cell| cell.level() == level).map(|cell| cell.bounds().center().up()).collect()
}

/// Collections with objects, and where those are.
fn extents<'a>(
    manifest: &'a Manifest,
    index: &'a IndexForest,
) -> impl Iterator<Item = (&'a CollectionInfo, GeoBounds)> + 'a {
    manifest.collections.iter().enumerate().filter(|(_, info)| info.objects > 0).filter_map(move |(number, info)| {
        let [west, south, east, north] = info.bounds_deg;
        let in_order =
            -360.0 <= west && west <= east && east <= 360.0 && -90.0 <= south && south <= north && north <= 90.0;
        let bounds = in_order.then(|| GeoBounds::from_degrees(west, south, east, north))?;
        Some((info, if bounds.width_rad() > PI { across_antimeridian(bounds, number, index) } else { bounds }))
    })
}

/// Bounds of more than half the Earth's width may be those of a collection on both sides of the antimeridian; where its
/// pages lie tells; where the index is not whole, cells with objects in absent segments count as pages of it. A
/// collection all round the Earth keeps its bounds.
fn across_antimeridian(bounds: GeoBounds, number: usize, index: &IndexForest) -> GeoBounds {
    let nodes = index.trees().flat_map(IndexTree::nodes);
    let may_hold = |node: &Node<'_>| node.dimension_m() > 0.0 && node.absent_children().next().is_some();
    let has_page = |node: &Node<'_>| node.objects().any(|entry| usize::from(entry.collection) == number);
    let pages = nodes.filter(|node| has_page(node) || may_hold(node));
    let (mut west_rad, mut east_rad) = (f64::INFINITY, f64::NEG_INFINITY);
    for page in pages {
        let lon_rad = page.cell().bounds().center().lon_rad.rem_euclid(TAU);
        (west_rad, east_rad) = (west_rad.min(lon_rad), east_rad.max(lon_rad));
    }
    if east_rad >= west_rad && east_rad - west_rad < PI { GeoBounds { west_rad, east_rad, ..bounds } } else { bounds }
}

/// Looks north over a rectangle, down by 45 degrees, from where all of it is seen.
fn overview(name: &str, bounds: &GeoBounds, index: &IndexForest) -> NamedView {
    let (low_m, high_m) = ground_m(bounds.center(), index);
    let target = bounds.center().at_height((low_m + high_m) / 2.0);
    let corner_m = |(u, v)| bounds.at(u, v, target.height_m).to_ecef().distance_m(target.to_ecef());
    let corners = [(0.0, 0.0), (0.5, 0.0), (1.0, 0.0), (0.0, 1.0), (0.5, 1.0), (1.0, 1.0)];
    let across_m = corners.into_iter().map(corner_m).fold(0.0, f64::max);
    let radius_m = across_m.hypot((high_m - low_m) / 2.0).max(RADIUS_MIN_M);
    let distance_m = DISTANCE_IN_RADII * radius_m;
    if radius_m > OBLIQUE_RADIUS_MAX_M {
        return NamedView::straight_down(name, target.at_height(distance_m.min(HOME_HEIGHT_M)));
    }
    let back = DVec3::new(0.0, -1.0, 1.0).normalize() * distance_m;
    let eye = Geodetic::from_ecef(target.ecef_from_enu() * Point::<Enu>::new(back));
    let (_, below_m) = ground_m(eye, index);
    let eye = eye.at_height(eye.height_m.max(below_m + CLEARANCE_M));
    NamedView::towards(name, eye.to_ecef(), target.to_ecef())
}

/// Lowest and highest ground round a place, as far as the index tells, metres.
fn ground_m(place: Geodetic, index: &IndexForest) -> (f64, f64) {
    let cell = CellId::containing(place.lat_rad, place.lon_rad, LEVEL_MAX);
    index.find_deepest(cell).map_or((0.0, 0.0), |node| node.height_range_m())
}
