//! Textures of egui on the GPU.

use super::device::Gpu;
use super::pass::picture_layout;
use egui::epaint::{ColorImage, ImageData, ImageDelta};
use egui::{TextureFilter, TextureId, TextureOptions, TextureWrapMode};
use std::collections::HashMap;

#[derive(Debug)]
struct Held {
    texture: wgpu::Texture,
    group: wgpu::BindGroup,
}

/// What egui has set and not freed.
#[derive(Debug)]
pub(super) struct OverlayTextures {
    pub layout: wgpu::BindGroupLayout,
    held: HashMap<TextureId, Held>,
}

impl OverlayTextures {
    pub fn new(gpu: &Gpu) -> Self {
        Self { layout: picture_layout(gpu, "egui", wgpu::TextureViewDimension::D2), held: HashMap::new() }
    }

    pub fn group(&self, id: TextureId) -> Option<&wgpu::BindGroup> {
        self.held.get(&id).map(|held| &held.group)
    }

    pub fn free(&mut self, id: TextureId) {
        self.held.remove(&id);
    }

    /// Sets a whole texture or changes a part of one. A part that does not fit what is there is left: after a loss the
    /// whole texture comes first.
    pub fn update(&mut self, gpu: &Gpu, id: TextureId, delta: &ImageDelta) {
        let ImageData::Color(image) = &delta.image;
        let limit = gpu.device.limits().max_texture_dimension_2d as usize;
        if image.pixels.len() != image.size[0] * image.size[1]
            || image.size.iter().any(|&side| side == 0 || side > limit)
        {
            return;
        }
        match delta.pos {
            None => {
                let held = self.create(gpu, image, delta.options);
                upload(gpu, &held.texture, image, [0, 0]);
                self.held.insert(id, held);
            }
            Some(at) => {
                if let Some(held) = self.held.get(&id).filter(|held| fits(&held.texture, at, image.size)) {
                    upload(gpu, &held.texture, image, at);
                }
            }
        }
    }

    fn create(&self, gpu: &Gpu, image: &ColorImage, options: TextureOptions) -> Held {
        let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
            label: Some("egui"),
            size: extent(image.size),
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: wgpu::TextureFormat::Rgba8Unorm,
            usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
            view_formats: &[],
        });
        let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
        let sampler = sampler(gpu, options);
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("egui"),
            layout: &self.layout,
            entries: &[
                wgpu::BindGroupEntry { binding: 0, resource: wgpu::BindingResource::TextureView(&view) },
                wgpu::BindGroupEntry { binding: 1, resource: wgpu::BindingResource::Sampler(&sampler) },
            ],
        });
        Held { texture, group }
    }
}

fn extent([width, height]: [usize; 2]) -> wgpu::Extent3d {
    wgpu::Extent3d { width: width as u32, height: height as u32, depth_or_array_layers: 1 }
}

fn fits(texture: &wgpu::Texture, at: [usize; 2], size: [usize; 2]) -> bool {
    let within = |at: usize, size: usize, side: u32| at.checked_add(size).is_some_and(|end| end <= side as usize);
    within(at[0], size[0], texture.width()) && within(at[1], size[1], texture.height())
}

fn upload(gpu: &Gpu, texture: &wgpu::Texture, image: &ColorImage, [x, y]: [usize; 2]) {
    let size = extent(image.size);
    gpu.queue.write_texture(
        wgpu::TexelCopyTextureInfo {
            texture,
            mip_level: 0,
            origin: wgpu::Origin3d { x: x as u32, y: y as u32, z: 0 },
            aspect: wgpu::TextureAspect::All,
        },
        bytemuck::cast_slice(&image.pixels),
        wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(4 * size.width), rows_per_image: None },
        size,
    );
}

fn sampler(gpu: &Gpu, options: TextureOptions) -> wgpu::Sampler {
    let filter = |filter| match filter {
        TextureFilter::Nearest => wgpu::FilterMode::Nearest,
        TextureFilter::Linear => wgpu::FilterMode::Linear,
    };
    let mode = match options.wrap_mode {
        TextureWrapMode::ClampToEdge => wgpu::AddressMode::ClampToEdge,
        TextureWrapMode::Repeat => wgpu::AddressMode::Repeat,
        TextureWrapMode::MirroredRepeat => wgpu::AddressMode::MirrorRepeat,
    };
    gpu.device.create_sampler(&wgpu::SamplerDescriptor {
        label: Some("egui"),
        mag_filter: filter(options.magnification),
        min_filter: filter(options.minification),
        address_mode_u: mode,
        address_mode_v: mode,
        ..Default::default()
    })
}
