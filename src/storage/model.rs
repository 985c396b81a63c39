//! Latency, bandwidth and parallel requests of a kind of storage.

use std::fmt;
use std::str::FromStr;

/// A storage model. The bandwidth is shared by all requests that are transferred at the same time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StorageModel {
    pub name: &'static str,
    /// From a request's turn to its first byte, seconds; 0 to 60.
    pub latency_secs: f64,
    /// 1 kB/s to 1 TB/s.
    pub bytes_per_sec: f64,
    /// Requests served at the same time, 1 to [`PARALLEL_MAX`].
    pub parallel: usize,
    /// Whether the latency is paid only where a range does not start where the last one ended; else each request pays.
    pub seek_only: bool,
}

/// Most requests that a model may serve at the same time.
pub const PARALLEL_MAX: usize = 256;

const MS_PER_SEC: f64 = 1e3;
const BYTES_PER_MB: f64 = 1e6;
/// Of models given by numbers.
const CUSTOM: &str = "custom";
const LATENCY_MS: std::ops::RangeInclusive<f64> = 0.0..=60_000.0;
const MB_PER_SEC: std::ops::RangeInclusive<f64> = 0.001..=1e6;

impl StorageModel {
    pub const HDD: Self = Self { seek_only: true, ..Self::of("hdd", 10.0, 120.0, 1) };
    pub const SSD: Self = Self::of("ssd", 0.1, 500.0, 8);
    pub const LAN: Self = Self::of("lan", 2.0, 100.0, 6);
    pub const WAN: Self = Self::of("wan", 60.0, 5.0, 6);
    pub const MOBILE: Self = Self::of("mobile", 150.0, 1.0, 4);
    /// Those that have a name to be asked for.
    pub const ALL: [Self; 5] = [Self::HDD, Self::SSD, Self::LAN, Self::WAN, Self::MOBILE];
    /// So fast that the storage below alone is felt: for faults over a real disk.
    pub const DIRECT: Self = Self::of("direct", 0.0, 1e6, PARALLEL_MAX);

    const fn of(name: &'static str, latency_ms: f64, mb_per_sec: f64, parallel: usize) -> Self {
        Self {
            name,
            latency_secs: latency_ms / MS_PER_SEC,
            bytes_per_sec: mb_per_sec * BYTES_PER_MB,
            parallel,
            seek_only: false,
        }
    }

    fn custom(text: &str) -> Option<Self> {
        let fields: Vec<&str> = text.split(',').map(str::trim).collect();
        let [latency_ms, mb_per_sec, parallel] = fields[..] else { return None };
        let within = |digits: &str, range| digits.parse().ok().filter(|number| RangeOf::contains(range, number));
        let parallel = parallel.parse().ok().filter(|count| (1..=PARALLEL_MAX).contains(count))?;
        Some(Self::of(CUSTOM, within(latency_ms, &LATENCY_MS)?, within(mb_per_sec, &MB_PER_SEC)?, parallel))
    }
}

/// How a model is best read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReadLimits {
    /// Ranges under way at once.
    pub in_flight: usize,
    /// Bytes under way at once.
    pub bytes_in_flight: u64,
    /// Length up to which pages that lie together are read at once, bytes: about what a request's latency costs.
    pub run_bytes: u32,
    /// Unwanted bytes that are read over, since another request costs more.
    pub gap_bytes: u32,
}

/// Ranges under way at most, whatever the model.
const IN_FLIGHT_MAX: f64 = 1024.0;
const RUN_BYTES: std::ops::RangeInclusive<f64> = 32768.0..=1048576.0;
/// A range takes no longer than this share of a latency, the bandwidth for itself.
const RUN_SHARE: f64 = 0.5;
/// A gap is read over where that takes no longer than this share of a latency.
const GAP_SHARE: f64 = 0.25;

impl StorageModel {
    /// For requests that are made every `step_s` seconds: enough under way that no place stays empty in between.
    pub fn reads(&self, step_s: f64) -> ReadLimits {
        let turns = if self.latency_secs > 0.0 { (step_s / self.latency_secs).ceil() } else { IN_FLIGHT_MAX };
        let latency_bytes = self.latency_secs * self.bytes_per_sec;
        ReadLimits {
            in_flight: (self.parallel as f64 * (1.0 + turns)).min(IN_FLIGHT_MAX) as usize,
            bytes_in_flight: (self.bytes_per_sec * (self.latency_secs + step_s)).max(1.0) as u64,
            run_bytes: (RUN_SHARE * latency_bytes).clamp(*RUN_BYTES.start(), *RUN_BYTES.end()) as u32,
            gap_bytes: (GAP_SHARE * latency_bytes / self.parallel as f64).min(*RUN_BYTES.end()) as u32,
        }
    }
}

type RangeOf = std::ops::RangeInclusive<f64>;

#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "{0:?} is no storage model: name hdd, ssd, lan, wan or mobile, or write LATENCY_MS,MB_PER_S,PARALLEL such as \
     20,50,4 (latency 0 to 60000 ms, bandwidth 0.001 to 1000000 MB/s, 1 to {PARALLEL_MAX} parallel requests)"
)]
pub struct StorageModelError(String);

impl FromStr for StorageModel {
    type Err = StorageModelError;

    /// A name, or `LATENCY_MS,MB_PER_S,PARALLEL` with MB = 10⁶ bytes, where each request pays the latency.
    ///
    /// ```
    /// # use stoop::storage::StorageModel;
    /// assert_eq!("wan".parse(), Ok(StorageModel::WAN));
    /// let model: StorageModel = "20,50,4".parse()?;
    /// assert_eq!((model.latency_secs, model.bytes_per_sec, model.parallel), (0.02, 5e7, 4));
    /// # Ok::<(), stoop::storage::StorageModelError>(())
    /// ```
    fn from_str(text: &str) -> Result<Self, StorageModelError> {
        let named = Self::ALL.into_iter().find(|model| model.name == text.trim());
        named.or_else(|| Self::custom(text)).ok_or_else(|| StorageModelError(text.to_owned()))
    }
}

impl fmt::Display for StorageModel {
    /// The name, or the three numbers; both can be read again.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.name != CUSTOM {
            return f.write_str(self.name);
        }
        let (latency_ms, mb_per_sec) = (self.latency_secs * MS_PER_SEC, self.bytes_per_sec / BYTES_PER_MB);
        write!(f, "{},{},{}", without_rounding(latency_ms), without_rounding(mb_per_sec), self.parallel)
    }
}

/// What was written before the change of units rounded it; to nine decimals.
fn without_rounding(number: f64) -> f64 {
    (number * 1e9).round() / 1e9
}
