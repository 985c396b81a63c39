//! Servers: they read, verify and decode what they are told, and know no policy. Threads by layer for live runs; inline
//! for runs in lock-step, where reading happens in the order of the commands, inside the frame.

use super::RangeRead;
use crate::content::{Page, PageId, PageKind};
use crate::forest::index::Place;
use crossbeam_channel::{Receiver, Sender, TrySendError, after, bounded};
use std::collections::{HashSet, VecDeque};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{Builder, JoinHandle};
use std::time::Duration;

/// A moment, for [`PageServer::poll_within`].
const LOOK_AGAIN: Duration = Duration::from_millis(1);

/// Why a page did not come.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ReadError {
    /// The storage did not answer; a later try may succeed.
    #[error("{0}")]
    Failed(String),
    /// What is stored is wrong and stays so.
    #[error("{0}")]
    Broken(String),
}

/// Reads and decodes single pages; thread-safe.
pub trait PageReader: Send + Sync {
    fn load(&self, page: PageId, place: Place) -> Result<Page, ReadError>;
}

/// What became of a started page.
#[derive(Clone, Debug)]
pub enum Outcome {
    Loaded(Page),
    Failed(ReadError),
    /// Cancelled before it was read.
    Cancelled,
}

#[derive(Clone, Debug)]
pub struct Delivery {
    pub page: PageId,
    pub place: Place,
    pub outcome: Outcome,
}

/// Takes commands, gives deliveries: exactly one for each started page, also for cancelled ones.
pub trait PageServer: Send {
    /// False when the queue has no room for all pages of the range; nothing is then started, and no delivery follows.
    fn start(&mut self, read: RangeRead) -> bool;
    /// Drops a started page if it is not being read yet.
    fn cancel(&mut self, page: PageId);
    /// The next delivery that is there; never waits.
    fn poll(&mut self) -> Option<Delivery>;
    /// The next delivery; where reads go on elsewhere, waits for it, but no longer than `at_most`. `None` may come
    /// sooner: a server that does not know when its next one comes looks again in a moment.
    fn poll_within(&mut self, at_most: Duration) -> Option<Delivery> {
        self.poll().or_else(|| {
            // A timer is a channel that gives one message.
            let _ = after(at_most.min(LOOK_AGAIN)).recv();
            self.poll()
        })
    }
    /// Starts without delivery so far.
    fn in_flight(&self) -> usize;
}

/// Reads when polled.
pub struct InlineServer {
    reader: Arc<dyn PageReader>,
    queue: VecDeque<(PageId, Place)>,
    cancelled: HashSet<PageId>,
}

impl InlineServer {
    pub fn new(reader: Arc<dyn PageReader>) -> Self {
        Self { reader, queue: VecDeque::new(), cancelled: HashSet::new() }
    }
}

impl PageServer for InlineServer {
    fn start(&mut self, read: RangeRead) -> bool {
        self.queue.extend(read.pages);
        true
    }

    fn cancel(&mut self, page: PageId) {
        if self.queue.iter().any(|queued| queued.0 == page) {
            self.cancelled.insert(page);
        }
    }

    fn poll(&mut self) -> Option<Delivery> {
        let (page, place) = self.queue.pop_front()?;
        let outcome = if self.cancelled.remove(&page) { Outcome::Cancelled } else { read(&*self.reader, page, place) };
        Some(Delivery { page, place, outcome })
    }

    fn poll_within(&mut self, _at_most: Duration) -> Option<Delivery> {
        self.poll()
    }

    fn in_flight(&self) -> usize {
        self.queue.len()
    }
}

fn read(reader: &dyn PageReader, page: PageId, place: Place) -> Outcome {
    // A decoder that panics must cost its page only, and not a delivery that the manager waits for.
    match catch_unwind(AssertUnwindSafe(|| reader.load(page, place))) {
        Ok(Ok(loaded)) => Outcome::Loaded(loaded),
        Ok(Err(error)) => Outcome::Failed(error),
        Err(_) => Outcome::Failed(ReadError::Broken(format!("decoding {page:?} failed unexpectedly"))),
    }
}

/// How many threads serve a layer, and how many pages may wait for them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ServerLimits {
    pub threads_per_layer: usize,
    /// Started pages without delivery, over all layers; at least what the request manager may have in flight.
    pub queue_len: usize,
}

#[derive(Debug, thiserror::Error)]
#[error("cannot start the thread {name}: {source}")]
pub struct ServerError {
    name: String,
    source: std::io::Error,
}

/// How long dropping [`ThreadedServers`] waits for reads that are under way. Threads whose storage hangs longer are left
/// behind: they hold all they use, read nothing more, and end when their read does.
pub const SHUTDOWN_WAIT: Duration = Duration::from_secs(1);

/// Nothing is ever sent: its channel closes when the last thread has ended.
enum Never {}

type Cancelled = Arc<Mutex<HashSet<PageId>>>;

/// Threads by layer.
pub struct ThreadedServers {
    /// By layer; dropped to end the threads.
    queues: Vec<Sender<(PageId, Place)>>,
    deliveries: Option<Receiver<Delivery>>,
    cancelled: Cancelled,
    threads: Vec<JoinHandle<()>>,
    ended: Receiver<Never>,
    in_flight: usize,
    queue_len: usize,
    /// Of pages that no thread would take.
    unserved: VecDeque<Delivery>,
}

const LAYERS: [&str; 3] = ["terrain", "imagery", "objects"];

fn layer(kind: PageKind) -> usize {
    match kind {
        // Segments are few and small, and wanted before the data below them.
        PageKind::Terrain | PageKind::Segment => 0,
        PageKind::Imagery => 1,
        PageKind::Objects { .. } => 2,
    }
}

impl ThreadedServers {
    pub fn start(reader: &Arc<dyn PageReader>, limits: ServerLimits) -> Result<Self, ServerError> {
        let queue_len = limits.queue_len.max(1);
        let (to_engine, deliveries) = bounded(queue_len);
        let (alive, ended) = bounded(0);
        let mut servers = Self {
            queues: Vec::new(),
            deliveries: Some(deliveries),
            cancelled: Cancelled::default(),
            threads: Vec::new(),
            ended,
            in_flight: 0,
            queue_len,
            unserved: VecDeque::new(),
        };
        for name in LAYERS {
            let (queue, jobs) = bounded(queue_len);
            servers.queues.push(queue);
            for number in 0..limits.threads_per_layer.max(1) {
                let worker = Worker {
                    reader: reader.clone(),
                    jobs: jobs.clone(),
                    deliveries: to_engine.clone(),
                    cancelled: servers.cancelled.clone(),
                    _alive: alive.clone(),
                };
                let name = format!("{name}-{number}");
                let thread = Builder::new().name(name.clone()).spawn(move || worker.run());
                servers.threads.push(thread.map_err(|source| ServerError { name, source })?);
            }
        }
        Ok(servers)
    }
}

impl ThreadedServers {
    fn delivered(&mut self, delivery: Delivery) -> Delivery {
        self.in_flight -= 1;
        // A cancellation that came too late must not hit the page's next start.
        lock(&self.cancelled).remove(&delivery.page);
        delivery
    }
}

impl PageServer for ThreadedServers {
    fn start(&mut self, read: RangeRead) -> bool {
        if self.in_flight + read.pages.len() > self.queue_len {
            return false;
        }
        // The threads of a layer have their own queues, each as long as all may be together.
        for (page, place) in read.pages {
            match self.queues[layer(page.kind)].try_send((page, place)) {
                Ok(()) => self.in_flight += 1,
                Err(TrySendError::Full(_) | TrySendError::Disconnected(_)) => {
                    let error = ReadError::Failed("the threads that read have ended".into());
                    self.unserved.push_back(Delivery { page, place, outcome: Outcome::Failed(error) });
                }
            }
        }
        true
    }

    fn cancel(&mut self, page: PageId) {
        lock(&self.cancelled).insert(page);
    }

    fn poll(&mut self) -> Option<Delivery> {
        let unserved = self.unserved.pop_front();
        unserved.or_else(|| {
            let delivery = self.deliveries.as_ref()?.try_recv().ok()?;
            Some(self.delivered(delivery))
        })
    }

    fn poll_within(&mut self, at_most: Duration) -> Option<Delivery> {
        self.poll().or_else(|| {
            let deliveries = self.deliveries.as_ref().filter(|_| self.in_flight > 0)?;
            let delivery = deliveries.recv_timeout(at_most).ok()?;
            Some(self.delivered(delivery))
        })
    }

    fn in_flight(&self) -> usize {
        self.in_flight + self.unserved.len()
    }
}

impl Drop for ThreadedServers {
    fn drop(&mut self) {
        self.queues.clear();
        self.deliveries = None;
        let all_ended = self.ended.recv_timeout(SHUTDOWN_WAIT).is_err_and(|error| error.is_disconnected());
        for thread in self.threads.drain(..).filter(|thread| all_ended || thread.is_finished()) {
            // Panics in decoders are caught where they happen; there is nothing to report here.
            let _ = thread.join();
        }
    }
}

struct Worker {
    reader: Arc<dyn PageReader>,
    jobs: Receiver<(PageId, Place)>,
    deliveries: Sender<Delivery>,
    cancelled: Cancelled,
    /// Dropped last, when nothing else is held any more.
    _alive: Sender<Never>,
}

impl Worker {
    /// Serves until the queue or the receiver is gone; what is left in the queue then is not read.
    fn run(self) {
        while let Ok((page, place)) = self.jobs.recv() {
            let dropped = lock(&self.cancelled).remove(&page);
            let outcome = if dropped { Outcome::Cancelled } else { read(&*self.reader, page, place) };
            if self.deliveries.send(Delivery { page, place, outcome }).is_err() {
                return;
            }
        }
    }
}

/// The set stays meaningful whatever a holder of the lock did.
fn lock(cancelled: &Mutex<HashSet<PageId>>) -> MutexGuard<'_, HashSet<PageId>> {
    cancelled.lock().unwrap_or_else(PoisonError::into_inner)
}
