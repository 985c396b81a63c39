//! A reader that is as slow as one likes, and that hangs: for tests, and for seeing what a bad network does.

use super::{OneByOne, PageReader, PageRun, RangeRead, ReadError};
use crate::content::{Page, PageId};
use crate::forest::index::Place;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// A time in which nothing is read, counted from a start that its user names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stall {
    pub at: Duration,
    pub lasts: Duration,
}

/// Longest begin and length of a stall, seconds: a day.
const STALL_MAX_SECS: f64 = 86_400.0;

#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0:?} is no stall: write AT,FOR in seconds, each 0 to 86400, such as 5,2")]
pub struct StallError(String);

impl std::str::FromStr for Stall {
    type Err = StallError;

    /// `AT,FOR`, seconds.
    fn from_str(text: &str) -> Result<Self, StallError> {
        let secs = |digits: &str| {
            let secs = digits.trim().parse::<f64>().ok().filter(|secs| (0.0..=STALL_MAX_SECS).contains(secs))?;
            Some(Duration::from_secs_f64(secs))
        };
        let parts = text.split_once(',').and_then(|(at, lasts)| Some(Self { at: secs(at)?, lasts: secs(lasts)? }));
        parts.ok_or_else(|| StallError(text.to_owned()))
    }
}

/// What reads wait at: open, closed until someone opens it, or closed by a [`Stall`].
#[derive(Debug, Default)]
pub struct Gate {
    state: Mutex<GateState>,
    changed: Condvar,
}

#[derive(Debug, Default)]
struct GateState {
    is_closed: bool,
    /// From, until.
    stall: Option<(Instant, Instant)>,
    waiting: usize,
}

impl GateState {
    /// Why a read that may pass from `due` on has to wait now.
    fn hold(&self, due: Instant, now: Instant) -> Option<Hold> {
        if self.is_closed {
            return Some(Hold::UntilOpened);
        }
        let stalled = self.stall.filter(|(from, until)| (*from..*until).contains(&now)).map(|(_, until)| until);
        let until = stalled.into_iter().chain((due > now).then_some(due)).max()?;
        Some(Hold::For(until - now))
    }
}

enum Hold {
    UntilOpened,
    For(Duration),
}

impl Gate {
    /// All reads hang from now on.
    pub fn close(&self) {
        self.change(|state| state.is_closed = true);
    }

    /// All reads go on; a stall that was set is over.
    pub fn open(&self) {
        self.change(|state| (state.is_closed, state.stall) = (false, None));
    }

    /// All reads hang during `stall`, counted from now; it takes the place of an earlier one.
    pub fn stall(&self, stall: Stall) {
        let from = Instant::now() + stall.at;
        self.change(|state| state.stall = Some((from, from + stall.lasts)));
    }

    /// Reads that hang or wait for their time.
    pub fn waiting(&self) -> usize {
        self.lock().waiting
    }

    /// Returns when `latency` has gone by and the gate is open.
    fn pass(&self, latency: Duration) {
        let due = Instant::now() + latency;
        let mut state = self.lock();
        state.waiting += 1;
        while let Some(hold) = state.hold(due, Instant::now()) {
            state = match hold {
                Hold::UntilOpened => self.changed.wait(state).unwrap_or_else(PoisonError::into_inner),
                Hold::For(time) => self.changed.wait_timeout(state, time).unwrap_or_else(PoisonError::into_inner).0,
            };
        }
        state.waiting -= 1;
    }

    fn change(&self, change: impl FnOnce(&mut GateState)) {
        change(&mut self.lock());
        self.changed.notify_all();
    }

    /// The state stays meaningful whatever a holder of the lock did.
    fn lock(&self) -> MutexGuard<'_, GateState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Another reader's pages and runs, each after a latency and no sooner than a gate is open. Reads on several threads wait at the
/// same time.
pub struct SlowReader {
    inner: Arc<dyn PageReader>,
    latency: Duration,
    gate: Arc<Gate>,
}

impl SlowReader {
    pub fn new(inner: Arc<dyn PageReader>, latency: Duration, gate: Arc<Gate>) -> Self {
        Self { inner, latency, gate }
    }
}

impl PageReader for SlowReader {
    fn load(&self, page: PageId, place: Place) -> Result<Page, ReadError> {
        self.gate.pass(self.latency);
        self.inner.load(page, place)
    }

    fn read_run(&self, run: &RangeRead) -> Result<Option<Arc<dyn PageRun>>, ReadError> {
        self.gate.pass(self.latency);
        let read = self.inner.read_run(run)?;
        Ok(Some(read.unwrap_or_else(|| Arc::new(OneByOne(self.inner.clone())))))
    }

    fn is_remote(&self) -> bool {
        self.inner.is_remote()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stalls_are_read_and_nonsense_is_not() {
        let stall = |at, lasts| Stall { at: Duration::from_millis(at), lasts: Duration::from_millis(lasts) };
        assert_eq!("5,2".parse(), Ok(stall(5000, 2000)));
        assert_eq!(" 0 , 0.25 ".parse(), Ok(stall(0, 250)));
        for bad in ["", "5", "5,", ",2", "-1,2", "1,inf", "1,nan", "1,2,3", "0,90000", "a,b"] {
            assert!(bad.parse::<Stall>().is_err_and(|e| e.to_string().contains("AT,FOR")), "{bad}");
        }
    }

    #[test]
    fn a_hold_is_the_longest_of_its_reasons() {
        let start = Instant::now();
        let at = |secs: u64| start + Duration::from_secs(secs);
        let hold = |state: &GateState, due: u64, now: u64| match state.hold(at(due), at(now)) {
            None => "none".to_owned(),
            Some(Hold::UntilOpened) => "until opened".to_owned(),
            Some(Hold::For(time)) => format!("{} s", time.as_secs()),
        };
        let open = GateState::default();
        assert_eq!((hold(&open, 3, 3), hold(&open, 3, 1)), ("none".into(), "2 s".into()));
        let stalled = GateState { stall: Some((at(10), at(20))), ..GateState::default() };
        for (due, now, expected) in
            [(5, 9, "none"), (5, 10, "10 s"), (15, 12, "8 s"), (25, 12, "13 s"), (5, 20, "none"), (12, 9, "3 s")]
        {
            assert_eq!(hold(&stalled, due, now), expected, "due {due}, now {now}");
        }
        let closed = GateState { is_closed: true, ..stalled };
        assert_eq!(hold(&closed, 5, 30), "until opened");
    }
}
