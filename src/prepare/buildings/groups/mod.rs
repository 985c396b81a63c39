//! Groups: what stands for the objects of a whole subtree from afar (Varadhan & Manocha 2002, §3.1; design §5).
//!
//! Objects become columns over a grid along their walls; squares half covered and more are filled, and those of about
//! one height joined to blocks. What blocks would show wrongly by more than the error aimed at stays as it is: landmarks.
//! What is smaller than that error may vanish. The error told is measured: the farthest that any point of a roof is
//! from the nearest block, and a block's from the nearest roof (the Hausdorff distance of the roofs), an object that
//! vanished counting its own bounding dimension.

mod blocks;
mod columns;
mod plane;

use super::place::Ground;
use super::{Placed, place};
use crate::content::Prism;
use crate::forest::CellId;
use blocks::{Allowed, Block, blocks, simplified};
use columns::{Columns, Run, Shape, TileKey, tiles_of};
pub use plane::Plane;
use rayon::prelude::*;
use rustc_hash::FxHashSet;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Of the error aimed at: the squares' sides, how far a block's roof may be off those of its squares, its outline off
/// their sides, and the outlines of landmarks off what they are.
const SIDE_PER_ERROR: f64 = 0.4;
const STEP_PER_ERROR: f64 = 0.5;
const OUTLINE_PER_ERROR: f64 = 0.4;
const LANDMARK_PER_ERROR: f64 = 0.5;
/// How often landmarks are looked for.
const ROUNDS: usize = 8;

/// What stands for some objects.
#[derive(Debug, Default)]
pub struct Group {
    pub prisms: Vec<Prism>,
    /// Measured; metres.
    pub error_m: f64,
}

/// A part of a page: its cell, and the objects that it stands for.
pub type Part<'a> = (CellId, Vec<&'a Placed>);

/// The plane in which groups of some parts are made.
pub fn plane(parts: &[Part]) -> Plane {
    Plane::along_walls(parts.iter().flat_map(|(_, objects)| objects.iter().map(|object| object.plain())))
}

/// Makes groups of objects that the parts of a page stand for; `None` where blocks alone, before any landmark, take more
/// than `triangles_max`.
pub fn group(parts: &[Part], plane: &Plane, error_m: f64, ground: &Ground, triangles_max: usize) -> Option<Group> {
    let left = TrianglesLeft(AtomicUsize::new(triangles_max));
    // In whatever order parts come: one of them finds too few left where all together take more.
    let made: Option<Vec<Group>> =
        parts.par_iter().map(|(cell, objects)| part(*cell, objects, error_m, plane, ground, &left)).collect();
    Some(made?.into_iter().fold(Group::default(), |mut all, part| {
        all.prisms.extend(part.prisms);
        all.error_m = all.error_m.max(part.error_m);
        all
    }))
}

/// What the parts of a page share.
struct TrianglesLeft(AtomicUsize);

impl TrianglesLeft {
    /// `None` where there are fewer left, now or later.
    fn take(&self, triangles: usize) -> Option<()> {
        let less = |left: usize| Some(left.saturating_sub(triangles));
        let before = self.0.fetch_update(Ordering::Relaxed, Ordering::Relaxed, less);
        before.is_ok_and(|left| left >= triangles).then_some(())
    }
}

/// Objects with simpler outlines, no corner left out farther than `error_m` from what is left; those that are smaller
/// are left out.
pub fn simpler(objects: &[&Placed], plane: &Plane, error_m: f64) -> Vec<Prism> {
    let large = objects.par_iter().filter(|object| object.dimension_m() >= error_m);
    large.map(|object| simpler_one(object, plane, error_m)).collect()
}

/// The detail stays where the object without it is off by more than half of the error: the outline takes the rest.
fn simpler_one(object: &Placed, plane: &Plane, error_m: f64) -> Prism {
    let outline_m = error_m - object.plain_error_m();
    if outline_m < error_m / 2.0 {
        return object.prism.clone();
    }
    let prism = object.plain();
    with_outline(prism, &Shape::of(prism, plane), plane, outline_m)
}

/// A prism with a simpler outline.
fn with_outline(prism: &Prism, shape: &Shape, plane: &Plane, within_m: f64) -> Prism {
    match simplified(&shape.rings, within_m) {
        Some((rings, roof)) => Prism { rings: back(&rings, plane), roof, ..prism.clone() },
        None => prism.clone(),
    }
}

/// An object on its way into a group.
struct Member<'a> {
    placed: &'a Placed,
    shape: Shape,
    /// What it covers of the lattice.
    runs: Vec<Run>,
    dimension_m: f64,
    landmark: bool,
    /// How far what stands for it is off, metres.
    error_m: f64,
}

impl<'a> Member<'a> {
    fn new(placed: &'a Placed, plane: &Plane, step_m: f64) -> Self {
        let shape = Shape::of(placed.plain(), plane);
        let landmark = shape.is_beyond(step_m);
        let runs = if landmark { Vec::new() } else { shape.runs(step_m) };
        Self { placed, shape, runs, dimension_m: placed.dimension_m(), landmark, error_m: 0.0 }
    }

    fn is_in(&self, tiles: &FxHashSet<TileKey>) -> bool {
        tiles_of(&self.runs).any(|key| tiles.contains(&key))
    }

    fn is_about(&self, tiles: &FxHashSet<TileKey>, side_m: f64) -> bool {
        self.shape.tiles_about(side_m).any(|key| tiles.contains(&key))
    }

    /// How far the blocks that stand for it are off; 0 for landmarks, which stand for themselves. What is no larger than
    /// blocks may be off anyway is taken to vanish.
    fn measure_m(&self, columns: &Columns, outline_m: f64) -> f64 {
        if self.landmark {
            return 0.0;
        }
        if self.dimension_m <= columns.side_m + outline_m {
            return self.dimension_m;
        }
        let off_m = columns.distance_m(self.placed.plain(), &self.shape, &self.runs, self.dimension_m) + outline_m;
        off_m.min(self.dimension_m)
    }
}

/// Objects of one part of a page as blocks and landmarks.
struct Making<'a> {
    members: Vec<Member<'a>>,
    columns: Columns,
    made: BTreeMap<TileKey, Vec<Block>>,
    allowed: Allowed,
}

impl<'a> Making<'a> {
    fn new(objects: &[&'a Placed], error_m: f64, plane: &Plane) -> Self {
        let columns = Columns::new(error_m * SIDE_PER_ERROR);
        let members = objects.iter().map(|placed| Member::new(placed, plane, columns.step_m())).collect();
        let allowed =
            Allowed { step_m: error_m * STEP_PER_ERROR, outline_m: error_m * OUTLINE_PER_ERROR, smallest_m: error_m };
        let mut making = Self { members, columns, made: BTreeMap::new(), allowed };
        for (number, member) in making.members.iter().enumerate() {
            making.columns.add(number as u32, member.placed.plain(), &member.runs, &|_| true);
        }
        blocks(&mut making.columns, allowed, &|_| true, &mut making.made);
        making
    }

    fn block_triangles(&self) -> usize {
        self.made.values().flatten().map(Block::drawn_triangles).sum()
    }

    /// Makes landmarks of what is off by more than the error, and the tiles where they were anew, again and again.
    fn find_landmarks(&mut self, error_m: f64) {
        for member in &mut self.members {
            member.error_m = member.measure_m(&self.columns, self.allowed.outline_m);
        }
        for _ in 1..ROUNDS {
            let mut changed: FxHashSet<TileKey> = FxHashSet::default();
            for member in self.members.iter_mut().filter(|member| member.error_m > error_m) {
                (member.landmark, member.error_m) = (true, 0.0);
                changed.extend(tiles_of(&member.runs));
            }
            if changed.is_empty() {
                break;
            }
            self.make_anew(&changed);
        }
    }

    fn make_anew(&mut self, changed: &FxHashSet<TileKey>) {
        self.columns.clear(changed);
        let is_wanted = |key: TileKey| changed.contains(&key);
        for (number, member) in self.members.iter().enumerate().filter(|(_, member)| !member.landmark) {
            if member.is_in(changed) {
                self.columns.add(number as u32, member.placed.plain(), &member.runs, &is_wanted);
            }
        }
        blocks(&mut self.columns, self.allowed, &is_wanted, &mut self.made);
        for member in self.members.iter_mut().filter(|member| !member.landmark) {
            if member.is_about(changed, self.columns.side_m) {
                member.error_m = member.measure_m(&self.columns, self.allowed.outline_m);
            }
        }
    }
}

fn part(
    cell: CellId,
    objects: &[&Placed],
    error_m: f64,
    plane: &Plane,
    ground: &Ground,
    left: &TrianglesLeft,
) -> Option<Group> {
    let mut making = Making::new(objects, error_m, plane);
    left.take(making.block_triangles())?;
    making.find_landmarks(error_m);
    let Making { members, columns, made, allowed } = making;
    let landmark_m = error_m * LANDMARK_PER_ERROR;
    let landmarks = members
        .iter()
        .filter(|member| member.landmark)
        .map(|member| with_outline(member.placed.plain(), &member.shape, plane, landmark_m));
    let blocks = made.values().flatten().filter_map(|block| block.prism(&members, plane, ground));
    let mut prisms: Vec<Prism> = landmarks.chain(blocks).collect();
    prisms.iter_mut().for_each(|prism| prism.cell = cell);
    let has_landmarks = members.iter().any(|member| member.landmark);
    let least_m = columns.reverse_m(allowed.outline_m).max(if has_landmarks { landmark_m } else { 0.0 });
    // All this is measured against the objects without their details.
    let plain_m = members.iter().map(|member| member.placed.plain_error_m()).fold(0.0, f64::max);
    Some(Group { prisms, error_m: members.iter().map(|member| member.error_m).fold(least_m, f64::max) + plain_m })
}

impl Block {
    /// The block as a prism on its ground; `None` where all of it is below the ground.
    fn prism(&self, members: &[Member], plane: &Plane, ground: &Ground) -> Option<Prism> {
        let object = members.get(self.object as usize)?.placed.plain();
        let mut prism = Prism {
            id: object.id,
            rings: back(&self.rings, plane),
            roof: self.triangles.clone(),
            wall_color: object.wall_color,
            roof_color: object.roof_color,
            ..object.clone()
        };
        let footprint = prism.footprint();
        let own_m = (ground.height_m)(footprint.lat_rad, place::wrap(footprint.lon_rad));
        let base_m = self.base_m.max(own_m).min(self.top_m - Prism::WALL_MIN_M);
        (prism.base_m, prism.top_m) = (base_m as f32, self.top_m as f32);
        prism.foundation_m = (base_m - self.foot_m).max(Prism::FOUNDATION_MIN_M) as f32;
        Some(prism)
    }
}

fn back(rings: &[Vec<[f64; 2]>], plane: &Plane) -> Vec<Vec<[f64; 2]>> {
    rings.iter().map(|ring| ring.iter().map(|&corner| plane.back(corner)).collect()).collect()
}
