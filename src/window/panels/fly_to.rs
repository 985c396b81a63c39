//! The box that asks where to fly.

use super::action::Action;
use super::look::{self, BAR_HEIGHT, MARGIN};
use super::place_text::{Named, PLACE_CHARS_MAX, PlaceError, parse_place};
use super::shown::Shown;
use egui::text::{CCursor, CCursorRange};
use egui::{Align2, Context, Event, Key, Label, RichText, TextEdit, Ui, pos2};

const WIDTH: f32 = 250.0;
/// The line of credits stays free.
const CREDITS_HEIGHT: f32 = 16.0;
/// Height above the status line up to the box's upper edge, points.
pub(super) const TAKEN: f32 = 64.0;

/// An open box.
#[derive(Clone, Debug, Default)]
pub(super) struct FlyTo {
    text: String,
    error: Option<PlaceError>,
    /// The field has the keyboard and its text is selected.
    is_ready: bool,
}

/// What became of the box in a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Outcome {
    Open,
    Closed,
}

impl FlyTo {
    pub(super) fn new(text: String) -> Self {
        Self { text, ..Self::default() }
    }

    pub(super) fn show(&mut self, ctx: &Context, shown: &Shown<'_>, actions: &mut Vec<Action>) -> Outcome {
        if !self.is_ready {
            // The key that opened the box is no part of its text.
            ctx.input_mut(|input| input.events.retain(|event| !matches!(event, Event::Text(_))));
        }
        if ctx.input(|input| input.key_pressed(Key::Escape)) {
            return Outcome::Closed;
        }
        let screen = ctx.content_rect();
        let at = pos2(screen.center().x, screen.bottom() - BAR_HEIGHT - CREDITS_HEIGHT);
        let (entered, flown) = look::panel(ctx, "fly to", Align2::CENTER_BOTTOM, at, |ui| {
            ui.set_width(WIDTH.min(screen.width() - 4.0 * MARGIN));
            let entered = self.field(ui);
            self.hints(ui, shown);
            (entered, ui.input(|input| input.key_pressed(Key::Enter)))
        });
        if entered && flown { self.fly(shown, actions) } else { Outcome::Open }
    }

    /// Whether the field has or had the keyboard in this frame.
    fn field(&mut self, ui: &mut Ui) -> bool {
        let output = TextEdit::singleline(&mut self.text)
            .hint_text("60.17, 24.95  or a name")
            .char_limit(PLACE_CHARS_MAX)
            .desired_width(f32::INFINITY)
            .show(ui);
        let response = output.response.response;
        if !self.is_ready {
            response.request_focus();
            let mut state = output.state;
            let end = CCursor::new(self.text.chars().count());
            state.cursor.set_char_range(Some(CCursorRange::two(CCursor::new(0), end)));
            state.store(ui.ctx(), response.id);
            self.is_ready = true;
        }
        if response.changed() {
            self.error = None;
        }
        response.has_focus() || response.lost_focus()
    }

    fn hints(&self, ui: &mut Ui, shown: &Shown<'_>) {
        let hint = match &self.error {
            Some(error) => RichText::new(error.to_string()).small().color(look::BAD),
            None => {
                let mut hint = String::from("Enter flies, Esc closes");
                for name in shown.bookmarks.iter().take(super::BOOKMARK_KEYS) {
                    hint += &format!(" · {}", name.chars().take(super::words::NAME_CHARS).collect::<String>());
                }
                RichText::new(hint).small().color(look::WEAK)
            }
        };
        ui.add(Label::new(hint).wrap().selectable(false));
    }

    fn fly(&mut self, shown: &Shown<'_>, actions: &mut Vec<Action>) -> Outcome {
        match parse_place(&self.text, shown.bookmarks) {
            Ok(Named::Place(place)) => actions.push(Action::FlyTo(place)),
            Ok(Named::Bookmark(at)) => actions.push(Action::Bookmark(at)),
            Err(error) => {
                self.error = Some(error);
                // Enter took the keyboard away; it comes back with the text selected.
                self.is_ready = false;
                return Outcome::Open;
            }
        }
        Outcome::Closed
    }
}
