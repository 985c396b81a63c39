//! The terrain pass.

use super::device::{FrameStorage, Gpu};
use super::imagery::{ImageryArena, ImageryPlace};
use super::layout::TERRAIN_WGSL;
use super::meshes::{MeshArena, MeshKey};
use super::pass::{Entries, PassShape, Pipelines, storage_layout};
use crate::content::{IMAGERY_GUTTER_PX, IMAGERY_PX, IMAGERY_STORED_PX, TerrainVertex};
use crate::forest::CellId;
use bytemuck::{Pod, Zeroable};

/// Mirrors `Piece` in terrain.wgsl.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub(super) struct Piece {
    pub offset: [f32; 3],
    pub own: f32,
    pub uv_scale: [f32; 2],
    pub uv_offset: [f32; 2],
    pub skirt_m: f32,
    pub layer: u32,
    pub id: u32,
    pub textured: u32,
}

/// Mirrors `TerrainVertex` in terrain.wgsl.
pub(super) const ATTRIBUTES: [wgpu::VertexAttribute; 4] =
    wgpu::vertex_attr_array![0 => Float32x3, 1 => Float32, 2 => Unorm16x2, 3 => Snorm8x4];

/// A piece that is ready to be drawn.
#[derive(Clone, Copy, Debug)]
pub(super) struct TerrainItem {
    pub mesh: MeshKey,
    pub picture: Option<ImageryPlace>,
    pub piece: Piece,
}

#[derive(Debug)]
pub(super) struct TerrainPass {
    pipelines: Pipelines,
    pieces: FrameStorage,
}

impl TerrainPass {
    pub fn new(gpu: &Gpu, frame: &wgpu::BindGroupLayout, imagery: &wgpu::BindGroupLayout) -> Self {
        let storage = storage_layout(gpu, "pieces", 1);
        let shape = PassShape {
            label: "terrain",
            source: TERRAIN_WGSL,
            vertices: vec![Some(wgpu::VertexBufferLayout {
                array_stride: size_of::<TerrainVertex>() as u64,
                step_mode: wgpu::VertexStepMode::Vertex,
                attributes: &ATTRIBUTES,
            })],
            entries: Entries::default(),
            backdrop: false,
        };
        Self {
            pipelines: Pipelines::new(gpu, shape, &[frame, &storage, imagery]),
            pieces: FrameStorage::new(gpu, "pieces", &storage),
        }
    }

    pub fn write(&mut self, gpu: &Gpu, items: &[TerrainItem]) {
        let pieces: Vec<Piece> = items.iter().map(|item| item.piece).collect();
        self.pieces.write(gpu, bytemuck::cast_slice(&pieces));
    }

    /// Draws what was written, in that order; gives the number of draw calls.
    pub fn draw(
        &self,
        gpu: &Gpu,
        pass: &mut wgpu::RenderPass,
        aov: bool,
        items: &[TerrainItem],
        meshes: &MeshArena,
        imagery: &ImageryArena,
    ) -> u32 {
        pass.set_pipeline(self.pipelines.get(gpu, aov));
        pass.set_bind_group(1, self.pieces.group(), &[]);
        let mut bound = None;
        let mut calls = 0;
        for (instance, item) in (0..).zip(items) {
            let Some(mesh) = meshes.get(item.mesh).filter(|mesh| mesh.index_count > 0) else { continue };
            let array = item.picture.map(|picture| picture.array);
            if bound != Some(array) {
                pass.set_bind_group(2, imagery.group(array), &[]);
                bound = Some(array);
            }
            pass.set_vertex_buffer(0, mesh.vertices.slice(..));
            pass.set_index_buffer(mesh.indices.slice(..), mesh.format);
            pass.draw_indexed(0..mesh.index_count, 0, instance..instance + 1);
            calls += 1;
        }
        calls
    }
}

/// Scale and offset that take fractions of `piece` (v north) to texture coordinates (v south) in the picture of
/// `picture`, the same cell or one above it.
pub(super) fn texture_window(piece: CellId, picture: CellId) -> ([f32; 2], [f32; 2]) {
    let (inner, outer) = (piece.bounds(), picture.bounds());
    let (west, south) = outer.fractions(inner.south_rad, inner.west_rad);
    let (east, north) = outer.fractions(inner.north_rad, inner.east_rad);
    let stored = f64::from(IMAGERY_STORED_PX);
    let (side, gutter) = (f64::from(IMAGERY_PX) / stored, f64::from(IMAGERY_GUTTER_PX) / stored);
    let scale = [side * (east - west), -side * (north - south)];
    let offset = [gutter + side * west, gutter + side * (1.0 - south)];
    (scale.map(|v| v as f32), offset.map(|v| v as f32))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::forest::Zone;

    #[test]
    fn a_picture_fills_its_cell_and_lends_a_quarter_to_a_child() {
        let cell = Zone::new(20).unwrap().root();
        let texel = |v: f32| v * IMAGERY_STORED_PX as f32;
        let check = |piece, west: f32, north: f32, side: f32| {
            let (scale, offset) = texture_window(piece, cell);
            assert!((texel(offset[0]) - west).abs() < 1e-3);
            assert!((texel(offset[1] + scale[1]) - north).abs() < 1e-3);
            assert!((texel(scale[0]) - side).abs() < 1e-3 && (texel(-scale[1]) - side).abs() < 1e-3);
        };
        check(cell, 1.0, 1.0, 256.0);
        check(cell.child(crate::forest::Quadrant::NorthEast).unwrap(), 129.0, 1.0, 128.0);
        check(cell.child(crate::forest::Quadrant::SouthWest).unwrap(), 1.0, 129.0, 128.0);
    }
}
