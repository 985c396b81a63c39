//! The length that the scale bar stands for.

use crate::camera::View;
use crate::geodesy::Geodetic;

/// A bar of a round length.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ScaleBar {
    /// 1, 2 or 5 times a power of ten.
    pub length_m: f64,
    pub width_px: f64,
}

/// The longest bar of a round length that is at most `width_max_px` wide at the distance of `middle`, across the
/// view. `None` where there is none between a millimetre and the size of the Earth.
pub(super) fn scale_bar(view: &View, middle: Geodetic, width_max_px: f64) -> Option<ScaleBar> {
    let distance_m = view.eye().distance_m(middle.to_ecef());
    let metres_per_px = distance_m / view.focal_px();
    let length_m = round_length(metres_per_px * width_max_px)?;
    Some(ScaleBar { length_m, width_px: length_m / metres_per_px })
}

/// The largest of 1, 2, 5 times a power of ten up to `limit`.
fn round_length(limit: f64) -> Option<f64> {
    const RANGE_M: std::ops::RangeInclusive<f64> = 1e-3..=1e8;
    if !RANGE_M.contains(&limit) {
        return None;
    }
    let power = 10f64.powi(limit.log10().floor() as i32);
    // The logarithm may be rounded either way.
    [10.0, 5.0, 2.0, 1.0, 0.5].map(|step| step * power).into_iter().find(|&length| length <= limit)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Pose;

    #[test]
    fn lengths_are_round_and_as_long_as_fits() {
        for (limit, length) in
            [(1.0, 1.0), (1.99, 1.0), (2.0, 2.0), (4.9, 2.0), (99.0, 50.0), (1000.0, 1000.0), (0.07, 0.05)]
        {
            let found = round_length(limit).unwrap();
            assert!((found / length - 1.0).abs() < 1e-12, "{limit}: {found}");
        }
        for limit in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e300, 1e-9] {
            assert_eq!(round_length(limit), None, "{limit}");
        }
    }

    #[test]
    fn the_bar_is_as_wide_as_its_length_is_drawn() {
        let place = Geodetic::from_degrees(60.0, 25.0, 20.0);
        let down = Pose { eye: place.at_height(1020.0), heading_rad: 0.3, pitch_rad: -std::f64::consts::FRAC_PI_2 };
        let view = View::new(down, 1.0, [1280, 720]);
        let bar = scale_bar(&view, place, 100.0).unwrap();
        assert!((bar.length_m - 100.0).abs() < 1e-9, "{bar:?}");
        // The same length on the ground, projected.
        let right = view.ecef_from_view().rotation().x_axis;
        let end = place.to_ecef() + crate::geodesy::Vector::new(right * bar.length_m);
        let [from, to] = [view.project_px(place.to_ecef()), view.project_px(end)].map(Option::unwrap);
        assert!(((to[0] - from[0]).hypot(to[1] - from[1]) - bar.width_px).abs() < 1e-6);
    }
}
