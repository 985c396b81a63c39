//! The present pass: the drawn picture, copied to what a window shows.

use super::device::Gpu;
use super::layout::PRESENT_WGSL;
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
    exact: wgpu::RenderPipeline,
    /// Made when a picture first has another size than the window.
    scaled: OnceLock<wgpu::RenderPipeline>,
    bound: Option<Bound>,
}

impl PresentPass {
    /// For targets of a format: bytes are copied as they are, or as the colours that they stand for.
    pub fn new(gpu: &Gpu, format: wgpu::TextureFormat) -> Self {
        let bindings = bindings(gpu);
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
        let exact = pipeline(gpu, &layout, &module, format, "fs_color");
        Self { format, module, bindings, layout, sampler, exact, scaled: OnceLock::new(), bound: None }
    }

    /// Draws the picture over all of a target.
    pub fn draw(&mut self, gpu: &Gpu, pass: &mut wgpu::RenderPass, picture: &wgpu::Texture, size_px: [u32; 2]) {
        if self.bound.as_ref().is_none_or(|bound| bound.texture != *picture) {
            self.bound = Some(self.bind(gpu, picture));
        }
        let Some(bound) = &self.bound else { return };
        let pipeline = if size_px == [picture.width(), picture.height()] {
            &self.exact
        } else {
            self.scaled.get_or_init(|| pipeline(gpu, &self.layout, &self.module, self.format, "fs_scaled"))
        };
        pass.set_pipeline(pipeline);
        pass.set_bind_group(0, &bound.group, &[]);
        pass.draw(0..3, 0..1);
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

fn bindings(gpu: &Gpu) -> wgpu::BindGroupLayout {
    let entry =
        |binding, ty| wgpu::BindGroupLayoutEntry { binding, visibility: wgpu::ShaderStages::FRAGMENT, ty, count: None };
    let texture = wgpu::BindingType::Texture {
        sample_type: wgpu::TextureSampleType::Float { filterable: true },
        view_dimension: wgpu::TextureViewDimension::D2,
        multisampled: false,
    };
    gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("present"),
        entries: &[entry(0, texture), entry(1, wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering))],
    })
}

fn pipeline(
    gpu: &Gpu,
    layout: &wgpu::PipelineLayout,
    module: &wgpu::ShaderModule,
    format: wgpu::TextureFormat,
    entry: &str,
) -> wgpu::RenderPipeline {
    let target = wgpu::ColorTargetState { format, blend: None, write_mask: wgpu::ColorWrites::ALL };
    gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("present"),
        layout: Some(layout),
        vertex: wgpu::VertexState {
            module,
            entry_point: Some("vs_main"),
            compilation_options: Default::default(),
            buffers: &[],
        },
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: None,
        multisample: Default::default(),
        fragment: Some(wgpu::FragmentState {
            module,
            entry_point: Some(entry),
            compilation_options: Default::default(),
            targets: &[Some(target)],
        }),
        multiview_mask: None,
        cache: None,
    })
}
