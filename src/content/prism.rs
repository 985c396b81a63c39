//! Prisms over footprints, and how they are drawn: walls along the ellipsoid's normals, and flat roofs; or a
//! foundation and a detailed shape.

use super::detail::{Canvas, Detail, Looks};
use super::objects::{Object, ObjectMesh, ObjectVertex};
use crate::forest::CellId;
use crate::geodesy::{Ecef, Geodetic, Point};
use glam::{DVec2, DVec3};

/// One object as stored: a footprint drawn up from its base.
#[derive(Clone, Debug, PartialEq)]
pub struct Prism {
    /// Ordinal in the collection.
    pub id: u32,
    /// The cell that it lives in.
    pub cell: CellId,
    /// Longitude and latitude, radians: the outer ring counter-clockwise, then holes clockwise; not closed.
    pub rings: Vec<Vec<[f64; 2]>>,
    /// Triangles of the roof as indices into the rings laid end to end, counter-clockwise from above.
    pub roof: Vec<[u16; 3]>,
    /// Lower and upper edge of the visible walls above the ellipsoid, metres.
    pub base_m: f32,
    pub top_m: f32,
    /// How far the walls go on below the base, metres; 0 for parts that hang in the air.
    pub foundation_m: f32,
    /// sRGB of walls and of the roof.
    pub wall_color: [u8; 3],
    pub roof_color: [u8; 3],
    /// What is drawn in place of the roof and of the walls above the base. It lies between base and top.
    pub detail: Option<Detail>,
}

/// A prism's horizontal box in the east-north-up frame of its centre.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Footprint {
    /// Middle of the box, radians.
    pub lat_rad: f64,
    pub lon_rad: f64,
    /// Sides east and north, metres.
    pub sides_m: [f64; 2],
}

impl Prism {
    /// Visible walls are never less than this, metres.
    pub const WALL_MIN_M: f64 = 0.05;
    /// Foundations of what stands on the ground are never less than this, metres: who has one, stands.
    pub const FOUNDATION_MIN_M: f64 = 0.01;

    /// Longitude and latitude of the outline's corners, then of the detail's, which may jut out.
    fn corners(&self) -> impl Iterator<Item = [f64; 2]> {
        let detailed = self.detail.iter().flat_map(|detail| &detail.corners);
        self.rings.iter().flatten().copied().chain(detailed.map(|corner| [corner.lon_rad, corner.lat_rad]))
    }

    /// The box of the footprint and of what juts out beyond it; where there is no vertex, a point at (0, 0).
    pub fn footprint(&self) -> Footprint {
        let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        for [lon_rad, lat_rad] in self.corners() {
            low = low.min(DVec2::new(lon_rad, lat_rad));
            high = high.max(DVec2::new(lon_rad, lat_rad));
        }
        if low.x > high.x {
            return Footprint { lat_rad: 0.0, lon_rad: 0.0, sides_m: [0.0; 2] };
        }
        let rough = Geodetic { lat_rad: (low.y + high.y) / 2.0, lon_rad: (low.x + high.x) / 2.0, height_m: 0.0 };
        let rough = rough.at_height(f64::from(self.base_m));
        let enu_from_ecef = rough.ecef_from_enu().inverse();
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for [lon_rad, lat_rad] in self.corners() {
            let corner = enu_from_ecef * Geodetic { lat_rad, lon_rad, ..rough }.to_ecef();
            low = low.min(corner.xyz());
            high = high.max(corner.xyz());
        }
        Footprint { lat_rad: rough.lat_rad, lon_rad: rough.lon_rad, sides_m: [high.x - low.x, high.y - low.y] }
    }

    /// Largest horizontal side of the box, metres.
    pub fn reach_m(&self) -> f64 {
        let [east_m, north_m] = self.footprint().sides_m;
        east_m.max(north_m)
    }

    /// Largest side of the box, height included (the foundation is not seen), metres.
    pub fn dimension_m(&self) -> f64 {
        self.reach_m().max(f64::from(self.top_m) - f64::from(self.base_m))
    }

    /// How many triangles draw it.
    pub fn triangles(&self) -> usize {
        let walls = 2 * self.rings.iter().map(Vec::len).sum::<usize>();
        walls + self.detail.as_ref().map_or(self.roof.len(), Detail::triangles)
    }

    /// Appends the prism's triangles to a mesh, counter-clockwise from outside.
    pub(super) fn draw(&self, origin: Point<Ecef>, object: u16, mesh: &mut ObjectMesh, looks: &mut Looks) -> Object {
        let start = mesh.indices.len() as u32;
        let footprint = self.footprint();
        let place =
            Geodetic { lat_rad: footprint.lat_rad, lon_rad: footprint.lon_rad, height_m: f64::from(self.base_m) };
        let foot_m = f64::from(self.base_m) - f64::from(self.foundation_m);
        let mut pen = Pen { origin: origin.xyz(), object, mesh };
        match &self.detail {
            Some(detail) => {
                pen.all_walls(&self.rings, foot_m, self.detail_foot_m(detail));
                let (wall_color, roof_color) = (self.wall_color, self.roof_color);
                let ecef_from_enu = place.ecef_from_enu();
                Canvas { origin, object, ecef_from_enu, wall_color, roof_color, mesh, looks }.draw(detail);
            }
            None => {
                pen.all_walls(&self.rings, foot_m, f64::from(self.top_m));
                pen.roof(&self.rings, &self.roof, f64::from(self.top_m));
            }
        }
        let [east_m, north_m] = footprint.sides_m;
        let reach_m = east_m.max(north_m) as f32;
        Object {
            id: self.id,
            cell: self.cell,
            place: place.to_ecef(),
            lat_rad: place.lat_rad,
            lon_rad: place.lon_rad,
            base_m: self.base_m,
            top_m: self.top_m,
            dimension_m: reach_m.max(self.top_m - self.base_m),
            reach_m,
            wall_color: self.wall_color,
            roof_color: self.roof_color,
            indices: start..mesh.indices.len() as u32,
        }
    }

    /// Where the foundation ends: a detail's own walls may go on down below the base.
    fn detail_foot_m(&self, detail: &Detail) -> f64 {
        let low_m = detail.height_range_m().map_or(self.base_m, |(low_m, _)| low_m);
        f64::from(low_m.min(self.base_m))
    }
}

/// Draws into a mesh for one object.
struct Pen<'a> {
    origin: DVec3,
    object: u16,
    mesh: &'a mut ObjectMesh,
}

impl Pen<'_> {
    fn vertex(&mut self, [lon_rad, lat_rad]: [f64; 2], height_m: f64, facing: u16) -> u32 {
        let position = Geodetic { lat_rad, lon_rad, height_m }.to_ecef().xyz() - self.origin;
        let position_m = position.as_vec3().to_array();
        self.mesh.vertices.push(ObjectVertex { position_m, look: self.object, facing });
        self.mesh.vertices.len() as u32 - 1
    }

    fn all_walls(&mut self, rings: &[Vec<[f64; 2]>], foot_m: f64, top_m: f64) {
        if foot_m < top_m {
            rings.iter().for_each(|ring| self.walls(ring, foot_m, top_m));
        }
    }

    /// The outer ring runs counter-clockwise and holes clockwise, so the outside is always on the right.
    fn walls(&mut self, ring: &[[f64; 2]], foot_m: f64, top_m: f64) {
        for (at, &from) in ring.iter().enumerate() {
            let to = ring[(at + 1) % ring.len()];
            if from == to {
                continue;
            }
            let facing = ObjectVertex::facing(outward(from, to), false);
            let [a, b] = [from, to].map(|corner| self.vertex(corner, foot_m, facing));
            let [c, d] = [to, from].map(|corner| self.vertex(corner, top_m, facing));
            self.mesh.indices.extend([a, b, c, a, c, d]);
        }
    }

    fn roof(&mut self, rings: &[Vec<[f64; 2]>], triangles: &[[u16; 3]], top_m: f64) {
        let first = self.mesh.vertices.len() as u32;
        let count = rings.iter().map(Vec::len).sum::<usize>();
        if triangles.is_empty() {
            return;
        }
        let facing = ObjectVertex::facing(DVec3::Z, true);
        for &corner in rings.iter().flatten() {
            self.vertex(corner, top_m, facing);
        }
        let whole = triangles.iter().filter(|triangle| triangle.iter().all(|&corner| usize::from(corner) < count));
        self.mesh.indices.extend(whole.flatten().map(|&corner| first + u32::from(corner)));
    }
}

/// The horizontal direction to the right of an edge that has a length, east-north-up.
fn outward(from: [f64; 2], to: [f64; 2]) -> DVec3 {
    let east = (to[0] - from[0]) * ((from[1] + to[1]) / 2.0).cos();
    let north = to[1] - from[1];
    DVec3::new(north, -east, 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::content::ObjectPage;
    use crate::geodesy::meridian_radius_m;
    use proptest::prelude::*;

    /// A block of east × north metres round a place, with its roof.
    fn block(cell: CellId, lat_rad: f64, lon_rad: f64, east_m: f64, north_m: f64, top_m: f32) -> Prism {
        let frame = Geodetic { lat_rad, lon_rad, height_m: 0.0 };
        let across_m = crate::geodesy::prime_vertical_radius_m(lat_rad.sin()) * lat_rad.cos();
        let along_m = meridian_radius_m(lat_rad.sin());
        let corner = |x: f64, y: f64| [frame.lon_rad + x * east_m / across_m, frame.lat_rad + y * north_m / along_m];
        Prism {
            id: 5,
            cell,
            rings: vec![vec![corner(-0.5, -0.5), corner(0.5, -0.5), corner(0.5, 0.5), corner(-0.5, 0.5)]],
            roof: vec![[0, 1, 2], [0, 2, 3]],
            base_m: 3.0,
            top_m,
            foundation_m: 1.0,
            wall_color: [1; 3],
            roof_color: [2; 3],
            detail: None,
        }
    }

    proptest! {
        #[test]
        fn a_block_is_drawn_closed_with_its_size(
            lat in -80.0..80.0f64, lon in -179.0..179.0f64, east_m in 1.0..300.0f64, north_m in 1.0..300.0f64, tall_m in 1.0..400.0f32,
        ) {
            let (lat_rad, lon_rad) = (lat.to_radians(), lon.to_radians());
            let root = CellId::containing(lat_rad, lon_rad, 12);
            let (page, mesh) =
                ObjectPage::from_prisms(root, 1, 0, 0.1, vec![block(root, lat_rad, lon_rad, east_m, north_m, 3.0 + tall_m)]);
            let object = &page.objects[0];
            // Meridians converge: the side towards the equator is longer than the middle.
            let allowed_m = 0.02 + east_m * north_m * lat_rad.tan().abs() / 6.3e6;
            prop_assert!((f64::from(object.reach_m) - east_m.max(north_m)).abs() < allowed_m);
            prop_assert!((f64::from(object.dimension_m) - east_m.max(north_m).max(f64::from(tall_m))).abs() < allowed_m);
            prop_assert!((object.lat_rad - lat_rad).abs() < 1e-9 && (object.lon_rad - lon_rad).abs() < 1e-9);
            prop_assert_eq!(page.cells[0].height_range_m, (2.0, 3.0 + tall_m));
            prop_assert_eq!(mesh.indices.len(), 3 * (4 * 2 + 2));
            // Divergence theorem over walls and roof, seen from the middle of the floor: all faces but the floor.
            let floor = Geodetic { lat_rad, lon_rad, height_m: 2.0 }.to_ecef().xyz() - page.origin.xyz();
            let corner = |at: u32| DVec3::from(mesh.vertices[at as usize].position_m.map(f64::from)) - floor;
            let volume: f64 =
                mesh.indices.chunks_exact(3).map(|t| corner(t[0]).dot(corner(t[1]).cross(corner(t[2]))) / 6.0).sum();
            let expected = east_m * north_m * (f64::from(tall_m) + 1.0);
            prop_assert!((volume / expected - 1.0).abs() < 2e-3, "{volume} {expected}");
        }
    }

    #[test]
    fn objects_are_ordered_by_cell_and_each_cell_has_one_entry() {
        let root = CellId::containing(0.7, 0.3, 10);
        let cells: Vec<_> = root.children().collect();
        let prisms = [3, 0, 2, 0, 3].map(|at: usize| {
            let center = cells[at].bounds().center();
            block(cells[at], center.lat_rad, center.lon_rad, 10.0, 20.0, 30.0)
        });
        let (page, mesh) = ObjectPage::from_prisms(root, 0, 0, 0.0, prisms.to_vec());
        let told: Vec<_> = page.cells.iter().map(|entry| (entry.cell, entry.objects.clone())).collect();
        assert_eq!(told, [(cells[0], 0..2), (cells[2], 2..3), (cells[3], 3..5)]);
        assert_eq!(page.indices_of(2..5), 60..150);
        assert_eq!(page.indices_of(0..5).len(), mesh.indices.len());
        assert_eq!((page.indices_of(3..3), page.indices_of(9..12)), (0..0, 0..0));
        let (empty, mesh) = ObjectPage::from_prisms(root, 0, 0, 0.0, Vec::new());
        assert!(empty.objects.is_empty() && mesh.indices.is_empty());
    }
}
