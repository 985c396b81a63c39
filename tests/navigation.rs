//! The controller, driven as hands drive it over scenes in closed form.

mod analytic;

use analytic::{Building, Mountain, Scene, ray_ellipsoid};
use proptest::prelude::*;
use std::f64::consts::PI;
use stoop::camera::{
    Button, Destination, EYE_OVER_GROUND_M, Held, MAX_HEIGHT_M, MAX_HEIGHTS_PER_S, NavInput, Navigator, Pose,
    Surroundings, View,
};
use stoop::geodesy::{Course, Ecef, Geodetic, Point};

const SIZE_PX: [u32; 2] = [1280, 720];
const FOV_RAD: f64 = PI / 3.0;
const FRAME_S: f64 = 1.0 / 60.0;

fn pose(lat_deg: f64, lon_deg: f64, height_m: f64, heading_deg: f64, pitch_deg: f64) -> Pose {
    Pose {
        eye: Geodetic::from_degrees(lat_deg, lon_deg, height_m),
        heading_rad: heading_deg.to_radians(),
        pitch_rad: pitch_deg.to_radians(),
    }
}

fn is_finite(pose: Pose) -> bool {
    [pose.eye.lat_rad, pose.eye.lon_rad, pose.eye.height_m, pose.heading_rad, pose.pitch_rad]
        .iter()
        .all(|number| number.is_finite())
}

/// How far a point is drawn from a pixel.
fn off_px(view: &View, point: Point<Ecef>, at_px: [f64; 2]) -> f64 {
    view.project_px(point).map_or(f64::INFINITY, |px| (px[0] - at_px[0]).hypot(px[1] - at_px[1]))
}

/// Angle between what two views look at, radians.
fn turn_rad(a: &View, b: &View) -> f64 {
    a.forward().angle_between(b.forward())
}

/// A hand at a controller, with its clock.
struct Hand<'a> {
    navigator: Navigator,
    scene: &'a Scene,
    now_s: f64,
}

impl<'a> Hand<'a> {
    fn new(scene: &'a Scene, from: Pose) -> Self {
        let mut hand = Self { navigator: Navigator::new(from, from, FOV_RAD), scene, now_s: 100.0 };
        hand.frame();
        hand
    }

    fn input(&mut self, input: NavInput) {
        self.navigator.input(input, self.now_s, SIZE_PX, self.scene);
    }

    fn frame(&mut self) -> View {
        self.now_s += FRAME_S;
        self.navigator.step(self.now_s, SIZE_PX, self.scene)
    }

    fn frames(&mut self, count: usize) {
        for _ in 0..count {
            self.frame();
        }
    }

    fn at(&mut self, at_px: [f64; 2]) -> View {
        self.input(NavInput::PointerMoved(at_px));
        self.frame()
    }

    fn press(&mut self, button: Button, at_px: [f64; 2]) {
        self.input(NavInput::PointerMoved(at_px));
        self.input(NavInput::Pressed(button));
    }

    fn view(&self) -> View {
        View::new(self.navigator.pose(), FOV_RAD, SIZE_PX)
    }

    fn picked(&self, at_px: [f64; 2]) -> Option<Point<Ecef>> {
        self.scene.pick(&self.view(), at_px)
    }

    fn pose(&self) -> Pose {
        self.navigator.pose()
    }

    /// Frames until nothing moves; panics where that takes more than `limit_s`.
    fn rest(&mut self, limit_s: f64) {
        let end_s = self.now_s + limit_s;
        while self.navigator.is_moving() {
            assert!(self.now_s < end_s, "still moving at {:?}", self.pose());
            self.frame();
        }
    }
}

/// A pixel whose ray meets the ground well inside the globe's edge: the most upper one on the middle column.
fn grabbable(hand: &Hand) -> Option<[f64; 2]> {
    (0..36).map(|row| [640.0, 10.0 + 20.0 * f64::from(row)]).find(|&at_px| is_held(&hand.view(), at_px))
}

/// Whether the ray of a pixel meets the globe with the eye more than 10 degrees over the horizon there.
fn is_held(view: &View, at_px: [f64; 2]) -> bool {
    let scene = Scene::default();
    scene.pick(view, at_px).is_some_and(|point| {
        let to_eye = (view.eye() - point).xyz().normalize();
        to_eye.dot(Geodetic::from_ecef(point).up()) > 10f64.to_radians().sin()
    })
}

/// Cursors of a drag: a small spiral, in steps of at most 12 px.
fn spiral(from_px: [f64; 2]) -> impl Iterator<Item = [f64; 2]> {
    (1..=60).map(move |step| {
        let (angle, radius) = (f64::from(step) * 0.2, f64::from(step) * 0.9);
        [from_px[0] + radius * angle.sin(), from_px[1] + radius * (1.0 - angle.cos())]
    })
}

#[test]
fn the_grabbed_point_stays_under_the_cursor() {
    let (mut held, mut free) = (0, 0);
    for height_m in [1e7, 1e4, 10.0] {
        for (lat_deg, lon_deg) in [(0.0, 10.0), (45.0, 180.0), (-45.0, -179.999_999), (89.9, 3.0), (90.0 - 1e-6, 0.0)] {
            for pitch_deg in [-90.0, -45.0, -20.0] {
                for heading_deg in [0.0, 77.0, 200.0] {
                    let scene = Scene::default();
                    let from = pose(lat_deg, lon_deg, height_m, heading_deg, pitch_deg);
                    let mut hand = Hand::new(&scene, from);
                    let Some(start_px) = grabbable(&hand) else {
                        free += 1;
                        continue;
                    };
                    hand.press(Button::Left, start_px);
                    let point = hand.picked(start_px).unwrap();
                    for at_px in spiral(start_px) {
                        let before = hand.view();
                        let view = hand.at(at_px);
                        assert!(is_finite(view.pose));
                        if is_held(&before, at_px) {
                            held += 1;
                            let off = off_px(&view, point, at_px);
                            assert!(off < 1.0, "{from:?}: {off} px off at {at_px:?}: {:?}", view.pose);
                        }
                        assert!((view.pose.eye.height_m - height_m).abs() < 1e-6, "the height stays");
                        assert_eq!(view.pose.pitch_rad, from.pitch_rad, "the pitch stays");
                    }
                }
            }
        }
    }
    assert!(held > 5000 && free < 20, "held {held}, {free} poses see no ground");
}

#[test]
fn a_drag_passes_the_pole_and_the_antimeridian() {
    let scene = Scene::default();
    for (lat_deg, lon_deg, heading_deg) in [(89.999, 20.0, 0.0), (10.0, 179.999, 90.0)] {
        let mut hand = Hand::new(&scene, pose(lat_deg, lon_deg, 1000.0, heading_deg, -90.0));
        let start = hand.pose();
        hand.press(Button::Left, [640.0, 60.0]);
        let point = hand.picked([640.0, 60.0]).unwrap();
        for step in 1..=60 {
            let at_px = [640.0, 60.0 + 10.0 * f64::from(step)];
            let before = hand.view();
            let view = hand.at(at_px);
            assert!(off_px(&view, point, at_px) < 1.0);
            let moved_m = before.eye().distance_m(view.eye());
            assert!(moved_m < 30.0, "no jump: {moved_m} m");
            assert!(turn_rad(&before, &view) < 1e-4);
        }
        let end = hand.pose();
        let lon_apart = (end.eye.lon_rad - start.eye.lon_rad).abs();
        assert!(lon_apart > 3.0, "the other side is reached: {end:?}");
    }
}

#[test]
fn a_grab_beside_the_globe_turns_the_view_and_a_lost_one_stays_on_the_edge() {
    let scene = Scene::default();
    let mut hand = Hand::new(&scene, pose(40.0, 20.0, 3000.0, 30.0, -10.0));
    let up_px = [700.0, 80.0];
    assert!(hand.picked(up_px).is_none());
    hand.press(Button::Left, up_px);
    let direction = {
        let view = hand.view();
        let local = glam::DVec3::new(60.0, 280.0, -view.focal_px()).normalize();
        Point::new(view.eye().xyz() + view.ecef_from_view().rotation() * local * 1e6)
    };
    for at_px in spiral(up_px) {
        let view = hand.at(at_px);
        assert!(off_px(&view, direction, at_px) < 0.01);
        assert_eq!(view.pose.eye, hand.pose().eye);
    }

    let mut hand = Hand::new(&scene, pose(0.0, 0.0, 1e7, 0.0, -90.0));
    hand.press(Button::Left, [640.0, 360.0]);
    let point = hand.picked([640.0, 360.0]).unwrap();
    for step in 0..60 {
        hand.at([640.0 + 10.0 * f64::from(step), 360.0]);
    }
    let view = hand.frame();
    let px = view.project_px(point).unwrap();
    let edge_px = view.focal_px() * (6_378_137.0f64 / 16_378_137.0).asin().tan();
    assert!((px[1] - 360.0).abs() < 2.0 && (px[0] - 640.0 - edge_px).abs() < 2.0, "{px:?}, edge {edge_px}");
    // Back on the globe it is held again.
    hand.at([700.0, 300.0]);
    hand.rest(0.2);
    assert!(off_px(&hand.view(), point, [700.0, 300.0]) < 1.0);
}

#[test]
fn a_grab_at_the_horizon_does_not_fling_the_eye() {
    let scene = Scene::default();
    let mut hand = Hand::new(&scene, pose(0.0, 0.0, 10.0, 0.0, -5.0));
    // 2.4 degrees below the horizon: 240 m away.
    let start_px = [640.0, 332.0];
    hand.press(Button::Left, start_px);
    let point = hand.picked(start_px).unwrap();
    let mut fastest: f64 = 0.0;
    for step in 1..=25 {
        let before = hand.view().eye();
        let view = hand.at([640.0, 332.0 + 12.0 * f64::from(step)]);
        fastest = fastest.max(before.distance_m(view.eye()) / FRAME_S / 10.0);
    }
    assert!(fastest <= MAX_HEIGHTS_PER_S * 1.01 && fastest > 20.0, "{fastest} heights per second");
    hand.rest(5.0);
    assert!(off_px(&hand.view(), point, [640.0, 632.0]) < 1.0, "it catches up");
}

#[test]
fn the_wheel_keeps_the_point_under_the_cursor() {
    let mut zooms = 0;
    for height_m in [1e7, 1e4, 10.0] {
        for (lat_deg, lon_deg) in [(0.0, 10.0), (45.0, 180.0), (89.9, 3.0), (90.0 - 1e-6, 0.0)] {
            for pitch_deg in [-90.0, -45.0, -20.0] {
                let scene = Scene::default();
                let from = pose(lat_deg, lon_deg, height_m, 77.0, pitch_deg);
                let mut hand = Hand::new(&scene, from);
                let Some([_, row_px]) = grabbable(&hand) else { continue };
                let at_px = [560.0, (row_px + 40.0).max(250.0)];
                let Some(point) = hand.picked(at_px).filter(|_| is_held(&hand.view(), at_px)) else { continue };
                hand.input(NavInput::PointerMoved(at_px));
                hand.input(NavInput::Wheel { notches: 3.0 });
                while hand.navigator.is_moving() {
                    let view = hand.frame();
                    let off = off_px(&view, point, at_px);
                    assert!(off < 1.0, "{from:?}: {off} px off");
                    assert!(hand.now_s < 102.0);
                }
                let want_m = height_m * 0.8f64.powi(3);
                assert!((hand.pose().eye.height_m / want_m - 1.0).abs() < 0.01, "{from:?}: {:?}", hand.pose());
                zooms += 1;
            }
        }
    }
    assert!(zooms > 20, "{zooms}");
}

#[test]
fn zooming_is_bounded() {
    let scene = Scene::flat(300.0);
    let mut hand = Hand::new(&scene, pose(20.0, 10.0, 1e5, 0.0, -60.0));
    hand.input(NavInput::PointerMoved([700.0, 380.0]));
    for notches in [8.0, -15.0] {
        for _ in 0..120 {
            hand.input(NavInput::Wheel { notches });
            for _ in 0..3 {
                let before_m = hand.pose().eye.height_m - 300.0;
                let pose = hand.frame().pose;
                let over_m = pose.eye.height_m - 300.0;
                assert!(is_finite(pose) && over_m > 2.0 - 1e-6 && pose.eye.height_m <= MAX_HEIGHT_M, "{pose:?}");
                assert!((over_m / before_m).ln().abs() < 5.0 * FRAME_S * 1.2, "{before_m} to {over_m}");
            }
        }
        hand.rest(2.0);
        let height_m = hand.pose().eye.height_m;
        if notches > 0.0 {
            assert!(height_m < 310.0, "down at the ground: {height_m}");
        } else {
            assert!(height_m > 0.9 * MAX_HEIGHT_M, "up at the limit: {height_m}");
            // The point zoomed about is at the globe's edge by now, and still where the cursor is.
            let near = (-4..=4).any(|row| hand.picked([700.0, 380.0 + 10.0 * f64::from(row)]).is_some());
            assert!(near, "the Earth is still in the picture: {:?}", hand.pose());
        }
    }
}

#[test]
fn a_wheel_over_the_sky_zooms_about_the_middle_or_straight_up() {
    let scene = Scene::default();
    let mut hand = Hand::new(&scene, pose(0.0, 0.0, 3e7, 0.0, -90.0));
    let middle = hand.picked([640.0, 360.0]).unwrap();
    hand.input(NavInput::PointerMoved([20.0, 20.0]));
    hand.input(NavInput::Wheel { notches: 2.0 });
    hand.rest(2.0);
    assert!(off_px(&hand.view(), middle, [640.0, 360.0]) < 1.0);
    assert!((hand.pose().eye.height_m / 3e7 / 0.64 - 1.0).abs() < 0.01);
    let mut hand = Hand::new(&scene, pose(30.0, 0.0, 3000.0, 0.0, 60.0));
    hand.input(NavInput::Wheel { notches: -1.0 });
    hand.rest(2.0);
    assert!((hand.pose().eye.height_m - 3750.0).abs() < 1.0);
    assert!(Course::between(hand.pose().eye, Geodetic::from_degrees(30.0, 0.0, 0.0)).distance_m < 1e-3);
}

#[test]
fn orbiting_keeps_the_middle_and_its_distance() {
    for (lat_deg, height_m, pitch_deg) in
        [(0.0, 1e7, -90.0), (45.0, 1e6, -80.0), (60.0, 1e4, -45.0), (89.999, 500.0, -30.0), (10.0, 10.0, -90.0)]
    {
        for button in [Button::Right, Button::Middle] {
            let scene = Scene::default();
            let mut hand = Hand::new(&scene, pose(lat_deg, 179.999, height_m, 40.0, pitch_deg));
            let pivot = hand.picked([640.0, 360.0]).unwrap();
            let distance_m = hand.view().eye().distance_m(pivot);
            let first = hand.view();
            hand.press(button, [640.0, 360.0]);
            assert!(turn_rad(&first, &hand.frame()) < 1e-6, "a press alone moves nothing");
            let mut turned: f64 = 0.0;
            for step in 1..=80 {
                let before = hand.view();
                let angle = f64::from(step) * 0.08;
                let view = hand.at([640.0 + 250.0 * angle.sin(), 360.0 - 200.0 * (1.0 - angle.cos())]);
                assert!(off_px(&view, pivot, [640.0, 360.0]) < 1.0, "{:?}", view.pose);
                assert!((view.eye().distance_m(pivot) / distance_m - 1.0).abs() < 1e-6);
                let up = Geodetic::from_ecef(pivot).up();
                let sine = up.dot((view.eye() - pivot).xyz().normalize());
                assert!(sine > 0.9f64.to_radians().sin(), "the eye is over the horizon");
                assert!(scene.depth_m(view.pose) < 1e-5);
                let turn = turn_rad(&before, &view);
                assert!(turn < 0.3, "no jump: {turn}");
                turned += turn;
            }
            assert!(turned > 0.5, "the drag turned: {turned}");
        }
    }
}

#[test]
fn orbiting_without_ground_in_the_middle_turns_the_eye() {
    let scene = Scene::default();
    let mut hand = Hand::new(&scene, pose(0.0, 0.0, 100.0, 0.0, 20.0));
    hand.press(Button::Right, [640.0, 360.0]);
    hand.at([700.0, 330.0]);
    let turned = hand.pose();
    assert!(turned.heading_rad < -0.05 && turned.pitch_rad < 20f64.to_radians() - 0.02, "{turned:?}");
    assert!(turned.eye.to_ecef().distance_m(pose(0.0, 0.0, 100.0, 0.0, 0.0).eye.to_ecef()) < 1e-6);
}

#[test]
fn coasting_runs_on_and_ends() {
    let scene = Scene::default();
    for button in [Button::Left, Button::Right] {
        let mut hand = Hand::new(&scene, pose(30.0, 0.0, 5000.0, 0.0, -60.0));
        hand.press(button, [500.0, 400.0]);
        for step in 1..=20 {
            hand.at([500.0 + 8.0 * f64::from(step), 400.0]);
        }
        hand.input(NavInput::Released(button));
        assert!(hand.navigator.is_moving());
        let start = hand.view();
        let first_m = start.eye().distance_m(hand.frame().eye());
        hand.rest(3.0);
        let end = hand.view();
        assert!(start.eye().distance_m(end.eye()) > 5.0 * first_m, "it runs on");
        for _ in 0..10 {
            assert_eq!(hand.frame().pose, end.pose, "it has ended");
        }
        // A hand that rests before it lets go leaves nothing running.
        hand.press(button, [500.0, 400.0]);
        hand.at([560.0, 400.0]);
        for _ in 0..10 {
            hand.frame();
        }
        hand.input(NavInput::Released(button));
        assert!(!hand.navigator.is_moving());
    }
}

#[test]
fn a_press_a_wheel_a_key_and_stop_end_what_runs() {
    let scene = Scene::default();
    let there = Destination::new(pose(31.0, 1.0, 2000.0, 0.0, -45.0));
    for end in [
        NavInput::Pressed(Button::Left),
        NavInput::Pressed(Button::Right),
        NavInput::Wheel { notches: 1.0 },
        NavInput::Hold(Held::Forward, true),
        NavInput::Stop,
    ] {
        let mut hand = Hand::new(&scene, pose(30.0, 0.0, 5000.0, 0.0, -60.0));
        hand.input(NavInput::PointerMoved([640.0, 400.0]));
        hand.input(NavInput::FlyTo(there));
        for _ in 0..20 {
            hand.frame();
        }
        assert!(hand.navigator.flight().is_some());
        hand.input(end);
        assert!(hand.navigator.flight().is_none(), "{end:?}");
        hand.input(NavInput::Unfocused);
        hand.rest(2.0);
    }
}

/// Flies there; checks the path and gives the least height over what stands below.
fn flown(scene: &Scene, from: Pose, to: Pose) -> f64 {
    let mut hand = Hand::new(scene, from);
    hand.input(NavInput::FlyTo(Destination::new(to)));
    let flight = hand.navigator.flight().cloned().expect("a flight");
    let length_s = flight.end_s() - flight.start_s();
    assert!((1.5..=8.0).contains(&length_s));
    let mut least_m = f64::INFINITY;
    let mut before = hand.view();
    while hand.navigator.is_moving() {
        let view = hand.frame();
        assert!(is_finite(view.pose));
        let told = flight.pose_at(hand.now_s);
        assert!(told.eye.to_ecef().distance_m(view.eye()) < 1e-6, "the path is known from the start");
        let height_m = (before.pose.eye.height_m - scene.ground_at(before.pose.eye)).max(2.0);
        let speed = before.eye().distance_m(view.eye()) / FRAME_S / height_m;
        assert!(speed < 20.0, "{speed} heights per second at {:?}", view.pose);
        assert!(turn_rad(&before, &view) < 0.2, "{:?}", view.pose);
        least_m = least_m.min(-scene.depth_m(view.pose));
        before = view;
    }
    assert_eq!(hand.pose(), to);
    assert!(!hand.navigator.is_moving());
    least_m
}

#[test]
fn flights_are_smooth_and_end_at_their_pose() {
    let scene = Scene::flat(20.0);
    let helsinki = pose(60.17, 24.94, 300.0, 30.0, -30.0);
    let cases = [
        (pose(0.0, 0.0, 1.5e7, 0.0, -90.0), helsinki),
        (helsinki, pose(37.81, -122.48, 600.0, 330.0, -20.0)),
        (helsinki, pose(-60.17, -155.06, 300.0, 0.0, -60.0)),
        (pose(10.0, 179.9, 100.0, 90.0, -10.0), pose(10.0, -179.9, 50.0, 80.0, -20.0)),
        (pose(89.99, 0.0, 1000.0, 0.0, -45.0), pose(89.99, 180.0, 1000.0, 0.0, -45.0)),
        (pose(90.0, 0.0, 1000.0, 0.0, -45.0), pose(90.0, 120.0, 30.0, 0.0, -45.0)),
        (helsinki, helsinki),
        (helsinki, Pose { heading_rad: 3.0, ..helsinki }),
        (helsinki, Pose { eye: helsinki.eye.at_height(4e7), ..helsinki }),
    ];
    for (from, to) in cases {
        let least_m = flown(&scene, from, to);
        assert!(least_m > 0.0, "{from:?} to {to:?}: {least_m}");
    }
}

#[test]
fn flights_clear_mountains_and_towers() {
    let place = Geodetic::from_degrees(46.0, 7.0, 0.0);
    let mountain = Mountain { place, height_m: 1500.0, radius_m: 500.0 };
    let tower = Building { place, half_m: [30.0, 30.0], base_m: 0.0, top_m: 1600.0 };
    let (from, to) = (pose(45.994, 7.0, 60.0, 0.0, -10.0), pose(46.006, 7.0, 40.0, 0.0, -30.0));
    let scene = Scene { mountain: Some(mountain), buildings: vec![tower], ..Scene::default() };
    let flat = Scene::default();
    let mut bare = Hand::new(&flat, from);
    bare.input(NavInput::FlyTo(Destination::new(to)));
    let flight = bare.navigator.flight().unwrap();
    let through = (0..500).any(|at| scene.depth_m(flight.pose_at(flight.start_s() + 0.02 * f64::from(at))) > 0.0);
    assert!(through, "without the mountain the way goes through where it is");
    let least_m = flown(&scene, from, to);
    assert!(least_m > 5.0, "{least_m}");
}

#[test]
fn a_double_click_flies_to_what_was_clicked() {
    let scene = Scene::default();
    for (from, at_px) in [
        (pose(30.0, 5.0, 1e7, 0.0, -90.0), [800.0, 300.0]),
        (pose(30.0, 5.0, 200.0, 50.0, -15.0), [700.0, 420.0]),
        (pose(89.99, 5.0, 5000.0, 50.0, -50.0), [640.0, 100.0]),
    ] {
        let mut hand = Hand::new(&scene, from);
        let point = hand.picked(at_px).unwrap();
        let distance_m = hand.view().eye().distance_m(point);
        for _ in 0..2 {
            hand.press(Button::Left, at_px);
            hand.frame();
            hand.input(NavInput::Released(Button::Left));
            hand.frame();
        }
        assert!(hand.navigator.flight().is_some());
        hand.rest(9.0);
        let view = hand.view();
        let want_m = (distance_m / 8.0).max(60.0);
        assert!((view.eye().distance_m(point) / want_m - 1.0).abs() < 1e-6);
        assert!(off_px(&view, point, [640.0, 360.0]) < 1.0);
        assert!(view.pose.pitch_rad < -29.9f64.to_radians());
        // Two slow presses, or two apart, are none.
        for wait in [30, 3] {
            let before = hand.pose();
            hand.press(Button::Left, [640.0, 360.0]);
            hand.input(NavInput::Released(Button::Left));
            hand.frames(wait);
            hand.press(Button::Left, if wait > 10 { [640.0, 360.0] } else { [660.0, 360.0] });
            assert!(hand.navigator.flight().is_none());
            hand.input(NavInput::Released(Button::Left));
            hand.frame();
            assert!(before.eye.to_ecef().distance_m(hand.pose().eye.to_ecef()) < 1e-3);
            hand.frames(60);
        }
    }
}

#[test]
fn north_up_turns_about_the_middle() {
    for (lat_deg, pitch_deg) in [(30.0, -40.0), (30.0, -90.0), (89.9999, -45.0), (10.0, 10.0)] {
        let scene = Scene::default();
        let mut hand = Hand::new(&scene, pose(lat_deg, 7.0, 2000.0, 130.0, pitch_deg));
        let middle = hand.picked([640.0, 360.0]);
        let start_s = hand.now_s;
        hand.input(NavInput::NorthUp);
        hand.rest(1.2);
        assert!(hand.pose().heading_rad.abs() < 1e-9, "{:?}", hand.pose());
        if lat_deg < 89.0 {
            assert!(hand.now_s - start_s < 0.6);
            assert!(middle.is_none_or(|middle| off_px(&hand.view(), middle, [640.0, 360.0]) < 1.0));
        }
    }
}

#[test]
fn reset_flies_home() {
    let scene = Scene::default();
    let home = pose(0.0, 0.0, 1.5e7, 0.0, -90.0);
    let mut navigator = Navigator::new(pose(60.0, 25.0, 100.0, 50.0, -20.0), home, FOV_RAD);
    navigator.step(0.0, SIZE_PX, &scene);
    navigator.input(NavInput::Reset, 0.0, SIZE_PX, &scene);
    for frame in 1..=600 {
        navigator.step(f64::from(frame) * FRAME_S, SIZE_PX, &scene);
    }
    assert_eq!(navigator.pose(), home);
}

#[test]
fn keys_fly_turn_and_zoom_by_height_and_stop() {
    let scene = Scene::default();
    for height_m in [1e6, 1000.0, 10.0] {
        let mut hand = Hand::new(&scene, pose(45.0, 179.99, height_m, 90.0, -30.0));
        let start = hand.pose();
        hand.input(NavInput::Hold(Held::Forward, true));
        for _ in 0..60 {
            hand.frame();
        }
        let course = Course::between(start.eye, hand.pose().eye);
        assert!((course.distance_m / height_m - 0.9).abs() < 0.02, "{}", course.distance_m / height_m);
        assert!((course.departure_rad - PI / 2.0).abs() < 1e-6);
        hand.input(NavInput::Hold(Held::Fast, true));
        let fast_from = hand.pose();
        for _ in 0..60 {
            hand.frame();
        }
        let fast_m = Course::between(fast_from.eye, hand.pose().eye).distance_m;
        assert!((fast_m / height_m - 3.7).abs() < 0.1, "{}", fast_m / height_m);
        hand.input(NavInput::Unfocused);
        hand.rest(1.5);
    }
    let mut hand = Hand::new(&scene, pose(45.0, 0.0, 100.0, 0.0, -30.0));
    hand.input(NavInput::Hold(Held::TurnRight, true));
    hand.input(NavInput::Hold(Held::TiltUp, true));
    hand.input(NavInput::Hold(Held::Up, true));
    for _ in 0..30 {
        hand.frame();
    }
    hand.input(NavInput::Hold(Held::TurnRight, false));
    hand.input(NavInput::Hold(Held::TiltUp, false));
    hand.input(NavInput::Hold(Held::Up, false));
    hand.rest(1.5);
    let turned = hand.pose();
    assert!((turned.heading_rad.to_degrees() - 30.0).abs() < 1.0 && turned.pitch_rad.abs() < 0.02, "{turned:?}");
    assert!((turned.eye.height_m / 100.0).ln() > 0.45);
    hand.input(NavInput::Hold(Held::TiltDown, true));
    hand.input(NavInput::Hold(Held::ZoomIn, true));
    for _ in 0..120 {
        assert!(hand.frame().pose.pitch_rad >= -PI / 2.0);
    }
    assert!(hand.pose().eye.height_m < turned.eye.height_m / 3.0);
}

/// A street between two houses, and a bridge over it.
fn street() -> Scene {
    let place = Geodetic::from_degrees(60.0, 25.0, 0.0);
    let off = |azimuth_deg: f64, by_m: f64| place.travel(azimuth_deg.to_radians(), by_m).0;
    let house = |place| Building { place, half_m: [10.0, 30.0], base_m: 0.0, top_m: 20.0 };
    let bridge = Building { place: off(0.0, 20.0), half_m: [6.0, 4.0], base_m: 8.0, top_m: 10.0 };
    Scene {
        ground_m: 5.0,
        mountain: Some(Mountain { place: off(180.0, 200.0), height_m: 60.0, radius_m: 120.0 }),
        buildings: vec![house(off(90.0, 15.0)), house(off(270.0, 15.0)), bridge],
    }
}

#[test]
fn walls_stop_roofs_carry_and_bridges_are_passed_under() {
    let scene = street();
    let walked = |from: Pose, key: Held, seconds: f64| {
        let mut hand = Hand::new(&scene, from);
        hand.input(NavInput::Hold(key, true));
        for _ in 0..(seconds * 60.0) as usize {
            let view = hand.frame();
            assert!(scene.depth_m(view.pose) < 1e-5, "{key:?}: {:?}", view.pose);
        }
        hand.pose()
    };
    let start = pose(60.0, 25.0, 7.0, 90.0, 0.0);
    let stopped = walked(start, Held::Forward, 6.0);
    let way_m = Course::between(start.eye, stopped.eye).distance_m;
    assert!((4.3..4.55).contains(&way_m) || stopped.eye.lat_rad != start.eye.lat_rad, "{way_m}");
    // At an angle it slides along.
    let slid = walked(pose(60.0, 25.0, 7.0, 30.0, 0.0), Held::Forward, 6.0);
    assert!(Course::between(start.eye, slid.eye).distance_m > 8.0, "{slid:?}");
    let over = Geodetic::from_ecef(scene.buildings[0].place.to_ecef());
    let landed = walked(Pose { eye: over.at_height(60.0), ..start }, Held::Down, 10.0);
    assert!((landed.eye.height_m - 20.5).abs() < 1e-3, "{landed:?}");
    let under = walked(pose(60.0, 25.0, 7.0, 0.0, 0.0), Held::Forward, 12.0);
    assert!(Course::between(start.eye, under.eye).distance_m > 22.0, "{under:?}");
    assert!(under.eye.height_m < 8.0);
    // Uphill the eye follows the ground.
    let uphill = walked(pose(60.0, 25.0, 7.0, 180.0, 0.0), Held::Forward, 60.0);
    assert!(uphill.eye.height_m > 20.0, "{uphill:?}");
}

#[test]
fn a_drag_that_would_enter_a_house_is_held_back_and_slopes_are_climbed() {
    let scene = street();
    let mut hand = Hand::new(&scene, pose(60.0, 25.0, 12.0, 90.0, -45.0));
    hand.press(Button::Left, [640.0, 300.0]);
    for step in 1..=30 {
        let view = hand.at([640.0, 300.0 + 10.0 * f64::from(step)]);
        assert!(scene.depth_m(view.pose) < 1e-5, "{:?}", view.pose);
    }
    let way_m = Course::between(Geodetic::from_degrees(60.0, 25.0, 0.0), hand.pose().eye).distance_m;
    assert!((3.0..4.6).contains(&way_m), "it went as far as the wall: {way_m}");
    let mut hand = Hand::new(&scene, pose(60.0, 25.0, 7.0, 180.0, -20.0));
    for _ in 0..40 {
        hand.press(Button::Left, [640.0, 420.0]);
        for step in 1..=20 {
            let view = hand.at([640.0, 420.0 + 12.0 * f64::from(step)]);
            assert!(scene.depth_m(view.pose) < 1e-5, "{:?}", view.pose);
        }
        hand.input(NavInput::Released(Button::Left));
    }
    assert!(hand.pose().eye.height_m > 20.0, "{:?}", hand.pose());
}

#[test]
fn an_eye_that_is_overtaken_by_ground_or_a_house_rises_smoothly() {
    let coarse = Scene::default();
    let from = pose(60.0, 25.0, 10.0, 0.0, -20.0);
    let place = from.eye;
    let finer = Scene::flat(40.0);
    let house = Building { place, half_m: [10.0, 10.0], base_m: 0.0, top_m: 25.0 };
    let built = Scene { buildings: vec![house], ..Scene::default() };
    for (scene, want_m) in [(finer, 40.0 + EYE_OVER_GROUND_M), (built, 25.5)] {
        let mut hand = Hand::new(&coarse, from);
        hand.scene = &scene;
        let first_m = hand.frame().pose.eye.height_m;
        assert!(first_m > 10.0 && first_m < want_m - 5.0, "no jump: {first_m}");
        assert!(hand.navigator.is_moving());
        hand.rest(2.0);
        assert!((hand.pose().eye.height_m - want_m).abs() < 1e-5, "{:?}", hand.pose());
    }
}

#[test]
fn odd_clocks_sizes_and_numbers_do_no_harm() {
    let scene = Scene::default();
    for size_px in [[1, 1], [0, 0], [1, 4000]] {
        for from in
            [pose(90.0, 0.0, 4e7, 0.0, -90.0), pose(-90.0, 50.0, 10.0, 0.0, 90.0), pose(0.0, 180.0, 2.0, 0.0, 0.0)]
        {
            let mut navigator = Navigator::new(from, from, FOV_RAD);
            let inputs = [
                NavInput::PointerMoved([0.5, 0.5]),
                NavInput::Pressed(Button::Left),
                NavInput::PointerMoved([1e9, -1e9]),
                NavInput::PointerMoved([f64::NAN, 0.0]),
                NavInput::Wheel { notches: 1e300 },
                NavInput::Wheel { notches: f64::NAN },
                NavInput::Released(Button::Left),
                NavInput::Pressed(Button::Right),
                NavInput::PointerMoved([0.0, 3.0]),
                NavInput::Released(Button::Right),
                NavInput::Hold(Held::Forward, true),
                NavInput::NorthUp,
                NavInput::Reset,
                NavInput::FlyTo(Destination::new(Pose { pitch_rad: f64::NAN, ..from })),
            ];
            for (input, now_s) in
                inputs.into_iter().zip([0.0, 0.0, 0.0, 10.0, 20.0, 20.0, f64::NAN, 20.0, 5.0, 30.0].iter().cycle())
            {
                navigator.input(input, *now_s, size_px, &scene);
                for _ in 0..3 {
                    let view = navigator.step(*now_s, size_px, &scene);
                    assert!(is_finite(view.pose), "{input:?} at {now_s}");
                }
            }
        }
    }
    let broken =
        Pose { eye: Geodetic { lat_rad: f64::NAN, lon_rad: 0.0, height_m: 0.0 }, heading_rad: 0.0, pitch_rad: 0.0 };
    assert!(is_finite(Navigator::new(broken, broken, FOV_RAD).pose()));
}

#[test]
fn a_stall_is_no_jump() {
    let scene = Scene::default();
    let from = pose(30.0, 0.0, 1000.0, 0.0, -45.0);
    let mut hand = Hand::new(&scene, from);
    hand.input(NavInput::Hold(Held::Forward, true));
    hand.now_s += 10.0;
    hand.frame();
    assert!(Course::between(from.eye, hand.pose().eye).distance_m < 300.0);
    hand.navigator.place(from);
    hand.input(NavInput::FlyTo(Destination::new(pose(31.0, 0.0, 1000.0, 0.0, -45.0))));
    for _ in 0..10 {
        hand.frame();
    }
    let (before, end_s) = (hand.view(), hand.navigator.flight().unwrap().end_s());
    hand.now_s += 10.0;
    let view = hand.frame();
    assert!(before.eye().distance_m(view.eye()) < 5.0 * 1000.0 * 8.0, "{:?}", view.pose);
    let flight = hand.navigator.flight().unwrap();
    assert!(flight.end_s() > end_s + 9.0);
    assert_eq!(flight.pose_at(hand.now_s), view.pose, "what is told of the flight is what is flown");
    // A clock that stands still moves nothing.
    let still = hand.navigator.step(hand.now_s, SIZE_PX, &scene);
    assert_eq!(still.pose, view.pose);
}

#[test]
fn the_scene_picks_what_it_shows() {
    let view = View::new(pose(45.0, 10.0, 1e4, 20.0, -40.0), FOV_RAD, SIZE_PX);
    let point = Scene::flat(100.0).pick(&view, [300.0, 400.0]).unwrap();
    assert!(off_px(&view, point, [300.0, 400.0]) < 1e-6);
    assert!((Geodetic::from_ecef(point).height_m - 100.0).abs() < 1e-2);
    assert!(ray_ellipsoid(view.eye().xyz(), Geodetic::from_degrees(45.0, 10.0, 0.0).up(), 0.0).is_none());
}

#[derive(Clone, Debug)]
enum Act {
    Key(usize, u8),
    Drag(Button, [f64; 2], [f64; 2]),
    Wheel([f64; 2], f64),
    Fly(f64, f64),
    North,
}

fn acts() -> impl Strategy<Value = Vec<Act>> {
    let px = || [100.0..1180.0, 60.0..660.0];
    let button = prop_oneof![Just(Button::Left), Just(Button::Right)];
    let act = prop_oneof![
        4 => (0..12usize, 1..90u8).prop_map(|(key, frames)| Act::Key(key, frames)),
        4 => (button, px(), px()).prop_map(|(button, from, to)| Act::Drag(button, from, to)),
        2 => (px(), -6.0..6.0).prop_map(|(at, notches)| Act::Wheel(at, notches)),
        1 => (-60.0..60.0, 7.0..40.0).prop_map(|(north_m, height_m)| Act::Fly(north_m, height_m)),
        1 => Just(Act::North),
    ];
    prop::collection::vec(act, 1..12)
}

const KEYS: [Held; 12] = [
    Held::Forward,
    Held::Back,
    Held::Left,
    Held::Right,
    Held::Up,
    Held::Down,
    Held::TurnLeft,
    Held::TurnRight,
    Held::TiltUp,
    Held::TiltDown,
    Held::ZoomIn,
    Held::ZoomOut,
];

/// Does it, and gives the frames.
fn acted(hand: &mut Hand, act: &Act) -> Vec<View> {
    let mut views = Vec::new();
    match *act {
        Act::Key(key, frames) => {
            hand.input(NavInput::Hold(Held::Fast, frames % 2 == 0));
            hand.input(NavInput::Hold(KEYS[key], true));
            views.extend((0..frames).map(|_| hand.frame()));
            hand.input(NavInput::Hold(KEYS[key], false));
        }
        Act::Drag(button, from, to) => {
            hand.press(button, from);
            for step in 1..=15 {
                let share = f64::from(step) / 15.0;
                views.push(hand.at([0, 1].map(|axis| from[axis] + (to[axis] - from[axis]) * share)));
            }
            hand.input(NavInput::Released(button));
        }
        Act::Wheel(at_px, notches) => {
            hand.input(NavInput::PointerMoved(at_px));
            hand.input(NavInput::Wheel { notches });
        }
        Act::Fly(north_m, height_m) => {
            let eye = Geodetic::from_degrees(60.0, 25.0, height_m).travel(0.0, north_m).0;
            hand.input(NavInput::FlyTo(Destination::new(Pose { eye, heading_rad: 1.0, pitch_rad: -0.3 })));
        }
        Act::North => hand.input(NavInput::NorthUp),
    }
    views.extend((0..20).map(|_| hand.frame()));
    views
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, ..ProptestConfig::default() })]
    #[test]
    fn no_hand_brings_the_eye_under_the_ground_or_into_a_house(acts in acts()) {
        let scene = street();
        let mut hand = Hand::new(&scene, pose(60.0, 25.0, 7.0, 20.0, -10.0));
        for act in &acts {
            for view in acted(&mut hand, act) {
                prop_assert!(is_finite(view.pose));
                prop_assert!(scene.depth_m(view.pose) < 1e-5, "{act:?}: {} m deep at {:?}", scene.depth_m(view.pose), view.pose);
                prop_assert!(view.pose.eye.height_m <= MAX_HEIGHT_M);
            }
        }
    }

    #[test]
    fn no_hand_flings_the_eye(
        acts in acts(),
        lat_deg in prop_oneof![-90.0..90.0, 89.99..=90.0],
        lon_deg in -180.0..180.0,
        log_height in 2.0..17.0,
        pitch_deg in -90.0..20.0,
    ) {
        let scene = Scene::default();
        let mut hand = Hand::new(&scene, pose(lat_deg, lon_deg, f64::exp(log_height), 50.0, pitch_deg));
        // Turning about a far point is as fast as the hand; flights have a test of their own.
        for act in acts.iter().filter(|act| !matches!(act, Act::Drag(Button::Right, ..) | Act::Fly(..) | Act::North)) {
            let mut before = hand.view();
            for view in acted(&mut hand, act) {
                prop_assert!(is_finite(view.pose) && view.pose.eye.height_m <= MAX_HEIGHT_M);
                prop_assert!(scene.depth_m(view.pose) < 1e-5);
                let height_m = before.pose.eye.height_m.max(2.0);
                let speed = before.eye().distance_m(view.eye()) / FRAME_S / height_m;
                prop_assert!(speed < 2.2 * MAX_HEIGHTS_PER_S, "{act:?}: {speed} from {:?} to {:?}", before.pose, view.pose);
                before = view;
            }
        }
    }
}

#[test]
fn a_rest_is_not_made_up_for() {
    let scene = Scene::default();
    let from = pose(10.0, 20.0, 5000.0, 0.0, -45.0);
    let mut hand = Hand::new(&scene, from);
    hand.now_s += 60.0;
    hand.input(NavInput::Hold(Held::TurnLeft, true));
    hand.frame();
    let turned_deg = (hand.navigator.pose().heading_rad - from.heading_rad).to_degrees().abs();
    assert!(turned_deg < 2.0, "{turned_deg} degrees in the first frame");
    hand.input(NavInput::Hold(Held::TurnLeft, false));
    hand.now_s += 60.0;
    hand.input(NavInput::FlyTo(Destination::new(pose(10.5, 20.0, 5000.0, 0.0, -45.0))));
    (0..60).for_each(|_| _ = hand.frame());
    let moved_m = hand.navigator.pose().eye.to_ecef().distance_m(from.eye.to_ecef());
    assert!(moved_m > 100.0, "after a second the flight has gone {moved_m} m");
}
