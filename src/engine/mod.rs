//! One frame, in order.

mod report;

pub use report::{FrameReport, FrameTimings};
