//! Footprints against the mesh that is drawn.

use super::*;
use crate::content::{ObjectMesh, ObjectPage};
use crate::forest::CellId;
use crate::geodesy::{ellipsoid_normal, meets_front};
use proptest::prelude::*;

/// A courtyard house: an outer ring with spikes and a square hole, in metres, its roof triangulated by hand.
fn courtyard(lat_rad: f64, lon_rad: f64, size_m: f64, cell: CellId) -> Prism {
    let frame = Geodetic { lat_rad, lon_rad, height_m: 20.0 }.ecef_from_enu();
    let corner = |[x, y]: [f64; 2]| {
        let place = Geodetic::from_ecef(frame * Point::new(DVec3::new(x * size_m, y * size_m, 0.0)));
        [place.lon_rad, place.lat_rad]
    };
    let outer = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(corner);
    let hole = [[-0.5, -0.5], [-0.5, 0.5], [0.5, 0.5], [0.5, -0.5]].map(corner);
    Prism {
        id: 0,
        cell,
        rings: vec![outer.to_vec(), hole.to_vec()],
        roof: vec![[0, 1, 7], [0, 7, 4], [1, 2, 6], [1, 6, 7], [2, 3, 5], [2, 5, 6], [3, 0, 4], [3, 4, 5]],
        base_m: 20.0,
        top_m: 45.0,
        foundation_m: 3.0,
        wall_color: [0; 3],
        roof_color: [0; 3],
        detail: None,
    }
}

fn page_at(lat_rad: f64, lon_rad: f64, size_m: f64) -> (ObjectPage, ObjectMesh) {
    let root = CellId::containing(lat_rad, lon_rad, 12);
    ObjectPage::from_prisms(root, 0, 0, 0.1, vec![courtyard(lat_rad, lon_rad, size_m, root)])
}

/// The nearest front of a mesh's triangles.
fn brute_force(page: &ObjectPage, mesh: &ObjectMesh, ray: &Ray, lift: DVec3) -> Option<f64> {
    let corner = |at: u32| {
        let position = DVec3::from(mesh.vertices[at as usize].position_m.map(f64::from));
        (page.origin - ray.origin).xyz() + position + lift
    };
    let triangles = mesh.indices.chunks_exact(3).map(|t| [corner(t[0]), corner(t[1]), corner(t[2])]);
    triangles.filter_map(|triangle| meets_front(ray.direction, triangle)).min_by(f64::total_cmp)
}

/// How much further the drawn mesh is met by rays beside this one, a metre for each metre aside; `None` where they miss it
/// or an edge is near.
fn slant(page: &ObjectPage, mesh: &ObjectMesh, ray: &Ray, lift: DVec3, distance_m: f64) -> Option<f64> {
    const ASIDE_M: f64 = 0.03;
    let (side, other) = ray.direction.any_orthonormal_pair();
    let further = [side, -side, other, -other].map(|aside| {
        let origin = Point::new(ray.origin.xyz() + aside * ASIDE_M);
        let beside_m = brute_force(page, mesh, &Ray { origin, ..*ray }, lift)?;
        Some((beside_m - distance_m).abs()).filter(|&further_m| further_m < 2.0)
    });
    further.into_iter().try_fold(0f64, |most_m, further_m| Some(most_m.max(further_m?))).map(|most_m| most_m / ASIDE_M)
}

proptest! {
    #[test]
    fn a_ray_meets_the_prism_where_it_is_drawn(
        lat in -89.0..89.0f64, lon in -180.0..180.0f64, size_m in 3.0..120.0f64,
        azimuth in 0.0..6.3f64, away in 1.2..6.0f64, up_m in -10.0..150.0f64, lift_m in 0.0..40.0f64,
        aim_x in -1.3..1.3f64, aim_y in -1.3..1.3f64, aim_m in -3.0..30.0f64,
    ) {
        let (lat_rad, lon_rad) = (lat.to_radians(), lon.to_radians());
        let (page, mesh) = page_at(lat_rad, lon_rad, size_m);
        let frame = Geodetic { lat_rad, lon_rad, height_m: 20.0 }.ecef_from_enu();
        let from = frame * Point::new(DVec3::new(azimuth.cos() * away * size_m, azimuth.sin() * away * size_m, up_m));
        let aim = frame * Point::new(DVec3::new(aim_x * size_m, aim_y * size_m, aim_m));
        let ray = Ray { origin: from, direction: (aim - from).xyz().normalize() };
        let lift = ellipsoid_normal(lat_rad, lon_rad) * lift_m;
        let (met, drawn) = (page.meet_ray(0, &ray, lift_m), brute_force(&page, &mesh, &ray, lift));
        let slant = drawn.and_then(|drawn| slant(&page, &mesh, &ray, lift, drawn));
        match (met, drawn) {
            (Some(met), Some(drawn)) => {
                // Half the mesh's rounding against its origin, and the tangent plane, along a ray at a slant.
                let off_m = (met - drawn).abs();
                prop_assert!(slant.is_none_or(|slant| off_m < 0.02 * (1.0 + slant)), "{met} {drawn} {slant:?}");
            }
            (None, Some(_)) => prop_assert!(slant.is_none()),
            (Some(met), None) => {
                let (side, other) = ray.direction.any_orthonormal_pair();
                let near = [side, -side, other, -other].into_iter().any(|aside| {
                    let origin = Point::new(ray.origin.xyz() + aside * 0.05);
                    brute_force(&page, &mesh, &Ray { origin, ..ray }, lift).is_some()
                });
                prop_assert!(near, "met nothing drawn at {met}");
            }
            _ => {}
        }
        if let Some(met) = met {
            let (center, radius_m) = page.object_ball(0).unwrap();
            prop_assert!(ray.at(met).distance_m(Point::new(center.xyz() + lift)) <= radius_m);
        }
    }

    #[test]
    fn a_footprint_holds_what_lies_in_it_or_within_the_margin(
        lat in -89.9..89.9f64, lon in -180.0..180.0f64, size_m in 3.0..200.0f64,
        x in -1.5..1.5f64, y in -1.5..1.5f64, margin_m in 0.0..3.0f64, height_m in -100.0..1000.0f64,
    ) {
        let (lat_rad, lon_rad) = (lat.to_radians(), lon.to_radians());
        let (page, _) = page_at(lat_rad, lon_rad, size_m);
        let frame = Geodetic { lat_rad, lon_rad, height_m: 20.0 }.ecef_from_enu();
        let (x_m, y_m) = (x * size_m, y * size_m);
        let mut there = Geodetic::from_ecef(frame * Point::new(DVec3::new(x_m, y_m, 0.0)));
        there.height_m = height_m;
        // Signed distance to squares: negative inside.
        let to_square = |half_m: f64| {
            let (dx, dy) = (x_m.abs() - half_m, y_m.abs() - half_m);
            if dx.max(dy) < 0.0 { dx.max(dy) } else { dx.max(0.0).hypot(dy.max(0.0)) }
        };
        let away_m = to_square(size_m).max(-to_square(size_m / 2.0));
        // From inside the hole the nearest wall is straight ahead.
        prop_assume!((away_m - margin_m).abs() > 0.02);
        prop_assert_eq!(page.footprint_holds(0, there.lat_rad, there.lon_rad, margin_m), away_m < margin_m);
        prop_assert!(!page.footprint_holds(0, -there.lat_rad, there.lon_rad + std::f64::consts::PI, margin_m));
    }
}

#[test]
fn degenerate_rings_hold_nothing_and_stop_nothing() {
    let root = CellId::containing(1.0, 0.4, 12);
    let mut prism = courtyard(1.0, 0.4, 10.0, root);
    let at = [0.4, 1.0];
    for rings in [vec![], vec![vec![]], vec![vec![at]], vec![vec![at; 5]], vec![vec![at, [0.400001, 1.0], at]]] {
        prism.rings = rings;
        prism.roof = Vec::new();
        let (page, _) = ObjectPage::from_prisms(root, 0, 0, 0.0, vec![prism.clone()]);
        assert!(!page.footprint_holds(0, 1.0, 0.4 + 1e-9, 0.0));
        let above = Geodetic { lat_rad: 1.0, lon_rad: 0.4 + 1e-9, height_m: 100.0 };
        let ray = Ray { origin: above.to_ecef(), direction: -above.up() };
        assert_eq!(page.meet_ray(0, &ray, 0.0), None);
    }
    let (page, _) = page_at(1.0, 0.4, 10.0);
    assert!(!page.footprint_holds(7, 1.0, 0.4, 1e9));
    let ray = Ray { origin: page.origin, direction: DVec3::X };
    assert_eq!(page.meet_ray(7, &ray, 0.0), None);
}

#[test]
fn one_of_several_objects_answers_with_its_own_rings() {
    let root = CellId::containing(1.0, 0.4, 12);
    let mut prisms: Vec<_> = (0..4).map(|n| courtyard(1.0, 0.4 + f64::from(n) * 2e-5, 10.0, root)).collect();
    prisms[1].rings.pop();
    prisms[1].roof = vec![[0, 1, 2], [0, 2, 3]];
    let (page, mesh) = ObjectPage::from_prisms(root, 0, 0, 0.0, prisms);
    for n in 0..4 {
        let lon_rad = 0.4 + n as f64 * 2e-5;
        let at_place: Vec<_> = (0..4).filter(|&which| page.footprint_holds(which, 1.0, lon_rad, 0.0)).collect();
        // Only the one without a courtyard stands in its middle.
        assert_eq!(at_place, if n == 1 { vec![1] } else { vec![] });
        let near: Vec<_> = (0..4).filter(|&which| page.footprint_holds(which, 1.0, lon_rad, 6.0)).collect();
        assert_eq!(near, [n]);
        let above = Geodetic { lat_rad: 1.0, lon_rad, height_m: 400.0 };
        let ray = Ray { origin: above.to_ecef(), direction: -above.up() };
        let met: Vec<_> = (0..4).filter_map(|which| page.meet_ray(which, &ray, 0.0)).collect();
        let drawn: Vec<_> = brute_force(&page, &mesh, &ray, DVec3::ZERO).into_iter().collect();
        assert_eq!((met.len(), drawn.len()), (usize::from(n == 1), usize::from(n == 1)));
    }
    assert!(page.byte_len() > ObjectPage { footprints: Footprints::default(), ..page.clone() }.byte_len());
}
