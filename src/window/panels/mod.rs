//! Panels over the picture: what they show comes as plain data, what is asked for leaves as actions. Nothing here
//! knows the window, the engine's threads or a clock.

mod action;
mod controls;
mod curve;
mod fly_to;
mod frame_times;
mod help;
mod hud;
mod keys;
mod look;
mod messages;
mod notes;
mod place_text;
mod place_tokens;
mod scale_bar;
mod sets_panel;
mod settings_panel;
mod shown;
mod status;
#[cfg(test)]
mod tests;
mod words;

pub use action::Action;
pub use controls::CONTROLS;
pub use frame_times::FrameTimes;
pub use messages::{MessageKind, Messages};
pub use place_text::Place;
pub use shown::{FRAME_MS, Playback, Quality, SetRow, Shown, TOLERANCE_PX};

use super::overlays::Overlays;
use egui::Context;
use fly_to::{FlyTo, Outcome};
use serde::{Deserialize, Serialize};

/// Bookmarks that have a key.
pub const BOOKMARK_KEYS: usize = 9;

/// What stands at the right; one at a time, so that the middle stays free.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Side {
    Settings,
    Help,
    Sets,
}

/// Which panels are open.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct Open {
    pub status: bool,
    pub hud: bool,
    /// Only the first line of it.
    pub hud_brief: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub side: Option<Side>,
}

impl Default for Open {
    fn default() -> Self {
        Self { status: true, hud: false, hud_brief: false, side: None }
    }
}

/// The panels' state.
#[derive(Clone, Debug, Default)]
pub struct Panels {
    pub open: Open,
    pub overlays: Overlays,
    /// Values of the sliders while one is dragged.
    dragged: Option<Quality>,
    fly_to: Option<FlyTo>,
    /// The folder of a world as it is being typed, and one that was asked for.
    world_path: String,
    world_asked: Option<String>,
    /// A text was being written when the last pass ended: Esc and Enter of this one belong to it.
    had_text: bool,
}

impl Panels {
    pub fn new(open: Open, overlays: Overlays) -> Self {
        Self { open, overlays, ..Self::default() }
    }

    /// Answers keys and clicks and lays the panels out; to be called once in every pass of `ctx`, with all of
    /// egui's events. A frame may have more than one pass: what all of them return is to be done. While [`Context::egui_wants_keyboard_input`], no key is meant for the globe; while
    /// [`Context::egui_wants_pointer_input`], no pointer is.
    pub fn show(&mut self, ctx: &Context, shown: &Shown<'_>) -> Vec<Action> {
        look::set_style(ctx);
        let mut actions = Vec::new();
        keys::answer(ctx, shown, self, &mut actions);
        if self.open.status {
            status::show(ctx, shown, !self.open.hud, &mut actions);
        }
        notes::show_credits(ctx, shown, self.open.status);
        if self.open.hud {
            hud::show(ctx, shown, &mut self.open.hud_brief);
        }
        match self.open.side {
            Some(Side::Settings) => settings_panel::show(ctx, shown, self, &mut actions),
            Some(Side::Help) => help::show(ctx, shown),
            Some(Side::Sets) => sets_panel::show(ctx, shown, self, &mut actions),
            None => {}
        }
        notes::show_messages(ctx, shown, self.lowest_note());
        if let Some(fly_to) = &mut self.fly_to
            && fly_to.show(ctx, shown, &mut actions) == Outcome::Closed
        {
            self.fly_to = None;
        }
        self.had_text = ctx.text_edit_focused();
        actions
    }

    /// Opens the box that asks for a place, with the place in the middle of the picture written in it.
    pub fn open_fly_to(&mut self, shown: &Shown<'_>) {
        let middle = shown.middle.or(shown.cursor).unwrap_or(shown.view.pose.eye);
        let is_place = middle.lat_rad.is_finite() && middle.lon_rad.is_finite();
        let text = if is_place { format!("{:.5}, {:.5}", middle.lat_deg(), middle.lon_deg()) } else { String::new() };
        self.fly_to = Some(FlyTo::new(text));
    }

    /// Whether the box that asks for a place is open.
    pub fn asks_for_place(&self) -> bool {
        self.fly_to.is_some()
    }

    /// The folder of a world that was asked for since the last call.
    pub fn take_world_asked(&mut self) -> Option<String> {
        self.world_asked.take()
    }

    /// Height that is taken at the lower edge, points: messages stand above it.
    fn lowest_note(&self) -> f32 {
        let status = if self.open.status { look::BAR_HEIGHT } else { 0.0 };
        if self.fly_to.is_some() { look::BAR_HEIGHT + fly_to::TAKEN } else { status }
    }

    fn toggle_side(&mut self, side: Side) {
        self.open.side = if self.open.side == Some(side) { None } else { Some(side) };
    }
}
