//! The laws of the request manager over random demands, and of the servers.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on should stop")]

mod made_up;

use made_up::{dive_world, outcome, page};
use proptest::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};
use stoop::content::{Page, PageId, PageKind};
use stoop::forest::index::Place;
use stoop::forest::{CellId, Zone};
use stoop::paging::{
    Command, Completion, Delivery, Event, Gate, InlineServer, Limits, ManagerError, PageCounts, PageReader, PageServer,
    PageState, RangeRead, ReadError, RequestManager, ServerLimits, SlowReader, Stall, ThreadedServers,
    least_footprint_bytes,
};
use stoop::select::{Demand, Urgency};

const MIB: u64 = 1 << 20;
/// Each page by itself.
const LIMITS: Limits = Limits {
    footprint_bytes: 64 * MIB,
    in_flight: 3,
    pages_in_flight: 1000,
    bytes_in_flight: u64::MAX,
    read_bytes_per_update: MIB,
    run_bytes: 0,
    gap_bytes: 0,
};

fn page_id(n: u32) -> PageId {
    let cell = CellId::new(Zone::new(18).unwrap(), 10, n % 1024, n / 1024).unwrap();
    let kind = match n % 3 {
        0 => PageKind::Terrain,
        1 => PageKind::Imagery,
        _ => PageKind::Objects { collection: 0, rep: 0 },
    };
    PageId { cell, kind }
}

fn demand(n: u32, urgency: Urgency, gain: f64) -> Demand {
    Demand { page: page_id(n), place: Place::new(u64::from(n) << 16, 1000 + n % 7 * 900).unwrap(), urgency, gain }
}

/// What a page takes once it is loaded; never above the manager's estimate.
fn held_bytes(page: PageId, place: Place) -> u64 {
    match page.kind {
        PageKind::Terrain => 20_000 + u64::from(place.len),
        PageKind::Imagery => 700_000,
        PageKind::Objects { .. } => u64::from(place.len) * 20,
        PageKind::Segment => u64::from(place.len),
    }
}

/// Storage that takes its time: started pages are answered later, in any order.
fn end(place: Place) -> u64 {
    place.offset + u64::from(place.len)
}

struct Simulation {
    manager: RequestManager,
    limits: Limits,
    under_way: Vec<(PageId, Place, bool)>,
    resident: BTreeMap<PageId, u64>,
    /// The update in which a resident page left the demands; those that are demanded are not here.
    left: BTreeMap<PageId, u64>,
    updates: u64,
    wanted: BTreeSet<PageId>,
    broken: BTreeSet<PageId>,
    log: Vec<String>,
    now_secs: f64,
}

impl Simulation {
    fn new(limits: Limits) -> Self {
        Self {
            manager: RequestManager::new(limits).unwrap(),
            limits,
            under_way: Vec::new(),
            resident: BTreeMap::new(),
            left: BTreeMap::new(),
            updates: 0,
            wanted: BTreeSet::new(),
            broken: BTreeSet::new(),
            log: Vec::new(),
            now_secs: 0.0,
        }
    }

    fn update(&mut self, demands: &[Demand]) -> Vec<Command> {
        self.now_secs += 0.1;
        let commands = self.manager.update(demands, self.now_secs);
        self.note_left(demands);
        for command in &commands {
            self.log.push(format!("{command:?}"));
            match *command {
                Command::Start(ref read) => {
                    assert!(read.pages.windows(2).all(|pair| end(pair[0].1) <= pair[1].1.offset), "pages in a row");
                    assert_eq!(read.offset, read.pages[0].1.offset);
                    assert_eq!(read.offset + u64::from(read.len), end(read.pages[read.pages.len() - 1].1));
                    for &(page, place) in &read.pages {
                        assert!(!self.resident.contains_key(&page), "a resident page is read again");
                        assert!(self.under_way.iter().all(|started| started.0 != page), "a page is started twice");
                        assert!(demands.iter().any(|demand| demand.page == page), "nobody wants the page");
                        self.under_way.push((page, place, false));
                    }
                }
                Command::Cancel(page) => {
                    assert!(demands.iter().all(|demand| demand.page != page), "a wanted page is cancelled");
                    self.under_way.iter_mut().filter(|started| started.0 == page).for_each(|started| started.2 = true);
                }
                Command::Evict(page) => {
                    let wanted = demands.iter().find(|demand| demand.page == page);
                    assert!(wanted.is_none_or(|demand| demand.urgency == Urgency::Predicted), "the front is dropped");
                    self.check_order(page, wanted, demands);
                    self.left.remove(&page);
                    assert!(self.resident.remove(&page).is_some(), "what is not there is dropped");
                }
            }
        }
        self.check();
        commands
    }

    fn note_left(&mut self, demands: &[Demand]) {
        self.updates += 1;
        self.wanted = demands.iter().map(|demand| demand.page).collect();
        self.left.retain(|page, _| !self.wanted.contains(page));
        for page in self.resident.keys().filter(|page| !self.wanted.contains(page)) {
            self.left.entry(*page).or_insert(self.updates);
        }
    }

    /// Rest before predicted before front; of the rest what left the demands first, of what is predicted the least gain.
    fn check_order(&self, dropped: PageId, wanted: Option<&Demand>, demands: &[Demand]) {
        let Some(wanted) = wanted else {
            let first = self.left.iter().map(|(page, update)| (*update, *page)).min();
            assert_eq!(Some(dropped), first.map(|(_, page)| page), "what is longest unused goes first");
            return;
        };
        assert!(self.left.is_empty(), "what is predicted is dropped before {:?}", self.left);
        let predicted = demands.iter().filter(|demand| demand.urgency == Urgency::Predicted);
        let stays = predicted.filter(|demand| self.resident.contains_key(&demand.page));
        for other in stays {
            assert!(other.gain >= wanted.gain, "{other:?} stays and {wanted:?} goes");
        }
    }

    /// Answers one request; `fate` chooses which, and how.
    fn answer(&mut self, fate: u32) {
        if self.under_way.is_empty() {
            return;
        }
        let (page, place, cancelled) = self.under_way.remove(fate as usize % self.under_way.len());
        let completion = match fate / 7 % 16 {
            0 => Completion::Failed,
            1 => Completion::Broken,
            2..=8 if cancelled => Completion::Cancelled,
            _ => Completion::Loaded { bytes: held_bytes(page, place) },
        };
        if let Completion::Loaded { bytes } = completion {
            self.resident.insert(page, bytes);
            if !self.wanted.contains(&page) {
                self.left.insert(page, self.updates);
            }
        }
        if completion == Completion::Broken {
            self.broken.insert(page);
        }
        self.manager.complete(Event { page, completion }, self.now_secs);
        self.check();
    }

    fn check(&self) {
        let stats = self.manager.stats();
        assert_eq!(stats.resident_bytes, self.resident.values().sum::<u64>());
        assert_eq!(stats.resident_pages, self.resident.len() as u64);
        assert_eq!(stats.in_flight, self.under_way.len() as u64);
        assert!(self.under_way.len() <= self.limits.in_flight);
        assert!(self.manager.footprint_bytes() <= self.limits.footprint_bytes);
        self.check_states();
    }

    fn check_states(&self) {
        let all: Vec<PageState> = (0..90).map(|n| self.manager.state(page_id(n))).collect();
        for (n, state) in all.iter().enumerate() {
            let page = page_id(n as u32);
            assert_eq!(*state == PageState::Resident, self.resident.contains_key(&page));
            assert_eq!(*state == PageState::Requested, self.under_way.iter().any(|started| started.0 == page));
        }
        let counts = self.manager.page_counts();
        let layers = [counts.terrain, counts.imagery, counts.objects];
        for (first, layer) in layers.into_iter().enumerate() {
            let count = |state| all.iter().skip(first).step_by(3).filter(|s| **s == state).count() as u64;
            let states = [PageState::Resident, PageState::Requested, PageState::Failed].map(count);
            assert_eq!([layer.resident, layer.requested, layer.failed], states);
        }
        let total = counts.total();
        assert_eq!(total.resident, self.resident.len() as u64);
        assert_eq!(total.requested, self.under_way.len() as u64);
        let since = self.manager.awaited_since_secs();
        assert!(since.is_none_or(|since| total.missing > 0 && since <= self.now_secs), "{since:?}");
    }
}

fn any_frame() -> impl Strategy<Value = (Vec<Demand>, Vec<u32>)> {
    let urgency = prop_oneof![Just(Urgency::Predicted), Just(Urgency::Visible), Just(Urgency::Blocking)];
    let wish = (0u32..60, urgency, 0.0f64..10.0).prop_map(|(n, urgency, gain)| demand(n, urgency, gain));
    (prop::collection::vec(wish, 0..40), prop::collection::vec(any::<u32>(), 0..12))
}

fn run(limits: Limits, frames: &[(Vec<Demand>, Vec<u32>)]) -> Vec<String> {
    let mut simulation = Simulation::new(limits);
    for (demands, fates) in frames {
        // The same page may be wished for at two ranks; the test's checks look at the highest.
        let mut highest: BTreeMap<PageId, Demand> = BTreeMap::new();
        for demand in demands {
            let known = highest.entry(demand.page).or_insert(*demand);
            if (demand.urgency, demand.gain) > (known.urgency, known.gain) {
                *known = *demand;
            }
        }
        let unique: Vec<Demand> = highest.into_values().collect();
        simulation.update(&unique);
        fates.iter().for_each(|&fate| simulation.answer(fate));
    }
    simulation.log
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn no_limit_is_passed_and_the_front_is_never_dropped(
        frames in prop::collection::vec(any_frame(), 1..40), mib in 3u64..30, in_flight in 1usize..9
    ) {
        let limits = Limits { footprint_bytes: mib * MIB, in_flight, read_bytes_per_update: 20_000, ..LIMITS };
        let log = run(limits, &frames);
        prop_assert_eq!(log, run(limits, &frames), "the same input gives the same commands");
    }

    #[test]
    fn whatever_came_before_a_front_that_fits_comes_in(
        frames in prop::collection::vec(any_frame(), 0..20), wanted in prop::collection::btree_set(0u32..60, 1..12)
    ) {
        let limits = Limits { footprint_bytes: 24 * MIB, in_flight: 4, read_bytes_per_update: 3_000, ..LIMITS };
        let mut simulation = Simulation::new(limits);
        for (demands, fates) in &frames {
            let mut seen = BTreeSet::new();
            let unique: Vec<Demand> = demands.iter().filter(|demand| seen.insert(demand.page)).copied().collect();
            simulation.update(&unique);
            fates.iter().for_each(|&fate| simulation.answer(fate));
        }
        let front: Vec<Demand> = wanted.iter().map(|&n| demand(n, Urgency::Visible, f64::from(n))).collect();
        for _ in 0..200 {
            simulation.update(&front);
            // Everything is answered in time, and well.
            while !simulation.under_way.is_empty() {
                simulation.answer(7 * 9);
            }
            simulation.now_secs += 1.0;
        }
        prop_assert!(simulation.manager.is_idle());
        for demand in &front {
            let there = simulation.resident.contains_key(&demand.page);
            prop_assert_ne!(there, simulation.broken.contains(&demand.page), "all but the broken pages come in");
        }
    }
}

#[test]
fn the_more_urgent_and_the_more_gainful_come_first() {
    let limits = Limits { footprint_bytes: 64 * MIB, in_flight: 3, read_bytes_per_update: MIB, ..LIMITS };
    let mut manager = RequestManager::new(limits).unwrap();
    let demands = [
        demand(1, Urgency::Predicted, 9.0),
        demand(2, Urgency::Visible, 1.0),
        demand(3, Urgency::Visible, 5.0),
        demand(4, Urgency::Blocking, 0.0),
    ];
    let started: Vec<PageId> = manager
        .update(&demands, 0.0)
        .into_iter()
        .map(|command| match command {
            Command::Start(read) => read.pages[0].0,
            other => panic!("{other:?}"),
        })
        .collect();
    assert_eq!(started, [page_id(4), page_id(3), page_id(2)]);
}

#[test]
fn what_is_no_longer_wanted_is_cancelled_once() {
    let limits = Limits { footprint_bytes: 64 * MIB, in_flight: 3, read_bytes_per_update: MIB, ..LIMITS };
    let mut manager = RequestManager::new(limits).unwrap();
    manager.update(&[demand(1, Urgency::Visible, 1.0)], 0.0);
    assert_eq!(manager.update(&[], 0.1), [Command::Cancel(page_id(1))]);
    assert_eq!(manager.update(&[], 0.2), []);
    assert!(!manager.is_idle());
    manager.complete(Event { page: page_id(1), completion: Completion::Cancelled }, 0.3);
    assert!(manager.is_idle() && manager.footprint_bytes() == 0);
    assert_eq!(manager.update(&[demand(1, Urgency::Visible, 1.0)], 0.4).len(), 1);
}

#[test]
fn failed_pages_are_tried_again_later_and_broken_ones_never() {
    let limits = Limits { footprint_bytes: 64 * MIB, in_flight: 3, read_bytes_per_update: MIB, ..LIMITS };
    let mut manager = RequestManager::new(limits).unwrap();
    let wish = [demand(1, Urgency::Visible, 1.0)];
    let (mut now_secs, mut waits) = (0.0, Vec::new());
    for _ in 0..5 {
        let failed_at = now_secs;
        while manager.update(&wish, now_secs).is_empty() {
            now_secs += 0.05;
        }
        waits.push(now_secs - failed_at);
        manager.complete(Event { page: page_id(1), completion: Completion::Failed }, now_secs);
    }
    assert!(waits.windows(2).skip(1).all(|pair| pair[1] > 1.5 * pair[0]), "{waits:?}");
    assert!(manager.is_idle(), "a page that failed often is not waited for");
    now_secs += 100.0;
    assert_eq!(manager.update(&wish, now_secs).len(), 1);
    manager.complete(Event { page: page_id(1), completion: Completion::Broken }, now_secs);
    assert_eq!(manager.update(&wish, now_secs + 1e6), []);
    assert_eq!(manager.stats().failed, 6);
    assert!(manager.is_idle());
}

#[test]
fn pages_have_a_state_and_are_counted_by_layer() {
    let limits = Limits { footprint_bytes: 64 * MIB, in_flight: 3, read_bytes_per_update: MIB, ..LIMITS };
    let mut manager = RequestManager::new(limits).unwrap();
    // Two of each layer; the last three wait for their turn.
    let wishes: Vec<Demand> = (0..6).map(|n| demand(n, Urgency::Visible, 10.0 - f64::from(n))).collect();
    manager.update(&wishes, 0.0);
    let complete = |manager: &mut RequestManager, n, completion| {
        manager.complete(Event { page: page_id(n), completion }, 1.0);
    };
    complete(&mut manager, 0, Completion::Loaded { bytes: 1000 });
    complete(&mut manager, 1, Completion::Broken);
    complete(&mut manager, 2, Completion::Failed);
    let states: Vec<PageState> = (0..7).map(|n| manager.state(page_id(n))).collect();
    use PageState::{Absent, Failed, Requested, Resident};
    assert_eq!(states, [Resident, Failed, Failed, Absent, Absent, Absent, Absent]);
    let counts = manager.page_counts();
    assert_eq!(counts.terrain, PageCounts { resident: 1, requested: 0, failed: 0, missing: 1 });
    assert_eq!(counts.imagery, PageCounts { resident: 0, requested: 0, failed: 1, missing: 1 });
    // What failed once is still to come.
    assert_eq!(counts.objects, PageCounts { resident: 0, requested: 0, failed: 1, missing: 2 });
    manager.update(&wishes, 2.0);
    assert_eq!([2, 3, 4].map(|n| manager.state(page_id(n))), [Requested; 3]);
    manager.update(&[], 3.0);
    assert_eq!(manager.state(page_id(3)), Requested, "its bytes may still be held");
    assert_eq!(manager.page_counts().total(), PageCounts { resident: 1, requested: 3, failed: 1, missing: 0 });
}

#[test]
fn the_longest_wait_is_told_until_the_page_comes_or_is_wanted_no_more() {
    let limits = Limits { footprint_bytes: 64 * MIB, in_flight: 8, read_bytes_per_update: MIB, ..LIMITS };
    let mut manager = RequestManager::new(limits).unwrap();
    let [first, second] = [1, 2].map(|n| demand(n, Urgency::Visible, 1.0));
    let complete = |manager: &mut RequestManager, n, completion, now_secs| {
        manager.complete(Event { page: page_id(n), completion }, now_secs);
    };
    assert_eq!(manager.awaited_since_secs(), None);
    manager.update(&[first], 1.0);
    manager.update(&[first, second], 2.0);
    assert_eq!(manager.awaited_since_secs(), Some(1.0));
    complete(&mut manager, 1, Completion::Failed, 3.0);
    manager.update(&[first, second], 4.0);
    assert_eq!(manager.awaited_since_secs(), Some(1.0), "another try is the same wait");
    manager.update(&[second], 5.0);
    assert_eq!(manager.awaited_since_secs(), Some(2.0));
    manager.update(&[first, second], 6.0);
    assert_eq!(manager.awaited_since_secs(), Some(2.0), "what was not wanted begins anew");
    complete(&mut manager, 2, Completion::Loaded { bytes: 1000 }, 7.0);
    assert_eq!(manager.awaited_since_secs(), None, "the other one is being cancelled");
    complete(&mut manager, 1, Completion::Cancelled, 8.0);
    manager.update(&[first, second], 9.0);
    assert_eq!(manager.awaited_since_secs(), Some(9.0));
    complete(&mut manager, 1, Completion::Broken, 10.0);
    assert_eq!(manager.awaited_since_secs(), None, "what never comes is not awaited");
}

#[test]
fn a_front_that_does_not_fit_is_said_and_not_thrashed() {
    let limits = Limits { footprint_bytes: 4 * MIB, in_flight: 8, read_bytes_per_update: 10 * MIB, ..LIMITS };
    let mut simulation = Simulation::new(limits);
    let front: Vec<Demand> = (0..30).map(|n| demand(3 * n + 1, Urgency::Visible, f64::from(n))).collect();
    assert!(!simulation.manager.fits(&front) && simulation.manager.fits(&front[..4]));
    for _ in 0..20 {
        simulation.update(&front);
        while !simulation.under_way.is_empty() {
            simulation.answer(7 * 9);
        }
    }
    assert!(!simulation.manager.fits(&front) && simulation.manager.is_idle());
    assert_eq!(simulation.manager.stats().evicted, 0);
    assert_eq!(simulation.manager.stats().started, simulation.resident.len() as u64);
    assert!(simulation.resident.contains_key(&front[29].page), "the most gainful are there");
}

#[test]
fn the_least_workable_footprint_is_told_and_works() {
    let index = dive_world(10.0, 10.0, 4, 4);
    let least = least_footprint_bytes(&index);
    let limits = |footprint_bytes| Limits { footprint_bytes, in_flight: 4, read_bytes_per_update: MIB, ..LIMITS };
    assert!(RequestManager::for_world(limits(least), &index).is_ok());
    let error = RequestManager::for_world(limits(least - MIB), &index).err().unwrap();
    let ManagerError::FootprintTooSmall { least: told, .. } = &error;
    assert_eq!(told.0, least);
    assert!(error.to_string().contains("--footprint"), "{error}");
    assert!(RequestManager::new(limits(1000)).is_err());
}

fn read(n: u32, len: u32) -> RangeRead {
    RangeRead::of_page(u64::from(n), page_id(n), Place::new(0, len).unwrap())
}

/// Gives made-up pages; every fifth breaks, one kind panics.
struct MadeUpReader {
    reads: AtomicUsize,
}

impl PageReader for MadeUpReader {
    fn load(&self, id: PageId, place: Place) -> Result<Page, ReadError> {
        self.reads.fetch_add(1, Ordering::Relaxed);
        match place.len % 5 {
            1 => Err(ReadError::Failed("busy".into())),
            2 => Err(ReadError::Broken("torn".into())),
            3 => panic!("a decoder gives up"),
            _ => Ok(page(id)),
        }
    }
}

fn drain(server: &mut dyn PageServer) -> Vec<Delivery> {
    let mut deliveries = Vec::new();
    while server.in_flight() > 0 {
        match server.poll() {
            Some(delivery) => deliveries.push(delivery),
            None => std::thread::yield_now(),
        }
    }
    deliveries.sort_by_key(|delivery| delivery.page);
    deliveries
}

#[test]
fn inline_and_threaded_servers_deliver_each_start_once() {
    let reader: Arc<dyn PageReader> = Arc::new(MadeUpReader { reads: AtomicUsize::new(0) });
    let limits = ServerLimits { threads_per_layer: 2, queue_len: 64 };
    let mut servers: [Box<dyn PageServer>; 2] =
        [Box::new(InlineServer::new(reader.clone())), Box::new(ThreadedServers::start(&reader, limits).unwrap())];
    let results: Vec<Vec<(PageId, &str)>> = servers
        .iter_mut()
        .map(|server| {
            for n in 0..50 {
                assert!(server.start(read(n, 100 + n)));
            }
            drain(&mut **server).iter().map(|delivery| (delivery.page, outcome(delivery))).collect()
        })
        .collect();
    assert_eq!(results[0].len(), 50);
    assert_eq!(results[0], results[1]);
    assert_eq!(results[0].iter().filter(|(_, outcome)| *outcome == "broken").count(), 20);
}

#[test]
fn cancelled_pages_are_not_read() {
    let reader = Arc::new(MadeUpReader { reads: AtomicUsize::new(0) });
    let mut server = InlineServer::new(reader.clone());
    for n in 0..10 {
        server.start(read(n, 100));
    }
    (0..10).filter(|n| n % 2 == 0).for_each(|n| server.cancel(page_id(n)));
    let outcomes: Vec<_> = drain(&mut server).iter().map(outcome).collect();
    assert_eq!(outcomes.iter().filter(|outcome| **outcome == "cancelled").count(), 5);
    assert_eq!(reader.reads.load(Ordering::Relaxed), 5);
}

#[test]
fn a_full_queue_says_so_and_dropping_the_servers_ends_them() {
    let reader: Arc<dyn PageReader> = Arc::new(MadeUpReader { reads: AtomicUsize::new(0) });
    let limits = ServerLimits { threads_per_layer: 1, queue_len: 4 };
    let mut servers = ThreadedServers::start(&reader, limits).unwrap();
    let started = (0..9).filter(|&n| servers.start(read(n, 100))).count();
    assert_eq!((started, servers.in_flight()), (4, 4));
    drop(servers);
    assert_eq!(Arc::strong_count(&reader), 1, "all threads have ended");
}

/// Waits until as many reads hang.
fn until_waiting(gate: &Gate, count: usize) {
    while gate.waiting() != count {
        std::thread::yield_now();
    }
}

fn hanging() -> (Arc<Gate>, Arc<MadeUpReader>, Arc<dyn PageReader>) {
    let (gate, made_up) = (Arc::new(Gate::default()), Arc::new(MadeUpReader { reads: AtomicUsize::new(0) }));
    gate.close();
    let reader = SlowReader::new(made_up.clone(), Duration::ZERO, gate.clone());
    (gate, made_up, Arc::new(reader))
}

#[test]
fn dropping_the_servers_does_not_wait_for_storage_that_hangs() {
    let (gate, made_up, reader) = hanging();
    let limits = ServerLimits { threads_per_layer: 1, queue_len: 8 };
    let mut servers = ThreadedServers::start(&reader, limits).unwrap();
    // Two for each layer: one hangs, one waits in the queue.
    (0..6).for_each(|n| assert!(servers.start(read(n, 100))));
    until_waiting(&gate, 3);
    drop(servers);
    assert_eq!((gate.waiting(), made_up.reads.load(Ordering::Relaxed)), (3, 0), "the threads were left behind");
    gate.open();
    while Arc::strong_count(&reader) > 1 {
        std::thread::yield_now();
    }
    assert_eq!(made_up.reads.load(Ordering::Relaxed), 3, "the threads ended, and read nothing more");
}

#[test]
fn reads_wait_at_a_closed_gate_and_all_come_when_it_opens() {
    let (gate, made_up, reader) = hanging();
    let limits = ServerLimits { threads_per_layer: 2, queue_len: 8 };
    let mut servers = ThreadedServers::start(&reader, limits).unwrap();
    (0..6).for_each(|n| assert!(servers.start(read(n, 100))));
    until_waiting(&gate, 6);
    assert!(servers.poll().is_none() && made_up.reads.load(Ordering::Relaxed) == 0);
    gate.open();
    assert!(drain(&mut servers).iter().all(|delivery| outcome(delivery) == "loaded"));
    assert_eq!((gate.waiting(), made_up.reads.load(Ordering::Relaxed)), (0, 6));
}

#[test]
fn slow_reads_take_their_latency_and_outlast_a_stall() {
    let gate = Arc::new(Gate::default());
    let made_up = Arc::new(MadeUpReader { reads: AtomicUsize::new(0) });
    let latency = Duration::from_millis(20);
    let reader = SlowReader::new(made_up, latency, gate.clone());
    let read = || {
        let begun = Instant::now();
        assert!(reader.load(page_id(0), Place::new(0, 100).unwrap()).is_ok());
        begun.elapsed()
    };
    assert!(read() >= latency);
    let lasts = Duration::from_millis(80);
    let begun = Instant::now();
    gate.stall(Stall { at: Duration::ZERO, lasts });
    read();
    assert!(begun.elapsed() >= lasts);
    gate.stall(Stall { at: Duration::ZERO, lasts: Duration::from_secs(3600) });
    std::thread::scope(|scope| {
        let hangs = scope.spawn(read);
        until_waiting(&gate, 1);
        gate.open();
        assert!(hangs.join().is_ok_and(|took| took >= latency), "opening ends a stall");
    });
}
