//! A stage of a long job: counted, shown, and stopped by Ctrl-C between two of its steps.

use super::{OnProgress, Progress};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// The job was asked to stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("stopped; run the same command again to go on from the stages that are done")]
pub struct Stopped;

/// One stage; shared between threads.
pub struct Task<'a> {
    stage: &'static str,
    item: String,
    total: u64,
    done: AtomicU64,
    stop: &'a AtomicBool,
    on_progress: OnProgress<'a>,
}

impl<'a> Task<'a> {
    /// `total` 0: not known beforehand.
    pub fn new(
        stage: &'static str,
        item: impl Into<String>,
        total: u64,
        stop: &'a AtomicBool,
        on_progress: OnProgress<'a>,
    ) -> Self {
        Self { stage, item: item.into(), total, done: AtomicU64::new(0), stop, on_progress }
    }

    /// Whether the job may go on.
    pub fn go_on(&self) -> Result<(), Stopped> {
        if self.stop.load(Ordering::Relaxed) { Err(Stopped) } else { Ok(()) }
    }

    /// Counts a step that is about to be taken.
    pub fn step(&self) -> Result<(), Stopped> {
        self.go_on()?;
        let done = self.done.fetch_add(1, Ordering::Relaxed) + 1;
        (self.on_progress)(Progress { stage: self.stage, item: &self.item, done, total: self.total });
        Ok(())
    }

    pub fn done(&self) -> u64 {
        self.done.load(Ordering::Relaxed)
    }
}
