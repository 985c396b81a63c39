//! Live runs held back to a storage model: pages come when the virtual disk has them, each exactly once, and faults are
//! told as what they are. The clock is the test's.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on should stop")]

mod made_up;

use made_up::page;
use proptest::prelude::*;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use stoop::content::{Page, PageFile, PageId, PageKind};
use stoop::engine::{PAGES_IN_FLIGHT_MAX, ThrottledServer};
use stoop::forest::index::Place;
use stoop::forest::{CellId, Zone};
use stoop::paging::{Delivery, InlineServer, Outcome, PageReader, PageServer, RangeRead, ReadError};
use stoop::storage::{Disk, Faults};

/// Bytes of every page: 10 ms at 1 MB/s.
const LEN: u32 = 10_000;

/// Counts what is really read.
#[derive(Default)]
struct Reader(AtomicUsize);

impl PageReader for Reader {
    fn load(&self, id: PageId, _place: Place) -> Result<Page, ReadError> {
        self.0.fetch_add(1, Ordering::Relaxed);
        Ok(page(id))
    }
}

struct Rig {
    server: ThrottledServer,
    reader: Arc<Reader>,
    now_ms: Arc<AtomicU64>,
}

impl Rig {
    /// 100 ms, 1 MB/s.
    fn new(parallel: usize, faults: &str) -> Self {
        let reader = Arc::new(Reader::default());
        let server = Box::new(InlineServer::new(reader.clone()));
        Self::over(server, reader, parallel, faults)
    }

    fn over(inner: Box<dyn PageServer>, reader: Arc<Reader>, parallel: usize, faults: &str) -> Self {
        let faults: Faults = faults.parse().unwrap();
        let now_ms = Arc::new(AtomicU64::new(0));
        let clock = now_ms.clone();
        let now_secs = Box::new(move || clock.load(Ordering::Relaxed) as f64 / 1000.0);
        let disk = Disk::new(format!("100,1,{parallel}").parse().unwrap(), faults, 0);
        Self { server: ThrottledServer::with_clock(inner, disk, now_secs), reader, now_ms }
    }

    /// What has come by a time, as page numbers and outcomes.
    fn at_ms(&mut self, now_ms: u64) -> Vec<(u32, &'static str)> {
        self.now_ms.store(now_ms, Ordering::Relaxed);
        std::iter::from_fn(|| self.server.poll()).map(|delivery| (number(delivery.page), told(&delivery))).collect()
    }
}

fn page_id(n: u32) -> PageId {
    PageId { cell: CellId::new(Zone::new(18).unwrap(), 10, n % 1024, n / 1024).unwrap(), kind: PageKind::Imagery }
}

fn number(page: PageId) -> u32 {
    (0..4096).find(|&n| page_id(n) == page).unwrap()
}

fn told(delivery: &Delivery) -> &'static str {
    match &delivery.outcome {
        Outcome::Loaded(loaded) if loaded.id() == delivery.page => "loaded",
        Outcome::Loaded(_) => "another page",
        Outcome::Failed(ReadError::Failed(_)) => "failed",
        Outcome::Failed(ReadError::Broken(_)) => "broken",
        Outcome::Cancelled => "cancelled",
    }
}

/// Pages that lie one behind the other.
fn range(pages: std::ops::Range<u32>) -> RangeRead {
    let place = |n: u32| Place::new(u64::from(n * LEN), LEN).unwrap();
    let (first, len) = (pages.start, (pages.end - pages.start) * LEN);
    RangeRead {
        id: u64::from(first),
        file: PageFile::Pack,
        zone: Zone::new(18).unwrap(),
        offset: place(first).offset,
        len,
        pages: pages.map(|n| (page_id(n), place(n))).collect(),
    }
}

#[test]
fn pages_come_one_by_one_when_the_disk_has_them() {
    let mut rig = Rig::new(1, "");
    assert!(rig.server.start(range(0..3)));
    assert!(rig.server.start(range(7..8)));
    assert_eq!((rig.at_ms(109), rig.server.in_flight()), (vec![], 4));
    assert_eq!(rig.at_ms(111), [(0, "loaded")]);
    assert_eq!(rig.at_ms(131), [(1, "loaded"), (2, "loaded")]);
    assert_eq!(rig.reader.0.load(Ordering::Relaxed), 3, "the fourth has not been read");
    // Its turn came at 130 ms, though nobody looked then.
    assert_eq!((rig.at_ms(241), rig.server.in_flight()), (vec![(7, "loaded")], 0));
}

#[test]
fn a_range_that_nobody_awaits_makes_place() {
    let mut rig = Rig::new(1, "");
    rig.server.start(range(0..50));
    rig.server.start(range(60..61));
    assert_eq!(rig.at_ms(111), [(0, "loaded")]);
    (1..49).for_each(|n| rig.server.cancel(page_id(n)));
    let cancelled: Vec<_> = (1..49).map(|n| (n, "cancelled")).collect();
    assert_eq!(rig.at_ms(112), cancelled, "told at once");
    // The last one is still awaited: the range goes on, until it is not.
    assert_eq!((rig.at_ms(150), rig.server.in_flight()), (vec![], 2));
    rig.server.cancel(page_id(49));
    assert_eq!(rig.at_ms(150), [(49, "cancelled")]);
    // The block ends at 165.536 ms, not the range at 600.
    assert_eq!((rig.at_ms(275), rig.at_ms(276)), (vec![], vec![(60, "loaded")]));
    assert_eq!((rig.server.in_flight(), rig.reader.0.load(Ordering::Relaxed)), (0, 2));
}

#[test]
fn faults_are_told_and_nothing_is_read_for_them() {
    for (faults, outcome) in [("errors=1", "failed"), ("corrupt=1", "broken"), ("die_s=0", "failed")] {
        let mut rig = Rig::new(1, faults);
        rig.server.start(range(0..2));
        assert_eq!(rig.at_ms(5000), [(0, outcome), (1, outcome)], "{faults}");
        assert_eq!((rig.server.in_flight(), rig.reader.0.load(Ordering::Relaxed)), (0, 0));
    }
}

/// Takes one page at a time.
struct Narrow {
    inner: InlineServer,
    cancelled: Arc<Mutex<Vec<PageId>>>,
}

impl PageServer for Narrow {
    fn start(&mut self, read: RangeRead) -> bool {
        self.inner.in_flight() == 0 && self.inner.start(read)
    }

    fn cancel(&mut self, page: PageId) {
        self.cancelled.lock().unwrap().push(page);
        self.inner.cancel(page);
    }

    fn poll(&mut self) -> Option<Delivery> {
        self.inner.poll()
    }

    fn in_flight(&self) -> usize {
        self.inner.in_flight()
    }
}

#[test]
fn pages_wait_for_a_server_that_is_full_and_can_be_cancelled_there() {
    let (reader, cancelled) = (Arc::new(Reader::default()), Arc::new(Mutex::new(Vec::new())));
    let narrow = Narrow { inner: InlineServer::new(reader.clone()), cancelled: cancelled.clone() };
    let mut rig = Rig::over(Box::new(narrow), reader, 1, "");
    rig.server.start(range(0..4));
    rig.now_ms.store(1000, Ordering::Relaxed);
    let first = rig.server.poll().unwrap();
    assert_eq!((number(first.page), rig.server.in_flight()), (0, 3));
    // All have arrived, and none is at the narrow server: it hears of nothing.
    rig.server.cancel(page_id(2));
    rig.server.cancel(page_id(2));
    assert_eq!(rig.at_ms(1000), [(2, "cancelled"), (1, "loaded"), (3, "loaded")]);
    assert!(cancelled.lock().unwrap().is_empty());
    assert_eq!(rig.server.in_flight(), 0);
}

#[test]
fn more_pages_than_may_be_under_way_are_refused() {
    let mut rig = Rig::new(1, "");
    let most = PAGES_IN_FLIGHT_MAX as u32;
    for first in (0..most).step_by(64) {
        assert!(rig.server.start(range(first..first + 64)));
    }
    assert!(!rig.server.start(range(most..most + 1)));
    assert_eq!(rig.server.in_flight(), PAGES_IN_FLIGHT_MAX);
    assert_eq!(rig.at_ms(1_000_000).len(), PAGES_IN_FLIGHT_MAX);
    assert!(rig.server.start(range(most..most + 1)), "there is room again");
}

fn some_faults() -> impl Strategy<Value = &'static str> {
    prop::sample::select(vec!["", "errors=0.2,corrupt=0.1", "die_s=0.5,revive_s=1", "spike_ms=200,spikes=0.3"])
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn each_started_page_is_delivered_once(
        ranges in prop::collection::vec((1u32..20, 0u64..400), 1..20),
        cancels in prop::collection::vec((0u32..300, 0u64..2000), 0..60),
        faults in some_faults(),
        parallel in 1usize..5,
    ) {
        let mut rig = Rig::new(parallel, faults);
        let (mut now_ms, mut next, mut started) = (0, 0, 0u32);
        let mut found: BTreeMap<u32, &str> = BTreeMap::new();
        let mut cancels = cancels.into_iter().map(|(page, at_ms)| (at_ms, page)).collect::<Vec<_>>();
        cancels.sort_unstable();
        let mut cancels = cancels.into_iter().peekable();
        for (len, wait_ms) in ranges {
            now_ms += wait_ms;
            while let Some((at_ms, page)) = cancels.next_if(|(at_ms, _)| *at_ms <= now_ms) {
                rig.now_ms.store(at_ms, Ordering::Relaxed);
                rig.server.cancel(page_id(page));
            }
            for (page, outcome) in rig.at_ms(now_ms) {
                prop_assert!(page < next && found.insert(page, outcome).is_none());
            }
            prop_assert!(rig.server.start(range(next..next + len)));
            (next, started) = (next + len, started + len);
            prop_assert_eq!(rig.server.in_flight() + found.len(), started as usize);
        }
        for (page, outcome) in rig.at_ms(1_000_000) {
            prop_assert!(found.insert(page, outcome).is_none());
        }
        prop_assert_eq!((found.len(), rig.server.in_flight()), (started as usize, 0));
        let loaded = found.values().filter(|outcome| **outcome == "loaded").count();
        prop_assert_eq!(rig.reader.0.load(Ordering::Relaxed), loaded);
        prop_assert!(!faults.is_empty() || found.values().all(|outcome| ["loaded", "cancelled"].contains(outcome)));
    }
}
