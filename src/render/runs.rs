//! Runs of indices, those of a page in one draw call where the adapter can.

use super::device::Gpu;
use std::ops::Range;
use wgpu::util::DrawIndexedIndirectArgs;

/// The calls of a frame, one for each run; a page's instance is its number among the frame's pages.
#[derive(Debug)]
pub(super) struct RunCalls {
    /// `None` where the adapter cannot number instances in what it is told indirectly.
    buffer: Option<wgpu::Buffer>,
}

impl RunCalls {
    const BYTES_FIRST: u64 = 16 << 10;

    pub fn new(gpu: &Gpu) -> Self {
        Self { buffer: gpu.numbers_indirectly.then(|| Self::allocate(gpu, Self::BYTES_FIRST)) }
    }

    fn allocate(gpu: &Gpu, size: u64) -> wgpu::Buffer {
        gpu.buffer("runs", wgpu::BufferUsages::INDIRECT, size)
    }

    /// `pages`: the runs of each page of the frame.
    pub fn write<'r>(&mut self, gpu: &Gpu, pages: impl Iterator<Item = &'r [Range<u32>]>) {
        let Some(buffer) = &mut self.buffer else { return };
        let mut bytes = Vec::new();
        for (first_instance, runs) in (0..).zip(pages) {
            for run in runs {
                let (index_count, first_index) = (run.end - run.start, run.start);
                let call = DrawIndexedIndirectArgs {
                    index_count,
                    instance_count: 1,
                    first_index,
                    base_vertex: 0,
                    first_instance,
                };
                bytes.extend_from_slice(call.as_bytes());
            }
        }
        let size = bytes.len() as u64;
        if size > buffer.size() {
            *buffer = Self::allocate(gpu, size.next_power_of_two());
        }
        gpu.queue.write_buffer(buffer, 0, &bytes);
    }

    /// Draws the runs of one page, before which `before` runs of others were written; gives the number of draw calls.
    pub fn draw(&self, pass: &mut wgpu::RenderPass, runs: &[Range<u32>], instance: u32, before: usize) -> u32 {
        match &self.buffer {
            Some(buffer) if runs.len() > 1 => {
                let offset = (before * size_of::<DrawIndexedIndirectArgs>()) as u64;
                pass.multi_draw_indexed_indirect(buffer, offset, runs.len() as u32);
                1
            }
            _ => {
                runs.iter().for_each(|run| pass.draw_indexed(run.clone(), 0, instance..instance + 1));
                runs.len() as u32
            }
        }
    }
}
