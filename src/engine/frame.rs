//! One frame, in order, on one thread: completions, selection, requests, lifts, drawing, report.

use super::audit::Auditor;
use super::cost::{Load, TimeBudget};
use super::picture::LastPicture;
use super::reader::Source;
use super::scene::{Scene, timed};
use super::surroundings::{DrawnGround, PickCache};
use super::{EngineError, EngineParams, FrameRequest, Mode, Partition, Reading};
use crate::camera::View;
use crate::layout::RideCounts;
use crate::paging::{FrameReport, FrameTimings, KnownWay, Totals};
use crate::render::{DrawOptions, FrameStats, RenderError, Renderer};
use crate::select::{OutOfView, Selection};
use std::time::Instant;

/// A world, what is resident of it, and a renderer.
pub struct Engine {
    scene: Scene,
    renderer: Renderer,
    frames: u64,
    counted: Totals,
    /// What the last frame drew, and what asking about it keeps.
    drawn: Selection,
    picks: PickCache,
    auditor: Auditor,
}

impl Engine {
    /// Opens the renderer and loads the coarsest pages of all zones.
    pub fn new(source: Source, params: EngineParams) -> Result<Self, EngineError> {
        let auditor = Auditor::new(&source, &params);
        let partition = Partition::new(params.footprint, Reading::of(params.mode, &source), &source.index)?;
        let mut renderer = Renderer::new(partition.gpu_limits())?;
        let source = source.with_atlases(renderer.atlas_format());
        let mut scene = Scene::new(source, params, OutOfView::Left)?;
        scene.load_pinned(&mut renderer);
        if params.mode == Mode::Live {
            scene.set_time(params.frame_ms.map(TimeBudget::new));
        }
        Ok(Self {
            scene,
            renderer,
            frames: 0,
            counted: Totals::default(),
            drawn: Selection::default(),
            picks: PickCache::default(),
            auditor,
        })
    }

    pub fn source(&self) -> &Source {
        &self.scene.source
    }

    pub fn mode(&self) -> Mode {
        self.scene.params.mode
    }

    pub fn adapter_name(&self) -> &str {
        self.renderer.adapter_name()
    }

    /// Bytes read and never drawn so far.
    pub fn wasted_bytes(&self) -> u64 {
        self.scene.residency.usage.wasted_bytes()
    }

    /// Messages of failed reads since the last call; a broken page costs its detail and nothing else.
    pub fn take_failures(&mut self) -> Vec<String> {
        self.scene.residency.take_messages()
    }

    /// Steps the engine by a frame and draws it.
    pub fn frame(&mut self, request: &FrameRequest) -> Result<FrameReport, EngineError> {
        let started = Instant::now();
        let mut timings = FrameTimings::default();
        let chosen = self.scene.advance(&request.view, request.t_s, &mut self.renderer, &mut timings);
        let options = DrawOptions { aov: request.ids, ..DrawOptions::default() };
        let drawn = timed(&mut timings.render_ms, || self.draw(&request.view, &chosen.selection, &options))?;
        timings.frame_ms = started.elapsed().as_secs_f64() * 1000.0;
        self.scene.learn(Load::of(&chosen.selection), timings.frame_ms - chosen.waited_s * 1000.0);
        let mut report = self.scene.report(&chosen, request.t_s, &self.renderer);
        let totals = self.scene.totals();
        report.count(&std::mem::replace(&mut self.counted, totals), &totals);
        report.frame = self.frames;
        report.triangles = drawn.triangles;
        report.draw_calls = drawn.draw_calls;
        report.timings = timings;
        self.frames += 1;
        self.drawn = chosen.selection;
        Ok(report)
    }

    /// What the last frame drew, to be asked by navigation.
    pub fn surroundings(&self) -> DrawnGround<'_> {
        DrawnGround::new(&self.drawn, &self.scene.residency.lifts, &self.picks)
    }

    /// Tells the way of the eye from now on, on the clock of the frames, for what may know it; or that it is not known.
    pub fn set_way(&mut self, known: Option<KnownWay>) {
        self.scene.set_way(known);
    }

    /// What went on along the layout; `None` where none is flown by.
    pub fn ride_counts(&self) -> Option<RideCounts> {
        self.scene.ride_counts()
    }

    /// The list that the last frame drew.
    pub fn drawn(&self) -> &Selection {
        &self.drawn
    }

    /// Draws and waits for the pixels, so that a frame's time is the whole of it.
    fn draw(&mut self, view: &View, selection: &Selection, options: &DrawOptions) -> Result<FrameStats, RenderError> {
        let drawn = self.renderer.draw(view, selection, options)?;
        self.renderer.finish()?;
        Ok(drawn)
    }

    /// The last frame, to be read back.
    pub fn picture(&self) -> LastPicture<'_> {
        LastPicture::new(&self.renderer, &self.scene.source.manifest)
    }

    /// Compares the frame just drawn, with ids, with the settled frame of its view, and completes its report.
    pub fn audit(&mut self, request: &FrameRequest, report: &mut FrameReport) -> Result<(), EngineError> {
        let drawn = self.picture().read_ids()?;
        self.auditor.audit(&drawn, request, report)
    }
}
