//! What goes wrong: `errors=0.01,corrupt=0.001,spike_ms=2000,spikes=0.01,die_s=12,revive_s=15,halve_s=10`.

use std::ops::RangeInclusive;
use std::str::FromStr;

/// Faults to be made; none by default. Whom they hit follows from a seed ([`Disk`](super::Disk)).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Faults {
    /// `errors`: share of the parts whose reading fails, drawn anew for each attempt; 0 to 1.
    pub errors: f64,
    /// `corrupt`: share of the parts that are stored wrong, for good; 0 to 1.
    pub corrupt: f64,
    /// `spikes`: share of the requests that are late by [`spike_secs`](Self::spike_secs), drawn anew for each attempt;
    /// 0 to 1.
    pub spikes: f64,
    /// `spike_ms` in milliseconds, 0 to 600,000; here in seconds. Without `spikes` it hits [`SPIKES_DEFAULT`].
    pub spike_secs: f64,
    /// `die_s`: when the server dies, seconds; 0 to 10⁶.
    pub die_s: Option<f64>,
    /// `revive_s`: when it is there again, seconds; after `die_s`. Without it, never.
    pub revive_s: Option<f64>,
    /// `halve_s`: from when on the bandwidth is half, seconds; 0 to 10⁶.
    pub halve_s: Option<f64>,
}

/// Share of the requests that a spike hits where only `spike_ms` is given.
pub const SPIKES_DEFAULT: f64 = 0.01;

/// How long a request to a dead server, or cut off by its death, hangs before its parts fail.
pub const DEAD_TIMEOUT_SECS: f64 = 2.0;

const SHARE: RangeInclusive<f64> = 0.0..=1.0;
const SPIKE_MS: RangeInclusive<f64> = 0.0..=600_000.0;
const TIME_S: RangeInclusive<f64> = 0.0..=1e6;

#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FaultsError {
    #[error(
        "there is no fault {0:?}: write errors=SHARE, corrupt=SHARE, spike_ms=MS, spikes=SHARE, die_s=S, revive_s=S, \
         halve_s=S with commas between them"
    )]
    Unknown(String),
    #[error("the fault {0} is given twice: write it once")]
    Twice(String),
    #[error("{text:?} is no value of the fault {key}: write a number from {} to {}", .range.start(), .range.end())]
    Value { key: String, text: String, range: RangeInclusive<f64> },
    #[error("spikes says how many requests are late: write spike_ms=MS too, by how much")]
    SpikeWithoutLength,
    #[error("a server revives after it died: write revive_s with an earlier die_s")]
    ReviveBeforeDeath,
}

impl Faults {
    /// Nothing goes wrong.
    pub const NONE: Self =
        Self { errors: 0.0, corrupt: 0.0, spikes: 0.0, spike_secs: 0.0, die_s: None, revive_s: None, halve_s: None };

    /// Whether the server is dead at a time.
    pub fn is_dead(&self, at_s: f64) -> bool {
        self.die_s.is_some_and(|die_s| at_s >= die_s) && self.revive_s.is_none_or(|revive_s| at_s < revive_s)
    }

    /// What a time leaves of the bandwidth, as a share.
    pub(super) fn bandwidth_share(&self, at_s: f64) -> f64 {
        if self.halve_s.is_some_and(|halve_s| at_s >= halve_s) { 0.5 } else { 1.0 }
    }

    /// The next time after `at_s` at which transfers change by themselves.
    pub(super) fn next_change_s(&self, at_s: f64) -> Option<f64> {
        [self.die_s, self.halve_s].into_iter().flatten().filter(|&change_s| change_s > at_s).min_by(f64::total_cmp)
    }

    fn set(&mut self, key: &str, text: &str) -> Result<(), FaultsError> {
        let value = |range: RangeInclusive<f64>| match text.parse::<f64>() {
            Ok(value) if range.contains(&value) => Ok(value),
            _ => Err(FaultsError::Value { key: key.to_owned(), text: text.to_owned(), range }),
        };
        match key {
            "errors" => self.errors = value(SHARE)?,
            "corrupt" => self.corrupt = value(SHARE)?,
            "spikes" => self.spikes = value(SHARE)?,
            "spike_ms" => self.spike_secs = value(SPIKE_MS)? / 1000.0,
            "die_s" => self.die_s = Some(value(TIME_S)?),
            "revive_s" => self.revive_s = Some(value(TIME_S)?),
            "halve_s" => self.halve_s = Some(value(TIME_S)?),
            _ => return Err(FaultsError::Unknown(key.to_owned())),
        }
        Ok(())
    }

    fn checked(mut self, given: &[&str]) -> Result<Self, FaultsError> {
        match (given.contains(&"spike_ms"), given.contains(&"spikes")) {
            (true, false) => self.spikes = SPIKES_DEFAULT,
            (false, true) => return Err(FaultsError::SpikeWithoutLength),
            _ => {}
        }
        if self.revive_s.is_some_and(|revive_s| self.die_s.is_none_or(|die_s| revive_s <= die_s)) {
            return Err(FaultsError::ReviveBeforeDeath);
        }
        Ok(self)
    }
}

impl FromStr for Faults {
    type Err = FaultsError;

    /// `KEY=VALUE,…`, each key at most once; an empty text is no fault at all.
    ///
    /// ```
    /// # use stoop::storage::Faults;
    /// let faults: Faults = "errors=0.01,spike_ms=2000".parse()?;
    /// assert_eq!((faults.errors, faults.spikes, faults.spike_secs), (0.01, 0.01, 2.0));
    /// # Ok::<(), stoop::storage::FaultsError>(())
    /// ```
    fn from_str(text: &str) -> Result<Self, FaultsError> {
        let (mut faults, mut given) = (Self::NONE, Vec::new());
        for fault in text.split(',').map(str::trim).filter(|fault| !fault.is_empty()) {
            let (key, value) = fault.split_once('=').unwrap_or((fault, ""));
            let key = key.trim();
            faults.set(key, value.trim())?;
            if given.contains(&key) {
                return Err(FaultsError::Twice(key.to_owned()));
            }
            given.push(key);
        }
        faults.checked(&given)
    }
}
