//! Pages on their way in and out: between selection, request manager, servers, live tree and GPU.

use super::footprint::{IN_FLIGHT_MAX, Partition, READ_BYTES_PER_FRAME, THREADS_PER_LAYER, UPLOAD_BYTES_PER_FRAME};
use super::lift::{LIFT_BYTES_PER_OBJECT, Lifts};
use super::usage::{Usage, drawn_pages};
use super::{EngineError, EngineParams, Mode, Source};
use crate::cells::LiveTree;
use crate::content::{Page, PageId, PageKind};
use crate::forest::Zone;
use crate::forest::index::{IndexForest, Place};
use crate::paging::{
    Command, Completion, Delivery, Event, InlineServer, Limits, Outcome, PageServer, ReadError,
    RequestManager, ServerLimits, ThreadedServers,
};
use crate::render::Renderer;
use crate::select::{Demand, Selection, Urgency};
use std::collections::{HashMap, HashSet};

/// Messages of failures kept for the caller; further ones are only counted.
const MESSAGES_MAX: usize = 16;

/// What went on since the frame began.
#[derive(Clone, Copy, Debug, Default)]
pub struct Traffic {
    pub bytes_read: u64,
    pub seeks: u64,
    pub footprint_max_bytes: u64,
}

/// What is resident, and the machinery that changes it.
pub struct Residency {
    pub cells: LiveTree,
    pub manager: RequestManager,
    pub usage: Usage,
    pub lifts: Lifts,
    pub traffic: Traffic,
    partition: Partition,
    limits: Limits,
    mode: Mode,
    server: Box<dyn PageServer>,
    /// Bytes on the GPU of each resident page.
    gpu_bytes: HashMap<PageId, u64>,
    gpu_total_bytes: u64,
    last_read: Option<(Zone, u64)>,
    messages: Vec<String>,
}

impl Residency {
    pub fn new(params: &EngineParams, partition: Partition, source: &Source) -> Result<Self, EngineError> {
        let read_bytes_per_update = if params.mode == Mode::LockStep { READ_BYTES_PER_FRAME } else { u64::MAX >> 2 };
        let limits =
            Limits { footprint_bytes: partition.pool_bytes(0), in_flight: IN_FLIGHT_MAX, read_bytes_per_update };
        let server: Box<dyn PageServer> = if params.mode == Mode::Live {
            let limits = ServerLimits { threads_per_layer: THREADS_PER_LAYER, queue_len: IN_FLIGHT_MAX };
            Box::new(ThreadedServers::start(&source.reader, limits)?)
        } else {
            Box::new(InlineServer::new(source.reader.clone()))
        };
        Ok(Self {
            cells: LiveTree::default(),
            manager: RequestManager::for_world(limits, &source.index)?,
            usage: Usage::default(),
            lifts: Lifts::default(),
            traffic: Traffic::default(),
            partition,
            limits,
            mode: params.mode,
            server,
            gpu_bytes: HashMap::new(),
            gpu_total_bytes: 0,
            last_read: None,
            messages: Vec::new(),
        })
    }

    /// Loads the coarsest pages of all zones, so that the first frame already has the globe. This is the only time
    /// that anything waits for a page.
    pub fn load_pinned(&mut self, source: &Source, renderer: &mut Renderer) {
        let usual = std::mem::replace(&mut self.server, Box::new(InlineServer::new(source.reader.clone())));
        self.manager.set_limits(Limits { read_bytes_per_update: u64::MAX >> 2, ..self.limits });
        let demands = pinned_demands(&source.index);
        loop {
            self.command(&demands, 0.0);
            if self.server.in_flight() == 0 {
                break;
            }
            self.receive(0.0, renderer);
        }
        self.manager.set_limits(self.limits);
        self.server = usual;
    }

    /// Takes in what has arrived: all of it, in live runs no more than the upload budget.
    pub fn receive(&mut self, now_s: f64, renderer: &mut Renderer) {
        let mut taken_bytes = 0;
        while self.mode != Mode::Live || taken_bytes < UPLOAD_BYTES_PER_FRAME {
            let Some(delivery) = self.server.poll() else { break };
            let (page, place) = (delivery.page, delivery.place);
            let completion = self.take_in(delivery, renderer);
            if let Completion::Loaded { bytes } = completion {
                taken_bytes += bytes;
                self.usage.loaded(page, u64::from(place.len));
            }
            self.manager.complete(Event { page, completion }, now_s);
            self.measure(renderer);
        }
    }

    fn take_in(&mut self, delivery: Delivery, renderer: &mut Renderer) -> Completion {
        if !matches!(delivery.outcome, Outcome::Cancelled) {
            self.count_read(delivery.page, delivery.place);
        }
        match delivery.outcome {
            Outcome::Loaded(page) => self.admit(&page, renderer),
            Outcome::Cancelled => Completion::Cancelled,
            Outcome::Failed(error) => {
                self.note(error.to_string());
                if matches!(error, ReadError::Broken(_)) { Completion::Broken } else { Completion::Failed }
            }
        }
    }

    /// Uploads a page and makes it drawable.
    fn admit(&mut self, page: &Page, renderer: &mut Renderer) -> Completion {
        match renderer.upload(page) {
            Ok(gpu_bytes) => {
                let id = page.id();
                self.gpu_total_bytes += gpu_bytes;
                self.gpu_total_bytes -= self.gpu_bytes.insert(id, gpu_bytes).unwrap_or(0);
                self.cells.insert(page);
                Completion::Loaded { bytes: gpu_bytes + memory_bytes(page) }
            }
            Err(full) => {
                self.note(format!("page {:?} of cell {}: {full}", page.id().kind, page.id().cell));
                Completion::Failed
            }
        }
    }

    fn count_read(&mut self, page: PageId, place: Place) {
        let zone = page.cell.zone();
        self.traffic.bytes_read += u64::from(place.len);
        self.traffic.seeks += u64::from(self.last_read != Some((zone, place.offset)));
        self.last_read = Some((zone, place.offset + u64::from(place.len)));
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
    pub fn manage(&mut self, selection: &Selection, now_s: f64, renderer: &mut Renderer) -> bool {
        self.give_pool(renderer);
        let evicted = self.command(&selection.demands, now_s);
        let drawn: HashSet<PageId> =
            if evicted.is_empty() { HashSet::new() } else { drawn_pages(selection).collect() };
        let mut hurt = false;
        for page in evicted {
            self.drop_page(page, renderer);
            hurt |= drawn.contains(&page);
        }
        self.measure(renderer);
        hurt
    }

    /// Passes commands to the server and returns what is to be dropped.
    fn command(&mut self, demands: &[Demand], now_s: f64) -> Vec<PageId> {
        let mut evicted = Vec::new();
        for command in self.manager.update(demands, now_s) {
            match command {
                Command::Start { page, place } => {
                    if !self.server.start(page, place) {
                        self.manager.complete(Event { page, completion: Completion::Cancelled }, now_s);
                    }
                }
                Command::Cancel(page) => self.server.cancel(page),
                Command::Evict(page) => evicted.push(page),
            }
        }
        evicted
    }

    fn drop_page(&mut self, page: PageId, renderer: &mut Renderer) {
        self.cells.remove(page);
        renderer.remove(page);
        self.gpu_total_bytes -= self.gpu_bytes.remove(&page).unwrap_or(0);
        self.usage.dropped(page);
        self.lifts.forget(page);
    }

    /// What the arenas hold beyond their pages is not the request manager's to give.
    fn give_pool(&mut self, renderer: &Renderer) {
        let fragmented = self.arena_bytes(renderer).saturating_sub(self.gpu_total_bytes);
        self.manager
            .set_limits(Limits { footprint_bytes: self.partition.pool_bytes(fragmented), ..self.limits });
    }

    /// Allocated for pages on the GPU; the meshes' arena counts with its limit.
    fn arena_bytes(&self, renderer: &Renderer) -> u64 {
        renderer.allocated_bytes().saturating_sub(renderer.mesh_bytes())
    }

    fn measure(&mut self, renderer: &Renderer) {
        let fragmented = self.arena_bytes(renderer).saturating_sub(self.gpu_total_bytes);
        let now = self.partition.fixed_bytes() + self.manager.footprint_bytes() + fragmented;
        self.traffic.footprint_max_bytes = self.traffic.footprint_max_bytes.max(now);
    }

    /// The figures since the last call; the footprint starts from what is held now.
    pub fn take_traffic(&mut self, renderer: &Renderer) -> Traffic {
        let traffic = std::mem::take(&mut self.traffic);
        self.measure(renderer);
        traffic
    }
}

/// Bytes that a resident page holds beside the GPU: pictures and meshes of objects go there whole.
fn memory_bytes(page: &Page) -> u64 {
    match page {
        Page::Terrain(terrain) => terrain.byte_len() as u64,
        Page::Imagery(_) => 0,
        Page::Objects(objects, _) => (objects.byte_len() + objects.objects.len() * LIFT_BYTES_PER_OBJECT) as u64,
    }
}

fn pinned_demands(index: &IndexForest) -> Vec<Demand> {
    let roots = index.trees().map(|tree| tree.root());
    let demand = |page, place| Demand { page, place, urgency: Urgency::Blocking, gain: f64::INFINITY };
    roots
        .flat_map(|root| {
            let cell = root.cell();
            let terrain = root.terrain().map(|entry| demand(PageId { cell, kind: PageKind::Terrain }, entry.place));
            let imagery = root.imagery().map(|place| demand(PageId { cell, kind: PageKind::Imagery }, place));
            [terrain, imagery]
        })
        .flatten()
        .collect()
}
