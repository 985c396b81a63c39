//! Sliders for the picture's quality, overlays, and a button for what each key does.

use super::action::Action;
use super::look::{self, MARGIN};
use super::shown::{FOOTPRINT_MAX, FRAME_MS, Playback, Quality, Shown, TOLERANCE_PX};
use super::{Panels, words};
use crate::units::ByteSize;
use crate::window::overlays::Overlays;
use egui::{Align2, Button, Context, Response, ScrollArea, Slider, Ui, pos2, vec2};

const WIDTH: f32 = 222.0;

pub(super) fn show(ctx: &Context, shown: &Shown<'_>, panels: &mut Panels, actions: &mut Vec<Action>) {
    let screen = ctx.content_rect();
    let at = pos2(screen.right() - MARGIN, screen.top() + MARGIN);
    look::panel(ctx, "settings", Align2::RIGHT_TOP, at, |ui| {
        ui.set_width(WIDTH.min(screen.width() - 4.0 * MARGIN));
        let height_max = (screen.height() - look::BAR_HEIGHT - 6.0 * MARGIN).max(40.0);
        ScrollArea::vertical().max_height(height_max).min_scrolled_height(height_max).animated(false).show(ui, |ui| {
            ui.spacing_mut().item_spacing.y = 4.0;
            quality(ui, shown, &mut panels.dragged, actions);
            ui.separator();
            overlays(ui, &mut panels.overlays);
            ui.separator();
            buttons(ui, shown, panels, actions);
        });
    });
}

/// A slider that is dragged shows its own value, as what was asked for may come back frames later.
fn quality(ui: &mut Ui, shown: &Shown<'_>, dragged: &mut Option<Quality>, actions: &mut Vec<Action>) {
    let mut quality = dragged.unwrap_or(shown.asked).sane();
    let is_held = [
        tolerance(ui, &mut quality, actions),
        footprint(ui, shown.footprint_least, &mut quality, actions),
        frame_ms(ui, &mut quality, actions),
    ];
    *dragged = is_held.contains(&true).then_some(quality);
}

fn row(ui: &mut Ui, name: &str, slider: Slider<'_>) -> Response {
    ui.label(name);
    ui.add(slider.handle_shape(egui::style::HandleShape::Rect { aspect_ratio: 0.45 }))
}

fn tolerance(ui: &mut Ui, quality: &mut Quality, actions: &mut Vec<Action>) -> bool {
    let [low, high] = TOLERANCE_PX;
    let slider = Slider::new(&mut quality.tolerance_px, low..=high).logarithmic(true).max_decimals(2).suffix(" px");
    let response = row(ui, "Tolerance: error allowed on the screen", slider);
    if response.changed() {
        actions.push(Action::Tolerance(quality.tolerance_px));
    }
    response.dragged()
}

fn footprint(ui: &mut Ui, least: ByteSize, quality: &mut Quality, actions: &mut Vec<Action>) -> bool {
    let mebi = f64::from(1 << 20);
    // Whole mebibytes, so that the least is not rounded below itself.
    let low = (least.0 as f64 / mebi).ceil().clamp(1.0, FOOTPRINT_MAX.0 as f64 / mebi - 1.0);
    let mut mebibytes = (quality.footprint.0 as f64 / mebi).max(low);
    let slider = Slider::new(&mut mebibytes, low..=FOOTPRINT_MAX.0 as f64 / mebi)
        .logarithmic(true)
        .custom_formatter(|mebibytes, _| ByteSize((mebibytes.round() * mebi) as u64).to_string())
        .custom_parser(mebibytes_of);
    let response = row(ui, &format!("Footprint: memory used, at least {low:.0} MiB"), slider);
    quality.footprint = ByteSize((mebibytes.round() * mebi) as u64);
    if response.drag_stopped() || (response.changed() && !response.dragged()) {
        actions.push(Action::Footprint(quality.footprint));
    }
    response.dragged()
}

/// A bare number is one of mebibytes.
fn mebibytes_of(text: &str) -> Option<f64> {
    let bare = text.trim().parse::<f64>().ok().filter(|number| number.is_finite());
    bare.or_else(|| text.parse::<ByteSize>().ok().map(|size| size.0 as f64 / f64::from(1 << 20)))
}

fn frame_ms(ui: &mut Ui, quality: &mut Quality, actions: &mut Vec<Action>) -> bool {
    let mut is_on = quality.frame_ms.is_some();
    let mut frame_ms = quality.frame_ms.or(Quality::default().frame_ms).unwrap_or(FRAME_MS[1]);
    let switched = ui.checkbox(&mut is_on, "Coarser where frames take over").changed();
    let [low, high] = FRAME_MS;
    let slider = Slider::new(&mut frame_ms, low..=high).logarithmic(true).max_decimals(0).suffix(" ms");
    let response = ui.add_enabled(is_on, slider.handle_shape(egui::style::HandleShape::Rect { aspect_ratio: 0.45 }));
    quality.frame_ms = is_on.then_some(frame_ms);
    if switched || response.changed() {
        actions.push(Action::FrameMs(quality.frame_ms));
    }
    response.dragged()
}

fn overlays(ui: &mut Ui, overlays: &mut Overlays) {
    ui.checkbox(&mut overlays.zones, look::key_text("Zones", "Z"));
    ui.checkbox(&mut overlays.cells, look::key_text("Cells and their levels", "C"));
    ui.checkbox(&mut overlays.page_state, look::key_text("State of their pages", "X"));
    if overlays.page_state {
        ui.horizontal_wrapped(|ui| {
            for state in crate::window::overlays::PieceState::ALL {
                ui.add(
                    egui::Label::new(egui::RichText::new(state.name()).small().color(state.color())).selectable(false),
                );
            }
        });
    }
}

fn buttons(ui: &mut Ui, shown: &Shown<'_>, panels: &mut Panels, actions: &mut Vec<Action>) {
    let screenshot = ("Screenshot", "P", Action::Screenshot);
    let [record, replay] = playback(shown.playback);
    ui.horizontal_wrapped(|ui| {
        ui.spacing_mut().item_spacing = vec2(4.0, 4.0);
        for (what, key, action) in [
            ("North up", "N", Action::NorthUp),
            ("Reset", "R", Action::Reset),
            screenshot,
            record,
            replay,
            ("Full screen", "F11", Action::FullScreen),
        ] {
            if button(ui, what, key) {
                actions.push(action);
            }
        }
        if button(ui, "Fly to", "F") {
            panels.open_fly_to(shown);
        }
        if button(ui, "Frame times", "T") {
            panels.open.hud = !panels.open.hud;
        }
        if button(ui, "Status line", "I") {
            panels.open.status = !panels.open.status;
        }
        if button(ui, "Building sets", "B") {
            panels.open.side = Some(super::Side::Sets);
        }
        if button(ui, "Help", "H") {
            panels.open.side = Some(super::Side::Help);
        }
        for (at, name) in shown.bookmarks.iter().enumerate().take(super::BOOKMARK_KEYS) {
            if button(ui, name, &(at + 1).to_string()) {
                actions.push(Action::Bookmark(at));
            }
        }
        if button(ui, "Quit", "Ctrl-Q") {
            actions.push(Action::Quit);
        }
    });
}

fn playback(playback: Playback) -> [(&'static str, &'static str, Action); 2] {
    let record = match playback {
        Playback::Recording { .. } => ("End recording", "Shift-P", Action::Record(false)),
        _ => ("Record path", "Shift-P", Action::Record(true)),
    };
    let replay = match playback {
        Playback::Replaying { .. } => ("End replay", "L", Action::Replay(false)),
        _ => ("Replay", "L", Action::Replay(true)),
    };
    [record, replay]
}

fn button(ui: &mut Ui, what: &str, key: &str) -> bool {
    let what: String = what.chars().take(words::NAME_CHARS).collect();
    ui.add(Button::new(look::key_text(&what, key)).truncate()).clicked()
}
