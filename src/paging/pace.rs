//! How fast pages come, as measured: the lead time of prediction, and how much to read at once.

/// Share of a new value in a running mean.
const NEWS: f64 = 0.1;
/// Busy seconds over which the rate is taken.
const RATE_WINDOW_SECS: f64 = 1.0;
/// Before anything has come: a page takes so long, and so many bytes come in a second.
const FIRST_LATENCY_SECS: f64 = 0.05;
const FIRST_BYTES_PER_SEC: f64 = 20e6;

/// Running measures of the storage. Times are those that the request manager is told.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pace {
    mean_secs: f64,
    deviation_secs: f64,
    arrivals: u64,
    busy_since_secs: Option<f64>,
    bytes: f64,
    busy_secs: f64,
}

impl Default for Pace {
    fn default() -> Self {
        let (bytes, busy_secs) = (FIRST_BYTES_PER_SEC * RATE_WINDOW_SECS / 10.0, RATE_WINDOW_SECS / 10.0);
        Self {
            mean_secs: FIRST_LATENCY_SECS,
            deviation_secs: 0.0,
            arrivals: 0,
            busy_since_secs: None,
            bytes,
            busy_secs,
        }
    }
}

impl Pace {
    pub(super) fn note_start(&mut self, now_secs: f64) {
        self.busy_since_secs.get_or_insert(now_secs);
    }

    /// A page of `len` stored bytes came in `took_secs` after it was asked for.
    pub(super) fn note_arrival(&mut self, took_secs: f64, len: u32) {
        let took_secs = took_secs.max(0.0);
        // The first arrivals count in full: a mean of them, not of the guess before them.
        self.arrivals += 1;
        let share = NEWS.max(1.0 / self.arrivals as f64);
        self.deviation_secs += share * ((took_secs - self.mean_secs).abs() - self.deviation_secs);
        self.mean_secs += share * (took_secs - self.mean_secs);
        self.bytes += f64::from(len);
    }

    /// Something ended; `idle` when nothing is under way any more.
    pub(super) fn note_end(&mut self, now_secs: f64, idle: bool) {
        if let Some(since_secs) = self.busy_since_secs {
            self.busy_secs += (now_secs - since_secs).max(0.0);
            self.busy_since_secs = (!idle).then_some(now_secs);
        }
        if self.busy_secs > RATE_WINDOW_SECS {
            let kept = RATE_WINDOW_SECS / self.busy_secs;
            self.bytes *= kept;
            self.busy_secs *= kept;
        }
    }

    /// How long a page takes from its start to its arrival, most of the time: the mean and its mean deviation.
    pub fn lead_secs(&self) -> f64 {
        self.mean_secs + self.deviation_secs
    }

    /// Stored bytes that came per busy second.
    pub fn bytes_per_sec(&self) -> f64 {
        self.bytes / self.busy_secs.max(1e-9)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lead_time_and_rate_are_those_of_what_came() {
        let mut pace = Pace::default();
        for n in 0..400 {
            let start_secs = f64::from(n) * 0.1;
            pace.note_start(start_secs);
            pace.note_arrival(0.02, 20_000);
            pace.note_end(start_secs + 0.02, true);
        }
        assert!((pace.lead_secs() - 0.02).abs() < 1e-3, "{pace:?}");
        assert!((pace.bytes_per_sec() / 1e6 - 1.0).abs() < 0.05, "{pace:?}");
    }
}
