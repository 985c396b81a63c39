//! The line at the bottom: place under the cursor, height of the eye, scale bar, compass.

use super::action::Action;
use super::look::{self, BAR_HEIGHT, MARGIN};
use super::scale_bar::{ScaleBar, scale_bar};
use super::shown::{Playback, Shown};
use super::words;
use egui::{
    Align, Align2, Area, Color32, Context, Id, Layout, Order, Painter, Pos2, Rect, Sense, Ui, Vec2, pos2, vec2,
};

/// The scale bar is at most this wide, points.
const SCALE_BAR_WIDTH: f32 = 110.0;
/// Pages awaited for longer are worth a word even where the counts are hidden, seconds.
const WAITING_SAID_S: f64 = 1.0;
const COMPASS_RADIUS: f32 = 9.5;

/// `says_waiting`: whether it tells of pages that are awaited.
pub(super) fn show(ctx: &Context, shown: &Shown<'_>, says_waiting: bool, actions: &mut Vec<Action>) {
    let screen = ctx.content_rect();
    let rect = Rect::from_min_max(pos2(screen.left(), screen.bottom() - BAR_HEIGHT), screen.max);
    Area::new(Id::unique("stoop status")).order(Order::Middle).fixed_pos(rect.min).fade_in(false).show(ctx, |ui| {
        ui.painter().rect_filled(rect, 0.0, look::BACK);
        let mut ui = ui.new_child(
            egui::UiBuilder::new()
                .max_rect(rect.shrink2(vec2(MARGIN, 0.0)))
                .layout(Layout::right_to_left(Align::Center)),
        );
        ui.set_clip_rect(rect);
        ui.set_height(BAR_HEIGHT);
        if compass(&mut ui, shown.view.pose.heading_rad) {
            actions.push(Action::NorthUp);
        }
        draw_scale_bar(&mut ui, shown);
        ui.with_layout(Layout::left_to_right(Align::Center), |ui| texts(ui, shown, says_waiting));
    });
}

fn texts(ui: &mut Ui, shown: &Shown<'_>, says_waiting: bool) {
    let mut job = egui::text::LayoutJob::default();
    match shown.playback {
        Playback::Off => {}
        Playback::Recording { at_s } => {
            look::append(&mut job, &format!("● {}   ", words::clock(at_s)), look::mono(), look::BAD);
        }
        Playback::Replaying { at_s, of_s } => {
            let text = format!("▶ {} of {}   ", words::clock(at_s), words::clock(of_s));
            look::append(&mut job, &text, look::mono(), look::ACCENT);
        }
    }
    if let Some(place) = shown.cursor {
        look::append(&mut job, &words::place(place), look::mono(), look::TEXT);
        look::append(&mut job, &format!("  {}", words::metres(place.height_m)), look::mono(), look::TEXT);
        if let Some(error_m) = shown.cursor_error_m {
            look::append(&mut job, &format!(" ± {}", words::metres(error_m)), look::mono(), look::WEAK);
        }
    } else {
        look::append(&mut job, "no ground under the cursor", look::body(), look::WEAK);
    }
    look::append(&mut job, "   eye", look::body(), look::WEAK);
    let eye = shown.above_ground_m.map_or_else(
        || format!(" {} above the ellipsoid", words::metres(shown.view.pose.eye.height_m)),
        |height_m| format!(" {} above ground", words::metres(height_m)),
    );
    look::append(&mut job, &eye, look::mono(), look::TEXT);
    if says_waiting
        && shown.awaited_s.is_some_and(|seconds| seconds > WAITING_SAID_S)
        && let Some(waiting) = super::hud::waiting(shown)
    {
        look::append(&mut job, &format!("   {waiting}"), look::body(), look::WARN);
    }
    ui.add(egui::Label::new(job).truncate().selectable(false));
}

fn draw_scale_bar(ui: &mut Ui, shown: &Shown<'_>) {
    let points_per_px = 1.0 / f64::from(ui.ctx().pixels_per_point());
    let bar =
        shown.middle.and_then(|middle| scale_bar(&shown.view, middle, f64::from(SCALE_BAR_WIDTH) / points_per_px));
    let Some(ScaleBar { length_m, width_px }) = bar else { return };
    let (rect, _) = ui.allocate_exact_size(vec2(SCALE_BAR_WIDTH + 2.0 * MARGIN, BAR_HEIGHT), Sense::hover());
    let width = (width_px * points_per_px) as f32;
    let base = rect.bottom() - 5.0;
    let (left, right) = (rect.center().x - width / 2.0, rect.center().x + width / 2.0);
    let stroke = look::line(1.5, look::TEXT);
    let tick = |x: f32| pos2(x, base - 4.0);
    let points = vec![tick(left), pos2(left, base), pos2(right, base), tick(right)];
    ui.painter().line(points, stroke);
    let text_at = pos2(rect.center().x, base - 2.0);
    ui.painter().text(text_at, Align2::CENTER_BOTTOM, length_text(length_m), look::small(), look::TEXT);
}

/// Round lengths need no decimals: `200 m`, `5 km`, `5 cm`.
fn length_text(length_m: f64) -> String {
    match length_m {
        m if m >= 999.0 => format!("{:.0} km", m / 1000.0),
        m if m >= 0.99 => format!("{m:.0} m"),
        m if m >= 0.0099 => format!("{:.0} cm", m * 100.0),
        m => format!("{:.0} mm", m * 1000.0),
    }
}

/// Whether it was clicked. The needle points north in the picture: up when looking north.
fn compass(ui: &mut Ui, heading_rad: f64) -> bool {
    let (rect, response) = ui.allocate_exact_size(Vec2::splat(BAR_HEIGHT), Sense::click());
    let heading_rad = if heading_rad.is_finite() { heading_rad } else { 0.0 };
    let rim = if response.hovered() { look::ACCENT } else { Color32::from_gray(95) };
    ui.painter().circle(rect.center(), COMPASS_RADIUS, Color32::from_gray(28), look::line(1.0, rim));
    needle(ui.painter(), rect.center(), heading_rad);
    let degrees = heading_rad.to_degrees().rem_euclid(360.0).round() % 360.0;
    response.on_hover_text(format!("heading {degrees:.0}°; click for north up (N)")).clicked()
}

fn needle(painter: &Painter, center: Pos2, heading_rad: f64) {
    // North lies against the heading; y runs down.
    let (sin, cos) = (heading_rad.sin() as f32, heading_rad.cos() as f32);
    let north = vec2(-sin, -cos) * (COMPASS_RADIUS - 2.0);
    let side = vec2(cos, -sin) * 3.0;
    let half = |tip: Vec2, color| {
        egui::Shape::convex_polygon(vec![center + tip, center + side, center - side], color, egui::Stroke::NONE)
    };
    painter.add(half(-north, Color32::from_gray(190)));
    painter.add(half(north, Color32::from_rgb(240, 80, 70)));
}
