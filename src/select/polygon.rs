//! Convex polygons cut by planes.

use glam::{DVec2, DVec3};

pub struct Polygon {
    corners: [DVec3; Polygon::CORNERS_MAX],
    len: usize,
}

impl Polygon {
    /// A quad clipped by five planes has at most nine corners, a triangle fewer.
    pub const CORNERS_MAX: usize = 9;

    /// `N` corners, at most those of a quad.
    pub fn new<const N: usize>(of: [DVec3; N]) -> Self {
        let mut corners = [DVec3::ZERO; Self::CORNERS_MAX];
        corners[..N].copy_from_slice(&of);
        Self { corners, len: N }
    }

    /// Keeps what has a distance of at least 0 (Sutherland, Hodgman 1974).
    pub fn clip(&mut self, distance: impl Fn(DVec3) -> f64) {
        let (before, len) = (self.corners, self.len);
        self.len = 0;
        for at in 0..len {
            let (from, to) = (before[at], before[(at + 1) % len]);
            let (d_from, d_to) = (distance(from), distance(to));
            if d_from >= 0.0 {
                self.push(from);
            }
            if (d_from >= 0.0) != (d_to >= 0.0) {
                self.push(from.lerp(to, d_from / (d_from - d_to)));
            }
        }
    }

    fn push(&mut self, corner: DVec3) {
        // A quad that is not quite flat may be cut more often than a convex one; the loss is a sliver.
        if let Some(slot) = self.corners.get_mut(self.len) {
            *slot = corner;
            self.len += 1;
        }
    }

    pub fn corners(&self) -> &[DVec3] {
        &self.corners[..self.len]
    }

    pub fn area(&self, project: impl Fn(DVec3) -> DVec2) -> f64 {
        let corners = self.corners();
        let twice: f64 =
            (0..self.len).map(|at| project(corners[at]).perp_dot(project(corners[(at + 1) % self.len]))).sum();
        twice.abs() / 2.0
    }
}
