//! The card of all controls and credits, at the right.

use super::controls::CONTROLS;
use super::look::{self, MARGIN};
use super::shown::Shown;
use egui::text::LayoutJob;
use egui::{Align2, Context, Label, ScrollArea, Ui, pos2};

const WIDTH: f32 = 296.0;
/// Of the column that names keys, points.
const KEYS_WIDTH: f32 = 104.0;
/// Sources listed at most; worlds may have thousands.
const CREDITS_MAX: usize = 64;

pub(super) fn show(ctx: &Context, shown: &Shown<'_>) {
    let screen = ctx.content_rect();
    let at = pos2(screen.right() - MARGIN, screen.top() + MARGIN);
    look::panel(ctx, "help", Align2::RIGHT_TOP, at, |ui| {
        // Never over the middle of the picture.
        let half = screen.width() / 2.0 - 5.0 * MARGIN;
        ui.set_width(WIDTH.min(half.max(160.0)).min(screen.width() - 4.0 * MARGIN));
        let height_max = (screen.height() - look::BAR_HEIGHT - 6.0 * MARGIN).max(40.0);
        ScrollArea::vertical().max_height(height_max).min_scrolled_height(height_max).animated(false).show(ui, |ui| {
            controls(ui);
            ui.separator();
            credits(ui, shown);
        });
    });
}

fn controls(ui: &mut Ui) {
    ui.spacing_mut().interact_size.y = 0.0;
    egui::Grid::new("stoop controls").num_columns(2).min_col_width(KEYS_WIDTH).spacing([8.0, 1.5]).show(ui, |ui| {
        for (keys, what) in CONTROLS {
            for (text, color) in [(keys, look::ACCENT), (what, look::TEXT)] {
                let mut job = LayoutJob::default();
                look::append(&mut job, text, look::small(), color);
                ui.add(Label::new(job).wrap().selectable(false));
            }
            ui.end_row();
        }
    });
}

fn credits(ui: &mut Ui, shown: &Shown<'_>) {
    let mut job = LayoutJob::default();
    look::append(&mut job, &format!("{}: sources", shown.world), look::small(), look::WEAK);
    let lines: Vec<&str> = super::notes::credit_lines(shown.credits).collect();
    for line in lines.iter().take(CREDITS_MAX) {
        look::append(&mut job, &format!("\n{line}"), look::small(), look::TEXT);
    }
    if lines.len() > CREDITS_MAX {
        let more = format!("\nand {} more: see stoop info", lines.len() - CREDITS_MAX);
        look::append(&mut job, &more, look::small(), look::WEAK);
    }
    ui.add(Label::new(job).wrap());
}
