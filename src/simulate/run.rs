//! One flight by the virtual clock.

use super::bound::{Budget, FrameBound};
use super::pages::Library;
use crate::camera::{FlightPath, View};
use crate::cells::LiveTree;
use crate::content::{Page, PageId, PageKind};
use crate::forest::index::{IndexForest, Place};
use crate::layout::{Ride, RideCounts, Rider, Run, RunCause, times_ahead_s};
use crate::paging::{
    Command, Completion, DrawnLevels, DrawnTolerance, Event, Frame as Seen, FrameReport, Lack, Limits, ManagerError,
    Modelled, Planner, PlannerParams, PolicyName, RangeRead, ReadError, RequestManager, Totals, Usage, drawn_pages,
    held_bytes, least_footprint_bytes, pinned_demands,
};
use crate::select::{Demand, DrawPiece, ObjectsMode, SelectParams, Selection, Urgency, needed_and_seen, select_raised};
use crate::storage::{Counters, Disk, Faults, PartOutcome, Request, StorageModel};
use crate::units::ByteSize;
use std::collections::{HashMap, HashSet};
use std::sync::Arc;

/// Workspace of one decoder, bytes: set aside of the footprint beside the index.
pub const FIXED_BYTES: u64 = 2 << 20;
/// Pages that may be under way at most.
const PAGES_IN_FLIGHT_MAX: usize = 4096;
/// Frames that wait for their pages wait no longer than this for one that never comes, seconds.
const SYNC_WAIT_MAX_S: f64 = 60.0;

/// How a flight is run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Setup {
    pub storage: StorageModel,
    pub faults: Faults,
    pub seed: u64,
    pub planner: PlannerParams,
    /// Each frame reads what it lacks, and waits for it: the baseline that Funkhouser 1996, §6 compares with.
    pub sync_reads: bool,
    pub tolerance_px: f64,
    pub threshold_px: f64,
    pub objects: ObjectsMode,
    pub footprint: ByteSize,
    pub size_px: [u32; 2],
    /// From frame to frame, seconds.
    pub step_s: f64,
    /// Whether the lower bound of debt is computed for each frame; a world whose index is paged has none.
    pub bound: bool,
}

impl Setup {
    pub fn new(storage: StorageModel, step_s: f64) -> Self {
        Self {
            storage,
            faults: Faults::default(),
            seed: 0,
            planner: PlannerParams::default(),
            sync_reads: false,
            tolerance_px: 1.0,
            threshold_px: 1.0,
            objects: ObjectsMode::Groups,
            footprint: ByteSize(256 << 20),
            size_px: [640, 360],
            step_s,
            bound: false,
        }
    }

    /// Whether a layout can be flown by: they are made for what is drawn by default.
    fn rides(&self) -> bool {
        self.objects == SelectParams::DEFAULT.objects
    }

    fn limits(&self, pool_bytes: u64) -> Limits {
        let reads = self.storage.reads(self.step_s);
        Limits {
            footprint_bytes: pool_bytes,
            in_flight: reads.in_flight,
            pages_in_flight: PAGES_IN_FLIGHT_MAX,
            bytes_in_flight: reads.bytes_in_flight,
            read_bytes_per_update: u64::MAX >> 2,
            run_bytes: reads.run_bytes,
            gap_bytes: reads.gap_bytes,
        }
    }

    /// What selections are made by.
    pub fn select_params(&self) -> SelectParams {
        SelectParams {
            tolerance_px: self.tolerance_px,
            threshold_px: self.threshold_px,
            objects: self.objects,
            ..SelectParams::DEFAULT
        }
    }
}

#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SimulationError {
    #[error("a footprint of {asked} cannot work with this world: at least {least} are needed; raise --footprint")]
    FootprintTooSmall { asked: ByteSize, least: ByteSize },
    #[error(transparent)]
    Manager(#[from] ManagerError),
    #[error("the coarsest pages cannot be read: {0}")]
    Pinned(ReadError),
}

/// A frame of a simulated flight.
pub struct Frame {
    pub report: FrameReport,
    pub selection: Selection,
    pub view: View,
}

/// Pages of a range that are still to come, and whether they are wanted.
struct UnderWay {
    pages: Vec<Option<(PageId, Place)>>,
    cancelled: HashSet<PageId>,
}

/// A world, what is resident of it by the virtual clock, and the storage model.
pub struct Simulation<'a> {
    library: &'a Library,
    /// With the segments that are resident.
    index: IndexForest,
    setup: Setup,
    disk: Disk,
    manager: RequestManager,
    planner: Planner,
    /// Where a layout is flown by.
    rider: Option<Rider>,
    cells: LiveTree,
    tolerance: DrawnTolerance,
    usage: Usage,
    levels: DrawnLevels,
    level_switches: u64,
    under_way: HashMap<u64, UnderWay>,
    reads: HashMap<PageId, u64>,
    counted: Totals,
    frames: u64,
    footprint_max_bytes: u64,
    messages: Vec<String>,
}

/// Messages of failures kept for the caller; further ones are only counted.
const MESSAGES_MAX: usize = 16;

impl<'a> Simulation<'a> {
    /// Loads the coarsest pages of all zones; the clock starts after that.
    pub fn new(library: &'a Library, setup: Setup) -> Result<Self, SimulationError> {
        let fixed_bytes = library.fixed_bytes();
        let least = Self::least_footprint(&library.index);
        let Some(pool_bytes) = setup.footprint.0.checked_sub(fixed_bytes).filter(|_| setup.footprint >= least) else {
            return Err(SimulationError::FootprintTooSmall { asked: setup.footprint, least });
        };
        let mut simulation = Self {
            library,
            index: library.index.clone(),
            setup,
            disk: Disk::new(setup.storage, setup.faults, setup.seed),
            manager: RequestManager::for_world(setup.limits(pool_bytes), &library.index)?,
            planner: Planner::new(&setup.planner),
            rider: library.layout.clone().filter(|_| setup.rides()).map(Rider::new),
            cells: LiveTree::default(),
            tolerance: DrawnTolerance::default(),
            usage: Usage::default(),
            levels: DrawnLevels::default(),
            level_switches: 0,
            under_way: HashMap::new(),
            reads: HashMap::new(),
            counted: Totals::default(),
            frames: 0,
            footprint_max_bytes: 0,
            messages: Vec::new(),
        };
        simulation.load_pinned()?;
        Ok(simulation)
    }

    /// The least footprint that can work with a world by the virtual clock.
    pub fn least_footprint(index: &IndexForest) -> ByteSize {
        ByteSize(FIXED_BYTES + index.bytes().fixed() as u64 + least_footprint_bytes(index))
    }

    /// Tells the path, for what may know it; its start is when the clock starts.
    pub fn know(&mut self, path: Arc<FlightPath>) {
        let start_s = path.start_s();
        self.planner.set_way(Some(Arc::new(move |since_s| path.at(start_s + since_s))));
    }

    fn load_pinned(&mut self) -> Result<(), SimulationError> {
        let demands = pinned_demands(&self.index);
        let mut waiting = true;
        while waiting {
            waiting = false;
            for command in self.manager.update(&demands, 0.0) {
                let Command::Start(read) = command else { continue };
                waiting = true;
                for (page, place) in read.pages {
                    let loaded = self.library.page(page, place).map_err(SimulationError::Pinned)?;
                    self.admit(&loaded, 0.0);
                }
            }
        }
        self.manager.forget_pace();
        Ok(())
    }

    fn admit(&mut self, page: &Page, at_s: f64) {
        if let Page::Segment(segment) = page
            && let Err(error) = self.index.insert_segment(segment.clone())
        {
            self.messages.push(error.to_string());
            self.complete(page.id(), Completion::Broken, at_s);
            return;
        }
        self.cells.insert(page);
        self.complete(page.id(), Completion::Loaded { bytes: held_bytes(page) }, at_s);
    }

    fn complete(&mut self, page: PageId, completion: Completion, at_s: f64) {
        self.manager.complete(Event { page, completion }, at_s);
        self.measure();
    }

    fn measure(&mut self) {
        self.footprint_max_bytes = self.footprint_max_bytes.max(self.footprint_bytes());
    }

    /// All that is held or spoken for, bytes.
    pub fn footprint_bytes(&self) -> u64 {
        self.library.fixed_bytes() + self.manager.footprint_bytes()
    }

    /// Takes in what has arrived by a time.
    fn receive(&mut self, to_s: f64) {
        for arrival in self.disk.advance(to_s) {
            let Some(under_way) = self.under_way.get_mut(&arrival.id) else { continue };
            let taken = under_way.pages.get_mut(arrival.part).and_then(Option::take);
            if under_way.pages.iter().all(Option::is_none) {
                self.under_way.remove(&arrival.id);
            }
            let Some((page, place)) = taken else { continue };
            self.reads.remove(&page);
            self.take_in(page, place, arrival.outcome, arrival.at_s);
        }
    }

    fn take_in(&mut self, page: PageId, place: Place, outcome: PartOutcome, at_s: f64) {
        let loaded = match outcome {
            PartOutcome::Ok => self.library.page(page, place),
            PartOutcome::Failed => Err(ReadError::Failed(format!("the storage did not give {page:?}"))),
            PartOutcome::Corrupt => Err(ReadError::Broken(format!("{page:?} came with a wrong checksum"))),
        };
        match loaded {
            Ok(loaded) => {
                self.usage.loaded(page, u64::from(place.len));
                self.admit(&loaded, at_s);
            }
            Err(error) => {
                let broken = matches!(error, ReadError::Broken(_));
                if self.messages.len() < MESSAGES_MAX {
                    self.messages.push(error.to_string());
                }
                self.complete(page, if broken { Completion::Broken } else { Completion::Failed }, at_s);
            }
        }
    }

    /// Messages of failures since the last call.
    pub fn take_messages(&mut self) -> Vec<String> {
        std::mem::take(&mut self.messages)
    }

    /// True when a page that `selection` draws was dropped.
    fn command(&mut self, selection: &Selection, demands: &[Demand], ride: &Ride, now_s: f64) -> bool {
        let before = self.manager.stats().reads;
        let mut commands = self.manager.update_for(&selection.demands, demands, now_s);
        let (ahead, now): (Vec<&Run>, Vec<&Run>) = ride.runs.iter().partition(|run| run.cause == RunCause::Ahead);
        for run in now {
            let started = self.manager.start_run(&run.pages, now_s);
            if let Some(rider) = self.rider.as_mut().filter(|_| started.is_cut) {
                rider.note_cut();
            }
            commands.extend(started.commands);
        }
        if let Some(rider) = self.rider.as_mut().filter(|_| ride.crossed) {
            rider.note_reads(self.manager.stats().reads - before);
        }
        commands.extend(ahead.iter().flat_map(|run| self.manager.start_run(&run.pages, now_s).commands));
        let evicts = commands.iter().any(|command| matches!(command, Command::Evict(_)));
        let drawn: HashSet<PageId> = if evicts { drawn_pages(selection).collect() } else { HashSet::new() };
        let mut hurt = false;
        for command in commands {
            match command {
                Command::Evict(page) => {
                    self.drop_page(page);
                    hurt |= drawn.contains(&page);
                }
                Command::Cancel(page) => self.cancel(page, now_s),
                Command::Start(read) => self.start(read, now_s),
            }
        }
        self.measure();
        hurt
    }

    fn drop_page(&mut self, page: PageId) {
        if page.kind == PageKind::Segment {
            self.index.remove_segment(page.cell);
        }
        self.cells.remove(page);
        self.usage.dropped(page);
    }

    fn start(&mut self, read: RangeRead, now_s: f64) {
        let ends = read.pages.iter().map(|(_, place)| place.offset + u64::from(place.len) - read.offset).collect();
        let request = Request { id: read.id, file: read.file_number(), offset: read.offset, parts: ends };
        let started = self.disk.start(request, now_s);
        for &(page, _) in &read.pages {
            if started {
                self.reads.insert(page, read.id);
            } else {
                self.complete(page, Completion::Cancelled, now_s);
            }
        }
        if started {
            let pages = read.pages.into_iter().map(Some).collect();
            self.under_way.insert(read.id, UnderWay { pages, cancelled: HashSet::new() });
        }
    }

    /// A range is given up once none of its pages is wanted.
    fn cancel(&mut self, page: PageId, now_s: f64) {
        let Some(&id) = self.reads.get(&page) else { return };
        let Some(under_way) = self.under_way.get_mut(&id) else { return };
        under_way.cancelled.insert(page);
        if under_way.pages.iter().flatten().any(|(page, _)| !under_way.cancelled.contains(page)) {
            return;
        }
        self.disk.cancel(id, now_s);
        let pages: Vec<PageId> = under_way.pages.iter().flatten().map(|page| page.0).collect();
        self.under_way.remove(&id);
        for page in pages {
            self.reads.remove(&page);
            self.complete(page, Completion::Cancelled, now_s);
        }
    }

    fn choose(&mut self, view: &View) -> Selection {
        let mut tolerance = std::mem::take(&mut self.tolerance);
        let selection = tolerance.settle(
            |factor| self.select_at(view, factor),
            |selection, _| (!self.manager.fits(&selection.demands)).then_some(Lack::Memory),
        );
        self.tolerance = tolerance;
        selection
    }

    fn select_at(&self, view: &View, factor: f64) -> Selection {
        let params = self.setup.select_params();
        select_raised(&self.index, &self.cells, view, &params, params.tolerance_px * factor)
    }

    fn plan(&mut self, view: &View, selection: &Selection, now_s: f64) -> (Vec<Demand>, Ride) {
        let seen = Seen {
            index: &self.index,
            cells: &self.cells,
            manager: &self.manager,
            view,
            now_s,
            step_s: self.setup.step_s,
            params: &self.setup.select_params(),
            drawn_tolerance_px: self.setup.tolerance_px * self.tolerance.factor(),
        };
        let demands = if self.setup.sync_reads {
            selection.demands.clone()
        } else {
            self.planner.plan(&seen, &selection.demands)
        };
        let Some(rider) = &mut self.rider else { return (demands, Ride::default()) };
        let (manager, index) = (&self.manager, &self.index);
        let times_s = &times_ahead_s(manager.pace().lead_secs() + self.setup.step_s);
        let eyes = if manager.lacks_front() { Vec::new() } else { self.planner.eyes_ahead(&seen, times_s) };
        let thresholds = (self.setup.tolerance_px, self.setup.threshold_px);
        let ride = rider.step(view, thresholds, &eyes, &|page| manager.is_held(page));
        let demands = rider.demands(demands, &ride.runs, &|page| manager.is_held(page), &|page| page.place(index));
        (demands, ride)
    }

    /// Whether a frame that waits has something to wait for: of a layout's run, what other directions need is none of it.
    fn is_waited_for(&self, selection: &Selection) -> bool {
        if self.rider.is_none() {
            return !self.manager.is_idle();
        }
        let lacks = |demand: &Demand| demand.urgency > Urgency::Predicted && !self.manager.is_resident(demand.page);
        self.still_wanted(selection).iter().any(lacks)
    }

    /// What a frame that waits still asks for.
    fn still_wanted(&self, selection: &Selection) -> Vec<Demand> {
        let demands = selection.demands.clone();
        let Some(rider) = &self.rider else { return demands };
        let (manager, index) = (&self.manager, &self.index);
        rider.demands(demands, &[], &|page| manager.is_held(page), &|page| page.place(index))
    }

    /// What went on along the layout; `None` where none is flown by.
    pub fn ride_counts(&self) -> Option<RideCounts> {
        self.rider.as_ref().map(Rider::counts)
    }

    /// Drops all pages that the last frame did not want; see [`RequestManager::drop_unwanted`].
    pub fn drop_unwanted(&mut self) {
        for command in self.manager.drop_unwanted() {
            if let Command::Evict(page) = command {
                self.drop_page(page);
            }
        }
    }

    /// Requests, seeks and bytes of the storage so far.
    pub fn traffic(&self) -> Counters {
        self.disk.counters()
    }

    /// The frame at a time since the start of the clock, which must not fall.
    pub fn frame(&mut self, view: &View, t_s: f64) -> Frame {
        self.receive(t_s);
        let mut selection = self.choose(view);
        let would_have_waited = selection.stats.pages_missing > 0;
        let (demands, ride) = self.plan(view, &selection, t_s);
        if self.command(&selection, &demands, &ride, t_s) {
            selection = self.select_at(view, self.tolerance.factor());
        }
        let mut waited_s = 0.0;
        if self.setup.sync_reads {
            waited_s = self.wait(view, t_s, &mut selection);
        }
        self.usage.drawn(&selection);
        self.level_switches += u64::from(self.levels.switch(selection.pieces.iter().map(DrawPiece::page_cell)));
        let mut report = self.report(&selection, t_s);
        report.would_have_waited = would_have_waited;
        report.waited_s = waited_s;
        Frame { report, selection, view: *view }
    }

    /// Lets the clock go on until the frame's front is there; gives the time that took.
    fn wait(&mut self, view: &View, t_s: f64, selection: &mut Selection) -> f64 {
        let mut now_s = t_s;
        while self.is_waited_for(selection)
            && now_s - t_s < SYNC_WAIT_MAX_S
            && let Some(next_s) = self.disk.next_event_s()
        {
            now_s = next_s.max(now_s);
            self.receive(now_s);
            *selection = self.choose(view);
            let demands = self.still_wanted(selection);
            self.command(selection, &demands, &Ride::default(), now_s);
        }
        now_s - t_s
    }

    fn totals(&self) -> Totals {
        let (stats, traffic) = (self.manager.stats(), self.disk.counters());
        Totals {
            level_switches: self.level_switches,
            bytes_read: traffic.bytes,
            seeks: traffic.seeks,
            requests: traffic.requests,
            ..Totals::of(&stats)
        }
    }

    fn report(&mut self, selection: &Selection, t_s: f64) -> FrameReport {
        let (stats, selected) = (self.manager.stats(), &selection.stats);
        let mut report = FrameReport {
            frame: self.frames,
            t_s,
            tolerance_drawn_px: self.setup.tolerance_px * self.tolerance.factor(),
            lack: self.tolerance.lack(),
            cells_drawn: selection.pieces.len() as u32,
            triangles: selected.triangles,
            ground_pressed: selection.press.is_some_and(|press| press.buries_eye()),
            front_size_bytes: self.manager.front_bytes(),
            in_flight: stats.in_flight,
            resident_pages: stats.resident_pages,
            footprint_bytes: std::mem::take(&mut self.footprint_max_bytes).max(self.footprint_bytes()),
            ..FrameReport::default()
        };
        report.take_measures(selected);
        let totals = self.totals();
        report.count(&std::mem::replace(&mut self.counted, totals), &totals);
        self.frames += 1;
        report
    }

    /// Stored bytes that were read and never drawn, were the flight to end now.
    pub fn wasted_bytes(&self) -> u64 {
        // All that came beside pages that were drawn: gaps, failures and what was cancelled too.
        self.disk.counters().bytes.saturating_sub(self.usage.drawn_bytes())
    }

    /// With the segments that are resident.
    pub fn index(&self) -> &IndexForest {
        &self.index
    }

    pub fn manager(&self) -> &RequestManager {
        &self.manager
    }

    /// What a frame draws and holds beyond what its picture needs.
    pub fn modelled(&self, frame: &Frame) -> Modelled {
        let (view, params) = (&frame.view, self.setup.select_params());
        let (needed, seen) = needed_and_seen(&self.index, view, &params, self.library);
        Modelled::of(view, &frame.selection, &needed, Some(&seen), self.usage.resident_bytes())
    }

    /// What can be drawn.
    pub fn cells(&self) -> &LiveTree {
        &self.cells
    }

    /// Whether nothing is under way, and nothing more of the front will come.
    pub fn is_settled(&self) -> bool {
        self.manager.is_idle() && self.manager.stats().in_flight == 0 && !self.tolerance.is_moving()
    }

    /// What the lower bound of debt may count on at a time since the clock started.
    pub fn budget_of(library: &Library, setup: &Setup, since_s: f64) -> Budget {
        let fixed_bytes = library.fixed_bytes();
        Budget {
            read_bytes: super::bound::bytes_by(&setup.storage, since_s),
            held_bytes: setup.footprint.0.saturating_sub(fixed_bytes),
        }
    }
}

/// Flies a path from its start to its end, frame by frame. `each` takes every frame, and ends the flight with `false`.
/// Gives the bytes that were read and never drawn.
pub fn fly(
    library: &Library,
    path: &Arc<FlightPath>,
    setup: Setup,
    mut each: impl FnMut(Frame, &mut Simulation<'_>) -> bool,
) -> Result<u64, SimulationError> {
    let mut simulation = Simulation::new(library, setup)?;
    if setup.planner.policy == PolicyName::Oracle {
        simulation.know(path.clone());
    }
    let start_s = path.start_s();
    // A step that divides the flight must reach its end in spite of rounding.
    let last = (path.duration_s() / setup.step_s + 1e-6).floor() as u64;
    let mut at = 0;
    while at <= last {
        let since_s = at as f64 * setup.step_s;
        let view = View::new(path.at(start_s + since_s), path.fovy_rad(), setup.size_px);
        let mut frame = simulation.frame(&view, since_s);
        let waited_s = frame.report.waited_s;
        frame.report.t_s = start_s + since_s;
        // Runs of a layout may be longer than what the bound takes for one request.
        if setup.bound && library.index.is_whole() && library.layout.is_none() {
            let bound = FrameBound::new(&library.index, &view, &setup.select_params());
            frame.report.debt_bound_px =
                Some(bound.debt_px(&Simulation::budget_of(library, &setup, since_s + waited_s)));
        }
        if !each(frame, &mut simulation) {
            break;
        }
        // A frame that waited is followed by the first one after it.
        at += 1 + (waited_s / setup.step_s).ceil() as u64;
    }
    Ok(simulation.wasted_bytes())
}
