//! `stoop fly --virtual`: a flight by the virtual clock over a storage model.

use super::outputs::Outputs;
use super::schedule::{self, Progress};
use super::{Arguments, header, is_audited};
use std::process::ExitCode;
use std::sync::Arc;
use stoop::camera::FlightPath;
use stoop::engine::{FrameRequest, Source, Stills};
use stoop::record::FlightLog;
use stoop::simulate::{Frame, Library, Setup, Simulation, fly as simulate};
use stoop::storage::StorageModel;

pub fn fly(arguments: &Arguments, path: FlightPath, source: Source, storage: StorageModel) -> anyhow::Result<ExitCode> {
    let setup = setup(arguments, &path, storage)?;
    let mode = format!("virtual {storage}");
    let mut log = FlightLog::new(header(arguments, &path, &source, &mode));
    let mut pictures = Pictures::open(arguments, &source, setup.step_s)?;
    let mut progress = Progress::new(path.end_s());
    let library = Library::new(source.index.clone(), source.reader.clone()).with_layout(source.layout.clone());
    let mut drawn = Ok(());
    log.wasted_bytes = simulate(&library, &Arc::new(path), setup, |mut frame, simulation| {
        if is_audited(arguments.modelled.unwrap_or(0), log.frames.len()) {
            frame.report.take_modelled(&simulation.modelled(&frame));
        }
        drawn = pictures.take(&mut frame, simulation, log.frames.len());
        for failure in simulation.take_messages().into_iter().chain(pictures.take_failures()) {
            eprintln!("stoop: at {:.2} s: {failure}; flying on with coarser detail", frame.report.t_s);
        }
        progress.at(frame.report.t_s);
        log.frames.push(frame.report);
        log.ride = simulation.ride_counts();
        drawn.is_ok()
    })?;
    progress.end();
    drawn?;
    pictures.outputs.finish()?;
    if let Some(file) = arguments.report.as_deref() {
        log.write(file)?;
    }
    schedule::print_summary(&log.summary(), &pictures.maker());
    Ok(ExitCode::SUCCESS)
}

/// The pictures of a flight that needs none itself.
struct Pictures {
    outputs: Outputs,
    /// Opened only where some are asked for.
    stills: Option<Stills>,
    audit_every: u32,
    size_px: [u32; 2],
}

impl Pictures {
    fn open(arguments: &Arguments, source: &Source, step_s: f64) -> anyhow::Result<Self> {
        let outputs = Outputs::create(arguments, step_s)?;
        let audit_every = arguments.audit_every();
        let stills = if outputs.want_pixels() || audit_every > 0 {
            Some(Stills::open(source.clone(), &arguments.params()?)?)
        } else {
            None
        };
        Ok(Self { outputs, stills, audit_every, size_px: arguments.size.0 })
    }

    /// Draws and writes what is due of a frame after so many others.
    fn take(&mut self, frame: &mut Frame, simulation: &Simulation<'_>, before: usize) -> anyhow::Result<()> {
        let Some(stills) = &mut self.stills else { return Ok(()) };
        let t_s = frame.report.t_s;
        let (due, audit) = (self.outputs.due(t_s), is_audited(self.audit_every, before));
        if !due.wants_pixels() && !audit {
            return Ok(());
        }
        let request = FrameRequest { view: frame.view, t_s, ids: audit || due.wants_aov() };
        stills.draw(simulation.index(), &frame.selection, &request)?;
        if audit {
            stills.audit(&request, &mut frame.report)?;
        }
        self.outputs.write(stills.picture(), due, self.size_px)
    }

    fn take_failures(&mut self) -> Vec<String> {
        self.stills.as_mut().map(Stills::take_failures).unwrap_or_default()
    }

    /// Who made the flight and its pictures.
    fn maker(&self) -> String {
        let drawn = self.stills.as_ref().map(|stills| format!(", pictures on {}", stills.adapter_name()));
        format!("the virtual clock{}", drawn.unwrap_or_default())
    }
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
