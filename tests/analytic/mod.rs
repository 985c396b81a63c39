//! A scene in closed form for the controller: an ellipsoid, a cone of a mountain, buildings that are boxes.

use glam::DVec3;
use stoop::camera::{Obstacle, Pose, Surroundings, View};
use stoop::geodesy::{Course, Ecef, Geodetic, Point, SEMI_MAJOR_M, SEMI_MINOR_M};

/// A cone over the ground.
#[derive(Clone, Copy)]
pub struct Mountain {
    pub place: Geodetic,
    pub height_m: f64,
    pub radius_m: f64,
}

/// A building along the parallels and meridians of its place.
#[derive(Clone, Copy)]
pub struct Building {
    pub place: Geodetic,
    pub half_m: [f64; 2],
    pub base_m: f64,
    pub top_m: f64,
}

#[derive(Clone, Default)]
pub struct Scene {
    pub ground_m: f64,
    pub mountain: Option<Mountain>,
    pub buildings: Vec<Building>,
}

impl Scene {
    pub fn flat(ground_m: f64) -> Self {
        Self { ground_m, ..Self::default() }
    }

    pub fn ground_at(&self, place: Geodetic) -> f64 {
        let rise_m = self.mountain.map_or(0.0, |mountain| {
            let off_m = Course::between(mountain.place, place).distance_m;
            (mountain.height_m * (1.0 - off_m / mountain.radius_m)).max(0.0)
        });
        self.ground_m + rise_m
    }

    /// The building whose footprint, grown by `margin_m`, holds a place.
    pub fn building_at(&self, place: Geodetic, margin_m: f64) -> Option<Building> {
        let holds = |building: &&Building| {
            let local = building.place.at_height(0.0).ecef_from_enu().inverse() * place.at_height(0.0).to_ecef();
            let off = local.xyz();
            off.x.abs() <= building.half_m[0] + margin_m && off.y.abs() <= building.half_m[1] + margin_m
        };
        self.buildings.iter().filter(holds).max_by(|a, b| a.top_m.total_cmp(&b.top_m)).copied()
    }

    /// How deep an eye is where it must not be, metres: in the ground's clearance, or in a building.
    pub fn depth_m(&self, pose: Pose) -> f64 {
        let ground_m = self.ground_at(pose.eye) + stoop::camera::EYE_OVER_GROUND_M - pose.eye.height_m;
        let inside = self
            .building_at(pose.eye, 0.49)
            .filter(|building| pose.eye.height_m > building.base_m - 0.49)
            .map_or(f64::NEG_INFINITY, |building| building.top_m + 0.49 - pose.eye.height_m);
        ground_m.max(inside)
    }
}

/// Nearest meeting of a ray with the ellipsoid that is `height_m` larger on every axis.
pub fn ray_ellipsoid(from: DVec3, direction: DVec3, height_m: f64) -> Option<DVec3> {
    let radii = DVec3::new(SEMI_MAJOR_M + height_m, SEMI_MAJOR_M + height_m, SEMI_MINOR_M + height_m);
    let (o, d) = (from / radii, direction / radii);
    let (a, half_b, c) = (d.length_squared(), o.dot(d), o.length_squared() - 1.0);
    let root = half_b * half_b - a * c;
    if root < 0.0 || half_b >= 0.0 {
        return None;
    }
    // The nearer root without a difference of like numbers.
    let far = c / (-half_b + root.sqrt());
    (far > 0.0).then(|| from + direction * far)
}

impl Surroundings for Scene {
    fn pick(&self, view: &View, at_px: [f64; 2]) -> Option<Point<Ecef>> {
        let [width, height] = view.size_px.map(f64::from);
        let local = DVec3::new(at_px[0] - width / 2.0, height / 2.0 - at_px[1], -view.focal_px()).normalize();
        let direction = view.ecef_from_view().rotation() * local;
        ray_ellipsoid(view.eye().xyz(), direction, self.ground_m).map(Point::new)
    }

    fn ground_m(&self, lat_rad: f64, lon_rad: f64) -> Option<f64> {
        Some(self.ground_at(Geodetic { lat_rad, lon_rad, height_m: 0.0 }))
    }

    fn obstacle(&self, lat_rad: f64, lon_rad: f64, margin_m: f64) -> Option<Obstacle> {
        self.building_at(Geodetic { lat_rad, lon_rad, height_m: 0.0 }, margin_m)
            .map(|building| Obstacle { base_m: building.base_m, top_m: building.top_m })
    }
}
