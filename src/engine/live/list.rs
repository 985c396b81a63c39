//! What the scene thread publishes for the render thread.

use crate::camera::{FlyTo, View};
use crate::content::PageId;
use crate::engine::{EngineParams, FrameReport, Source, TimeBudget};
use crate::paging::Totals;
use crate::paging::{LayerCounts, PageState};
use crate::render::GpuLimits;
use crate::select::Selection;
use std::sync::Arc;
use std::time::Instant;

/// A selection ready to be drawn from any view near the one it was made for.
pub struct DisplayList {
    /// Counts up from 1.
    pub(super) number: u64,
    /// The view that it was selected for.
    pub view: View,
    pub selection: Selection,
    /// Pages by layer and state.
    pub pages: LayerCounts,
    /// Since when the page that has been waited for longest is awaited.
    pub(super) awaited_since: Option<Instant>,
    /// Pages of the front that are not resident.
    pub lacking: Vec<(PageId, PageState)>,
    /// Of the arenas.
    pub(super) limits: GpuLimits,
    /// Without what only drawing tells; what is counted between frames is in `totals`.
    pub(super) report: FrameReport,
    pub(super) totals: Totals,
    /// All that the render thread has not confirmed yet, with the number of the list that brought it first.
    pub(super) changes: Vec<(u64, Change)>,
}

impl DisplayList {
    /// How long the page that has been waited for longest is awaited by now, seconds.
    pub fn awaited_s(&self) -> Option<f64> {
        self.awaited_since.map(|since| since.elapsed().as_secs_f64())
    }
}

/// What is to be done to the arenas before a list is drawn.
#[derive(Clone, Debug)]
pub(super) enum Change {
    Remove(PageId),
    Lift(PageId, Arc<[f32]>),
}

/// What the render thread asks the scene thread for.
pub(super) struct Order {
    pub view: View,
    pub t_s: f64,
    /// The real time of it.
    pub at: Instant,
    pub params: EngineParams,
    /// What is flown over; another one than before where a world was added.
    pub source: Arc<Source>,
    pub time: Option<TimeBudget>,
    /// The flight under way, on the clock of `t_s`.
    pub way: Option<Arc<FlyTo>>,
}
