//! Threads by layer.
//!
//! A run goes to the threads of the most urgent layer in it (terrain, then imagery, then objects), which read it. They
//! decode that layer's pages alone, and hand the others on, as bytes, to the threads of theirs: so terrain waits neither
//! for reads nor for the decoding of runs in which there is none.

use super::run::{self, Fetched, Part};
use super::{Delivery, Outcome, PageReader, PageServer, RangeRead, ReadError};
use crate::content::{PageId, PageKind};
use crate::forest::index::Place;
use crossbeam_channel::{Receiver, Sender, TrySendError, bounded};
use std::collections::{HashSet, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{Builder, JoinHandle};
use std::time::Duration;

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
    queues: Vec<Sender<Job>>,
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

/// What a thread is told to do.
enum Job {
    Read(RangeRead),
    /// Pages of its layer in a run that a thread of another one read.
    Decode(Fetched, Vec<Part>),
}

impl ThreadedServers {
    pub fn start(reader: &Arc<dyn PageReader>, limits: ServerLimits) -> Result<Self, ServerError> {
        let queue_len = limits.queue_len.max(1);
        let (to_engine, deliveries) = bounded(queue_len);
        let (alive, ended) = bounded(0);
        // No layer has more jobs than there are started pages.
        let (queues, jobs): (Vec<_>, Vec<_>) = LAYERS.iter().map(|_| bounded(queue_len)).unzip();
        let mut servers = Self {
            queues,
            deliveries: Some(deliveries),
            cancelled: Cancelled::default(),
            threads: Vec::new(),
            ended,
            in_flight: 0,
            queue_len,
            unserved: VecDeque::new(),
        };
        for ((layer, name), jobs) in LAYERS.into_iter().enumerate().zip(&jobs) {
            for number in 0..limits.threads_per_layer.max(1) {
                let worker = Worker {
                    layer,
                    reader: reader.clone(),
                    jobs: jobs.clone(),
                    onward: servers.queues[layer + 1..].to_vec(),
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
        let Some(first) = read.pages.iter().map(|(page, _)| layer(page.kind)).min() else { return true };
        let pages = read.pages.len();
        match self.queues[first].try_send(Job::Read(read)) {
            Ok(()) => self.in_flight += pages,
            Err(TrySendError::Full(job) | TrySendError::Disconnected(job)) => self.unserved.extend(unserved(job)),
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

/// Deliveries for a job that no thread takes.
fn unserved(job: Job) -> Vec<Delivery> {
    let Job::Read(read) = job else { return Vec::new() };
    let failed = |(page, place): (PageId, Place)| {
        let error = ReadError::Failed("the threads that read have ended".into());
        Delivery { page, place, outcome: Outcome::Failed(error), read_bytes: 0 }
    };
    read.pages.into_iter().map(failed).collect()
}

struct Worker {
    /// Which of [`LAYERS`].
    layer: usize,
    reader: Arc<dyn PageReader>,
    jobs: Receiver<Job>,
    /// Queues of the layers behind this one: each ends when those before it have.
    onward: Vec<Sender<Job>>,
    deliveries: Sender<Delivery>,
    cancelled: Cancelled,
    /// Dropped last, when nothing else is held any more.
    _alive: Sender<Never>,
}

impl Worker {
    /// Serves until the queue or the receiver is gone; what is left in the queue then is not read.
    fn run(self) {
        while let Ok(job) = self.jobs.recv() {
            let is_served = match job {
                Job::Read(read) => self.read(read),
                Job::Decode(fetched, parts) => self.deliver(&fetched, parts),
            };
            if !is_served {
                return;
            }
        }
    }

    /// False when nobody takes deliveries any more.
    fn read(&self, read: RangeRead) -> bool {
        let (fetched, mut parts) = run::fetch(&*self.reader, read, |page| lock(&self.cancelled).remove(&page));
        if matches!(fetched, Fetched::Run(_)) {
            for (behind, queue) in self.onward.iter().enumerate() {
                parts = self.hand_on(queue, self.layer + 1 + behind, &fetched, parts);
            }
        }
        self.deliver(&fetched, parts)
    }

    /// Gives the pages of a layer to its threads; gives back all others, and them too where they cannot be taken.
    fn hand_on(&self, queue: &Sender<Job>, to: usize, fetched: &Fetched, parts: Vec<Part>) -> Vec<Part> {
        let (theirs, mut others): (Vec<_>, Vec<_>) = parts.into_iter().partition(|part| layer(part.page.kind) == to);
        if theirs.is_empty() {
            return others;
        }
        let refused = queue.try_send(Job::Decode(fetched.clone(), theirs)).err();
        if let Some(TrySendError::Full(Job::Decode(_, theirs)) | TrySendError::Disconnected(Job::Decode(_, theirs))) =
            refused
        {
            others.extend(theirs);
        }
        others
    }

    /// False when nobody takes deliveries any more.
    fn deliver(&self, fetched: &Fetched, parts: Vec<Part>) -> bool {
        parts.into_iter().all(|part| {
            let is_cancelled = lock(&self.cancelled).remove(&part.page);
            self.deliveries.send(part.deliver(&*self.reader, fetched, is_cancelled)).is_ok()
        })
    }
}

/// The set stays meaningful whatever a holder of the lock did.
fn lock(cancelled: &Mutex<HashSet<PageId>>) -> MutexGuard<'_, HashSet<PageId>> {
    cancelled.lock().unwrap_or_else(PoisonError::into_inner)
}
