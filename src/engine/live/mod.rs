//! Windows: the render thread draws the last published display list and never waits; the scene thread selects, ranks
//! and manages; servers read and decode (Davis et al. 1999, §IV; Funkhouser 1996, fig. 2).
//!
//! Pages go to the render thread through a queue of uploads, from which each frame takes no more than a budget, and
//! back come their sizes; only then may lists draw from them. What is to be removed or lifted goes with the lists, again
//! and again until the render thread has confirmed it, as lists may be overtaken.

mod fade;
mod latest;
mod list;
mod remote;
mod thread;

use super::cost::{Load, TimeBudget};
use super::footprint::{PAGES_IN_FLIGHT_MAX, Partition, Reading};
use super::lift::LiftCopies;
use super::reader::SwitchReader;
use super::scene::{Scene, timed};
use super::surroundings::{DrawnGround, PickCache};
use super::upload::UploadRate;
use super::{EngineError, EngineParams, FrameReport, FrameTimings, Mode, Source};
use crate::camera::{FlyTo, View};
use crate::paging::Totals;
use crate::render::{DrawOptions, GpuLimits, Renderer};
use crate::select::OutOfView;
use crate::units::ByteSize;
use crossbeam_channel::{Receiver, Sender, bounded};
use fade::Fades;
use latest::Latest;
pub use list::DisplayList;
use list::{Change, Order};
use remote::{Remote, Upload, Uploaded};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread::{Builder, JoinHandle};
use std::time::Instant;
use thread::SceneThread;

/// Messages that wait to be shown; further ones are left out.
const MESSAGES_MAX: usize = 32;
/// How far a list's view is wider than the present one on each side, at most, as a share of the picture.
const PAD_SHARE_MAX: f64 = 0.25;
/// A list is drawn up to so many frames after it was ordered.
const PAD_FRAMES: f64 = 2.5;

/// Whether frames follow one another.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pace {
    /// The frame time is held, where one is asked for.
    Moving,
    /// The picture will stay: it may take its time.
    Resting,
}

/// Called when a new list is there; from the scene thread.
pub type Notify = Box<dyn Fn() + Send>;

/// What both threads see. Nothing in it is ever waited for.
#[derive(Default)]
struct Shared {
    orders: Latest<Order>,
    lists: Latest<DisplayList>,
    /// A list that was drawn: the scene thread lets go of its pages.
    spent: Latest<DisplayList>,
    /// Number of the last list whose changes were made.
    applied: AtomicU64,
    allocated_bytes: AtomicU64,
    mesh_bytes: AtomicU64,
    /// The highest since the last frame.
    footprint_max_bytes: AtomicU64,
}

/// What an order asked for: the next one with the same would change nothing.
#[derive(Debug, PartialEq)]
struct Asked {
    view: View,
    params: EngineParams,
    pace: Pace,
    way: Option<Arc<FlyTo>>,
}

/// The render thread's side; owns the renderer. Dropped, it ends the scene thread.
pub struct Live {
    source: Arc<Source>,
    /// What all threads read from.
    reader: Arc<SwitchReader>,
    params: EngineParams,
    renderer: Renderer,
    shared: Arc<Shared>,
    uploads: Receiver<Upload>,
    uploaded: Sender<Uploaded>,
    messages: Receiver<String>,
    /// Dropped to end the scene thread.
    wake: Option<Sender<()>>,
    thread: Option<JoinHandle<()>>,
    list: Box<DisplayList>,
    lifts: LiftCopies,
    fades: Fades,
    /// An upload that waits for its list.
    held_over: Option<Upload>,
    upload_rate: UploadRate,
    time: TimeBudget,
    counted: Totals,
    frames: u64,
    last_view: Option<View>,
    ordered: Option<Asked>,
    /// The flight under way.
    way: Option<Arc<FlyTo>>,
}

impl Live {
    /// What a renderer may hold for these parameters.
    pub fn gpu_limits(source: &Source, params: &EngineParams) -> Result<GpuLimits, EngineError> {
        Ok(Partition::new(params.footprint, Reading::of(Mode::Live, source), &source.index)?.gpu_limits())
    }

    /// Loads the coarsest pages of all zones and starts the threads; the first frame already has the globe.
    pub fn start(
        source: Source,
        params: EngineParams,
        mut renderer: Renderer,
        view: View,
        notify: Notify,
    ) -> Result<Self, EngineError> {
        let params = live_params(params);
        let source = source.with_atlases(renderer.atlas_format());
        let reader = Arc::new(SwitchReader::new(source.reader.clone()));
        let source = Arc::new(Source { reader: reader.clone(), ..source });
        let mut scene = Scene::new(Source::clone(&source), params, OutOfView::Coarse)?;
        scene.load_pinned(&mut renderer);
        let shared = Arc::new(Shared::default());
        let (to_render, uploads) = bounded(PAGES_IN_FLIGHT_MAX);
        let (uploaded, from_render) = bounded(PAGES_IN_FLIGHT_MAX);
        let (to_show, messages) = bounded(MESSAGES_MAX);
        let (wake, woken) = bounded(1);
        let remote = Remote::new(shared.clone(), to_render, from_render);
        let order = Order { view, t_s: 0.0, at: Instant::now(), params, source: source.clone(), time: None, way: None };
        let mut scene_thread = SceneThread {
            scene,
            remote,
            shared: shared.clone(),
            wake: woken,
            messages: to_show,
            notify,
            order,
            again: None,
        };
        tell_usage(&shared, &renderer);
        let list = Box::new(scene_thread.make_list());
        let mut live = Self {
            time: TimeBudget::new(params.frame_ms.unwrap_or(f64::INFINITY)),
            source,
            reader,
            params,
            renderer,
            shared,
            uploads,
            uploaded,
            messages,
            wake: Some(wake),
            thread: None,
            list,
            lifts: LiftCopies::default(),
            fades: Fades::default(),
            held_over: None,
            upload_rate: UploadRate::default(),
            counted: Totals::default(),
            frames: 0,
            last_view: None,
            ordered: None,
            way: None,
        };
        let named = Builder::new().name("scene".into());
        live.thread = Some(named.spawn(move || scene_thread.run()).map_err(EngineError::Thread)?);
        Ok(live)
    }

    pub fn source(&self) -> &Source {
        &self.source
    }

    pub fn params(&self) -> &EngineParams {
        &self.params
    }

    /// Flies on over another source, which holds all that the one before does and more: a world that was added. Pages
    /// that are resident or under way stay. From the next order on.
    pub fn set_source(&mut self, source: Source) -> Result<(), EngineError> {
        Self::gpu_limits(&source, &self.params)?;
        // Before the index that tells of them: pages of the new source may be asked for at once.
        let source = source.with_atlases(self.renderer.atlas_format());
        self.reader.set(source.reader);
        self.source = Arc::new(Source { reader: self.reader.clone(), ..source });
        self.ordered = None;
        Ok(())
    }

    /// From the next order on.
    pub fn set_params(&mut self, params: EngineParams) -> Result<(), EngineError> {
        Self::gpu_limits(&self.source, &params)?;
        self.params = live_params(params);
        self.time.frame_ms = self.params.frame_ms.unwrap_or(f64::INFINITY);
        Ok(())
    }

    /// Tells the flight that is under way on the clock of [`Live::frame`], or that there is none: where it leads is
    /// known, and fetched ahead. From the next order on.
    pub fn set_way(&mut self, flight: Option<Arc<FlyTo>>) {
        self.way = flight;
    }

    /// The least footprint that works with a world in a window.
    pub fn least_footprint(source: &Source) -> ByteSize {
        Partition::least(Reading::of(Mode::Live, source), &source.index)
    }

    /// Time of the GPU for the newest frame that is known to be finished, milliseconds; without the panels.
    pub fn gpu_ms(&mut self) -> Option<f64> {
        self.renderer.gpu_ms().map(f64::from)
    }

    /// Whether the device is gone: what is left to do is to start anew with another renderer.
    pub fn is_lost(&self) -> bool {
        self.renderer.is_lost()
    }

    pub fn renderer(&mut self) -> &mut Renderer {
        &mut self.renderer
    }

    /// What the last frame drew.
    pub fn list(&self) -> &DisplayList {
        &self.list
    }

    /// What the last frame drew, to be asked by navigation; `cache` is kept from call to call.
    pub fn surroundings<'a>(&'a self, cache: &'a PickCache) -> DrawnGround<'a> {
        DrawnGround::new(&self.list.selection, &self.lifts, cache)
    }

    /// Messages of failures since the last call.
    pub fn take_messages(&mut self) -> Vec<String> {
        self.messages.try_iter().collect()
    }

    /// Draws a view from the newest list and orders the next one; `t_s` must not fall. Waits for nothing.
    pub fn frame(&mut self, view: &View, t_s: f64, pace: Pace) -> Result<FrameReport, EngineError> {
        let started = Instant::now();
        if self.thread.as_ref().is_some_and(JoinHandle::is_finished) {
            return Err(EngineError::SceneEnded);
        }
        self.order(view, t_s, pace);
        let mut timings = FrameTimings::default();
        let is_new = timed(&mut timings.upload_ms, || {
            let is_new = self.take_list(t_s) || self.frames == 0;
            self.take_uploads();
            is_new
        });
        let list = &self.list;
        let options = DrawOptions { lowest_m: self.source.manifest.height_range_m.0, ..DrawOptions::default() };
        let fades = self.fades.now(&list.selection.objects, t_s);
        let drawn = timed(&mut timings.render_ms, || match &fades {
            Some((steady, fading)) => self.renderer.draw_fading(view, &list.selection, steady, fading, &options),
            None => self.renderer.draw(view, &list.selection, &options),
        })?;
        timings.frame_ms = started.elapsed().as_secs_f64() * 1000.0;
        let mut report = list.report.clone();
        report.count(&std::mem::replace(&mut self.counted, list.totals), &list.totals);
        report.frame = self.frames;
        report.t_s = t_s;
        report.triangles = drawn.triangles;
        report.draw_calls = drawn.draw_calls;
        report.footprint_bytes = self.shared.footprint_max_bytes.swap(0, Ordering::Relaxed).max(report.footprint_bytes);
        // What the scene thread took for a list counts in the first frame that draws it.
        let scene = if is_new { report.timings } else { FrameTimings::default() };
        report.timings = FrameTimings {
            upload_ms: timings.upload_ms,
            render_ms: timings.render_ms,
            frame_ms: timings.frame_ms,
            ..scene
        };
        self.frames += 1;
        tell_usage(&self.shared, &self.renderer);
        Ok(report)
    }

    /// Tells what a frame like the last one took in all, milliseconds: the next tolerance follows from it.
    pub fn learn(&mut self, took_ms: f64) {
        self.time.model.learn(Load::of(&self.list.selection), took_ms);
    }

    /// Asks for a list of this view, unless the last one asked for is the same.
    fn order(&mut self, view: &View, t_s: f64, pace: Pace) {
        let pad_px = self.last_view.map_or(0, |last| pad_px(&last, view));
        self.last_view = Some(*view);
        let time = self.params.frame_ms.filter(|_| pace == Pace::Moving).map(|_| self.time);
        let way = self.way.clone();
        let (view, params, source) = (view.padded(pad_px), self.params, self.source.clone());
        let order = Order { view, t_s, at: Instant::now(), params, source, time, way };
        let asked = Asked { view: order.view, params: order.params, pace, way: order.way.clone() };
        if self.ordered.as_ref() == Some(&asked) {
            return;
        }
        self.ordered = Some(asked);
        drop(self.shared.orders.publish(Box::new(order)));
        self.wake();
    }

    fn wake(&self) {
        if let Some(wake) = &self.wake {
            // Full: it is awake already.
            let _ = wake.try_send(());
        }
    }

    /// False where there is no newer one.
    fn take_list(&mut self, t_s: f64) -> bool {
        let Some(list) = self.shared.lists.take() else { return false };
        let applied = self.shared.applied.load(Ordering::Relaxed);
        for (_, change) in list.changes.iter().filter(|&&(number, _)| number > applied) {
            match change {
                Change::Remove(page) => {
                    self.renderer.remove(*page);
                    self.lifts.forget(*page);
                    self.fades.forget(*page);
                }
                Change::Lift(page, lifts_m) => {
                    self.renderer.set_lifts(*page, lifts_m);
                    self.lifts.set(*page, lifts_m);
                }
            }
        }
        self.fades.change(&self.list.selection.objects, &list.selection.objects, t_s);
        self.renderer.set_limits(list.limits);
        let is_over = list.report.footprint_bytes > self.params.footprint.0;
        if is_over {
            // The limit was lowered, and pages that stay keep chunks that are nearly empty.
            self.renderer.compact();
        }
        tell_usage(&self.shared, &self.renderer);
        self.shared.applied.store(list.number, Ordering::Release);
        let removed = |(number, change): &(u64, Change)| *number > applied && matches!(change, Change::Remove(_));
        if is_over || list.changes.iter().any(removed) {
            // There is room again.
            self.wake();
        }
        drop(self.shared.spent.publish(std::mem::replace(&mut self.list, list)));
        true
    }

    fn take_uploads(&mut self) {
        let applied = self.shared.applied.load(Ordering::Relaxed);
        let (started, budget_bytes) = (Instant::now(), self.upload_rate.budget_bytes(self.params.frame_ms));
        let (mut taken_bytes, mut taken) = (0, false);
        while taken_bytes < budget_bytes
            && let Some((number, page)) = self.held_over.take().or_else(|| self.uploads.try_recv().ok())
        {
            if number > applied {
                self.held_over = Some((number, page));
                break;
            }
            let result = self.renderer.upload(&page);
            taken_bytes += result.unwrap_or(0);
            // The queue holds as many as may be in flight.
            let _ = self.uploaded.try_send((page.id(), result));
            taken = true;
        }
        if taken {
            self.upload_rate.learn(taken_bytes, started.elapsed().as_secs_f64() * 1000.0);
            self.wake();
        }
    }

    /// Whether one rep is giving way to another.
    pub fn is_fading(&self) -> bool {
        !self.fades.is_empty()
    }

    /// Whether uploads wait for the next frame.
    pub fn has_uploads(&self) -> bool {
        self.held_over.is_some() || !self.uploads.is_empty()
    }
}

impl Live {
    /// Ends the scene thread; only the last list can be drawn from then on.
    pub fn close(&mut self) {
        self.wake = None;
        if let Some(thread) = self.thread.take() {
            // A panic there was shown where it happened.
            let _ = thread.join();
        }
    }
}

impl Drop for Live {
    fn drop(&mut self) {
        self.close();
    }
}

/// A window's frames wait for nothing.
fn live_params(params: EngineParams) -> EngineParams {
    EngineParams { mode: Mode::Live, sync_reads: false, ..params }
}

fn tell_usage(shared: &Shared, renderer: &Renderer) {
    shared.allocated_bytes.store(renderer.allocated_bytes(), Ordering::Relaxed);
    shared.mesh_bytes.store(renderer.mesh_bytes(), Ordering::Relaxed);
}

/// How much wider the next list must be, given how far the picture moved since the last frame.
fn pad_px(last: &View, view: &View) -> u32 {
    let turned_rad = last.forward().angle_between(view.forward());
    let height_m = view.pose.eye.height_m.abs().max(1.0);
    let moved_rad = (view.eye() - last.eye()).xyz().length() / height_m;
    let pad_px = PAD_FRAMES * (turned_rad + moved_rad) * view.focal_px();
    pad_px.min(PAD_SHARE_MAX * f64::from(view.size_px[0].max(view.size_px[1]))) as u32
}
