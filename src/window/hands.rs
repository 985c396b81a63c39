//! Window events as what hands do: the way from winit to the controller of the eye.

use crate::camera::{Button, Held, NavInput};
use winit::event::{ElementState, KeyEvent, MouseButton, MouseScrollDelta, WindowEvent};
use winit::keyboard::{Key, KeyCode, ModifiersState, PhysicalKey};

/// Physical pixels of a smooth wheel or touch pad that make a notch, at scale factor 1.
const NOTCH_PX: f64 = 50.0;

/// Keys that are held to fly, by their place on the keyboard.
const HELD: [(KeyCode, Held); 16] = [
    (KeyCode::KeyW, Held::Forward),
    (KeyCode::KeyS, Held::Back),
    (KeyCode::KeyA, Held::Left),
    (KeyCode::KeyD, Held::Right),
    (KeyCode::KeyE, Held::Up),
    (KeyCode::KeyQ, Held::Down),
    (KeyCode::ArrowLeft, Held::TurnLeft),
    (KeyCode::ArrowRight, Held::TurnRight),
    (KeyCode::ArrowUp, Held::TiltUp),
    (KeyCode::ArrowDown, Held::TiltDown),
    (KeyCode::PageUp, Held::ZoomIn),
    (KeyCode::PageDown, Held::ZoomOut),
    (KeyCode::NumpadAdd, Held::ZoomIn),
    (KeyCode::NumpadSubtract, Held::ZoomOut),
    (KeyCode::ShiftLeft, Held::Fast),
    (KeyCode::ShiftRight, Held::Fast),
];

/// Whether the panels take what the pointer or the keyboard does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Taken {
    pub pointer: bool,
    pub keyboard: bool,
}

/// Follows the modifiers.
#[derive(Clone, Debug, Default)]
pub struct Hands {
    modifiers: ModifiersState,
}

impl Hands {
    /// What an event means for the eye, if anything. What ends (a button or key let go, the pointer leaving) always
    /// counts, so that nothing stays held.
    pub fn translate(&mut self, event: &WindowEvent, scale_factor: f64, taken: Taken) -> Option<NavInput> {
        match event {
            WindowEvent::ModifiersChanged(modifiers) => {
                self.modifiers = modifiers.state();
                None
            }
            WindowEvent::CursorMoved { position, .. } => Some(NavInput::PointerMoved([position.x, position.y])),
            WindowEvent::CursorLeft { .. } => Some(NavInput::PointerLeft),
            WindowEvent::Focused(false) => Some(NavInput::Unfocused),
            WindowEvent::MouseInput { state, button, .. } => pointer_button(*button, *state, taken),
            WindowEvent::MouseWheel { delta, .. } if !taken.pointer => Some(wheel(*delta, scale_factor)),
            WindowEvent::KeyboardInput { event, is_synthetic: false, .. } => self.key(event, taken),
            _ => None,
        }
    }

    fn key(&self, event: &KeyEvent, taken: Taken) -> Option<NavInput> {
        self.held(held_by(event)?, event.state, event.repeat, taken)
    }

    /// A key that flies; shortcuts with Ctrl, Alt or Super are none of the eye's.
    fn held(&self, held: Held, state: ElementState, repeat: bool, taken: Taken) -> Option<NavInput> {
        let others = ModifiersState::CONTROL | ModifiersState::ALT | ModifiersState::SUPER;
        match state {
            ElementState::Released => Some(NavInput::Hold(held, false)),
            ElementState::Pressed if repeat || taken.keyboard || self.modifiers.intersects(others) => None,
            ElementState::Pressed => Some(NavInput::Hold(held, true)),
        }
    }
}

/// What a key is held for: by its place, or by the sign on it, whose place differs from keyboard to keyboard.
fn held_by(event: &KeyEvent) -> Option<Held> {
    match &event.logical_key {
        Key::Character(sign) if matches!(sign.as_str(), "+" | "=") => return Some(Held::ZoomIn),
        Key::Character(sign) if matches!(sign.as_str(), "-" | "_") => return Some(Held::ZoomOut),
        _ => {}
    }
    let PhysicalKey::Code(code) = event.physical_key else { return None };
    HELD.iter().find(|(key, _)| *key == code).map(|(_, held)| *held)
}

fn pointer_button(button: MouseButton, state: ElementState, taken: Taken) -> Option<NavInput> {
    let button = match button {
        MouseButton::Left => Button::Left,
        MouseButton::Middle => Button::Middle,
        MouseButton::Right => Button::Right,
        _ => return None,
    };
    match state {
        ElementState::Released => Some(NavInput::Released(button)),
        ElementState::Pressed => (!taken.pointer).then_some(NavInput::Pressed(button)),
    }
}

fn wheel(delta: MouseScrollDelta, scale_factor: f64) -> NavInput {
    let notches = match delta {
        MouseScrollDelta::LineDelta(_, lines) => f64::from(lines),
        MouseScrollDelta::PixelDelta(pixels) => pixels.y / (NOTCH_PX * scale_factor.max(0.1)),
    };
    NavInput::Wheel { notches }
}

#[cfg(test)]
mod tests {
    use super::*;
    use winit::dpi::PhysicalPosition;
    use winit::event::{DeviceId, TouchPhase};

    const NOTHING: Taken = Taken { pointer: false, keyboard: false };
    const ALL: Taken = Taken { pointer: true, keyboard: true };

    #[test]
    fn what_panels_take_does_not_move_the_eye_and_what_ends_always_ends() {
        let mut hands = Hands::default();
        let button = |state| WindowEvent::MouseInput { device_id: DeviceId::dummy(), state, button: MouseButton::Left };
        assert_eq!(
            hands.translate(&button(ElementState::Pressed), 1.0, NOTHING),
            Some(NavInput::Pressed(Button::Left))
        );
        assert_eq!(hands.translate(&button(ElementState::Pressed), 1.0, ALL), None);
        assert_eq!(hands.translate(&button(ElementState::Released), 1.0, ALL), Some(NavInput::Released(Button::Left)));
        let held = |state, taken| hands.held(Held::Forward, state, false, taken);
        assert_eq!(held(ElementState::Pressed, NOTHING), Some(NavInput::Hold(Held::Forward, true)));
        assert_eq!(held(ElementState::Pressed, ALL), None);
        assert_eq!(held(ElementState::Released, ALL), Some(NavInput::Hold(Held::Forward, false)));
        assert_eq!(hands.held(Held::Forward, ElementState::Pressed, true, NOTHING), None);
        hands.modifiers = ModifiersState::CONTROL;
        assert_eq!(hands.held(Held::Forward, ElementState::Pressed, false, NOTHING), None);
    }

    #[test]
    fn wheels_count_notches_on_any_display() {
        let mut hands = Hands::default();
        let mut notches = |delta, scale| {
            let event = WindowEvent::MouseWheel { device_id: DeviceId::dummy(), delta, phase: TouchPhase::Moved };
            hands.translate(&event, scale, NOTHING)
        };
        assert_eq!(notches(MouseScrollDelta::LineDelta(0.0, -2.0), 1.0), Some(NavInput::Wheel { notches: -2.0 }));
        let pixels = MouseScrollDelta::PixelDelta(PhysicalPosition::new(0.0, 100.0));
        assert_eq!(notches(pixels, 2.0), Some(NavInput::Wheel { notches: 1.0 }));
    }
}
