//! What a user asks for through panels and keys.

use super::place_text::Place;
use crate::units::ByteSize;

/// For the application to do; buttons and keys ask for the same.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Action {
    /// Pixels, within [`super::TOLERANCE_PX`].
    Tolerance(f64),
    /// Sent when a slider is let go, not while it is dragged: a new limit costs.
    Footprint(ByteSize),
    /// Milliseconds within [`super::FRAME_MS`]; `None` switches it off.
    FrameMs(Option<f64>),
    FlyTo(Place),
    /// An index of [`super::Shown::bookmarks`].
    Bookmark(usize),
    NorthUp,
    Reset,
    /// Stops a flight, inertia or a replay.
    Stop,
    Screenshot,
    /// Starts or ends a recording.
    Record(bool),
    /// Starts or ends the replay of the last recording.
    Replay(bool),
    /// A collection by its number is shown, or hidden.
    ShowSet(u8, bool),
    FullScreen,
    Quit,
}
