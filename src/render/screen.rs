//! A window to draw into: its surface, the copy of the picture, and the panels over it.

use super::device::{Gpu, RenderError};
use super::options::GpuLimits;
use super::overlay::{Overlay, OverlayPass};
use super::present::{PresentPass, copy};
use super::renderer::Renderer;
use super::surface::{Skip, WindowSurface};
use std::sync::Arc;
use wgpu::rwh::{HasDisplayHandle, HasWindowHandle};

/// What became of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Presented {
    Shown,
    Skipped(Skip),
}

#[derive(Debug)]
pub(super) struct Screen {
    surface: WindowSurface,
    present: PresentPass,
    overlay: OverlayPass,
}

impl Renderer {
    /// A renderer that can show its pictures in a window of this size in pixels (0 while it is minimized), on the best
    /// adapter that suits the window. Mesh arenas below 256 KiB count as 256 KiB. A window has one renderer at a time:
    /// after a loss drop the old one first.
    pub fn for_window<W>(window: Arc<W>, size_px: [u32; 2], limits: GpuLimits) -> Result<Self, RenderError>
    where
        W: HasWindowHandle + HasDisplayHandle + Send + Sync + 'static,
    {
        let (surface, gpu) = WindowSurface::open(window, size_px)?;
        let (present, overlay) = (PresentPass::new(&gpu, surface.format()), OverlayPass::new(&gpu, surface.format()));
        let mut renderer = Self::over(gpu, limits)?;
        renderer.screen = Some(Screen { surface, present, overlay });
        Ok(renderer)
    }

    /// Leaves the window to another renderer; this one can still draw, and show nothing.
    pub fn leave_window(&mut self) {
        self.screen = None;
    }

    /// The window's new size, pixels; with a side of 0 (minimized) nothing is shown. Takes effect when a picture is
    /// next presented.
    pub fn set_size(&mut self, size_px: [u32; 2]) {
        if let Some(screen) = &mut self.screen {
            screen.surface.set_size(size_px);
        }
    }

    /// The largest side of a texture, pixels: egui must be told.
    pub fn max_texture_side_px(&self) -> u32 {
        self.gpu.device.limits().max_texture_dimension_2d
    }

    /// Shows the last picture that was drawn, stretched where the window has another size, with an overlay; black
    /// before the first one. The overlay's textures are taken out of it even where the frame is skipped. Submits without
    /// waiting, but for the display where that takes one frame after the other.
    pub fn present(&mut self, overlay: &mut Overlay) -> Result<Presented, RenderError> {
        self.gpu.check()?;
        let screen =
            self.screen.as_mut().ok_or_else(|| RenderError::NoSurface("this renderer has no window".into()))?;
        let picture = self.targets.as_ref().map(|targets| targets.color_texture());
        let presented = screen.present(&self.gpu, picture, overlay)?;
        self.gpu.check()?;
        Ok(presented)
    }
}

impl Screen {
    fn present(
        &mut self,
        gpu: &Gpu,
        picture: Option<&wgpu::Texture>,
        overlay: &mut Overlay,
    ) -> Result<Presented, RenderError> {
        self.overlay.take_textures(gpu, &mut overlay.textures);
        let presented = match self.surface.acquire(gpu)? {
            Ok(shown) => {
                self.draw(gpu, picture, overlay, &shown.texture);
                gpu.queue.present(shown);
                Presented::Shown
            }
            Err(skip) => {
                // Textures wait in memory until something is submitted.
                gpu.queue.submit([]);
                Presented::Skipped(skip)
            }
        };
        self.overlay.free_textures(&mut overlay.textures);
        Ok(presented)
    }

    /// The picture is copied, or else drawn in one pass with the panels.
    fn draw(&mut self, gpu: &Gpu, picture: Option<&wgpu::Texture>, overlay: &Overlay, shown: &wgpu::Texture) {
        let size_px = [shown.width(), shown.height()];
        let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let has_panels = self.overlay.prepare(gpu, overlay, size_px);
        let is_copied = picture.is_some_and(|picture| copy(&mut encoder, picture, shown));
        if has_panels || !is_copied {
            let mut pass = begin_pass(&mut encoder, shown, !is_copied);
            if let Some(picture) = picture.filter(|_| !is_copied) {
                self.present.draw(gpu, &mut pass, picture, size_px);
            }
            if has_panels {
                self.overlay.draw(&mut pass);
            }
        }
        gpu.queue.submit([encoder.finish()]);
    }
}

fn begin_pass<'e>(encoder: &'e mut wgpu::CommandEncoder, shown: &wgpu::Texture, clear: bool) -> wgpu::RenderPass<'e> {
    let view = shown.create_view(&wgpu::TextureViewDescriptor::default());
    let load = if clear { wgpu::LoadOp::Clear(wgpu::Color::BLACK) } else { wgpu::LoadOp::Load };
    encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: Some("present"),
        color_attachments: &[Some(wgpu::RenderPassColorAttachment {
            view: &view,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations { load, store: wgpu::StoreOp::Store },
        })],
        ..Default::default()
    })
}
