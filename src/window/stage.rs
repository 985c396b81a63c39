//! What lives with a window: renderer and threads, the eye, panels; and one frame of it.

use super::aim::Aim;
use super::hands::{Hands, Taken};
use super::opener::{Opened, Opener};
use super::overlays::{self, Drawn};
use super::panels::{Action, FrameTimes, MessageKind, Messages, Panels, Place, Playback, Quality, SetRow, Shown};
use super::recorder::{Recorder, Replay};
use super::saver::Saver;
use super::{WindowError, WindowOptions};
use crate::camera::{Destination, FlightPath, Held, NavInput, Navigator, Pose, Surroundings, View};
use crate::engine::{EngineError, EngineParams, FrameReport, Lack, Live, Notify, Pace, PickCache, Source};
use crate::geodesy::Geodetic;
use crate::render::{Overlay, Presented, Renderer, Skip};
use crate::store::{NamedView, World, bookmarks};
use crate::units::ByteSize;
use egui::ViewportId;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};
use winit::event::WindowEvent;
use winit::window::Window;

/// Vertical field of view of the eye.
const FOV_Y_RAD: f64 = std::f64::consts::FRAC_PI_3;
/// An eye that has been still for this long rests.
const REST_S: f64 = 0.25;
/// Of a display that does not tell its rate, and what is believed of one.
const DISPLAY_HZ: f64 = 60.0;
const DISPLAY_HZ_RANGE: [f64; 2] = [24.0, 480.0];
/// After a frame that was skipped the next one is tried this much later.
const SKIPPED_WAIT: Duration = Duration::from_millis(100);

/// A view with a name.
#[derive(Clone, Debug, PartialEq)]
pub struct Bookmark {
    pub name: String,
    pub pose: Pose,
}

impl Bookmark {
    /// What a world offers.
    pub fn of(view: &NamedView) -> Self {
        let eye = Geodetic::from_degrees(view.lat_deg, view.lon_deg, view.height_m);
        let (heading_rad, pitch_rad) = (view.heading_deg.to_radians(), view.pitch_deg.to_radians());
        Self { name: view.name.clone(), pose: Pose { eye, heading_rad, pitch_rad } }
    }
}

/// When the next frame is due.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Next {
    Now,
    /// When the display shows the next one; frames follow without a pause.
    Soon(Instant),
    At(Instant),
    /// When something happens.
    Never,
}

/// What a frame leaves behind.
pub struct Frame {
    pub report: FrameReport,
    pub shown: bool,
    pub next: Next,
    /// For the application: what the stage cannot do itself.
    pub actions: Vec<Action>,
}

/// A window with all that it needs; of it only `live` is made anew when the device is lost.
pub struct Stage {
    window: Arc<Window>,
    live: Live,
    egui: egui_winit::State,
    overlay: Overlay,
    hands: Hands,
    navigator: Navigator,
    pub panels: Panels,
    messages: Messages,
    frame_times: FrameTimes,
    picks: PickCache,
    cursor_px: Option<[f64; 2]>,
    recorder: Option<Recorder>,
    /// The last recording, or the flight that the program was started with.
    last_path: Option<FlightPath>,
    replay: Option<Replay>,
    saver: Saver,
    opener: Opener,
    /// The collections by number.
    sets: Vec<SetRow>,
    /// Names of sets that are hidden when their world is added.
    pub hidden_names: Vec<String>,
    picture_asked: bool,
    aim: Option<Aim>,
    report: FrameReport,
    bytes_read: u64,
    started: Instant,
    /// End of the last frame, where the next one followed without a pause.
    last_end: Option<Instant>,
    /// The last view, and since when it is the same.
    seen: Option<(View, f64)>,
    occluded: bool,
    /// Of the display's frames.
    period: Duration,
    names: Vec<String>,
    bookmarks: Vec<Bookmark>,
    credits: Vec<String>,
    footprint_least: ByteSize,
    /// Of a picture; a larger window stretches it.
    side_max_px: u32,
}

impl Stage {
    /// Opens the renderer and starts the threads; `pose` is the first view.
    pub fn open(
        window: Arc<Window>,
        options: &WindowOptions,
        params: EngineParams,
        panels: Panels,
        pose: Pose,
        notify: impl Fn() + Send + Clone + 'static,
    ) -> Result<Self, WindowError> {
        let size_px = size_of(&window);
        let live = start(
            &window,
            &options.source,
            params,
            View::new(pose, FOV_Y_RAD, size_px.map(|side| side.max(1))),
            Box::new(notify.clone()),
        )?;
        let context = egui::Context::default();
        let scale = window.scale_factor() as f32;
        let egui = egui_winit::State::new(context, ViewportId::ROOT, &window, Some(scale), None, None);
        let home = options.bookmarks.first().map_or(pose, |home| home.pose);
        let mut stage = Self {
            egui,
            overlay: Overlay::default(),
            hands: Hands::default(),
            navigator: Navigator::new(pose, home, FOV_Y_RAD),
            panels,
            messages: Messages::default(),
            frame_times: FrameTimes::default(),
            picks: PickCache::default(),
            cursor_px: None,
            recorder: None,
            last_path: options.replay.clone(),
            replay: None,
            saver: Saver::start(notify.clone()).map_err(WindowError::Thread)?,
            opener: Opener::start(options, notify).map_err(WindowError::Thread)?,
            sets: set_rows(&options.worlds, &options.source),
            hidden_names: Vec::new(),
            picture_asked: false,
            aim: None,
            report: FrameReport::default(),
            bytes_read: 0,
            started: Instant::now(),
            last_end: None,
            seen: None,
            occluded: false,
            period: period_of(&window),
            names: options.bookmarks.iter().map(|bookmark| bookmark.name.clone()).collect(),
            bookmarks: options.bookmarks.clone(),
            credits: options.source.manifest.credits(),
            footprint_least: Live::least_footprint(&options.source),
            side_max_px: u32::MAX,
            window,
            live,
        };
        let side_px = stage.live.renderer().max_texture_side_px();
        stage.side_max_px = side_px;
        stage.egui.set_max_texture_side(side_px as usize);
        if stage.last_path.is_some() {
            stage.do_action(Action::Replay(true));
        }
        Ok(stage)
    }

    /// A new renderer and new threads for the same window, after the device was lost. Waits for the coarsest pages.
    pub fn reopen(&mut self, notify: Notify) -> Result<(), WindowError> {
        let (params, view) = (*self.live.params(), self.view(self.now_s()));
        self.live.close();
        self.live.renderer().leave_window();
        self.live = start(&self.window, &self.live.source().clone(), params, view, notify)?;
        let fonts = Overlay::fonts_of(self.egui.egui_ctx());
        self.overlay = Overlay { textures: fonts, ..Overlay::default() };
        self.say(MessageKind::Failed, "the graphics device was lost; a new one draws on".into());
        Ok(())
    }

    pub fn window(&self) -> &Window {
        &self.window
    }

    pub fn is_lost(&self) -> bool {
        self.live.is_lost()
    }

    pub fn quality(&self) -> Quality {
        let params = self.live.params();
        Quality { tolerance_px: params.tolerance_px, footprint: params.footprint, frame_ms: params.frame_ms }
    }

    /// Size of texts and panels over what the display asks for.
    pub fn scale(&self) -> f64 {
        f64::from(self.egui.egui_ctx().zoom_factor())
    }

    pub fn set_scale(&mut self, scale: f64) {
        self.egui.egui_ctx().set_zoom_factor(scale as f32);
    }

    /// Where the eye is.
    pub fn pose(&self) -> Pose {
        self.replay.as_ref().map_or(self.navigator.pose(), |replay| replay.pose(self.now_s()))
    }

    /// Seconds since the window opened.
    fn now_s(&self) -> f64 {
        self.started.elapsed().as_secs_f64()
    }

    fn size_px(&self) -> [u32; 2] {
        size_of(&self.window).map(|side| side.clamp(1, self.side_max_px))
    }

    /// The view at a time, without moving the eye.
    fn view(&self, now_s: f64) -> View {
        match &self.replay {
            Some(replay) => View::new(replay.pose(now_s), replay.path.fovy_rad(), self.size_px()),
            None => View::new(self.navigator.pose(), FOV_Y_RAD, self.size_px()),
        }
    }

    pub fn say(&mut self, kind: MessageKind, text: String) {
        self.messages.say(kind, text, self.now_s());
    }

    /// Takes an event of the window; true when a frame should follow.
    pub fn event(&mut self, event: &WindowEvent) -> bool {
        let response = self.egui.on_window_event(&self.window, event);
        match event {
            WindowEvent::Resized(_) | WindowEvent::ScaleFactorChanged { .. } => {
                let size_px = size_of(&self.window);
                self.live.renderer().set_size(size_px);
                self.period = period_of(&self.window);
                return true;
            }
            WindowEvent::Moved(_) => self.period = period_of(&self.window),
            WindowEvent::Occluded(occluded) => {
                self.occluded = *occluded;
                return !occluded;
            }
            WindowEvent::CursorMoved { position, .. } => self.cursor_px = Some([position.x, position.y]),
            WindowEvent::CursorLeft { .. } => self.cursor_px = None,
            _ => {}
        }
        let taken = self.taken();
        let input = self.hands.translate(event, self.window.scale_factor(), taken);
        if let Some(input) = input {
            self.navigate(input);
        }
        response.repaint || input.is_some()
    }

    /// What panels take: the pointer where one lies under it now, the keyboard while a text is written.
    fn taken(&self) -> Taken {
        let context = self.egui.egui_ctx();
        let scale = f64::from(context.pixels_per_point());
        let over = self.cursor_px.is_some_and(|[x, y]| {
            let layer = context.layer_id_at(egui::pos2((x / scale) as f32, (y / scale) as f32));
            layer.is_some_and(|layer| layer.order != egui::Order::Background)
        });
        let keyboard = context.text_edit_focused() || self.panels.asks_for_place();
        Taken { pointer: over || context.egui_is_using_pointer(), keyboard }
    }

    fn navigate(&mut self, input: NavInput) {
        let now_s = self.now_s();
        let is_passive = matches!(input, NavInput::PointerMoved(_) | NavInput::PointerLeft | NavInput::Released(_))
            || matches!(input, NavInput::Hold(_, false) | NavInput::Hold(Held::Fast, _) | NavInput::Unfocused);
        if !is_passive {
            self.end_replay();
            self.aim = None;
        }
        let size_px = self.size_px();
        let (navigator, around) = (&mut self.navigator, self.live.surroundings(&self.picks));
        navigator.input(input, now_s, size_px, &around);
    }

    /// The eye goes on from where a replay is.
    fn end_replay(&mut self) {
        if let Some(replay) = self.replay.take() {
            self.navigator.place(replay.pose(self.now_s()));
        }
    }

    /// Draws a frame, unless there is nothing to draw into.
    pub fn frame(&mut self) -> Result<Option<Frame>, WindowError> {
        let size_px = self.size_px();
        if size_of(&self.window).contains(&0) || self.occluded {
            self.last_end = None;
            return Ok(None);
        }
        let (begun, now_s) = (Instant::now(), self.now_s());
        let view = self.step(now_s, size_px);
        let pace = self.pace(&view, now_s);
        self.live.set_way(self.navigator.flight().filter(|_| self.replay.is_none()).cloned());
        let mut report = self.live.frame(&view, now_s, pace)?;
        self.bytes_read += report.bytes_read;
        let (mut actions, repaint) = self.lay_out(&view, now_s);
        actions.retain(|&action| !self.do_action(action));
        self.tell_news();
        let drawn_ms = begun.elapsed().as_secs_f64() * 1000.0;
        let presented = self.live.renderer().present(&mut self.overlay)?;
        self.ask_for_picture()?;
        self.time(&mut report, pace, begun, drawn_ms);
        self.report = report.clone();
        let next = self.next(presented, repaint, begun);
        self.last_end = matches!(next, Next::Now | Next::Soon(_)).then(Instant::now);
        Ok(Some(Frame { report, shown: presented == Presented::Shown, next, actions }))
    }

    /// Whether the view has been the same for a while.
    fn pace(&mut self, view: &View, now_s: f64) -> Pace {
        if self.seen.is_none_or(|(seen, _)| seen != *view) {
            self.seen = Some((*view, now_s));
        }
        let rested_s = self.seen.map_or(0.0, |(_, since_s)| now_s - since_s);
        if rested_s >= REST_S { Pace::Resting } else { Pace::Moving }
    }

    /// Moves the eye, or the replay, and records it.
    fn step(&mut self, now_s: f64, size_px: [u32; 2]) -> View {
        if self.replay.as_ref().is_some_and(|replay| replay.is_over(now_s)) {
            self.end_replay();
        }
        let view = match &self.replay {
            Some(_) => self.view(now_s),
            None => {
                self.keep_aim();
                let (navigator, around) = (&mut self.navigator, self.live.surroundings(&self.picks));
                navigator.step(now_s, size_px, &around)
            }
        };
        if let Some(recorder) = &mut self.recorder {
            recorder.push(now_s, view.pose);
            if recorder.is_full() {
                self.do_action(Action::Record(false));
            }
        }
        view
    }

    /// Panels and overlays; gives what was asked for and when they change by themselves.
    fn lay_out(&mut self, view: &View, now_s: f64) -> (Vec<Action>, Duration) {
        let input = self.egui.take_egui_input(&self.window);
        let gpu_ms = self.live.gpu_ms();
        let context = self.egui.egui_ctx().clone();
        let around = self.live.surroundings(&self.picks);
        let place = |at_px: [f64; 2]| around.pick(view, at_px).map(Geodetic::from_ecef);
        let wants_places = self.panels.open.status || self.panels.asks_for_place();
        let middle_px = view.size_px.map(|side| f64::from(side) / 2.0);
        let eye = view.pose.eye;
        let list = self.live.list();
        let cursor = self.cursor_px.filter(|_| wants_places).and_then(place);
        let shown = Shown {
            now_s,
            view: *view,
            cursor,
            cursor_error_m: cursor.and_then(|cursor| around.ground_error_m(cursor.lat_rad, cursor.lon_rad)),
            middle: place(middle_px),
            above_ground_m: around.ground_m(eye.lat_rad, eye.lon_rad).map(|ground_m| eye.height_m - ground_m),
            frame_times: &self.frame_times,
            report: &self.report,
            gpu_ms,
            asked: self.quality(),
            footprint_least: self.footprint_least,
            pages: list.pages,
            awaited_s: list.awaited_s(),
            bytes_read: self.bytes_read,
            world: &self.live.source().manifest.name,
            credits: &self.credits,
            bookmarks: &self.names,
            sets: &self.sets,
            hidden: self.live.params().hidden,
            is_opening: self.opener.is_busy(),
            messages: &self.messages,
            playback: self.playback(now_s),
        };
        let mut actions = Vec::new();
        let panels = &mut self.panels;
        let output = context.run_ui(input, |ui| {
            actions.extend(panels.show(ui.ctx(), &shown));
            let drawn = Drawn { view, pieces: &list.selection.pieces, lacking: &list.lacking };
            overlays::show(ui.ctx(), panels.overlays, &drawn);
        });
        self.egui.handle_platform_output(&self.window, output.platform_output);
        let pixels_per_point = output.pixels_per_point;
        let primitives = context.tessellate(output.shapes, pixels_per_point);
        self.overlay.replace(Overlay { textures: output.textures_delta, primitives, pixels_per_point });
        let repaint = output.viewport_output.get(&ViewportId::ROOT).map_or(Duration::MAX, |root| root.repaint_delay);
        (actions, repaint)
    }

    fn playback(&self, now_s: f64) -> Playback {
        match (&self.recorder, &self.replay) {
            (Some(recorder), _) => Playback::Recording { at_s: recorder.at_s(now_s) },
            (None, Some(replay)) => Playback::Replaying { at_s: replay.at_s(now_s), of_s: replay.path.duration_s() },
            (None, None) => Playback::Off,
        }
    }

    /// What happened beside the frames.
    fn tell_news(&mut self) {
        if let Some(folder) = self.panels.take_world_asked() {
            self.open_world(folder.into());
        }
        while let Some(opened) = self.opener.poll() {
            match opened {
                Ok(opened) => self.add_world(&opened),
                Err(text) => self.say(MessageKind::Failed, text),
            }
        }
        for message in self.live.take_messages() {
            self.say(MessageKind::Failed, message);
        }
        let said: Vec<_> = self.saver.said().collect();
        for saved in said {
            match saved {
                Ok(text) => self.say(MessageKind::Done, text),
                Err(text) => self.say(MessageKind::Failed, text),
            }
        }
        let failed = match self.live.renderer().poll_picture() {
            None => None,
            Some(Ok((size_px, rgba))) => {
                let saved = self.saver.save(size_px, rgba);
                (!saved).then(|| "too many screenshots at once: this one was not saved".to_owned())
            }
            Some(Err(error)) => Some(format!("no screenshot: {error}")),
        };
        if let Some(text) = failed {
            self.say(MessageKind::Failed, text);
        }
    }

    fn ask_for_picture(&mut self) -> Result<(), WindowError> {
        if std::mem::take(&mut self.picture_asked) {
            self.live.renderer().request_picture().map_err(EngineError::from)?;
        }
        Ok(())
    }

    /// Writes the frame's times down: its own, or from the end of the one before where they follow without a pause.
    fn time(&mut self, report: &mut FrameReport, pace: Pace, begun: Instant, drawn_ms: f64) {
        report.timings.frame_ms = self.last_end.unwrap_or(begun).elapsed().as_secs_f64() * 1000.0;
        self.frame_times.push(report.timings.frame_ms);
        let gpu_ms = self.live.gpu_ms();
        // The GPU's time is of a frame or two before: only where frames follow one another is it of one like this.
        if self.last_end.is_some() && pace == Pace::Moving {
            // A frame waits for the one before where that is not done: what the GPU takes shows in one of the two.
            let busy_ms = begun.elapsed().as_secs_f64() * 1000.0;
            self.live.learn(busy_ms.max(drawn_ms + gpu_ms.unwrap_or(0.0)));
        }
    }

    fn next(&mut self, presented: Presented, repaint: Duration, begun: Instant) -> Next {
        let now_s = self.now_s();
        match presented {
            Presented::Skipped(Skip::Minimized | Skip::Occluded) => return Next::Never,
            Presented::Skipped(_) => return Next::At(Instant::now() + SKIPPED_WAIT),
            Presented::Shown => {}
        }
        let moves =
            self.replay.is_some() || self.navigator.is_moving() || self.live.has_uploads() || self.live.is_fading();
        if moves || self.picture_asked || self.live.renderer().has_picture_pending() || repaint.is_zero() {
            // Frames that the display cannot show would only take time from the other threads.
            let due = begun + self.period;
            return if due <= Instant::now() { Next::Now } else { Next::Soon(due) };
        }
        let fades = self.messages.changes_in_s(now_s).map_or(Duration::MAX, Duration::from_secs_f64);
        // While pages are awaited the time shown with them runs on.
        let waits = self.live.list().awaited_s().map_or(Duration::MAX, |_| SKIPPED_WAIT);
        // A picture that was held back for time comes once the eye has rested.
        let rests = if self.report.lack == Lack::Time { Duration::from_secs_f64(REST_S) } else { Duration::MAX };
        let wait = repaint.min(fades).min(waits).min(rests);
        Instant::now().checked_add(wait).filter(|_| wait < Duration::MAX).map_or(Next::Never, Next::At)
    }

    /// Does what panels and keys ask for; false for what only the application can do.
    pub fn do_action(&mut self, action: Action) -> bool {
        let params = *self.live.params();
        match action {
            Action::Tolerance(tolerance_px) => self.set_params(EngineParams { tolerance_px, ..params }),
            Action::Footprint(footprint) => self.set_params(EngineParams { footprint, ..params }),
            Action::FrameMs(frame_ms) => self.set_params(EngineParams { frame_ms, ..params }),
            Action::FlyTo(place) => self.fly_to_place(place),
            Action::Bookmark(which) => {
                if let Some(pose) = self.bookmarks.get(which).map(|bookmark| bookmark.pose) {
                    self.navigate(NavInput::FlyTo(Destination { pose }));
                }
            }
            Action::NorthUp => self.navigate(NavInput::NorthUp),
            Action::Reset => self.navigate(NavInput::Reset),
            Action::Stop => self.navigate(NavInput::Stop),
            Action::Screenshot => self.picture_asked = true,
            Action::Record(true) => {
                let now_s = self.now_s();
                self.recorder = Some(Recorder::start(now_s, self.view(now_s).fov_y_rad));
            }
            Action::Record(false) => self.end_recording(),
            Action::Replay(_) if self.replay.is_some() => self.end_replay(),
            Action::Replay(true) => match self.last_path.clone() {
                Some(path) => self.replay = Some(Replay::start(path, self.now_s())),
                None => self.say(MessageKind::Failed, "there is no recording yet: Shift-P starts one".into()),
            },
            Action::Replay(false) => self.end_replay(),
            Action::ShowSet(number, is_shown) => {
                let hidden = params.hidden;
                let hidden = if is_shown { hidden.without(number) } else { hidden.with(number) };
                self.set_params(EngineParams { hidden, ..params });
            }
            Action::FullScreen | Action::Quit => return false,
        }
        true
    }

    fn set_params(&mut self, params: EngineParams) {
        if let Err(error) = self.live.set_params(params) {
            self.say(MessageKind::Failed, error.to_string());
        }
    }

    fn fly_to_place(&mut self, place: Place) {
        let aim = Aim { place, ground_m: self.ground_m(place) };
        let heading_rad = self.pose().heading_rad;
        self.navigate(NavInput::FlyTo(aim.destination(heading_rad)));
        self.aim = Some(aim);
    }

    fn ground_m(&self, place: Place) -> f64 {
        self.live.surroundings(&self.picks).ground_m(place.lat_rad, place.lon_rad).unwrap_or(0.0)
    }

    /// From afar only coarse ground is known of a place: once there, the height over the ground is put right.
    fn keep_aim(&mut self) {
        let Some(aim) = self.aim.filter(|_| self.navigator.flight().is_none()) else { return };
        let ground_m = self.ground_m(aim.place);
        let settled = self.live.list().selection.stats.pages_missing == 0;
        if aim.is_off(ground_m) {
            let aim = Aim { ground_m, ..aim };
            let heading_rad = self.pose().heading_rad;
            self.navigate(NavInput::FlyTo(aim.destination(heading_rad)));
            self.aim = Some(aim);
        } else if settled {
            self.aim = None;
        }
    }

    /// Adds the world of a folder, once it is open.
    pub fn open_world(&mut self, folder: PathBuf) {
        let said = format!("opening {}", folder.display());
        match self.opener.open(folder) {
            true => self.say(MessageKind::Done, said),
            false => self.say(MessageKind::Failed, "too many worlds at once: this one was not opened".into()),
        }
    }

    /// A world more to fly over. What was hidden stays so: numbers do not change.
    fn add_world(&mut self, opened: &Opened) {
        let source = Source::shared(&opened.whole);
        let (sets, credits) = (set_rows(&opened.worlds, &source), source.manifest.credits());
        let views = bookmarks(&source.manifest, &source.index);
        let least = Live::least_footprint(&source);
        if let Err(error) = self.live.set_source(source) {
            return self.say(MessageKind::Failed, error.to_string());
        }
        let known = self.sets.len();
        let added = (0..=u8::MAX).zip(&sets).skip(known).filter(|(_, set)| self.hidden_names.contains(&set.name));
        let params = *self.live.params();
        let hidden = added.fold(params.hidden, |hidden, (number, _)| hidden.with(number));
        self.set_params(EngineParams { hidden, ..params });
        (self.sets, self.credits, self.footprint_least) = (sets, credits, least);
        self.bookmarks = views.iter().map(Bookmark::of).collect();
        self.names = self.bookmarks.iter().map(|bookmark| bookmark.name.clone()).collect();
        let name = opened.worlds.last().map_or("", |world| world.manifest().name.as_str());
        self.say(MessageKind::Done, format!("added {name}"));
    }

    /// Names of all collections, with those that are hidden.
    pub fn sets(&self) -> impl Iterator<Item = (&str, bool)> {
        let hidden = self.live.params().hidden;
        (0..=u8::MAX).zip(&self.sets).map(move |(number, set)| (&*set.name, hidden.contains(number)))
    }

    /// Shows a flight from a file.
    pub fn replay_file(&mut self, file: &std::path::Path) {
        match FlightPath::load(file) {
            Ok(path) => {
                self.last_path = Some(path);
                self.do_action(Action::Replay(true));
            }
            Err(error) => self.say(MessageKind::Failed, error.to_string()),
        }
    }

    fn end_recording(&mut self) {
        match self.save_recording() {
            None => {}
            Some(Ok(said)) => self.say(MessageKind::Done, said),
            Some(Err(said)) => self.say(MessageKind::Failed, said),
        }
    }

    /// Saves a recording that is under way; tells where it lies or why it does not.
    fn save_recording(&mut self) -> Option<Result<String, String>> {
        let path = self.recorder.take().and_then(Recorder::finish)?;
        let saved = super::files::save_recording(&path);
        self.last_path = Some(path);
        Some(saved.map(|file| format!("saved {}", file.display())).map_err(|error| error.to_string()))
    }

    /// Ends what is under way before the window closes: a recording, a picture on its way. Tells what became of it.
    pub fn finish(&mut self) -> Vec<String> {
        let recorded = self.save_recording().map(|saved| saved.unwrap_or_else(|said| said));
        if self.live.renderer().has_picture_pending() && self.live.renderer().finish().is_ok() {
            self.tell_news();
        }
        recorded.into_iter().collect()
    }
}

/// Physical pixels; 0 while minimized.
fn size_of(window: &Window) -> [u32; 2] {
    window.inner_size().into()
}

/// Time between two frames of the display that the window is on.
fn period_of(window: &Window) -> Duration {
    let millihertz = window.current_monitor().and_then(|monitor| monitor.refresh_rate_millihertz());
    let hz = millihertz.map_or(DISPLAY_HZ, |millihertz| f64::from(millihertz) / 1000.0);
    Duration::from_secs_f64(1.0 / hz.clamp(DISPLAY_HZ_RANGE[0], DISPLAY_HZ_RANGE[1]))
}

/// The collections of worlds over one another.
fn set_rows(worlds: &[Arc<World>], source: &Source) -> Vec<SetRow> {
    let worlds = worlds.iter().map(|world| world.manifest());
    let of_world = worlds.flat_map(|manifest| std::iter::repeat_n(&manifest.name, manifest.collections.len()));
    let sets = source.manifest.collections.iter().zip(of_world);
    sets.map(|(info, world)| SetRow { name: info.name.clone(), world: world.clone(), objects: info.objects }).collect()
}

fn start(
    window: &Arc<Window>,
    source: &Source,
    params: EngineParams,
    view: View,
    notify: Notify,
) -> Result<Live, WindowError> {
    let limits = Live::gpu_limits(source, &params)?;
    let renderer = Renderer::for_window(window.clone(), size_of(window), limits).map_err(EngineError::from)?;
    Ok(Live::start(source.clone(), params, renderer, view, notify)?)
}
