//! Days of flight, in hours of frames a few seconds apart.

use super::flights::library;
use super::table::{Row, digits, grouped};
use crate::made_up::flights::pose;
use crate::made_up::random::unit;
use std::collections::HashMap;
use stoop::camera::{Pose, View};
use stoop::content::PageId;
use stoop::paging::{PlannerParams, PolicyName};
use stoop::simulate::{Setup, Simulation};
use stoop::storage::StorageModel;
use stoop::units::ByteSize;

const LAT_DEG: f64 = 33.0;
const LON_DEG: f64 = -84.0;
const HOUR_S: f64 = 3600.0;
const HOURS: usize = 24;
/// From frame to frame.
const STEP_S: f64 = 12.0;
/// From stop to stop of the flight.
const LEG_S: f64 = 120.0;
/// Beyond the least footprint.
const ROOM_BYTES: u64 = 2 << 20;

/// A random way without end: 300 m to 3,000 km high, most of it round the fine place; the same every day.
fn wanderer(t_s: f64) -> Pose {
    const LEGS: u64 = (24.0 * HOUR_S / LEG_S) as u64;
    let stop = |stop: u64| {
        let random = |draw: u64| unit(7, (stop % LEGS) * 8 + draw);
        let log_height = 300f64.ln() + 1e4f64.ln() * random(0);
        let off_deg = (log_height.exp() / 111e3).min(20.0);
        let (north_deg, east_deg) = (off_deg * (random(1) - 0.5), off_deg * (random(2) - 0.5));
        [LAT_DEG + north_deg, LON_DEG + east_deg, log_height, 360.0 * random(3), -90.0 * random(4)]
    };
    let leg = (t_s / LEG_S).floor();
    let way = t_s / LEG_S - leg;
    let share = way * way * (3.0 - 2.0 * way);
    let (from, to) = (stop(leg as u64), stop(leg as u64 + 1));
    let [lat_deg, lon_deg, log_height, heading_deg, pitch_deg] =
        std::array::from_fn(|at| from[at] + share * (to[at] - from[at]));
    pose(lat_deg, lon_deg, log_height.exp(), heading_deg, pitch_deg)
}

/// What an hour cost and held at most.
#[derive(Clone, Copy, Debug, Default)]
struct Hour {
    cells_tested: u64,
    footprint_bytes: u64,
    known_pages: u64,
    bytes_read: u64,
}

/// Pages that the request manager knows anything of.
fn known_pages(simulation: &Simulation<'_>) -> u64 {
    let counts = simulation.manager().page_counts().total();
    counts.resident + counts.requested + counts.failed
}

pub fn days() -> Row {
    let library = library();
    let footprint = ByteSize(Simulation::least_footprint(&library.index).0 + ROOM_BYTES);
    let planner = PlannerParams { policy: PolicyName::Foresight, ..PlannerParams::default() };
    let setup = Setup { planner, footprint, ..Setup::new(StorageModel::WAN, STEP_S) };
    let mut simulation = Simulation::new(&library, setup).unwrap();
    let frames = (HOUR_S / STEP_S) as usize;
    let mut kept: HashMap<PageId, u64> = HashMap::new();
    let hours: Vec<Hour> = (0..=HOURS)
        .map(|hour| {
            let mut sums = Hour::default();
            for frame in 0..frames {
                let t_s = (hour * frames + frame) as f64 * STEP_S;
                let view = View::new(wanderer(t_s), 1.0, setup.size_px);
                let frame = simulation.frame(&view, t_s);
                let report = &frame.report;
                sums.cells_tested += u64::from(report.cells_tested);
                sums.bytes_read += report.bytes_read;
                sums.footprint_bytes = sums.footprint_bytes.max(report.footprint_bytes);
                sums.known_pages = sums.known_pages.max(known_pages(&simulation));
                kept.extend(frame.selection.demands.iter().map(|demand| (demand.page, u64::from(demand.place.len))));
            }
            sums
        })
        .collect();
    // The flight is the same every day: so must its cost be.
    let (first, last) = (hours[0], hours[HOURS]);
    let grown = last.cells_tested as f64 / first.cells_tested as f64;
    assert!((0.99..1.01).contains(&grown), "{first:?} {last:?}");
    let most = |of: fn(&Hour) -> u64| hours.iter().map(of).max().unwrap();
    assert!(most(|hour| hour.footprint_bytes) <= footprint.0);
    let (early, late) = (hours[1..=HOURS / 2].iter(), hours[HOURS / 2..].iter());
    let known = [early.map(|hour| hour.known_pages).max(), late.map(|hour| hour.known_pages).max()].map(Option::unwrap);
    assert!(known[1] as f64 <= 1.1 * known[0] as f64, "{known:?}");
    let kept_bytes: u64 = kept.values().sum();
    assert!(kept_bytes > footprint.0, "{kept_bytes} {footprint}");
    // A clock of f32 seconds stands still for frames of 1/60 s.
    let stands_s = (0..40).map(|power| 2f32.powi(power)).find(|&t_s| t_s + 1.0 / 60.0 == t_s).unwrap();
    Row {
        case: "days of random flight",
        usual: format!(
            "pages kept as they come: {} MiB in a day; a clock of f32 seconds stands still after {} days",
            digits(mib(kept_bytes)),
            digits(f64::from(stands_s) / 86_400.0)
        ),
        ours: format!(
            "{HOURS} hours within {} MiB, {} pages known at most; the same hour a day later tests {} times the cells",
            digits(mib(footprint.0)),
            digits(most(|hour| hour.known_pages) as f64),
            digits(grown)
        ),
        limit: format!("{HOURS} h, {} frames {} s apart", grouped((HOURS * frames) as i64), digits(STEP_S)),
    }
}

fn mib(bytes: u64) -> f64 {
    bytes as f64 / f64::from(1 << 20)
}
