//! Roofs that are the lower envelope of planes: each triangle of the footprint is cut to where each plane is the lowest.
//! Both sides of an edge are cut at the same places, so that the roof is watertight.

use super::frame::Frame;
use super::{Levels, RoofMesh, RoofShape};
use crate::content::FaceKind;
use geo::Coord;

/// Height above the eaves, metres: `at[0] + at[1] x + at[2] y`.
#[derive(Clone, Copy, Debug)]
pub struct Slope([f64; 3]);

impl Slope {
    fn at(&self, point: Coord) -> f64 {
        self.0[0] + self.0[1] * point.x + self.0[2] * point.y
    }
}

/// Planes through which a barrel's arc is drawn.
const ARC_CHORDS: usize = 8;
/// Where a mansard's or a gambrel's steep part ends: share of its height, and of its half width from the eaves.
const BREAK_HEIGHT: f64 = 0.7;
const BREAK_RUN: f64 = 0.35;
/// Planes nearer than this are the same there, metres.
const SAME_M: f64 = 1e-7;

/// `None` for shapes that are no envelope.
pub fn planes(shape: RoofShape, frame: &Frame, height_m: f64) -> Option<Vec<Slope>> {
    let sides = Sides { frame, height_m };
    let (run_m, short_m) = (frame.across_m, frame.across_m.min(frame.along_m));
    let pitch = height_m / run_m;
    Some(match shape {
        RoofShape::Gabled => sides.ridged(0.0, pitch).to_vec(),
        RoofShape::Hipped => [sides.ridged(0.0, pitch), sides.hips(0.0, height_m / short_m)].concat(),
        RoofShape::HalfHipped => [sides.ridged(0.0, pitch), sides.hips(height_m / 2.0, height_m / short_m)].concat(),
        RoofShape::Pyramidal => [sides.ridged(0.0, pitch), sides.hips(0.0, height_m / frame.along_m)].concat(),
        RoofShape::Skillion => vec![sides.across(0.0, pitch / 2.0, -1.0)],
        RoofShape::Gambrel => sides.broken(run_m).map(|(at_m, pitch)| sides.ridged(at_m, pitch)).concat(),
        RoofShape::Mansard => {
            let both = |(at_m, pitch)| [sides.ridged(at_m, pitch), sides.hips(at_m, pitch)].concat();
            sides.broken(short_m).map(both).concat()
        }
        RoofShape::Round => sides.arc(),
        RoofShape::Flat | RoofShape::Dome | RoofShape::Onion => return None,
    })
}

/// Makes planes over a rectangle.
struct Sides<'a> {
    frame: &'a Frame,
    height_m: f64,
}

impl Sides<'_> {
    /// Rises from `at_m` on one side of the ridge (1 left, -1 right) towards the other.
    fn across(&self, at_m: f64, pitch: f64, side: f64) -> Slope {
        let inwards = self.frame.along.perp() * -side;
        self.slope(at_m + pitch * self.frame.across_m, inwards * pitch)
    }

    fn ridged(&self, at_m: f64, pitch: f64) -> [Slope; 2] {
        [1.0, -1.0].map(|side| self.across(at_m, pitch, side))
    }

    fn hips(&self, at_m: f64, pitch: f64) -> [Slope; 2] {
        [1.0, -1.0].map(|end| self.slope(at_m + pitch * self.frame.along_m, self.frame.along * -end * pitch))
    }

    /// A plane by its height in the middle and its gradient.
    fn slope(&self, middle_m: f64, gradient: glam::DVec2) -> Slope {
        Slope([middle_m - gradient.dot(self.frame.middle), gradient.x, gradient.y])
    }

    /// A steep part from the eaves and a gentle one to the top over a run: heights at the eaves, and pitches.
    fn broken(&self, run_m: f64) -> [(f64, f64); 2] {
        let steep = BREAK_HEIGHT * self.height_m / (BREAK_RUN * run_m);
        let gentle = (1.0 - BREAK_HEIGHT) * self.height_m / ((1.0 - BREAK_RUN) * run_m);
        [(0.0, steep), (BREAK_HEIGHT * self.height_m - gentle * BREAK_RUN * run_m, gentle)]
    }

    /// Chords of half an ellipse across the ridge.
    fn arc(&self) -> Vec<Slope> {
        let point = |at: usize| {
            let (sin, cos) = (std::f64::consts::PI * at as f64 / ARC_CHORDS as f64).sin_cos();
            (self.frame.across_m * cos, self.height_m * sin)
        };
        let chord = |at: usize| {
            let ((v0, z0), (v1, z1)) = (point(at), point(at + 1));
            let rise = (z1 - z0) / (v1 - v0);
            self.slope(z0 - rise * v0, self.frame.along.perp() * rise)
        };
        (0..ARC_CHORDS).map(chord).collect()
    }
}

fn lowest_m(planes: &[Slope], point: Coord) -> f64 {
    planes.iter().map(|plane| plane.at(point)).fold(f64::INFINITY, f64::min).max(0.0)
}

/// Draws the roof over the footprint's triangles, and walls up to it along its rings.
pub fn draw(rings: &[Vec<Coord>], triangles: &[[u16; 3]], planes: &[Slope], levels: Levels, mesh: &mut RoofMesh) {
    let points: Vec<Coord> = rings.concat();
    for triangle in triangles {
        let corners: Option<Vec<Coord>> = triangle.iter().map(|&at| points.get(usize::from(at)).copied()).collect();
        let Some(corners) = corners else { continue };
        for (at, own) in planes.iter().enumerate() {
            let piece = planes.iter().enumerate().fold(corners.clone(), |piece, (other_at, other)| {
                // Of planes that are the same, the first counts.
                if other_at == at { piece } else { clip(&piece, own, other) }
            });
            let top = |&point: &Coord| (point, levels.eaves_m + lowest_m(planes, point));
            let piece = piece.iter().map(top).map(|(point, height_m)| mesh.corner(point, height_m)).collect();
            mesh.fan(FaceKind::Roof, piece);
        }
    }
    for ring in rings {
        for (&from, &to) in ring.iter().zip(ring.iter().cycle().skip(1)) {
            wall(from, to, planes, levels, mesh);
        }
    }
}

/// The part of a convex polygon where one plane is no higher than another (Sutherland, Hodgman 1974).
fn clip(piece: &[Coord], own: &Slope, other: &Slope) -> Vec<Coord> {
    let above = |point: Coord| own.at(point) - other.at(point);
    let mut kept = Vec::with_capacity(piece.len() + 1);
    for (&from, &to) in piece.iter().zip(piece.iter().cycle().skip(1)) {
        let (a, b) = (above(from), above(to));
        if a <= SAME_M {
            kept.push(from);
        }
        if (a > SAME_M && b < -SAME_M) || (a < -SAME_M && b > SAME_M) {
            kept.push(between(from, to, a / (a - b)));
        }
    }
    kept
}

fn between(from: Coord, to: Coord, share: f64) -> Coord {
    Coord { x: from.x + (to.x - from.x) * share, y: from.y + (to.y - from.y) * share }
}

/// A wall from the foot up to the roof, which bends where the lowest plane changes.
fn wall(from: Coord, to: Coord, planes: &[Slope], levels: Levels, mesh: &mut RoofMesh) {
    let mut bends: Vec<f64> = Vec::new();
    for (at, one) in planes.iter().enumerate() {
        for other in &planes[at + 1..] {
            let (a, b) = (one.at(from) - other.at(from), one.at(to) - other.at(to));
            let share = a / (a - b);
            let crosses = (a > SAME_M && b < -SAME_M) || (a < -SAME_M && b > SAME_M);
            if crosses && one.at(between(from, to, share)) <= lowest_m(planes, between(from, to, share)) + SAME_M {
                bends.push(share);
            }
        }
    }
    bends.sort_by(f64::total_cmp);
    let foot = [from, to].map(|point| mesh.corner(point, levels.foot_m));
    let tops = std::iter::once(to).chain(bends.iter().rev().map(|&share| between(from, to, share))).chain([from]);
    let tops: Vec<u32> = tops.map(|point| mesh.corner(point, levels.eaves_m + lowest_m(planes, point))).collect();
    mesh.fan(FaceKind::Wall, [&foot[..], &tops].concat());
}
