//! egui's panels over a picture.

use super::device::Gpu;
use super::layout::OVERLAY_WGSL;
use super::overlay_textures::OverlayTextures;
use super::pass::{FlatShape, flat_pipeline};
use egui::epaint::{ImageDelta, Primitive, Vertex};
use std::ops::Range;

/// What egui made of a frame.
#[derive(Clone, Debug, Default)]
pub struct Overlay {
    /// Changes of textures since the last overlay; each must be presented once. Presenting takes them out.
    pub textures: egui::TexturesDelta,
    /// Meshes; callbacks are not drawn.
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
}

/// A mesh that is ready to be drawn.
#[derive(Debug)]
struct Draw {
    texture: egui::TextureId,
    /// Left, top, width, height, pixels.
    clip_px: [u32; 4],
    indices: Range<u32>,
    base_vertex: i32,
}

/// `Vertex` of epaint: position, texture coordinates, colour.
const ATTRIBUTES: [wgpu::VertexAttribute; 3] = wgpu::vertex_attr_array![0 => Float32x2, 1 => Float32x2, 2 => Unorm8x4];
/// Room for the first panels; buffers grow with them, bytes.
const BUFFER_MIN_BYTES: u64 = 64 << 10;

/// Draws overlays into targets of one format.
#[derive(Debug)]
pub(super) struct OverlayPass {
    pipeline: wgpu::RenderPipeline,
    scale: wgpu::Buffer,
    scale_group: wgpu::BindGroup,
    vertices: wgpu::Buffer,
    indices: wgpu::Buffer,
    textures: OverlayTextures,
    draws: Vec<Draw>,
}

impl OverlayPass {
    pub fn new(gpu: &Gpu, format: wgpu::TextureFormat) -> Self {
        let scale_layout = scale_layout(gpu);
        let textures = OverlayTextures::new(gpu);
        let pipeline = pipeline(gpu, format, [&scale_layout, &textures.layout]);
        let scale = gpu.buffer("overlay scale", wgpu::BufferUsages::UNIFORM, size_of::<[f32; 4]>() as u64);
        let scale_group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("overlay scale"),
            layout: &scale_layout,
            entries: &[wgpu::BindGroupEntry { binding: 0, resource: scale.as_entire_binding() }],
        });
        let buffer = |usage| gpu.buffer("overlay", usage, BUFFER_MIN_BYTES);
        let (vertices, indices) = (buffer(wgpu::BufferUsages::VERTEX), buffer(wgpu::BufferUsages::INDEX));
        Self { pipeline, scale, scale_group, vertices, indices, textures, draws: Vec::new() }
    }

    /// Takes the new textures over, whether or not this frame will be shown.
    pub fn take_textures(&mut self, gpu: &Gpu, textures: &mut egui::TexturesDelta) {
        for (id, deltas) in textures.set.drain() {
            deltas.iter().for_each(|delta| self.textures.update(gpu, id, delta));
        }
    }

    /// Drops the textures that were drawn for the last time.
    pub fn free_textures(&mut self, textures: &mut egui::TexturesDelta) {
        textures.free.drain().for_each(|id| self.textures.free(id));
    }

    /// Uploads the triangles of an overlay; false where there are none to draw.
    pub fn prepare(&mut self, gpu: &Gpu, overlay: &Overlay, size_px: [u32; 2]) -> bool {
        let (mut vertices, mut indices): (Vec<Vertex>, Vec<u32>) = (Vec::new(), Vec::new());
        self.draws.clear();
        for clipped in &overlay.primitives {
            let Primitive::Mesh(mesh) = &clipped.primitive else { continue };
            let clip_px = clip_px(clipped.clip_rect, overlay.pixels_per_point, size_px);
            if mesh.indices.is_empty() || clip_px[2] == 0 || clip_px[3] == 0 {
                continue;
            }
            let (first, base_vertex) = (indices.len() as u32, vertices.len() as i32);
            vertices.extend_from_slice(&mesh.vertices);
            indices.extend_from_slice(&mesh.indices);
            let range = first..indices.len() as u32;
            self.draws.push(Draw { texture: mesh.texture_id, clip_px, indices: range, base_vertex });
        }
        if self.draws.is_empty() {
            return false;
        }
        write(gpu, &mut self.vertices, bytemuck::cast_slice(&vertices));
        write(gpu, &mut self.indices, bytemuck::cast_slice(&indices));
        let [x, y] = size_px.map(|side| 2.0 * overlay.pixels_per_point / side as f32);
        gpu.queue.write_buffer(&self.scale, 0, bytemuck::cast_slice(&[x, -y, 0.0, 0.0]));
        true
    }

    /// Draws what was prepared.
    pub fn draw(&self, pass: &mut wgpu::RenderPass) {
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &self.scale_group, &[]);
        pass.set_vertex_buffer(0, self.vertices.slice(..));
        pass.set_index_buffer(self.indices.slice(..), wgpu::IndexFormat::Uint32);
        for draw in &self.draws {
            let Some(texture) = self.textures.group(draw.texture) else { continue };
            let [left, top, width, height] = draw.clip_px;
            pass.set_scissor_rect(left, top, width, height);
            pass.set_bind_group(1, texture, &[]);
            pass.draw_indexed(draw.indices.clone(), draw.base_vertex, 0..1);
        }
    }
}

/// The pixels inside a rectangle in points, as far as they are in the target.
fn clip_px(clip: egui::Rect, pixels_per_point: f32, [width, height]: [u32; 2]) -> [u32; 4] {
    // What is no number, or below 0, becomes 0.
    let pixel = |points: f32, limit: u32| ((points * pixels_per_point).round() as u32).min(limit);
    let (left, top) = (pixel(clip.min.x, width), pixel(clip.min.y, height));
    let (right, bottom) = (pixel(clip.max.x, width), pixel(clip.max.y, height));
    [left, top, right.saturating_sub(left), bottom.saturating_sub(top)]
}

/// Writes a buffer, a larger one where it is too small.
fn write(gpu: &Gpu, buffer: &mut wgpu::Buffer, bytes: &[u8]) {
    if bytes.len() as u64 > buffer.size() {
        *buffer = gpu.buffer("overlay", buffer.usage(), (bytes.len() as u64).next_power_of_two());
    }
    gpu.queue.write_buffer(buffer, 0, bytes);
}

fn scale_layout(gpu: &Gpu) -> wgpu::BindGroupLayout {
    gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("overlay scale"),
        entries: &[wgpu::BindGroupLayoutEntry {
            binding: 0,
            visibility: wgpu::ShaderStages::VERTEX,
            ty: wgpu::BindingType::Buffer {
                ty: wgpu::BufferBindingType::Uniform,
                has_dynamic_offset: false,
                min_binding_size: None,
            },
            count: None,
        }],
    })
}

fn pipeline(gpu: &Gpu, format: wgpu::TextureFormat, groups: [&wgpu::BindGroupLayout; 2]) -> wgpu::RenderPipeline {
    let module = gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some("overlay"),
        source: wgpu::ShaderSource::Wgsl(OVERLAY_WGSL.into()),
    });
    let layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some("overlay"),
        bind_group_layouts: &groups.map(Some),
        immediate_size: 0,
    });
    let vertices = wgpu::VertexBufferLayout {
        array_stride: size_of::<Vertex>() as u64,
        step_mode: wgpu::VertexStepMode::Vertex,
        attributes: &ATTRIBUTES,
    };
    flat_pipeline(
        gpu,
        &FlatShape {
            label: "overlay",
            layout: &layout,
            module: &module,
            vertices: Some(vertices),
            entry: if format.is_srgb() { "fs_linear" } else { "fs_color" },
            format,
            blend: Some(wgpu::BlendState::PREMULTIPLIED_ALPHA_BLENDING),
        },
    )
}

#[cfg(test)]
mod tests {
    use super::super::read_back::read;
    use super::*;
    use egui::{Color32, ColorImage, Pos2, Rect, TextureId, TexturesDelta, Vec2};

    const SIZE_PX: [u32; 2] = [64, 32];
    const POINT_PX: f32 = 2.0;
    const BYTES: wgpu::TextureFormat = wgpu::TextureFormat::Bgra8Unorm;

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

    fn drawn(gpu: &Gpu, pass: &mut OverlayPass, overlay: &mut Overlay, format: wgpu::TextureFormat) -> Vec<u8> {
        let target = gpu.device.create_texture(&wgpu::TextureDescriptor {
            label: None,
            size: wgpu::Extent3d { width: SIZE_PX[0], height: SIZE_PX[1], depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
            view_formats: &[],
        });
        let view = target.create_view(&wgpu::TextureViewDescriptor::default());
        pass.take_textures(gpu, &mut overlay.textures);
        let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let has_panels = pass.prepare(gpu, overlay, SIZE_PX);
        let mut render_pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &view,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations::default(),
            })],
            ..Default::default()
        });
        if has_panels {
            pass.draw(&mut render_pass);
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
        let mut pass = OverlayPass::new(&gpu, BYTES);
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
        let pixels = drawn(&gpu, &mut pass, &mut overlay, BYTES);
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
        let mut pass = OverlayPass::new(&gpu, BYTES);
        let mut overlay = frame(&context, texture);
        let half = ColorImage::filled([4, 2], Color32::GREEN);
        overlay.textures.push(texture, ImageDelta::partial([0, 2], half, egui::TextureOptions::NEAREST));
        let pixels = drawn(&gpu, &mut pass, &mut overlay, BYTES);
        assert_eq!((pixel(&pixels, 12, 16), pixel(&pixels, 48, 20)), ([0; 3], [0; 3]), "egui's own white is missing");
        let mut overlay = frame(&context, texture);
        let mut textures = Overlay::fonts_of(&context);
        textures.append(std::mem::take(&mut overlay.textures));
        overlay.textures = textures;
        let pixels = drawn(&gpu, &mut pass, &mut overlay, BYTES);
        assert_eq!(pixel(&pixels, 12, 16), [255, 0, 0]);
    }

    #[test]
    fn colours_are_the_same_where_the_target_encodes_them() {
        let gpu = Gpu::headless().unwrap();
        let context = egui::Context::default();
        let texture = TextureId::Managed(77);
        for format in [BYTES, wgpu::TextureFormat::Rgba8UnormSrgb] {
            let mut pass = OverlayPass::new(&gpu, format);
            let mut overlay = frame(&context, texture);
            overlay.textures.append(Overlay::fonts_of(&context));
            overlay.textures.push(texture, full(Color32::from_rgb(200, 100, 5)));
            let pixels = drawn(&gpu, &mut pass, &mut overlay, format);
            let apart = pixel(&pixels, 48, 16).into_iter().zip([200, 100, 5]).map(|(a, b): (u8, u8)| a.abs_diff(b));
            assert!(apart.max().unwrap() <= 1, "{format:?} {:?}", pixel(&pixels, 48, 16));
        }
    }

    #[test]
    fn clips_end_at_the_target() {
        let rect = |left, top, right, bottom| Rect::from_min_max(Pos2::new(left, top), Pos2::new(right, bottom));
        assert_eq!(clip_px(rect(1.0, 2.0, 5.0, 4.0), 2.0, SIZE_PX), [2, 4, 8, 4]);
        assert_eq!(clip_px(rect(-9.0, -9.0, 1e9, f32::INFINITY), 2.0, SIZE_PX), [0, 0, 64, 32]);
        assert_eq!(clip_px(rect(40.0, 4.0, 50.0, 5.0), 2.0, SIZE_PX)[2], 0);
        assert_eq!(clip_px(rect(5.0, f32::NAN, 2.0, f32::NAN), 2.0, SIZE_PX)[2..], [0, 0]);
        assert_eq!(clip_px(rect(0.0, 0.0, 5.0, 5.0), f32::NAN, SIZE_PX)[2..], [0, 0]);
    }

    #[test]
    fn an_overlay_without_triangles_draws_nothing() {
        let gpu = Gpu::headless().unwrap();
        let mut pass = OverlayPass::new(&gpu, BYTES);
        let mut overlay = Overlay { pixels_per_point: 1.0, textures: TexturesDelta::default(), primitives: Vec::new() };
        assert!(
            drawn(&gpu, &mut pass, &mut overlay, BYTES).iter().enumerate().all(|(at, &byte)| at % 4 == 3 || byte == 0)
        );
    }
}
