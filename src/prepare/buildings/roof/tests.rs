use super::*;
use crate::prepare::buildings::clean::clean;
use proptest::prelude::*;
use serde_json::json;
use std::collections::HashMap;

/// Metres about (8°E, 47°N) as a sound footprint.
fn footprint(rings: &[Vec<[f64; 2]>]) -> Footprint {
    let plane = Plane::about([8f64.to_radians(), 47f64.to_radians()]);
    let degrees = |p: &[f64; 2]| plane.back(Coord { x: p[0], y: p[1] }).map(f64::to_degrees);
    let rings = rings.iter().map(|ring| ring.iter().map(degrees).collect()).collect();
    clean(&[rings], &mut BTreeSet::new()).unwrap().remove(0)
}

/// A rectangle of 20 × 10 m, turned by 30°.
fn rectangle() -> Footprint {
    let turned = |x: f64, y: f64| {
        let (sin, cos) = 30f64.to_radians().sin_cos();
        [cos * x - sin * y, sin * x + cos * y]
    };
    footprint(&[vec![turned(0.0, 0.0), turned(20.0, 0.0), turned(20.0, 10.0), turned(0.0, 10.0)]])
}

fn rule(attributes: Value) -> RoofRule {
    let attributes = attributes.as_object().unwrap();
    let shape = RoofShape::parse(attributes["roof:shape"].as_str().unwrap()).unwrap();
    RoofRule::new(shape, attributes)
}

/// Corners in local metres, heights as they are.
fn local(detail: &Detail, footprint: &Footprint) -> Vec<DVec3> {
    let plane = plane(footprint);
    let corner = |corner: &DetailCorner| {
        let flat = plane.to([corner.lon_rad, corner.lat_rad]);
        DVec3::new(flat.x, flat.y, f64::from(corner.height_m))
    };
    detail.corners.iter().map(corner).collect()
}

/// Volume above the foot; faces there are left out, and add nothing.
fn volume_m3(detail: &Detail, footprint: &Footprint, foot_m: f64) -> f64 {
    let corners = local(detail, footprint);
    let triangles = detail.groups.iter().flat_map(|group| &group.triangles);
    let from = DVec3::new(0.0, 0.0, foot_m);
    triangles.map(|t| t.map(|at| corners[at as usize] - from)).map(|[a, b, c]| a.dot(b.cross(c)) / 6.0).sum()
}

/// Every edge is there once each way, but for those along the foot.
fn assert_watertight(detail: &Detail, foot_m: f64) {
    let mut edges: HashMap<(u32, u32), i32> = HashMap::new();
    for triangle in detail.groups.iter().flat_map(|group| &group.triangles) {
        for (a, b) in [(0, 1), (1, 2), (2, 0)].map(|(a, b)| (triangle[a], triangle[b])) {
            *edges.entry((a.min(b), a.max(b))).or_default() += if a < b { 1 } else { -1 };
        }
    }
    let low = |at: u32| (f64::from(detail.corners[at as usize].height_m) - foot_m).abs() < 1e-3;
    for ((a, b), sum) in edges {
        assert!(
            sum == 0 || low(a) && low(b),
            "{:?} {:?} {sum}",
            detail.corners[a as usize],
            detail.corners[b as usize]
        );
    }
}

/// Volume of a dome of six bands over that of the block round it: frusta of similar outlines.
fn dome_share() -> f64 {
    let angle = |at: u32| f64::from(at) * std::f64::consts::FRAC_PI_2 / 6.0;
    let band = |at: u32| {
        let ((s0, c0), (s1, c1)) = (angle(at).sin_cos(), angle(at + 1).sin_cos());
        (s1 - s0) * (c0 * c0 + c0 * c1 + c1 * c1) / 3.0
    };
    (0..6).map(band).sum()
}

#[test]
fn known_shapes_have_their_volumes() {
    // Walls of 6 m under a roof of 4 m on 20 × 10 m; the rest is the roof's own volume.
    let dome = 20.0 * 10.0 * 4.0 * dome_share();
    let cases = [
        ("gabled", 20.0 * 10.0 * 4.0 / 2.0),
        ("hipped", 10.0 * 10.0 * 4.0 / 2.0 + 10.0 * 10.0 * 4.0 / 3.0),
        ("pyramidal", 20.0 * 10.0 * 4.0 / 3.0),
        ("skillion", 20.0 * 10.0 * 4.0 / 2.0),
        // The ends from half way up: two quarters of the pyramid that a hip takes away.
        ("half-hipped", 20.0 * 10.0 * 4.0 / 2.0 - 2.0 * (10.0 / 2.0 * 2.0 / 2.0) * 2.5 / 3.0),
        ("gambrel", 20.0 * 2.0 * (1.75 * 2.8 / 2.0 + 3.25 * (2.8 + 4.0) / 2.0)),
        ("round", 20.0 * 4.0 * 5.0 * 4.0 * (std::f64::consts::PI / 8.0).sin()),
        ("dome", dome),
    ];
    let footprint = rectangle();
    for (shape, expected) in cases {
        let detail = rule(json!({ "roof:shape": shape })).detail(&footprint, 100.0, 106.0, 110.0).unwrap();
        assert_watertight(&detail, 100.0);
        let (low, high) = detail.height_range_m().unwrap();
        assert_eq!((low, high), (100.0, 110.0), "{shape}");
        let roof_m3 = volume_m3(&detail, &footprint, 100.0) - 1200.0;
        assert!((roof_m3 - expected).abs() < 0.5, "{shape}: {roof_m3} {expected}");
    }
    for shape in ["mansard", "onion"] {
        let detail = rule(json!({ "roof:shape": shape })).detail(&footprint, 100.0, 106.0, 110.0).unwrap();
        assert_watertight(&detail, 100.0);
        assert_eq!(detail.height_range_m(), Some((100.0, 110.0)), "{shape}");
    }
    assert!(rule(json!({ "roof:shape": "flat" })).detail(&footprint, 100.0, 106.0, 110.0).is_none());
    assert_eq!(RoofShape::parse("sawtooth"), None);
}

/// Heights of the highest corners, and where they lie from the first, metres.
fn highest(detail: &Detail, footprint: &Footprint) -> Vec<DVec3> {
    let corners = local(detail, footprint);
    let top = corners.iter().map(|corner| corner.z).fold(f64::MIN, f64::max);
    corners.into_iter().filter(|corner| top - corner.z < 1e-3).collect()
}

#[test]
fn ridges_run_and_roofs_slope_as_the_tags_say() {
    let plain = footprint(&[vec![[0.0, 0.0], [20.0, 0.0], [20.0, 10.0], [0.0, 10.0]]]);
    let ridge = |attributes: Value| {
        let detail = rule(attributes).detail(&plain, 0.0, 6.0, 10.0).unwrap();
        let ridge = highest(&detail, &plain);
        let (first, last) = (ridge[0], ridge[ridge.len() - 1]);
        (last - first).abs()
    };
    assert!(ridge(json!({ "roof:shape": "gabled" })).x > 19.9);
    assert!(ridge(json!({ "roof:shape": "gabled", "roof:orientation": "across" })).y > 9.9);
    assert!(ridge(json!({ "roof:shape": "gabled", "roof:direction": "E" })).y > 9.9);
    assert!(ridge(json!({ "roof:shape": "gabled", "roof:direction": 170 })).x > 19.9);
    // Down to the south: the north side is high.
    for direction in [json!("S"), json!("180"), json!(180)] {
        let rule = rule(json!({ "roof:shape": "skillion", "roof:direction": direction }));
        let top = highest(&rule.detail(&plain, 0.0, 6.0, 10.0).unwrap(), &plain);
        assert!(top.iter().all(|corner| (corner.y - 10.0).abs() < 0.01), "{top:?}");
    }
}

#[test]
fn heights_come_from_the_first_tag_that_says() {
    let footprint = rectangle();
    let height = |attributes: Value| {
        let mut notes = BTreeSet::new();
        (rule(attributes).height_m(&footprint, 10.0, &mut notes), notes.len())
    };
    let near = |(height_m, notes): (f64, usize), expected: f64, count: usize| {
        assert!((height_m - expected).abs() < 0.01 && notes == count, "{height_m} {expected}");
    };
    near(height(json!({ "roof:shape": "gabled", "roof:height": "3.5 m", "roof:levels": 1 })), 3.5, 0);
    near(height(json!({ "roof:shape": "gabled", "roof:levels": "2" })), 6.4, 0);
    near(height(json!({ "roof:shape": "gabled", "roof:angle": 45 })), 5.0, 0);
    near(height(json!({ "roof:shape": "skillion", "roof:angle": 45 })), 10.0, 0);
    near(height(json!({ "roof:shape": "gabled" })), 5.0 * RISE, 1);
    near(height(json!({ "roof:shape": "dome" })), 5.0, 1);
}

/// An L, a courtyard, a star and a triangle.
fn odd_footprints() -> Vec<Footprint> {
    let star = (0..10).map(|at| {
        let (sin, cos) = (f64::from(at) * std::f64::consts::TAU / 10.0).sin_cos();
        let radius = if at % 2 == 0 { 12.0 } else { 5.0 };
        [20.0 + radius * cos, 20.0 + radius * sin]
    });
    vec![
        footprint(&[vec![[0.0, 0.0], [20.0, 0.0], [20.0, 8.0], [8.0, 8.0], [8.0, 15.0], [0.0, 15.0]]]),
        footprint(&[
            vec![[0.0, 0.0], [30.0, 0.0], [30.0, 20.0], [0.0, 20.0]],
            vec![[10.0, 7.0], [10.0, 13.0], [20.0, 13.0], [20.0, 7.0]],
        ]),
        footprint(&[star.collect()]),
        footprint(&[vec![[0.0, 0.0], [9.0, 2.0], [3.0, 11.0]]]),
    ]
}

proptest! {
    #[test]
    fn any_shape_on_any_outline_is_watertight_and_within_it(
        which in 0..4usize, shape in 0..10usize, height_m in 0.2..9.0f64, direction in 0..360u32, across: bool,
    ) {
        const SHAPES: [&str; 10] = [
            "gabled", "hipped", "half-hipped", "pyramidal", "skillion", "gambrel", "mansard", "round", "dome", "onion",
        ];
        let footprint = &odd_footprints()[which];
        let orientation = if across { "across" } else { "along" };
        let attributes = json!({
            "roof:shape": SHAPES[shape], "roof:direction": direction, "roof:orientation": orientation,
        });
        let Some(detail) = rule(attributes).detail(footprint, 50.0, 60.0, 60.0 + height_m) else {
            // Only domes over outlines that their middle does not see are not drawn.
            prop_assert!(shape >= 8 && which < 2);
            return Ok(());
        };
        assert_watertight(&detail, 50.0);
        let (low, high) = detail.height_range_m().unwrap();
        prop_assert!(low == 50.0 && f64::from(high) <= 60.0 + height_m + 1e-3);
        let volume = volume_m3(&detail, footprint, 50.0);
        prop_assert!(volume > 10.0 * footprint.area_m2 * 0.999, "{volume}");
        prop_assert!(shape == 9 || volume < (10.0 + height_m) * footprint.area_m2 * 1.001, "{volume}");
        // The roof covers the outline once.
        if shape < 9 {
            let corners = local(&detail, footprint);
            let roof = detail.groups.iter().filter(|group| group.kind == FaceKind::Roof).flat_map(|g| &g.triangles);
            let roof = roof.map(|t| t.map(|at| corners[at as usize].truncate()));
            let area: f64 = roof.map(|[a, b, c]| (b - a).perp_dot(c - a) / 2.0).sum();
            prop_assert!((area / footprint.area_m2 - 1.0).abs() < 1e-3, "{area} {}", footprint.area_m2);
        }
    }
}
