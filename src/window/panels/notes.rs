//! What lies at the lower edge without being asked for: credits and messages.

use super::look::{self, BAR_HEIGHT, MARGIN};
use super::messages::MessageKind;
use super::shown::Shown;
use egui::text::{LayoutJob, TextWrapping};
use egui::{Color32, Context, Id, LayerId, Order, Painter, Pos2, pos2, vec2};

/// Of the picture's width that credits and messages may take.
const WIDTH_SHARE: f32 = 0.55;

/// Each line once, in order, empty ones left out.
pub(super) fn credit_lines(credits: &[String]) -> impl Iterator<Item = &str> {
    credits.iter().enumerate().filter_map(|(at, line)| {
        let line = line.trim();
        let is_new = !credits[..at].iter().any(|earlier| earlier.trim() == line);
        (is_new && !line.is_empty()).then_some(line)
    })
}

/// One line at the bottom right, cut where it is too long; the help card has them all.
pub(super) fn show_credits(ctx: &Context, shown: &Shown<'_>, has_status: bool) {
    let text = credit_lines(shown.credits).take(16).collect::<Vec<_>>().join(" · ");
    if text.is_empty() {
        return;
    }
    let painter = painter(ctx, "credits");
    let screen = ctx.content_rect();
    let galley = painter.layout_job(one_line(&text, Color32::from_gray(200), screen.width() * WIDTH_SHARE, 1));
    let bottom = screen.bottom() - if has_status { BAR_HEIGHT } else { 0.0 };
    let size = galley.size() + vec2(8.0, 2.0);
    let rect = egui::Rect::from_min_size(pos2(screen.right() - size.x, bottom - size.y), size);
    painter.rect_filled(rect, 0.0, Color32::from_black_alpha(110));
    painter.galley(rect.min + vec2(4.0, 1.0), galley, look::TEXT);
}

/// Stacked at the bottom left, the newest lowest, above what is taken of the lower edge.
pub(super) fn show_messages(ctx: &Context, shown: &Shown<'_>, taken: f32) {
    let screen = ctx.content_rect();
    let width = (screen.width() * WIDTH_SHARE).min(420.0);
    let mut bottom = screen.bottom() - MARGIN - taken;
    let messages: Vec<_> = shown.messages.shown(shown.now_s).collect();
    for message in messages.into_iter().rev() {
        let strength = message.strength(shown.now_s);
        let color = match message.kind {
            MessageKind::Done => look::TEXT,
            MessageKind::Failed => look::BAD,
        };
        let mut painter = painter(ctx, "messages");
        painter.set_opacity(strength);
        let at = pos2(screen.left() + MARGIN, bottom);
        bottom = draw_message(&painter, &message.text, color, at, width) - 3.0;
    }
    if let Some(seconds) = shown.messages.changes_in_s(shown.now_s) {
        ctx.request_repaint_after_secs(seconds as f32);
    }
}

/// Returns where it begins.
fn draw_message(painter: &Painter, text: &str, color: Color32, left_bottom: Pos2, width: f32) -> f32 {
    let galley = painter.layout_job(one_line(text, color, width, 3));
    let size = galley.size() + vec2(12.0, 6.0);
    let rect = egui::Rect::from_min_size(left_bottom - vec2(0.0, size.y), size);
    painter.rect_filled(rect, 3.0, look::BACK);
    painter.galley(rect.min + vec2(6.0, 3.0), galley, color);
    rect.top()
}

fn one_line(text: &str, color: Color32, width: f32, rows: usize) -> LayoutJob {
    let mut job = LayoutJob::default();
    look::append(&mut job, text, look::small(), color);
    job.wrap = TextWrapping { max_width: width, max_rows: rows, ..Default::default() };
    job
}

fn painter(ctx: &Context, name: &str) -> Painter {
    ctx.layer_painter(LayerId::new(Order::Foreground, Id::unique(("stoop notes", name))))
}
