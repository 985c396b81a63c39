//! What the panels show: plain data that the application fills in for each frame.

use super::frame_times::FrameTimes;
use super::messages::Messages;
use crate::camera::View;
use crate::engine::FrameReport;
use crate::geodesy::Geodetic;
use crate::paging::LayerCounts;
use crate::select::CollectionSet;
use crate::units::ByteSize;

/// Tolerances that the slider and the keys reach, pixels.
pub const TOLERANCE_PX: [f64; 2] = [0.25, 16.0];
/// Frame times that may be aimed at, milliseconds.
pub const FRAME_MS: [f64; 2] = [8.0, 100.0];
/// The slider's upper end.
pub const FOOTPRINT_MAX: ByteSize = ByteSize(4 << 30);
const FOOTPRINT_MIN: ByteSize = ByteSize(1 << 20);

/// What is asked of the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quality {
    pub tolerance_px: f64,
    pub footprint: ByteSize,
    /// The time that a frame may take; `None` never raises the tolerance for time.
    pub frame_ms: Option<f64>,
}

impl Default for Quality {
    fn default() -> Self {
        Self { tolerance_px: 1.0, footprint: ByteSize(256 << 20), frame_ms: Some(33.0) }
    }
}

impl Quality {
    /// Every number within its range; what is no number is the default.
    pub fn sane(self) -> Self {
        let fallback = Self::default();
        let within = |value: f64, [low, high]: [f64; 2], otherwise: f64| {
            if value.is_finite() { value.clamp(low, high) } else { otherwise }
        };
        Self {
            tolerance_px: within(self.tolerance_px, TOLERANCE_PX, fallback.tolerance_px),
            footprint: self.footprint.clamp(FOOTPRINT_MIN, FOOTPRINT_MAX),
            frame_ms: self.frame_ms.map(|frame_ms| within(frame_ms, FRAME_MS, 33.0)),
        }
    }
}

/// Recording and replaying of paths; times are seconds since the path's start.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Playback {
    #[default]
    Off,
    Recording {
        at_s: f64,
    },
    Replaying {
        at_s: f64,
        of_s: f64,
    },
}

/// A building set or the like, as the list of them shows it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SetRow {
    pub name: String,
    /// The name of the world that it is of.
    pub world: String,
    pub objects: u64,
}

/// Everything the panels show of one frame.
#[derive(Clone, Copy, Debug)]
pub struct Shown<'a> {
    /// Of the clock that the messages were said by.
    pub now_s: f64,
    pub view: View,
    /// The place drawn under the cursor; `None` for the sky or no cursor.
    pub cursor: Option<Geodetic>,
    /// Bounds the drawn ground's distance from the truth there, metres.
    pub cursor_error_m: Option<f64>,
    /// The place drawn in the middle of the picture; `None` for the sky.
    pub middle: Option<Geodetic>,
    pub above_ground_m: Option<f64>,
    pub frame_times: &'a FrameTimes,
    pub report: &'a FrameReport,
    /// Of the newest finished frame; `None` where it cannot be measured.
    pub gpu_ms: Option<f64>,
    pub asked: Quality,
    /// The least that works with this world.
    pub footprint_least: ByteSize,
    pub pages: LayerCounts,
    /// How long the oldest missing page has been awaited.
    pub awaited_s: Option<f64>,
    /// Since the start.
    pub bytes_read: u64,
    pub world: &'a str,
    /// One of each source; empty lines are left out.
    pub credits: &'a [String],
    /// Names, in the order of the number keys.
    pub bookmarks: &'a [String],
    /// The collections by number, and which of them are hidden.
    pub sets: &'a [SetRow],
    pub hidden: CollectionSet,
    /// Whether a world is being opened.
    pub is_opening: bool,
    pub messages: &'a Messages,
    pub playback: Playback,
}
