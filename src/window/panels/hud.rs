//! Frame times and counts, at the top left.

use super::look::{self, MARGIN};
use super::shown::Shown;
use super::{curve, words};
use crate::engine::Lack;
use crate::paging::PageCounts;
use crate::units::ByteSize;
use egui::text::LayoutJob;
use egui::{Align2, Color32, Context, Label, Sense, Ui, vec2};

/// Of the column of text, points: a raised tolerance with its reason is the widest line.
const WIDTH: f32 = 252.0;
/// Triangles drawn over needed beside which they are worth a colour.
const DRAWN_AIM: f64 = 1.3;
/// Screen error beside which debt is worth a colour, px.
const DEBT_SEEN_PX: f64 = 0.05;

/// `is_brief` leaves only the first line; a click on it changes that.
pub(super) fn show(ctx: &Context, shown: &Shown<'_>, is_brief: &mut bool) {
    let at = ctx.content_rect().min + vec2(MARGIN, MARGIN);
    look::panel(ctx, "hud", Align2::LEFT_TOP, at, |ui| {
        ui.set_width(WIDTH);
        ui.spacing_mut().item_spacing.y = 2.0;
        header(ui, shown, is_brief);
        if !*is_brief {
            curve::show(ui, shown.frame_times, WIDTH);
            text(ui, frame_lines(shown));
            footprint(ui, shown);
            text(ui, page_lines(shown));
        }
        if let Some(waiting) = waiting(shown) {
            ui.add(Label::new(colored(&waiting, look::body(), look::WARN)).wrap().selectable(false));
        }
    });
}

fn header(ui: &mut Ui, shown: &Shown<'_>, is_brief: &mut bool) {
    let fps = shown.frame_times.fps().map_or_else(|| words::UNKNOWN.to_owned(), |fps| format!("{fps:.0}"));
    let mut job = LayoutJob::default();
    look::append(&mut job, if *is_brief { "▶ " } else { "▼ " }, look::mono(), look::WEAK);
    look::append(&mut job, &format!("{fps} fps"), look::body(), look::TEXT);
    let median = shown.frame_times.percentile_ms(0.5).map_or_else(String::new, words::millis);
    look::append(&mut job, &format!("   {median}   {}", shown.world), look::body(), look::WEAK);
    let header = ui.add(Label::new(job).truncate().selectable(false).sense(Sense::click()));
    if header.on_hover_text("click to show more or less; T hides").clicked() {
        *is_brief = !*is_brief;
    }
}

/// Rows of a name and a value.
struct Rows(LayoutJob);

impl Rows {
    fn row(&mut self, name: &str, value: &str, color: Color32) {
        let end = if self.0.is_empty() { "" } else { "\n" };
        look::append(&mut self.0, &format!("{end}{name:<11}"), look::mono(), look::WEAK);
        look::append(&mut self.0, value, look::mono(), color);
    }
}

fn text(ui: &mut Ui, Rows(job): Rows) {
    ui.add(Label::new(job).extend().selectable(false));
}

fn frame_lines(shown: &Shown<'_>) -> Rows {
    let mut rows = Rows(LayoutJob::default());
    let times = shown.frame_times;
    let millis = |ms: Option<f64>| ms.map_or_else(|| words::UNKNOWN.to_owned(), words::millis);
    let [median, late] = [0.5, 0.99].map(|share| millis(times.percentile_ms(share)));
    rows.row("frame", &format!("{median}, p99 {late}"), look::TEXT);
    rows.row("GPU", &millis(shown.gpu_ms), look::TEXT);
    let drawn = format!("{} in {} calls", words::count(shown.report.triangles), shown.report.draw_calls);
    rows.row("triangles", &drawn, look::TEXT);
    if let Some((modelled, color)) = modelled(shown) {
        rows.row("over need", &modelled, color);
    }
    let (tolerance, color) = tolerance(shown);
    rows.row("tolerance", &tolerance, color);
    let debt_px = shown.report.debt_px;
    rows.row("debt", &words::pixels(debt_px), if debt_px > DEBT_SEEN_PX { look::WARN } else { look::TEXT });
    rows.row("read", &ByteSize(shown.bytes_read).to_string(), look::TEXT);
    rows
}

/// What is drawn and held over what the picture needs: known at rest, without occlusion.
fn modelled(shown: &Shown<'_>) -> Option<(String, Color32)> {
    let (drawn, held) = (shown.report.drawn_over_needed()?, shown.report.resident_over_needed()?);
    let color = if drawn > DRAWN_AIM { look::WARN } else { look::TEXT };
    Some((format!("drawn {drawn:.2} ×, held {held:.1} ×"), color))
}

fn tolerance(shown: &Shown<'_>) -> (String, Color32) {
    let asked = words::pixels(shown.asked.tolerance_px);
    let why = match shown.report.lack {
        Lack::Nothing => return (asked, look::TEXT),
        Lack::Memory => "memory",
        Lack::Time => "time",
    };
    (format!("{asked}, drawn {} ({why})", words::pixels(shown.report.tolerance_drawn_px)), look::WARN)
}

fn footprint(ui: &mut Ui, shown: &Shown<'_>) {
    let (used, limit) = (ByteSize(shown.report.footprint_bytes), shown.asked.footprint);
    let share = used.0 as f64 / limit.0.max(1) as f64;
    let mut rows = Rows(LayoutJob::default());
    rows.row("footprint", &format!("{used} of {limit}"), look::TEXT);
    text(ui, rows);
    look::bar(ui, vec2(WIDTH, 3.0), share, if share > 0.95 { look::WARN } else { look::ACCENT });
}

fn page_lines(shown: &Shown<'_>) -> Rows {
    let layers = shown.pages.layers().map(|(_, pages)| pages);
    let mut rows = Rows(LayoutJob::default());
    rows.row("pages", &format!("{:>8}{:>8}{:>8}{:>8}", "terrain", "imagery", "objects", "index"), look::WEAK);
    let mut state = |name: &str, of: fn(&PageCounts) -> u64, color| {
        let counts = layers.each_ref().map(of);
        let value: String = counts.iter().map(|&pages| format!("{:>8}", words::count(pages))).collect();
        rows.row(name, &value, if counts.iter().all(|&pages| pages == 0) { look::WEAK } else { color });
    };
    state("resident", |pages| pages.resident, look::TEXT);
    state("requested", |pages| pages.requested, look::ACCENT);
    state("missing", |pages| pages.missing, look::WARN);
    state("failed", |pages| pages.failed, look::BAD);
    rows
}

/// `waiting for 12 pages (terrain 4, imagery 8), the oldest for 1.8 s`; `None` when nothing is missing.
pub(super) fn waiting(shown: &Shown<'_>) -> Option<String> {
    let missing = shown.pages.total().missing;
    if missing == 0 {
        return None;
    }
    let layers = shown.pages.layers();
    let parts: Vec<String> = layers
        .iter()
        .filter(|(_, pages)| pages.missing > 0)
        .map(|(name, pages)| format!("{name} {}", words::count(pages.missing)))
        .collect();
    let oldest = shown
        .awaited_s
        .filter(|seconds| seconds.is_finite())
        .map_or_else(String::new, |seconds| format!(", the oldest for {seconds:.1} s"));
    let noun = if missing == 1 { "page" } else { "pages" };
    Some(format!("waiting for {} {noun} ({}){oldest}", words::count(missing), parts.join(", ")))
}

fn colored(text: &str, font: egui::FontId, color: Color32) -> LayoutJob {
    let mut job = LayoutJob::default();
    look::append(&mut job, text, font, color);
    job
}
