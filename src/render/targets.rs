//! What is drawn into, and reading it back.

use super::device::{Gpu, RenderError};
use std::sync::mpsc;

pub(super) const COLOR_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8UnormSrgb;
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
        Ok(Self {
            size_px,
            color: target(gpu, size_px, COLOR_FORMAT, read),
            depth: target(gpu, size_px, DEPTH_FORMAT, wgpu::TextureUsages::empty()),
            aov: aov.then(|| [target(gpu, size_px, ID_FORMAT, read), target(gpu, size_px, METRES_FORMAT, read)]),
        })
    }

    pub fn has_aov(&self) -> bool {
        self.aov.is_some()
    }

    /// Begins a pass over all targets; with `clear` they are emptied first: sky everywhere.
    pub fn begin_pass<'e>(&self, encoder: &'e mut wgpu::CommandEncoder, clear: bool) -> wgpu::RenderPass<'e> {
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
            ..Default::default()
        })
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
    let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some("target"),
        size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: usage | wgpu::TextureUsages::RENDER_ATTACHMENT,
        view_formats: &[],
    });
    let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
    Target { texture, view }
}

fn words(bytes: &[u8]) -> impl Iterator<Item = [u8; 4]> {
    bytes.as_chunks::<4>().0.iter().copied()
}

/// All pixels of a texture of 4 bytes a pixel, rows from the top, without padding.
fn read(gpu: &Gpu, texture: &wgpu::Texture) -> Result<Vec<u8>, RenderError> {
    let row = texture.width() as usize * 4;
    let padded = row.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT as usize);
    let buffer = gpu.buffer("read-back", wgpu::BufferUsages::MAP_READ, (padded * texture.height() as usize) as u64);
    let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(padded as u32), rows_per_image: None };
    encoder.copy_texture_to_buffer(
        texture.as_image_copy(),
        wgpu::TexelCopyBufferInfo { buffer: &buffer, layout },
        texture.size(),
    );
    gpu.queue.submit([encoder.finish()]);
    let (sender, receiver) = mpsc::sync_channel(1);
    buffer.map_async(wgpu::MapMode::Read, .., move |result| {
        // The receiver lives until this function ends.
        let _ = sender.send(result);
    });
    gpu.wait()?;
    let failed = |cause: String| RenderError::Device(format!("reading a picture back: {cause}"));
    match receiver.try_recv() {
        Ok(Ok(())) => {}
        Ok(Err(cause)) => return Err(failed(cause.to_string())),
        Err(cause) => return Err(failed(cause.to_string())),
    }
    let mapped = buffer.get_mapped_range(..).map_err(|cause| failed(cause.to_string()))?;
    Ok(mapped.chunks(padded).flat_map(|line| &line[..row]).copied().collect())
}
