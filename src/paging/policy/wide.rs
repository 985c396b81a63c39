//! Views that are wider than the present one, with the same pixels per radian in the middle (the prefetch frustum of
//! Varadhan & Manocha 2002, §4.2).

use crate::camera::View;

/// No half of a widened view is wider than this, radians: beyond it one projection takes too many pixels at its edges.
const HALF_MAX_RAD: f64 = 1.2;

/// Half the angles that a view spans, across and up; radians.
pub fn half_angles_rad(view: &View) -> [f64; 2] {
    let tan_y = (view.fov_y_rad / 2.0).tan();
    [(tan_y * view.aspect()).atan(), view.fov_y_rad / 2.0]
}

/// Half the angle between opposite corners of a view, radians: that of the least cone around it.
pub fn half_diagonal_rad(view: &View) -> f64 {
    let [across, up] = half_angles_rad(view).map(f64::tan);
    across.hypot(up).atan()
}

/// The view with at least so much more on each side, across and up, as far as one projection can hold it; radians.
pub fn widened(view: &View, by_rad: [f64; 2]) -> View {
    let more = |half_rad: f64, by_rad: f64| (half_rad + by_rad.max(0.0)).min(HALF_MAX_RAD).tan() - half_rad.tan();
    let [half_x, half_y] = half_angles_rad(view);
    let pad = more(half_x, by_rad[0]).max(more(half_y, by_rad[1])).max(0.0);
    view.padded((pad * view.focal_px()).ceil() as u32)
}

/// The view as a square that holds it however it is rolled.
pub fn unrolled(view: &View) -> View {
    let [across_px, up_px] = view.size_px.map(f64::from);
    let side_px = across_px.hypot(up_px).ceil();
    let fov_y_rad = 2.0 * (side_px / (2.0 * view.focal_px())).atan();
    View::new(view.pose, fov_y_rad, [side_px as u32; 2])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Pose;
    use crate::geodesy::Geodetic;

    fn view() -> View {
        let pose = Pose { eye: Geodetic::from_degrees(33.0, -84.0, 1000.0), heading_rad: 0.0, pitch_rad: -0.5 };
        View::new(pose, 1.0, [640, 360])
    }

    #[test]
    fn a_wider_view_has_the_same_scale_and_reaches_as_far_as_asked() {
        let (view, wide) = (view(), widened(&view(), [0.2, 0.0]));
        assert!((view.focal_px() / wide.focal_px() - 1.0).abs() < 1e-9);
        let [before, after] = [&view, &wide].map(|view| half_angles_rad(view)[0]);
        assert!(after >= before + 0.2 && after < before + 0.21, "{before} {after}");
        assert_eq!(widened(&view, [0.0, 0.0]), view);
    }

    #[test]
    fn no_view_is_wider_than_a_projection_can_hold() {
        let wide = widened(&view(), [9.0, 9.0]);
        assert!(half_angles_rad(&wide).iter().all(|&half| half < HALF_MAX_RAD + 0.2));
        // A view that is as wide already stays as it is.
        let widest = View::new(view().pose, 2.0 * HALF_MAX_RAD + 0.3, [100, 100]);
        assert_eq!(widened(&widest, [0.5, 0.5]), widest);
    }

    #[test]
    fn a_square_holds_the_view_at_every_roll() {
        let (view, square) = (view(), unrolled(&view()));
        assert!((view.focal_px() / square.focal_px() - 1.0).abs() < 1e-9);
        assert!(half_angles_rad(&square).iter().all(|&half| half >= half_diagonal_rad(&view) - 1e-9));
    }
}
