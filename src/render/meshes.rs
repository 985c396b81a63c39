//! Terrain meshes on the GPU: cut on demand, kept while they fit, the least recently drawn dropped first.

use super::device::Gpu;
use super::renderer::ArenaFull;
use crate::content::{TerrainMesh, TerrainPage};
use crate::forest::CellId;
use crate::geodesy::{Ecef, Point};
use std::collections::HashMap;

/// The page's cell and the piece's.
pub(super) type MeshKey = (CellId, CellId);

#[derive(Debug)]
pub(super) struct Mesh {
    pub vertices: wgpu::Buffer,
    pub indices: wgpu::Buffer,
    pub format: wgpu::IndexFormat,
    pub index_count: u32,
    pub origin: Point<Ecef>,
    bytes: u64,
    drawn_in: u64,
}

/// Indices as short as they can be, padded to whole words.
pub(super) fn packed_indices(indices: &[u32], vertex_count: usize) -> (Vec<u8>, wgpu::IndexFormat) {
    if vertex_count > usize::from(u16::MAX) {
        return (bytemuck::cast_slice(indices).to_vec(), wgpu::IndexFormat::Uint32);
    }
    let mut short: Vec<u16> = indices.iter().map(|&index| index as u16).collect();
    short.resize(short.len().next_multiple_of(2), 0);
    (bytemuck::cast_slice(&short).to_vec(), wgpu::IndexFormat::Uint16)
}

#[derive(Debug)]
pub(super) struct MeshArena {
    limit_bytes: u64,
    bytes: u64,
    frame: u64,
    meshes: HashMap<MeshKey, Mesh>,
}

impl MeshArena {
    pub fn new(limit_bytes: u64) -> Self {
        Self { limit_bytes, bytes: 0, frame: 0, meshes: HashMap::new() }
    }

    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Above a lowered limit the least recently drawn meshes go when the next one is cut.
    pub fn set_limit(&mut self, limit_bytes: u64) {
        self.limit_bytes = limit_bytes;
        if self.bytes > limit_bytes {
            // What was drawn may go; it is cut again where it is drawn again.
            self.frame += 1;
            let _ = self.make_room(0);
        }
    }

    /// What was drawn before may be dropped from now on.
    pub fn begin_frame(&mut self) {
        self.frame += 1;
    }

    pub fn get(&self, key: MeshKey) -> Option<&Mesh> {
        self.meshes.get(&key)
    }

    /// The mesh of a page cut to a piece, and whether it had to be cut. Fails when what this frame has drawn already
    /// leaves no room.
    pub fn ensure(&mut self, gpu: &Gpu, page: &TerrainPage, piece: CellId) -> Result<(&Mesh, bool), ArenaFull> {
        let key = (page.cell, piece);
        let is_new = !self.meshes.contains_key(&key);
        if is_new {
            let mesh = self.upload(gpu, &page.cut(piece))?;
            self.bytes += mesh.bytes;
            self.meshes.insert(key, mesh);
        }
        match self.meshes.get_mut(&key) {
            Some(mesh) => {
                mesh.drawn_in = self.frame;
                Ok((mesh, is_new))
            }
            None => Err(ArenaFull { needed_bytes: 0, limit_bytes: self.limit_bytes }),
        }
    }

    fn upload(&mut self, gpu: &Gpu, cut: &TerrainMesh) -> Result<Mesh, ArenaFull> {
        let vertices: &[u8] = bytemuck::cast_slice(&cut.vertices);
        let (indices, format) = packed_indices(&cut.indices, cut.vertices.len());
        let bytes = (vertices.len() + indices.len()) as u64;
        self.make_room(bytes)?;
        Ok(Mesh {
            vertices: gpu.filled_buffer("terrain vertices", wgpu::BufferUsages::VERTEX, vertices),
            indices: gpu.filled_buffer("terrain indices", wgpu::BufferUsages::INDEX, &indices),
            format,
            index_count: cut.indices.len() as u32,
            origin: cut.origin,
            bytes,
            drawn_in: self.frame,
        })
    }

    fn make_room(&mut self, needed_bytes: u64) -> Result<(), ArenaFull> {
        if self.bytes + needed_bytes <= self.limit_bytes {
            return Ok(());
        }
        let mut old: Vec<_> =
            self.meshes.iter().filter(|(_, m)| m.drawn_in < self.frame).map(|(&key, m)| (m.drawn_in, key)).collect();
        old.sort_unstable();
        for (_, key) in old {
            if self.bytes + needed_bytes <= self.limit_bytes {
                break;
            }
            self.drop_mesh(key);
        }
        let fits = self.bytes + needed_bytes <= self.limit_bytes;
        fits.then_some(()).ok_or(ArenaFull { needed_bytes, limit_bytes: self.limit_bytes })
    }

    fn drop_mesh(&mut self, key: MeshKey) {
        if let Some(mesh) = self.meshes.remove(&key) {
            self.bytes -= mesh.bytes;
        }
    }

    /// Drops all meshes of a page.
    pub fn remove(&mut self, page: CellId) {
        let keys: Vec<_> = self.meshes.keys().filter(|key| key.0 == page).copied().collect();
        keys.into_iter().for_each(|key| self.drop_mesh(key));
    }

    pub fn clear(&mut self) {
        self.meshes.clear();
        self.bytes = 0;
    }
}
