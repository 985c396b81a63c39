//! What the passes share: pipelines with and without the id and depth targets, storage layouts.

use super::device::Gpu;
use super::targets::{DEPTH_FORMAT, ID_FORMAT, METRES_FORMAT};
use std::sync::OnceLock;

/// Names of a pass's entry points in its source.
#[derive(Clone, Copy, Debug)]
pub(super) struct Entries {
    pub vertex: &'static str,
    pub color: &'static str,
    /// For frames with ids and depths.
    pub aov: &'static str,
    /// Colour alone, of what fades.
    pub fading: &'static str,
}

impl Default for Entries {
    fn default() -> Self {
        Self { vertex: "vs_main", color: "fs_color", aov: "fs_aov", fading: "fs_fading" }
    }
}

/// What tells one pass from another.
#[derive(Debug)]
pub(super) struct PassShape {
    pub label: &'static str,
    pub source: &'static str,
    pub vertices: Vec<Option<wgpu::VertexBufferLayout<'static>>>,
    pub entries: Entries,
    /// The sky: behind everything, writes no depth and no ids.
    pub backdrop: bool,
}

/// A pass for frames with colour only, and one for frames with ids and depths, which is made when first needed: a
/// window starts sooner without.
#[derive(Debug)]
pub(super) struct Pipelines {
    shape: PassShape,
    module: wgpu::ShaderModule,
    layout: wgpu::PipelineLayout,
    color: wgpu::RenderPipeline,
    aov: OnceLock<wgpu::RenderPipeline>,
    fading: OnceLock<wgpu::RenderPipeline>,
}

impl Pipelines {
    pub fn new(gpu: &Gpu, shape: PassShape, groups: &[&wgpu::BindGroupLayout]) -> Self {
        let module = gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some(shape.label),
            source: wgpu::ShaderSource::Wgsl(shape.source.into()),
        });
        let groups: Vec<_> = groups.iter().map(|&group| Some(group)).collect();
        let layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some(shape.label),
            bind_group_layouts: &groups,
            immediate_size: 0,
        });
        let color = pipeline(gpu, &shape, &module, &layout, shape.entries.color, false);
        Self { shape, module, layout, color, aov: OnceLock::new(), fading: OnceLock::new() }
    }

    pub fn get(&self, gpu: &Gpu, aov: bool) -> &wgpu::RenderPipeline {
        match aov {
            false => &self.color,
            true => self.aov.get_or_init(|| {
                let entries = &self.shape.entries;
                let entry = if self.shape.backdrop { entries.color } else { entries.aov };
                pipeline(gpu, &self.shape, &self.module, &self.layout, entry, true)
            }),
        }
    }

    /// Colour alone, of what fades.
    pub fn fading(&self, gpu: &Gpu) -> &wgpu::RenderPipeline {
        let entry = self.shape.entries.fading;
        self.fading.get_or_init(|| pipeline(gpu, &self.shape, &self.module, &self.layout, entry, false))
    }
}

fn pipeline(
    gpu: &Gpu,
    shape: &PassShape,
    module: &wgpu::ShaderModule,
    layout: &wgpu::PipelineLayout,
    entry: &str,
    aov: bool,
) -> wgpu::RenderPipeline {
    let target = |format, write_mask| Some(wgpu::ColorTargetState { format, blend: None, write_mask });
    let beside = if shape.backdrop { wgpu::ColorWrites::empty() } else { wgpu::ColorWrites::ALL };
    let mut targets = vec![target(gpu.color_format, wgpu::ColorWrites::ALL)];
    if aov {
        targets.extend([target(ID_FORMAT, beside), target(METRES_FORMAT, beside)]);
    }
    let compare = if shape.backdrop { wgpu::CompareFunction::Equal } else { wgpu::CompareFunction::Greater };
    gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some(shape.label),
        layout: Some(layout),
        vertex: wgpu::VertexState {
            module,
            entry_point: Some(shape.entries.vertex),
            compilation_options: Default::default(),
            buffers: &shape.vertices,
        },
        primitive: wgpu::PrimitiveState {
            cull_mode: (!shape.backdrop).then_some(wgpu::Face::Back),
            ..Default::default()
        },
        depth_stencil: Some(wgpu::DepthStencilState {
            format: DEPTH_FORMAT,
            depth_write_enabled: Some(!shape.backdrop),
            depth_compare: Some(compare),
            stencil: Default::default(),
            bias: Default::default(),
        }),
        multisample: Default::default(),
        fragment: Some(wgpu::FragmentState {
            module,
            entry_point: Some(entry),
            compilation_options: Default::default(),
            targets: &targets,
        }),
        multiview_mask: None,
        cache: None,
    })
}

/// A layout of `count` read-only storage buffers.
pub(super) fn storage_layout(gpu: &Gpu, label: &str, count: u32) -> wgpu::BindGroupLayout {
    let entries: Vec<_> = (0..count)
        .map(|binding| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::VERTEX_FRAGMENT,
            ty: wgpu::BindingType::Buffer {
                ty: wgpu::BufferBindingType::Storage { read_only: true },
                has_dynamic_offset: false,
                min_binding_size: None,
            },
            count: None,
        })
        .collect();
    gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some(label), entries: &entries })
}

/// A layout of a picture for the fragments, and how it is sampled.
pub(super) fn picture_layout(
    gpu: &Gpu,
    label: &str,
    view_dimension: wgpu::TextureViewDimension,
) -> wgpu::BindGroupLayout {
    let entry =
        |binding, ty| wgpu::BindGroupLayoutEntry { binding, visibility: wgpu::ShaderStages::FRAGMENT, ty, count: None };
    let sample_type = wgpu::TextureSampleType::Float { filterable: true };
    let texture = wgpu::BindingType::Texture { sample_type, view_dimension, multisampled: false };
    gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some(label),
        entries: &[entry(0, texture), entry(1, wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering))],
    })
}

/// What tells one pass over a finished picture from another.
#[cfg(feature = "window")]
pub(super) struct FlatShape<'a> {
    pub label: &'a str,
    pub layout: &'a wgpu::PipelineLayout,
    pub module: &'a wgpu::ShaderModule,
    pub vertices: Option<wgpu::VertexBufferLayout<'a>>,
    /// Of the fragments' stage.
    pub entry: &'a str,
    pub format: wgpu::TextureFormat,
    pub blend: Option<wgpu::BlendState>,
}

/// A pipeline without depths, into what a window shows.
#[cfg(feature = "window")]
pub(super) fn flat_pipeline(gpu: &Gpu, shape: &FlatShape) -> wgpu::RenderPipeline {
    let target =
        wgpu::ColorTargetState { format: shape.format, blend: shape.blend, write_mask: wgpu::ColorWrites::ALL };
    gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some(shape.label),
        layout: Some(shape.layout),
        vertex: wgpu::VertexState {
            module: shape.module,
            entry_point: Some("vs_main"),
            compilation_options: Default::default(),
            buffers: if shape.vertices.is_some() { std::slice::from_ref(&shape.vertices) } else { &[] },
        },
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: None,
        multisample: Default::default(),
        fragment: Some(wgpu::FragmentState {
            module: shape.module,
            entry_point: Some(shape.entry),
            compilation_options: Default::default(),
            targets: &[Some(target)],
        }),
        multiview_mask: None,
        cache: None,
    })
}
