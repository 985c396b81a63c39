//! One frame's view, immutable.

use crate::geodesy::{Ecef, Geodetic, OrientedBox, Point, Transform};
use glam::{DMat3, DVec3, Mat3, Mat4, Vec4};

/// The frame of a view: x right, y up, z backwards; metres from the eye.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ViewAxes {}

/// Where an eye is and where it looks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    pub eye: Geodetic,
    /// Clockwise from north.
    pub heading_rad: f64,
    /// Up from the horizon; −π/2 looks straight down.
    pub pitch_rad: f64,
}

/// Eye, axes, field of view and size of a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    pub pose: Pose,
    pub fov_y_rad: f64,
    pub size_px: [u32; 2],
    ecef_from_view: Transform<Ecef, ViewAxes>,
}

impl View {
    pub fn new(pose: Pose, fov_y_rad: f64, size_px: [u32; 2]) -> Self {
        let ecef_from_enu = pose.eye.ecef_from_enu();
        let (sin_h, cos_h) = pose.heading_rad.sin_cos();
        let (sin_p, cos_p) = pose.pitch_rad.sin_cos();
        let right = DVec3::new(cos_h, -sin_h, 0.0);
        let forward = DVec3::new(sin_h * cos_p, cos_h * cos_p, sin_p);
        let axes = ecef_from_enu.rotation() * DMat3::from_cols(right, right.cross(forward), -forward);
        Self { pose, fov_y_rad, size_px, ecef_from_view: Transform::new(axes, ecef_from_enu.origin().xyz()) }
    }

    pub fn eye(&self) -> Point<Ecef> {
        self.ecef_from_view.origin()
    }

    pub fn ecef_from_view(&self) -> Transform<Ecef, ViewAxes> {
        self.ecef_from_view
    }

    pub fn forward(&self) -> DVec3 {
        -self.ecef_from_view.rotation().z_axis
    }

    pub fn aspect(&self) -> f64 {
        f64::from(self.size_px[0]) / f64::from(self.size_px[1])
    }

    /// Pixels that one metre takes at one metre's distance: viewport_h_px / (2 tan(fov_y/2)).
    pub fn focal_px(&self) -> f64 {
        f64::from(self.size_px[1]) / (2.0 * (self.fov_y_rad / 2.0).tan())
    }

    /// Screen-space size of `size_m` at `distance_m`, which counts as at least 1 m.
    pub fn projected_px(&self, size_m: f64, distance_m: f64) -> f64 {
        size_m * self.focal_px() / distance_m.max(1.0)
    }

    /// Rotation from eye-relative ECEF axes to view axes, f32.
    pub fn view_from_eye(&self) -> Mat3 {
        self.ecef_from_view.rotation().transpose().as_mat3()
    }

    /// Reversed-Z projection with the far plane at infinity: depth is near/z, 1 at `near_m`, 0 at infinity.
    pub fn clip_from_view(&self, near_m: f32) -> Mat4 {
        let y = (1.0 / (self.fov_y_rad / 2.0).tan()) as f32;
        let x = y / self.aspect() as f32;
        Mat4::from_cols(Vec4::X * x, Vec4::Y * y, Vec4::new(0.0, 0.0, 0.0, -1.0), Vec4::Z * near_m)
    }

    /// The same view with `pad_px` more pixels on each side.
    pub fn padded(&self, pad_px: u32) -> Self {
        let size_px = self.size_px.map(|side| side.saturating_add(pad_px.saturating_mul(2)));
        let fov_y_rad = 2.0 * (f64::from(size_px[1]) / (2.0 * self.focal_px())).atan();
        Self { fov_y_rad, size_px, ..*self }
    }

    /// Unit direction in space of what is seen at a pixel position, the inverse of [`View::project_px`]; the middle of
    /// the first pixel is at (0.5, 0.5).
    pub fn ray(&self, at_px: [f64; 2]) -> DVec3 {
        let focal = self.focal_px();
        let x = (at_px[0] - f64::from(self.size_px[0]) / 2.0) / focal;
        let y = (f64::from(self.size_px[1]) / 2.0 - at_px[1]) / focal;
        self.ecef_from_view.rotation() * DVec3::new(x, y, -1.0).normalize()
    }

    pub fn frustum(&self) -> Frustum {
        let rotation = self.ecef_from_view.rotation();
        let tan_y = (self.fov_y_rad / 2.0).tan();
        let tan_x = tan_y * self.aspect();
        let side = |x: f64, y: f64, z: f64| rotation * DVec3::new(x, y, z).normalize();
        Frustum {
            eye: self.eye(),
            inward: [side(1.0, 0.0, -tan_x), side(-1.0, 0.0, -tan_x), side(0.0, 1.0, -tan_y), side(0.0, -1.0, -tan_y)],
        }
    }

    /// Pixel position (x right, y down) of a point; `None` behind the eye.
    pub fn project_px(&self, point: Point<Ecef>) -> Option<[f64; 2]> {
        let p = (self.ecef_from_view.inverse() * point).xyz();
        let focal = self.focal_px();
        (p.z < 0.0).then(|| {
            [
                f64::from(self.size_px[0]) / 2.0 + focal * p.x / -p.z,
                f64::from(self.size_px[1]) / 2.0 - focal * p.y / -p.z,
            ]
        })
    }
}

/// The four side planes of a view; all pass through the eye.
#[derive(Clone, Copy, Debug)]
pub struct Frustum {
    eye: Point<Ecef>,
    /// Unit normals that point inside.
    inward: [DVec3; 4],
}

impl Frustum {
    /// Unit normals of the side planes, which point inside.
    pub fn inward(&self) -> [DVec3; 4] {
        self.inward
    }

    /// Whether a box may be inside: false only when it lies wholly outside one plane.
    pub fn meets(&self, bounds: &OrientedBox) -> bool {
        let to_center = (bounds.center - self.eye).xyz();
        self.inward.iter().all(|&normal| to_center.dot(normal) >= -bounds.extent_along_m(normal))
    }

    /// Whether a box is inside wholly.
    pub fn holds(&self, bounds: &OrientedBox) -> bool {
        let to_center = (bounds.center - self.eye).xyz();
        self.inward.iter().all(|&normal| to_center.dot(normal) >= bounds.extent_along_m(normal))
    }

    /// Whether a ball may be inside: false only when it lies wholly outside one plane.
    pub fn meets_ball(&self, center: Point<Ecef>, radius_m: f64) -> bool {
        let to_center = (center - self.eye).xyz();
        self.inward.iter().all(|normal| to_center.dot(*normal) >= -radius_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_ray_goes_through_its_pixel(
            lat in -90.0..90.0f64, lon in -180.0..180.0f64, log_height in 0.3..7.6f64, heading in 0.0..360.0f64,
            pitch in -90.0..90.0f64, fov in 5.0..120.0f64, width in 1u32..4000, height in 1u32..3000,
            u in 0.0..1.0f64, v in 0.0..1.0f64,
        ) {
            let eye = Geodetic::from_degrees(lat, lon, 10f64.powf(log_height));
            let pose = Pose { eye, heading_rad: heading.to_radians(), pitch_rad: pitch.to_radians() };
            let view = View::new(pose, fov.to_radians(), [width, height]);
            let at_px = [u * f64::from(width), v * f64::from(height)];
            let direction = view.ray(at_px);
            prop_assert!((direction.length() - 1.0).abs() < 1e-14);
            // As far as the Earth is: rounding of the point is what is left.
            let point = Point::new(view.eye().xyz() + direction * (eye.height_m + 1e7));
            let back_px = view.project_px(point).unwrap();
            prop_assert!((0..2).all(|axis| (back_px[axis] - at_px[axis]).abs() < 1e-6), "{at_px:?} {back_px:?}");
        }
    }
}
