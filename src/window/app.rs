//! The application: from the events of the system to frames, and from the first frame to a clean end.

use super::WindowOptions;
use super::panels::{Action, MessageKind, Panels, Quality};
use super::settings::{Settings, SettingsFile, WindowSettings};
use super::stage::{Frame, Next, Stage};
use crate::camera::{Pose, WHOLE_EARTH};
use crate::engine::{EngineError, EngineParams, FrameReport, Live};
use crate::record::{FlightHeader, FlightLog, RecordError};
use crate::store::MANIFEST_FILE;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use winit::application::ApplicationHandler;
use winit::dpi::LogicalSize;
use winit::error::{EventLoopError, OsError};
use winit::event::{StartCause, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoop, EventLoopProxy};
use winit::window::{Fullscreen, Window, WindowId};

/// Frames that a report of a session holds: an hour at 60 frames a second; later ones are left out.
const REPORT_FRAMES_MAX: usize = 60 * 60 * 60;
/// A device that is lost again within this time will not come back.
const LOST_AGAIN: Duration = Duration::from_secs(5);
/// The smallest window, logical pixels.
const LEAST_SIZE: LogicalSize<f64> = LogicalSize { width: 160.0, height: 120.0 };

#[derive(Debug, thiserror::Error)]
pub enum WindowError {
    #[error(
        "no window can be opened here: {0}; on a machine without a display fly headless: `stoop fly WORLD --path FILE \
         --frames DIR`, or `stoop shot WORLD …` for one picture"
    )]
    NoDisplay(EventLoopError),
    #[error("the system gives no window: {0}; without one, fly headless: `stoop fly WORLD --path FILE --frames DIR`")]
    NoWindow(OsError),
    #[error("cannot start a thread: {0}; close other programs")]
    Thread(std::io::Error),
    #[error("the window's events ended: {0}; start again")]
    Events(EventLoopError),
    #[error(transparent)]
    Engine(#[from] EngineError),
    #[error(transparent)]
    Render(#[from] crate::render::RenderError),
    #[error(transparent)]
    Report(#[from] RecordError),
}

/// What other threads tell.
#[derive(Clone, Copy, Debug)]
enum News {
    /// Something to look at: a new list, a saved picture.
    Look,
    /// Ctrl-C in the terminal, or the system wants the program to end.
    Quit,
}

/// Wakes the event loop; once until it is seen.
#[derive(Clone)]
struct Bell {
    proxy: EventLoopProxy<News>,
    rung: Arc<AtomicBool>,
}

impl Bell {
    fn ring(&self) {
        if !self.rung.swap(true, Ordering::AcqRel) {
            // An event loop that ended needs no news.
            let _ = self.proxy.send_event(News::Look);
        }
    }
}

/// Opens a window and flies until it is closed.
pub fn run(options: WindowOptions) -> Result<(), WindowError> {
    let events = EventLoop::<News>::with_user_event().build().map_err(WindowError::NoDisplay)?;
    let bell = Bell { proxy: events.create_proxy(), rung: Arc::default() };
    let quit = events.create_proxy();
    // Where no handler can be set, the signal ends the program as it does others.
    let _ = ctrlc::set_handler(move || {
        let _ = quit.send_event(News::Quit);
    });
    let mut file = SettingsFile::of_user();
    let (settings, said) = file.as_mut().map(SettingsFile::load).unwrap_or_default();
    let mut app = App {
        log: options.report.is_some().then(FlightLog::default),
        options,
        bell,
        file,
        settings,
        said,
        stage: None,
        lost: None,
        failed: None,
        due: None,
        saved: false,
    };
    let ended = events.run_app(&mut app).map_err(WindowError::Events);
    app.close();
    let ended = app.failed.take().map_or(ended, Err);
    // What was made is kept however it ended.
    let reported = app.write_report();
    ended.and(reported)
}

struct App {
    options: WindowOptions,
    bell: Bell,
    file: Option<SettingsFile>,
    settings: Settings,
    /// What loading the settings had to say.
    said: Option<String>,
    stage: Option<Stage>,
    log: Option<FlightLog>,
    /// When the device was last lost.
    lost: Option<Instant>,
    failed: Option<WindowError>,
    /// When the next frame follows the last one.
    due: Option<Instant>,
    saved: bool,
}

impl App {
    fn open(&mut self, system: &ActiveEventLoop) -> Result<(), WindowError> {
        let manifest = &self.options.source.manifest;
        let window = &self.settings.window;
        let size = self.options.size_px.map_or([window.width_px, window.height_px], |size| size.map(f64::from));
        let attributes = Window::default_attributes()
            .with_title(format!("{} — Stoop", manifest.name))
            .with_inner_size(LogicalSize::new(size[0], size[1]))
            .with_min_inner_size(LEAST_SIZE)
            .with_maximized(window.maximized && self.options.size_px.is_none());
        let window = Arc::new(system.create_window(attributes).map_err(WindowError::NoWindow)?);
        let panels = Panels::new(self.settings.panels, self.settings.overlays);
        let bell = self.bell.clone();
        let mut stage =
            Stage::open(window, &self.options, self.params(), panels, self.first_pose(), move || bell.ring())?;
        stage.set_scale(self.settings.window.scale);
        stage.hidden_names = self.settings.sets.hidden.clone();
        if let Some(said) = self.said.take() {
            stage.say(MessageKind::Failed, said);
        }
        self.stage = Some(stage);
        Ok(())
    }

    /// Settings, with what the command line says in their place.
    fn params(&self) -> EngineParams {
        let settings = self.settings.quality.quality().sane();
        let asked = Quality {
            tolerance_px: self.options.tolerance_px.unwrap_or(settings.tolerance_px),
            // What was set for a smaller world may be too little for this one.
            footprint: self
                .options
                .footprint
                .unwrap_or_else(|| settings.footprint.max(Live::least_footprint(&self.options.source))),
            frame_ms: self.options.frame_ms.unwrap_or(settings.frame_ms),
        };
        EngineParams {
            tolerance_px: asked.tolerance_px,
            footprint: asked.footprint,
            frame_ms: asked.frame_ms,
            hidden: self.settings.sets.hidden(&self.options.source.manifest.collections),
            ..self.options.params
        }
    }

    /// Where the world was left, else the first bookmark.
    fn first_pose(&self) -> Pose {
        let manifest = &self.options.source.manifest;
        let home = self.options.bookmarks.first().map(|bookmark| bookmark.pose);
        let last = self.settings.last_view(&manifest.name, &manifest.recipe_hash);
        last.or(home).unwrap_or(WHOLE_EARTH)
    }

    fn frame(&mut self, system: &ActiveEventLoop) {
        let Some(stage) = &mut self.stage else { return };
        match stage.frame() {
            Ok(Some(frame)) => self.after(frame, system),
            Ok(None) => system.set_control_flow(ControlFlow::Wait),
            Err(error) => self.mend(error, system),
        }
    }

    fn after(&mut self, frame: Frame, system: &ActiveEventLoop) {
        let Some(stage) = &mut self.stage else { return };
        self.due = if let Next::Soon(due) = frame.next { Some(due) } else { None };
        match frame.next {
            Next::Now => {
                stage.window().request_redraw();
                system.set_control_flow(ControlFlow::Wait);
            }
            Next::Soon(when) | Next::At(when) => system.set_control_flow(ControlFlow::WaitUntil(when)),
            Next::Never => system.set_control_flow(ControlFlow::Wait),
        }
        if frame.shown {
            Self::log(&mut self.log, frame.report, self.options.started);
        }
        for action in frame.actions {
            match action {
                Action::Quit => system.exit(),
                Action::FullScreen => {
                    let window = stage.window();
                    let full = window.fullscreen().is_none().then_some(Fullscreen::Borderless(None));
                    window.set_fullscreen(full);
                }
                _ => {}
            }
        }
    }

    fn log(log: &mut Option<FlightLog>, report: FrameReport, started: Instant) {
        if let Some(log) = log
            && log.frames.len() < REPORT_FRAMES_MAX
        {
            log.first_frame_ms.get_or_insert_with(|| started.elapsed().as_secs_f64() * 1000.0);
            log.frames.push(report);
        }
    }

    /// A lost device is replaced; anything else, or one that is lost again at once, ends the program.
    fn mend(&mut self, error: WindowError, system: &ActiveEventLoop) {
        let again = self.lost.replace(Instant::now()).is_some_and(|lost| lost.elapsed() < LOST_AGAIN);
        let bell = self.bell.clone();
        let lost = self.stage.as_mut().filter(|stage| stage.is_lost() && !again);
        let mended = lost.map_or(Err(error), |stage| stage.reopen(Box::new(move || bell.ring())));
        match mended {
            Ok(()) => self.redraw(),
            Err(error) => self.fail(error, system),
        }
    }

    fn fail(&mut self, error: WindowError, system: &ActiveEventLoop) {
        self.failed.get_or_insert(error);
        system.exit();
    }

    /// Asks for a frame, unless one is due soon that the display would not show earlier.
    fn redraw(&self) {
        let is_due = self.due.is_none_or(|due| due <= Instant::now());
        if let Some(stage) = self.stage.as_ref().filter(|_| is_due) {
            stage.window().request_redraw();
        }
    }

    /// Saves what a user would miss: a recording under way, the settings, the last view. Once.
    fn close(&mut self) {
        if std::mem::replace(&mut self.saved, true) {
            return;
        }
        let Some(stage) = &mut self.stage else { return };
        for said in stage.finish() {
            eprintln!("stoop: {said}");
        }
        let manifest = &self.options.source.manifest;
        self.settings.remember_view(&manifest.name, &manifest.recipe_hash, stage.pose());
        self.settings.sets.keep(stage.sets());
        self.settings.panels = stage.panels.open;
        self.settings.overlays = stage.panels.overlays;
        if self.options.size_px.is_none() && stage.window().fullscreen().is_none() {
            keep_size(&mut self.settings.window, stage.window());
        }
        self.settings.window.scale = stage.scale();
        self.keep_quality();
        if let Some(Err(error)) = self.file.as_ref().map(|file| file.save(&self.settings)) {
            eprintln!("stoop: {error}");
        }
        if let Some(log) = &mut self.log {
            log.header = self.stage.as_mut().map(|stage| header(stage, &self.options)).unwrap_or_default();
        }
    }

    /// What the command line asked for is not kept, unless it was changed since.
    fn keep_quality(&mut self) {
        let Some(stage) = &self.stage else { return };
        let (now, begun) = (stage.quality(), self.params());
        let mut kept = self.settings.quality.quality();
        if now.tolerance_px != begun.tolerance_px || self.options.tolerance_px.is_none() {
            kept.tolerance_px = now.tolerance_px;
        }
        if now.footprint != begun.footprint || self.options.footprint.is_none() {
            kept.footprint = now.footprint;
        }
        if now.frame_ms != begun.frame_ms || self.options.frame_ms.is_none() {
            kept.frame_ms = now.frame_ms;
        }
        self.settings.quality.set(kept);
    }

    fn write_report(mut self) -> Result<(), WindowError> {
        // The threads end first: their memory is none of the report's.
        self.stage = None;
        match (&self.log, &self.options.report) {
            (Some(log), Some(file)) => Ok(log.write(file)?),
            _ => Ok(()),
        }
    }
}

fn keep_size(kept: &mut WindowSettings, window: &Window) {
    kept.maximized = window.is_maximized();
    let size: LogicalSize<f64> = window.inner_size().to_logical(window.scale_factor());
    if !kept.maximized && size.width >= 1.0 && size.height >= 1.0 {
        (kept.width_px, kept.height_px) = (size.width, size.height);
    }
}

fn header(stage: &mut Stage, options: &WindowOptions) -> FlightHeader {
    let quality = stage.quality();
    FlightHeader {
        world: options.source.manifest.name.clone(),
        mode: "window".into(),
        policy: "demand".into(),
        size_px: stage.window().inner_size().into(),
        tolerance_px: quality.tolerance_px,
        footprint_limit_bytes: quality.footprint.0,
        arrivals_s: Vec::new(),
    }
}

impl ApplicationHandler<News> for App {
    fn new_events(&mut self, system: &ActiveEventLoop, cause: StartCause) {
        if let StartCause::ResumeTimeReached { .. } = cause {
            system.set_control_flow(ControlFlow::Wait);
            self.due = None;
            self.redraw();
        }
    }

    fn resumed(&mut self, system: &ActiveEventLoop) {
        if self.stage.is_none()
            && let Err(error) = self.open(system)
        {
            self.fail(error, system);
        }
        self.redraw();
    }

    fn user_event(&mut self, system: &ActiveEventLoop, news: News) {
        if let News::Quit = news {
            return system.exit();
        }
        self.bell.rung.store(false, Ordering::Release);
        self.redraw();
    }

    fn window_event(&mut self, system: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        match event {
            WindowEvent::CloseRequested => system.exit(),
            WindowEvent::RedrawRequested => self.frame(system),
            event => {
                if let (WindowEvent::DroppedFile(file), Some(stage)) = (&event, &mut self.stage) {
                    // A world is a folder; its manifest stands for it.
                    let is_world = file.is_dir() || file.file_name().is_some_and(|name| name == MANIFEST_FILE);
                    if is_world { stage.open_world(file.clone()) } else { stage.replay_file(file) }
                }
                if self.stage.as_mut().is_some_and(|stage| stage.event(&event)) {
                    self.redraw();
                }
            }
        }
    }

    fn exiting(&mut self, _: &ActiveEventLoop) {
        self.close();
    }
}
