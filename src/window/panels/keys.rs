//! The keys that the panels answer: all that act once when pressed. Keys that are held to fly are the navigator's.

use super::action::Action;
use super::shown::{Playback, Shown, TOLERANCE_PX};
use super::{BOOKMARK_KEYS, Panels, Side};
use egui::{Context, Event, Key, Modifiers};

/// Steps of the keys for the tolerance: two to a doubling.
const TOLERANCE_STEP: f64 = std::f64::consts::SQRT_2;

const DIGITS: [Key; BOOKMARK_KEYS] =
    [Key::Num1, Key::Num2, Key::Num3, Key::Num4, Key::Num5, Key::Num6, Key::Num7, Key::Num8, Key::Num9];

/// Answers the keys of this frame, unless a text is being written.
pub(super) fn answer(ctx: &Context, shown: &Shown<'_>, panels: &mut Panels, actions: &mut Vec<Action>) {
    let writes = panels.had_text || ctx.text_edit_focused();
    for (key, modifiers) in pressed(ctx) {
        // Shortcuts that write nothing hold in a text too.
        if writes && !(key == Key::F11 || key == Key::Q && modifiers.command) {
            continue;
        }
        if panels.fly_to.is_some() && key == Key::Escape {
            continue;
        }
        press(key, modifiers, shown, panels, actions);
    }
}

/// Keys whose places on the keyboard fly: whatever letters stand on them, they do nothing else.
const FLYING: [Key; 6] = [Key::W, Key::A, Key::S, Key::D, Key::E, Key::Q];

/// Keys that went down in this frame, without what the keyboard repeats and those that fly.
fn pressed(ctx: &Context) -> Vec<(Key, Modifiers)> {
    let of = |event: &Event| match *event {
        Event::Key { key, physical_key, pressed: true, repeat: false, modifiers } => {
            let flies = !modifiers.command && physical_key.is_some_and(|place| FLYING.contains(&place));
            (!flies).then_some((key, modifiers))
        }
        _ => None,
    };
    ctx.input(|input| input.events.iter().filter_map(of).collect())
}

fn press(key: Key, modifiers: Modifiers, shown: &Shown<'_>, panels: &mut Panels, actions: &mut Vec<Action>) {
    if modifiers.command || modifiers.ctrl || modifiers.alt {
        if key == Key::Q && !modifiers.alt {
            actions.push(Action::Quit);
        }
        return;
    }
    match key {
        Key::H => panels.toggle_side(Side::Help),
        Key::B => panels.toggle_side(Side::Sets),
        Key::O | Key::F2 => panels.toggle_side(Side::Settings),
        Key::T | Key::F1 => panels.open.hud = !panels.open.hud,
        Key::I => panels.open.status = !panels.open.status,
        Key::F => panels.open_fly_to(shown),
        Key::Z => panels.overlays.zones = !panels.overlays.zones,
        Key::C => panels.overlays.cells = !panels.overlays.cells,
        Key::X => panels.overlays.page_state = !panels.overlays.page_state,
        Key::Escape if panels.open.side.is_some() => panels.open.side = None,
        _ => actions.extend(action(key, modifiers, shown)),
    }
}

fn action(key: Key, modifiers: Modifiers, shown: &Shown<'_>) -> Option<Action> {
    let tolerance = |factor: f64| {
        let px = shown.asked.sane().tolerance_px * factor;
        Action::Tolerance(px.clamp(TOLERANCE_PX[0], TOLERANCE_PX[1]))
    };
    Some(match key {
        Key::N => Action::NorthUp,
        Key::R => Action::Reset,
        Key::P if modifiers.shift => Action::Record(!matches!(shown.playback, Playback::Recording { .. })),
        Key::P => Action::Screenshot,
        Key::L => Action::Replay(!matches!(shown.playback, Playback::Replaying { .. })),
        Key::Comma => tolerance(1.0 / TOLERANCE_STEP),
        Key::Period => tolerance(TOLERANCE_STEP),
        Key::F11 => Action::FullScreen,
        Key::Escape => Action::Stop,
        _ => {
            let at = DIGITS.iter().position(|&digit| digit == key)?;
            return (at < shown.bookmarks.len()).then_some(Action::Bookmark(at));
        }
    })
}
