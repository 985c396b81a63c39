//! The queueing model: first come, first served, up to `parallel` requests at once; each waits for its latency, then
//! those that are transferred share the bandwidth equally (egalitarian processor sharing: Kleinrock 1976, *Queueing
//! Systems* II, chapter 4).
//!
//! The state changes only when something happens: a request begins, its first byte or the end of a part or block comes,
//! the server dies, the bandwidth halves. In between rates are constant and times follow from them exactly, so that
//! nothing depends on how often the disk is asked.
//!
//! At the time t after the first request, no more than `min(B·(t − latency), P · 1 MiB · ⌊t/latency⌋)` bytes have come
//! where each request pays the latency and none is above [`REQUEST_BYTES_MAX`](super::REQUEST_BYTES_MAX). Where only seeks pay
//! ([`StorageModel::seek_only`]) the first half alone holds: one long run costs one latency.

use super::fates::{Fate, Fates};
use super::faults::DEAD_TIMEOUT_SECS;
use super::service::{Phase, Service};
use super::{Arrival, Faults, Position, Request, StorageModel};
use std::collections::VecDeque;

/// Requests that may wait for their turn.
pub const QUEUE_MAX: usize = 1 << 14;

/// What went on so far.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Counters {
    /// Transferred, in vain too.
    pub bytes: u64,
    /// Ranges that did not start where the one begun before ended; with [`StorageModel::seek_only`], those that paid.
    pub seeks: u64,
    /// Whose turn has come.
    pub requests: u64,
    /// In which at least one request was served, those that hang on a dead server included.
    pub busy_secs: f64,
}

/// A virtual disk or server. Times are seconds from 0 on and must not fall from call to call; where they do, the latest
/// one counts.
pub struct Disk {
    model: StorageModel,
    faults: Faults,
    fates: Fates,
    queue: VecDeque<Request>,
    /// In the order in which they began; at most as many as the model serves.
    served: Vec<Service>,
    /// Where the range that began last ends.
    head: Option<Position>,
    /// The time of the last change, which transfers in `served` describe.
    at_s: f64,
    /// The latest time that was told.
    now_s: f64,
    /// Arrivals that nobody has taken yet.
    ready: Vec<Arrival>,
    /// Of services that are over.
    ended_bytes: f64,
    seeks: u64,
    requests: u64,
    /// Of times that are over.
    busy_secs: f64,
    /// Since when something is served without a break.
    busy_from_s: Option<f64>,
}

impl Disk {
    /// The seed decides whom the faults hit.
    pub fn new(model: StorageModel, faults: Faults, seed: u64) -> Self {
        Self {
            model,
            faults,
            fates: Fates::new(faults, seed),
            queue: VecDeque::new(),
            served: Vec::new(),
            head: None,
            at_s: 0.0,
            now_s: 0.0,
            ready: Vec::new(),
            ended_bytes: 0.0,
            seeks: 0,
            requests: 0,
            busy_secs: 0.0,
            busy_from_s: None,
        }
    }

    pub fn model(&self) -> &StorageModel {
        &self.model
    }

    /// Puts a request into the queue. False when that is full, or nothing is asked for; then nothing will arrive.
    ///
    /// Nobody splits a request that is too long: the bound above holds where none has several parts in more than
    /// [`REQUEST_BYTES_MAX`](super::REQUEST_BYTES_MAX).
    pub fn start(&mut self, request: Request, now_s: f64) -> bool {
        debug_assert!(request.parts.is_sorted() && request.parts.first() != Some(&0), "parts ascend: {request:?}");
        self.run_to(now_s);
        if request.len_bytes() == 0 || self.queue.len() >= QUEUE_MAX {
            return false;
        }
        self.queue.push_back(request);
        self.fill(self.now_s);
        true
    }

    /// Drops a request; nothing of it arrives after `now_s`. In the queue it cost nothing; waiting for its first byte
    /// it makes place at once; a transfer makes place at the end of its block ([`BLOCK_BYTES`](super::BLOCK_BYTES)), so
    /// that a more urgent request need not wait for all of it. What was transferred counts. False when there is no such
    /// request.
    pub fn cancel(&mut self, id: u64, now_s: f64) -> bool {
        self.run_to(now_s);
        if let Some(at) = self.queue.iter().position(|request| request.id == id) {
            self.queue.remove(at);
            return true;
        }
        let moved_bytes = (self.now_s - self.at_s) * self.bytes_per_sec_each();
        let Some(at) = self.served.iter().position(|service| service.is(id)) else { return false };
        let service = &mut self.served[at];
        let was_last = self.head == Some(service.end());
        let stop = service.cancel(service.done_bytes() + moved_bytes);
        if was_last {
            self.head = stop;
        }
        if stop.is_none() {
            self.end(at, self.now_s);
            self.fill(self.now_s);
        }
        true
    }

    /// What has arrived up to and at `to_s` and was not given before, in the order of time.
    pub fn advance(&mut self, to_s: f64) -> Vec<Arrival> {
        self.run_to(to_s);
        std::mem::take(&mut self.ready)
    }

    /// Requests of which parts will still arrive.
    pub fn in_flight(&self) -> usize {
        self.queue.len() + self.served.iter().filter(|service| service.is_awaited()).count()
    }

    /// Nothing arrives before this time; `None` where nothing will.
    pub fn next_event_s(&self) -> Option<f64> {
        let ready = self.ready.first().map(|arrival| arrival.at_s);
        ready.or_else(|| if self.served.is_empty() { None } else { self.next_change_s() })
    }

    /// Sums up to the latest time that was told.
    pub fn counters(&self) -> Counters {
        let since_secs = self.now_s - self.at_s;
        let moving = self.served.iter().filter(|service| service.is_transferring()).count() as f64;
        let under_way: f64 = self.served.iter().map(Service::done_bytes).sum();
        let bytes = self.ended_bytes + under_way + since_secs * self.bytes_per_sec_each() * moving;
        let busy_since_secs = self.busy_from_s.map_or(0.0, |from_s| self.now_s - from_s);
        Counters {
            bytes: bytes.round() as u64,
            seeks: self.seeks,
            requests: self.requests,
            busy_secs: self.busy_secs + busy_since_secs,
        }
    }

    /// The bandwidth that each transfer has between the last change and the next one.
    fn bytes_per_sec_each(&self) -> f64 {
        let moving = self.served.iter().filter(|service| service.is_transferring()).count();
        self.model.bytes_per_sec * self.faults.bandwidth_share(self.at_s) / moving.max(1) as f64
    }

    fn next_change_s(&self) -> Option<f64> {
        let each = self.bytes_per_sec_each();
        let due = self.served.iter().map(|service| service.due_s(self.at_s, each));
        due.chain(self.faults.next_change_s(self.at_s)).min_by(f64::total_cmp)
    }

    fn run_to(&mut self, to_s: f64) {
        while let Some(change_s) = self.next_change_s().filter(|&change_s| change_s <= to_s) {
            self.move_to(change_s);
            self.change();
        }
        // Until all is over: no time but that of the last change was told.
        self.now_s = self.now_s.max(if to_s.is_finite() { to_s } else { self.at_s });
    }

    /// Brings all transfers to a time up to which nothing else happens.
    fn move_to(&mut self, to_s: f64) {
        let (at_s, each) = (self.at_s, self.bytes_per_sec_each());
        for service in &mut self.served {
            service.transfer(at_s, to_s, each);
        }
        self.at_s = to_s;
    }

    /// Does what is due at the time of this change.
    fn change(&mut self) {
        let mut at = 0;
        while let Some(service) = self.served.get_mut(at) {
            if service.step(self.at_s, &mut self.ready) {
                at += 1;
            } else {
                self.end(at, self.at_s);
            }
        }
        if self.faults.die_s == Some(self.at_s) {
            self.die();
        }
        self.fill(self.at_s);
    }

    /// Takes a service away; what it has transferred counts.
    fn end(&mut self, at: usize, now_s: f64) {
        self.ended_bytes += self.served.remove(at).done_bytes();
        self.rest(now_s);
    }

    /// Cuts all transfers off.
    fn die(&mut self) {
        self.head = None;
        self.ended_bytes += self.served.iter().map(Service::done_bytes).sum::<f64>();
        self.served.retain(Service::is_awaited);
        for service in &mut self.served {
            service.phase = Phase::Hang { until_s: self.at_s + DEAD_TIMEOUT_SECS };
        }
        self.rest(self.at_s);
    }

    /// Counts the time that it was busy, if that is over now.
    fn rest(&mut self, now_s: f64) {
        if self.served.is_empty() {
            self.busy_secs += self.busy_from_s.take().map_or(0.0, |from_s| now_s - from_s);
        }
    }

    /// Lets those who wait take the places that are free.
    fn fill(&mut self, now_s: f64) {
        while self.served.len() < self.model.parallel.max(1) {
            let Some(request) = self.queue.pop_front() else { return };
            self.begin(request, now_s);
        }
    }

    fn begin(&mut self, request: Request, now_s: f64) {
        self.busy_from_s.get_or_insert(now_s);
        self.requests += 1;
        let Fate { outcomes, delay_secs } = self.fates.draw(&request);
        let start = Position { file: request.file, offset: request.offset };
        let is_seek = self.head != Some(start);
        self.seeks += u64::from(is_seek);
        self.head = Some(request.end());
        let latency_secs = if is_seek || !self.model.seek_only { self.model.latency_secs } else { 0.0 };
        let phase = if self.faults.is_dead(now_s) {
            self.head = None;
            Phase::Hang { until_s: now_s + DEAD_TIMEOUT_SECS }
        } else {
            Phase::Latency { until_s: now_s + latency_secs + delay_secs }
        };
        self.served.push(Service::new(request, outcomes, phase));
    }
}
