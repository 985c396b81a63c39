//! Terrain as it is drawn, for rays: cut meshes in blocks of neighbouring triangles, kept from call to call.
//!
//! A page's triangles come in depth-first order of their bintree, so that a run of them lies close together and one box
//! round it spares the look at each. Vertices keep what moves them (morph, skirt, press), so that a mesh serves all
//! frames that draw the piece. Skirts are part of it: where pieces part, they are what the picture shows.

use crate::content::{TerrainMesh, TerrainPage, TerrainVertex};
use crate::forest::CellId;
use crate::geodesy::{Ecef, Point, Ray, enters_aligned, meets_front, normal_through};
use crate::select::{DrawPiece, GroundPress};
use glam::DVec3;
use std::collections::HashMap;
use std::ops::Range;
use std::sync::{Arc, Weak};

/// What the meshes kept may take, bytes; some tens of the largest ones.
pub const PICK_MESH_BYTES_MAX: usize = 4 << 20;
/// Triangles that share a box.
const BLOCK_TRIANGLES: usize = 16;
/// Skirts lean outwards by at most this times their depth, as in terrain.wgsl.
const STEEPEST: f64 = 8.0;

/// What one query looked at.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PickWork {
    /// Bounding boxes and balls, of pieces, blocks of triangles, pages, cells and objects.
    pub boxes: u32,
    /// Terrain meshes entered.
    pub pieces: u32,
    pub triangles: u32,
    /// Footprints.
    pub objects: u32,
}

/// A vertex and what moves it; f32 metres from the mesh's origin, as it is drawn.
#[derive(Clone, Copy, Debug)]
struct Vertex {
    position_m: [f32; 3],
    /// From the page's own surface to the parent's.
    rise_m: [f32; 3],
    /// Way of a skirt's lower edge per metre of its depth; 0 on the surface.
    sink: [f32; 3],
}

/// A run of triangles and the box round all places that morphing may take them to.
#[derive(Clone, Debug)]
struct Block {
    low_m: DVec3,
    high_m: DVec3,
    /// Longest `sink` in it.
    sink: f64,
    indices: Range<usize>,
}

#[derive(Debug)]
pub struct PickMesh {
    origin: Point<Ecef>,
    vertices: Vec<Vertex>,
    indices: Vec<u16>,
    blocks: Vec<Block>,
}

/// How a mesh is drawn in a frame.
#[derive(Clone, Copy, Debug)]
pub struct Pose<'a> {
    pub own: f64,
    pub skirt_m: f64,
    pub press: Option<&'a Pressing>,
}

/// The ground press of a view, as `press_at` in frame.wgsl has it.
#[derive(Clone, Copy, Debug)]
pub struct Pressing {
    eye: DVec3,
    zenith: DVec3,
    pub depth_m: f64,
    radius_m: f64,
}

impl Pressing {
    pub fn new(eye: Point<Ecef>, zenith: DVec3, press: GroundPress) -> Self {
        Self { eye: eye.xyz(), zenith, depth_m: f64::from(press.depth_m), radius_m: f64::from(press.radius_m) }
    }

    /// How far the ground at a point is lowered, metres.
    pub fn at_m(&self, point: Point<Ecef>) -> f64 {
        let from_eye = point.xyz() - self.eye;
        let across_m = (from_eye - self.zenith * from_eye.dot(self.zenith)).length();
        let (near_m, far_m) = (self.radius_m.max(1e-3), (2.0 * self.radius_m).max(2e-3));
        let t = ((across_m - near_m) / (far_m - near_m)).clamp(0.0, 1.0);
        self.depth_m * (1.0 - t * t * (3.0 - 2.0 * t))
    }
}

impl PickMesh {
    /// The surface of a page cut to a piece, with its skirts.
    pub fn of(page: &TerrainPage, piece: CellId) -> Self {
        let mesh = page.cut(piece);
        let vertices: Vec<_> = mesh.vertices.iter().map(|vertex| moved(&mesh, vertex)).collect();
        let blocks = (0..mesh.indices.len())
            .step_by(3 * BLOCK_TRIANGLES)
            .map(|start| {
                let end = (start + 3 * BLOCK_TRIANGLES).min(mesh.indices.len());
                block(&vertices, &mesh.indices[start..end], start..end)
            })
            .collect();
        // 65 × 65 posts, their cuts and their skirts are far fewer than 2¹⁶.
        let indices = mesh.indices.iter().map(|&index| index as u16).collect();
        Self { origin: mesh.origin, vertices, indices, blocks }
    }

    fn byte_len(&self) -> usize {
        size_of::<Self>() + size_of_val(&*self.vertices) + size_of_val(&*self.indices) + size_of_val(&*self.blocks)
    }

    /// Distance to the nearest front that a ray meets before `before_m`.
    pub fn meet(&self, ray: &Ray, pose: Pose<'_>, before_m: f64, work: &mut PickWork) -> Option<f64> {
        let from_origin = (ray.origin - self.origin).xyz();
        let depth_m = pose.press.map_or(0.0, |press| press.depth_m);
        let mut nearest_m = before_m;
        for block in &self.blocks {
            let slack = DVec3::splat(block.sink * pose.skirt_m + depth_m);
            let entry = enters_aligned(from_origin, ray.direction, block.low_m - slack, block.high_m + slack);
            work.boxes += 1;
            if entry.is_some_and(|entry_m| entry_m < nearest_m) {
                nearest_m = self.meet_block(block, ray, from_origin, pose, nearest_m);
                work.triangles += (block.indices.len() / 3) as u32;
            }
        }
        (nearest_m < before_m).then_some(nearest_m)
    }

    fn meet_block(&self, block: &Block, ray: &Ray, from_origin: DVec3, pose: Pose<'_>, before_m: f64) -> f64 {
        let corner = |&index: &u16| self.drawn(usize::from(index), pose) - from_origin;
        self.indices[block.indices.clone()]
            .chunks_exact(3)
            .filter_map(|t| meets_front(ray.direction, [corner(&t[0]), corner(&t[1]), corner(&t[2])]))
            .fold(before_m, f64::min)
    }

    /// Where a vertex is drawn, from the mesh's origin; see vs_main in terrain.wgsl.
    fn drawn(&self, index: usize, pose: Pose<'_>) -> DVec3 {
        let vertex = &self.vertices[index];
        let own_place = wide(vertex.position_m);
        let moved = own_place + wide(vertex.rise_m) * (1.0 - pose.own) + wide(vertex.sink) * pose.skirt_m;
        let Some(press) = pose.press else { return moved };
        let place = Point::new(self.origin.xyz() + own_place);
        moved - normal_through(place) * press.at_m(place)
    }
}

fn wide(v: [f32; 3]) -> DVec3 {
    DVec3::from(v.map(f64::from))
}

fn moved(mesh: &TerrainMesh, vertex: &TerrainVertex) -> Vertex {
    let place = Point::new(mesh.origin.xyz() + wide(vertex.position_m));
    let up = normal_through(place);
    let is_lower_edge = vertex.slope_skirt[2] != 0;
    let sink = if is_lower_edge { flare(up, vertex.uv[1]) - up } else { DVec3::ZERO };
    Vertex {
        position_m: vertex.position_m,
        rise_m: (up * f64::from(vertex.morph_m)).as_vec3().to_array(),
        sink: sink.as_vec3().to_array(),
    }
}

/// How far a skirt's lower edge leans out per metre of depth: along the meridian on a piece's southern and northern
/// border.
fn flare(up: DVec3, v: u16) -> DVec3 {
    let rim = match v {
        0 => -1.0,
        u16::MAX => 1.0,
        _ => return DVec3::ZERO,
    };
    let north = up.cross(DVec3::new(-up.y, up.x, 0.0)).normalize_or_zero();
    north * rim * (up.z.abs() / up.truncate().length()).min(STEEPEST)
}

fn block(vertices: &[Vertex], triangles: &[u32], indices: Range<usize>) -> Block {
    let (mut low_m, mut high_m, mut sink) = (DVec3::INFINITY, DVec3::NEG_INFINITY, 0.0f64);
    for vertex in triangles.iter().map(|&index| &vertices[index as usize]) {
        let own = wide(vertex.position_m);
        let parent = own + wide(vertex.rise_m);
        low_m = low_m.min(own).min(parent);
        high_m = high_m.max(own).max(parent);
        sink = sink.max(wide(vertex.sink).length());
    }
    Block { low_m, high_m, sink, indices }
}

struct Kept {
    page: Weak<TerrainPage>,
    mesh: Arc<PickMesh>,
    used: u64,
}

/// The meshes of pieces that rays came near, the least recently used ones dropped beyond [`PICK_MESH_BYTES_MAX`].
#[derive(Default)]
pub struct PickMeshes {
    kept: HashMap<CellId, Kept>,
    bytes: usize,
    calls: u64,
}

impl PickMeshes {
    pub fn get(&mut self, piece: &DrawPiece) -> Arc<PickMesh> {
        self.calls += 1;
        let used = self.calls;
        if let Some(kept) = self.kept.get_mut(&piece.cell)
            && kept.page.as_ptr() == Arc::as_ptr(&piece.terrain)
        {
            kept.used = used;
            return Arc::clone(&kept.mesh);
        }
        let mesh = Arc::new(PickMesh::of(&piece.terrain, piece.cell));
        self.bytes += mesh.byte_len();
        let kept = Kept { page: Arc::downgrade(&piece.terrain), mesh: Arc::clone(&mesh), used };
        if let Some(old) = self.kept.insert(piece.cell, kept) {
            self.bytes -= old.mesh.byte_len();
        }
        self.shrink();
        mesh
    }

    fn shrink(&mut self) {
        while self.bytes > PICK_MESH_BYTES_MAX {
            let Some((&oldest, _)) = self.kept.iter().min_by_key(|(_, kept)| kept.used) else { break };
            if let Some(dropped) = self.kept.remove(&oldest) {
                self.bytes -= dropped.mesh.byte_len();
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::content::{POSTS, TerrainPost};
    use crate::geodesy::{Geodetic, OrientedBox};

    fn rough(cell: CellId) -> Arc<TerrainPage> {
        let post = |at: usize| TerrainPost {
            column: (at % POSTS) as u8,
            row: (at / POSTS) as u8,
            height_m: (at * 37 % 101) as f32,
            parent_height_m: (at * 53 % 97) as f32,
            slope: [0; 2],
        };
        Arc::new(TerrainPage::from_posts(cell, 1.0, (0..POSTS * POSTS).map(post).collect()).unwrap())
    }

    fn piece(cell: CellId, terrain: &Arc<TerrainPage>) -> DrawPiece {
        let around = OrientedBox::around(&cell.bounds(), -1e3, 1e3);
        DrawPiece { cell, terrain: Arc::clone(terrain), imagery: None, own: 1.0, error_m: 0.0, skirt_m: 0.0, around }
    }

    #[test]
    fn meshes_are_kept_within_their_limit_and_go_with_their_page() {
        let coarse = [CellId::containing(0.5, 0.5, 9), CellId::containing(0.5, 0.6, 9)];
        let cells: Vec<_> = coarse.iter().flat_map(|cell| cell.children()).flat_map(CellId::children).collect();
        let mut meshes = PickMeshes::default();
        let pages: Vec<_> = cells.iter().map(|&cell| rough(cell)).collect();
        let first = meshes.get(&piece(cells[0], &pages[0]));
        assert!(Arc::ptr_eq(&first, &meshes.get(&piece(cells[0], &pages[0]))));
        let other_page = rough(cells[0]);
        assert!(!Arc::ptr_eq(&first, &meshes.get(&piece(cells[0], &other_page))));
        let mut all_bytes = 0;
        for (&cell, page) in cells.iter().zip(&pages) {
            all_bytes += meshes.get(&piece(cell, page)).byte_len();
            let held: usize = meshes.kept.values().map(|kept| kept.mesh.byte_len()).sum();
            assert!(held == meshes.bytes && held <= PICK_MESH_BYTES_MAX);
            assert!(meshes.kept.contains_key(&cell));
        }
        assert!(all_bytes > PICK_MESH_BYTES_MAX, "{all_bytes} bytes do not try the limit");
        assert!(meshes.kept.len() > 4 && !meshes.kept.contains_key(&cells[0]));
    }

    #[test]
    fn few_triangles_are_tried_and_the_surface_is_met_at_each_morph_and_press() {
        let cell = CellId::containing(0.9, -2.0, 12);
        let page = rough(cell);
        let mesh = PickMesh::of(&page, cell);
        let center = cell.bounds().at(0.3, 0.7, 2_000.0);
        let (mut work, ray) = (PickWork::default(), Ray { origin: center.to_ecef(), direction: -center.up() });
        let ground_m = |own| page.surface_height_m(center.lat_rad, center.lon_rad, own).unwrap();
        for own in [0.0, 0.4, 1.0] {
            let met = mesh.meet(&ray, Pose { own, skirt_m: 5.0, press: None }, f64::INFINITY, &mut work).unwrap();
            assert!((2_000.0 - met - ground_m(own)).abs() < 2e-3);
        }
        assert!(work.triangles > 0 && work.triangles < 3 * 40 * BLOCK_TRIANGLES as u32, "{work:?}");
        let press = GroundPress { depth_m: 30.0, radius_m: 1e6 };
        let press = Pressing::new(center.to_ecef(), center.up(), press);
        let pose = Pose { own: 1.0, skirt_m: 5.0, press: Some(&press) };
        let met = mesh.meet(&ray, pose, f64::INFINITY, &mut work).unwrap();
        assert!((2_000.0 - met - ground_m(1.0) + 30.0).abs() < 2e-3);
        assert_eq!(mesh.meet(&ray, pose, met - 1.0, &mut work), None);
        // From below there is nothing to be seen.
        let below = Geodetic { height_m: -3_000.0, ..center };
        assert_eq!(mesh.meet(&Ray { origin: below.to_ecef(), direction: center.up() }, pose, 1e9, &mut work), None);
    }
}
