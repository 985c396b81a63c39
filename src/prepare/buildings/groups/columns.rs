//! Objects as columns over a grid: what of each square they cover, and how high.
//!
//! A footprint is looked at on a lattice of [`SAMPLES`] × [`SAMPLES`] points a square. A square that is covered by half
//! or more is filled, up to the roof of the object that covers most of it.

use super::plane::Plane;
use crate::content::Prism;
use rustc_hash::{FxHashMap, FxHashSet};

/// Lattice points along a square's side.
pub const SAMPLES: i32 = 4;
/// Squares along a tile's side; blocks do not grow beyond a tile, so that they can be culled and stand on their ground.
pub const TILE: i32 = 32;
/// Lattice rows or points in a row of one object beyond which it is no matter for a grid this fine.
const LATTICE_MAX: f64 = 4096.0;
/// How far a point of a footprint may be from all that were looked at, steps: its lattice point is half a diagonal away,
/// or an edge lies before that, on which one was looked at within half a step.
const BETWEEN_POINTS: f64 = std::f64::consts::FRAC_1_SQRT_2 + 0.5;
/// Squares around one in which the nearest block is looked for.
const AROUND: i32 = 2;

// A bit for each lattice point of a square.
const _: () = assert!(SAMPLES * SAMPLES == u16::BITS as i32);

/// What lies in a square.
#[derive(Clone, Copy, Debug)]
pub struct Column {
    /// Lattice points covered, by bit, row by row.
    covered: u16,
    /// The same, each counted for each object.
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

const EMPTY: Column = Column {
    covered: 0,
    samples: 0,
    most: 0,
    object: 0,
    top_m: 0.0,
    base_m: 0.0,
    foot_m: f32::INFINITY,
    block_top_m: f32::NAN,
};

impl Column {
    pub fn is_filled(&self) -> bool {
        self.covered.count_ones() as i32 * 2 >= SAMPLES * SAMPLES
    }

    pub fn weight(&self) -> f64 {
        f64::from(self.samples)
    }

    /// Adds lattice points of one row.
    fn add(&mut self, covered: u16, object: u32, prism: &Prism) {
        let samples = covered.count_ones();
        self.covered |= covered;
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

/// Squares around one, itself among them.
const SQUARES_AROUND: usize = ((2 * AROUND + 1) * (2 * AROUND + 1)) as usize;
/// Steps to them, the nearest first.
const STEPS_AROUND: [[i32; 2]; SQUARES_AROUND] = steps_around();

const fn steps_around() -> [[i32; 2]; SQUARES_AROUND] {
    let mut steps = [[0; 2]; SQUARES_AROUND];
    let (mut count, mut far) = (0, 0);
    // By the square of their length.
    while far <= 2 * AROUND * AROUND {
        let mut y = -AROUND;
        while y <= AROUND {
            let mut x = -AROUND;
            while x <= AROUND {
                if x * x + y * y == far {
                    steps[count] = [x, y];
                    count += 1;
                }
                x += 1;
            }
            y += 1;
        }
        far += 1;
    }
    steps
}

pub type TileKey = [i32; 2];

/// Squares of one side length.
pub struct Columns {
    pub side_m: f64,
    numbers: FxHashMap<TileKey, u32>,
    tiles: Vec<Tile>,
}

/// Squares that are side by side.
pub struct Tile {
    pub key: TileKey,
    pub squares: Box<[Column]>,
}

impl Tile {
    fn new(key: TileKey) -> Self {
        Self { key, squares: vec![EMPTY; (TILE * TILE) as usize].into() }
    }
}

/// A tile's number, remembered: what comes next is mostly in the same.
type Last = Option<(TileKey, Option<u32>)>;

/// A square's tile, and its place there.
fn place([x, y]: [i32; 2]) -> (TileKey, usize) {
    ([x.div_euclid(TILE), y.div_euclid(TILE)], (y.rem_euclid(TILE) * TILE + x.rem_euclid(TILE)) as usize)
}

impl Columns {
    pub fn new(side_m: f64) -> Self {
        Self { side_m, numbers: FxHashMap::default(), tiles: Vec::new() }
    }

    pub fn step_m(&self) -> f64 {
        self.side_m / f64::from(SAMPLES)
    }

    pub fn tiles_mut(&mut self) -> &mut [Tile] {
        &mut self.tiles
    }

    fn number(&self, key: TileKey, last: &mut Last) -> Option<u32> {
        match *last {
            Some((of, number)) if of == key => number,
            _ => {
                let number = self.numbers.get(&key).copied();
                *last = Some((key, number));
                number
            }
        }
    }

    /// Adds what an object covers of the tiles that are wanted.
    pub fn add(&mut self, object: u32, prism: &Prism, runs: &[Run], is_wanted: &dyn Fn(TileKey) -> bool) {
        let mut last: Last = None;
        for &run in runs {
            for (square, from, to) in run.by_square() {
                let (key, index) = place(square);
                if !is_wanted(key) {
                    continue;
                }
                let number = self.number(key, &mut last).unwrap_or_else(|| {
                    let number = self.tiles.len() as u32;
                    self.numbers.insert(key, number);
                    self.tiles.push(Tile::new(key));
                    last = Some((key, Some(number)));
                    number
                });
                self.tiles[number as usize].squares[index].add(run.bits(from, to), object, prism);
            }
        }
    }

    /// Empties tiles, to be filled anew.
    pub fn clear(&mut self, keys: &FxHashSet<TileKey>) {
        for key in keys {
            if let Some(&number) = self.numbers.get(key) {
                self.tiles[number as usize].squares.fill(EMPTY);
            }
        }
    }

    fn get(&self, square: [i32; 2], last: &mut Last) -> Option<&Column> {
        let (key, index) = place(square);
        self.number(key, last).map(|number| &self.tiles[number as usize].squares[index])
    }

    /// How far an object's roof may be from the nearest block, metres: the farthest of its lattice points, blocks
    /// farther than some squares away left out. Infinite where there are none, and no less than `enough_m` matters; nor
    /// does anything below a square's side, as blocks may be as far from roofs (see `reverse_m`).
    pub fn distance_m(&self, prism: &Prism, shape: &Shape, runs: &[Run], enough_m: f64) -> f64 {
        let mut worst_m = self.side_m;
        let mut last: Last = None;
        for (square, from, to, row) in
            runs.iter().flat_map(|run| run.by_square().map(|(square, from, to)| (square, from, to, run.row)))
        {
            if worst_m >= enough_m {
                break;
            }
            let is_near = |column: &Column| f64::from((column.block_top_m - prism.top_m).abs()) <= worst_m;
            if self.get(square, &mut last).is_some_and(is_near) {
                continue;
            }
            for at in from..to {
                let point = [at, row].map(|at| f64::from(at) + 0.5);
                worst_m = worst_m.max(self.near_m(point, prism, worst_m, &mut last));
            }
        }
        // Arms narrower than a step may lie between all lattice points: their edges tell.
        shape.edge_points(self.step_m(), &mut |point| {
            if worst_m < enough_m {
                worst_m = worst_m.max(self.near_m(point, prism, worst_m, &mut last));
            }
        });
        worst_m + self.step_m() * BETWEEN_POINTS
    }

    /// From a point at the roof, in steps of the lattice, to the blocks' roofs in the squares around, nearest squares
    /// first; what is within `enough_m` is near enough.
    fn near_m(&self, point: [f64; 2], prism: &Prism, enough_m: f64, last: &mut Last) -> f64 {
        let square = point.map(|at| (at / f64::from(SAMPLES)).floor() as i32);
        let step_m = self.step_m();
        let mut nearest_m2 = f64::INFINITY;
        for [x, y] in STEPS_AROUND {
            let apart_m = |steps: i32| f64::from((steps.abs() - 1).max(0)) * self.side_m;
            if nearest_m2 <= apart_m(x).powi(2) + apart_m(y).powi(2) {
                continue;
            }
            let other = [square[0] + x, square[1] + y];
            let Some(column) = self.get(other, last).filter(|column| !column.block_top_m.is_nan()) else { continue };
            let gap = |axis: usize| {
                let at = point[axis];
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
        let columns = self.tiles.iter().flat_map(|tile| tile.squares.iter());
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

    /// The tiles in which it lies, and in which the nearest block is looked for, with squares of a side.
    pub fn tiles_about(&self, side_m: f64) -> impl Iterator<Item = TileKey> {
        let tile =
            |metres: f64, beyond: i32| ((metres / side_m).floor() as i32).saturating_add(beyond).div_euclid(TILE);
        let [west, south] = self.low.map(|at| tile(at, -AROUND));
        let [east, north] = self.high.map(|at| tile(at, AROUND));
        (west..=east).flat_map(move |x| (south..=north).map(move |y| [x, y]))
    }

    /// Points along the edges, at most a step apart, in steps.
    fn edge_points(&self, step_m: f64, visit: &mut dyn FnMut([f64; 2])) {
        for ring in &self.rings {
            for (a, b) in ring.iter().zip(ring.iter().cycle().skip(1)) {
                let steps = ((b[0] - a[0]).hypot(b[1] - a[1]) / step_m).ceil().max(1.0);
                for at in 0..steps as u32 {
                    let share = f64::from(at) / steps;
                    visit([0, 1].map(|axis| (a[axis] + share * (b[axis] - a[axis])) / step_m));
                }
            }
        }
    }

    /// Runs of lattice points inside, row by row. One point in the middle where a footprint lies between all of them.
    pub fn runs(&self, step_m: f64) -> Vec<Run> {
        let point = |metres: f64| (metres / step_m - 0.5).ceil() as i32;
        let (first, last) = (point(self.low[1]), point(self.high[1]));
        let mut crossings: Vec<f64> = Vec::new();
        let mut runs = Vec::with_capacity((last - first).max(1) as usize);
        for row in first..last {
            let y = (f64::from(row) + 0.5) * step_m;
            crossings.clear();
            for ring in &self.rings {
                let mut a = ring.last();
                for b in ring {
                    if let Some(a) = a.filter(|a| (a[1] <= y) != (b[1] <= y)) {
                        crossings.push(a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0]));
                    }
                    a = Some(b);
                }
            }
            crossings.sort_unstable_by(f64::total_cmp);
            let ends = crossings.chunks_exact(2).map(|pair| (point(pair[0]), point(pair[1])));
            runs.extend(ends.filter(|(from, to)| from < to).map(|(from, to)| Run { row, from, to }));
        }
        if runs.is_empty() && self.low[0] <= self.high[0] {
            let middle = |axis: usize| ((self.low[axis] + self.high[axis]) / 2.0 / step_m).floor() as i32;
            runs.push(Run { row: middle(1), from: middle(0), to: middle(0) + 1 });
        }
        runs
    }
}

/// Lattice points side by side: their row, the first and the one after the last.
#[derive(Clone, Copy, Debug)]
pub struct Run {
    row: i32,
    from: i32,
    to: i32,
}

impl Run {
    /// Those from a first to before a last one, of one square, by bit.
    fn bits(self, from: i32, to: i32) -> u16 {
        let at = SAMPLES * self.row.rem_euclid(SAMPLES) + from.rem_euclid(SAMPLES);
        ((1u16 << (to - from)) - 1) << at
    }

    /// Parts in one square each: the square, the first point and the one after the last.
    fn by_square(self) -> impl Iterator<Item = ([i32; 2], i32, i32)> {
        let y = self.row.div_euclid(SAMPLES);
        (self.from.div_euclid(SAMPLES)..=(self.to - 1).div_euclid(SAMPLES))
            .map(move |x| ([x, y], self.from.max(x * SAMPLES), self.to.min((x + 1) * SAMPLES)))
    }
}

/// The tiles that runs lie in.
pub fn tiles_of(runs: &[Run]) -> impl Iterator<Item = TileKey> {
    runs.iter().flat_map(|run| {
        let y = run.row.div_euclid(SAMPLES * TILE);
        let wide = SAMPLES * TILE;
        (run.from.div_euclid(wide)..=(run.to - 1).div_euclid(wide)).map(move |x| [x, y])
    })
}
