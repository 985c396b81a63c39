//! Bind group 0: what every pass knows of the frame.

use super::device::Gpu;
use super::options::{DrawOptions, Haze, Sun};
use crate::camera::View;
use crate::geodesy::{SEMI_MAJOR_M, SEMI_MINOR_M};
use crate::select::GroundPress;
use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Mat4, Vec4};

/// Depth buffers of floats with 1 at this distance and 0 at infinity keep their relative precision everywhere, so
/// that the near plane costs nothing and can stay close.
pub(super) const NEAR_M: f32 = 0.2;
/// Koschmieder: the extinction at which 2 % of the contrast is left at a distance of one.
const CONTRAST_LOG: f64 = 3.912;

/// Mirrors `Frame` in frame.wgsl.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub(super) struct Frame {
    pub clip_from_eye: Mat4,
    pub eye: Vec4,
    pub zenith: Vec4,
    pub sun: Vec4,
    pub right: Vec4,
    pub up: Vec4,
    pub forward: Vec4,
    pub press: Vec4,
    pub haze: Vec4,
}

impl Frame {
    pub fn new(view: &View, press: Option<GroundPress>, options: &DrawOptions) -> Self {
        let axes = view.ecef_from_view().rotation();
        let tan_y = (view.fov_y_rad / 2.0).tan();
        let plain = |v: DVec3| v.as_vec3().extend(0.0);
        Self {
            clip_from_eye: view.clip_from_view(NEAR_M) * Mat4::from_mat3(view.view_from_eye()),
            eye: view.eye().xyz().as_vec3().extend(view.pose.eye.height_m as f32),
            zenith: view.pose.eye.up().as_vec3().extend(stretched_height_m(view) as f32),
            sun: plain(towards_sun(view, &options.sun)),
            right: plain(axes.x_axis * tan_y * view.aspect()),
            up: plain(axes.y_axis * tan_y),
            forward: plain(view.forward()),
            press: press.map_or(Vec4::ZERO, |press| Vec4::new(press.depth_m, press.radius_m, 0.0, 0.0)),
            haze: haze(&options.haze),
        }
    }
}

/// Height above the sphere of radius a once the ellipsoid is stretched along its axis to that sphere, metres.
fn stretched_height_m(view: &View) -> f64 {
    (view.eye().xyz() * DVec3::new(1.0, 1.0, SEMI_MAJOR_M / SEMI_MINOR_M)).length() - SEMI_MAJOR_M
}

fn towards_sun(view: &View, sun: &Sun) -> DVec3 {
    let (sin_a, cos_a) = sun.azimuth_rad.sin_cos();
    let (sin_e, cos_e) = sun.elevation_rad.sin_cos();
    view.pose.eye.ecef_from_enu().rotation() * DVec3::new(sin_a * cos_e, cos_a * cos_e, sin_e)
}

fn haze(haze: &Haze) -> Vec4 {
    Vec4::new((CONTRAST_LOG / haze.visibility_m.max(1.0)) as f32, haze.scale_m.max(1.0) as f32, 0.0, 0.0)
}

/// The uniform buffer and its bind group.
#[derive(Debug)]
pub(super) struct FrameGroup {
    buffer: wgpu::Buffer,
    pub layout: wgpu::BindGroupLayout,
    pub group: wgpu::BindGroup,
}

impl FrameGroup {
    pub fn new(gpu: &Gpu) -> Self {
        let layout = gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("frame"),
            entries: &[wgpu::BindGroupLayoutEntry {
                binding: 0,
                visibility: wgpu::ShaderStages::VERTEX_FRAGMENT,
                ty: wgpu::BindingType::Buffer {
                    ty: wgpu::BufferBindingType::Uniform,
                    has_dynamic_offset: false,
                    min_binding_size: None,
                },
                count: None,
            }],
        });
        let buffer = gpu.buffer("frame", wgpu::BufferUsages::UNIFORM, size_of::<Frame>() as u64);
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("frame"),
            layout: &layout,
            entries: &[wgpu::BindGroupEntry { binding: 0, resource: buffer.as_entire_binding() }],
        });
        Self { buffer, layout, group }
    }

    pub fn write(&self, gpu: &Gpu, frame: &Frame) {
        gpu.queue.write_buffer(&self.buffer, 0, bytemuck::bytes_of(frame));
    }
}
