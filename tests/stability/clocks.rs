//! Clocks that jump, stand still and run backwards.

use super::flights::library;
use super::table::{Row, digits};
use crate::analytic::Scene;
use crate::made_up::flights::{dive, pose};
use stoop::camera::{Held, NavInput, Navigator, View};
use stoop::paging::{PlannerParams, PolicyName};
use stoop::simulate::{Setup, Simulation};
use stoop::storage::StorageModel;

const SIZE_PX: [u32; 2] = [640, 360];
const STEP_S: f64 = 1.0 / 60.0;
/// Times of a broken clock: backwards, equal, far on, no numbers.
const JUMPS_S: [f64; 7] = [-5.0, 0.0, 3600.0, 1e9, f64::NAN, f64::INFINITY, -1e300];

/// How far an eye that flies ahead goes in the frame in which the clock jumps, metres.
fn moved_m(jump_s: f64) -> f64 {
    let scene = Scene::flat(0.0);
    let start = pose(33.0, -84.0, 1_000.0, 0.0, -20.0);
    let mut navigator = Navigator::new(start, start, 1.0);
    navigator.input(NavInput::Hold(Held::Forward, true), 0.0, SIZE_PX, &scene);
    // Until it flies at full speed.
    let now_s = (0..300).map(|frame| f64::from(frame) * STEP_S).inspect(|&t_s| {
        navigator.step(t_s, SIZE_PX, &scene);
    });
    let now_s = now_s.last().unwrap();
    let before = navigator.pose().eye.to_ecef();
    let view = navigator.step(now_s + jump_s, SIZE_PX, &scene);
    assert!(view.pose.eye.height_m.is_finite() && view.pose.eye.lat_rad.is_finite());
    before.distance_m(view.eye())
}

/// A flight whose clock goes back and jumps ahead comes to rest, and never above its footprint.
fn flies_by_a_broken_clock() {
    let library = library();
    let planner = PlannerParams { policy: PolicyName::Foresight, ..PlannerParams::default() };
    let setup = Setup { planner, ..Setup::new(StorageModel::LAN, STEP_S) };
    let mut simulation = Simulation::new(&library, setup).unwrap();
    let path = dive(33.0, -84.0, [4e6, 600.0], -60.0, 4.0);
    let mut offset_s = 0.0;
    let mut last = None;
    for frame in 0..1200u32 {
        // Every hundred frames the clock stands still, or jumps an hour ahead; the flight goes on.
        offset_s += match frame % 300 {
            100 => -5.0,
            200 => 3600.0,
            _ => 0.0,
        };
        let view = View::new(path.at(f64::from(frame) * STEP_S), path.fovy_rad(), SIZE_PX);
        let report = simulation.frame(&view, f64::from(frame) * STEP_S + offset_s).report;
        assert!(report.footprint_bytes <= setup.footprint.0 && report.cells_drawn > 0);
        last = Some(report);
    }
    let last = last.unwrap();
    assert_eq!((last.excess_max_px, last.pages_missing), (0.0, 0));
}

pub fn clocks() -> Row {
    let usual = |jump_s: f64| moved_m(STEP_S) / STEP_S * jump_s;
    assert!(usual(-5.0) < -1_000.0 && usual(1e9) > 1e9 && usual(f64::NAN).is_nan());
    let ours_m = JUMPS_S.map(moved_m);
    assert!(ours_m.iter().all(|moved_m| moved_m.is_finite()), "{ours_m:?}");
    // Back is no time at all; on is one step, as long as a slow frame's.
    let [back_m, equal_m, hour_m, far_m, ..] = ours_m;
    assert!(back_m == 0.0 && equal_m == 0.0 && hour_m == far_m, "{ours_m:?}");
    assert!(far_m < 60.0 * moved_m(STEP_S), "{far_m}");
    flies_by_a_broken_clock();
    let farthest_s =
        [1e9, 1e12, 1e15, 1e300].into_iter().take_while(|&jump_s| moved_m(jump_s) <= far_m).last().unwrap();
    assert_eq!(farthest_s, 1e300);
    Row {
        case: "clocks that run back, stand and jump",
        usual: format!(
            "speed times time: −5 s take the eye back by {} m, an hour on by {} m, no number to nowhere",
            digits(-usual(-5.0)),
            digits(usual(3600.0))
        ),
        ours: format!("back and equal: no step; any jump ahead is a step of {} m; flights end sharp", digits(far_m)),
        limit: format!("jumps of {farthest_s:e} s"),
    }
}
