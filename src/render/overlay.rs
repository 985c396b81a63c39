//! egui's panels over a picture.

use super::device::{Gpu, RenderError};
use egui::epaint::{ImageDelta, Primitive};
use egui_wgpu::ScreenDescriptor;

/// What egui made of a frame.
#[derive(Clone, Debug, Default)]
pub struct Overlay {
    /// Changes of textures since the last overlay; each must be presented once. Presenting takes them out.
    pub textures: egui::TexturesDelta,
    pub primitives: Vec<egui::ClippedPrimitive>,
    /// Pixels that a point of egui takes; above 0.
    pub pixels_per_point: f32,
}

impl Overlay {
    /// The whole texture of the fonts, for a new renderer after a loss: to be put before the first overlay's textures.
    /// Textures that the program loaded itself are not in it. `context` must have run a frame.
    pub fn fonts_of(context: &egui::Context) -> egui::TexturesDelta {
        let image = context.fonts(|fonts| fonts.image());
        let delta = ImageDelta::full(image, egui::TextureOptions::LINEAR);
        let mut textures = egui::TexturesDelta::default();
        textures.push(egui::TextureId::default(), delta);
        textures
    }

    /// Puts a newer overlay in the place of one that may not have been presented: its textures' changes are kept.
    pub fn replace(&mut self, newer: Self) {
        self.textures.append(newer.textures);
        self.primitives = newer.primitives;
        self.pixels_per_point = newer.pixels_per_point;
    }

    fn triangles(&self) -> bool {
        self.primitives.iter().any(|clipped| match &clipped.primitive {
            Primitive::Mesh(mesh) => !mesh.indices.is_empty() && !mesh.vertices.is_empty(),
            Primitive::Callback(_) => false,
        })
    }
}

/// Draws overlays into targets of one format.
pub(super) struct OverlayPass(egui_wgpu::Renderer);

impl std::fmt::Debug for OverlayPass {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("OverlayPass")
    }
}

impl OverlayPass {
    pub fn new(gpu: &Gpu, format: wgpu::TextureFormat) -> Self {
        // Dithering costs every pixel of every panel and shows in none: there are no wide gradients.
        let options = egui_wgpu::RendererOptions { dithering: false, ..Default::default() };
        Self(egui_wgpu::Renderer::new(&gpu.device, format, options))
    }

    /// Takes the new textures over, whether or not this frame will be shown.
    pub fn take_textures(&mut self, gpu: &Gpu, textures: &mut egui::TexturesDelta) {
        for (id, deltas) in textures.set.drain() {
            for delta in deltas {
                // A change of what is not there cannot be drawn: after a loss the whole texture comes first.
                if delta.is_whole() || self.0.texture(&id).is_some() {
                    self.0.update_texture(&gpu.device, &gpu.queue, id, &delta);
                }
            }
        }
    }

    /// Drops the textures that were drawn for the last time.
    pub fn free_textures(&mut self, textures: &mut egui::TexturesDelta) {
        textures.free.drain().for_each(|id| self.0.free_texture(&id));
    }

    /// Uploads the triangles of an overlay; false where there are none to draw.
    pub fn prepare(
        &mut self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        overlay: &Overlay,
        size_px: [u32; 2],
    ) -> Result<bool, RenderError> {
        if !overlay.triangles() {
            return Ok(false);
        }
        let screen = screen(overlay, size_px);
        // Only callbacks give command buffers, and overlays have none.
        gpu.guarded("drawing the panels", || {
            self.0.update_buffers(&gpu.device, &gpu.queue, encoder, &overlay.primitives, &screen)
        })?;
        Ok(true)
    }

    /// Draws what was prepared.
    pub fn draw(&self, pass: &mut wgpu::RenderPass<'static>, overlay: &Overlay, size_px: [u32; 2]) {
        self.0.render(pass, &overlay.primitives, &screen(overlay, size_px));
    }
}

fn screen(overlay: &Overlay, size_in_pixels: [u32; 2]) -> ScreenDescriptor {
    ScreenDescriptor { size_in_pixels, pixels_per_point: overlay.pixels_per_point }
}
