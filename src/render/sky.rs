//! The sky pass.

use super::device::Gpu;
use super::layout::SKY_WGSL;
use super::pass::{PassShape, Pipelines};

#[derive(Debug)]
pub(super) struct SkyPass {
    pipelines: Pipelines,
}

impl SkyPass {
    pub fn new(gpu: &Gpu, frame: &wgpu::BindGroupLayout) -> Self {
        let shape = PassShape { label: "sky", source: SKY_WGSL, groups: &[frame], vertices: None, backdrop: true };
        Self { pipelines: Pipelines::new(gpu, &shape) }
    }

    /// Draws where nothing else did.
    pub fn draw(&self, pass: &mut wgpu::RenderPass, aov: bool) {
        pass.set_pipeline(self.pipelines.get(aov));
        pass.draw(0..3, 0..1);
    }
}
