//! One frame, in order: completions, selection, requests, lifts, drawing, report.

use super::audit::{Silhouettes, Uncovered, compare, may_have_holes};
use super::footprint::Partition;
use super::levels::DrawnLevels;
use super::lift::Ground;
use super::reader::Source;
use super::report::{FrameReport, FrameTimings};
use super::residency::Residency;
use super::surroundings::{DrawnGround, PickCache};
use super::tolerance::DrawnTolerance;
use super::{EngineError, EngineParams, FrameRequest, Mode};
use crate::camera::View;
use crate::paging::ManagerStats;
use crate::render::{DrawOptions, FrameStats, IdOf, RenderError, Renderer};
use crate::select::{OutOfView, SelectParams, Selection, select_raised};
use std::time::Instant;

/// How long a settled frame waits for a failed page between tries, on its own clock, seconds.
const SETTLE_WAIT_S: f64 = 0.25;

/// A world, what is resident of it, and a renderer.
pub struct Engine {
    source: Source,
    params: EngineParams,
    renderer: Renderer,
    residency: Residency,
    tolerance: DrawnTolerance,
    levels: DrawnLevels,
    frames: u64,
    counted: ManagerStats,
    /// What settling has waited beyond the flight's clock, seconds.
    waited_s: f64,
    /// What the last frame drew, and what asking about it keeps.
    drawn: Selection,
    picks: PickCache,
    /// Settles each audited view; made when first needed.
    twin: Option<Box<Engine>>,
}

impl Engine {
    /// Opens the renderer and loads the coarsest pages of all zones.
    pub fn new(source: Source, params: EngineParams) -> Result<Self, EngineError> {
        let partition = Partition::new(params.footprint, params.mode, &source.index)?;
        let mut renderer = Renderer::new(partition.gpu_limits())?;
        let mut residency = Residency::new(&params, partition, &source)?;
        residency.load_pinned(&source, &mut renderer);
        Ok(Self {
            source,
            params,
            renderer,
            residency,
            tolerance: DrawnTolerance::default(),
            levels: DrawnLevels::default(),
            frames: 0,
            counted: ManagerStats::default(),
            waited_s: 0.0,
            drawn: Selection::default(),
            picks: PickCache::default(),
            twin: None,
        })
    }

    pub fn source(&self) -> &Source {
        &self.source
    }

    pub fn mode(&self) -> Mode {
        self.params.mode
    }

    pub fn adapter_name(&self) -> &str {
        self.renderer.adapter_name()
    }

    /// Bytes read and never drawn so far.
    pub fn wasted_bytes(&self) -> u64 {
        self.residency.usage.wasted_bytes()
    }

    /// Messages of failed reads since the last call; a broken page costs its detail and nothing else.
    pub fn take_failures(&mut self) -> Vec<String> {
        self.residency.take_messages()
    }

    /// Steps the engine by a frame and draws it.
    pub fn frame(&mut self, request: &FrameRequest) -> Result<FrameReport, EngineError> {
        let started = Instant::now();
        let mut timings = FrameTimings::default();
        let (selection, waited) = self.advance(request, &mut timings);
        timed(&mut timings.lift_ms, || self.lift(&selection));
        let options = DrawOptions { aov: request.ids, ..DrawOptions::default() };
        let view = &request.view;
        let drawn = timed(&mut timings.render_ms, || self.draw(view, &selection, &options))?;
        timings.frame_ms = started.elapsed().as_secs_f64() * 1000.0;
        self.residency.usage.drawn(&selection);
        let mut report = self.report(request, &selection, &drawn, timings);
        report.would_have_waited = waited;
        self.drawn = selection;
        Ok(report)
    }

    /// What the last frame drew, to be asked by navigation.
    pub fn surroundings(&self) -> DrawnGround<'_> {
        DrawnGround::new(&self.drawn, &self.residency.lifts, &self.picks)
    }

    /// The list that the last frame drew.
    pub fn drawn(&self) -> &Selection {
        &self.drawn
    }

    /// Completions, selection and requests; once, or until settled. In lock-step, what this frame's budget could read
    /// is drawn in this frame. Also tells whether a page of the front was missing when the frame began: there a
    /// renderer that reads on demand would have waited (Varadhan & Manocha 2002, §5).
    fn advance(&mut self, request: &FrameRequest, timings: &mut FrameTimings) -> (Selection, bool) {
        let mut waited = None;
        loop {
            let now_s = request.t_s + self.waited_s;
            timed(&mut timings.complete_ms, || self.residency.receive(now_s, &mut self.renderer));
            let mut selection = timed(&mut timings.select_ms, || self.choose(&request.view));
            let waited = *waited.get_or_insert(selection.stats.pages_missing > 0);
            let hurt = timed(&mut timings.manage_ms, || self.residency.manage(&selection, now_s, &mut self.renderer));
            if hurt {
                selection = timed(&mut timings.select_ms, || self.select_at(&request.view, self.tolerance.factor()));
            }
            let mode = self.params.mode;
            match mode {
                Mode::Settled if !self.is_settled() => {}
                Mode::LockStep if self.residency.manager.stats().in_flight > 0 => {
                    timed(&mut timings.complete_ms, || self.residency.receive(now_s, &mut self.renderer));
                    return (timed(&mut timings.select_ms, || self.choose(&request.view)), waited);
                }
                _ => return (selection, waited),
            }
        }
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

    /// The front at the tolerance asked for, or at the least one whose front fits into the footprint.
    fn choose(&mut self, view: &View) -> Selection {
        let mut tolerance = std::mem::take(&mut self.tolerance);
        let selection = tolerance
            .settle(|factor| self.select_at(view, factor), |selection| self.residency.manager.fits(&selection.demands));
        self.tolerance = tolerance;
        selection
    }

    fn select_at(&self, view: &View, factor: f64) -> Selection {
        let params = SelectParams {
            tolerance_px: self.params.tolerance_px,
            threshold_px: self.params.threshold_px,
            objects: self.params.objects,
            out_of_view: OutOfView::Left,
        };
        select_raised(&self.source.index, &self.residency.cells, view, &params, params.tolerance_px * factor)
    }

    /// Draws and waits for the pixels, so that a frame's time is the whole of it.
    fn draw(&mut self, view: &View, selection: &Selection, options: &DrawOptions) -> Result<FrameStats, RenderError> {
        let drawn = self.renderer.draw(view, selection, options)?;
        self.renderer.finish()?;
        Ok(drawn)
    }

    fn lift(&mut self, selection: &Selection) {
        let ground = Ground::new(&selection.pieces);
        for drawn in &selection.objects {
            if let Some((page, lifts_m)) = self.residency.lifts.update(&self.source.index, &ground, drawn) {
                self.renderer.set_lifts(page, lifts_m);
            }
        }
    }

    fn report(
        &mut self,
        request: &FrameRequest,
        selection: &Selection,
        drawn: &FrameStats,
        timings: FrameTimings,
    ) -> FrameReport {
        let traffic = self.residency.take_traffic(&self.renderer);
        let stats = self.residency.manager.stats();
        let before = std::mem::replace(&mut self.counted, stats);
        let chosen = &selection.stats;
        self.frames += 1;
        FrameReport {
            frame: self.frames - 1,
            t_s: request.t_s,
            tolerance_drawn_px: self.params.tolerance_px * self.tolerance.factor(),
            debt_px: chosen.debt_px,
            excess_max_px: chosen.excess_max_px,
            terrain_excess_max_px: chosen.terrain_excess_max_px,
            excess_p99_px: chosen.excess_p99_px,
            raw_error_px: chosen.raw_error_px,
            // No share is −0.
            coverage: chosen.coverage + 0.0,
            cells_tested: chosen.cells_tested,
            cells_culled: chosen.cells_culled,
            cells_drawn: selection.pieces.len() as u32,
            level_switches: self.levels.switch(selection.pieces.iter().map(|piece| piece.cell)),
            objects_tested: chosen.objects_tested,
            objects_drawn: chosen.objects_drawn,
            objects_culled: chosen.objects_culled,
            triangles: drawn.triangles,
            draw_calls: drawn.draw_calls,
            pages_missing: chosen.pages_missing,
            would_have_waited: false,
            ground_pressed: selection.press.is_some_and(|press| press.buries_eye()),
            bytes_read: traffic.bytes_read,
            seeks: traffic.seeks,
            requests: traffic.requests,
            cancelled: stats.cancelled - before.cancelled,
            failed: stats.failed - before.failed,
            evicted: stats.evicted - before.evicted,
            in_flight: stats.in_flight,
            resident_pages: stats.resident_pages,
            footprint_bytes: traffic.footprint_max_bytes,
            holes: None,
            uncovered_px: None,
            timings,
        }
    }

    /// RGBA8 of the last frame, sRGB, rows from the top.
    pub fn read_color(&mut self) -> Result<Vec<u8>, RenderError> {
        self.renderer.read_color()
    }

    /// Ids of the last frame, if it was asked for them.
    pub fn read_ids(&mut self) -> Result<Vec<u32>, RenderError> {
        self.renderer.read_ids()
    }

    /// Linear depth of the last frame in metres, infinite for the sky, if it was asked for ids.
    pub fn read_depth(&mut self) -> Result<Vec<f32>, RenderError> {
        self.renderer.read_depth_m()
    }

    /// What an id of the last frame stands for, for the legend beside a picture.
    pub fn describe_id(&self, id: u32) -> serde_json::Value {
        match self.renderer.resolve_id(id) {
            None => serde_json::Value::Null,
            Some(IdOf::Cell(cell)) => serde_json::json!({ "cell": cell.to_string() }),
            Some(IdOf::Object { collection, id }) => {
                let name = self.source.manifest.collections.get(usize::from(collection)).map(|info| &info.name);
                serde_json::json!({ "collection": name, "object": id })
            }
        }
    }

    /// Compares the frame just drawn, with ids, with the settled frame of its view, and completes its report.
    pub fn audit(&mut self, request: &FrameRequest, report: &mut FrameReport) -> Result<(), EngineError> {
        let drawn = self.read_ids()?;
        let uncovered = if may_have_holes(&drawn) {
            let settled = self.settled_ids(request)?;
            compare(&drawn, &settled, request.view.size_px[0] as usize, Silhouettes::of(report))
        } else {
            Uncovered::default()
        };
        report.holes = Some(uncovered.holes);
        report.uncovered_px = Some(uncovered.pixels);
        Ok(())
    }

    fn settled_ids(&mut self, request: &FrameRequest) -> Result<Vec<u32>, EngineError> {
        let twin = match &mut self.twin {
            Some(twin) => twin,
            none => {
                let params = EngineParams { mode: Mode::Settled, ..self.params };
                none.insert(Box::new(Self::new(self.source.clone(), params)?))
            }
        };
        twin.frame(&FrameRequest { ids: true, ..*request })?;
        Ok(twin.read_ids()?)
    }
}

/// Runs a stage and adds its time.
fn timed<T>(total_ms: &mut f64, stage: impl FnOnce() -> T) -> T {
    let started = Instant::now();
    let result = stage();
    *total_ms += started.elapsed().as_secs_f64() * 1000.0;
    result
}
