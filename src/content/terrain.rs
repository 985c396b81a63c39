//! The terrain surface of a cell: a right-triangulated irregular network over its posts, drawn as flat triangles in
//! space between ellipsoid positions of its posts.

use super::rtin::{Active, Diagonal, POST_COUNT, Post, SIDE};
use super::surface::{self, Surface};
use crate::forest::CellId;
use crate::geodesy::{Ecef, GeoBounds, Point, prime_vertical_radius_m};
use bytemuck::{Pod, Zeroable};
use glam::DVec3;

/// A post that the network uses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TerrainPost {
    /// Column from the west and row from the south, 0 to 64.
    pub column: u8,
    pub row: u8,
    /// Above the ellipsoid, metres.
    pub height_m: f32,
    /// Height of the parent's drawn surface above the ellipsoid at this post, metres; its own where there is no parent.
    pub parent_height_m: f32,
    /// Rise of the truth towards east and north, in steps of [`TerrainPost::SLOPE_STEP`] of atan(slope)/(π/2).
    pub slope: [i8; 2],
}

/// A decoded terrain page.
#[derive(Clone, Debug, PartialEq)]
pub struct TerrainPage {
    pub cell: CellId,
    /// Bounds the distance between the drawn surface and the truth, metres.
    pub error_m: f32,
    pub diagonal: Diagonal,
    /// By rows from the south, columns from the west; [`TerrainPage::from_posts`] puts them in this order.
    pub posts: Vec<TerrainPost>,
    /// Indices into `posts`, counter-clockwise seen from above, in depth-first order of the bintree.
    pub triangles: Vec<[u16; 3]>,
}

/// A vertex as the GPU takes it: 24 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct TerrainVertex {
    /// From the mesh's origin, ECEF axes, metres; at the page's own height.
    pub position_m: [f32; 3],
    /// The parent's height less the own one, metres.
    pub morph_m: f32,
    /// Fractions of the piece's cell, 0 west/south to 65535 east/north.
    pub uv: [u16; 2],
    /// Slope towards east and north as in [`TerrainPost`]; then 127 for the lower edge of a skirt, else 0; then 0.
    pub slope_skirt: [i8; 4],
}

/// The surface of a page cut to a cell: its own or any below it.
#[derive(Clone, Debug)]
pub struct TerrainMesh {
    pub origin: Point<Ecef>,
    pub vertices: Vec<TerrainVertex>,
    /// Triangles, counter-clockwise from outside; the first `surface_len` indices are the surface, the rest skirts.
    pub indices: Vec<u32>,
    pub surface_len: u32,
}

impl TerrainPost {
    pub const SLOPE_STEP: f32 = 1.0 / 127.0;
}

impl TerrainPage {
    /// A page over posts in any order. `None` unless they hold the corners, are closed as [`Active`] says, and lie
    /// inside the page, each once.
    pub fn from_posts(cell: CellId, error_m: f32, mut posts: Vec<TerrainPost>) -> Option<Self> {
        posts.sort_unstable_by_key(TerrainPost::order);
        let mut active = Active::corners();
        posts.iter().for_each(|post| active.insert((post.column, post.row)));
        let diagonal = Diagonal::of(cell);
        // Doubles, posts outside and missing corners all show in the count.
        if active.len() != posts.len() || !active.is_closed(diagonal) {
            return None;
        }
        let slot = |(column, row): Post| usize::from(row) * (SIDE + 1) + usize::from(column);
        let mut index = vec![0; POST_COUNT];
        posts.iter().zip(0..).for_each(|(post, at)| index[slot((post.column, post.row))] = at);
        let triangles =
            active.triangles(diagonal).into_iter().map(|posts| posts.map(|post| index[slot(post)])).collect();
        Some(Self { cell, error_m, diagonal, posts, triangles })
    }

    pub fn byte_len(&self) -> usize {
        size_of::<Self>() + size_of_val(&*self.posts) + size_of_val(&*self.triangles)
    }

    /// Where a post stands in `posts`; `None` when the network does not use it.
    pub fn index_of(&self, (column, row): Post) -> Option<usize> {
        self.posts.binary_search_by_key(&(row, column), TerrainPost::order).ok()
    }

    /// Longest side of a triangle of the network, in spacings of the posts of a full page.
    pub fn longest_side_posts(&self) -> f64 {
        let apart = |a: u16, b: u16| {
            let (a, b) = (&self.posts[usize::from(a)], &self.posts[usize::from(b)]);
            let apart = |a: u8, b: u8| u32::from(a.abs_diff(b)).pow(2);
            apart(a.column, b.column) + apart(a.row, b.row)
        };
        let longest = self.triangles.iter().map(|&[a, b, c]| apart(a, b).max(apart(b, c)).max(apart(c, a))).max();
        f64::from(longest.unwrap_or(0)).sqrt()
    }

    /// The posts of the network.
    pub fn active(&self) -> Active {
        let mut active = Active::corners();
        self.posts.iter().for_each(|post| active.insert((post.column, post.row)));
        active
    }

    /// Rounds heights, the parent's too, to multiples of a step, as [`crate::store`] writes them.
    pub fn quantize(&mut self, step_m: f32) {
        let step = f64::from(step_m);
        let round = |height_m: f32| ((f64::from(height_m) / step).round() * step) as f32;
        for post in &mut self.posts {
            post.height_m = round(post.height_m);
            post.parent_height_m = round(post.parent_height_m);
        }
    }

    /// Height above the ellipsoid of the drawn surface at a place inside the cell, metres, at morph weight `own`
    /// (0: the parent's surface, 1: its own). `None` outside the cell. For many places of one page see [`Surface`].
    pub fn surface_height_m(&self, lat_rad: f64, lon_rad: f64, own: f64) -> Option<f64> {
        let bounds = self.cell.bounds();
        surface::height_m(
            self,
            &bounds,
            lat_rad,
            lon_rad,
            |post| self.index_of(post),
            |at| self.position(&bounds, at, own),
        )
    }

    /// The page's surface made ready for many queries, at morph weight `own`.
    pub fn surface(&self, own: f64) -> Surface<'_> {
        Surface::new(self, own)
    }

    /// Where the posts are, ECEF metres, at the page's own heights.
    pub fn positions(&self) -> Vec<DVec3> {
        let bounds = self.cell.bounds();
        (0..self.posts.len()).map(|at| self.position(&bounds, at, 1.0)).collect()
    }

    /// Where a post is drawn.
    pub(super) fn position(&self, bounds: &GeoBounds, index: usize, own: f64) -> DVec3 {
        let post = &self.posts[index];
        let height_m = own * f64::from(post.height_m) + (1.0 - own) * f64::from(post.parent_height_m);
        let side = SIDE as f64;
        bounds.at(f64::from(post.column) / side, f64::from(post.row) / side, height_m).to_ecef().xyz()
    }

    /// The drawn surface cut exactly to `piece`, which must be this page's cell or below it, with skirts along the
    /// four sides of the piece. Empty where `piece` lies elsewhere.
    pub fn cut(&self, piece: CellId) -> TerrainMesh {
        super::cut::cut(self, piece)
    }
}

impl TerrainPost {
    fn order(&self) -> (u8, u8) {
        (self.row, self.column)
    }
}

/// Posts on the southern and northern border of a cell that keep the chords drawn between them within `tolerance_m`
/// of the parallel, measured along the ground.
///
/// A parallel is no straight line: its chord lies on the side of the pole by tan φ times as far as it lies below the
/// ellipsoid. Vertical error bounds do not see that, but from above a gap would show between cells of different
/// networks, which vertical skirts cannot close. Networks should hold these posts.
pub fn border_posts(cell: CellId, tolerance_m: f64) -> Active {
    let bounds = cell.bounds();
    let mut active = Active::corners();
    for (row, lat_rad) in [(0, bounds.south_rad), (SIDE as u8, bounds.north_rad)] {
        let (sin, cos) = lat_rad.sin_cos();
        let inward_m = prime_vertical_radius_m(sin) * cos.max(0.0) * sin.abs();
        let off_m = |step: usize| inward_m * (1.0 - (bounds.width_rad() * step as f64 / SIDE as f64 / 2.0).cos());
        let mut step = SIDE;
        while step > 1 && off_m(step) > tolerance_m {
            step /= 2;
        }
        (0..=SIDE).step_by(step).for_each(|column| active.insert((column as u8, row)));
    }
    active.close(Diagonal::of(cell));
    active
}

#[cfg(test)]
#[path = "terrain_tests.rs"]
mod tests;
