//! What stands for a detailed shape from afar: its outline drawn up to the mean height of its roofs.

use super::clean::{Plane, polygon_of};
use crate::content::{Detail, DetailCorner, FaceKind, Prism};
use geo::{Coord, Distance, Euclidean, Point};

/// A prism in the place of a detail.
#[derive(Clone, Debug, PartialEq)]
pub struct Plain {
    pub prism: Prism,
    /// Bounds the distance of the detail's roofs from the prism's roof along the vertical, of its corners from the
    /// outline, and of the outline from its corners; metres.
    pub error_m: f64,
}

/// `None` for a prism without a detail.
pub fn of(prism: &Prism) -> Option<Plain> {
    let detail = prism.detail.as_ref()?;
    let origin = prism.rings.first()?.first().copied()?;
    let plane = Plane::about(origin);
    let roofs = roofs(detail, plane);
    let top_m = (roofs.mean_m as f32).min(prism.top_m).max(prism.base_m);
    let plain = Prism { top_m, detail: None, ..prism.clone() };
    let up_m = (roofs.low_m - f64::from(top_m)).abs().max((roofs.high_m - f64::from(top_m)).abs());
    Some(Plain { error_m: up_m.max(aside_m(prism, detail, plane)), prism: plain })
}

/// Heights of a detail's roofs above the ellipsoid, metres.
struct Roofs {
    low_m: f64,
    high_m: f64,
    /// By area on the ground.
    mean_m: f64,
}

/// Of all faces that look up; of the corners where there are none.
fn roofs(detail: &Detail, plane: Plane) -> Roofs {
    let at = |corner: &DetailCorner| plane.to([corner.lon_rad, corner.lat_rad]);
    let heights = detail.corners.iter().map(|corner| f64::from(corner.height_m));
    let high_m = heights.clone().reduce(f64::max).unwrap_or_default();
    let mut low_m = f64::INFINITY;
    let (mut area, mut sum) = (0.0, 0.0);
    for triangle in detail.groups.iter().filter(|group| group.kind == FaceKind::Roof).flat_map(|group| &group.triangles)
    {
        let corners = triangle.map(|corner| detail.corners.get(corner as usize));
        let [Some(a), Some(b), Some(c)] = corners else { continue };
        let [p, q, r] = [at(a), at(b), at(c)];
        let doubled = ((q.x - p.x) * (r.y - p.y) - (q.y - p.y) * (r.x - p.x)).abs();
        let own = [a, b, c].map(|corner| f64::from(corner.height_m));
        area += doubled;
        sum += doubled * own.iter().sum::<f64>() / 3.0;
        low_m = own.into_iter().fold(low_m, f64::min);
    }
    if area <= 0.0 {
        return Roofs { low_m: heights.fold(high_m, f64::min), high_m, mean_m: high_m };
    }
    Roofs { low_m, high_m, mean_m: sum / area }
}

/// How far corners jut out of the outline, and how far the outline's corners are from any corner.
fn aside_m(prism: &Prism, detail: &Detail, plane: Plane) -> f64 {
    let Some(outline) = polygon_of(&prism.rings, |p| plane.to(p)) else { return 0.0 };
    let corners: Vec<Coord> = detail.corners.iter().map(|corner| plane.to([corner.lon_rad, corner.lat_rad])).collect();
    let out_m = corners.iter().map(|&corner| Euclidean.distance(&Point::from(corner), &outline));
    let nearest_m = |p: Coord| corners.iter().map(|c| (c.x - p.x).hypot(c.y - p.y)).fold(f64::INFINITY, f64::min);
    let back_m = prism.rings.iter().flatten().map(|&p| nearest_m(plane.to(p))).filter(|metres| metres.is_finite());
    out_m.chain(back_m).fold(0.0, f64::max)
}
