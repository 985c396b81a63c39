//! What a window shows: a surface that follows the window's size and is made anew when it is lost.

use super::device::{Gpu, RenderError, instance_flags};
use std::fmt;
use std::sync::Arc;
use wgpu::rwh::{DisplayHandle, HandleError, HasDisplayHandle};

/// Formats that take sRGB as bytes, best first, and those that encode it themselves: egui blends as in the former.
const FORMATS: [wgpu::TextureFormat; 4] = [
    wgpu::TextureFormat::Bgra8Unorm,
    wgpu::TextureFormat::Rgba8Unorm,
    wgpu::TextureFormat::Bgra8UnormSrgb,
    wgpu::TextureFormat::Rgba8UnormSrgb,
];
/// Frames that may wait to be shown: each one more is a frame between a hand and what it does.
const LATENCY_FRAMES: u32 = 1;

/// Why a frame was not shown; the next one may be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Skip {
    /// The window has no size.
    Minimized,
    /// The window is wholly hidden.
    Occluded,
    /// The display did not take the frame in time.
    Timeout,
    /// The surface no longer fitted the window and was set up again.
    Reconfigured,
    /// The surface was lost and made anew.
    SurfaceLost,
}

/// A window, whatever made it.
#[derive(Clone)]
struct Target(Arc<dyn wgpu::DisplayAndWindowHandle>);

impl fmt::Debug for Target {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Target")
    }
}

impl HasDisplayHandle for Target {
    fn display_handle(&self) -> Result<DisplayHandle<'_>, HandleError> {
        self.0.display_handle()
    }
}

#[derive(Debug)]
pub(super) struct WindowSurface {
    target: Target,
    instance: wgpu::Instance,
    adapter: wgpu::Adapter,
    /// None only while it is made anew, and where that failed.
    surface: Option<wgpu::Surface<'static>>,
    format: wgpu::TextureFormat,
    usage: wgpu::TextureUsages,
    present_mode: wgpu::PresentMode,
    alpha_mode: wgpu::CompositeAlphaMode,
    /// Of the window.
    size_px: [u32; 2],
    /// For which the surface is set up.
    configured_px: Option<[u32; 2]>,
}

impl WindowSurface {
    /// A surface of a window, and a device that can draw into it.
    pub fn open(window: Arc<dyn wgpu::DisplayAndWindowHandle>, size_px: [u32; 2]) -> Result<(Self, Gpu), RenderError> {
        let target = Target(window);
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
            flags: instance_flags(),
            ..wgpu::InstanceDescriptor::new_with_display_handle(Box::new(target.clone()))
        });
        let surface = create(&instance, &target)?;
        let options = wgpu::RequestAdapterOptions {
            power_preference: wgpu::PowerPreference::HighPerformance,
            compatible_surface: Some(&surface),
            ..Default::default()
        };
        let adapter = pollster::block_on(instance.request_adapter(&options))
            .map_err(|cause| RenderError::NoAdapter(cause.to_string()))?;
        let choice = choose(&surface.get_capabilities(&adapter)).ok_or_else(|| RenderError::Surface {
            name: adapter.get_info().name,
            cause: "it offers no format of 8 bits a channel".into(),
        })?;
        let Choice { format, usage, present_mode, alpha_mode } = choice;
        // Pictures have the surface's own order of bytes: then they can be copied without drawing.
        let gpu = Gpu::from_adapter(&adapter, format.add_srgb_suffix())?;
        let mut opened = Self {
            target,
            instance,
            adapter,
            surface: Some(surface),
            format,
            usage,
            present_mode,
            alpha_mode,
            size_px,
            configured_px: None,
        };
        if !opened.is_minimized() {
            opened.configure(&gpu)?;
        }
        Ok((opened, gpu))
    }

    pub fn format(&self) -> wgpu::TextureFormat {
        self.format
    }

    /// The size takes effect with the next frame, so that many changes between two frames cost one.
    pub fn set_size(&mut self, size_px: [u32; 2]) {
        self.size_px = size_px;
    }

    fn is_minimized(&self) -> bool {
        self.size_px.contains(&0)
    }

    /// The texture to draw the next frame into, or why there is none.
    pub fn acquire(&mut self, gpu: &Gpu) -> Result<Result<wgpu::SurfaceTexture, Skip>, RenderError> {
        use wgpu::CurrentSurfaceTexture as Current;
        if self.is_minimized() {
            return Ok(Err(Skip::Minimized));
        }
        if self.surface.is_none() {
            self.reopen(gpu)?;
        }
        if self.configured_px != Some(self.size_px) {
            self.configure(gpu)?;
        }
        let Some(surface) = &self.surface else { return Ok(Err(Skip::SurfaceLost)) };
        Ok(match surface.get_current_texture() {
            // A suboptimal one shows the frame all the same; where the size is the reason, the window tells it.
            Current::Success(texture) | Current::Suboptimal(texture) => Ok(texture),
            Current::Timeout => Err(Skip::Timeout),
            Current::Occluded => Err(Skip::Occluded),
            Current::Outdated => {
                self.configure(gpu)?;
                Err(Skip::Reconfigured)
            }
            Current::Lost => {
                gpu.check()?;
                self.reopen(gpu)?;
                Err(Skip::SurfaceLost)
            }
            Current::Validation => {
                gpu.check()?;
                self.configure(gpu)?;
                Err(Skip::Reconfigured)
            }
        })
    }

    /// A new surface of the same window; the old one must be gone before, as a window has one at a time.
    fn reopen(&mut self, gpu: &Gpu) -> Result<(), RenderError> {
        self.surface = None;
        self.configured_px = None;
        let surface = create(&self.instance, &self.target)?;
        let offered = surface.get_capabilities(&self.adapter);
        if !offered.formats.contains(&self.format) || !offered.present_modes.contains(&self.present_mode) {
            return Err(refused(gpu, "a new surface offers less than the one before"));
        }
        self.surface = Some(surface);
        self.configure(gpu)
    }

    fn configure(&mut self, gpu: &Gpu) -> Result<(), RenderError> {
        let Some(surface) = &self.surface else { return Ok(()) };
        gpu.check()?;
        let limit = gpu.device.limits().max_texture_dimension_2d;
        self.configured_px = None;
        surface.configure(
            &gpu.device,
            &wgpu::SurfaceConfiguration {
                usage: self.usage,
                format: self.format,
                color_space: wgpu::SurfaceColorSpace::Auto,
                width: self.size_px[0].min(limit),
                height: self.size_px[1].min(limit),
                present_mode: self.present_mode,
                desired_maximum_frame_latency: LATENCY_FRAMES,
                alpha_mode: self.alpha_mode,
                view_formats: Vec::new(),
            },
        );
        gpu.check().map_err(|error| match error {
            RenderError::Device(cause) => refused(gpu, &cause),
            other => other,
        })?;
        self.configured_px = Some(self.size_px);
        Ok(())
    }
}

fn create(instance: &wgpu::Instance, target: &Target) -> Result<wgpu::Surface<'static>, RenderError> {
    instance.create_surface(Arc::clone(&target.0)).map_err(|cause| {
        // Without any driver no surface can be had either.
        let adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::all()));
        let cause = cause.to_string();
        if adapters.is_empty() { RenderError::NoAdapter(cause) } else { RenderError::NoSurface(cause) }
    })
}

fn refused(gpu: &Gpu, cause: &str) -> RenderError {
    RenderError::Surface { name: gpu.adapter_name.clone(), cause: cause.to_string() }
}

#[derive(Debug, PartialEq)]
struct Choice {
    format: wgpu::TextureFormat,
    usage: wgpu::TextureUsages,
    present_mode: wgpu::PresentMode,
    alpha_mode: wgpu::CompositeAlphaMode,
}

/// The best of what an adapter offers for a surface.
fn choose(offered: &wgpu::SurfaceCapabilities) -> Option<Choice> {
    let format = FORMATS.into_iter().find(|format| offered.formats.contains(format))?;
    // Both are without tearing; Mailbox never makes a frame wait for the one before. Fifo is there everywhere.
    let present_mode = [wgpu::PresentMode::Mailbox, wgpu::PresentMode::Fifo]
        .into_iter()
        .find(|mode| offered.present_modes.contains(mode))?;
    let opaque = wgpu::CompositeAlphaMode::Opaque;
    let alpha_mode = if offered.alpha_modes.contains(&opaque) { opaque } else { wgpu::CompositeAlphaMode::Auto };
    let usage = wgpu::TextureUsages::RENDER_ATTACHMENT | (offered.usages & wgpu::TextureUsages::COPY_DST);
    Some(Choice { format, usage, present_mode, alpha_mode })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn offer(formats: &[wgpu::TextureFormat], modes: &[wgpu::PresentMode]) -> wgpu::SurfaceCapabilities {
        wgpu::SurfaceCapabilities { formats: formats.to_vec(), present_modes: modes.to_vec(), ..Default::default() }
    }

    #[test]
    fn a_surface_without_tearing_and_with_bytes_as_they_are_is_chosen() {
        use wgpu::PresentMode::{Fifo, Immediate, Mailbox};
        use wgpu::TextureFormat::{Bgra8Unorm, Bgra8UnormSrgb, Rgb10a2Unorm, Rgba8UnormSrgb};
        let chosen = |formats: &[_], modes: &[_]| choose(&offer(formats, modes)).map(|c| (c.format, c.present_mode));
        assert_eq!(chosen(&[Bgra8UnormSrgb, Bgra8Unorm], &[Immediate, Fifo, Mailbox]), Some((Bgra8Unorm, Mailbox)));
        assert_eq!(chosen(&[Rgb10a2Unorm, Rgba8UnormSrgb], &[Immediate, Fifo]), Some((Rgba8UnormSrgb, Fifo)));
        assert_eq!(chosen(&[Rgb10a2Unorm], &[Fifo]), None);
        assert_eq!(chosen(&[], &[]), None, "an adapter that does not suit the window");
    }
}
