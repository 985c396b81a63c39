//! Small sets of collections, by number.

/// Which of a world's collections; at most 256, as their numbers are bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct CollectionSet {
    bits: [u64; 4],
}

impl CollectionSet {
    pub const NONE: Self = Self { bits: [0; 4] };

    pub fn contains(self, collection: u8) -> bool {
        self.bits[usize::from(collection >> 6)] >> (collection & 63) & 1 == 1
    }

    /// The same with a collection.
    #[must_use]
    pub fn with(mut self, collection: u8) -> Self {
        self.bits[usize::from(collection >> 6)] |= 1 << (collection & 63);
        self
    }

    /// The same without a collection.
    #[must_use]
    pub fn without(mut self, collection: u8) -> Self {
        self.bits[usize::from(collection >> 6)] &= !(1 << (collection & 63));
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_set_holds_what_was_put_in_and_nothing_else() {
        let set =
            [0, 63, 64, 200, 255].into_iter().fold(CollectionSet::NONE, CollectionSet::with).without(64).without(7);
        let held: Vec<u8> = (0..=255).filter(|&at| set.contains(at)).collect();
        assert_eq!(held, [0, 63, 200, 255]);
        assert_eq!(held.into_iter().fold(set, CollectionSet::without), CollectionSet::NONE);
    }
}
