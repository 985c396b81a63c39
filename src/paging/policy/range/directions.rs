//! Where an observer looks: bands of pitch, cut into sectors of heading (the range of directions of Funkhouser 1996,
//! §4.1).

use super::super::wide::{unrolled, widened};
use crate::camera::{Pose, View};
use crate::geodesy::Geodetic;
use glam::DVec3;
use std::f64::consts::{FRAC_PI_6, TAU};

/// Bands of 30° from straight down to 30° up; higher there is little to see.
const BANDS: std::ops::RangeInclusive<i8> = -3..=1;
const SECTORS_MAX: u32 = 32;
/// Steeper than this a turn of the heading rolls the picture, rather than it moves it; radians.
const STEEP_RAD: f64 = 0.9;

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Direction {
    /// Pitch in steps of 30°.
    band: i8,
    sector: u32,
    /// In its band.
    sectors: u32,
}

impl Direction {
    fn all(sectors: u32) -> impl Iterator<Item = Self> {
        let sectors = sectors.clamp(1, SECTORS_MAX);
        BANDS.flat_map(move |band: i8| {
            let sectors = match band.unsigned_abs() {
                3 => 1,
                2 => sectors.div_ceil(2),
                _ => sectors,
            };
            (0..sectors).map(move |sector| Self { band, sector, sectors })
        })
    }

    fn pitch_rad(&self) -> f64 {
        f64::from(self.band) * FRAC_PI_6
    }

    fn heading_rad(&self) -> f64 {
        f64::from(self.sector) * TAU / f64::from(self.sectors)
    }

    /// How far its edges are from its middle, radians: across and up.
    fn half_rad(&self) -> [f64; 2] {
        [TAU / f64::from(2 * self.sectors) * self.pitch_rad().cos(), FRAC_PI_6 / 2.0]
    }

    /// The view from a place that holds the views in all directions of the sector.
    pub fn view(&self, from: Geodetic, fov_y_rad: f64, size_px: [u32; 2]) -> View {
        let pose = Pose { eye: from, heading_rad: self.heading_rad(), pitch_rad: self.pitch_rad() };
        let view = View::new(pose, fov_y_rad, size_px);
        let view = if self.pitch_rad().abs() > STEEP_RAD { unrolled(&view) } else { view };
        widened(&view, self.half_rad())
    }

    /// Angle from a direction to the sector, radians; 0 inside it.
    fn angle_from_rad(&self, forward: DVec3) -> f64 {
        let [across, up] = self.half_rad();
        (forward_of(self.heading_rad(), self.pitch_rad()).angle_between(forward) - across.max(up)).max(0.0)
    }
}

/// Unit vector in east, north, up.
fn forward_of(heading_rad: f64, pitch_rad: f64) -> DVec3 {
    let ((sin_h, cos_h), (sin_p, cos_p)) = (heading_rad.sin_cos(), pitch_rad.sin_cos());
    DVec3::new(sin_h * cos_p, cos_h * cos_p, sin_p)
}

/// The directions that are reached within `frames_max` frames at `turn_rad` a frame, with the frames that it takes. The one
/// nearest to where the pose looks takes none.
pub fn reachable(sectors: u32, pose: &Pose, turn_rad: f64, frames_max: f64) -> Vec<(f64, Direction)> {
    let forward = forward_of(pose.heading_rad, pose.pitch_rad);
    let angle =
        |direction: &Direction| forward_of(direction.heading_rad(), direction.pitch_rad()).angle_between(forward);
    let nearest = Direction::all(sectors).min_by(|a, b| angle(a).total_cmp(&angle(b)).then(a.cmp(b)));
    let frames = |direction: &Direction| match direction.angle_from_rad(forward) {
        _ if Some(*direction) == nearest => 0.0,
        angle_rad if angle_rad > 0.0 => angle_rad / turn_rad,
        _ => 0.0,
    };
    let all = Direction::all(sectors).map(|direction| (frames(&direction), direction));
    all.filter(|(frames, _)| *frames <= frames_max).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose(heading_deg: f64, pitch_deg: f64) -> Pose {
        let eye = Geodetic::from_degrees(33.0, -84.0, 1000.0);
        Pose { eye, heading_rad: heading_deg.to_radians(), pitch_rad: pitch_deg.to_radians() }
    }

    #[test]
    fn turning_takes_its_frames() {
        // A degree a frame; sectors of 45°, bands of 30°.
        let reached = reachable(8, &pose(0.0, 0.0), 1f64.to_radians(), 100.0);
        let frames = |band: i8, sector: u32| {
            reached.iter().find(|(_, to)| (to.band, to.sector) == (band, sector)).map(|&(frames, _)| frames)
        };
        assert_eq!(frames(0, 0), Some(0.0));
        assert!((frames(0, 1).unwrap() - 22.5).abs() < 1e-6 && (frames(0, 7).unwrap() - 22.5).abs() < 1e-6);
        assert!((frames(0, 2).unwrap() - 67.5).abs() < 1e-6);
        assert_eq!(frames(0, 4), None);
        // Straight down: 90° less half a band.
        assert!((frames(-3, 0).unwrap() - 75.0).abs() < 1e-6);
    }

    #[test]
    fn at_rest_there_is_one_direction_at_least() {
        for (heading_deg, pitch_deg) in [(0.0, -90.0), (22.5, -45.0), (200.0, 90.0), (359.0, -15.0)] {
            let reached = reachable(8, &pose(heading_deg, pitch_deg), 0.0, 60.0);
            assert!(reached.iter().any(|(frames, _)| *frames == 0.0), "{heading_deg} {pitch_deg}");
        }
    }

    #[test]
    fn a_sector_sees_what_all_its_views_see() {
        let corners = |view: &View| {
            let [w, h] = view.size_px.map(f64::from);
            [[0.0, 0.0], [w, 0.0], [0.0, h], [w, h], [w / 2.0, h / 2.0]].map(|at_px| view.ray(at_px))
        };
        for (heading_deg, pitch_deg) in [(20.0, 3.0), (-20.0, -12.0), (130.0, -90.0), (77.0, -85.0)] {
            let pose = pose(heading_deg, pitch_deg);
            let view = View::new(pose, 0.7, [320, 180]);
            let (_, direction) = reachable(8, &pose, 0.0, 0.0)[0];
            let wide = direction.view(pose.eye, 0.7, [320, 180]);
            for ray in corners(&view) {
                let at_px = wide.project_px(crate::geodesy::Point::new(wide.eye().xyz() + ray * 1000.0)).unwrap();
                let inside = (0..2).all(|axis| (-30.0..f64::from(wide.size_px[axis]) + 30.0).contains(&at_px[axis]));
                assert!(inside, "{heading_deg} {pitch_deg} {direction:?} {at_px:?} {:?}", wide.size_px);
            }
        }
    }
}
