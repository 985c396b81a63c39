//! The surface of a page cut to a cell below it.
//!
//! Triangles are flat in space and are cut there, so that the cut pieces of a page are exactly its surface: west and
//! east by the planes of the piece's meridians (which normals of the ellipsoid never leave, so that morphing keeps the
//! cut), south and north by the line on the triangle that joins the grid's latitude on its edges. Cells of the same
//! meridian but of other pages end at the same plane.

use super::rtin::{Post, SIDE, Triangle};
use super::terrain::{TerrainMesh, TerrainPage, TerrainVertex};
use crate::forest::{CellId, columns};
use crate::geodesy::GeoBounds;
use glam::{DVec2, DVec3};
use std::collections::HashMap;

const WEST: u8 = 1;
const EAST: u8 = 2;
const SOUTH: u8 = 4;
const NORTH: u8 = 8;
/// Marks the lower edge of a skirt in [`TerrainVertex`].
const LOWER_EDGE: i8 = 127;

pub(super) fn cut(page: &TerrainPage, piece: CellId) -> TerrainMesh {
    let window = Window::of(page.cell, piece);
    let bounds = page.cell.bounds();
    let mut corners: Vec<Option<Corner>> = vec![None; page.posts.len()];
    let mut polygons = Vec::new();
    if page.cell.contains(piece) {
        visit(page, &window, &mut |posts| {
            let mut polygon = Vec::with_capacity(8);
            for post in posts {
                let Some(index) = page.index_of(post) else { return };
                polygon.push(*corners[index].get_or_insert_with(|| Corner::of(page, &bounds, index)));
            }
            // A row of posts at a pole is one point, and a triangle with two corners there has no area.
            if polygon.iter().filter(|corner| corner.at_pole).count() > 1 {
                return;
            }
            let polygon = window.clip(polygon);
            if polygon.len() >= 3 {
                polygons.push(polygon);
            }
        });
    }
    let (low_m, high_m) = polygons
        .iter()
        .flatten()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), c| (low.min(c.height_m), high.max(c.height_m)));
    let middle_m = if low_m <= high_m { (low_m + high_m) / 2.0 } else { 0.0 };
    let origin = piece.bounds().center().at_height(middle_m).to_ecef();
    let mut welder = Welder { origin: origin.xyz(), window: &window, known: HashMap::new(), mesh: Vec::new() };
    let (mut surface, mut rim) = (Vec::new(), Vec::new());
    for polygon in &polygons {
        let indices: Vec<u32> = polygon.iter().map(|corner| welder.index_of(corner)).collect();
        fan(&indices, &mut surface);
        for (at, corner) in polygon.iter().enumerate() {
            let next = (at + 1) % polygon.len();
            if corner.sides & polygon[next].sides != 0 && indices[at] != indices[next] {
                rim.push([indices[at], indices[next]]);
            }
        }
    }
    let surface_len = surface.len() as u32;
    let (mut vertices, mut indices) = (welder.mesh, surface);
    skirts(&rim, &mut vertices, &mut indices);
    TerrainMesh { origin, vertices, indices, surface_len }
}

/// A post or a point of the cut.
#[derive(Clone, Copy)]
struct Corner {
    position: DVec3,
    /// Column and row, in intervals of the page.
    grid: DVec2,
    height_m: f64,
    morph_m: f64,
    slope: DVec2,
    /// The sides of the window that it lies on.
    sides: u8,
    at_pole: bool,
}

impl Corner {
    fn of(page: &TerrainPage, bounds: &GeoBounds, index: usize) -> Self {
        let post = &page.posts[index];
        let position = page.position(bounds, index, 1.0);
        Self {
            position,
            grid: DVec2::new(f64::from(post.column), f64::from(post.row)),
            height_m: f64::from(post.height_m),
            morph_m: f64::from(post.parent_height_m) - f64::from(post.height_m),
            slope: DVec2::new(f64::from(post.slope[0]), f64::from(post.slope[1])),
            sides: 0,
            at_pole: position.truncate().length() < 1e-6,
        }
    }

    /// The point of an edge where a linear measure, which has opposite signs at its ends, is 0.
    fn between(a: &Self, b: &Self, at_a: f64, at_b: f64) -> Self {
        // One order for both triangles of the edge, so that they get the same point to the last bit.
        if (b.grid.x, b.grid.y) < (a.grid.x, a.grid.y) {
            return Self::between(b, a, at_b, at_a);
        }
        let t = at_a / (at_a - at_b);
        Self {
            position: a.position.lerp(b.position, t),
            grid: a.grid.lerp(b.grid, t),
            height_m: a.height_m + (b.height_m - a.height_m) * t,
            morph_m: a.morph_m + (b.morph_m - a.morph_m) * t,
            slope: a.slope.lerp(b.slope, t),
            sides: a.sides & b.sides,
            at_pole: false,
        }
    }
}

/// A piece's rectangle in intervals of the page, with its meridians.
struct Window {
    low: DVec2,
    high: DVec2,
    /// Normals, pointing east, of the planes of the western and the eastern meridian.
    west: DVec3,
    east: DVec3,
}

impl Window {
    fn of(page: CellId, piece: CellId) -> Self {
        let ((x, y), (piece_x, piece_y)) = (page.xy(), piece.xy());
        let per_row =
            f64::from(columns(piece.zone(), piece.level(), piece_y)) / f64::from(columns(page.zone(), page.level(), y));
        let per_column = f64::from(1u32 << piece.level().saturating_sub(page.level()));
        let side = SIDE as f64;
        // Powers of two throughout: these are exact.
        let low =
            DVec2::new(f64::from(piece_x) / per_row - f64::from(x), f64::from(piece_y) / per_column - f64::from(y));
        let bounds = piece.bounds();
        let eastward = |lon_rad: f64| DVec3::new(-lon_rad.sin(), lon_rad.cos(), 0.0);
        Self {
            low: low * side,
            high: (low + DVec2::new(1.0 / per_row, 1.0 / per_column)) * side,
            west: eastward(bounds.west_rad),
            east: eastward(bounds.east_rad),
        }
    }

    fn meets(&self, posts: [Post; 3]) -> bool {
        let p = posts.map(|(column, row)| DVec2::new(f64::from(column), f64::from(row)));
        let (low, high) = (p[0].min(p[1]).min(p[2]), p[0].max(p[1]).max(p[2]));
        low.cmplt(self.high).all() && high.cmpgt(self.low).all()
    }

    /// Cuts a convex polygon (Sutherland, Hodgman 1974).
    fn clip(&self, polygon: Vec<Corner>) -> Vec<Corner> {
        let meridian = |corner: &Corner, column: f64, eastward: DVec3| {
            // All meridians go through the pole.
            let on_it = corner.at_pole || corner.grid.x == column;
            if on_it { 0.0 } else { corner.position.dot(eastward) }
        };
        let polygon = keep(polygon, WEST, |c| meridian(c, self.low.x, self.west), |c| c.grid.x = self.low.x);
        let polygon = keep(polygon, EAST, |c| -meridian(c, self.high.x, self.east), |c| c.grid.x = self.high.x);
        let polygon = keep(polygon, SOUTH, |c| c.grid.y - self.low.y, |c| c.grid.y = self.low.y);
        keep(polygon, NORTH, |c| self.high.y - c.grid.y, |c| c.grid.y = self.high.y)
    }

    /// Fractions of the piece.
    fn uv(&self, corner: &Corner) -> [u16; 2] {
        let uv = (corner.grid - self.low) / (self.high - self.low);
        uv.to_array().map(|f| (f.clamp(0.0, 1.0) * 65535.0).round() as u16)
    }
}

/// The part of a polygon where a measure that is linear on it is not negative; `settle` puts new corners on the line.
fn keep(
    mut polygon: Vec<Corner>,
    side: u8,
    measure: impl Fn(&Corner) -> f64,
    settle: impl Fn(&mut Corner),
) -> Vec<Corner> {
    let measures: Vec<f64> = polygon.iter().map(&measure).collect();
    for (corner, &value) in polygon.iter_mut().zip(&measures) {
        if value == 0.0 {
            corner.sides |= side;
        }
    }
    if measures.iter().all(|&value| value >= 0.0) {
        return polygon;
    }
    // What only touches the line is not in.
    if measures.iter().all(|&value| value <= 0.0) {
        return Vec::new();
    }
    let mut kept = Vec::with_capacity(polygon.len() + 1);
    for at in 0..polygon.len() {
        let next = (at + 1) % polygon.len();
        if measures[at] >= 0.0 {
            kept.push(polygon[at]);
        }
        if measures[at] * measures[next] < 0.0 {
            let mut corner = Corner::between(&polygon[at], &polygon[next], measures[at], measures[next]);
            corner.sides |= side;
            settle(&mut corner);
            kept.push(corner);
        }
    }
    kept
}

/// The network's triangles that meet a window.
fn visit(page: &TerrainPage, window: &Window, visit: &mut dyn FnMut([Post; 3])) {
    let mut stack = vec![Triangle::ROOTS[1], Triangle::ROOTS[0]];
    while let Some(triangle) = stack.pop() {
        let posts = triangle.vertices(page.diagonal);
        if !window.meets(posts) {
            continue;
        }
        let is_split = triangle.split_post(page.diagonal).is_some_and(|post| page.index_of(post).is_some());
        match triangle.children() {
            Some([first, second]) if is_split => stack.extend([second, first]),
            _ => visit(posts),
        }
    }
}

/// Gives one index to corners at one place.
struct Welder<'a> {
    origin: DVec3,
    window: &'a Window,
    known: HashMap<([u32; 3], [u16; 2]), u32>,
    mesh: Vec<TerrainVertex>,
}

impl Welder<'_> {
    fn index_of(&mut self, corner: &Corner) -> u32 {
        let position_m = (corner.position - self.origin).as_vec3().to_array();
        let uv = self.window.uv(corner);
        let slope = corner.slope.to_array().map(|s| s.round().clamp(-127.0, 127.0) as i8);
        *self.known.entry((position_m.map(f32::to_bits), uv)).or_insert_with(|| {
            let morph_m = corner.morph_m as f32;
            self.mesh.push(TerrainVertex { position_m, morph_m, uv, slope_skirt: [slope[0], slope[1], 0, 0] });
            self.mesh.len() as u32 - 1
        })
    }
}

fn fan(polygon: &[u32], indices: &mut Vec<u32>) {
    for at in 1..polygon.len() - 1 {
        let (a, b, c) = (polygon[0], polygon[at], polygon[at + 1]);
        if a != b && b != c && c != a {
            indices.extend([a, b, c]);
        }
    }
}

/// Hangs a quad from every edge of the rim; the surface lies left of the edges.
fn skirts(rim: &[[u32; 2]], vertices: &mut Vec<TerrainVertex>, indices: &mut Vec<u32>) {
    let mut lower = HashMap::new();
    for &edge in rim {
        let [a, b] = edge;
        let [low_a, low_b] = edge.map(|top| {
            *lower.entry(top).or_insert_with(|| {
                let mut vertex = vertices[top as usize];
                vertex.slope_skirt[2] = LOWER_EDGE;
                vertices.push(vertex);
                vertices.len() as u32 - 1
            })
        });
        indices.extend([low_a, low_b, b, low_a, b, a]);
    }
}
