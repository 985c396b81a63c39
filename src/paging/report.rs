//! What one frame did and cost: feeds the display, the tests, the charts and the logs.

use super::manager::ManagerStats;
use super::tolerance::Lack;
use crate::select::SelectStats;
use serde::Serialize;

/// Counts and measures of one frame. Everything but `timings` follows from the input alone in lock-step runs.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct FrameReport {
    pub frame: u64,
    /// Time on the flight's clock, seconds.
    pub t_s: f64,
    /// The tolerance that the front was cut to: the one asked for, or more where the footprint or the frame's time did
    /// not hold that front.
    pub tolerance_drawn_px: f64,
    /// What raised it.
    pub lack: Lack,
    /// Detail debt: sum over the layers of the screen-weighted mean excess, px.
    pub debt_px: f64,
    pub excess_max_px: f64,
    /// Of terrain alone, px.
    pub terrain_excess_max_px: f64,
    pub excess_p99_px: f64,
    /// Largest drawn screen error, curable or not, px.
    pub raw_error_px: f64,
    /// Share of the screen with excess 0.
    pub coverage: f64,
    pub cells_tested: u32,
    pub cells_culled: u32,
    pub cells_drawn: u32,
    /// Drawn cells that lie where the frame before drew another level.
    pub level_switches: u32,
    pub objects_tested: u32,
    pub objects_drawn: u32,
    pub objects_culled: u32,
    pub triangles: u64,
    pub draw_calls: u32,
    /// Pages of the front that were not there.
    pub pages_missing: u32,
    /// Varadhan's renderer would have stood still for a page of this frame's front.
    pub would_have_waited: bool,
    pub ground_pressed: bool,
    /// Of reads that ended in this frame.
    pub bytes_read: u64,
    /// Reads that did not start where the one before ended.
    pub seeks: u64,
    pub requests: u64,
    pub cancelled: u64,
    /// Reads that failed or met a broken page.
    pub failed: u64,
    pub evicted: u64,
    /// Stored bytes asked for in this frame: of pages that its front lacked, and of those that only later frames are
    /// expected to need.
    pub front_bytes: u64,
    pub ahead_bytes: u64,
    pub in_flight: u64,
    /// Decoded bytes of the front, by estimates where its pages were not there.
    pub front_size_bytes: u64,
    pub resident_pages: u64,
    /// Bytes allocated for pages, GPU arenas, decode scratch and index, at their highest in this frame.
    pub footprint_bytes: u64,
    /// Pixels that the settled frame covers and this one does not, further from the settled frame's own sky than the
    /// drawn error can move a silhouette; `None` where not audited.
    pub holes: Option<u64>,
    /// The same with the silhouettes.
    pub uncovered_px: Option<u64>,
    /// Time that a frame stood still for its pages, by the virtual or the real clock, seconds; 0 but where reads are
    /// synchronous, and in lock-step, which has no clock.
    pub waited_s: f64,
    /// The debt that no policy can fall below here, px; `None` where it was not computed.
    pub debt_bound_px: Option<f64>,
    /// Over-modelling (see [`Modelled`](super::Modelled)); `None` where it was not measured.
    pub modelled_triangles: Option<u64>,
    pub needed_triangles: Option<u64>,
    pub front_triangles: Option<u64>,
    pub needed_ground_triangles: Option<u64>,
    pub view_cut_triangles: Option<u64>,
    pub resident_bytes: Option<u64>,
    pub needed_bytes: Option<u64>,
    pub seen_triangles: Option<u64>,
    pub seen_bytes: Option<u64>,
    #[serde(skip)]
    pub timings: FrameTimings,
}

/// Where a frame's time went, milliseconds of the real clock. In a window the scene thread's part (complete, select,
/// manage, lift) stands in the first frame that draws its list, and is 0 in the others.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct FrameTimings {
    /// From the start of the frame to its pixels.
    pub frame_ms: f64,
    /// Taking in what arrived: decoding where the run serves its own reads, uploads.
    pub complete_ms: f64,
    pub select_ms: f64,
    pub manage_ms: f64,
    pub lift_ms: f64,
    /// In a window: what the render thread takes of lists and pages before it draws.
    pub upload_ms: f64,
    /// Building meshes, recording and waiting for the pixels. On a software renderer this is drawing itself.
    pub render_ms: f64,
}

impl FrameTimings {
    /// Time of all stages before the GPU's work.
    pub fn cpu_ms(&self) -> f64 {
        self.complete_ms + self.select_ms + self.manage_ms + self.lift_ms + self.upload_ms
    }
}

/// Sums since a run began; what happened in between is the difference of two.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Totals {
    pub level_switches: u64,
    pub bytes_read: u64,
    pub seeks: u64,
    pub requests: u64,
    pub cancelled: u64,
    pub failed: u64,
    pub evicted: u64,
    pub front_bytes: u64,
    pub ahead_bytes: u64,
}

impl Totals {
    /// With what the request manager has counted.
    pub fn of(stats: &ManagerStats) -> Self {
        Self {
            cancelled: stats.cancelled,
            failed: stats.failed,
            evicted: stats.evicted,
            front_bytes: stats.front_bytes_started,
            ahead_bytes: stats.ahead_bytes_started,
            ..Self::default()
        }
    }
}

impl FrameReport {
    /// Takes over what selection counted and measured.
    pub fn take_measures(&mut self, selected: &SelectStats) {
        self.debt_px = selected.debt_px;
        self.excess_max_px = selected.excess_max_px;
        self.terrain_excess_max_px = selected.terrain_excess_max_px;
        self.excess_p99_px = selected.excess_p99_px;
        self.raw_error_px = selected.raw_error_px;
        // No share is −0.
        self.coverage = selected.coverage + 0.0;
        self.cells_tested = selected.cells_tested;
        self.cells_culled = selected.cells_culled;
        self.objects_tested = selected.objects_tested;
        self.objects_drawn = selected.objects_drawn;
        self.objects_culled = selected.objects_culled;
        self.pages_missing = selected.pages_missing;
    }

    /// Takes in what happened between two counts.
    pub fn count(&mut self, before: &Totals, now: &Totals) {
        self.level_switches = (now.level_switches - before.level_switches) as u32;
        self.bytes_read = now.bytes_read - before.bytes_read;
        self.seeks = now.seeks - before.seeks;
        self.requests = now.requests - before.requests;
        self.cancelled = now.cancelled - before.cancelled;
        self.failed = now.failed - before.failed;
        self.evicted = now.evicted - before.evicted;
        self.front_bytes = now.front_bytes - before.front_bytes;
        self.ahead_bytes = now.ahead_bytes - before.ahead_bytes;
    }
}
