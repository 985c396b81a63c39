//! Sets of page numbers, kept small: neighbours differ little, and most numbers follow one another.

use serde::{Deserialize, Serialize};

/// Ascending lists of numbers, each as the differences from one to the next, LEB128.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PackedSets {
    bytes: Vec<u8>,
    /// Where each list ends.
    ends: Vec<u32>,
}

impl PackedSets {
    /// `set` ascends.
    pub fn push(&mut self, set: &[u32]) {
        let mut next = 0;
        for &number in set {
            let mut step = number - next;
            while step >= 0x80 {
                self.bytes.push(step as u8 | 0x80);
                step >>= 7;
            }
            self.bytes.push(step as u8);
            next = number + 1;
        }
        self.ends.push(self.bytes.len() as u32);
    }

    pub fn len(&self) -> usize {
        self.ends.len()
    }

    /// The list of a number below [`PackedSets::len`]; what is no list gives fewer numbers.
    pub fn get(&self, at: usize) -> Vec<u32> {
        let start = at.checked_sub(1).map_or(0, |before| self.ends[before] as usize);
        let bytes = self.bytes.get(start..self.ends[at] as usize).unwrap_or_default();
        let (mut set, mut next, mut step, mut shift) = (Vec::new(), 0u32, 0u32, 0);
        for byte in bytes {
            step |= u32::from(byte & 0x7f).checked_shl(shift).unwrap_or(0);
            shift += 7;
            if *byte < 0x80 {
                let number = next.saturating_add(step);
                set.push(number);
                next = number.saturating_add(1);
                (step, shift) = (0, 0);
            }
        }
        set
    }

    /// Whether all lists are whole and hold numbers below `end` alone.
    pub fn is_sound(&self, end: u32) -> bool {
        self.ends.is_sorted()
            && self.ends.last().copied().unwrap_or(0) as usize == self.bytes.len()
            && (0..self.len()).all(|at| {
                let set = self.get(at);
                set.is_sorted_by(|a, b| a < b) && set.last().is_none_or(|&last| last < end)
            })
    }

    pub fn byte_len(&self) -> usize {
        self.bytes.len() + 4 * self.ends.len()
    }
}

/// What `to` has and `from` has not; both ascend.
pub fn difference(to: &[u32], from: &[u32]) -> Vec<u32> {
    to.iter().copied().filter(|number| from.binary_search(number).is_err()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sets_come_back_and_broken_ones_are_found() {
        let sets: [&[u32]; 4] = [&[0, 1, 2, 500], &[], &[70_000, 4_000_000_000], &[7]];
        let mut packed = PackedSets::default();
        sets.iter().for_each(|set| packed.push(set));
        assert!(sets.iter().enumerate().all(|(at, set)| packed.get(at) == *set));
        assert!(packed.is_sound(4_000_000_001) && !packed.is_sound(4_000_000_000));
        packed.ends[0] = 100;
        assert!(!packed.is_sound(u32::MAX));
        assert_eq!(difference(&[1, 3, 5], &[0, 3, 9]), [1, 5]);
    }
}
