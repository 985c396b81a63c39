//! The present pass: the drawn picture, copied to what a window shows.

use super::device::Gpu;
use super::layout::PRESENT_WGSL;
use super::pass::{FlatShape, flat_pipeline, picture_layout};
use std::sync::OnceLock;

/// A picture that can be copied.
#[derive(Debug)]
struct Bound {
    texture: wgpu::Texture,
    group: wgpu::BindGroup,
}

#[derive(Debug)]
pub(super) struct PresentPass {
    format: wgpu::TextureFormat,
    module: wgpu::ShaderModule,
    bindings: wgpu::BindGroupLayout,
    layout: wgpu::PipelineLayout,
    sampler: wgpu::Sampler,
    /// Pixel by pixel, and stretched; made when first needed.
    exact: OnceLock<wgpu::RenderPipeline>,
    scaled: OnceLock<wgpu::RenderPipeline>,
    bound: Option<Bound>,
}

/// Copies a picture without drawing where a target takes it as it is: of the same size and order of bytes. On a software
/// driver drawing costs twenty times as much. False where it has to be drawn.
pub(super) fn copy(encoder: &mut wgpu::CommandEncoder, picture: &wgpu::Texture, shown: &wgpu::Texture) -> bool {
    let alike = picture.size() == shown.size()
        && picture.format().remove_srgb_suffix() == shown.format().remove_srgb_suffix()
        && shown.usage().contains(wgpu::TextureUsages::COPY_DST);
    if alike {
        encoder.copy_texture_to_texture(picture.as_image_copy(), shown.as_image_copy(), shown.size());
    }
    alike
}

impl PresentPass {
    /// For targets of a format: bytes are copied as they are, or as the colours that they stand for.
    pub fn new(gpu: &Gpu, format: wgpu::TextureFormat) -> Self {
        let bindings = picture_layout(gpu, "present", wgpu::TextureViewDimension::D2);
        let module = gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("present"),
            source: wgpu::ShaderSource::Wgsl(PRESENT_WGSL.into()),
        });
        let layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("present"),
            bind_group_layouts: &[Some(&bindings)],
            immediate_size: 0,
        });
        let sampler = gpu.device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("present"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            ..Default::default()
        });
        let (exact, scaled) = (OnceLock::new(), OnceLock::new());
        Self { format, module, bindings, layout, sampler, exact, scaled, bound: None }
    }

    /// Draws the picture over all of a target.
    pub fn draw(&mut self, gpu: &Gpu, pass: &mut wgpu::RenderPass, picture: &wgpu::Texture, size_px: [u32; 2]) {
        if self.bound.as_ref().is_none_or(|bound| bound.texture != *picture) {
            self.bound = Some(self.bind(gpu, picture));
        }
        let Some(bound) = &self.bound else { return };
        let is_exact = size_px == [picture.width(), picture.height()];
        let (slot, entry) = if is_exact { (&self.exact, "fs_color") } else { (&self.scaled, "fs_scaled") };
        pass.set_pipeline(slot.get_or_init(|| self.pipeline(gpu, entry)));
        pass.set_bind_group(0, &bound.group, &[]);
        pass.draw(0..3, 0..1);
    }

    fn pipeline(&self, gpu: &Gpu, entry: &str) -> wgpu::RenderPipeline {
        let shape = FlatShape {
            label: "present",
            layout: &self.layout,
            module: &self.module,
            vertices: None,
            entry,
            format: self.format,
            blend: None,
        };
        flat_pipeline(gpu, &shape)
    }

    fn bind(&self, gpu: &Gpu, picture: &wgpu::Texture) -> Bound {
        let picture_format = picture.format();
        let format = if self.format.is_srgb() { picture_format } else { picture_format.remove_srgb_suffix() };
        let view = picture.create_view(&wgpu::TextureViewDescriptor {
            label: Some("present"),
            format: Some(format),
            usage: Some(wgpu::TextureUsages::TEXTURE_BINDING),
            ..Default::default()
        });
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("present"),
            layout: &self.bindings,
            entries: &[
                wgpu::BindGroupEntry { binding: 0, resource: wgpu::BindingResource::TextureView(&view) },
                wgpu::BindGroupEntry { binding: 1, resource: wgpu::BindingResource::Sampler(&self.sampler) },
            ],
        });
        Bound { texture: picture.clone(), group }
    }
}

#[cfg(test)]
mod tests {
    use super::super::read_back::read;
    use super::*;
    use wgpu::TextureFormat::{Bgra8Unorm, Bgra8UnormSrgb, Rgba8Unorm, Rgba8UnormSrgb};
    use wgpu::TextureUsages as Usages;

    const SIDES_PX: [u32; 2] = [48, 20];

    fn texture(gpu: &Gpu, [width, height]: [u32; 2], format: wgpu::TextureFormat, usage: Usages) -> wgpu::Texture {
        gpu.device.create_texture(&wgpu::TextureDescriptor {
            label: None,
            size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: usage | Usages::COPY_SRC,
            view_formats: &[format.remove_srgb_suffix()],
        })
    }

    /// A picture with all bytes in it, and what reading it gives.
    fn picture(gpu: &Gpu, format: wgpu::TextureFormat) -> (wgpu::Texture, Vec<u8>) {
        let [width, height] = SIDES_PX;
        let picture = texture(gpu, SIDES_PX, format, Usages::TEXTURE_BINDING | Usages::COPY_DST);
        let bytes: Vec<u8> = (0..width * height * 4).map(|i| (i * 7 % 256) as u8).collect();
        let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(4 * width), rows_per_image: None };
        gpu.queue.write_texture(picture.as_image_copy(), &bytes, layout, picture.size());
        let read = read(gpu, &picture).unwrap();
        (picture, read)
    }

    fn drawn(gpu: &Gpu, picture: &wgpu::Texture, format: wgpu::TextureFormat, size_px: [u32; 2]) -> Vec<u8> {
        let target = texture(gpu, size_px, format, Usages::RENDER_ATTACHMENT);
        let view = target.create_view(&wgpu::TextureViewDescriptor::default());
        let mut present = PresentPass::new(gpu, format);
        let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &view,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations::default(),
            })],
            ..Default::default()
        });
        present.draw(gpu, &mut pass, picture, size_px);
        drop(pass);
        gpu.queue.submit([encoder.finish()]);
        read(gpu, &target).unwrap()
    }

    #[test]
    fn a_picture_is_drawn_with_the_bytes_that_it_has() {
        let gpu = Gpu::headless().unwrap();
        let (picture, bytes) = picture(&gpu, Rgba8UnormSrgb);
        assert_eq!(bytes[..8], [0, 7, 14, 21, 28, 35, 42, 49]);
        for format in [Bgra8Unorm, Rgba8Unorm, Bgra8UnormSrgb, Rgba8UnormSrgb] {
            let same = drawn(&gpu, &picture, format, SIDES_PX);
            assert!(same == bytes, "{format:?}");
        }
    }

    #[test]
    fn a_picture_of_another_size_is_stretched() {
        let gpu = Gpu::headless().unwrap();
        let (picture, bytes) = picture(&gpu, Bgra8UnormSrgb);
        let [width, height] = SIDES_PX;
        // Of three pixels for one the middle one lies over its middle.
        let wide = drawn(&gpu, &picture, Bgra8Unorm, [3 * width, 3 * height]);
        for (x, y) in [(0, 0), (5, 7), (width - 1, height - 1)] {
            let (at, middle) = (((y * width + x) * 4) as usize, (((3 * y + 1) * 3 * width + 3 * x + 1) * 4) as usize);
            for channel in 0..4 {
                assert!(wide[middle + channel].abs_diff(bytes[at + channel]) <= 2, "{x} {y} {channel}");
            }
        }
    }

    #[test]
    fn what_is_alike_is_copied_without_drawing() {
        let gpu = Gpu::headless().unwrap();
        let (picture, bytes) = picture(&gpu, Bgra8UnormSrgb);
        let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let mut taken = |size_px, format, usage| {
            let target = texture(&gpu, size_px, format, usage);
            copy(&mut encoder, &picture, &target).then_some(target)
        };
        let target = taken(SIDES_PX, Bgra8Unorm, Usages::COPY_DST).unwrap();
        assert!(taken(SIDES_PX, Rgba8Unorm, Usages::COPY_DST).is_none());
        assert!(taken([SIDES_PX[0], 1], Bgra8Unorm, Usages::COPY_DST).is_none());
        assert!(taken(SIDES_PX, Bgra8Unorm, Usages::RENDER_ATTACHMENT).is_none());
        gpu.queue.submit([encoder.finish()]);
        assert!(read(&gpu, &target).unwrap() == bytes);
    }
}
