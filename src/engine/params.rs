//! What a run is asked to be.

use crate::camera::View;
use crate::paging::{ManagerError, PlannerParams, ServerError};
use crate::render::RenderError;
use crate::select::{CollectionSet, ObjectsMode};
use crate::storage::{Faults, StorageModel};
use crate::units::ByteSize;

/// How frames and reads keep step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// A frame reads what it may start and draws it; no threads, no clock: deterministic.
    LockStep,
    /// Each frame reads until nothing is left to load.
    Settled,
    /// Threads read and decode; a frame takes what is there and never waits.
    Live,
}

impl Mode {
    pub fn name(self) -> &'static str {
        match self {
            Self::LockStep => "lockstep",
            Self::Settled => "settled",
            Self::Live => "live",
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EngineParams {
    /// Allowed screen-space error, pixels; above 0.
    pub tolerance_px: f64,
    /// Projected bounding dimension below which an object is neither drawn nor read, pixels.
    pub threshold_px: f64,
    pub objects: ObjectsMode,
    /// Collections that are neither drawn nor read.
    pub hidden: CollectionSet,
    /// Hard limit of all bytes held; see [`Partition`](super::Partition).
    pub footprint: ByteSize,
    /// Frame time to hold in live runs by drawing coarser, milliseconds.
    pub frame_ms: Option<f64>,
    pub mode: Mode,
    /// What is fetched, and in which order; settled runs fetch the front alone.
    pub planner: PlannerParams,
    /// What live runs are held back to; without one, the disk is read as fast as it goes.
    pub storage: Option<StorageModel>,
    /// What goes wrong in live runs, with `storage` or without.
    pub faults: Faults,
    /// Whom the faults hit.
    pub seed: u64,
    /// Each frame reads what its front lacks and waits for it, and nothing is fetched ahead: the baseline that
    /// Funkhouser 1996, §6 compares with. Settled runs wait anyway, and a window's frames never do.
    pub sync_reads: bool,
}

impl Default for EngineParams {
    fn default() -> Self {
        Self {
            tolerance_px: 1.0,
            threshold_px: 1.0,
            objects: ObjectsMode::Groups,
            hidden: CollectionSet::NONE,
            footprint: ByteSize(256 << 20),
            frame_ms: None,
            mode: Mode::LockStep,
            planner: PlannerParams::default(),
            storage: None,
            faults: Faults::NONE,
            seed: 0,
            sync_reads: false,
        }
    }
}

/// One frame to draw.
#[derive(Clone, Copy, Debug)]
pub struct FrameRequest {
    pub view: View,
    /// Time on the flight's clock, seconds; must not fall from frame to frame.
    pub t_s: f64,
    /// Whether ids and depths are drawn beside the colours, to be read after the frame.
    pub ids: bool,
}

#[derive(Debug, thiserror::Error)]
pub enum EngineError {
    #[error("a footprint of {asked} cannot work with this world: at least {least} are needed; raise --footprint")]
    FootprintTooSmall { asked: ByteSize, least: ByteSize },
    #[error("cannot start the scene thread: {0}; close other programs")]
    Thread(std::io::Error),
    #[error("the scene thread ended unexpectedly, with a message on the terminal; start again")]
    SceneEnded,
    #[error(transparent)]
    Manager(#[from] ManagerError),
    #[error(transparent)]
    Servers(#[from] ServerError),
    #[error(transparent)]
    Render(#[from] RenderError),
}
