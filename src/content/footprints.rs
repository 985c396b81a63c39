//! The footprints of a page's objects, kept to be asked at run time: is a place inside, where does a ray meet the prism?
//!
//! Corners are f32 metres east and north of the object's place, in the tangent plane there. Walls stand upright in that
//! frame and roofs are level, whereas the drawn ones follow the ellipsoid's normals: half a kilometre from the place
//! this is 2 cm in height, and 1 cm across at 100 m above the base.

use super::objects::{Object, ObjectPage};
use super::prism::Prism;
use crate::geodesy::{Ecef, Geodetic, Point, Ray, SEMI_MAJOR_M, normal_through};
use glam::{DVec2, DVec3};
use std::f64::consts::FRAC_1_SQRT_2;
use std::ops::Range;

/// Walls count as this much wider, as a share of their width, so that no ray slips through between two of them.
const SEAM: f64 = 1e-9;
/// What rounding to f32 may take from a ball, as a share of its distance from the page's origin.
const BALL_ROUNDING: f64 = 1e-6;

/// Footprints by object, and balls round what a cell and the page hold.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Footprints {
    corners_m: Vec<[f32; 2]>,
    /// End of each ring in `corners_m`; a ring begins where the one before ends.
    rings: Vec<u32>,
    objects: Vec<Entry>,
    /// In the order of [`ObjectPage::cells`].
    cells: Vec<Ball>,
    page: Option<Ball>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Entry {
    /// End of the object's rings in `rings`.
    rings_end: u32,
    foundation_m: f32,
}

/// Bounds drawn prisms, without lifts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ball {
    /// From the page's origin, Earth-fixed axes.
    center_m: [f32; 3],
    radius_m: f32,
}

impl Ball {
    pub fn center(&self, origin: Point<Ecef>) -> Point<Ecef> {
        Point::new(origin.xyz() + DVec3::from(self.center_m.map(f64::from)))
    }

    pub fn radius_m(&self) -> f64 {
        f64::from(self.radius_m)
    }

    /// A ball round balls given by centre and radius; `None` round nothing.
    fn around(balls: impl Iterator<Item = (DVec3, f64)> + Clone, origin: DVec3) -> Option<Self> {
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for (center, radius_m) in balls.clone() {
            low = low.min(center - radius_m);
            high = high.max(center + radius_m);
        }
        if !low.cmple(high).all() {
            return None;
        }
        let middle = (low + high) / 2.0;
        let radius_m = balls.map(|(center, radius_m)| center.distance(middle) + radius_m).fold(0.0, f64::max);
        let center = middle - origin;
        let radius_m = (radius_m + BALL_ROUNDING * (center.length() + radius_m)) as f32;
        Some(Self { center_m: center.as_vec3().to_array(), radius_m })
    }
}

impl Footprints {
    /// Of prisms in the page's order, with their objects; `cells` are the ranges of the page's directory.
    pub(super) fn new<'a>(
        prisms: &[Prism],
        objects: &[Object],
        cells: impl Iterator<Item = &'a Range<u32>>,
        origin: Point<Ecef>,
    ) -> Self {
        let mut footprints = Self::default();
        for (prism, object) in prisms.iter().zip(objects) {
            footprints.push(prism, object);
        }
        let balls: Vec<_> = objects.iter().enumerate().map(|(at, object)| footprints.ball_of(at, object)).collect();
        let ball = |range: Range<usize>| Ball::around(balls[range].iter().copied(), origin.xyz());
        // No cell of a directory is empty.
        footprints.cells = cells.filter_map(|range| ball(range.start as usize..range.end as usize)).collect();
        footprints.page = ball(0..balls.len());
        footprints
    }

    fn push(&mut self, prism: &Prism, object: &Object) {
        let enu_from_ecef = place(object).ecef_from_enu().inverse();
        for ring in &prism.rings {
            self.corners_m.extend(ring.iter().map(|&[lon_rad, lat_rad]| {
                let corner = Geodetic { lat_rad, lon_rad, height_m: f64::from(object.base_m) };
                let p = (enu_from_ecef * corner.to_ecef()).xyz();
                [p.x as f32, p.y as f32]
            }));
            self.rings.push(self.corners_m.len() as u32);
        }
        self.objects.push(Entry { rings_end: self.rings.len() as u32, foundation_m: prism.foundation_m });
    }

    /// Centre and radius of a ball round an object as drawn without lift.
    fn ball_of(&self, which: usize, object: &Object) -> (DVec3, f64) {
        let foundation_m = self.objects.get(which).map_or(0.0, |entry| f64::from(entry.foundation_m));
        let (low_m, high_m) = (-foundation_m, f64::from(object.top_m) - f64::from(object.base_m));
        let center = object.place.xyz() + normal_through(object.place) * ((low_m + high_m) / 2.0);
        // A corner lies below the tangent plane by its distance squared over 2a.
        let across_m = f64::from(object.reach_m) * FRAC_1_SQRT_2;
        let sag_m = across_m * across_m / SEMI_MAJOR_M;
        (center, across_m.hypot((high_m - low_m).abs() / 2.0) + sag_m + 0.01)
    }

    pub(super) fn byte_len(&self) -> usize {
        size_of_val(&*self.corners_m)
            + size_of_val(&*self.rings)
            + size_of_val(&*self.objects)
            + size_of_val(&*self.cells)
    }

    fn ring_end(&self, ring: usize) -> usize {
        self.rings.get(ring).map_or(0, |&end| end as usize)
    }

    fn rings_end(&self, object: usize) -> usize {
        self.objects.get(object).map_or(0, |entry| entry.rings_end as usize)
    }

    /// The rings of an object.
    fn rings_of(&self, which: usize) -> impl Iterator<Item = &[[f32; 2]]> {
        let first = which.checked_sub(1).map_or(0, |before| self.rings_end(before));
        (first..self.rings_end(which)).map(|ring| {
            let start = ring.checked_sub(1).map_or(0, |before| self.ring_end(before));
            self.corners_m.get(start..self.ring_end(ring)).unwrap_or_default()
        })
    }

    fn edges_of(&self, which: usize) -> impl Iterator<Item = [DVec2; 2]> {
        self.rings_of(which).flat_map(|ring| {
            let corner = |at: usize| DVec2::new(f64::from(ring[at][0]), f64::from(ring[at][1]));
            (0..ring.len()).map(move |at| [corner(at), corner((at + 1) % ring.len())])
        })
    }

    /// Whether a point of the tangent plane lies inside, by the even-odd rule, or within `margin_m` of an edge.
    fn holds(&self, which: usize, p: DVec2, margin_m: f64) -> bool {
        let mut inside = false;
        for edge in self.edges_of(which) {
            if margin_m > 0.0 && distance_m(edge, p) <= margin_m {
                return true;
            }
            inside ^= crosses(edge, p);
        }
        inside
    }
}

/// Whether the ray from a point towards the east crosses an edge; each end counts with one of its two edges.
fn crosses([a, b]: [DVec2; 2], p: DVec2) -> bool {
    (a.y > p.y) != (b.y > p.y) && p.x < a.x + (p.y - a.y) / (b.y - a.y) * (b.x - a.x)
}

fn distance_m([a, b]: [DVec2; 2], p: DVec2) -> f64 {
    let along = b - a;
    let t = ((p - a).dot(along) / along.length_squared()).clamp(0.0, 1.0);
    // An edge without length is a point.
    if t.is_nan() { a.distance(p) } else { (a + along * t).distance(p) }
}

/// Where a ray meets the outside of an upright wall, which lies on the right of its edge.
fn meet_wall([a, b]: [DVec2; 2], heights_m: (f64, f64), origin: DVec3, direction: DVec3) -> Option<f64> {
    let along = b - a;
    let outward = DVec2::new(along.y, -along.x);
    let towards = direction.truncate().dot(outward);
    if towards >= 0.0 || towards.is_nan() {
        return None;
    }
    let t = (a - origin.truncate()).dot(outward) / towards;
    let hit = origin + direction * t;
    let share = (hit.truncate() - a).dot(along) / along.length_squared();
    let is_on_it = t >= 0.0 && (-SEAM..=1.0 + SEAM).contains(&share) && (heights_m.0..=heights_m.1).contains(&hit.z);
    is_on_it.then_some(t)
}

fn place(object: &Object) -> Geodetic {
    Geodetic { lat_rad: object.lat_rad, lon_rad: object.lon_rad, height_m: f64::from(object.base_m) }
}

impl ObjectPage {
    /// Bounds all that is drawn of the page without lifts; `None` for a page without footprints.
    pub fn ball(&self) -> Option<Ball> {
        self.footprints.page
    }

    /// Bounds the objects of an entry of the directory without lifts.
    pub fn cell_ball(&self, entry: usize) -> Option<Ball> {
        self.footprints.cells.get(entry).copied()
    }

    /// Centre and radius, metres, of a ball round an object without its lift; `None` where there is none.
    pub fn object_ball(&self, which: usize) -> Option<(Point<Ecef>, f64)> {
        let (center, radius_m) = self.footprints.ball_of(which, self.objects.get(which)?);
        Some((Point::new(center), radius_m))
    }

    /// How far an object's walls go on below its base, metres.
    pub fn foundation_m(&self, which: usize) -> f64 {
        self.footprints.objects.get(which).map_or(0.0, |entry| f64::from(entry.foundation_m))
    }

    /// Whether an object's footprint, grown by `margin_m` (0 or more), holds a place.
    pub fn footprint_holds(&self, which: usize, lat_rad: f64, lon_rad: f64, margin_m: f64) -> bool {
        let Some(object) = self.objects.get(which) else { return false };
        let place = place(object);
        let there = Geodetic { lat_rad, lon_rad, ..place }.to_ecef();
        let p = (place.ecef_from_enu().inverse() * there).xyz();
        // What lies further than its footprint reaches, on the other side of the Earth too.
        let reach_m = f64::from(object.reach_m) + margin_m;
        p.length() <= reach_m * 1.01 + 0.01 && self.footprints.holds(which, p.truncate(), margin_m)
    }

    /// Distance along a ray to the outside of an object's walls or roof, as drawn `lift_m` above where it is stored.
    pub fn meet_ray(&self, which: usize, ray: &Ray, lift_m: f64) -> Option<f64> {
        let object = self.objects.get(which)?;
        let place = place(object);
        let enu_from_ecef = place.at_height(place.height_m + lift_m).ecef_from_enu().inverse();
        let origin = (enu_from_ecef * ray.origin).xyz();
        let direction = enu_from_ecef.rotation() * ray.direction;
        let top_m = f64::from(object.top_m) - f64::from(object.base_m);
        let heights_m = (-self.foundation_m(which), top_m);
        let walls = self.footprints.edges_of(which).filter_map(|edge| meet_wall(edge, heights_m, origin, direction));
        walls.chain(self.meet_roof(which, top_m, origin, direction)).min_by(f64::total_cmp)
    }

    fn meet_roof(&self, which: usize, top_m: f64, origin: DVec3, direction: DVec3) -> Option<f64> {
        let t = (top_m - origin.z) / direction.z;
        let hit = (origin + direction * t).truncate();
        (direction.z < 0.0 && t >= 0.0 && self.footprints.holds(which, hit, 0.0)).then_some(t)
    }
}

#[cfg(test)]
#[path = "footprints_tests.rs"]
mod tests;
