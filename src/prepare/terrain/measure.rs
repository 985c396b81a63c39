//! How far a surface of flat triangles lies from the truth: vertical distances in f64, curvature included.
//! The plane of a triangle between ellipsoid positions of posts is cut with the normal of the ellipsoid at
//! each sample.

use super::truth::{HALVES, Meridians, Sample, Samples, is_rising, post_index};
use crate::content::rtin::{Active, DEPTH, Diagonal, TRIANGLE_COUNT, Triangle};
use crate::content::{POSTS, Surface, TerrainPage};
use crate::forest::CellId;
use glam::DVec3;
use std::sync::{LazyLock, OnceLock};

const SIDE: usize = POSTS - 1;

/// Heap numbers of the finest triangle that each half is, for rising and for falling roots.
static FINEST_OF_HALF: LazyLock<[Vec<u16>; 2]> =
    LazyLock::new(|| [Diagonal::Rising, Diagonal::Falling].map(finest_of_half));

fn finest_of_half(diagonal: Diagonal) -> Vec<u16> {
    let mut map = vec![0; HALVES];
    for triangle in Triangle::all().filter(|triangle| triangle.depth() == DEPTH) {
        let posts = triangle.vertices(diagonal).map(|(column, row)| (usize::from(column), usize::from(row)));
        let sum = posts.iter().fold((0, 0), |sum, post| (sum.0 + post.0, sum.1 + post.1));
        let low = posts.iter().fold((SIDE, SIDE), |low, post| (low.0.min(post.0), low.1.min(post.1)));
        // Thirds of the way across the square to the middle of the triangle.
        let (fx, fy) = (sum.0 - 3 * low.0, sum.1 - 3 * low.1);
        let north = if is_rising(low.0, low.1) { fy > fx } else { fx + fy > 3 };
        map[2 * (low.1 * SIDE + low.0) + usize::from(north)] = triangle.index() as u16;
    }
    map
}

fn finest(diagonal: Diagonal) -> &'static [u16] {
    match diagonal {
        Diagonal::Rising => &FINEST_OF_HALF[0],
        Diagonal::Falling => &FINEST_OF_HALF[1],
    }
}

/// Triangles with less than this part of their longest side squared as twice their area are lines.
const FLAT: f64 = 1e-9;
/// Barycentric coordinates count as inside from here on: less than rounding, and no height changes by it.
const INSIDE: f64 = -1e-7;

/// The plane of a triangle: normal · p = offset, the normal outwards, of any length. All zero where its corners lie on
/// one line (at a pole).
#[derive(Clone, Copy, Debug, Default)]
struct Plane {
    normal: DVec3,
    offset: f64,
}

impl Plane {
    fn through([a, b, c]: [DVec3; 3]) -> Self {
        let normal = (b - a).cross(c - a);
        let longest_sq = (b - a).length_squared().max((c - a).length_squared()).max((c - b).length_squared());
        if normal.length_squared() <= (FLAT * longest_sq).powi(2) {
            return Self::default();
        }
        Self { normal, offset: normal.dot(a) }
    }

    /// Height above the ellipsoid at which a sample's normal meets the plane. `None` for a plane that is none.
    fn height_m(&self, sample: &Sample) -> Option<f64> {
        let slope = self.normal.dot(sample.up);
        (slope != 0.0).then(|| (self.offset - self.normal.dot(sample.foot)) / slope)
    }

    /// Vertical distance between plane and truth; 0 for a plane that is none.
    fn miss_m(&self, sample: &Sample) -> f64 {
        self.height_m(sample).map_or(0.0, |height_m| (height_m - sample.height_m).abs())
    }

    /// Whether the vertical distance between plane and truth is above a limit.
    fn misses(&self, sample: &Sample, limit_m: f64) -> bool {
        let slope = self.normal.dot(sample.up);
        (self.offset - self.normal.dot(sample.foot) - sample.height_m * slope).abs() > limit_m * slope.abs()
    }
}

/// A drawn triangle: its plane, and the barycentric coordinates of a point p of it for the first two corners as
/// gradient · p + constant.
#[derive(Clone, Copy, Debug, Default)]
struct Facet {
    plane: Plane,
    weights: [(DVec3, f64); 2],
}

impl Facet {
    fn of([a, b, c]: [DVec3; 3]) -> Self {
        let plane = Plane::through([a, b, c]);
        let area_sq = plane.normal.length_squared();
        let weight = |from: DVec3, to: DVec3| {
            let gradient = if area_sq > 0.0 { plane.normal.cross(to - from) / area_sq } else { DVec3::ZERO };
            (gradient, -gradient.dot(from))
        };
        Self { plane, weights: [weight(b, c), weight(c, a)] }
    }

    /// The height where a sample's normal goes through the triangle; `None` where it passes by.
    fn height_m(&self, sample: &Sample) -> Option<f64> {
        let height_m = self.plane.height_m(sample)?;
        let point = sample.foot + sample.up * height_m;
        let [first, second] = self.weights.map(|(gradient, constant)| gradient.dot(point) + constant);
        (first.min(second).min(1.0 - first - second) >= INSIDE).then_some(height_m)
    }
}

/// The posts of a cell in space, at given heights.
pub struct Positions {
    diagonal: Diagonal,
    ecef: Vec<DVec3>,
}

impl Positions {
    /// Heights of all 65 × 65 posts, rows from the south, metres.
    pub fn new(cell: CellId, diagonal: Diagonal, heights_m: &[f64]) -> Self {
        let meridians = Meridians::of(&cell.bounds());
        let feet = (0..POSTS * POSTS).map(|at| meridians.foot(at % POSTS, at / POSTS));
        let ecef = feet.zip(heights_m).map(|((foot, up), &height_m)| foot + up * height_m).collect();
        Self { diagonal, ecef }
    }

    fn corners(&self, triangle: Triangle) -> [DVec3; 3] {
        triangle.vertices(self.diagonal).map(|(column, row)| self.ecef[post_index(column.into(), row.into())])
    }

    /// The largest vertical distance between the truth and the planes of the triangles that lie over the samples in
    /// the grid, all posts in use; metres.
    pub fn full_deviation_m(&self, samples: &Samples) -> f64 {
        let mut planes = vec![Plane::default(); TRIANGLE_COUNT];
        for triangle in Triangle::all().filter(|triangle| triangle.depth() == DEPTH) {
            planes[triangle.index()] = Plane::through(self.corners(triangle));
        }
        let finest = finest(self.diagonal);
        samples.fold(
            || 0.0f64,
            |most, sample| *most = most.max(planes[usize::from(finest[sample.half()])].miss_m(sample)),
            f64::max,
        )
    }

    /// The largest vertical distance between the truth and the surface of `page`, metres. In space the triangle over
    /// a sample may be another than in the grid (see [`Surface`]); mostly it is the same, and its plane does.
    pub fn surface_deviation_m(&self, drawn: &Drawn, page: &TerrainPage, samples: &Samples) -> f64 {
        let mut facets = vec![Facet::default(); TRIANGLE_COUNT];
        for &triangle in &drawn.triangles {
            facets[triangle.index()] = Facet::of(self.corners(triangle));
        }
        let surface = OnceLock::new();
        let search = |sample: &Sample| {
            let surface = surface.get_or_init(|| Surface::new(page, 1.0));
            surface.height_along_m(sample.foot, sample.up, sample.fractions)
        };
        let miss_m = |sample: &Sample| {
            let drawn_m = facets[drawn.over(sample)].height_m(sample).or_else(|| search(sample));
            drawn_m.map_or(0.0, |drawn_m| (drawn_m - sample.height_m).abs())
        };
        samples.fold(|| 0.0f64, |most, sample| *most = most.max(miss_m(sample)), f64::max)
    }

    /// Which triangles of the bintree lie further than `limit_m` from the truth at any sample.
    pub fn exceeding(&self, limit_m: f64, samples: &Samples) -> Flags {
        let mut planes = vec![Plane::default(); TRIANGLE_COUNT];
        for triangle in Triangle::all() {
            planes[triangle.index()] = Plane::through(self.corners(triangle));
        }
        let finest = finest(self.diagonal);
        samples.fold(
            Flags::default,
            |flags, sample| {
                let mut index = usize::from(finest[sample.half()]);
                while index >= 2 {
                    if !flags.get(index) && planes[index].misses(sample, limit_m) {
                        flags.set(index);
                    }
                    index /= 2;
                }
            },
            Flags::union,
        )
    }
}

/// One bit per triangle of the bintree.
#[derive(Clone, Debug)]
pub struct Flags(Box<[u64; TRIANGLE_COUNT / 64]>);

impl Default for Flags {
    fn default() -> Self {
        Self(Box::new([0; TRIANGLE_COUNT / 64]))
    }
}

impl Flags {
    pub fn get(&self, index: usize) -> bool {
        self.0[index / 64] >> (index % 64) & 1 == 1
    }

    fn set(&mut self, index: usize) {
        self.0[index / 64] |= 1 << (index % 64);
    }

    fn union(mut self, other: Self) -> Self {
        self.0.iter_mut().zip(other.0.iter()).for_each(|(mine, theirs)| *mine |= theirs);
        self
    }
}

/// A network: its triangles, and the heap number of the one over each half.
pub struct Drawn {
    triangles: Vec<Triangle>,
    of_half: Vec<u16>,
}

impl Drawn {
    /// The network of a closed set of posts.
    pub fn of(diagonal: Diagonal, active: &Active) -> Self {
        let mut triangles = Vec::new();
        active.visit(diagonal, &mut |triangle| triangles.push(triangle));
        let mut is_drawn = Flags::default();
        triangles.iter().for_each(|triangle| is_drawn.set(triangle.index()));
        let of_half = finest(diagonal)
            .iter()
            .map(|&finest| {
                (0..=DEPTH).map(|up| finest >> up).find(|&id| is_drawn.get(usize::from(id))).unwrap_or(finest)
            })
            .collect();
        Self { triangles, of_half }
    }

    /// Heap number of the triangle over a sample.
    fn over(&self, sample: &Sample) -> usize {
        usize::from(self.of_half[sample.half()])
    }
}
