//! What happened and is worth a line: shown for some seconds, then faded out.

use std::collections::VecDeque;

/// Messages kept; the oldest goes first.
pub const MESSAGES_MAX: usize = 5;
/// A longer text is cut.
pub const MESSAGE_CHARS_MAX: usize = 240;
const FADE_S: f64 = 0.8;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MessageKind {
    /// Something was done.
    Done,
    /// Something failed; stays longer.
    Failed,
}

impl MessageKind {
    /// Seconds until a message has gone.
    pub fn shown_s(self) -> f64 {
        match self {
            Self::Done => 5.0,
            Self::Failed => 12.0,
        }
    }
}

#[derive(Clone, Debug, PartialEq)]
pub struct Message {
    pub kind: MessageKind,
    pub text: String,
    said_s: f64,
}

impl Message {
    /// 1 fully shown, 0 gone.
    pub fn strength(&self, now_s: f64) -> f32 {
        let left_s = self.said_s + self.kind.shown_s() - now_s;
        (left_s / FADE_S).clamp(0.0, 1.0) as f32
    }
}

/// A bounded list of messages. Times are seconds of any clock that does not run backwards.
#[derive(Clone, Debug, Default)]
pub struct Messages {
    kept: VecDeque<Message>,
}

impl Messages {
    /// A text that is shown already is not shown twice: it starts anew.
    pub fn say(&mut self, kind: MessageKind, text: impl Into<String>, now_s: f64) {
        let text = shortened(text.into());
        self.kept.retain(|message| message.text != text && message.strength(now_s) > 0.0);
        if self.kept.len() == MESSAGES_MAX {
            self.kept.pop_front();
        }
        self.kept.push_back(Message { kind, text, said_s: now_s });
    }

    /// Those still shown, oldest first.
    pub fn shown(&self, now_s: f64) -> impl Iterator<Item = &Message> {
        self.kept.iter().filter(move |message| message.strength(now_s) > 0.0)
    }

    /// Seconds until the picture of the messages changes; `None` when none is shown.
    pub fn changes_in_s(&self, now_s: f64) -> Option<f64> {
        self.shown(now_s)
            .map(|message| (message.said_s + message.kind.shown_s() - FADE_S - now_s).max(0.0))
            .min_by(f64::total_cmp)
    }
}

fn shortened(text: String) -> String {
    match text.char_indices().nth(MESSAGE_CHARS_MAX) {
        Some((end, _)) => format!("{}…", text[..end].trim_end()),
        None => text,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_fade_and_go() {
        let mut messages = Messages::default();
        messages.say(MessageKind::Done, "saved", 10.0);
        messages.say(MessageKind::Failed, "broken", 10.0);
        let texts = |now_s| messages.shown(now_s).map(|message| message.text.as_str()).collect::<Vec<_>>();
        assert_eq!(texts(10.0), ["saved", "broken"]);
        assert_eq!(texts(16.0), ["broken"]);
        assert_eq!(texts(23.0), Vec::<&str>::new());
        let saved = messages.shown(14.6).next().unwrap();
        assert!(saved.strength(14.6) > 0.0 && saved.strength(14.6) < 1.0);
        assert!((messages.changes_in_s(10.0).unwrap() - 4.2).abs() < 1e-9);
        assert_eq!(messages.changes_in_s(14.6), Some(0.0));
        assert_eq!(messages.changes_in_s(30.0), None);
    }

    #[test]
    fn the_list_and_its_texts_are_bounded() {
        let mut messages = Messages::default();
        for at in 0..100 {
            messages.say(MessageKind::Failed, format!("{at} {}", "ä".repeat(1000)), 0.0);
        }
        assert_eq!(messages.shown(0.0).count(), MESSAGES_MAX);
        assert!(messages.shown(0.0).all(|message| message.text.chars().count() == MESSAGE_CHARS_MAX + 1));
        assert!(messages.shown(0.0).last().unwrap().text.starts_with("99"));
    }

    #[test]
    fn the_same_text_is_shown_once() {
        let mut messages = Messages::default();
        messages.say(MessageKind::Failed, "no disk", 0.0);
        messages.say(MessageKind::Failed, "no disk", 11.9);
        assert_eq!(messages.shown(20.0).count(), 1);
    }
}
