//! What a frame costs by its distance from a city (Davis et al. 1999, figs. 4 to 7): the ground alone, all objects without
//! a hierarchy, objects by cells, and with groups. Counts of settled frames by the virtual clock, which depend on no
//! machine.

use crate::camera::{Pose, View};
use crate::chart::figure::{Axis, Curve, Figure, Panel, Stroke};
use crate::chart::sheet::Sheet;
use crate::geodesy::Geodetic;
use crate::paging::{FrameReport, PlannerParams, PolicyName};
use crate::select::ObjectsMode;
use crate::simulate::{Library, Setup, Simulation, SimulationError};
use crate::storage::StorageModel;
use crate::units::ByteSize;
use rayon::prelude::*;

/// Farthest and nearest distance, metres, and how many there are.
const DISTANCES_M: [f64; 2] = [60_000.0, 300.0];
const STEPS: i32 = 9;
/// The eye looks at the place from the south, down by this.
const PITCH_DEG: f64 = -20.0;
/// No frame is coarser for want of memory.
const FOOTPRINT: ByteSize = ByteSize(8 << 30);
const FOVY_RAD: f64 = std::f64::consts::FRAC_PI_3;
/// A view settles within so many frames, or is taken as it is.
const FRAMES_MAX: u32 = 600;
const STEP_S: f64 = 0.1;

const MODES: [(&str, ObjectsMode); 4] = [
    ("ground alone", ObjectsMode::Off),
    ("flat", ObjectsMode::Flat),
    ("cells", ObjectsMode::Cells),
    ("groups", ObjectsMode::Groups),
];

type Count = (&'static str, fn(&FrameReport) -> u64);

const COUNTS: [Count; 3] = [
    ("cells tested", |report| report.cells_tested.into()),
    ("objects drawn", |report| report.objects_drawn.into()),
    ("triangles", |report| report.triangles),
];

/// Cost by distance from a place on the ground.
pub fn cost_by_distance(
    library: &Library,
    place: Geodetic,
    size_px: [u32; 2],
    tolerance_px: f64,
) -> Result<Figure, SimulationError> {
    let ratio = (DISTANCES_M[1] / DISTANCES_M[0]).powf(1.0 / f64::from(STEPS - 1));
    let distances_m: Vec<f64> = (0..STEPS).map(|step| (DISTANCES_M[0] * ratio.powi(step)).round()).collect();
    let cases: Vec<(usize, f64)> =
        (0..MODES.len()).flat_map(|mode| distances_m.iter().map(move |&distance_m| (mode, distance_m))).collect();
    let settled = |&(mode, distance_m): &(usize, f64)| {
        let view = View::new(pose(place, distance_m), FOVY_RAD, size_px);
        let planner = PlannerParams { policy: PolicyName::Demand, ..PlannerParams::default() };
        let objects = MODES[mode].1;
        let setup = Setup { planner, footprint: FOOTPRINT, size_px, tolerance_px, objects, ..setup() };
        Ok((mode, distance_m, settle(library, setup, &view)?))
    };
    let rows: Vec<(usize, f64, FrameReport)> = cases.par_iter().map(settled).collect::<Result<_, SimulationError>>()?;
    Ok(figure(&rows))
}

fn setup() -> Setup {
    Setup::new(StorageModel::SSD, STEP_S)
}

/// South of the place, looking at it.
fn pose(place: Geodetic, distance_m: f64) -> Pose {
    let pitch_rad = PITCH_DEG.to_radians();
    let south_rad = distance_m * pitch_rad.cos() / crate::geodesy::SEMI_MAJOR_M;
    let height_m = place.height_m - distance_m * pitch_rad.sin();
    let eye = Geodetic { lat_rad: place.lat_rad - south_rad, height_m, ..place };
    Pose { eye, heading_rad: 0.0, pitch_rad }
}

fn settle(library: &Library, setup: Setup, view: &View) -> Result<FrameReport, SimulationError> {
    let mut simulation = Simulation::new(library, setup)?;
    let mut report = simulation.frame(view, 0.0).report;
    for frame in 1..=FRAMES_MAX {
        report = simulation.frame(view, f64::from(frame) * STEP_S).report;
        if simulation.is_settled() {
            break;
        }
    }
    Ok(report)
}

fn figure(rows: &[(usize, f64, FrameReport)]) -> Figure {
    let mut sheet = Sheet::new("distance", &["objects", "distance_m", "cells_tested", "objects_drawn", "triangles"]);
    for (mode, distance_m, report) in rows {
        let [cells, objects, triangles] = COUNTS.map(|(_, of)| of(report).into());
        sheet.push([MODES[*mode].0.into(), (*distance_m).into(), cells, objects, triangles]);
    }
    let panel = |(name, of): Count| {
        let curve = |mode: usize| {
            let of_mode = rows.iter().filter(move |row| row.0 == mode);
            let spots: Vec<(f64, f64)> =
                of_mode.map(|(_, distance_m, report)| (*distance_m, of(report) as f64)).collect();
            Curve::new(MODES[mode].0, Stroke::Dotted, spots)
        };
        let curves = (0..MODES.len()).map(curve).collect();
        Panel { title: name.to_owned(), x: Axis::log("distance, m", 1.0), y: Axis::log(name, 1.0), curves }
    };
    Figure {
        title: "Frame cost against distance".into(),
        text: "Settled frames that look at a city from the south, 20° down, with the four ways to draw its objects: none, all \
               in view, those above a pixel by cells, and groups in place of small ones."
            .into(),
        panels: COUNTS.map(panel).into(),
        sheet,
        has_table: true,
    }
}
