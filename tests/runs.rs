//! Runs of pages: read as one, decoded page by page, delivered exactly once each, whatever goes wrong or is cancelled.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on should stop")]

mod made_up;

use made_up::{outcome, page};
use std::sync::{Arc, Mutex};
use std::time::Duration;
use stoop::content::{Page, PageFile, PageId, PageKind};
use stoop::forest::index::Place;
use stoop::forest::{CellId, Zone};
use stoop::paging::{
    Delivery, Gate, InlineServer, PageReader, PageRun, PageServer, RangeRead, ReadError, ServerLimits, SlowReader,
    ThreadedServers,
};

const LEN: u32 = 1000;
/// Unwanted bytes between two pages.
const GAP: u32 = 24;
const OBJECTS: PageKind = PageKind::Objects { collection: 0, rep: 0 };

fn page_id(n: u32, kind: PageKind) -> PageId {
    PageId { cell: CellId::new(Zone::new(18).unwrap(), 10, n, 0).unwrap(), kind }
}

/// Pages numbered on from `first`, one behind the other.
fn run(first: u32, kinds: &[PageKind]) -> RangeRead {
    let place = |n: u32| Place::new(u64::from(n * (LEN + GAP)), LEN).unwrap();
    let pages: Vec<_> = kinds.iter().zip(first..).map(|(&kind, n)| (page_id(n, kind), place(n))).collect();
    let len = kinds.len() as u32 * (LEN + GAP) - GAP;
    RangeRead {
        id: u64::from(first),
        zone: Zone::new(18).unwrap(),
        file: PageFile::Pack,
        offset: pages[0].1.offset,
        len,
        pages,
    }
}

#[derive(Default)]
struct Told {
    /// Offset and length of each read.
    reads: Mutex<Vec<(u64, u32)>>,
    decoded: Mutex<Vec<u32>>,
    /// Decoding objects waits for it.
    objects: Mutex<()>,
}

/// Reads runs. Page 5 is broken, the decoder of page 6 panics, runs from page 100 on cannot be read.
struct Reader(Arc<Told>);

struct Run(Arc<Told>);

impl PageReader for Reader {
    fn load(&self, _: PageId, _: Place) -> Result<Page, ReadError> {
        panic!("pages come in runs");
    }

    fn read_run(&self, run: &RangeRead) -> Result<Option<Arc<dyn PageRun>>, ReadError> {
        self.0.reads.lock().unwrap().push((run.offset, run.len));
        if run.id >= 100 { Err(ReadError::Failed("busy".into())) } else { Ok(Some(Arc::new(Run(self.0.clone())))) }
    }
}

impl PageRun for Run {
    fn page(&self, id: PageId, _: Place) -> Result<Page, ReadError> {
        if id.kind == OBJECTS {
            drop(self.0.objects.lock().unwrap_or_else(|poisoned| poisoned.into_inner()));
        }
        self.0.decoded.lock().unwrap().push(id.cell.xy().0);
        match id.cell.xy().0 {
            5 => Err(ReadError::Broken("torn".into())),
            6 => panic!("a decoder gives up"),
            _ => Ok(page(id)),
        }
    }
}

fn servers(reader: Arc<dyn PageReader>) -> [Box<dyn PageServer>; 2] {
    let limits = ServerLimits { threads_per_layer: 1, queue_len: 64 };
    [Box::new(ThreadedServers::start(&reader, limits).unwrap()), Box::new(InlineServer::new(reader))]
}

/// Page, outcome and bytes read, by page.
fn drain(server: &mut dyn PageServer) -> Vec<(u32, &'static str, u64)> {
    let mut told = Vec::new();
    while server.in_flight() > 0 {
        told.extend(server.poll_within(Duration::from_secs(1)).map(|delivery| tell(&delivery)));
    }
    told.sort_unstable();
    told
}

fn tell(delivery: &Delivery) -> (u32, &'static str, u64) {
    (delivery.page.cell.xy().0, outcome(delivery), delivery.read_bytes)
}

const MIXED: [PageKind; 4] = [PageKind::Terrain, PageKind::Imagery, OBJECTS, PageKind::Terrain];

#[test]
fn a_run_is_one_read_and_each_page_costs_only_itself() {
    let told = Arc::new(Told::default());
    for mut server in servers(Arc::new(Reader(told.clone()))) {
        server.start(run(4, &MIXED));
        assert_eq!(server.in_flight(), 4);
        let (own, with_gap) = (u64::from(LEN), u64::from(LEN + GAP));
        let expected = [(4, "loaded", own), (5, "broken", with_gap), (6, "broken", with_gap), (7, "loaded", with_gap)];
        assert_eq!(drain(&mut *server), expected);
        assert_eq!(std::mem::take(&mut *told.reads.lock().unwrap()), [(4 * 1024, 4 * 1024 - GAP)]);
    }
}

#[test]
fn a_run_that_cannot_be_read_fails_each_of_its_pages() {
    let told = Arc::new(Told::default());
    for mut server in servers(Arc::new(Reader(told.clone()))) {
        server.start(run(100, &MIXED));
        assert_eq!(drain(&mut *server), [100, 101, 102, 103].map(|n| (n, "failed", 0)), "and no byte came");
        assert_eq!(told.reads.lock().unwrap().drain(..).count(), 1);
    }
    assert!(told.decoded.lock().unwrap().is_empty());
}

#[test]
fn ends_of_a_run_that_nobody_wants_are_not_read_and_what_is_cancelled_is_not_decoded() {
    for at in 0..2 {
        let told = Arc::new(Told::default());
        let gate = Arc::new(Gate::default());
        gate.close();
        let slow = SlowReader::new(Arc::new(Reader(told.clone())), Duration::ZERO, gate.clone());
        // Inline nothing is read before it is asked for; in threads the first run keeps the others waiting.
        let reader: Arc<dyn PageReader> = if at == 0 { Arc::new(slow) } else { Arc::new(Reader(told.clone())) };
        let mut server = servers(reader).into_iter().nth(at).unwrap();
        server.start(run(0, &MIXED));
        while at == 0 && gate.waiting() == 0 {
            std::thread::yield_now();
        }
        server.start(run(10, &MIXED));
        server.start(run(20, &MIXED));
        // All of the second run, the ends of the third; a page that is being read, where there are threads.
        let cancelled = [(10, 0), (11, 1), (12, 2), (13, 3), (20, 0), (23, 3), (1, 1)];
        cancelled.iter().for_each(|&(n, kind)| server.cancel(page_id(n, MIXED[kind])));
        gate.open();
        let outcomes = drain(&mut *server);
        let is_cancelled = |n: u32| cancelled.iter().any(|cancelled| cancelled.0 == n);
        assert_eq!(outcomes.len(), 12);
        for (n, outcome, read_bytes) in outcomes {
            assert_eq!(outcome, if is_cancelled(n) { "cancelled" } else { "loaded" }, "{n}");
            let lies_inside = n == 1;
            assert_eq!(read_bytes == 0, is_cancelled(n) && !(lies_inside && at == 0), "{n}: {read_bytes}");
        }
        let reads = told.reads.lock().unwrap().clone();
        assert_eq!(reads, [(0, 4 * 1024 - GAP), (21 * 1024, 2 * 1024 - GAP)]);
        assert!(told.decoded.lock().unwrap().iter().all(|&n| !is_cancelled(n)));
    }
}

#[test]
fn terrain_waits_for_no_objects() {
    let told = Arc::new(Told::default());
    let reader: Arc<dyn PageReader> = Arc::new(Reader(told.clone()));
    let limits = ServerLimits { threads_per_layer: 1, queue_len: 64 };
    let mut server = ThreadedServers::start(&reader, limits).unwrap();
    let hang = told.objects.lock().unwrap();
    server.start(run(10, &MIXED));
    server.start(run(20, &MIXED));
    server.start(run(30, &[OBJECTS]));
    let mut come = Vec::new();
    while come.len() < 6 {
        come.extend(server.poll_within(Duration::from_secs(1)).map(|delivery| tell(&delivery).0));
    }
    come.sort_unstable();
    assert_eq!(come, [10, 11, 13, 20, 21, 23], "all but the objects");
    assert!(server.poll().is_none());
    drop(hang);
    let objects: Vec<_> = drain(&mut server).iter().map(|told| (told.0, told.1)).collect();
    assert_eq!(objects, [(12, "loaded"), (22, "loaded"), (30, "loaded")]);
}
