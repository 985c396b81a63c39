//! The list of building sets and the like, each with a box that shows or hides it, and a line that adds a world.

use super::action::Action;
use super::look::{self, MARGIN};
use super::shown::{SetRow, Shown};
use super::{Panels, words};
use egui::{Align2, Context, Label, RichText, ScrollArea, TextEdit, Ui, pos2};

const WIDTH: f32 = 222.0;
/// Characters of a path that is typed.
const PATH_CHARS_MAX: usize = 1024;

pub(super) fn show(ctx: &Context, shown: &Shown<'_>, panels: &mut Panels, actions: &mut Vec<Action>) {
    let screen = ctx.content_rect();
    let at = pos2(screen.right() - MARGIN, screen.top() + MARGIN);
    look::panel(ctx, "sets", Align2::RIGHT_TOP, at, |ui| {
        ui.set_width(WIDTH.min(screen.width() - 4.0 * MARGIN));
        let height_max = (screen.height() - look::BAR_HEIGHT - 6.0 * MARGIN).max(40.0);
        ScrollArea::vertical().max_height(height_max).min_scrolled_height(height_max).animated(false).show(ui, |ui| {
            ui.spacing_mut().item_spacing.y = 4.0;
            if shown.sets.is_empty() {
                weak(ui, "no building sets in these worlds");
            }
            for (number, set) in (0..=u8::MAX).zip(shown.sets) {
                row(ui, number, set, !shown.hidden.contains(number), actions);
            }
            ui.separator();
            add_world(ui, shown, panels);
        });
    });
}

fn row(ui: &mut Ui, number: u8, set: &SetRow, mut is_shown: bool, actions: &mut Vec<Action>) {
    let name: String = set.name.chars().take(words::NAME_CHARS).collect();
    if ui.checkbox(&mut is_shown, name).changed() {
        actions.push(Action::ShowSet(number, is_shown));
    }
    let world: String = set.world.chars().take(words::NAME_CHARS).collect();
    weak(ui, &format!("      {} in {world}", words::count(set.objects)));
}

fn weak(ui: &mut Ui, text: &str) {
    ui.add(Label::new(RichText::new(text).small().color(look::WEAK)).truncate().selectable(false));
}

fn add_world(ui: &mut Ui, shown: &Shown<'_>, panels: &mut Panels) {
    let hint = "folder of a world to add";
    let line = TextEdit::singleline(&mut panels.world_path).hint_text(hint).char_limit(PATH_CHARS_MAX);
    let response = ui.add(line.desired_width(f32::INFINITY));
    let entered = response.lost_focus() && ui.input(|input| input.key_pressed(egui::Key::Enter));
    let path = panels.world_path.trim();
    if entered && !path.is_empty() {
        panels.world_asked = Some(path.to_owned());
        panels.world_path.clear();
    }
    weak(ui, if shown.is_opening { "a world is being opened" } else { "Enter adds it; or drop the folder here" });
}
