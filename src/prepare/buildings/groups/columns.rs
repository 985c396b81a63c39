//! Objects as columns over a grid: what of each square they cover, and how high.
//!
//! A footprint is looked at on a lattice of [`SAMPLES`] × [`SAMPLES`] points a square. A square that is covered by half
//! or more is filled, up to the roof of the object that covers most of it.

use super::plane::Plane;
use crate::content::Prism;
use rustc_hash::FxHashMap;

/// Lattice points along a square's side.
pub const SAMPLES: i32 = 4;
/// Squares along a tile's side; blocks do not grow beyond a tile, so that they can be culled and stand on their ground.
pub const TILE: i32 = 32;
/// Lattice rows or points in a row of one object beyond which it is no matter for a grid this fine.
const LATTICE_MAX: f64 = 4096.0;
/// Squares around one in which the nearest block is looked for.
const AROUND: i32 = 2;

/// What lies in a square.
#[derive(Clone, Copy, Debug)]
pub struct Column {
    /// Lattice points covered, each counted for each object.
    samples: u32,
    /// The object with the most of them, its roof and base, metres.
    most: u32,
    pub object: u32,
    pub top_m: f32,
    pub base_m: f32,
    /// The lowest foot, metres.
    pub foot_m: f32,
    /// Roof of the block that the square became part of; NaN where it became part of none.
    pub block_top_m: f32,
}

const EMPTY: Column =
    Column { samples: 0, most: 0, object: 0, top_m: 0.0, base_m: 0.0, foot_m: f32::INFINITY, block_top_m: f32::NAN };

impl Column {
    pub fn is_filled(&self) -> bool {
        self.samples as i32 * 2 >= SAMPLES * SAMPLES
    }

    pub fn weight(&self) -> f64 {
        f64::from(self.samples)
    }

    fn add(&mut self, samples: u32, object: u32, prism: &Prism) {
        if samples > self.most {
            (self.most, self.object) = (samples, object);
            (self.top_m, self.base_m) = (prism.top_m, prism.base_m);
        }
        self.samples += samples;
        self.foot_m = self.foot_m.min(prism.base_m - prism.foundation_m);
    }

    /// How far the block's roof is above or below one in the square, metres.
    fn off_m(&self) -> f64 {
        f64::from((self.block_top_m - self.top_m).abs())
    }
}

/// Steps to the squares around one, itself first, then ring by ring.
fn around() -> impl Iterator<Item = (i32, i32)> {
    (0..=AROUND).flat_map(|ring: i32| {
        let all = (-ring..=ring).flat_map(move |y| (-ring..=ring).map(move |x| (x, y)));
        all.filter(move |(x, y)| x.abs().max(y.abs()) == ring)
    })
}

pub type TileKey = [i32; 2];

/// Squares of one side length.
pub struct Columns {
    pub side_m: f64,
    pub tiles: FxHashMap<TileKey, Box<[Column]>>,
}

/// A square's tile, and its place there.
fn place([x, y]: [i32; 2]) -> (TileKey, usize) {
    ([x.div_euclid(TILE), y.div_euclid(TILE)], (y.rem_euclid(TILE) * TILE + x.rem_euclid(TILE)) as usize)
}

impl Columns {
    pub fn new(side_m: f64) -> Self {
        Self { side_m, tiles: FxHashMap::default() }
    }

    fn step_m(&self) -> f64 {
        self.side_m / f64::from(SAMPLES)
    }

    pub fn add(&mut self, object: u32, prism: &Prism, shape: &Shape) {
        let step_m = self.step_m();
        shape.rows(step_m, &mut |row, from, to| {
            // Runs of points in one square.
            let mut at = from;
            while at < to {
                let square = at.div_euclid(SAMPLES);
                let end = to.min((square + 1) * SAMPLES);
                let (key, index) = place([square, row.div_euclid(SAMPLES)]);
                let tile = self.tiles.entry(key).or_insert_with(|| vec![EMPTY; (TILE * TILE) as usize].into());
                tile[index].add((end - at) as u32, object, prism);
                at = end;
            }
        });
    }

    fn get(&self, square: [i32; 2]) -> Option<&Column> {
        let (key, index) = place(square);
        self.tiles.get(&key).map(|tile| &tile[index])
    }

    /// How far an object's roof may be from the nearest block, metres: the farthest of its lattice points, blocks
    /// farther than some squares away left out. Infinite where there are none, and no less than `enough_m` matters.
    pub fn distance_m(&self, prism: &Prism, shape: &Shape, enough_m: f64) -> f64 {
        let step_m = self.step_m();
        let mut worst_m: f64 = 0.0;
        shape.rows(step_m, &mut |row, from, to| {
            let mut at = from;
            while at < to && worst_m < enough_m {
                let square = [at.div_euclid(SAMPLES), row.div_euclid(SAMPLES)];
                let end = to.min((square[0] + 1) * SAMPLES);
                match self.get(square).filter(|column| !column.block_top_m.is_nan()) {
                    Some(column) => {
                        let up_m = f64::from((column.block_top_m - prism.top_m).abs());
                        worst_m = if up_m <= worst_m {
                            worst_m
                        } else {
                            worst_m.max(self.near_m([at, row], square, prism, worst_m))
                        };
                    }
                    None => {
                        for point in at..end {
                            worst_m = worst_m.max(self.near_m([point, row], square, prism, worst_m));
                        }
                    }
                }
                at = end;
            }
        });
        // Arms narrower than a step may lie between all lattice points: their edges tell.
        shape.edge_points(step_m, &mut |point| {
            if worst_m < enough_m {
                let square = point.map(|at| at.div_euclid(SAMPLES));
                worst_m = worst_m.max(self.near_m(point, square, prism, worst_m));
            }
        });
        // Between lattice points half a step either way is left.
        worst_m + step_m * std::f64::consts::FRAC_1_SQRT_2
    }

    /// From a lattice point at the roof to the blocks' roofs in the squares around, nearest squares first; what is within
    /// `enough_m` is near enough.
    fn near_m(&self, point: [i32; 2], square: [i32; 2], prism: &Prism, enough_m: f64) -> f64 {
        let step_m = self.step_m();
        let mut nearest_m2 = f64::INFINITY;
        for (x, y) in around() {
            let other = [square[0] + x, square[1] + y];
            let Some(column) = self.get(other).filter(|column| !column.block_top_m.is_nan()) else { continue };
            let gap = |axis: usize| {
                let at = f64::from(point[axis]) + 0.5;
                let (from, to) = (f64::from(other[axis] * SAMPLES), f64::from((other[axis] + 1) * SAMPLES));
                (from - at).max(at - to).max(0.0) * step_m
            };
            let up_m = f64::from(column.block_top_m - prism.top_m);
            nearest_m2 = nearest_m2.min(gap(0).powi(2) + gap(1).powi(2) + up_m.powi(2));
            if nearest_m2 <= enough_m.powi(2) {
                break;
            }
        }
        nearest_m2.sqrt()
    }

    /// How far a block's roof may be from the nearest object, metres: no point of a square that is half covered is
    /// farther from what covers it than the square's side, and outlines are off by `outline_m` besides.
    pub fn reverse_m(&self, outline_m: f64) -> f64 {
        let columns = self.tiles.values().flat_map(|tile| tile.iter());
        let filled = columns.filter(|column| !column.block_top_m.is_nan());
        filled.map(|column| (self.side_m + outline_m).hypot(column.off_m())).fold(0.0, f64::max)
    }
}

/// A footprint in the plane.
pub struct Shape {
    pub rings: Vec<Vec<[f64; 2]>>,
    low: [f64; 2],
    high: [f64; 2],
}

impl Shape {
    pub fn of(prism: &Prism, plane: &Plane) -> Self {
        let rings: Vec<Vec<[f64; 2]>> =
            prism.rings.iter().map(|ring| ring.iter().map(|&corner| plane.to(corner)).collect()).collect();
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for &[x, y] in rings.iter().flatten() {
            low = [low[0].min(x), low[1].min(y)];
            high = [high[0].max(x), high[1].max(y)];
        }
        Self { rings, low, high }
    }

    /// Whether it takes too many points of a lattice to be worth a look.
    pub fn is_beyond(&self, step_m: f64) -> bool {
        (0..2).any(|axis| (self.high[axis] - self.low[axis]) / step_m > LATTICE_MAX)
    }

    /// Lattice points nearest to points along the edges, at most a step apart.
    fn edge_points(&self, step_m: f64, visit: &mut dyn FnMut([i32; 2])) {
        for ring in &self.rings {
            for (a, b) in ring.iter().zip(ring.iter().cycle().skip(1)) {
                let steps = ((b[0] - a[0]).hypot(b[1] - a[1]) / step_m).ceil().max(1.0);
                for at in 0..steps as u32 {
                    let share = f64::from(at) / steps;
                    visit([0, 1].map(|axis| ((a[axis] + share * (b[axis] - a[axis])) / step_m).floor() as i32));
                }
            }
        }
    }

    /// Runs of lattice points inside, row by row: row, first point, the one after the last. One point in the middle
    /// where a footprint lies between all of them.
    fn rows(&self, step_m: f64, visit: &mut dyn FnMut(i32, i32, i32)) {
        let point = |metres: f64| (metres / step_m - 0.5).ceil() as i32;
        let (first, last) = (point(self.low[1]), point(self.high[1]));
        let mut crossings: Vec<f64> = Vec::new();
        let mut found = false;
        for row in first..last {
            let y = (f64::from(row) + 0.5) * step_m;
            crossings.clear();
            for ring in &self.rings {
                for (a, b) in ring.iter().zip(ring.iter().cycle().skip(1)) {
                    if (a[1] <= y) != (b[1] <= y) {
                        crossings.push(a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0]));
                    }
                }
            }
            crossings.sort_by(f64::total_cmp);
            for pair in crossings.chunks_exact(2) {
                let (from, to) = (point(pair[0]), point(pair[1]));
                if from < to {
                    found = true;
                    visit(row, from, to);
                }
            }
        }
        if !found && self.low[0] <= self.high[0] {
            let middle = |axis: usize| ((self.low[axis] + self.high[axis]) / 2.0 / step_m).floor() as i32;
            visit(middle(1), middle(0), middle(0) + 1);
        }
    }
}
