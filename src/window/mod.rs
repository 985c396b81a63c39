//! The native window: input, frames, panels. The only module that sees winit; what it draws beside the world is egui's.
//!
//! One thread takes the events, moves the eye, and draws the last published list; see [`crate::engine::Live`] for the
//! others. Frames are drawn when something changed: a window at rest costs nothing.

mod aim;
mod app;
mod files;
mod hands;
mod opener;
mod overlays;
mod panels;
mod recorder;
mod saver;
mod settings;
mod stage;

pub use app::{WindowError, run};
pub use hands::{Hands, Taken};
pub use panels::{CONTROLS, FRAME_MS, TOLERANCE_PX};
pub use stage::Bookmark;

use crate::camera::FlightPath;
use crate::engine::{EngineParams, Source};
use crate::store::World;
use crate::units::ByteSize;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

/// What a window is opened for. What is `None` comes from the settings of the last time.
pub struct WindowOptions {
    pub source: Source,
    /// What the source is made of, over one another, and all of it: further worlds may be put over it.
    pub worlds: Vec<Arc<World>>,
    pub whole: Arc<World>,
    pub bookmarks: Vec<Bookmark>,
    /// Logical pixels.
    pub size_px: Option<[u32; 2]>,
    pub tolerance_px: Option<f64>,
    pub footprint: Option<ByteSize>,
    /// `Some(None)` holds no frame time.
    pub frame_ms: Option<Option<f64>>,
    /// Thresholds and what else has no setting.
    pub params: EngineParams,
    /// A flight to show first.
    pub replay: Option<FlightPath>,
    /// Where a report of the session goes, with its frames beside it.
    pub report: Option<PathBuf>,
    /// When the program started, to tell the time to the first frame.
    pub started: Instant,
}
