//! The height of a drawn surface: flat triangles in space, met by the ellipsoid's normal.
//!
//! Triangles are found in the grid of latitude and longitude, where their edges are straight. In space they are
//! straight too, but that is not quite the same line (a chord leaves the parallel), and at a pole a row of posts falls
//! into one point. So the search goes on from triangle to triangle in space until the normal goes through one; beyond
//! the chord of the cell's own border, the border's triangle is continued.

use super::rtin::{Post, SIDE, Triangle};
use super::terrain::TerrainPage;
use crate::geodesy::{GeoBounds, Geodetic, ellipsoid_normal};
use glam::{DVec2, DVec3};

/// Steps of the search in space; from the grid's answer a few are enough.
const STEPS_MAX: usize = 192;
/// Barycentric coordinates are taken as inside down to this.
const INSIDE: f64 = -1e-9;
/// Twice the area over the longest side squared below which a triangle is taken as a line.
const FLAT: f64 = 1e-9;

/// A page's surface made ready for many queries: positions in space are computed once.
pub struct Surface<'a> {
    page: &'a TerrainPage,
    bounds: GeoBounds,
    positions: Vec<DVec3>,
    /// Index of each post by row and column; `ABSENT` where the network has none.
    lookup: Vec<u16>,
}

const ABSENT: u16 = u16::MAX;

fn slot((column, row): Post) -> usize {
    usize::from(row) * (SIDE + 1) + usize::from(column)
}

impl<'a> Surface<'a> {
    pub fn new(page: &'a TerrainPage, own: f64) -> Self {
        let bounds = page.cell.bounds();
        let positions = (0..page.posts.len()).map(|at| page.position(&bounds, at, own)).collect();
        let mut lookup = vec![ABSENT; (SIDE + 1) * (SIDE + 1)];
        for (index, post) in page.posts.iter().enumerate() {
            if let Some(entry) = lookup.get_mut(slot((post.column, post.row))) {
                *entry = index as u16;
            }
        }
        Self { page, bounds, positions, lookup }
    }

    fn index_of(&self, post: Post) -> Option<usize> {
        self.lookup.get(slot(post)).filter(|&&index| index != ABSENT).map(|&index| usize::from(index))
    }

    /// As [`TerrainPage::surface_height_m`].
    pub fn height_m(&self, lat_rad: f64, lon_rad: f64) -> Option<f64> {
        height_m(self.page, &self.bounds, lat_rad, lon_rad, |post| self.index_of(post), |at| self.positions[at])
    }

    /// Height along a normal of the ellipsoid that the caller has at hand: its foot on the ellipsoid, its direction,
    /// and the place as fractions of the cell, west to east and south to north.
    pub fn height_along_m(&self, foot: DVec3, up: DVec3, fractions: [f64; 2]) -> Option<f64> {
        let at = DVec2::from(fractions) * SIDE as f64;
        walk(self.page, at, foot, up, |post| self.index_of(post), |at| self.positions[at])
    }
}

pub(super) fn height_m(
    page: &TerrainPage,
    bounds: &GeoBounds,
    lat_rad: f64,
    lon_rad: f64,
    index_of: impl Fn(Post) -> Option<usize>,
    position: impl Fn(usize) -> DVec3,
) -> Option<f64> {
    // Places on the border that differ in the last bit belong to the cell too.
    const SLACK: f64 = 1e-9;
    let (u, v) = bounds.fractions(lat_rad, lon_rad);
    let inside = -SLACK..=1.0 + SLACK;
    if !inside.contains(&u) || !inside.contains(&v) {
        return None;
    }
    let at = DVec2::new(u, v).clamp(DVec2::ZERO, DVec2::ONE) * SIDE as f64;
    let foot = Geodetic { lat_rad, lon_rad, height_m: 0.0 }.to_ecef().xyz();
    walk(page, at, foot, ellipsoid_normal(lat_rad, lon_rad), index_of, position)
}

/// Finds the triangle that a normal goes through, from the grid's answer on; `at` in intervals of the grid.
fn walk(
    page: &TerrainPage,
    at: DVec2,
    foot: DVec3,
    up: DVec3,
    index_of: impl Fn(Post) -> Option<usize>,
    position: impl Fn(usize) -> DVec3,
) -> Option<f64> {
    let find = |p: DVec2| Triangle::find(page.diagonal, p.x, p.y, |post| index_of(post).is_some());
    let mut triangle = find(at);
    let mut best: Option<(f64, f64)> = None;
    for _ in 0..STEPS_MAX {
        let posts = triangle.vertices(page.diagonal);
        let mut corners = [DVec3::ZERO; 3];
        for (corner, post) in corners.iter_mut().zip(posts) {
            *corner = position(index_of(post)?) - foot;
        }
        let mut edges = [0, 1, 2];
        match meet(corners, up) {
            Some(hit) => {
                let inside = hit.weights.into_iter().fold(f64::INFINITY, f64::min);
                if best.is_none_or(|(least, _)| inside > least) {
                    best = Some((inside, hit.height_m));
                }
                if inside >= INSIDE {
                    return Some(hit.height_m);
                }
                edges.sort_unstable_by(|&a, &b| hit.weights[a].total_cmp(&hit.weights[b]));
                let beyond = edges.into_iter().filter(|&edge| hit.weights[edge] < INSIDE);
                let Some(next) = beyond.filter_map(|edge| across(posts, edge)).next() else {
                    break;
                };
                triangle = find(next);
            }
            None => {
                let Some(next) = out_of_line(posts, corners, at) else { break };
                triangle = find(next);
            }
        }
    }
    best.map(|(_, height_m)| height_m)
}

/// Where a normal meets a triangle's plane.
struct Hit {
    height_m: f64,
    /// Barycentric coordinates.
    weights: [f64; 3],
}

/// The corners are relative to the normal's foot. `None` for a triangle that is a line.
fn meet([a, b, c]: [DVec3; 3], up: DVec3) -> Option<Hit> {
    let normal = (b - a).cross(c - a);
    let longest_sq = (b - a).length_squared().max((c - a).length_squared()).max((c - b).length_squared());
    if normal.length() <= FLAT * longest_sq {
        return None;
    }
    let height_m = normal.dot(a) / normal.dot(up);
    let p = up * height_m;
    let weight = |q: DVec3, r: DVec3| (q - p).cross(r - p).dot(normal) / normal.length_squared();
    Some(Hit { height_m, weights: [weight(b, c), weight(c, a), weight(a, b)] })
}

/// A point of the grid in the triangle across the edge opposite of a corner; `None` at the border.
fn across(posts: [Post; 3], corner: usize) -> Option<DVec2> {
    let grid = |at: usize| DVec2::new(f64::from(posts[at % 3].0), f64::from(posts[at % 3].1));
    let (from, to) = (grid(corner + 1), grid(corner + 2));
    // The smallest triangles reach further than this from the middle of each of their edges.
    let next = (from + to) / 2.0 - (to - from).perp().normalize() / 16.0;
    (next.min_element() >= 0.0 && next.max_element() <= SIDE as f64).then_some(next)
}

/// Out of a triangle with two corners at the pole, through one of its long sides, towards the column asked for.
fn out_of_line(posts: [Post; 3], corners: [DVec3; 3], at: DVec2) -> Option<DVec2> {
    let shortest = (0..3).min_by(|&a, &b| {
        let side = |i: usize| corners[(i + 1) % 3].distance_squared(corners[(i + 2) % 3]);
        side(a).total_cmp(&side(b))
    })?;
    let [first, second] = [(shortest + 1) % 3, (shortest + 2) % 3];
    let (west, east) = if posts[first].0 < posts[second].0 { (first, second) } else { (second, first) };
    // The edge opposite of the eastern corner is the western one.
    let [towards, away] = if at.x < f64::from(posts[shortest].0) { [east, west] } else { [west, east] };
    across(posts, towards).or_else(|| across(posts, away))
}
