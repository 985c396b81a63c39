//! What is drawn into, and reading it back.

use super::device::{Gpu, RenderError};
use super::read_back::{ReadBack, read};

pub(super) const ID_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::R32Uint;
pub(super) const METRES_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::R32Float;
pub(super) const DEPTH_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

#[derive(Debug)]
struct Target {
    texture: wgpu::Texture,
    view: wgpu::TextureView,
}

/// The pictures of one size. All have 4 bytes a pixel.
#[derive(Debug)]
pub(super) struct Targets {
    pub size_px: [u32; 2],
    color: Target,
    depth: Target,
    /// Ids and linear depths.
    aov: Option<[Target; 2]>,
}

impl Targets {
    pub fn new(gpu: &Gpu, size_px: [u32; 2], aov: bool) -> Result<Self, RenderError> {
        let limit = gpu.device.limits().max_texture_dimension_2d;
        if size_px.iter().any(|side| !(1..=limit).contains(side)) {
            return Err(RenderError::Size(size_px[0], size_px[1], limit));
        }
        let read = wgpu::TextureUsages::COPY_SRC;
        let shown = read | wgpu::TextureUsages::TEXTURE_BINDING;
        Ok(Self {
            size_px,
            color: target(gpu, size_px, gpu.color_format, shown),
            depth: target(gpu, size_px, DEPTH_FORMAT, wgpu::TextureUsages::empty()),
            aov: aov.then(|| [target(gpu, size_px, ID_FORMAT, read), target(gpu, size_px, METRES_FORMAT, read)]),
        })
    }

    pub fn has_aov(&self) -> bool {
        self.aov.is_some()
    }

    /// Begins a pass over all targets; with `clear` they are emptied first: sky everywhere.
    pub fn begin_pass<'e>(
        &self,
        encoder: &'e mut wgpu::CommandEncoder,
        clear: bool,
        timestamps: Option<wgpu::RenderPassTimestampWrites<'_>>,
    ) -> wgpu::RenderPass<'e> {
        let color = attachment(&self.color.view, clear, wgpu::Color::BLACK);
        let depth = wgpu::RenderPassDepthStencilAttachment {
            view: &self.depth.view,
            depth_ops: Some(wgpu::Operations { load: load(clear, 0.0), store: wgpu::StoreOp::Store }),
            stencil_ops: None,
        };
        let far = wgpu::Color { r: f64::INFINITY, ..wgpu::Color::BLACK };
        let attachments = match &self.aov {
            None => vec![color],
            Some([ids, metres]) => {
                let none = wgpu::Color::TRANSPARENT;
                vec![color, attachment(&ids.view, clear, none), attachment(&metres.view, clear, far)]
            }
        };
        encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("frame"),
            color_attachments: &attachments,
            depth_stencil_attachment: Some(depth),
            timestamp_writes: timestamps,
            ..Default::default()
        })
    }

    /// The colours, for a copy; they may be viewed as plain bytes too.
    #[cfg(feature = "window")]
    pub fn color_texture(&self) -> &wgpu::Texture {
        &self.color.texture
    }

    /// Starts to read the colours without waiting for them.
    pub fn begin_read_color(&self, gpu: &Gpu) -> ReadBack {
        ReadBack::begin(gpu, &self.color.texture)
    }

    pub fn read_color(&self, gpu: &Gpu) -> Result<Vec<u8>, RenderError> {
        read(gpu, &self.color.texture)
    }

    pub fn read_ids(&self, gpu: &Gpu) -> Result<Vec<u32>, RenderError> {
        let [ids, _] = self.aov.as_ref().ok_or(RenderError::NotDrawn { what: "the id picture" })?;
        Ok(words(&read(gpu, &ids.texture)?).map(u32::from_le_bytes).collect())
    }

    pub fn read_depth_m(&self, gpu: &Gpu) -> Result<Vec<f32>, RenderError> {
        let [_, metres] = self.aov.as_ref().ok_or(RenderError::NotDrawn { what: "the depth picture" })?;
        Ok(words(&read(gpu, &metres.texture)?).map(f32::from_le_bytes).collect())
    }
}

fn load<V>(clear: bool, value: V) -> wgpu::LoadOp<V> {
    if clear { wgpu::LoadOp::Clear(value) } else { wgpu::LoadOp::Load }
}

fn attachment(
    view: &wgpu::TextureView,
    clear: bool,
    color: wgpu::Color,
) -> Option<wgpu::RenderPassColorAttachment<'_>> {
    Some(wgpu::RenderPassColorAttachment {
        view,
        depth_slice: None,
        resolve_target: None,
        ops: wgpu::Operations { load: load(clear, color), store: wgpu::StoreOp::Store },
    })
}

fn target(gpu: &Gpu, [width, height]: [u32; 2], format: wgpu::TextureFormat, usage: wgpu::TextureUsages) -> Target {
    let bytes = [format.remove_srgb_suffix()];
    let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some("target"),
        size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: usage | wgpu::TextureUsages::RENDER_ATTACHMENT,
        // Viewed as plain bytes, colours are copied exactly.
        view_formats: if format.is_srgb() { &bytes } else { &[] },
    });
    let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
    Target { texture, view }
}

fn words(bytes: &[u8]) -> impl Iterator<Item = [u8; 4]> {
    bytes.as_chunks::<4>().0.iter().copied()
}
