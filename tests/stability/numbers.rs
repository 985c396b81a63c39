//! Positions, depths, coordinates and geodesics.

use super::search::limit;
use super::table::{Row, digits};
use crate::exact;
use crate::made_up::view as view_at;
use crate::vincenty::vincenty_m;
use glam::{DVec3, Mat4, Vec3};
use std::f64::consts::{FRAC_PI_2, PI};
use stoop::camera::{Pose, View};
use stoop::geodesy::{
    Course, ECCENTRICITY_SQ, Ecef, FLATTENING, Geodetic, Point, SEMI_MAJOR_M, SEMI_MINOR_M, prime_vertical_radius_m,
};
use stoop::render::eye_relative;

/// A door in the north; all digits of its coordinates are used.
const LAT_DEG: f64 = 60.170_1;
const LON_DEG: f64 = 24.940_1;
const SIZE_PX: [u32; 2] = [1920, 1080];
/// Jitter that is not seen, px.
const UNSEEN_PX: f64 = 0.1;

/// Pixel position of a point in the axes of the view, f32 as in a vertex shader.
fn pixel(view: &View, at: Vec3) -> [f64; 2] {
    let clip = view.clip_from_view(0.1) * at.extend(1.0);
    let [width, height] = view.size_px.map(f64::from);
    [f64::from(clip.x / clip.w) * width / 2.0 + width / 2.0, height / 2.0 - f64::from(clip.y / clip.w) * height / 2.0]
}

/// One f32 matrix from Earth-fixed coordinates to the view's axes, applied to an f32 position.
fn absolute(view: &View, point: Point<Ecef>) -> Vec3 {
    let transform = view.ecef_from_view().inverse();
    let matrix = Mat4::from_cols(
        transform.rotation().x_axis.as_vec3().extend(0.0),
        transform.rotation().y_axis.as_vec3().extend(0.0),
        transform.rotation().z_axis.as_vec3().extend(0.0),
        transform.origin().xyz().as_vec3().extend(1.0),
    );
    matrix.transform_point3(point.xyz().as_vec3())
}

/// Largest distance of the drawn from the true pixel, over frames of an eye that creeps past a point.
fn jitter_px(distance_m: f64, place: impl Fn(&View, Point<Ecef>) -> Vec3) -> f64 {
    let eye = Geodetic::from_degrees(LAT_DEG, LON_DEG, 20.0);
    let pose = |eye| Pose { eye, heading_rad: 0.7, pitch_rad: -0.3 };
    let view = View::new(pose(eye), 60f64.to_radians(), SIZE_PX);
    let aside = DVec3::new(0.4 * distance_m, 0.3 * distance_m, -distance_m);
    let point = view.ecef_from_view() * Point::new(aside);
    let off_px = |frame: u32| {
        let (creeping, _) = eye.travel(0.5, 1e-4 * distance_m * f64::from(frame));
        let view = View::new(pose(creeping), view.fov_y_rad, SIZE_PX);
        let [x, y] = view.project_px(point).unwrap();
        let drawn = pixel(&view, place(&view, point));
        (drawn[0] - x).hypot(drawn[1] - y)
    };
    (0..100).map(off_px).fold(0.0, f64::max)
}

pub fn positions_in_f32() -> Row {
    let ours = |view: &View, point| view.view_from_eye() * eye_relative(point, view);
    let usual_px = jitter_px(10.0, absolute);
    assert!(usual_px > 3.0, "{usual_px}");
    let ours_px = (0..=7).map(|digit| jitter_px(10f64.powi(digit), ours)).fold(0.0, f64::max);
    assert!(ours_px < 0.01, "{ours_px}");
    let usual_m = limit(1e6, 1.0, |distance_m| jitter_px(distance_m, absolute) < UNSEEN_PX);
    let ours_m = limit(1.0, 1e-9, |distance_m| jitter_px(distance_m, ours) < UNSEEN_PX);
    assert!(usual_m > 500.0 && ours_m < 1e-4, "{usual_m} {ours_m}");
    Row {
        case: "f32 positions 6.4·10⁶ m from the origin",
        usual: format!(
            "Earth-fixed f32 and one matrix: {} px of jitter 10 m away; unseen ({UNSEEN_PX} px) only beyond {} m",
            digits(usual_px),
            digits(usual_m)
        ),
        ours: format!("less the eye in f64, then f32: {} px at 1 m to 10⁷ m", digits(ours_px)),
        limit: format!("unseen from {} m on", digits(ours_m)),
    }
}

/// Near and, where a method has one, far plane, metres.
const NEAR_M: f64 = 0.2;
const FAR_M: f64 = 1e8;

fn unsigned_24(z_m: f64) -> f64 {
    (FAR_M / (FAR_M - NEAR_M) * (1.0 - NEAR_M / z_m) * f64::from((1u32 << 24) - 1)).round()
}

fn standard_f32(z_m: f64) -> f64 {
    f64::from((FAR_M / (FAR_M - NEAR_M) * (1.0 - NEAR_M / z_m)) as f32)
}

/// By the matrix that pictures are drawn with.
fn reversed_f32(z_m: f64) -> f64 {
    let view = view_at(0.0, 0.0, 100.0, 0.0, 0.0);
    let clip = view.clip_from_view(NEAR_M as f32) * Vec3::new(0.0, 0.0, -z_m as f32).extend(1.0);
    f64::from(clip.z / clip.w)
}

/// Whether surfaces so far apart always have different depths, wherever they fall between two steps.
fn separates(depth: impl Fn(f64) -> f64, z_m: f64, apart_m: f64) -> bool {
    (0..64).map(|at| z_m * (1.0 + 1e-3 * f64::from(at) / 64.0)).all(|z_m| depth(z_m) != depth(z_m + apart_m))
}

pub fn depth() -> Row {
    let farthest_m = |depth: &dyn Fn(f64) -> f64| limit(10.0, 1e9, |z_m| separates(depth, z_m, 1.0));
    let (unsigned_m, standard_m, reversed_m) =
        (farthest_m(&unsigned_24), farthest_m(&standard_f32), farthest_m(&reversed_f32));
    assert!(unsigned_m < 2_000.0 && standard_m < 2_000.0, "{unsigned_m} {standard_m}");
    assert!(reversed_m > 4e6, "{reversed_m}");
    // At 1,000 km neither tells a mountain from what lies 100 km behind it.
    assert!(unsigned_24(1e6) == unsigned_24(1.1e6) && standard_f32(1e6) == standard_f32(1.1e6));
    let share = limit(1e-3, 1e-9, |share| {
        (0..=70).map(|digit| 10f64.powf(f64::from(digit) / 10.0)).all(|z_m| separates(reversed_f32, z_m, share * z_m))
    });
    assert!(share < 2.5e-7, "{share}");
    Row {
        case: "depth from 1 m to 10⁷ m in one picture, near plane at 0.2 m",
        usual: format!(
            "24 bits tell 1 m apart up to {} m, f32 from near to far up to {} m; at 1,000 km neither tells 100 km",
            digits(unsigned_m),
            digits(standard_m)
        ),
        ours: format!("reversed f32 without far plane: {} of the distance, everywhere", digits(share)),
        limit: format!("1 m apart up to {} m", digits(reversed_m)),
    }
}

/// Bowring 1976, one step, with the usual height.
fn bowring(point: Point<Ecef>) -> Geodetic {
    let p = point.xyz();
    let across = p.x.hypot(p.y);
    let beta = p.z.atan2(across * (1.0 - FLATTENING));
    let second = ECCENTRICITY_SQ / (1.0 - ECCENTRICITY_SQ);
    let lat_rad = (p.z + second * SEMI_MINOR_M * beta.sin().powi(3))
        .atan2(across - ECCENTRICITY_SQ * SEMI_MAJOR_M * beta.cos().powi(3));
    let height_m = across / lat_rad.cos() - prime_vertical_radius_m(lat_rad.sin());
    Geodetic { lat_rad, lon_rad: p.y.atan2(p.x), height_m }
}

/// One step of Newton's for κ = (p/z) tan φ from its value on the ellipsoid (Bowring's equation, as it is taught).
fn newton(point: Point<Ecef>) -> Geodetic {
    let p = point.xyz();
    let (across_sq, z_sq) = (p.x * p.x + p.y * p.y, p.z * p.z);
    let start = 1.0 / (1.0 - ECCENTRICITY_SQ);
    let c = (across_sq + (1.0 - ECCENTRICITY_SQ) * z_sq * start * start).powf(1.5) / (SEMI_MAJOR_M * ECCENTRICITY_SQ);
    let kappa = 1.0 + (across_sq + (1.0 - ECCENTRICITY_SQ) * z_sq * start.powi(3)) / (c - across_sq);
    let height_m = (1.0 / kappa - 1.0 / start) / ECCENTRICITY_SQ * (across_sq + z_sq * kappa * kappa).sqrt();
    Geodetic { lat_rad: (kappa * p.z).atan2(across_sq.sqrt()), lon_rad: p.y.atan2(p.x), height_m }
}

/// How far what a method says is from the point, metres; infinite where it says nothing. Measured with 31 digits.
fn off_m(point: Point<Ecef>, method: fn(Point<Ecef>) -> Geodetic) -> f64 {
    let place = method(point);
    if !(place.lat_rad.is_finite() && place.height_m.is_finite()) {
        return f64::INFINITY;
    }
    exact::distance_m(exact::ecef(place.lat_rad, place.lon_rad, place.height_m), point.xyz().to_array())
}

/// Over latitudes and longitudes at a height, metres.
fn worst_at_height_m(height_m: f64, method: fn(Point<Ecef>) -> Geodetic) -> f64 {
    let lats = (-40..=40).map(|n| FRAC_PI_2 * f64::from(n) / 40.0).chain([FRAC_PI_2 - 1e-8, 1e-5 - FRAC_PI_2, 1e-9]);
    let points =
        lats.flat_map(|lat_rad| [-PI, -1.0, 0.0, 2.0].map(|lon_rad| Geodetic { lat_rad, lon_rad, height_m }.to_ecef()));
    points.map(|point| off_m(point, method)).fold(0.0, f64::max)
}

/// Over points on the axis and next to it, and about the centre.
fn worst_inside_m(method: fn(Point<Ecef>) -> Geodetic) -> f64 {
    let axis = [6.3e6, 1e6, 4e4, 1.0, 1e-6].into_iter().flat_map(|z| [z, -z]);
    let points = axis.flat_map(|z| [0.0, 1e-9, 1.0, 3e4].map(|x| DVec3::new(x, 0.0, z))).chain([DVec3::ZERO]);
    points.map(|xyz| off_m(Point::new(xyz), method)).fold(0.0, f64::max)
}

pub fn geodetic_coordinates() -> Row {
    let pole = Point::new(DVec3::new(1e-3, 0.0, SEMI_MINOR_M + 100.0));
    let height_off_m = |method: fn(Point<Ecef>) -> Geodetic| (method(pole).height_m - 100.0).abs();
    let (far, low) = (1e8, -10_000.0);
    let bowring_m = [worst_at_height_m(far, bowring), height_off_m(bowring), worst_inside_m(bowring)];
    let newton_m = [worst_at_height_m(low, newton), worst_at_height_m(far, newton), worst_inside_m(newton)];
    assert!(bowring_m[0] > 0.01 && bowring_m[1] > 1e-3 && bowring_m[2] > 1e3, "{bowring_m:?}");
    assert!(newton_m[0] > 1e-9 && newton_m[1] > 1.0 && newton_m[2] > 1e3, "{newton_m:?}");
    let ours: fn(Point<Ecef>) -> Geodetic = Geodetic::from_ecef;
    let low_m = worst_at_height_m(low, ours).max(worst_at_height_m(0.0, ours)).max(height_off_m(ours));
    let (far_m, inside_m) = (worst_at_height_m(far, ours), worst_inside_m(ours));
    assert!(low_m < 5e-9 && far_m < 100e-9 && inside_m < 20e-9, "{low_m} {far_m} {inside_m}");
    let highest_m = limit(1e8, 1e16, |height_m| worst_at_height_m(height_m, ours) < 1e-3);
    assert!(highest_m > 1e11, "{highest_m}");
    let of = |off_m: f64| if off_m.is_finite() { format!("{} m", digits(off_m)) } else { "no number".to_owned() };
    Row {
        case: "ECEF → geodetic: poles, axis, centre, −10 km, 10⁸ m",
        usual: format!(
            "one step of Bowring's: {} off at 10⁸ m, {} of height 1 mm from the pole, {} about the centre; one of \
             Newton's: {} at −10 km, {} at 10⁸ m, {} about the centre",
            of(bowring_m[0]),
            of(bowring_m[1]),
            of(bowring_m[2]),
            of(newton_m[0]),
            of(newton_m[1]),
            of(newton_m[2])
        ),
        ours: format!(
            "{} nm up to the ground, {} nm at 10⁸ m, {} nm at axis and centre",
            nm(low_m),
            nm(far_m),
            nm(inside_m)
        ),
        limit: format!("1 mm up to {} m of height", digits(highest_m)),
    }
}

fn nm(metres: f64) -> String {
    digits(metres * 1e9)
}

/// Pairs whose ends are `off_deg` from being antipodes, in several directions and latitudes.
fn near_antipodes(off_deg: f64) -> Vec<[Geodetic; 2]> {
    let lats = [0.0, 0.5, 30.0, 60.0, 89.0];
    let ways = [0.1f64, 0.8, 1.5, 2.6, 3.9, 5.5];
    let pair = |lat: f64, way: f64| {
        let (sin, cos) = way.sin_cos();
        let from = Geodetic::from_degrees(lat, 10.0, 0.0);
        [from, Geodetic::from_degrees((-lat + off_deg * sin).clamp(-90.0, 90.0), -170.0 + off_deg * cos, 0.0)]
    };
    lats.into_iter().flat_map(|lat| ways.map(|way| pair(lat, way))).collect()
}

pub fn geodesics() -> Row {
    let settled =
        |off_deg: f64| near_antipodes(off_deg).into_iter().filter(|&[a, b]| vincenty_m(a, b).is_some()).count();
    // Far from antipodes it is right, to its half a millimetre.
    for [from, to] in near_antipodes(20.0) {
        assert!((vincenty_m(from, to).unwrap() - Course::between(from, to).distance_m).abs() < 1e-3);
    }
    let all = near_antipodes(0.1).len();
    let lost = all - settled(0.1);
    assert!(lost > all / 3, "{lost} of {all}");
    let usual_deg = limit(20.0, 0.1, |off_deg| settled(off_deg) == all);
    let landing_m = |off_deg: f64| {
        let landing = |[from, to]: [Geodetic; 2]| {
            let course = Course::between(from, to);
            from.travel(course.departure_rad, course.distance_m).0.to_ecef().distance_m(to.to_ecef())
        };
        near_antipodes(off_deg).into_iter().map(landing).fold(0.0, f64::max)
    };
    let offs = (0..=14).map(|digit| 10f64.powi(-digit)).chain([0.0, 0.5, 0.3]);
    let ours_m = offs.map(landing_m).fold(0.0, f64::max);
    assert!(ours_m < 1e-7, "{ours_m}");
    Row {
        case: "geodesics near antipodes",
        usual: format!(
            "Vincenty's does not settle for {lost} of {all} pairs 0.1° from antipodes, and for some nearer than {}°",
            digits(usual_deg)
        ),
        ours: "Karney's: all ways are found, down to antipodes themselves".to_owned(),
        limit: format!("going the way lands within {} nm, 1° to 0° from antipodes", nm(ours_m)),
    }
}
