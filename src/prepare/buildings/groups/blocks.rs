//! Blocks: filled squares of one tile that touch along their sides, with roofs at about one height, as one footprint.

use super::columns::{Column, Columns, SAMPLES, TILE, Tile, TileKey};
use crate::prepare::buildings::clean::{polygon_of, triangulate};
use geo::{Area, Coord, LineString, Simplify};
use rustc_hash::FxHashMap;
use smallvec::SmallVec;
use std::collections::BTreeMap;

/// A block in the plane.
pub struct Block {
    /// Outer ring counter-clockwise, holes clockwise, metres; not closed.
    pub rings: Vec<Vec<[f64; 2]>>,
    /// Indices into the rings laid end to end, counter-clockwise.
    pub triangles: Vec<[u16; 3]>,
    pub top_m: f64,
    pub base_m: f64,
    pub foot_m: f64,
    /// The object with the most of it.
    pub object: u32,
}

impl Block {
    /// Of roof and walls.
    pub fn drawn_triangles(&self) -> usize {
        self.triangles.len() + 2 * self.rings.iter().map(Vec::len).sum::<usize>()
    }

    /// Largest side of its box along the axes of the plane, metres.
    fn dimension_m(&self) -> f64 {
        let [low, high] = self.bounds();
        (high[0] - low[0]).max(high[1] - low[1]).max(self.top_m - self.base_m)
    }

    fn bounds(&self) -> [[f64; 2]; 2] {
        self.rings.iter().flatten().fold([[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]], |[low, high], p| {
            [[low[0].min(p[0]), low[1].min(p[1])], [high[0].max(p[0]), high[1].max(p[1])]]
        })
    }

    /// Straightens the outline: a box where that reaches no farther out, else what keeps about the same area.
    fn simplify(&mut self, members: &[usize], side_m: f64, within_m: f64) {
        if self.rings.len() == 1 && self.rings[0].len() == 4 {
            return;
        }
        if is_about_a_box(members, within_m / side_m) {
            let [low, high] = self.bounds();
            self.rings = vec![vec![low, [high[0], low[1]], high, [low[0], high[1]]]];
            self.triangles = vec![[0, 1, 2], [0, 2, 3]];
        } else if let Some((rings, triangles)) = simplified(&self.rings, within_m) {
            (self.rings, self.triangles) = (rings, triangles);
        }
    }
}

/// Whether all empty squares of the squares' box share a side with a full one: no point of them is farther from it than
/// that side is long, which must be within what outlines may be off.
fn is_about_a_box(members: &[usize], within_sides: f64) -> bool {
    let at = |member: &usize| [*member as i32 % TILE, *member as i32 / TILE];
    let (low, high) = members.iter().map(at).fold(([i32::MAX; 2], [i32::MIN; 2]), |(low, high), [x, y]| {
        ([low[0].min(x), low[1].min(y)], [high[0].max(x + 1), high[1].max(y + 1)])
    });
    let mut is_full = [false; (TILE * TILE) as usize];
    members.iter().for_each(|&member| is_full[member] = true);
    let mut squares = (low[1]..high[1]).flat_map(|y| (low[0]..high[0]).filter_map(move |x| index(x, y)));
    within_sides >= 1.0 && squares.all(|at| is_full[at] || beside(at).any(|beside| is_full[beside]))
}

/// Rings, and triangles of what they enclose.
pub type Outline = (Vec<Vec<[f64; 2]>>, Vec<[u16; 3]>);

/// Rings and their triangles with fewer corners, no corner left out farther than `within_m` from what is left (Ramer,
/// Douglas, Peucker); `None` where nothing is gained or the area changes by more than a fifth.
pub fn simplified(rings: &[Vec<[f64; 2]>], within_m: f64) -> Option<Outline> {
    let polygon = polygon_of(rings, coord)?;
    let simple = polygon.simplify(within_m);
    let area = polygon.unsigned_area();
    let is_alike = (simple.unsigned_area() - area).abs() <= area * AREA_CHANGE_MAX;
    let open = |ring: &LineString| ring.0[..ring.0.len() - 1].iter().map(|point| [point.x, point.y]).collect();
    let simple_rings: Vec<Vec<[f64; 2]>> =
        std::iter::once(simple.exterior()).chain(simple.interiors()).map(open).collect();
    let corners = |rings: &[Vec<[f64; 2]>]| rings.iter().map(Vec::len).sum::<usize>();
    if !is_alike || corners(&simple_rings) >= corners(rings) {
        return None;
    }
    Some((simple_rings, triangulate(&simple)?))
}

fn coord([x, y]: [f64; 2]) -> Coord {
    Coord { x, y }
}

/// Straightened outlines may change their area by this part.
const AREA_CHANGE_MAX: f64 = 0.2;

/// What blocks may be off.
#[derive(Clone, Copy, Debug)]
pub struct Allowed {
    /// Squares' roofs from that of the block's first one, metres.
    pub step_m: f64,
    /// Outlines from the squares' sides, metres.
    pub outline_m: f64,
    /// Blocks smaller than this in every way are left out, metres.
    pub smallest_m: f64,
}

/// Joins the squares of the tiles that are wanted, and tells each square its block's roof.
pub fn blocks(
    columns: &mut Columns,
    allowed: Allowed,
    is_wanted: &dyn Fn(TileKey) -> bool,
    made: &mut BTreeMap<TileKey, Vec<Block>>,
) {
    let side_m = columns.side_m;
    for Tile { key, squares } in columns.tiles_mut().iter_mut().filter(|tile| is_wanted(tile.key)) {
        squares.iter_mut().for_each(|column| column.block_top_m = f32::NAN);
        let mut of_this = Vec::new();
        of_tile(*key, squares, allowed, side_m, &mut of_this);
        made.insert(*key, of_this);
    }
}

fn of_tile(key: TileKey, tile: &mut [Column], allowed: Allowed, side_m: f64, blocks: &mut Vec<Block>) {
    let heights: Vec<Option<f32>> = tile.iter().map(|column| column.is_filled().then_some(column.top_m)).collect();
    let mut block_of = vec![0u32; tile.len()];
    let mut count = 0;
    for start in 0..tile.len() {
        if heights[start].is_none() || block_of[start] != 0 {
            continue;
        }
        count += 1;
        let members = spread(start, count, &heights, allowed.step_m as f32, &mut block_of);
        let made = block(key, tile, &members, &|at| block_of[at] == count, side_m);
        let made = match made {
            Some(block) => vec![(block, members)],
            None => rows(key, tile, members, side_m),
        };
        for (mut block, members) in made {
            if block.dimension_m() < allowed.smallest_m {
                continue;
            }
            block.simplify(&members, side_m, allowed.outline_m);
            members.iter().for_each(|&at| tile[at].block_top_m = block.top_m as f32);
            blocks.push(block);
        }
    }
}

/// Squares that are reached along sides, and are about as high as the first.
fn spread(start: usize, number: u32, heights: &[Option<f32>], within_m: f32, block_of: &mut [u32]) -> Vec<usize> {
    let mut members = vec![start];
    block_of[start] = number;
    let mut next = 0;
    while let Some(&at) = members.get(next) {
        next += 1;
        for beside in beside(at) {
            let is_like = |(a, b): (f32, f32)| (a - b).abs() <= within_m;
            if block_of[beside] == 0 && heights[beside].zip(heights[start]).is_some_and(is_like) {
                block_of[beside] = number;
                members.push(beside);
            }
        }
    }
    members
}

/// The squares that share a side with one, in its tile.
fn beside(at: usize) -> impl Iterator<Item = usize> {
    let (x, y) = (at as i32 % TILE, at as i32 / TILE);
    [(1, 0), (-1, 0), (0, 1), (0, -1)].into_iter().filter_map(move |(dx, dy)| index(x + dx, y + dy))
}

fn index(x: i32, y: i32) -> Option<usize> {
    ((0..TILE).contains(&x) && (0..TILE).contains(&y)).then_some((y * TILE + x) as usize)
}

/// Runs of squares in rows, each a block: what always can be triangulated.
fn rows(key: TileKey, tile: &[Column], mut members: Vec<usize>, side_m: f64) -> Vec<(Block, Vec<usize>)> {
    members.sort_unstable();
    let is_next = |&a: &usize, &b: &usize| b == a + 1 && a as i32 / TILE == b as i32 / TILE;
    let runs = members.chunk_by(is_next);
    runs.filter_map(|run| Some((block(key, tile, run, &|at| run.contains(&at), side_m)?, run.to_vec()))).collect()
}

fn block(
    key: TileKey,
    tile: &[Column],
    members: &[usize],
    is_member: &dyn Fn(usize) -> bool,
    side_m: f64,
) -> Option<Block> {
    let weight: f64 = members.iter().map(|&at| tile[at].weight()).sum();
    let mean = |value: &dyn Fn(&Column) -> f32| {
        members.iter().map(|&at| tile[at].weight() * f64::from(value(&tile[at]))).sum::<f64>() / weight
    };
    let rings = outline(members, &|x, y| index(x, y).is_some_and(is_member));
    let corner = |[x, y]: [i32; 2]| [f64::from(key[0] * TILE + x) * side_m, f64::from(key[1] * TILE + y) * side_m];
    let rings: Vec<Vec<[f64; 2]>> = rings.into_iter().map(|ring| ring.into_iter().map(corner).collect()).collect();
    Some(Block {
        triangles: triangulate(&polygon_of(&rings, coord)?)?,
        rings,
        top_m: mean(&|column| column.top_m),
        base_m: mean(&|column| column.base_m),
        foot_m: members.iter().map(|&at| f64::from(tile[at].foot_m)).fold(f64::INFINITY, f64::min),
        object: most_of(members.iter().map(|&at| tile[at].object).collect()),
    })
}

/// The object with the most squares, the one of the highest number among equals.
fn most_of(mut objects: SmallVec<[u32; 64]>) -> u32 {
    objects.sort_unstable();
    objects.chunk_by(|a, b| a == b).max_by_key(|same| same.len()).map_or(0, |same| same[0])
}

/// Where the sides that begin at a corner end: two begin where squares touch at it.
type Sides = FxHashMap<[i32; 2], SmallVec<[[i32; 2]; 2]>>;

/// The rings round some squares, corners only: the outer one first, counter-clockwise.
fn outline(members: &[usize], is_inside: &dyn Fn(i32, i32) -> bool) -> Vec<Vec<[i32; 2]>> {
    // The inside is on their left.
    let mut sides: Sides = FxHashMap::default();
    let mut starts = Vec::new();
    for &at in members {
        let (x, y) = (at as i32 % TILE, at as i32 / TILE);
        let around = [
            ((x, y - 1), [x, y], [x + 1, y]),
            ((x + 1, y), [x + 1, y], [x + 1, y + 1]),
            ((x, y + 1), [x + 1, y + 1], [x, y + 1]),
            ((x - 1, y), [x, y + 1], [x, y]),
        ];
        for ((beside_x, beside_y), from, to) in around {
            if !is_inside(beside_x, beside_y) {
                sides.entry(from).or_default().push(to);
                starts.push(from);
            }
        }
    }
    starts.sort_unstable();
    let mut rings = Vec::new();
    for start in starts {
        while let Some(to) = sides.get_mut(&start).and_then(SmallVec::pop) {
            rings.push(ring(start, to, &mut sides));
        }
    }
    // The outer ring alone runs counter-clockwise.
    rings.sort_by_key(|ring| doubled_area(ring) <= 0);
    rings
}

/// Follows the sides round until the start, turning left where there is a choice, so that a ring keeps to one square.
fn ring(start: [i32; 2], first: [i32; 2], sides: &mut Sides) -> Vec<[i32; 2]> {
    let mut points = vec![start];
    let (mut from, mut at) = (start, first);
    while at != start {
        points.push(at);
        let Some(next) = sides.get_mut(&at) else { break };
        let turn = |to: &[i32; 2]| (at[0] - from[0]) * (to[1] - at[1]) - (at[1] - from[1]) * (to[0] - at[0]);
        let Some(leftmost) = (0..next.len()).max_by_key(|&side| turn(&next[side])) else { break };
        let to = next.swap_remove(leftmost);
        (from, at) = (at, to);
    }
    let count = points.len();
    let is_corner = |at: &usize| {
        let (a, b, c) = (points[(at + count - 1) % count], points[*at], points[(at + 1) % count]);
        (b[0] - a[0]) * (c[1] - b[1]) != (b[1] - a[1]) * (c[0] - b[0])
    };
    (0..count).filter(is_corner).map(|at| points[at]).collect()
}

fn doubled_area(ring: &[[i32; 2]]) -> i64 {
    let sides = ring.iter().zip(ring.iter().cycle().skip(1));
    sides.map(|(a, b)| i64::from(a[0]) * i64::from(b[1]) - i64::from(b[0]) * i64::from(a[1])).sum()
}

const _: () = assert!(TILE * TILE * 4 < u16::MAX as i32 && SAMPLES > 1);
