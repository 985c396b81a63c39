//! `stoop fly --virtual`: a flight by the virtual clock over a storage model.

use super::outputs::Outputs;
use super::schedule::{self, Progress};
use super::{Arguments, header};
use std::process::ExitCode;
use std::sync::Arc;
use stoop::camera::FlightPath;
use stoop::engine::Source;
use stoop::record::FlightLog;
use stoop::simulate::{Library, Setup, fly as simulate};
use stoop::storage::StorageModel;

pub fn fly(arguments: &Arguments, path: FlightPath, source: Source, storage: StorageModel) -> anyhow::Result<ExitCode> {
    let setup = setup(arguments, &path, storage)?;
    let mode = format!("virtual {storage}");
    let mut log = FlightLog::new(header(arguments, &path, &source, &mode));
    let mut outputs = Outputs::create(arguments, setup.step_s)?;
    let mut progress = Progress::new(path.end_s());
    let library = Library::new(source.index.clone(), source.reader.clone());
    log.wasted_bytes = simulate(&library, &Arc::new(path), setup, |frame, simulation| {
        for failure in simulation.take_messages() {
            eprintln!("stoop: at {:.2} s: {failure}; flying on with coarser detail", frame.report.t_s);
        }
        progress.at(frame.report.t_s);
        log.frames.push(frame.report);
        true
    })?;
    progress.end();
    outputs.finish()?;
    if let Some(file) = arguments.report.as_deref() {
        log.write(file)?;
    }
    schedule::print_summary(&log.summary(), "the virtual clock");
    Ok(ExitCode::SUCCESS)
}

fn setup(arguments: &Arguments, path: &FlightPath, storage: StorageModel) -> anyhow::Result<Setup> {
    let params = arguments.params()?;
    Ok(Setup {
        faults: arguments.faults.unwrap_or_default(),
        seed: arguments.seed,
        planner: params.planner,
        sync_reads: arguments.sync_reads,
        tolerance_px: params.tolerance_px,
        threshold_px: params.threshold_px,
        objects: params.objects,
        footprint: params.footprint,
        size_px: arguments.size.0,
        bound: true,
        ..Setup::new(storage, arguments.step_secs.unwrap_or(1.0 / path.hz()))
    })
}
