//! A request whose turn has come.

use super::{Arrival, BLOCK_BYTES, PartOutcome, Position, Request};

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Phase {
    /// Its first byte comes then.
    Latency { until_s: f64 },
    /// Bytes so far, at the time of the disk's last change.
    Transfer { done_bytes: f64 },
    /// The server is dead; the request gives up then.
    Hang { until_s: f64 },
}

/// A request in one of the places that the model serves at the same time.
#[derive(Debug)]
pub struct Service {
    request: Request,
    outcomes: Vec<PartOutcome>,
    /// The part that arrives next; all of them have when it has been cancelled.
    next_part: usize,
    /// Where the transfer ends, bytes from the start: behind the last part, or at a block's end when cancelled.
    stop_bytes: u64,
    pub phase: Phase,
}

impl Service {
    pub fn new(request: Request, outcomes: Vec<PartOutcome>, phase: Phase) -> Self {
        let stop_bytes = request.len_bytes();
        Self { request, outcomes, next_part: 0, stop_bytes, phase }
    }

    /// Whether parts of it will arrive.
    pub fn is_awaited(&self) -> bool {
        self.next_part < self.request.parts.len()
    }

    pub fn is(&self, id: u64) -> bool {
        self.request.id == id && self.is_awaited()
    }

    pub fn is_transferring(&self) -> bool {
        matches!(self.phase, Phase::Transfer { .. })
    }

    /// Bytes transferred, of those that count.
    pub fn done_bytes(&self) -> f64 {
        if let Phase::Transfer { done_bytes } = self.phase { done_bytes } else { 0.0 }
    }

    /// Where its range ends, as asked for.
    pub fn end(&self) -> Position {
        self.request.end()
    }

    /// When something happens to it by itself, for a transfer of `bytes_per_sec` that is described at `at_s`.
    pub fn due_s(&self, at_s: f64, bytes_per_sec: f64) -> f64 {
        match self.phase {
            Phase::Latency { until_s } | Phase::Hang { until_s } => until_s,
            Phase::Transfer { done_bytes } => at_s + (self.target_bytes() - done_bytes) / bytes_per_sec,
        }
    }

    /// Transfers from `at_s` on to `to_s`; what is due by then is there to the byte, whatever rounding says.
    pub fn transfer(&mut self, at_s: f64, to_s: f64, bytes_per_sec: f64) {
        let (target, due_s) = (self.target_bytes(), self.due_s(at_s, bytes_per_sec));
        if let Phase::Transfer { done_bytes } = &mut self.phase {
            let moved = (*done_bytes + (to_s - at_s) * bytes_per_sec).min(target);
            *done_bytes = if due_s <= to_s { target } else { moved };
        }
    }

    /// Goes on from what is due at `now_s`: parts arrive, or the first byte does. False when it is over.
    pub fn step(&mut self, now_s: f64, arrivals: &mut Vec<Arrival>) -> bool {
        match self.phase {
            Phase::Latency { until_s } if until_s <= now_s => self.phase = Phase::Transfer { done_bytes: 0.0 },
            Phase::Hang { until_s } if until_s <= now_s => {
                self.outcomes.fill(PartOutcome::Failed);
                self.arrive(self.request.len_bytes() as f64, now_s, arrivals);
                return false;
            }
            Phase::Transfer { done_bytes } => {
                self.arrive(done_bytes, now_s, arrivals);
                return done_bytes < self.stop_bytes as f64;
            }
            Phase::Latency { .. } | Phase::Hang { .. } => {}
        }
        true
    }

    /// Nothing of it will arrive any more. A transfer goes on to the end of its block, which `done_bytes` lie in; gives
    /// where it ends. Without a transfer it is over at once.
    pub fn cancel(&mut self, done_bytes: f64) -> Option<Position> {
        self.next_part = self.request.parts.len();
        if !self.is_transferring() {
            return None;
        }
        let blocks = (done_bytes / BLOCK_BYTES as f64).ceil() as u64;
        self.stop_bytes = self.stop_bytes.min(blocks * BLOCK_BYTES);
        Some(Position { file: self.request.file, offset: self.request.offset.saturating_add(self.stop_bytes) })
    }

    /// Where the transfer next means something: a part's end, or its own.
    fn target_bytes(&self) -> f64 {
        self.request.parts.get(self.next_part).copied().unwrap_or(self.stop_bytes) as f64
    }

    fn arrive(&mut self, done_bytes: f64, at_s: f64, arrivals: &mut Vec<Arrival>) {
        while self.is_awaited() && self.target_bytes() <= done_bytes {
            let (id, part) = (self.request.id, self.next_part);
            let outcome = self.outcomes.get(part).copied().unwrap_or(PartOutcome::Ok);
            arrivals.push(Arrival { id, part, at_s, outcome });
            self.next_part += 1;
        }
    }
}
