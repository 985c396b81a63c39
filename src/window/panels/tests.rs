use super::shown::FOOTPRINT_MAX;
use super::*;
use crate::camera::{Pose, View};
use crate::engine::{FrameReport, Lack};
use crate::geodesy::Geodetic;
use crate::paging::{LayerCounts, PageCounts};
use crate::select::CollectionSet;
use crate::units::ByteSize;
use egui::{Event, Key, Modifiers, PointerButton, Pos2, RawInput, Rect, pos2, vec2};

/// What a `Shown` borrows.
struct World {
    times: FrameTimes,
    report: FrameReport,
    messages: Messages,
    credits: Vec<String>,
    bookmarks: Vec<String>,
    sets: Vec<SetRow>,
}

impl World {
    fn new() -> Self {
        let mut times = FrameTimes::default();
        (0..400).for_each(|at| times.push(15.0 + f64::from(at % 7) * 4.0));
        let mut messages = Messages::default();
        messages.say(
            MessageKind::Done,
            "saved the screenshot to /home/user/Pictures/stoop-2026-01-31T12-34-56Z.png",
            0.0,
        );
        messages.say(MessageKind::Failed, "cannot read packs/12.pack: it ends early; prepare the world again", 0.0);
        Self {
            times,
            report: FrameReport {
                triangles: 123_456,
                draw_calls: 210,
                debt_px: 0.12,
                tolerance_drawn_px: 1.84,
                lack: Lack::Time,
                footprint_bytes: 212 << 20,
                ..FrameReport::default()
            },
            messages,
            credits: ["Natural Earth II", "GEBCO 2024", "", "GEBCO 2024", "City of Helsinki, CC BY 4.0"]
                .map(str::to_owned)
                .into(),
            bookmarks: ["Globe", "Helsinki", "Golden Gate"].map(str::to_owned).into(),
            sets: [("helsinki", "default", 84_123), ("boston", "east coast", 22_099)]
                .map(|(name, world, objects)| SetRow { name: name.into(), world: world.into(), objects })
                .into(),
        }
    }

    fn shown(&self, size_px: [u32; 2]) -> Shown<'_> {
        let place = Geodetic::from_degrees(60.1699, 24.9384, 12.0);
        let pose = Pose { eye: place.at_height(1200.0), heading_rad: 0.6, pitch_rad: -1.2 };
        let pages = |resident, missing| PageCounts { resident, requested: missing, failed: 1, missing };
        Shown {
            now_s: 1.0,
            view: View::new(pose, 1.0, size_px),
            cursor: Some(place),
            cursor_error_m: Some(0.5),
            middle: Some(place),
            above_ground_m: Some(1188.0),
            frame_times: &self.times,
            report: &self.report,
            gpu_ms: Some(3.1),
            asked: Quality::default(),
            footprint_least: ByteSize(48 << 20),
            pages: LayerCounts {
                terrain: pages(120, 4),
                imagery: pages(131, 8),
                objects: pages(8, 0),
                index: pages(0, 0),
            },
            awaited_s: Some(1.84),
            bytes_read: 124 << 20,
            world: "default",
            credits: &self.credits,
            bookmarks: &self.bookmarks,
            sets: &self.sets,
            hidden: CollectionSet::NONE.with(1),
            is_opening: false,
            messages: &self.messages,
            playback: Playback::Recording { at_s: 12.0 },
        }
    }
}

/// A window without a display.
struct Window {
    ctx: Context,
    size: egui::Vec2,
    pixels_per_point: f32,
    panels: Panels,
}

/// What a frame gave.
struct Frame {
    actions: Vec<Action>,
    meshes: Vec<egui::ClippedPrimitive>,
    texts: Vec<(String, Rect)>,
    areas: Vec<Rect>,
}

impl Window {
    fn new(size_px: [u32; 2], pixels_per_point: f32, panels: Panels) -> Self {
        let size = vec2(size_px[0] as f32, size_px[1] as f32) / pixels_per_point;
        Self { ctx: Context::default(), size, pixels_per_point, panels }
    }

    fn frame(&mut self, shown: &Shown<'_>, events: Vec<Event>) -> Frame {
        let mut input = RawInput {
            screen_rect: Some(Rect::from_min_size(Pos2::ZERO, self.size)),
            events,
            time: Some(shown.now_s),
            ..RawInput::default()
        };
        input.viewports.entry(input.viewport_id).or_default().native_pixels_per_point = Some(self.pixels_per_point);
        let mut actions = Vec::new();
        let output = self.ctx.run_pass(input, |ctx| actions.extend(self.panels.show(ctx, shown)));
        let texts = output.shapes.iter().flat_map(|clipped| texts_of(&clipped.shape)).collect();
        let areas = self.ctx.memory(|memory| memory.areas().visible_layer_ids().into_iter().collect::<Vec<_>>());
        let areas = areas
            .into_iter()
            .filter(|layer| layer.order != egui::Order::Background)
            .filter_map(|layer| self.ctx.memory(|memory| memory.area_rect(layer.id)))
            .collect();
        let meshes = self.ctx.tessellate(output.shapes.clone(), self.pixels_per_point);
        output.drop_without_applying_deltas();
        Frame { actions, meshes, texts, areas }
    }

    /// Frames until all is laid out.
    fn settle(&mut self, shown: &Shown<'_>) -> Frame {
        for _ in 0..4 {
            self.frame(shown, vec![]);
        }
        self.frame(shown, vec![])
    }

    fn key(&mut self, shown: &Shown<'_>, key: Key, modifiers: Modifiers) -> Vec<Action> {
        let event = |pressed| Event::Key { key, physical_key: None, pressed, repeat: false, modifiers };
        let mut actions = self.frame(shown, vec![event(true)]).actions;
        actions.extend(self.frame(shown, vec![event(false)]).actions);
        actions
    }

    fn click(&mut self, shown: &Shown<'_>, at: Pos2) -> Vec<Action> {
        let press = |pressed| Event::PointerButton {
            pos: at,
            button: PointerButton::Primary,
            pressed,
            modifiers: Modifiers::NONE,
        };
        let mut actions = self.frame(shown, vec![Event::PointerMoved(at)]).actions;
        actions.extend(self.frame(shown, vec![press(true)]).actions);
        actions.extend(self.frame(shown, vec![press(false)]).actions);
        actions
    }

    fn click_text(&mut self, shown: &Shown<'_>, text: &str) -> Vec<Action> {
        let frame = self.settle(shown);
        let at = frame.rect_of(text).unwrap_or_else(|| panic!("no {text:?} in {:?}", frame.all_text()));
        self.click(shown, at.center())
    }
}

impl Frame {
    fn all_text(&self) -> String {
        self.texts.iter().map(|(text, _)| text.as_str()).collect::<Vec<_>>().join("\n")
    }

    fn rect_of(&self, text: &str) -> Option<Rect> {
        self.texts.iter().find(|(found, _)| found.contains(text)).map(|(_, rect)| *rect)
    }

    fn vertices(&self) -> usize {
        let count = |mesh: &egui::ClippedPrimitive| match &mesh.primitive {
            egui::epaint::Primitive::Mesh(mesh) => mesh.vertices.len(),
            egui::epaint::Primitive::Callback(_) => 0,
        };
        self.meshes.iter().map(count).sum()
    }
}

fn texts_of(shape: &egui::Shape) -> Vec<(String, Rect)> {
    match shape {
        egui::Shape::Text(text) => vec![(text.galley.text().to_owned(), text.visual_bounding_rect())],
        egui::Shape::Vec(shapes) => shapes.iter().flat_map(texts_of).collect(),
        _ => vec![],
    }
}

fn all_open(side: Side) -> Panels {
    Panels::new(Open { status: true, hud: true, hud_brief: false, side: Some(side) }, Overlays::default())
}

const SIZES: [([u32; 2], f32); 5] =
    [([640, 360], 1.0), ([1280, 720], 1.0), ([3840, 2160], 1.0), ([3840, 2160], 2.0), ([3840, 2160], 3.0)];

#[test]
fn all_panels_lie_inside_the_picture_and_leave_its_middle() {
    let world = World::new();
    for (size_px, scale) in SIZES {
        for side in [Side::Settings, Side::Help, Side::Sets] {
            let shown = world.shown(size_px);
            let mut window = Window::new(size_px, scale, all_open(side));
            window.panels.open_fly_to(&shown);
            let frame = window.settle(&shown);
            let screen = Rect::from_min_size(Pos2::ZERO, window.size);
            assert!(frame.areas.len() >= 4, "{:?}", frame.areas);
            for area in &frame.areas {
                assert!(screen.expand(0.6).contains_rect(*area), "{size_px:?} {side:?}: {area:?}");
                assert!(!area.contains(screen.center()), "{size_px:?} {side:?}: {area:?}");
            }
            let mut drawn = 0;
            for clipped in &frame.meshes {
                let egui::epaint::Primitive::Mesh(mesh) = &clipped.primitive else { continue };
                drawn += mesh.vertices.len();
                assert!(screen.expand(1.0).contains_rect(clipped.clip_rect.intersect(mesh.calc_bounds())));
            }
            assert!(drawn > 1000, "{drawn}");
        }
    }
}

#[test]
fn panels_say_what_they_were_given() {
    let world = World::new();
    let shown = world.shown([1280, 720]);
    let mut window = Window::new([1280, 720], 1.0, all_open(Side::Settings));
    let text = window.settle(&shown).all_text();
    for part in [
        "60.16990° N  24.93840° E",
        "1188 m above ground",
        "100 m",
        "123 k in 210 calls",
        "1.00 px, drawn 1.84 px (time)",
        "212.00 MiB of 256.00 MiB",
        "waiting for 12 pages (terrain 4, imagery 8), the oldest for 1.8 s",
        "Natural Earth II · GEBCO 2024 · City of Helsinki, CC BY 4.0",
        "at least 48 MiB",
        "saved the screenshot",
        "0:12",
        "Golden Gate  3",
    ] {
        assert!(text.contains(part), "{part:?} is not in {text}");
    }
    window.panels.open.side = Some(Side::Help);
    let text = window.settle(&shown).all_text();
    for (keys, what) in CONTROLS {
        assert!(text.contains(keys) && text.contains(what), "{keys}: {text}");
    }
}

#[test]
fn every_letter_has_a_picture() {
    let world = World::new();
    let mut shown = world.shown([1280, 720]);
    shown.gpu_ms = None;
    let mut window = Window::new([1280, 720], 1.0, all_open(Side::Settings));
    let mut text = String::new();
    for side in [Side::Settings, Side::Help, Side::Sets] {
        window.panels.open.side = Some(side);
        text += &window.settle(&shown).all_text();
        shown.playback = Playback::Replaying { at_s: 1.0, of_s: 2.0 };
        window.panels.open.hud_brief = true;
        shown.above_ground_m = Some(12_345_678.0);
    }
    let has = |font: egui::FontId, letter| window.ctx.fonts_mut(|fonts| fonts.has_glyph(&font, letter));
    // Marks are always written in the fixed-width font; everything else may be in either.
    let lacks = |letter: &char| {
        let is_mark = "▶▼●".contains(*letter);
        !letter.is_whitespace() && !(has(look::mono(), *letter) && (is_mark || has(look::body(), *letter)))
    };
    assert!(text.contains('▶') && text.contains('▼') && text.contains('●') && text.contains('–'));
    assert_eq!(text.chars().filter(lacks).collect::<String>(), "");
}

#[test]
fn sets_are_listed_shown_and_hidden_and_a_typed_world_is_asked_for() {
    let mut world = World::new();
    world.messages = Messages::default();
    let shown = world.shown([1280, 720]);
    let mut window = Window::new([1280, 720], 1.0, all_open(Side::Sets));
    let text = window.settle(&shown).all_text();
    for part in ["helsinki", "boston", "east coast", "in default"] {
        assert!(text.contains(part), "{part}: {text}");
    }
    // The second one is hidden.
    assert_eq!(window.click_text(&shown, "helsinki"), [Action::ShowSet(0, false)]);
    assert_eq!(window.click_text(&shown, "boston"), [Action::ShowSet(1, true)]);
    assert_eq!(window.panels.take_world_asked(), None);
    assert_eq!(window.click_text(&shown, "folder of a world"), []);
    window.frame(&shown, vec![Event::Text(" /worlds/boston ".into())]);
    // Letters of a path do nothing else.
    assert_eq!(window.key(&shown, Key::H, Modifiers::NONE), []);
    assert_eq!(window.panels.open.side, Some(Side::Sets));
    assert_eq!(window.key(&shown, Key::Enter, Modifiers::NONE), []);
    assert_eq!(window.panels.take_world_asked().as_deref(), Some("/worlds/boston"));
    assert_eq!(window.panels.take_world_asked(), None);
    world.sets.clear();
    let mut shown = world.shown([1280, 720]);
    shown.is_opening = true;
    let text = window.settle(&shown).all_text();
    assert!(text.contains("no building sets") && text.contains("being opened"), "{text}");
}

#[test]
fn closed_panels_cost_next_to_nothing() {
    let mut world = World::new();
    world.messages = Messages::default();
    let shown = world.shown([1280, 720]);
    let closed = Panels::new(Open { status: false, ..Open::default() }, Overlays::default());
    let frame = Window::new([1280, 720], 1.0, closed).settle(&shown);
    assert_eq!(frame.texts.len(), 1, "{}", frame.all_text());
    let only_status = Window::new([1280, 720], 1.0, Panels::default()).settle(&shown);
    let open = Window::new([1280, 720], 1.0, all_open(Side::Settings)).settle(&shown);
    assert!(frame.vertices() < 400, "{}", frame.vertices());
    assert!(only_status.vertices() < 1500, "{}", only_status.vertices());
    assert!(open.vertices() < 12_000, "{}", open.vertices());
}

#[test]
fn keys_ask_for_what_the_controls_say() {
    let world = World::new();
    let shown = world.shown([1280, 720]);
    let mut window = Window::new([1280, 720], 1.0, Panels::default());
    window.settle(&shown);
    let (none, shift) = (Modifiers::NONE, Modifiers::SHIFT);
    for (key, modifiers, expected) in [
        (Key::N, none, Action::NorthUp),
        (Key::R, none, Action::Reset),
        (Key::P, none, Action::Screenshot),
        (Key::P, shift, Action::Record(false)),
        (Key::L, none, Action::Replay(true)),
        (Key::Num3, none, Action::Bookmark(2)),
        (Key::F11, none, Action::FullScreen),
        (Key::Escape, none, Action::Stop),
        (Key::Q, Modifiers::COMMAND, Action::Quit),
        (Key::Period, none, Action::Tolerance(std::f64::consts::SQRT_2)),
    ] {
        assert_eq!(window.key(&shown, key, modifiers), [expected], "{key:?}");
    }
    for (key, modifiers) in [(Key::Num9, none), (Key::N, Modifiers::COMMAND), (Key::W, none), (Key::Q, none)] {
        assert_eq!(window.key(&shown, key, modifiers), [], "{key:?}");
    }
    // The keyboard repeats what is held.
    let held = Event::Key { key: Key::N, physical_key: None, pressed: true, repeat: false, modifiers: Modifiers::NONE };
    assert_eq!(window.frame(&shown, vec![held.clone()]).actions, [Action::NorthUp]);
    assert_eq!(window.frame(&shown, vec![held]).actions, []);
}

#[test]
fn keys_open_and_close_panels() {
    let world = World::new();
    let shown = world.shown([1280, 720]);
    let mut window = Window::new([1280, 720], 1.0, Panels::default());
    let mut press = |key| {
        assert_eq!(window.key(&shown, key, Modifiers::NONE), []);
        (window.panels.open, window.panels.overlays)
    };
    assert!(press(Key::T).0.hud && !press(Key::F1).0.hud);
    assert_eq!(press(Key::H).0.side, Some(Side::Help));
    assert_eq!(press(Key::B).0.side, Some(Side::Sets));
    assert_eq!(press(Key::H).0.side, Some(Side::Help));
    assert_eq!(press(Key::O).0.side, Some(Side::Settings));
    assert_eq!(press(Key::Escape).0.side, None);
    assert!(!press(Key::I).0.status);
    assert!(press(Key::Z).1.zones && press(Key::C).1.cells && press(Key::X).1.page_state);
    assert!(!press(Key::Z).1.zones);
}

#[test]
fn buttons_ask_for_what_keys_do() {
    let world = World::new();
    let shown = world.shown([1280, 720]);
    let mut window = Window::new([1280, 720], 1.0, all_open(Side::Settings));
    for (text, action) in [
        ("North up", Action::NorthUp),
        ("Screenshot", Action::Screenshot),
        ("End recording", Action::Record(false)),
        ("Replay", Action::Replay(true)),
        ("Helsinki  2", Action::Bookmark(1)),
        ("Quit", Action::Quit),
    ] {
        assert_eq!(window.click_text(&shown, text), [action], "{text}");
    }
    assert_eq!(window.click_text(&shown, "Zones"), []);
    assert!(window.panels.overlays.zones);
    assert_eq!(window.click_text(&shown, "Coarser where"), [Action::FrameMs(None)]);
    // The compass, at the right end of the status line.
    assert_eq!(window.click(&shown, pos2(1280.0 - 18.0, 720.0 - 12.0)), [Action::NorthUp]);
    // A click on the first line of the display.
    window.click_text(&shown, "fps");
    assert!(window.panels.open.hud_brief);
}

#[test]
fn sliders_ask_while_dragged_and_for_memory_when_let_go() {
    let world = World::new();
    let shown = world.shown([1280, 720]);
    let mut window = Window::new([1280, 720], 1.0, all_open(Side::Settings));
    let mut drag = |label: &str| {
        let frame = window.settle(&shown);
        let label = frame.rect_of(label).unwrap();
        let at = pos2(label.left() + 10.0, label.bottom() + 11.0);
        let button = |pos, pressed| Event::PointerButton {
            pos,
            button: PointerButton::Primary,
            pressed,
            modifiers: Modifiers::NONE,
        };
        window.frame(&shown, vec![Event::PointerMoved(at)]);
        window.frame(&shown, vec![button(at, true)]);
        let end = at + vec2(60.0, 0.0);
        let dragged = window.frame(&shown, vec![Event::PointerMoved(end)]).actions;
        let released = window.frame(&shown, vec![button(end, false)]).actions;
        (dragged, released)
    };
    let (dragged, _) = drag("Tolerance");
    let [Action::Tolerance(px)] = dragged[..] else { panic!("{dragged:?}") };
    assert!(px > 1.0 && px <= 16.0, "{px}");
    let (dragged, released) = drag("Footprint");
    assert_eq!(dragged, []);
    let [Action::Footprint(bytes)] = released[..] else { panic!("{released:?}") };
    assert!(bytes > ByteSize(256 << 20) && bytes <= FOOTPRINT_MAX, "{bytes}");
}

#[test]
fn the_box_flies_to_what_is_written() {
    let world = World::new();
    let shown = world.shown([1280, 720]);
    let mut window = Window::new([1280, 720], 1.0, Panels::default());
    window.settle(&shown);
    let none = Modifiers::NONE;
    // The letter that comes with the key is no part of the text.
    let pressed = |key| Event::Key { key, physical_key: None, pressed: true, repeat: false, modifiers: none };
    let released = |key| Event::Key { key, physical_key: None, pressed: false, repeat: false, modifiers: none };
    window.frame(&shown, vec![pressed(Key::F), Event::Text("f".into())]);
    let frame = window.settle(&shown);
    assert!(frame.rect_of("60.16990, 24.93840").is_some(), "{}", frame.all_text());
    assert!(window.ctx.egui_wants_keyboard_input());
    // What is typed takes the place of what was there, and keys are letters.
    let typed = window.frame(&shown, vec![pressed(Key::N), Event::Text("nowhere".into())]);
    assert_eq!(typed.actions, []);
    assert_eq!(window.key(&shown, Key::Enter, none), []);
    let frame = window.settle(&shown);
    assert!(frame.all_text().contains("\"nowhere\" is no bookmark"), "{}", frame.all_text());
    window.frame(&shown, vec![Event::Text("10 S, 20 E, 400".into())]);
    let flown = window.key(&shown, Key::Enter, none);
    let [Action::FlyTo(place)] = flown[..] else { panic!("{flown:?}") };
    assert!((place.lat_rad.to_degrees() + 10.0).abs() < 1e-9);
    assert_eq!(place.above_ground_m, Some(400.0));
    assert!(!window.panels.asks_for_place());
    window.settle(&shown);
    window.frame(&shown, vec![released(Key::F)]);
    window.key(&shown, Key::F, none);
    window.settle(&shown);
    window.frame(&shown, vec![Event::Text("hel".into())]);
    assert_eq!(window.key(&shown, Key::Enter, none), [Action::Bookmark(1)]);
    window.key(&shown, Key::F, none);
    window.settle(&shown);
    assert_eq!(window.key(&shown, Key::Escape, none), []);
    assert!(!window.panels.asks_for_place());
    assert!(!window.ctx.egui_wants_keyboard_input());
}

#[test]
fn messages_go_and_ask_for_the_frame_in_which_they_do() {
    let world = World::new();
    let mut shown = world.shown([640, 360]);
    let mut window = Window::new([640, 360], 1.0, Panels::default());
    assert!(window.settle(&shown).all_text().contains("cannot read packs/12.pack"));
    shown.now_s = 100.0;
    assert!(!window.settle(&shown).all_text().contains("cannot read packs/12.pack"));
}

#[test]
fn no_value_makes_the_panels_fail() {
    let mut world = World::new();
    world.credits = vec!["x".repeat(10_000); 500];
    world.bookmarks = vec!["b".repeat(5000); 100];
    for wild in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 0.0, -1.0, 1e300, 1e-300] {
        let size = if wild > 0.0 { ByteSize(u64::MAX) } else { ByteSize(0) };
        world.report = FrameReport {
            triangles: u64::MAX,
            draw_calls: u32::MAX,
            debt_px: wild,
            tolerance_drawn_px: wild,
            lack: Lack::Memory,
            footprint_bytes: size.0,
            ..FrameReport::default()
        };
        world.times.push(wild);
        for (size_px, scale) in [([1, 1], 1.0), ([640, 360], 1.0), ([16_384, 16_384], 0.5)] {
            let mut shown = world.shown(size_px);
            let place = Geodetic { lat_rad: wild, lon_rad: wild, height_m: wild };
            let pose = Pose { eye: place, heading_rad: wild, pitch_rad: wild };
            shown.view = View::new(pose, wild, size_px);
            (shown.cursor, shown.middle, shown.above_ground_m) = (Some(place), Some(place), Some(wild));
            (shown.gpu_ms, shown.awaited_s, shown.cursor_error_m) = (Some(wild), Some(wild), Some(wild));
            shown.asked = Quality { tolerance_px: wild, footprint: size, frame_ms: Some(wild) };
            (shown.footprint_least, shown.bytes_read) = (size, size.0);
            let pages = PageCounts { resident: size.0, requested: size.0, failed: size.0, missing: size.0 };
            shown.pages = LayerCounts { terrain: pages, imagery: pages, objects: pages, index: pages };
            shown.playback = Playback::Replaying { at_s: wild, of_s: wild };
            for side in [Side::Settings, Side::Help, Side::Sets] {
                let mut window = Window::new(size_px, scale, all_open(side));
                window.panels.open_fly_to(&shown);
                let frame = window.settle(&shown);
                assert!(!frame.meshes.is_empty());
                for clipped in &frame.meshes {
                    let egui::epaint::Primitive::Mesh(mesh) = &clipped.primitive else { continue };
                    assert!(mesh.vertices.iter().all(|vertex| vertex.pos.x.is_finite() && vertex.pos.y.is_finite()));
                }
            }
        }
    }
}
