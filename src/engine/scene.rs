//! The part of a frame that needs no GPU: completions, selection, requests, lifts.

use super::cost::{Load, TimeBudget};
use super::footprint::{Partition, Reading};
use super::residency::Residency;
use super::sink::PageSink;
use super::{EngineError, EngineParams, Mode, Source};
use crate::camera::View;
use crate::layout::{Ride, RideCounts, Rider, times_ahead_s};
use crate::paging::{
    DrawnLevels, DrawnTolerance, Frame, FrameReport, FrameTimings, KnownWay, Lack, Modelled, Planner, Totals,
};
use crate::render::Renderer;
use crate::select::{Demand, DrawPiece, OutOfView, SelectParams, Selection, needed, select_raised};
use std::time::{Duration, Instant};

/// How long a settled frame waits for a failed page between tries, on its own clock, seconds.
const SETTLE_WAIT_S: f64 = 0.25;

/// A frame that waits for its front waits no longer than this for what does not come.
const SYNC_WAIT_MAX: Duration = Duration::from_secs(60);

/// Frames further apart than this are none of one motion, seconds.
const STEP_MAX_S: f64 = 0.25;

/// A world, what is resident of it, and what is selected of that.
pub struct Scene {
    pub source: Source,
    pub params: EngineParams,
    /// From its start on.
    reading: Reading,
    pub residency: Residency,
    out_of_view: OutOfView,
    planner: Planner,
    /// Where a layout is flown by.
    rider: Option<Rider>,
    /// Time of the step before, on the flight's clock, seconds.
    stepped_s: Option<f64>,
    tolerance: DrawnTolerance,
    /// Holds the frame time, where one is asked for.
    time: Option<TimeBudget>,
    /// The tolerance's factor when the eye last came to rest.
    moving_factor: f64,
    levels: DrawnLevels,
    level_switches: u64,
    /// What settling has waited beyond the flight's clock, seconds.
    waited_s: f64,
}

/// What a step chose to draw.
pub struct Chosen {
    pub selection: Selection,
    /// A page of the front was missing when the step began: there a renderer that reads on demand would have waited
    /// (Varadhan & Manocha 2002, §5).
    pub would_have_waited: bool,
    /// Time that a live frame stood still for its pages, seconds.
    pub waited_s: f64,
}

impl Scene {
    pub fn new(source: Source, params: EngineParams, out_of_view: OutOfView) -> Result<Self, EngineError> {
        let reading = Reading::of(params.mode, &source);
        let partition = Partition::new(params.footprint, reading, &source.index)?;
        let residency = Residency::new(&params, reading, partition, &source)?;
        Ok(Self {
            rider: rider(&source, &params),
            source,
            params,
            reading,
            residency,
            out_of_view,
            planner: Planner::new(&params.planner),
            stepped_s: None,
            tolerance: DrawnTolerance::default(),
            time: None,
            moving_factor: 1.0,
            levels: DrawnLevels::default(),
            level_switches: 0,
            waited_s: 0.0,
        })
    }

    /// The frame time to hold from now on. Without one, a tolerance that was raised for it comes back at once: an eye at
    /// rest waits for a picture once. When the eye moves on, so does the tolerance where it was.
    pub fn set_time(&mut self, time: Option<TimeBudget>) {
        match (&self.time, &time) {
            (Some(_), None) => {
                self.moving_factor = if self.tolerance.lack() == Lack::Time { self.tolerance.factor() } else { 1.0 };
                if self.tolerance.lack() == Lack::Time {
                    self.tolerance = DrawnTolerance::default();
                }
            }
            (None, Some(_)) if self.moving_factor > self.tolerance.factor() => {
                self.tolerance = DrawnTolerance::slowed(self.moving_factor);
            }
            _ => {}
        }
        self.time = time;
    }

    /// Learns what a frame took in all, milliseconds.
    pub fn learn(&mut self, load: Load, took_ms: f64) {
        if let Some(time) = &mut self.time {
            time.model.learn(load, took_ms);
        }
    }

    /// Loads the coarsest terrain of all zones and the world image.
    pub fn load_pinned(&mut self, renderer: &mut Renderer) {
        self.residency.load_pinned(&self.source, renderer);
        self.residency.load_world_image(&self.source, renderer);
    }

    /// Completions, selection and requests; once, or until settled. In lock-step, what this frame's budget could read
    /// is drawn in this frame.
    pub fn advance(&mut self, view: &View, t_s: f64, sink: &mut dyn PageSink, timings: &mut FrameTimings) -> Chosen {
        let mut would_have_waited = None;
        let mut waiting_since = None;
        let selection = loop {
            let now_s = t_s + self.waited_s;
            timed(&mut timings.complete_ms, || self.residency.receive(now_s, sink));
            let mut selection = timed(&mut timings.select_ms, || self.choose(view));
            would_have_waited.get_or_insert(selection.stats.pages_missing > 0);
            let hurt = timed(&mut timings.manage_ms, || {
                let (demands, ride) = self.plan(view, &selection, now_s);
                let ridden = self.rider.as_mut().map(|rider| (rider, &ride));
                self.residency.manage(&selection, &demands, ridden, now_s, sink)
            });
            if hurt {
                selection = timed(&mut timings.select_ms, || self.select_at(view, self.tolerance.factor()));
            }
            let mode = self.params.mode;
            match mode {
                Mode::Settled if !self.is_settled() => {}
                _ if self.awaits_front(waiting_since) => {
                    let deadline = *waiting_since.get_or_insert_with(Instant::now) + SYNC_WAIT_MAX;
                    timed(&mut timings.complete_ms, || self.residency.receive_all(deadline, now_s, sink));
                }
                Mode::LockStep if self.residency.manager.stats().in_flight > 0 => {
                    timed(&mut timings.complete_ms, || self.residency.receive(now_s, sink));
                    break timed(&mut timings.select_ms, || self.select_at(view, self.tolerance.factor()));
                }
                _ => break selection,
            }
        };
        timed(&mut timings.lift_ms, || self.lift(&selection, sink));
        self.residency.usage.drawn(&selection);
        self.level_switches += u64::from(self.levels.switch(selection.pieces.iter().map(DrawPiece::page_cell)));
        Chosen {
            selection,
            would_have_waited: would_have_waited.unwrap_or(false),
            waited_s: waiting_since
                .filter(|_| self.params.mode == Mode::Live)
                .map_or(0.0, |at| at.elapsed().as_secs_f64()),
        }
    }

    /// Whether a frame that reads synchronously has something to wait for.
    fn awaits_front(&self, since: Option<Instant>) -> bool {
        let may_wait = self.params.sync_reads && self.params.mode != Mode::Settled;
        let lacks = !self.residency.manager.is_idle() && self.residency.is_reading();
        may_wait && lacks && since.is_none_or(|since| since.elapsed() < SYNC_WAIT_MAX)
    }

    /// What to ask for in this step. A settled frame is of no later use, and asks for its front alone; so does one that
    /// reads synchronously.
    fn plan(&mut self, view: &View, selection: &Selection, now_s: f64) -> (Vec<Demand>, Ride) {
        if self.params.mode == Mode::Settled || self.params.sync_reads {
            return (selection.demands.clone(), Ride::default());
        }
        let step_s = self.stepped_s.replace(now_s).map_or(0.0, |before_s| (now_s - before_s).clamp(0.0, STEP_MAX_S));
        let frame = Frame {
            index: &self.residency.index,
            cells: &self.residency.cells,
            manager: &self.residency.manager,
            view,
            now_s,
            step_s,
            params: &self.select_params(),
            drawn_tolerance_px: self.params.tolerance_px * self.tolerance.factor(),
        };
        let demands = self.planner.plan(&frame, &selection.demands);
        let Some(rider) = &mut self.rider else { return (demands, Ride::default()) };
        let (manager, index) = (&self.residency.manager, &self.residency.index);
        let times_s = &times_ahead_s(manager.pace().lead_secs() + step_s);
        let eyes = if manager.lacks_front() { Vec::new() } else { self.planner.eyes_ahead(&frame, times_s) };
        let thresholds = (self.params.tolerance_px, self.params.threshold_px);
        let ride = rider.step(view, thresholds, &eyes, &|page| manager.is_held(page));
        let demands = rider.demands(demands, &ride.runs, &|page| manager.is_held(page), &|page| page.place(index));
        (demands, ride)
    }

    /// What went on along the layout; `None` where none is flown by.
    pub fn ride_counts(&self) -> Option<RideCounts> {
        self.rider.as_ref().map(Rider::counts)
    }

    /// Tells the way of the eye from now on, where it is known.
    pub fn set_way(&mut self, known: Option<KnownWay>) {
        self.planner.set_way(known);
    }

    fn is_settled(&mut self) -> bool {
        if self.residency.manager.stats().in_flight > 0 {
            return false;
        }
        let settled = self.residency.manager.is_idle();
        if !settled {
            self.waited_s += SETTLE_WAIT_S;
        }
        settled && !self.tolerance.is_moving()
    }

    /// The front at the tolerance asked for, or at the least one whose front fits into the footprint and the time.
    fn choose(&mut self, view: &View) -> Selection {
        let mut tolerance = std::mem::take(&mut self.tolerance);
        let selection = tolerance.settle(
            |factor| self.select_at(view, factor),
            |selection, aim| {
                if !self.residency.manager.fits(&selection.demands) {
                    return Some(Lack::Memory);
                }
                let slow = self.time.is_some_and(|time| !time.allows(selection, aim));
                slow.then_some(Lack::Time)
            },
        );
        self.tolerance = tolerance;
        selection
    }

    fn select_params(&self) -> SelectParams {
        SelectParams {
            tolerance_px: self.params.tolerance_px,
            threshold_px: self.params.threshold_px,
            objects: self.params.objects,
            hidden: self.params.hidden,
            out_of_view: self.out_of_view,
        }
    }

    fn select_at(&self, view: &View, factor: f64) -> Selection {
        let params = self.select_params();
        select_raised(&self.residency.index, &self.residency.cells, view, &params, params.tolerance_px * factor)
    }

    /// What a selection draws and holds beyond what its picture needs, as far as resident pages tell.
    pub fn modelled(&self, view: &View, selection: &Selection) -> Modelled {
        let Residency { index, cells, usage, .. } = &self.residency;
        let needed = needed(index, view, &self.select_params(), cells);
        Modelled::of(view, selection, &needed, None, usage.resident_bytes())
    }

    fn lift(&mut self, selection: &Selection, sink: &mut dyn PageSink) {
        let Residency { lifts, index, .. } = &mut self.residency;
        lifts.follow(index, selection, |page, lifts_m| sink.set_lifts(page, lifts_m));
    }

    /// Whether something is under way that may change what is drawn of the same view.
    pub fn is_busy(&self) -> bool {
        self.residency.is_reading() || self.tolerance.is_moving()
    }

    /// Whether a step would choose otherwise though neither view nor pages changed: the tolerance comes back, or a
    /// failed page may be tried again by now.
    pub fn wants_step(&self, now_s: f64) -> bool {
        self.tolerance.is_moving() || self.residency.manager.may_retry(now_s)
    }

    pub fn totals(&self) -> Totals {
        let (traffic, stats) = (self.residency.traffic, self.residency.manager.stats());
        Totals {
            level_switches: self.level_switches,
            bytes_read: traffic.bytes_read,
            seeks: traffic.seeks,
            requests: traffic.requests,
            ..Totals::of(&stats)
        }
    }

    /// Changes what can be changed while flying. A footprint that cannot work leaves all as it was.
    pub fn set_params(&mut self, params: EngineParams) -> Result<(), EngineError> {
        let partition = Partition::new(params.footprint, self.reading, &self.source.index)?;
        self.residency.set_partition(partition);
        if params.planner != self.params.planner {
            self.planner = Planner::new(&params.planner);
        }
        if (params.objects, params.hidden) != (self.params.objects, self.params.hidden) {
            self.rider = rider(&self.source, &params);
        }
        self.params = EngineParams { mode: self.params.mode, ..params };
        Ok(())
    }

    /// Goes on over another source, which holds all that the one before does: what is resident stays. A footprint that
    /// cannot hold its index leaves all as it was.
    pub fn set_source(&mut self, source: Source) -> Result<(), EngineError> {
        let partition = Partition::new(self.params.footprint, self.reading, &source.index)?;
        self.residency.set_partition(partition);
        self.residency.set_index(source.index.clone());
        // What was planned and surveyed was so over the old index.
        self.planner = Planner::new(&self.params.planner);
        self.rider = rider(&source, &self.params);
        self.source = source;
        Ok(())
    }

    /// The report of a selection that is not drawn yet: no triangles, draw calls and drawing times.
    pub fn report(&mut self, chosen: &Chosen, t_s: f64, sink: &dyn PageSink) -> FrameReport {
        let stats = self.residency.manager.stats();
        let selected = &chosen.selection.stats;
        let mut report = FrameReport {
            t_s,
            tolerance_drawn_px: self.params.tolerance_px * self.tolerance.factor(),
            lack: self.tolerance.lack(),
            cells_drawn: chosen.selection.pieces.len() as u32,
            would_have_waited: chosen.would_have_waited,
            waited_s: chosen.waited_s,
            ground_pressed: chosen.selection.press.is_some_and(|press| press.buries_eye()),
            front_size_bytes: self.residency.manager.front_bytes(),
            in_flight: stats.in_flight,
            resident_pages: stats.resident_pages,
            footprint_bytes: self.residency.take_footprint_max(sink),
            ..FrameReport::default()
        };
        report.take_measures(selected);
        report
    }
}

/// Who follows the eye through the source's layout, where there is one and it is made for what is drawn.
fn rider(source: &Source, params: &EngineParams) -> Option<Rider> {
    let suits = params.objects == SelectParams::DEFAULT.objects && params.hidden == SelectParams::DEFAULT.hidden;
    source.layout.clone().filter(|_| suits).map(Rider::new)
}

/// Runs a stage and adds its time.
pub(super) fn timed<T>(total_ms: &mut f64, stage: impl FnOnce() -> T) -> T {
    let started = Instant::now();
    let result = stage();
    *total_ms += started.elapsed().as_secs_f64() * 1000.0;
    result
}
