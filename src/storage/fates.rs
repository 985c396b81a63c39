//! Who is hit by a fault: a hash of the seed, of what is read and of how often it was read before. The order of
//! requests does not matter, so policies that ask differently meet the same faults.

use super::{Faults, PartOutcome, Request};
use std::collections::HashMap;
use xxhash_rust::xxh3::xxh3_64_with_seed;

/// Parts whose attempts are remembered; beyond it all are forgotten, and their fates begin anew.
pub const ATTEMPTS_MAX: usize = 1 << 18;

/// What a fate is drawn for.
#[derive(Clone, Copy)]
enum Draw {
    Error = 1,
    Corruption,
    Spike,
}

/// A part by where it ends: file, offset of its end. Pages do not overlap, so no two end at the same place.
type Part = (u32, u64);

pub struct Fates {
    faults: Faults,
    seed: u64,
    attempts: HashMap<Part, u32>,
}

/// What will happen to a request.
pub struct Fate {
    /// By part.
    pub outcomes: Vec<PartOutcome>,
    /// By how much it is late, seconds.
    pub delay_secs: f64,
}

impl Fates {
    pub fn new(faults: Faults, seed: u64) -> Self {
        Self { faults, seed, attempts: HashMap::new() }
    }

    /// Draws for a request whose turn it is; this is an attempt, even if it is cancelled afterwards.
    pub fn draw(&mut self, request: &Request) -> Fate {
        let parts = request.parts.iter().map(|end| (request.file, request.offset.saturating_add(*end)));
        let attempts: Vec<(Part, u32)> = parts.map(|part| (part, self.attempt(part))).collect();
        let is_late =
            attempts.last().is_some_and(|&(part, attempt)| self.hits(self.faults.spikes, Draw::Spike, part, attempt));
        Fate {
            outcomes: attempts.iter().map(|&(part, attempt)| self.outcome(part, attempt)).collect(),
            delay_secs: if is_late { self.faults.spike_secs } else { 0.0 },
        }
    }

    fn outcome(&self, part: Part, attempt: u32) -> PartOutcome {
        if self.hits(self.faults.errors, Draw::Error, part, attempt) {
            PartOutcome::Failed
        } else if self.hits(self.faults.corrupt, Draw::Corruption, part, 0) {
            PartOutcome::Corrupt
        } else {
            PartOutcome::Ok
        }
    }

    /// How often a part was tried before; counts this one.
    fn attempt(&mut self, part: Part) -> u32 {
        if self.faults.errors == 0.0 && self.faults.spikes == 0.0 {
            return 0;
        }
        if self.attempts.len() >= ATTEMPTS_MAX && !self.attempts.contains_key(&part) {
            self.attempts.clear();
        }
        let attempts = self.attempts.entry(part).or_insert(0);
        *attempts = attempts.wrapping_add(1);
        attempts.wrapping_sub(1)
    }

    fn hits(&self, share: f64, draw: Draw, (file, end): Part, attempt: u32) -> bool {
        if share == 0.0 {
            return false;
        }
        let mut what = [0; 17];
        what[..4].copy_from_slice(&file.to_le_bytes());
        what[4..12].copy_from_slice(&end.to_le_bytes());
        what[12..16].copy_from_slice(&attempt.to_le_bytes());
        what[16] = draw as u8;
        // The upper 53 bits as a number from 0 to below 1.
        let drawn = (xxh3_64_with_seed(&what, self.seed) >> 11) as f64 / (1u64 << 53) as f64;
        drawn < share
    }
}
