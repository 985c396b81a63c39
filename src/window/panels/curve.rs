//! The curve of frame times.

use super::frame_times::FrameTimes;
use super::look;
use egui::{Align2, Color32, Pos2, Rect, Sense, Ui, pos2, vec2};

/// Frames of 60 and of 30 in a second, milliseconds.
const LINES_MS: [f32; 2] = [16.7, 33.3];
/// What the curve's height stands for; longer frames are cut at its top.
const TOP_MS: f32 = 50.0;
const HEIGHT: f32 = 44.0;
/// Between frames, points.
const STEP: f32 = 1.5;

/// The newest frame at the right.
pub(super) fn show(ui: &mut Ui, times: &FrameTimes, width: f32) {
    let (rect, _) = ui.allocate_exact_size(vec2(width, HEIGHT), Sense::hover());
    let painter = ui.painter();
    painter.rect_filled(rect, 0.0, Color32::from_black_alpha(90));
    for line_ms in LINES_MS {
        let y = height_of(rect, line_ms);
        painter.hline(rect.x_range(), y, look::line(1.0, Color32::from_gray(75)));
        painter.text(pos2(rect.left() + 2.0, y), Align2::LEFT_BOTTOM, line_ms, look::small(), look::WEAK);
    }
    let frames = (rect.width() / STEP) as usize;
    let at = |(age, ms): (usize, f32)| pos2(rect.right() - age as f32 * STEP, height_of(rect, ms));
    let points: Vec<Pos2> = times.newest().take(frames).enumerate().map(at).collect();
    if points.len() > 1 {
        painter.line(points, look::line(1.0, look::ACCENT));
    }
}

fn height_of(rect: Rect, ms: f32) -> f32 {
    rect.bottom() - 1.0 - (ms / TOP_MS).min(1.0) * (rect.height() - 2.0)
}
