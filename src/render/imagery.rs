//! Pictures on the GPU: layers of texture arrays that are allocated and freed in chunks; and the world image, small
//! pictures of all zones in one array, which stays.

use super::device::Gpu;
use super::pass::picture_layout;
use super::renderer::ArenaFull;
use crate::content::{IMAGERY_STORED_PX, ImageryPage, WORLD_IMAGE_MIP};
use crate::forest::{CellId, ZONE_COUNT};
use std::collections::HashMap;

/// Most layers of a chunk: 2.8 MB at a time, of which what no picture uses is lost.
const CHUNK_LAYERS: u32 = 8;
/// 258, 129, …, 1.
const MIP_LEVELS: u32 = IMAGERY_STORED_PX.ilog2() + 1;
const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8UnormSrgb;

/// Where a picture lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct ImageryPlace {
    pub array: PictureArray,
    pub layer: u32,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum PictureArray {
    Chunk(usize),
    WorldImage,
}

/// A layer of a chunk.
#[derive(Clone, Copy, Debug)]
struct Slot {
    chunk: usize,
    layer: u32,
}

#[derive(Debug)]
struct Chunk {
    texture: wgpu::Texture,
    group: wgpu::BindGroup,
    free: Vec<u32>,
}

impl Chunk {
    fn layers(&self) -> u32 {
        self.texture.depth_or_array_layers()
    }
}

#[derive(Debug)]
pub(super) struct ImageryArena {
    limit_bytes: u64,
    pub layout: wgpu::BindGroupLayout,
    sampler: wgpu::Sampler,
    /// Bound where there is no picture.
    none: Chunk,
    chunks: Vec<Option<Chunk>>,
    slots: HashMap<CellId, Slot>,
    /// A layer for each zone; those that are there, by zone.
    world: Option<Chunk>,
    in_world: [bool; ZONE_COUNT],
}

fn mip_side(level: u32) -> u32 {
    (IMAGERY_STORED_PX >> level).max(1)
}

/// Bytes of a picture with its mips.
pub(super) fn layer_bytes() -> u64 {
    (0..MIP_LEVELS).map(|level| 4 * u64::from(mip_side(level)).pow(2)).sum()
}

/// Bytes of the world image.
pub(super) fn world_image_bytes() -> u64 {
    let layer: u64 = (WORLD_IMAGE_MIP..MIP_LEVELS).map(|level| 4 * u64::from(mip_side(level)).pow(2)).sum();
    layer * ZONE_COUNT as u64
}

impl ImageryArena {
    pub fn new(gpu: &Gpu, limit_bytes: u64) -> Self {
        let layout = picture_layout(gpu, "imagery", wgpu::TextureViewDimension::D2Array);
        let sampler = gpu.device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("imagery"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            mipmap_filter: wgpu::MipmapFilterMode::Linear,
            ..Default::default()
        });
        let none = chunk(gpu, &layout, &sampler, 1, 1);
        Self {
            limit_bytes,
            layout,
            sampler,
            none,
            chunks: Vec::new(),
            slots: HashMap::new(),
            world: None,
            in_world: [false; ZONE_COUNT],
        }
    }

    /// For uploads from now on; what is there stays.
    pub fn set_limit(&mut self, limit_bytes: u64) {
        self.limit_bytes = limit_bytes;
    }

    /// Of the pictures that come and go.
    pub fn bytes(&self) -> u64 {
        self.chunks.iter().flatten().map(|chunk| u64::from(chunk.layers()) * layer_bytes()).sum()
    }

    pub fn place(&self, cell: CellId) -> Option<ImageryPlace> {
        self.slots.get(&cell).map(|slot| ImageryPlace { array: PictureArray::Chunk(slot.chunk), layer: slot.layer })
    }

    /// The part of the world image in which a cell lies: its zone, and where that is.
    pub fn world_place(&self, cell: CellId) -> Option<(CellId, ImageryPlace)> {
        let zone = cell.zone();
        let place = ImageryPlace { array: PictureArray::WorldImage, layer: zone.index() as u32 };
        self.in_world[zone.index()].then_some((zone.root(), place))
    }

    /// The bind group of an array, or of no picture.
    pub fn group(&self, array: Option<PictureArray>) -> &wgpu::BindGroup {
        let chunk = array.and_then(|array| match array {
            PictureArray::Chunk(index) => self.chunks.get(index)?.as_ref(),
            PictureArray::WorldImage => self.world.as_ref(),
        });
        &chunk.unwrap_or(&self.none).group
    }

    pub fn upload(&mut self, gpu: &Gpu, page: &ImageryPage) -> Result<u64, ArenaFull> {
        if !self.slots.contains_key(&page.cell) {
            let slot = self.take_layer(gpu)?;
            if let Some(chunk) = &self.chunks[slot.chunk] {
                write(gpu, chunk, slot.layer, page, 0);
            }
            self.slots.insert(page.cell, slot);
        }
        Ok(layer_bytes())
    }

    /// Takes the coarse mips of a zone's picture into the world image.
    pub fn add_to_world(&mut self, gpu: &Gpu, root: &ImageryPage) {
        let zone = root.cell.zone().index();
        let (layout, sampler) = (&self.layout, &self.sampler);
        let world =
            self.world.get_or_insert_with(|| chunk(gpu, layout, sampler, ZONE_COUNT as u32, mip_side(WORLD_IMAGE_MIP)));
        write(gpu, world, zone as u32, root, WORLD_IMAGE_MIP);
        self.in_world[zone] = true;
    }

    fn take_layer(&mut self, gpu: &Gpu) -> Result<Slot, ArenaFull> {
        for (chunk, slot) in self.chunks.iter_mut().enumerate() {
            if let Some(layer) = slot.as_mut().and_then(|slot| slot.free.pop()) {
                return Ok(Slot { chunk, layer });
            }
        }
        // A limit of a few pictures gives a chunk of a few pictures.
        let layers = (self.limit_bytes / layer_bytes()).min(u64::from(CHUNK_LAYERS)) as u32;
        if layers == 0 || self.bytes() + u64::from(layers) * layer_bytes() > self.limit_bytes {
            return Err(ArenaFull { needed_bytes: layer_bytes(), limit_bytes: self.limit_bytes });
        }
        let mut fresh = chunk(gpu, &self.layout, &self.sampler, layers, IMAGERY_STORED_PX);
        let layer = fresh.free.pop().unwrap_or(0);
        let chunk = self.chunks.iter().position(Option::is_none).unwrap_or(self.chunks.len());
        if chunk == self.chunks.len() {
            self.chunks.push(None);
        }
        self.chunks[chunk] = Some(fresh);
        Ok(Slot { chunk, layer })
    }

    /// Moves the pictures of the emptiest chunk into the others and lets it go, if they have room for them.
    pub fn compact(&mut self, gpu: &Gpu) {
        let free = |slot: &Option<Chunk>| slot.as_ref().map_or(0, |chunk| chunk.free.len());
        let spare: usize = self.chunks.iter().map(free).sum();
        let allocated = (0..self.chunks.len()).filter(|&at| self.chunks[at].is_some());
        let Some(emptiest) = allocated.max_by_key(|&at| free(&self.chunks[at])) else { return };
        let unused = free(&self.chunks[emptiest]);
        let used = self.chunks[emptiest].as_ref().map_or(0, |chunk| chunk.layers() as usize - unused);
        if spare - unused < used {
            return;
        }
        let Some(leaving) = self.chunks[emptiest].take() else { return };
        let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        for slot in self.slots.values_mut().filter(|slot| slot.chunk == emptiest) {
            let mut others = self.chunks.iter_mut().enumerate();
            let room =
                others.find_map(|(at, slot)| slot.as_mut().and_then(|chunk| Some((at, chunk.free.pop()?, chunk))));
            let Some((at, layer, chunk)) = room else { continue };
            copy_layer(&mut encoder, (&leaving.texture, slot.layer), (&chunk.texture, layer));
            *slot = Slot { chunk: at, layer };
        }
        gpu.queue.submit([encoder.finish()]);
    }

    pub fn remove(&mut self, cell: CellId) {
        let Some(Slot { chunk: at, layer }) = self.slots.remove(&cell) else { return };
        if let Some(chunk) = &mut self.chunks[at] {
            chunk.free.push(layer);
            if chunk.free.len() as u32 == chunk.layers() {
                self.chunks[at] = None;
            }
        }
    }
}

/// Writes the mips of a picture from `first_mip` on into a layer.
fn write(gpu: &Gpu, chunk: &Chunk, layer: u32, page: &ImageryPage, first_mip: u32) {
    for (level, texels) in (first_mip..MIP_LEVELS).zip(page.mips.iter().skip(first_mip as usize)) {
        let side = mip_side(level);
        debug_assert_eq!(texels.len(), 4 * (side * side) as usize, "mip {level} of {}", page.cell);
        gpu.queue.write_texture(
            wgpu::TexelCopyTextureInfo {
                texture: &chunk.texture,
                mip_level: level - first_mip,
                origin: wgpu::Origin3d { x: 0, y: 0, z: layer },
                aspect: wgpu::TextureAspect::All,
            },
            texels,
            wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(4 * side), rows_per_image: Some(side) },
            wgpu::Extent3d { width: side, height: side, depth_or_array_layers: 1 },
        );
    }
}

/// A picture with its mips.
fn copy_layer(encoder: &mut wgpu::CommandEncoder, from: (&wgpu::Texture, u32), to: (&wgpu::Texture, u32)) {
    for mip_level in 0..MIP_LEVELS {
        let side = mip_side(mip_level);
        let part = |(texture, z)| wgpu::TexelCopyTextureInfo {
            texture,
            mip_level,
            origin: wgpu::Origin3d { x: 0, y: 0, z },
            aspect: wgpu::TextureAspect::All,
        };
        let size = wgpu::Extent3d { width: side, height: side, depth_or_array_layers: 1 };
        encoder.copy_texture_to_texture(part(from), part(to), size);
    }
}

fn chunk(gpu: &Gpu, layout: &wgpu::BindGroupLayout, sampler: &wgpu::Sampler, layers: u32, side: u32) -> Chunk {
    let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some("imagery"),
        size: wgpu::Extent3d { width: side, height: side, depth_or_array_layers: layers },
        mip_level_count: side.ilog2() + 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: FORMAT,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST | wgpu::TextureUsages::COPY_SRC,
        view_formats: &[],
    });
    let view = texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2Array),
        ..Default::default()
    });
    let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some("imagery"),
        layout,
        entries: &[
            wgpu::BindGroupEntry { binding: 0, resource: wgpu::BindingResource::TextureView(&view) },
            wgpu::BindGroupEntry { binding: 1, resource: wgpu::BindingResource::Sampler(sampler) },
        ],
    });
    Chunk { texture, group, free: (0..layers).rev().collect() }
}
