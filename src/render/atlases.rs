//! Objects with textures: the pipelines of their pages and the atlases that these draw from. Pages without cost nothing.

use super::device::Gpu;
use super::layout::OBJECTS_WGSL;
use super::objects::VERTICES;
use super::pass::{Entries, PassShape, Pipelines, picture_layout};
use crate::content::{ATLAS_MIPS, Atlas, AtlasFormat};
use std::sync::OnceLock;

/// Location 2 in objects.wgsl: right and down in the atlas.
const UV: [wgpu::VertexAttribute; 1] = wgpu::vertex_attr_array![2 => Unorm16x2];
const UVS: wgpu::VertexBufferLayout<'static> = wgpu::VertexBufferLayout {
    array_stride: size_of::<[u16; 2]>() as u64,
    step_mode: wgpu::VertexStepMode::Vertex,
    attributes: &UV,
};
const ENTRIES: Entries =
    Entries { vertex: "vs_textured", color: "fs_textured", aov: "fs_textured_aov", fading: "fs_textured_fading" };

/// What textured pages have beside others.
#[derive(Debug)]
pub(super) struct Textures {
    pub uvs: wgpu::Buffer,
    pub group: wgpu::BindGroup,
}

#[derive(Debug)]
pub(super) struct Atlases {
    /// Of the groups before the atlas's.
    layouts: Vec<wgpu::BindGroupLayout>,
    layout: wgpu::BindGroupLayout,
    sampler: wgpu::Sampler,
    /// Made for the first page that has textures.
    pipelines: OnceLock<Pipelines>,
}

impl Atlases {
    pub fn new(gpu: &Gpu, layouts: [&wgpu::BindGroupLayout; 3]) -> Self {
        let sampler = gpu.device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("atlas"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            mipmap_filter: wgpu::MipmapFilterMode::Linear,
            ..Default::default()
        });
        let layout = picture_layout(gpu, "atlas", wgpu::TextureViewDimension::D2);
        Self { layouts: layouts.map(Clone::clone).to_vec(), layout, sampler, pipelines: OnceLock::new() }
    }

    pub fn pipelines(&self, gpu: &Gpu) -> &Pipelines {
        self.pipelines.get_or_init(|| {
            let shape = PassShape {
                label: "textured objects",
                source: OBJECTS_WGSL,
                vertices: vec![Some(VERTICES), Some(UVS)],
                entries: ENTRIES,
                backdrop: false,
            };
            let groups: Vec<&wgpu::BindGroupLayout> = self.layouts.iter().chain([&self.layout]).collect();
            Pipelines::new(gpu, shape, &groups)
        })
    }

    pub fn upload(&self, gpu: &Gpu, atlas: &Atlas, uvs: &[[u16; 2]]) -> Textures {
        let view = write(gpu, atlas).create_view(&wgpu::TextureViewDescriptor::default());
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("atlas"),
            layout: &self.layout,
            entries: &[
                wgpu::BindGroupEntry { binding: 0, resource: wgpu::BindingResource::TextureView(&view) },
                wgpu::BindGroupEntry { binding: 1, resource: wgpu::BindingResource::Sampler(&self.sampler) },
            ],
        });
        let uvs = bytemuck::cast_slice(uvs);
        Textures { uvs: gpu.filled_buffer("object texture places", wgpu::BufferUsages::VERTEX, uvs), group }
    }
}

/// An atlas with its mips.
fn write(gpu: &Gpu, atlas: &Atlas) -> wgpu::Texture {
    let [width, height] = atlas.size_px();
    let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some("atlas"),
        size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        mip_level_count: ATLAS_MIPS,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: gpu_format(atlas.format()),
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    });
    let (block_px, block_bytes) = atlas.format().block();
    for (level, texels) in (0..ATLAS_MIPS).zip(atlas.mips()) {
        let [width, height] = [width, height].map(|side| (side >> level).next_multiple_of(block_px));
        let (across, down) = (width / block_px, height / block_px);
        gpu.queue.write_texture(
            wgpu::TexelCopyTextureInfo {
                texture: &texture,
                mip_level: level,
                origin: wgpu::Origin3d::ZERO,
                aspect: wgpu::TextureAspect::All,
            },
            texels,
            wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(block_bytes * across),
                rows_per_image: Some(down),
            },
            wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        );
    }
    texture
}

fn gpu_format(format: AtlasFormat) -> wgpu::TextureFormat {
    match format {
        AtlasFormat::Rgba8 => wgpu::TextureFormat::Rgba8UnormSrgb,
        AtlasFormat::Bc7 => wgpu::TextureFormat::Bc7RgbaUnormSrgb,
        AtlasFormat::Etc2 => wgpu::TextureFormat::Etc2Rgb8UnormSrgb,
    }
}
