//! Roofs by the tags of OpenStreetMap's *Simple 3D Buildings*, over cleaned footprints.
//!
//! A roof with ridges is the lower envelope of planes over the smallest turned rectangle round the footprint, cut to the
//! footprint: it stays within the outline, and walls end where it does. A pointed or domed one draws the outline in
//! towards its middle. The height of a building counts to its ridge; storeys do not count the roof's.

mod envelope;
mod frame;
mod radial;

use super::clean::{Footprint, Plane, Reason};
use super::rules::STOREY_M;
use crate::content::{Detail, DetailCorner, FaceGroup, FaceKind};
use crate::prepare::expression::Expression;
use frame::Frame;
use geo::Coord;
use glam::DVec3;
use serde_json::{Map, Value};
use std::collections::{BTreeSet, HashMap};

/// What a roof is like.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RoofShape {
    Flat,
    Gabled,
    Hipped,
    HalfHipped,
    Pyramidal,
    Skillion,
    Gambrel,
    Mansard,
    Round,
    Dome,
    Onion,
}

impl RoofShape {
    /// By the value of `roof:shape`; `None` for what cannot be drawn.
    pub fn parse(name: &str) -> Option<Self> {
        Some(match name.trim().to_ascii_lowercase().replace(['-', ' '], "_").as_str() {
            "flat" | "no" | "terrace" => Self::Flat,
            "gabled" | "pitched" => Self::Gabled,
            "hipped" => Self::Hipped,
            "half_hipped" => Self::HalfHipped,
            "pyramidal" | "tented" | "cone" | "conical" => Self::Pyramidal,
            "skillion" | "lean_to" | "monopitch" => Self::Skillion,
            "gambrel" => Self::Gambrel,
            "mansard" => Self::Mansard,
            "round" | "barrel" => Self::Round,
            "dome" => Self::Dome,
            "onion" => Self::Onion,
            _ => return None,
        })
    }
}

/// The slope of a roof of which nothing but its shape is known: its rise over half its width.
const RISE: f64 = 0.577;
/// Such a roof takes no more than this share of the building's height.
const SHARE_MAX: f64 = 0.5;
/// Lower roofs are flat, metres.
const HEIGHT_MIN_M: f64 = 0.05;
/// Corners nearer than this are one, metres.
const WELD_M: f64 = 1e-3;

/// A roof that is to be drawn.
#[derive(Clone, Debug, PartialEq)]
pub struct RoofRule {
    pub shape: RoofShape,
    height: Height,
    /// Clockwise from north, radians: where the roof slopes down to.
    direction_rad: Option<f64>,
    /// The ridge runs across the longer side.
    across: bool,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Height {
    Metres(f64),
    /// Rise over run.
    Slope(f64),
    Unknown,
}

impl RoofRule {
    pub fn new(shape: RoofShape, attributes: &Map<String, Value>) -> Self {
        let number = |name: &str| Expression::Attribute(name.into()).value(attributes).ok().flatten();
        let metres = number("roof:height").filter(|height| (0.0..500.0).contains(height));
        let levels = number("roof:levels").filter(|levels| (0.1..50.0).contains(levels)).map(|n| n * STOREY_M);
        let slope = number("roof:angle").filter(|angle| (1.0..85.0).contains(angle)).map(|a| a.to_radians().tan());
        let height = match (metres.or(levels), slope) {
            (Some(metres), _) => Height::Metres(metres),
            (None, Some(slope)) => Height::Slope(slope),
            (None, None) => Height::Unknown,
        };
        let text = |name: &str| attributes.get(name).and_then(Value::as_str);
        let direction = number_or_compass(attributes.get("roof:direction"));
        let across = text("roof:orientation").is_some_and(|value| value == "across");
        Self { shape, height, direction_rad: direction.map(f64::to_radians), across }
    }

    /// Height of the roof over a footprint, metres; `room_m` is what the building has. What had to be assumed is noted.
    pub fn height_m(&self, footprint: &Footprint, room_m: f64, notes: &mut BTreeSet<Reason>) -> f64 {
        let frame = self.frame(footprint);
        let run_m = match self.shape {
            RoofShape::Skillion => 2.0 * frame.across_m,
            RoofShape::Pyramidal | RoofShape::Dome | RoofShape::Onion => frame.along_m.min(frame.across_m),
            _ => frame.across_m,
        };
        match self.height {
            Height::Metres(metres) => metres,
            Height::Slope(slope) => slope * run_m,
            Height::Unknown => {
                notes.insert("roof height by its shape");
                let rise = match self.shape {
                    RoofShape::Dome => 1.0,
                    RoofShape::Onion => 1.6,
                    RoofShape::Skillion => RISE / 2.0,
                    _ => RISE,
                };
                (rise * run_m).min(SHARE_MAX * room_m)
            }
        }
    }

    fn frame(&self, footprint: &Footprint) -> Frame {
        Frame::new(&flat(footprint), self.shape, self.direction_rad, self.across)
    }

    /// Walls from `foot_m` and the roof from the eaves to the top, metres above the ellipsoid; `None` where this shape
    /// does not fit the footprint.
    pub fn detail(&self, footprint: &Footprint, foot_m: f64, eaves_m: f64, top_m: f64) -> Option<Detail> {
        let height_m = top_m - eaves_m;
        if self.shape == RoofShape::Flat || height_m < HEIGHT_MIN_M {
            return None;
        }
        let rings = flat(footprint);
        let mut mesh = RoofMesh::new(plane(footprint));
        let levels = Levels { foot_m, eaves_m, height_m };
        let drawn = match radial::profile(self.shape) {
            Some(profile) => radial::draw(&rings, profile, levels, &mut mesh),
            None => false,
        };
        if !drawn {
            let planes = envelope::planes(self.shape, &self.frame(footprint), height_m)?;
            envelope::draw(&rings, &footprint.triangles, &planes, levels, &mut mesh);
        }
        mesh.finish()
    }
}

fn number_or_compass(value: Option<&Value>) -> Option<f64> {
    const COMPASS: [&str; 16] =
        ["N", "NNE", "NE", "ENE", "E", "ESE", "SE", "SSE", "S", "SSW", "SW", "WSW", "W", "WNW", "NW", "NNW"];
    let value = value?;
    let Some(text) = value.as_str() else { return value.as_f64() };
    let text = text.trim().to_ascii_uppercase();
    let point = COMPASS.iter().position(|point| *point == text);
    point.map(|at| at as f64 * 22.5).or_else(|| text.trim_end_matches('°').parse().ok()).filter(|deg| deg.is_finite())
}

/// Heights above the ellipsoid, metres.
#[derive(Clone, Copy)]
struct Levels {
    foot_m: f64,
    eaves_m: f64,
    /// Of the roof.
    height_m: f64,
}

fn plane(footprint: &Footprint) -> Plane {
    let first = footprint.rings.iter().flatten().next();
    Plane::about(first.copied().unwrap_or_default())
}

/// The rings in local metres.
fn flat(footprint: &Footprint) -> Vec<Vec<Coord>> {
    let plane = plane(footprint);
    footprint.rings.iter().map(|ring| ring.iter().map(|&point| plane.to(point)).collect()).collect()
}

/// A roof and its walls in the making.
struct RoofMesh {
    plane: Plane,
    corners: Vec<DVec3>,
    by_place: HashMap<[i64; 3], u32>,
    walls: Vec<[u32; 3]>,
    roofs: Vec<[u32; 3]>,
}

impl RoofMesh {
    fn new(plane: Plane) -> Self {
        Self { plane, corners: Vec::new(), by_place: HashMap::new(), walls: Vec::new(), roofs: Vec::new() }
    }

    fn corner(&mut self, flat: Coord, height_m: f64) -> u32 {
        let place = DVec3::new(flat.x, flat.y, height_m);
        let key = place.to_array().map(|metres| (metres / WELD_M).round() as i64);
        *self.by_place.entry(key).or_insert_with(|| {
            self.corners.push(place);
            self.corners.len() as u32 - 1
        })
    }

    /// A convex polygon, counter-clockwise from outside, as a fan; corners that are one go.
    fn fan(&mut self, kind: FaceKind, mut corners: Vec<u32>) {
        corners.dedup();
        while corners.len() > 1 && corners.first() == corners.last() {
            corners.pop();
        }
        let triangles = if kind == FaceKind::Wall { &mut self.walls } else { &mut self.roofs };
        let Some((&first, rest)) = corners.split_first() else { return };
        triangles.extend(rest.windows(2).map(|edge| [first, edge[0], edge[1]]));
    }

    fn finish(self) -> Option<Detail> {
        let corner = |place: &DVec3| {
            let [lon_rad, lat_rad] = self.plane.back(Coord { x: place.x, y: place.y });
            DetailCorner { lon_rad, lat_rad, height_m: place.z as f32 }
        };
        let group = |kind, triangles: Vec<[u32; 3]>| FaceGroup { kind, color: None, texture: None, triangles };
        let groups = vec![group(FaceKind::Wall, self.walls), group(FaceKind::Roof, self.roofs)];
        let sound = !groups[1].triangles.is_empty();
        sound.then(|| Detail { corners: self.corners.iter().map(corner).collect(), uvs: Vec::new(), groups })
    }
}

#[cfg(test)]
#[path = "tests.rs"]
mod tests;
