//! The sky pass.

use super::device::Gpu;
use super::layout::SKY_WGSL;
use super::pass::{Entries, PassShape, Pipelines};

#[derive(Debug)]
pub(super) struct SkyPass {
    pipelines: Pipelines,
}

impl SkyPass {
    pub fn new(gpu: &Gpu, frame: &wgpu::BindGroupLayout) -> Self {
        let shape = PassShape {
            label: "sky",
            source: SKY_WGSL,
            vertices: Vec::new(),
            entries: Entries::default(),
            backdrop: true,
        };
        Self { pipelines: Pipelines::new(gpu, shape, &[frame]) }
    }

    /// Draws where nothing else did.
    pub fn draw(&self, gpu: &Gpu, pass: &mut wgpu::RenderPass, aov: bool) {
        pass.set_pipeline(self.pipelines.get(gpu, aov));
        pass.draw(0..3, 0..1);
    }
}
