//! Pictures from the GPU, at once or when they are there.

use super::device::{Gpu, RenderError};
use std::sync::{Arc, OnceLock};

/// A picture of 4 bytes a pixel on its way from the GPU.
#[derive(Debug)]
pub(super) struct ReadBack {
    pub size_px: [u32; 2],
    buffer: wgpu::Buffer,
    padded_row_bytes: usize,
    /// Whether blue comes first.
    is_bgra: bool,
    mapped: Arc<OnceLock<Result<(), String>>>,
}

impl ReadBack {
    /// Copies a texture as it will be after all that was submitted.
    pub fn begin(gpu: &Gpu, texture: &wgpu::Texture) -> Self {
        let size_px = [texture.width(), texture.height()];
        let padded = (size_px[0] * 4).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let bytes = u64::from(padded) * u64::from(size_px[1]);
        let buffer = gpu.buffer("read-back", wgpu::BufferUsages::MAP_READ, bytes);
        let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(padded), rows_per_image: None };
        encoder.copy_texture_to_buffer(
            texture.as_image_copy(),
            wgpu::TexelCopyBufferInfo { buffer: &buffer, layout },
            texture.size(),
        );
        gpu.queue.submit([encoder.finish()]);
        let mapped = map_for_reading(&buffer);
        let is_bgra = texture.format().remove_srgb_suffix() == wgpu::TextureFormat::Bgra8Unorm;
        Self { size_px, buffer, padded_row_bytes: padded as usize, is_bgra, mapped }
    }

    /// The rows from the top, without padding, red before blue; `None` while they are on their way.
    pub fn take(&self) -> Option<Result<Vec<u8>, RenderError>> {
        let mapped = self.mapped.get()?.clone();
        Some(mapped.and_then(|()| self.rows()).map_err(|cause| RenderError::Device(format!("reading back: {cause}"))))
    }

    fn rows(&self) -> Result<Vec<u8>, String> {
        let mapped = self.buffer.get_mapped_range(..).map_err(|cause| cause.to_string())?;
        let row_bytes = self.size_px[0] as usize * 4;
        let mut pixels = Vec::with_capacity(row_bytes * self.size_px[1] as usize);
        mapped.chunks(self.padded_row_bytes).for_each(|line| pixels.extend_from_slice(&line[..row_bytes]));
        if self.is_bgra {
            pixels.as_chunks_mut::<4>().0.iter_mut().for_each(|pixel| pixel.swap(0, 2));
        }
        Ok(pixels)
    }
}

/// Asks for a buffer to be mapped; the answer comes with a later submission or poll.
pub(super) fn map_for_reading(buffer: &wgpu::Buffer) -> Arc<OnceLock<Result<(), String>>> {
    let answer = Arc::new(OnceLock::new());
    let sink = Arc::clone(&answer);
    buffer.map_async(wgpu::MapMode::Read, .., move |result| {
        // There is one answer only.
        let _ = sink.set(result.map_err(|cause| cause.to_string()));
    });
    answer
}

/// All pixels of a texture of 4 bytes a pixel, rows from the top, without padding; waits for them.
pub(super) fn read(gpu: &Gpu, texture: &wgpu::Texture) -> Result<Vec<u8>, RenderError> {
    gpu.check()?;
    let picture = ReadBack::begin(gpu, texture);
    gpu.wait()?;
    picture.take().unwrap_or_else(|| Err(RenderError::Device("a picture was waited for and did not come".into())))
}
