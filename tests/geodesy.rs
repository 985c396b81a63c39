//! Coordinates, boxes, horizon: what must hold everywhere, and where the naive method fails.

use glam::DVec3;
use proptest::prelude::*;
use std::f64::consts::{FRAC_PI_2, PI};
use stoop::geodesy::{
    Course, ECCENTRICITY_SQ, Ecef, FLATTENING, GeoBounds, Geodetic, HorizonCone, OrientedBox, Point, SEMI_MAJOR_M,
    SEMI_MINOR_M, prime_vertical_radius_m,
};

mod exact;
mod vincenty;

use vincenty::vincenty_m;

fn quiet(cases: u32) -> ProptestConfig {
    ProptestConfig { cases, failure_persistence: None, ..ProptestConfig::default() }
}

fn any_lat() -> impl Strategy<Value = f64> {
    let near_pole = (0.0f64..16.0, any::<bool>())
        .prop_map(|(digits, north)| (FRAC_PI_2 - 10f64.powf(-digits)) * if north { 1.0 } else { -1.0 });
    prop_oneof![3 => -FRAC_PI_2..=FRAC_PI_2, 1 => near_pole, 1 => Just(FRAC_PI_2), 1 => Just(-FRAC_PI_2), 1 => Just(0.0)]
}

fn there_and_back_m(place: Geodetic) -> f64 {
    let point = place.to_ecef();
    Geodetic::from_ecef(point).to_ecef().distance_m(point)
}

proptest! {
    #![proptest_config(quiet(20_000))]

    #[test]
    fn coordinates_close_near_the_ground(lat_rad in any_lat(), lon_rad in -PI..PI, height_m in -10_000.0..100_000.0) {
        let off_m = there_and_back_m(Geodetic { lat_rad, lon_rad, height_m });
        prop_assert!(off_m <= 5e-9, "{off_m}");
    }

    #[test]
    fn coordinates_close_far_away(lat_rad in any_lat(), lon_rad in -PI..PI, digits in 5.0f64..8.0) {
        let off_m = there_and_back_m(Geodetic { lat_rad, lon_rad, height_m: 10f64.powf(digits) });
        prop_assert!(off_m <= 100e-9, "{off_m}");
    }

    #[test]
    fn coordinates_close_inside_the_earth(x in -1.0f64..1.0, y in -1.0f64..1.0, z in -1.0f64..1.0, digits in -9.0f64..7.0) {
        let point = Point::new(DVec3::new(x, y, z) * 10f64.powf(digits));
        let place = Geodetic::from_ecef(point);
        prop_assert!(place.lat_rad.abs() <= FRAC_PI_2 && place.height_m.is_finite());
        let off_m = place.to_ecef().distance_m(point);
        prop_assert!(off_m <= 20e-9, "{off_m}");
        // The nearest place of the ellipsoid, not another normal's foot.
        let foot_m = place.at_height(0.0).to_ecef().distance_m(point);
        for lat_rad in [-1.5, -1.0, -0.5, 0.0, 0.5, 1.0, 1.5] {
            let other = Geodetic { lat_rad, lon_rad: place.lon_rad, height_m: 0.0 }.to_ecef();
            prop_assert!(foot_m <= other.distance_m(point) + 1e-6);
        }
    }

    #[test]
    fn forward_is_right_to_a_few_units_in_the_last_place(
        lat_rad in any_lat(), lon_rad in -PI..PI, height_m in -10_000.0..100_000.0,
    ) {
        let p = Geodetic { lat_rad, lon_rad, height_m }.to_ecef().xyz();
        let off_m = exact::distance_m(exact::ecef(lat_rad, lon_rad, height_m), p.to_array());
        prop_assert!(off_m < 3.5e-9, "{off_m}");
    }
}

#[test]
fn poles_axis_and_centre_are_places() {
    for (xyz, lat_deg, height_m) in [
        ([0.0, 0.0, SEMI_MINOR_M], 90.0, 0.0),
        ([0.0, 0.0, -SEMI_MINOR_M - 1e8], -90.0, 1e8),
        ([0.0, 0.0, 0.0], 90.0, -SEMI_MINOR_M),
        ([0.0, 0.0, 1e-6], 90.0, 1e-6 - SEMI_MINOR_M),
        ([0.0, 0.0, -1e-6], -90.0, 1e-6 - SEMI_MINOR_M),
        ([0.0, 0.0, 1e-300], 90.0, -SEMI_MINOR_M),
        ([SEMI_MAJOR_M, 0.0, 0.0], 0.0, 0.0),
        ([60_000.0, 0.0, 0.0], 0.0, 60_000.0 - SEMI_MAJOR_M),
    ] {
        let place = Geodetic::from_ecef(Point::new(DVec3::from_array(xyz)));
        assert_eq!(place.lat_deg(), lat_deg, "{xyz:?}");
        assert!((place.height_m - height_m).abs() <= 2e-9_f64.max(height_m * 1e-15), "{xyz:?}: {}", place.height_m);
        assert_eq!(place.lon_rad, 0.0);
    }
}

#[test]
fn one_step_of_bowring_fails_far_away() {
    let bowring = |point: Point<Ecef>| {
        let p = point.xyz();
        let across = p.x.hypot(p.y);
        let beta = p.z.atan2(across * (1.0 - FLATTENING));
        let second = ECCENTRICITY_SQ / (1.0 - ECCENTRICITY_SQ);
        let lat_rad = (p.z + second * SEMI_MINOR_M * beta.sin().powi(3))
            .atan2(across - ECCENTRICITY_SQ * SEMI_MAJOR_M * beta.cos().powi(3));
        // The usual height, which divides by a cosine.
        let height_m = across / lat_rad.cos() - prime_vertical_radius_m(lat_rad.sin());
        Geodetic { lat_rad, lon_rad: p.y.atan2(p.x), height_m }
    };
    let off_m = |place: Geodetic| {
        let point = place.to_ecef();
        bowring(point).to_ecef().distance_m(point)
    };
    let far = Geodetic::from_degrees(45.0, 10.0, 1e8);
    assert!(off_m(far) > 0.01, "{}", off_m(far));
    assert!(there_and_back_m(far) < 100e-9);
    // And next to the pole, where the usual height divides a rounded nought by another.
    let (mut naive_m, mut ours_m) = (0f64, 0f64);
    for i in 1..100 {
        let point = Point::new(DVec3::new(f64::from(i) * 1.234e-3, 0.0, SEMI_MINOR_M + 100.0));
        naive_m = naive_m.max((bowring(point).height_m - 100.0).abs());
        ours_m = ours_m.max((Geodetic::from_ecef(point).height_m - 100.0).abs());
    }
    assert!(naive_m > 1e-2 && ours_m < 2e-9, "{naive_m} {ours_m}");
}

#[test]
fn f32_positions_jump_by_decimetres_and_eye_relative_ones_do_not() {
    let eye = Geodetic::from_degrees(60.17, 24.94, 20.0);
    let door = Geodetic::from_degrees(60.1701, 24.9401, 5.0).to_ecef().xyz();
    let naive = door.as_vec3().as_dvec3();
    assert!(naive.distance(door) > 0.05, "{}", naive.distance(door));
    let eye = eye.to_ecef().xyz();
    let relative = eye + (door - eye).as_vec3().as_dvec3();
    assert!(relative.distance(door) < 1e-6);
}

fn any_bounds() -> impl Strategy<Value = GeoBounds> {
    let span = |most: f64| (0.0f64..1.0).prop_map(move |t| most * 10f64.powf(-7.0 * t * t));
    (-FRAC_PI_2..FRAC_PI_2, -PI..PI, span(PI), span(2.0 * PI)).prop_map(|(lat, lon, height, width)| GeoBounds {
        west_rad: (lon - width / 2.0).max(-PI),
        south_rad: (lat - height / 2.0).max(-FRAC_PI_2),
        east_rad: (lon + width / 2.0).min(PI),
        north_rad: (lat + height / 2.0).min(FRAC_PI_2),
    })
}

proptest! {
    #![proptest_config(quiet(1500))]

    #[test]
    fn a_box_holds_its_shell_and_touches_it(bounds in any_bounds(), low_m in -11_000.0..9000.0, thick_m in 0.0..1000.0) {
        let around = OrientedBox::around(&bounds, low_m, low_m + thick_m);
        let (mut least, mut greatest) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let steps = 60;
        for row in 0..=steps {
            for column in 0..=steps {
                for height_m in [low_m, low_m + thick_m / 2.0, low_m + thick_m] {
                    let (u, v) = (f64::from(column) / f64::from(steps), f64::from(row) / f64::from(steps));
                    let point = bounds.at(u, v, height_m).to_ecef();
                    prop_assert!(around.distance_m(point) <= 1e-8, "{u} {v} {height_m}: {}", around.distance_m(point));
                    let offset = (point - around.center).xyz();
                    let local = DVec3::from_array(around.axes.map(|axis| axis.dot(offset)));
                    (least, greatest) = (least.min(local), greatest.max(local));
                }
            }
        }
        // No larger than what it holds, as far as the samples can tell.
        let slack = around.half_m * 2e-3 + 1e-6;
        prop_assert!((greatest + slack).cmpge(around.half_m).all(), "{greatest} {}", around.half_m);
        prop_assert!((least - slack).cmple(-around.half_m).all(), "{least} {}", around.half_m);
    }

    #[test]
    fn the_horizon_hides_exactly_what_the_earth_stands_before(
        lat_rad in any_lat(), lon_rad in -PI..PI, digits in 0.0f64..8.0, turn_rad in -PI..PI, way in 0.0f64..1.0,
        height_digits in -1.0f64..6.5, sunk_m in 0.0..12_000.0,
    ) {
        let eye = Geodetic { lat_rad, lon_rad, height_m: 10f64.powf(digits) };
        let (target, _) = eye.travel(turn_rad, way * way * 2e7);
        let target = target.at_height(10f64.powf(height_digits) - 0.1).to_ecef();
        let eye = eye.to_ecef();
        let hidden = HorizonCone::new(eye, sunk_m).hides(target);
        // Hidden means that the straight line meets the ground, all of which lies above −sunk_m.
        let depth = deepest_m(eye, target);
        prop_assert!(!hidden || depth < -sunk_m, "hidden, but the line comes no deeper than {depth} m");
        prop_assert!(hidden || depth > -sunk_m * 1.001 - 0.5, "seen, but the line comes as deep as {depth} m");
    }

    #[test]
    fn a_hidden_box_hides_all_that_is_in_it(
        bounds in any_bounds(), lat_rad in any_lat(), lon_rad in -PI..PI, digits in 0.0f64..8.0,
    ) {
        let eye = Geodetic { lat_rad, lon_rad, height_m: 10f64.powf(digits) }.to_ecef();
        let cone = HorizonCone::new(eye, 500.0);
        if cone.hides_box(&OrientedBox::around(&bounds, -100.0, 4000.0)) {
            for at in 0..64u32 {
                let (u, v) = (f64::from(at % 8) / 7.0, f64::from(at / 8) / 7.0);
                prop_assert!(deepest_m(eye, bounds.at(u, v, 4000.0).to_ecef()) < -500.0);
            }
        }
    }
}

/// Least height along the straight line between two points, by golden-section search.
fn deepest_m(from: Point<Ecef>, to: Point<Ecef>) -> f64 {
    let height_at = |t: f64| Geodetic::from_ecef(Point::new(from.xyz().lerp(to.xyz(), t))).height_m;
    let golden = (5f64.sqrt() - 1.0) / 2.0;
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..90 {
        let (a, b) = (high - golden * (high - low), low + golden * (high - low));
        if height_at(a) < height_at(b) {
            high = b;
        } else {
            low = a;
        }
    }
    height_at((low + high) / 2.0).min(height_at(0.0)).min(height_at(1.0))
}

#[test]
fn a_spherical_horizon_hides_what_can_be_seen() {
    // From 2 m above the sea at the pole towards a hill: a sphere of the equator's radius stands in the way.
    let eye = Geodetic::from_degrees(89.9, 0.0, 2.0).to_ecef();
    let hill = Geodetic::from_degrees(89.8, 0.0, 100.0).to_ecef();
    assert!(!HorizonCone::new(eye, 0.0).hides(hill));
    // The naive way finds the eye itself 21 km inside.
    assert!(eye.xyz().length() < SEMI_MAJOR_M - 20_000.0);
}

#[test]
fn vincenty_fails_near_antipodes_and_karney_does_not() {
    let (helsinki, boston) = (Geodetic::from_degrees(60.17, 24.94, 0.0), Geodetic::from_degrees(42.36, -71.06, 0.0));
    let near = vincenty_m(helsinki, boston).expect("far from antipodes it settles");
    assert!((Course::between(helsinki, boston).distance_m - near).abs() < 1e-3);
    // Karney 2013, §8: (−30°, 0°) to (29.9°, 179.8°).
    let (from, to) = (Geodetic::from_degrees(-30.0, 0.0, 0.0), Geodetic::from_degrees(29.9, 179.8, 0.0));
    let course = Course::between(from, to);
    assert!((course.distance_m - 19_989_832.827_610).abs() < 1e-6, "{}", course.distance_m);
    assert!((course.departure_rad.to_degrees() - 161.890_524_736_33).abs() < 1e-9);
    assert_eq!(vincenty_m(from, to), None);
    let (arrived, _) = from.travel(course.departure_rad, course.distance_m);
    assert!(arrived.to_ecef().distance_m(to.to_ecef()) < 1e-6);
}
