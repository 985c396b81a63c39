//! How panels look: dark, translucent, small, and cheap to draw (no shadows, no blur, no animation).

use egui::{Align2, Area, Color32, Context, CornerRadius, FontFamily, FontId, Frame, Id, Margin, Order, Pos2, Rect};
use egui::{Shadow, Stroke, TextStyle, Ui, Vec2, Visuals, vec2};

pub(super) const BACK: Color32 = Color32::from_rgba_premultiplied(8, 10, 14, 200);
pub(super) const TEXT: Color32 = Color32::from_gray(225);
pub(super) const WEAK: Color32 = Color32::from_gray(160);
pub(super) const ACCENT: Color32 = Color32::from_rgb(120, 190, 255);
pub(super) const WARN: Color32 = Color32::from_rgb(255, 190, 90);
pub(super) const BAD: Color32 = Color32::from_rgb(255, 115, 100);
/// Between panels and the edge of the picture, points.
pub(super) const MARGIN: f32 = 6.0;
/// Height of the status line, points.
pub(super) const BAR_HEIGHT: f32 = 24.0;
const TEXT_PT: f32 = 12.0;
const SMALL_PT: f32 = 10.0;
const MONO_PT: f32 = 10.5;

pub(super) fn mono() -> FontId {
    FontId::new(MONO_PT, FontFamily::Monospace)
}

pub(super) fn small() -> FontId {
    FontId::new(SMALL_PT, FontFamily::Proportional)
}

pub(super) fn body() -> FontId {
    FontId::new(TEXT_PT, FontFamily::Proportional)
}

/// Sets the style once; every later frame leaves it.
pub(super) fn set_style(ctx: &Context) {
    let set = Id::unique("stoop look");
    if ctx.data(|data| data.get_temp(set).unwrap_or(false)) {
        return;
    }
    ctx.data_mut(|data| data.insert_temp(set, true));
    ctx.set_theme(egui::Theme::Dark);
    ctx.all_styles_mut(|style| {
        style.visuals = visuals();
        style.animation_time = 0.0;
        style.spacing.item_spacing = vec2(6.0, 3.0);
        style.spacing.button_padding = vec2(5.0, 1.0);
        style.spacing.interact_size = vec2(28.0, 17.0);
        style.spacing.slider_width = 92.0;
        style.text_styles = [
            (TextStyle::Small, small()),
            (TextStyle::Body, body()),
            (TextStyle::Button, body()),
            (TextStyle::Heading, FontId::new(14.0, FontFamily::Proportional)),
            (TextStyle::Monospace, mono()),
        ]
        .into();
    });
}

fn visuals() -> Visuals {
    let mut visuals = Visuals::dark();
    visuals.override_text_color = Some(TEXT);
    visuals.window_shadow = Shadow::NONE;
    visuals.popup_shadow = Shadow::NONE;
    visuals.extreme_bg_color = Color32::from_rgb(22, 25, 32);
    visuals.selection.bg_fill = Color32::from_rgb(40, 85, 130);
    visuals.slider_trailing_fill = true;
    visuals
}

/// The dark ground that texts stand on.
pub(super) fn card() -> Frame {
    Frame::NONE.fill(BACK).corner_radius(CornerRadius::same(4)).inner_margin(Margin::symmetric(8, 6))
}

/// A panel at an edge of the picture. `at` is where the corner or side named by `align` goes.
pub(super) fn panel<R>(ctx: &Context, name: &str, align: Align2, at: Pos2, contents: impl FnOnce(&mut Ui) -> R) -> R {
    Area::new(Id::unique(("stoop panel", name)))
        .order(Order::Middle)
        .pivot(align)
        .fixed_pos(at)
        .constrain(true)
        .fade_in(false)
        .show(ctx, |ui| card().show(ui, contents).inner)
        .inner
}

/// A key's name after what it does.
pub(super) fn key_text(what: &str, key: &str) -> egui::text::LayoutJob {
    let mut job = egui::text::LayoutJob::default();
    append(&mut job, what, body(), TEXT);
    append(&mut job, &format!("  {key}"), small(), WEAK);
    job
}

pub(super) fn append(job: &mut egui::text::LayoutJob, text: &str, font: FontId, color: Color32) {
    job.append(text, 0.0, egui::TextFormat { font_id: font, color, valign: egui::Align::Center, ..Default::default() });
}

/// A bar filled from the left; `share` from 0 to 1, anything else is clamped.
pub(super) fn bar(ui: &mut Ui, size: Vec2, share: f64, color: Color32) {
    let (rect, _) = ui.allocate_exact_size(size, egui::Sense::hover());
    let share = if share.is_finite() { share.clamp(0.0, 1.0) as f32 } else { 0.0 };
    ui.painter().rect_filled(rect, 0.0, Color32::from_gray(45));
    let filled = Rect::from_min_size(rect.min, vec2(rect.width() * share, rect.height()));
    ui.painter().rect_filled(filled, 0.0, color);
}

pub(super) fn line(width: f32, color: Color32) -> Stroke {
    Stroke::new(width, color)
}
