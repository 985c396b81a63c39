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

#[cfg(test)]
mod tests {
    use super::super::read_back::read;
    use super::*;
    use egui::{Color32, ColorImage, Pos2, Rect, TextureId, TexturesDelta, Vec2};

    const SIZE_PX: [u32; 2] = [64, 32];
    const POINT_PX: f32 = 2.0;

    /// An egui frame with a red square of 8 points at the left and a picture of 8 points at the right.
    fn frame(context: &egui::Context, texture: TextureId) -> Overlay {
        let all = Rect::from_min_size(Pos2::ZERO, Vec2::new(32.0, 16.0));
        context.begin_pass(egui::RawInput { screen_rect: Some(all), ..Default::default() });
        let painter = context.debug_painter();
        let square = |x| Rect::from_min_size(Pos2::new(x, 4.0), Vec2::splat(8.0));
        painter.rect_filled(square(2.0), 0.0, Color32::RED);
        let whole = Rect::from_min_max(Pos2::ZERO, Pos2::new(1.0, 1.0));
        painter.image(texture, square(20.0), whole, Color32::WHITE);
        let output = context.end_pass();
        let primitives = context.tessellate(output.shapes, POINT_PX);
        Overlay { textures: output.textures_delta, primitives, pixels_per_point: POINT_PX }
    }

    fn drawn(gpu: &Gpu, pass: &mut OverlayPass, overlay: &mut Overlay) -> Vec<u8> {
        let target = gpu.device.create_texture(&wgpu::TextureDescriptor {
            label: None,
            size: wgpu::Extent3d { width: SIZE_PX[0], height: SIZE_PX[1], depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: wgpu::TextureFormat::Bgra8Unorm,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
            view_formats: &[],
        });
        let view = target.create_view(&wgpu::TextureViewDescriptor::default());
        pass.take_textures(gpu, &mut overlay.textures);
        let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let has_panels = pass.prepare(gpu, &mut encoder, overlay, SIZE_PX).unwrap();
        let mut render_pass = encoder
            .begin_render_pass(&wgpu::RenderPassDescriptor {
                color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                    view: &view,
                    depth_slice: None,
                    resolve_target: None,
                    ops: wgpu::Operations::default(),
                })],
                ..Default::default()
            })
            .forget_lifetime();
        if has_panels {
            pass.draw(&mut render_pass, overlay, SIZE_PX);
        }
        drop(render_pass);
        gpu.queue.submit([encoder.finish()]);
        pass.free_textures(&mut overlay.textures);
        read(gpu, &target).unwrap()
    }

    fn pixel(pixels: &[u8], x: u32, y: u32) -> [u8; 3] {
        let at = ((y * SIZE_PX[0] + x) * 4) as usize;
        [pixels[at], pixels[at + 1], pixels[at + 2]]
    }

    fn full(color: Color32) -> ImageDelta {
        ImageDelta::full(ColorImage::filled([4, 4], color), egui::TextureOptions::NEAREST)
    }

    #[test]
    fn panels_lie_where_egui_puts_them_and_textures_of_frames_not_shown_are_kept() {
        let gpu = Gpu::headless().unwrap();
        let mut pass = OverlayPass::new(&gpu, wgpu::TextureFormat::Bgra8Unorm);
        let context = egui::Context::default();
        let texture = TextureId::Managed(77);
        // A frame that nobody draws brings the picture; a second one repaints its lower half; the third is drawn.
        let mut overlay = frame(&context, texture);
        overlay.textures.push(texture, full(Color32::BLUE));
        let mut second = frame(&context, texture);
        let half = ColorImage::filled([4, 2], Color32::GREEN);
        second.textures.push(texture, ImageDelta::partial([0, 2], half, egui::TextureOptions::NEAREST));
        overlay.replace(second);
        pass.take_textures(&gpu, &mut overlay.textures);
        assert!(overlay.textures.set.is_empty());
        overlay.replace(frame(&context, texture));
        let pixels = drawn(&gpu, &mut pass, &mut overlay);
        assert_eq!(pixel(&pixels, 12, 16), [255, 0, 0]);
        assert_eq!((pixel(&pixels, 48, 12), pixel(&pixels, 48, 20)), ([0, 0, 255], [0, 255, 0]));
        assert_eq!((pixel(&pixels, 2, 16), pixel(&pixels, 12, 6)), ([0; 3], [0; 3]));
    }

    #[test]
    fn changes_of_textures_that_are_not_there_do_no_harm_and_fonts_can_be_had_anew() {
        let gpu = Gpu::headless().unwrap();
        let context = egui::Context::default();
        let texture = TextureId::Managed(77);
        frame(&context, texture).textures.clear();
        // A device that comes later has seen nothing of what went before.
        let mut pass = OverlayPass::new(&gpu, wgpu::TextureFormat::Bgra8Unorm);
        let mut overlay = frame(&context, texture);
        let half = ColorImage::filled([4, 2], Color32::GREEN);
        overlay.textures.push(texture, ImageDelta::partial([0, 2], half, egui::TextureOptions::NEAREST));
        let pixels = drawn(&gpu, &mut pass, &mut overlay);
        assert_eq!((pixel(&pixels, 12, 16), pixel(&pixels, 48, 20)), ([0; 3], [0; 3]), "egui's own white is missing");
        let mut overlay = frame(&context, texture);
        let mut textures = Overlay::fonts_of(&context);
        textures.append(std::mem::take(&mut overlay.textures));
        overlay.textures = textures;
        let pixels = drawn(&gpu, &mut pass, &mut overlay);
        assert_eq!(pixel(&pixels, 12, 16), [255, 0, 0]);
    }

    #[test]
    fn an_overlay_without_triangles_draws_nothing() {
        let gpu = Gpu::headless().unwrap();
        let mut pass = OverlayPass::new(&gpu, wgpu::TextureFormat::Bgra8Unorm);
        let mut overlay = Overlay { pixels_per_point: 1.0, textures: TexturesDelta::default(), primitives: Vec::new() };
        assert!(drawn(&gpu, &mut pass, &mut overlay).iter().enumerate().all(|(at, &byte)| at % 4 == 3 || byte == 0));
    }
}
