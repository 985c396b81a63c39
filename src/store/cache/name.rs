//! Names of entries: all that must be known of one without opening it.

use std::fmt;

/// What an entry holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(in crate::store) enum Kind {
    /// Bytes of packs, and of indexes read while flying.
    Pages,
    /// Bytes of indexes that a world is opened with.
    Index,
    /// Which versions of its files a world was read at.
    Pins,
    Manifest,
}

impl Kind {
    const ALL: [Self; 4] = [Self::Pages, Self::Index, Self::Pins, Self::Manifest];

    fn letter(self) -> char {
        match self {
            Self::Pages => 'p',
            Self::Index => 'i',
            Self::Pins => 'v',
            Self::Manifest => 'm',
        }
    }

    /// Whether a world cannot be opened without it.
    pub fn is_vital(self) -> bool {
        self != Self::Pages
    }

    /// Whether another entry takes the place of one under the same name.
    pub fn is_replaced(self) -> bool {
        matches!(self, Self::Pins | Self::Manifest)
    }
}

/// A range of a version of a file: `p-0123456789abcdef0123456789abcdef-1f40-3e8.stoop`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(in crate::store) struct EntryName {
    pub kind: Kind,
    /// Hash of address, file and version.
    pub file: u128,
    pub offset: u64,
    /// 0 where the length is not known beforehand.
    pub len: u32,
}

const EXTENSION: &str = ".stoop";

impl EntryName {
    /// Of what is kept whole.
    pub fn whole(kind: Kind, file: u128) -> Self {
        Self { kind, file, offset: 0, len: 0 }
    }

    pub fn parse(text: &str) -> Option<Self> {
        let mut parts = text.strip_suffix(EXTENSION)?.split('-');
        let letter = parts.next()?;
        let kind = Kind::ALL.into_iter().find(|kind| letter.chars().eq([kind.letter()]))?;
        let file = u128::from_str_radix(parts.next()?, 16).ok()?;
        let offset = u64::from_str_radix(parts.next()?, 16).ok()?;
        let len = u32::from_str_radix(parts.next()?, 16).ok()?;
        let name = Self { kind, file, offset, len };
        // Numbers can be written in several ways; entries in one.
        (parts.next().is_none() && name.to_string() == text).then_some(name)
    }

    pub fn covers(&self, offset: u64, len: u32) -> bool {
        // A file's name may tell any numbers.
        let end = |offset: u64, len: u32| offset.saturating_add(len.into());
        self.offset <= offset && end(offset, len) <= end(self.offset, self.len)
    }
}

impl fmt::Display for EntryName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { kind, file, offset, len } = self;
        write!(f, "{}-{file:032x}-{offset:x}-{len:x}{EXTENSION}", kind.letter())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_back_and_others_are_left_alone() {
        for kind in Kind::ALL {
            let name = EntryName { kind, file: 0xabc, offset: 8000, len: 1000 };
            assert_eq!(EntryName::parse(&name.to_string()), Some(name));
        }
        let hash = "0".repeat(32);
        for text in ["", "notes.txt", "p-1-2-3.stoop", &format!("x-{hash}-0-0.stoop"), &format!("p-{hash}-+1-0.stoop")]
        {
            assert_eq!(EntryName::parse(text), None, "{text}");
        }
    }
}
