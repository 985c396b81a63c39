//! Pages on their way in and out: between selection, request manager, servers, live tree and GPU.

use super::footprint::{FLUSH_BYTES, PAGES_IN_FLIGHT_MAX, Partition, READ_BYTES_PER_FRAME, Reading};
use super::lift::{LIFT_BYTES_PER_OBJECT, Lifts};
use super::sink::{Handover, PageSink};
use super::throttle::ThrottledServer;
use super::upload::UploadRate;
use super::world_image::load_world_image;
use super::{EngineError, EngineParams, Mode, Source};
use crate::cells::LiveTree;
use crate::content::{Page, PageFile, PageId, PageKind};
use crate::forest::Zone;
use crate::forest::index::{IndexForest, Place, Segment};
use crate::layout::{Ride, Rider, RunCause};
use crate::paging::{
    Command, Completion, Delivery, Event, InlineServer, Limits, Outcome, PICTURE_GPU_BYTES, PageServer, RangeRead,
    ReadError, RequestManager, ServerLimits, ThreadedServers, Usage, drawn_pages, pinned_demands,
};
use crate::render::{ArenaFull, GpuLimits, Renderer};
use crate::select::{Demand, Selection};
use crate::storage::{Disk, Faults, StorageModel};
use std::collections::{HashMap, HashSet};
use std::time::Instant;

/// Messages of failures kept for the caller; further ones are only counted.
const MESSAGES_MAX: usize = 16;

/// How often live runs ask for pages, seconds, as far as that is known beforehand.
const LIVE_STEP_S: f64 = 1.0 / 60.0;

/// What went on so far.
#[derive(Clone, Copy, Debug, Default)]
pub struct Traffic {
    pub bytes_read: u64,
    pub seeks: u64,
    pub requests: u64,
}

/// Bytes that a resident page holds.
#[derive(Clone, Copy, Debug, Default)]
struct Held {
    gpu: u64,
    memory: u64,
}

/// What the request manager decided, in its order.
#[derive(Debug, Default)]
struct Orders {
    start: Vec<RangeRead>,
    evict: Vec<PageId>,
}

fn is_picture(page: PageId) -> bool {
    page.kind == PageKind::Imagery
}

/// What is resident, and the machinery that changes it.
pub struct Residency {
    pub cells: LiveTree,
    /// The source's index with the segments that are resident.
    pub index: IndexForest,
    pub manager: RequestManager,
    pub usage: Usage,
    pub lifts: Lifts,
    pub traffic: Traffic,
    partition: Partition,
    limits: Limits,
    mode: Mode,
    server: Box<dyn PageServer>,
    /// Decoded pages on their way to the GPU; as many as may be in flight.
    uploading: HashMap<PageId, (Page, Place)>,
    held: HashMap<PageId, Held>,
    gpu_total_bytes: u64,
    /// Pictures under way: they will go where the arena has layers free.
    pictures_in_flight: u64,
    last_read: Option<(Zone, PageFile, u64)>,
    messages: Vec<String>,
    /// What live runs take in at a time follows from this, and from the frame time to hold, milliseconds.
    upload_rate: UploadRate,
    frame_ms: Option<f64>,
    /// The highest since it was last asked for.
    footprint_max_bytes: u64,
}

impl Residency {
    pub fn new(
        params: &EngineParams,
        reading: Reading,
        partition: Partition,
        source: &Source,
    ) -> Result<Self, EngineError> {
        let read_bytes_per_update = if params.mode == Mode::LockStep { READ_BYTES_PER_FRAME } else { u64::MAX >> 2 };
        let held_back = params.storage.filter(|_| params.mode == Mode::Live);
        let reads = held_back.map_or_else(|| reading.limits(LIVE_STEP_S), |storage| storage.reads(LIVE_STEP_S));
        let limits = Limits {
            footprint_bytes: partition.pool_bytes(0),
            in_flight: reads.in_flight,
            pages_in_flight: PAGES_IN_FLIGHT_MAX,
            bytes_in_flight: reads.bytes_in_flight,
            read_bytes_per_update,
            run_bytes: reads.run_bytes,
            gap_bytes: reads.gap_bytes,
        };
        let server: Box<dyn PageServer> = if params.mode == Mode::Live {
            let limits =
                ServerLimits { threads_per_layer: reading.threads_per_layer(), queue_len: PAGES_IN_FLIGHT_MAX };
            throttled(Box::new(ThreadedServers::start(&source.reader, limits)?), params)
        } else {
            Box::new(InlineServer::new(source.reader.clone()))
        };
        Ok(Self {
            cells: LiveTree::default(),
            index: source.index.clone(),
            manager: RequestManager::for_world(limits, &source.index)?,
            usage: Usage::default(),
            lifts: Lifts::default(),
            traffic: Traffic::default(),
            partition,
            limits,
            mode: params.mode,
            server,
            uploading: HashMap::new(),
            held: HashMap::new(),
            gpu_total_bytes: 0,
            pictures_in_flight: 0,
            last_read: None,
            messages: Vec::new(),
            upload_rate: UploadRate::default(),
            frame_ms: params.frame_ms,
            footprint_max_bytes: 0,
        })
    }

    /// Loads the coarsest terrain of all zones, so that the first frame already has the globe. This is the only time
    /// that anything waits for a page.
    pub fn load_pinned(&mut self, source: &Source, sink: &mut dyn PageSink) {
        let usual = std::mem::replace(&mut self.server, Box::new(InlineServer::new(source.reader.clone())));
        self.manager.set_limits(Limits { read_bytes_per_update: u64::MAX >> 2, ..self.limits });
        let demands = pinned_demands(&source.index);
        loop {
            let orders = self.command(&demands, &demands, 0.0);
            self.start(orders.start, 0.0, sink);
            if self.server.in_flight() == 0 {
                break;
            }
            self.receive(0.0, sink);
        }
        self.manager.set_limits(self.limits);
        self.manager.forget_pace();
        self.server = usual;
    }

    /// Makes the world image.
    pub fn load_world_image(&mut self, source: &Source, renderer: &mut Renderer) {
        let load = load_world_image(source, renderer);
        load.read.into_iter().for_each(|(id, place)| self.count_read(id, place, place.len.into()));
        load.failures.into_iter().for_each(|failure| self.note(failure));
    }

    /// Takes in what has arrived: all of it; in live runs no more than the upload budget, where a window's render
    /// thread does not keep to that itself.
    /// Gives the number of reads that ended and pages that became drawable.
    pub fn receive(&mut self, now_s: f64, sink: &mut dyn PageSink) -> usize {
        self.receive_from(None, now_s, sink)
    }

    /// Takes in all that is under way: waits for it, but not beyond `deadline`.
    pub fn receive_all(&mut self, deadline: Instant, now_s: f64, sink: &mut dyn PageSink) {
        while self.is_reading() {
            let left = deadline.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return;
            }
            let first = self.server.poll_within(left);
            self.receive_from(first, now_s, sink);
            sink.flush();
        }
    }

    fn receive_from(&mut self, mut first: Option<Delivery>, now_s: f64, sink: &mut dyn PageSink) -> usize {
        let (started, budget_bytes) = (Instant::now(), self.upload_rate.budget_bytes(self.frame_ms));
        let (mut taken_bytes, mut unflushed_bytes) = (0, 0);
        let mut taken = 0;
        while self.mode != Mode::Live || taken_bytes < budget_bytes {
            let Some(delivery) = first.take().or_else(|| self.server.poll()) else { break };
            let bytes = self.take_in(delivery, now_s, sink);
            (taken_bytes, unflushed_bytes) = (taken_bytes + bytes, unflushed_bytes + bytes);
            taken += 1;
            // The driver holds what is uploaded a second time until it is told to go on.
            if self.mode != Mode::Live && unflushed_bytes >= FLUSH_BYTES {
                unflushed_bytes = 0;
                sink.flush();
            }
        }
        if self.mode == Mode::Live {
            self.upload_rate.learn(taken_bytes, started.elapsed().as_secs_f64() * 1000.0);
        }
        while let Some((id, uploaded)) = sink.poll() {
            if let Some((page, place)) = self.uploading.remove(&id) {
                self.admit(&page, place, uploaded, now_s, sink);
                taken += 1;
            }
        }
        taken
    }

    /// Gives the bytes that became resident.
    fn take_in(&mut self, delivery: Delivery, now_s: f64, sink: &mut dyn PageSink) -> u64 {
        let Delivery { page: id, place, outcome, read_bytes } = delivery;
        if read_bytes > 0 {
            self.count_read(id, place, read_bytes);
        }
        match outcome {
            Outcome::Loaded(Page::Segment(segment)) => {
                let completion = self.admit_segment(segment);
                if completion == Completion::Broken {
                    self.usage.failed(place.len.into());
                }
                self.complete(id, place, completion, now_s, sink)
            }
            Outcome::Loaded(page) => match sink.upload(&page) {
                Handover::Done(uploaded) => self.admit(&page, place, uploaded, now_s, sink),
                Handover::Later => {
                    self.uploading.insert(id, (page, place));
                    0
                }
            },
            Outcome::Cancelled => self.complete(id, place, Completion::Cancelled, now_s, sink),
            Outcome::Failed(error) => {
                self.note(error.to_string());
                self.usage.failed(read_bytes);
                let broken = matches!(error, ReadError::Broken(_));
                let completion = if broken { Completion::Broken } else { Completion::Failed };
                self.complete(id, place, completion, now_s, sink)
            }
        }
    }

    /// Makes a segment part of the index; nothing of it goes to the GPU.
    fn admit_segment(&mut self, segment: Segment) -> Completion {
        let (cell, memory) = (segment.root(), segment.byte_len() as u64);
        if let Err(error) = self.index.insert_segment(segment) {
            self.note(error.to_string());
            return Completion::Broken;
        }
        self.held.insert(PageId { cell, kind: PageKind::Segment }, Held { gpu: 0, memory });
        self.lifts.look_again();
        Completion::Loaded { bytes: memory }
    }

    /// Makes an uploaded page drawable.
    fn admit(
        &mut self,
        page: &Page,
        place: Place,
        uploaded: Result<u64, ArenaFull>,
        now_s: f64,
        sink: &mut dyn PageSink,
    ) -> u64 {
        let id = page.id();
        let completion = match uploaded {
            Ok(gpu) => {
                let held = Held { gpu, memory: memory_bytes(page) };
                self.gpu_total_bytes += gpu;
                self.gpu_total_bytes -= self.held.insert(id, held).unwrap_or_default().gpu;
                self.cells.insert(page);
                Completion::Loaded { bytes: held.gpu + held.memory }
            }
            Err(full) => {
                self.note(format!("page {:?} of cell {}: {full}", id.kind, id.cell));
                self.usage.failed(place.len.into());
                Completion::Failed
            }
        };
        self.complete(id, place, completion, now_s, sink)
    }

    fn complete(
        &mut self,
        page: PageId,
        place: Place,
        completion: Completion,
        now_s: f64,
        sink: &mut dyn PageSink,
    ) -> u64 {
        self.pictures_in_flight -= u64::from(is_picture(page));
        let bytes = match completion {
            Completion::Loaded { bytes } => {
                self.usage.loaded(page, u64::from(place.len));
                bytes
            }
            Completion::Cancelled | Completion::Failed | Completion::Broken => 0,
        };
        self.manager.complete(Event { page, completion }, now_s);
        self.measure(sink);
        bytes
    }

    /// `read_bytes`: up to the page's end.
    fn count_read(&mut self, page: PageId, place: Place, read_bytes: u64) {
        let (zone, file) = (page.cell.zone(), page.kind.file_of(place));
        let end = place.offset + u64::from(place.len);
        self.traffic.bytes_read += read_bytes;
        self.traffic.seeks += u64::from(self.last_read != Some((zone, file, end.saturating_sub(read_bytes))));
        self.last_read = Some((zone, file, end));
    }

    fn note(&mut self, message: String) {
        if self.messages.len() < MESSAGES_MAX {
            self.messages.push(message);
        }
    }

    /// Messages of failures since the last call.
    pub fn take_messages(&mut self) -> Vec<String> {
        std::mem::take(&mut self.messages)
    }

    /// Tells the request manager what is wanted and passes on its commands; true when a page that `selection` draws
    /// was dropped, so that it must be made again.
    /// `rider`, with the runs that it wants, where a layout is flown by.
    pub fn manage(
        &mut self,
        selection: &Selection,
        demands: &[Demand],
        ridden: Option<(&mut Rider, &Ride)>,
        now_s: f64,
        sink: &mut dyn PageSink,
    ) -> bool {
        // What is on its way out is no fragmentation: the pool would shrink by it, and more would have to go.
        let stays = self.fragmented_bytes(sink).saturating_sub(sink.usage().leaving);
        let pool = self.partition.pool_bytes(stays);
        self.manager.set_limits(Limits { footprint_bytes: pool, ..self.limits });
        let before = self.manager.stats().reads;
        let mut orders = self.command(&selection.demands, demands, now_s);
        if let Some((rider, ride)) = ridden {
            self.start_runs(ride, before, rider, now_s, &mut orders);
        }
        let drawn: HashSet<PageId> =
            if orders.evict.is_empty() { HashSet::new() } else { drawn_pages(selection).collect() };
        let mut hurt = false;
        for page in orders.evict {
            self.drop_page(page, sink);
            hurt |= drawn.contains(&page);
        }
        self.start(orders.start, now_s, sink);
        self.measure(sink);
        hurt
    }

    fn command(&mut self, front: &[Demand], demands: &[Demand], now_s: f64) -> Orders {
        let mut orders = Orders::default();
        let commands = self.manager.update_for(front, demands, now_s);
        self.sort(commands, &mut orders);
        orders
    }

    fn sort(&mut self, commands: Vec<Command>, orders: &mut Orders) {
        for command in commands {
            match command {
                Command::Start(read) => orders.start.push(read),
                // What is read already comes in, wanted or not.
                Command::Cancel(page) if self.uploading.contains_key(&page) => {}
                Command::Cancel(page) => self.server.cancel(page),
                Command::Evict(page) => orders.evict.push(page),
            }
        }
    }

    /// Starts what a layout has for this step; `before`: reads before it.
    fn start_runs(&mut self, ride: &Ride, before: u64, rider: &mut Rider, now_s: f64, orders: &mut Orders) {
        for run in ride.runs.iter().filter(|run| run.cause != RunCause::Ahead) {
            let started = self.manager.start_run(&run.pages, now_s);
            if started.is_cut {
                rider.note_cut();
            }
            self.sort(started.commands, orders);
        }
        if ride.crossed {
            rider.note_reads(self.manager.stats().reads - before);
        }
        for run in ride.runs.iter().filter(|run| run.cause == RunCause::Ahead) {
            let started = self.manager.start_run(&run.pages, now_s);
            self.sort(started.commands, orders);
        }
    }

    /// Passes reads to the server, the most urgent first, as far as the footprint allows: what was dropped for them may
    /// have left holes in the arenas that only later frames close.
    fn start(&mut self, mut reads: Vec<RangeRead>, now_s: f64, sink: &dyn PageSink) {
        let pages = reads.iter().flat_map(|read| &read.pages);
        self.pictures_in_flight += pages.filter(|page| is_picture(page.0)).count() as u64;
        while self.held_bytes(sink) > self.partition.footprint
            && let Some(read) = reads.pop()
        {
            self.take_back(&read.pages, now_s);
        }
        for read in reads {
            let pages = read.pages.clone();
            if self.server.start(read) {
                self.traffic.requests += 1;
            } else {
                self.take_back(&pages, now_s);
            }
        }
    }

    fn take_back(&mut self, pages: &[(PageId, Place)], now_s: f64) {
        for &(page, _) in pages {
            self.pictures_in_flight -= u64::from(is_picture(page));
            self.manager.complete(Event { page, completion: Completion::Cancelled }, now_s);
        }
    }

    fn drop_page(&mut self, page: PageId, sink: &mut dyn PageSink) {
        if page.kind == PageKind::Segment {
            self.index.remove_segment(page.cell);
            self.held.remove(&page);
            self.usage.dropped(page);
            return;
        }
        self.cells.remove(page);
        let held = self.held.remove(&page).unwrap_or_default();
        sink.remove(page, held.gpu, held.memory);
        self.gpu_total_bytes -= held.gpu;
        self.usage.dropped(page);
        self.lifts.forget(page);
    }

    /// What the arenas hold beyond the pages in them and the pictures on their way into them, and what is lent.
    fn fragmented_bytes(&self, sink: &dyn PageSink) -> u64 {
        let usage = sink.usage();
        let arenas = usage.allocated.saturating_sub(usage.meshes);
        usage.lent + arenas.saturating_sub(self.gpu_total_bytes + self.pictures_in_flight * PICTURE_GPU_BYTES)
    }

    /// All that is held or spoken for; the meshes' arena counts with its limit.
    fn held_bytes(&self, sink: &dyn PageSink) -> u64 {
        self.partition.fixed_bytes() + self.manager.footprint_bytes() + self.fragmented_bytes(sink)
    }

    fn measure(&mut self, sink: &dyn PageSink) {
        self.footprint_max_bytes = self.footprint_max_bytes.max(self.held_bytes(sink));
    }

    /// The highest footprint since the last call, what is held now included.
    pub fn take_footprint_max(&mut self, sink: &dyn PageSink) -> u64 {
        self.measure(sink);
        std::mem::take(&mut self.footprint_max_bytes)
    }

    pub fn gpu_limits(&self) -> GpuLimits {
        self.partition.gpu_limits()
    }

    pub fn is_reading(&self) -> bool {
        self.server.in_flight() > 0 || !self.uploading.is_empty()
    }

    /// Takes another index, whole in memory, that holds all that the one before does.
    pub fn set_index(&mut self, index: IndexForest) {
        self.index = index;
        self.lifts.start_over();
    }

    /// Divides another footprint from the next update on.
    pub fn set_partition(&mut self, partition: Partition) {
        self.partition = partition;
        // What was held under another limit is none of the new one's.
        self.footprint_max_bytes = 0;
    }
}

/// The servers behind what live runs are asked to be held back by; themselves where that is nothing.
fn throttled(servers: Box<dyn PageServer>, params: &EngineParams) -> Box<dyn PageServer> {
    if params.storage.is_none() && params.faults == Faults::NONE {
        return servers;
    }
    let model = params.storage.unwrap_or(StorageModel::DIRECT);
    Box::new(ThrottledServer::new(servers, Disk::new(model, params.faults, params.seed)))
}

/// Bytes that a resident page holds beside the GPU: pictures and meshes of objects go there whole.
fn memory_bytes(page: &Page) -> u64 {
    match page {
        Page::Terrain(terrain) => terrain.byte_len() as u64,
        Page::Imagery(_) => 0,
        Page::Segment(segment) => segment.byte_len() as u64,
        Page::Objects(objects, _) => (objects.byte_len() + objects.objects.len() * LIFT_BYTES_PER_OBJECT) as u64,
    }
}
