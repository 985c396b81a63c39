//! The request manager: a value. Demands in, commands out, completions in.
//!
//! The footprint is hard: a page is asked for only when what is held, what is under way and its own estimate fit; a
//! sixteenth of the footprint is kept back for pages that turn out larger than their estimate. Room is made before
//! anything is read for it. What is dropped first is what is not demanded now, the least recently demanded first; then
//! what is only predicted, by ascending gain (see [`residents`]). The front is never dropped for itself: where it does
//! not fit, [`RequestManager::fits`] says so, and the tolerance is raised.
//!
//! Pages that lie together are read as one range: around each page that is due, those that are wanted too and lie no
//! further than a gap apart are taken along (see [`runs`]).

mod progress;
mod residents;
mod runs;

pub use progress::{LayerCounts, PageCounts, PageState};
pub use runs::RangeRead;

use super::estimate::{Estimator, largest_bytes};
use super::order::{is_front, ranked};
use super::pace::Pace;
use crate::content::{LAYOUT_AT, PageId, PageKind};
use crate::forest::index::{IndexForest, Place};
use crate::select::{Demand, Urgency};
use crate::units::ByteSize;
use residents::Residents;
use runs::Waiting;
use std::collections::{BTreeMap, HashMap, HashSet};

/// Hard limits, each of which is named in the report.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// All bytes held: decoded pages, GPU parts, reads under way.
    pub footprint_bytes: u64,
    /// Ranges under way, and pages in them.
    pub in_flight: usize,
    pub pages_in_flight: usize,
    /// Stored bytes under way: more than the storage can bring meanwhile would only hold up what is urgent.
    pub bytes_in_flight: u64,
    /// Bytes that one update may start to read.
    pub read_bytes_per_update: u64,
    /// Longest range that is read at once for pages that lie together, bytes; a page longer than this is read alone.
    pub run_bytes: u32,
    /// Most unwanted bytes between two pages that are read at once.
    pub gap_bytes: u32,
}

#[derive(Clone, Debug, PartialEq)]
pub enum Command {
    Start(RangeRead),
    Cancel(PageId),
    Evict(PageId),
}

/// What became of a run of a layout.
#[derive(Clone, Debug, PartialEq)]
pub struct RunStart {
    pub commands: Vec<Command>,
    /// Some of its pages were left out for lack of room.
    pub is_cut: bool,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Completion {
    /// Resident now, with the bytes it holds in memory and on the GPU.
    Loaded { bytes: u64 },
    /// To be tried again after a while.
    Failed,
    /// Never to be tried again: the page is broken.
    Broken,
    /// Dropped on a [`Command::Cancel`]; nothing is held any more.
    Cancelled,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Event {
    pub page: PageId,
    pub completion: Completion,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct ManagerStats {
    /// Pages asked for, and the ranges that they were read in.
    pub started: u64,
    pub reads: u64,
    /// Stored bytes of pages that a frame's own front lacked when they were asked for, and of those that were fetched
    /// ahead of it.
    pub front_bytes_started: u64,
    pub ahead_bytes_started: u64,
    pub cancelled: u64,
    pub failed: u64,
    pub evicted: u64,
    pub resident_pages: u64,
    pub resident_bytes: u64,
    pub in_flight: u64,
}

#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ManagerError {
    #[error("a footprint of {asked} cannot work here: at least {least} are needed; raise --footprint")]
    FootprintTooSmall { asked: ByteSize, least: ByteSize },
}

/// Share of the footprint that is kept back for pages larger than their estimate: 1/16.
const RESERVE_SHIFT: u32 = 4;
/// The first wait before a failed page is tried again; it doubles with each failure, up to [`RETRY_MAX_SECS`].
const RETRY_FIRST_SECS: f64 = 0.25;
const RETRY_MAX_SECS: f64 = 30.0;
/// Failures after which waiting for a page is given up when everything else is there; it is still tried again.
const ATTEMPTS_TO_SETTLE: u32 = 3;
/// By how much a predicted page must promise more per byte than a resident one that gives way to it: else two that are
/// alike would drive each other out in turns.
const GIVE_WAY_FACTOR: f64 = 2.0;
/// Failed and broken pages remembered; beyond it the first ones in the order of pages are forgotten and tried
/// again.
const FAULTS_MAX: usize = 1 << 16;

#[derive(Clone, Copy, Debug, PartialEq)]
struct UnderWay {
    place: Place,
    reserved_bytes: u64,
    /// The range it is read in.
    read: u64,
    started_secs: f64,
    /// Cancelled, and not yet confirmed: its bytes may still be held.
    cancelled: bool,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Fault {
    Failed { attempts: u32, retry_at_secs: f64 },
    Broken,
}

/// How a page is demanded now.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Wanted {
    urgency: Urgency,
    gain: f64,
    /// When the page was first asked for since it is demanded without a break, seconds.
    asked_at_secs: Option<f64>,
}

pub struct RequestManager {
    limits: Limits,
    estimator: Estimator,
    pace: Pace,
    residents: Residents,
    under_way: HashMap<PageId, UnderWay>,
    /// Pages to come of each range.
    reads: HashMap<u64, usize>,
    next_read: u64,
    wanted: HashMap<PageId, Wanted>,
    faults: BTreeMap<PageId, Fault>,
    reserved_bytes: u64,
    bytes_under_way: u64,
    /// Bytes that may still be read; below 0 after a page larger than an update's share.
    read_credit: i64,
    updates: u64,
    front_bytes: u64,
    /// Pages of the frame's own front.
    front: HashSet<PageId>,
    /// Demanded pages of the front that are neither there nor given up.
    missing: usize,
    /// Whether the last update left a page out for lack of room.
    out_of_room: bool,
    counts: ManagerStats,
}

impl RequestManager {
    pub fn new(limits: Limits) -> Result<Self, ManagerError> {
        let manager = Self {
            limits,
            estimator: Estimator::new(),
            pace: Pace::default(),
            residents: Residents::default(),
            under_way: HashMap::new(),
            reads: HashMap::new(),
            next_read: 0,
            wanted: HashMap::new(),
            faults: BTreeMap::new(),
            reserved_bytes: 0,
            bytes_under_way: 0,
            read_credit: 0,
            updates: 0,
            front_bytes: 0,
            front: HashSet::new(),
            missing: 0,
            out_of_room: false,
            counts: ManagerStats::default(),
        };
        manager.require(2 * largest_bytes())?;
        Ok(manager)
    }

    /// The same for a world: its pinned pages and a page of each layer must fit.
    pub fn for_world(limits: Limits, index: &IndexForest) -> Result<Self, ManagerError> {
        let manager = Self::new(limits)?;
        manager.require(least_plan_bytes(index))?;
        Ok(manager)
    }

    fn require(&self, plan_bytes: u64) -> Result<(), ManagerError> {
        if self.plan_bytes() >= plan_bytes {
            return Ok(());
        }
        Err(ManagerError::FootprintTooSmall {
            asked: ByteSize(self.limits.footprint_bytes),
            least: ByteSize(footprint_for(plan_bytes)),
        })
    }

    /// The footprint less what is kept back.
    fn plan_bytes(&self) -> u64 {
        self.limits.footprint_bytes - (self.limits.footprint_bytes >> RESERVE_SHIFT)
    }

    /// Changes the limits from the next update on, for example to a measured rate.
    pub fn set_limits(&mut self, limits: Limits) {
        self.limits = limits;
    }

    pub fn limits(&self) -> Limits {
        self.limits
    }

    /// How fast pages come.
    pub fn pace(&self) -> &Pace {
        &self.pace
    }

    /// Forgets how fast pages came: what was read while nothing ran says nothing of what follows.
    pub fn forget_pace(&mut self) {
        self.pace = Pace::default();
    }

    /// Demands of the frame in any order, resident pages included; `now_secs` from any start. What is more than
    /// predicted is the frame's front.
    pub fn update(&mut self, demands: &[Demand], now_secs: f64) -> Vec<Command> {
        let demands = ranked(demands);
        self.update_ranked(&demands, &demands, now_secs)
    }

    /// The same for a frame whose front is that of `front`: by it reads are counted as the frame's own or as ahead of it.
    /// `front` names each page once.
    pub fn update_for(&mut self, front: &[Demand], demands: &[Demand], now_secs: f64) -> Vec<Command> {
        self.update_ranked(front, &ranked(demands), now_secs)
    }

    fn update_ranked(&mut self, front: &[Demand], demands: &[Demand], now_secs: f64) -> Vec<Command> {
        self.front_bytes = self.front_bytes_of(front);
        self.front.clear();
        self.front.extend(front.iter().filter(|demand| is_front(demand)).map(|demand| demand.page));
        self.updates += 1;
        self.refill();
        self.note_wanted(demands);
        let mut commands = Vec::new();
        self.cancel_unwanted(&mut commands);
        self.get_under_limit(demands, &mut commands);
        self.start_wanted(demands, now_secs, &mut commands);
        self.missing = demands.iter().filter(|demand| is_front(demand) && self.is_awaited(demand.page)).count();
        commands
    }

    fn refill(&mut self) {
        let share = i64::try_from(self.limits.read_bytes_per_update).unwrap_or(i64::MAX / 2).min(i64::MAX / 2);
        self.read_credit = self.read_credit.min(0).saturating_add(share.max(1));
    }

    fn note_wanted(&mut self, demands: &[Demand]) {
        let before = std::mem::take(&mut self.wanted);
        for demand in demands {
            let asked_at_secs = before.get(&demand.page).and_then(|known| known.asked_at_secs);
            let wanted = Wanted { urgency: demand.urgency, gain: demand.gain, asked_at_secs };
            self.wanted.insert(demand.page, wanted);
            self.residents.want(demand.page);
        }
        let mut left: Vec<PageId> = before.into_keys().filter(|page| !self.wanted.contains_key(page)).collect();
        left.sort();
        left.into_iter().for_each(|page| self.residents.leave(page, self.updates));
    }

    fn is_wanted(&self, page: PageId) -> bool {
        self.wanted.contains_key(&page)
    }

    fn cancel_unwanted(&mut self, commands: &mut Vec<Command>) {
        let wanted = &self.wanted;
        let unwanted =
            self.under_way.iter_mut().filter(|(page, under_way)| !under_way.cancelled && !wanted.contains_key(page));
        let mut pages: Vec<PageId> = unwanted
            .map(|(&page, under_way)| {
                under_way.cancelled = true;
                page
            })
            .collect();
        pages.sort();
        self.counts.cancelled += pages.len() as u64;
        commands.extend(pages.into_iter().map(Command::Cancel));
    }

    /// Drops pages when some came in larger than estimated, the front last.
    fn get_under_limit(&mut self, demands: &[Demand], commands: &mut Vec<Command>) {
        while self.held_bytes() > self.limits.footprint_bytes
            && let Some(page) = self.residents.least_recent()
        {
            self.evict(page, commands);
        }
        for demand in demands.iter().rev() {
            if self.held_bytes() <= self.limits.footprint_bytes {
                return;
            }
            self.evict(demand.page, commands);
        }
    }

    fn start_wanted(&mut self, demands: &[Demand], now_secs: f64, commands: &mut Vec<Command>) {
        self.out_of_room = false;
        let mut waiting = None;
        let mut predicted = None;
        for demand in demands {
            if !self.may_start_more() || self.read_credit <= 0 {
                break;
            }
            if !self.may_start(demand.page, now_secs) {
                continue;
            }
            let bytes = self.estimator.arriving_bytes(demand.page.kind, demand.place);
            if bytes > self.plan_bytes() {
                self.out_of_room = true;
                continue;
            }
            let predicted = predicted.get_or_insert_with(|| self.predicted_residents(demands));
            self.make_room(demand, bytes, predicted, commands);
            if self.held_bytes() + bytes > self.plan_bytes() {
                // Lesser demands must not take the room that this one waits for.
                self.out_of_room = true;
                break;
            }
            let waiting = waiting.get_or_insert_with(|| self.waiting(demands, now_secs));
            self.start(demand, waiting, now_secs, commands);
        }
    }

    /// Resident pages that are only predicted, those to drop last first.
    fn predicted_residents(&self, demands: &[Demand]) -> Vec<Demand> {
        let predicted = demands.iter().filter(|demand| !is_front(demand) && self.residents.contains(demand.page));
        predicted.copied().collect()
    }

    fn waiting(&self, demands: &[Demand], now_secs: f64) -> Waiting {
        Waiting::new(demands.iter().filter(|demand| self.may_start(demand.page, now_secs)).copied().collect())
    }

    /// Drops what may be dropped for a page, as far as needed. What is predicted gives way to the front, and to what
    /// promises clearly more.
    fn make_room(&mut self, demand: &Demand, bytes: u64, predicted: &mut Vec<Demand>, commands: &mut Vec<Command>) {
        let gives_way = |other: &Demand| is_front(demand) || GIVE_WAY_FACTOR * other.gain < demand.gain;
        while self.held_bytes() + bytes > self.plan_bytes() {
            if let Some(page) = self.residents.least_recent() {
                self.evict(page, commands);
            } else if let Some(other) = predicted.pop_if(|other| gives_way(other)) {
                self.evict(other.page, commands);
            } else {
                return;
            }
        }
    }

    /// Starts a page, and with it those that lie beside it, as far as there is room for them without dropping anything.
    fn start(&mut self, demand: &Demand, waiting: &mut Waiting, now_secs: f64, commands: &mut Vec<Command>) {
        let mut room = self.plan_bytes() - self.held_bytes();
        let mut places = self.limits.pages_in_flight - self.under_way.len();
        let estimator = self.estimator;
        let run = waiting.take_run(demand, &self.limits, |page, place| {
            let bytes = estimator.arriving_bytes(page.kind, place);
            let fits = bytes <= room && places > 0;
            room -= if fits { bytes } else { 0 };
            places -= usize::from(fits);
            fits
        });
        commands.push(self.note_run(&run, now_secs));
    }

    fn note_run(&mut self, run: &[Demand], now_secs: f64) -> Command {
        let read = self.next_read;
        self.next_read += 1;
        for demand in run {
            self.note_start(demand, read, now_secs);
        }
        self.reads.insert(read, run.len());
        self.pace.note_start(now_secs);
        self.counts.reads += 1;
        let range = RangeRead::new(read, run);
        self.read_credit -= i64::from(range.len);
        Command::Start(range)
    }

    fn note_start(&mut self, demand: &Demand, read: u64, now_secs: f64) {
        if let Some(wanted) = self.wanted.get_mut(&demand.page) {
            wanted.asked_at_secs.get_or_insert(now_secs);
        }
        let reserved_bytes = self.estimator.arriving_bytes(demand.page.kind, demand.place);
        let place = demand.place;
        let under_way = UnderWay { place, reserved_bytes, read, started_secs: now_secs, cancelled: false };
        self.under_way.insert(demand.page, under_way);
        self.reserved_bytes += reserved_bytes;
        self.bytes_under_way += u64::from(place.len);
        self.counts.started += 1;
        let bytes = u64::from(place.len);
        if self.front.contains(&demand.page) {
            self.counts.front_bytes_started += bytes;
        } else {
            self.counts.ahead_bytes_started += bytes;
        }
    }

    /// Starts a run that a single-seek layout has, as one range whatever its length: those of its pages that are neither
    /// here nor on their way, as far as there is room without dropping what is wanted. Call it after
    /// [`RequestManager::update`]; `pages` have their places in the layout, ascending.
    pub fn start_run(&mut self, pages: &[(PageId, Place)], now_secs: f64) -> RunStart {
        let mut commands = Vec::new();
        let mut taken: Vec<Demand> = Vec::new();
        let mut coming_bytes = 0;
        let missing: Vec<_> = pages.iter().filter(|(page, _)| self.may_start(*page, now_secs)).collect();
        let wanted = missing.len();
        for &(page, place) in missing {
            if self.under_way.len() + taken.len() >= self.limits.pages_in_flight {
                break;
            }
            let bytes = self.estimator.arriving_bytes(page.kind, place);
            while self.held_bytes() + coming_bytes + bytes > self.plan_bytes()
                && let Some(page) = self.residents.least_recent()
            {
                self.evict(page, &mut commands);
            }
            if self.held_bytes() + coming_bytes + bytes <= self.plan_bytes() {
                coming_bytes += bytes;
                taken.push(Demand { page, place, urgency: Urgency::Predicted, gain: 0.0 });
            }
        }
        if !taken.is_empty() {
            commands.push(self.note_run(&taken, now_secs));
        }
        RunStart { commands, is_cut: taken.len() < wanted }
    }

    fn may_start_more(&self) -> bool {
        self.reads.len() < self.limits.in_flight
            && self.under_way.len() < self.limits.pages_in_flight
            && self.bytes_under_way < self.limits.bytes_in_flight
    }

    fn may_start(&self, page: PageId, now_secs: f64) -> bool {
        !self.residents.contains(page) && !self.under_way.contains_key(&page) && self.may_try(page, now_secs)
    }

    fn may_try(&self, page: PageId, now_secs: f64) -> bool {
        match self.faults.get(&page) {
            None => true,
            Some(Fault::Failed { retry_at_secs, .. }) => now_secs >= *retry_at_secs,
            Some(Fault::Broken) => false,
        }
    }

    /// Whether a page that is still demanded failed, its wait is over, and it can be started.
    pub fn may_retry(&self, now_secs: f64) -> bool {
        self.may_start_more()
            && !self.out_of_room
            && self.faults.iter().any(|(&page, fault)| {
                matches!(fault, Fault::Failed { .. }) && self.is_wanted(page) && self.may_start(page, now_secs)
            })
    }

    fn evict(&mut self, page: PageId, commands: &mut Vec<Command>) {
        if self.residents.remove(page) {
            self.counts.evicted += 1;
            commands.push(Command::Evict(page));
        }
    }

    /// Drops all that nobody wants now, though there is room: memory holds then what a walkthrough system without a cache
    /// of its own would hold.
    pub fn drop_unwanted(&mut self) -> Vec<Command> {
        let mut commands = Vec::new();
        while let Some(page) = self.residents.least_recent() {
            self.evict(page, &mut commands);
        }
        commands
    }

    /// Takes in what became of a started page.
    pub fn complete(&mut self, event: Event, now_secs: f64) {
        // Where nothing was asked for, nothing changes.
        let Some(done) = self.under_way.remove(&event.page) else { return };
        self.reserved_bytes -= done.reserved_bytes;
        self.bytes_under_way -= u64::from(done.place.len);
        if let Some(left) = self.reads.get_mut(&done.read) {
            *left -= 1;
            if *left == 0 {
                self.reads.remove(&done.read);
            }
        }
        match event.completion {
            Completion::Loaded { bytes } => {
                self.residents.insert(event.page, bytes, (!self.is_wanted(event.page)).then_some(self.updates));
                self.estimator.learn(event.page.kind, done.place, bytes);
                self.pace.note_arrival(now_secs - done.started_secs, done.place.len);
                self.faults.remove(&event.page);
                if let Some(wanted) = self.wanted.get_mut(&event.page) {
                    wanted.asked_at_secs = None;
                }
            }
            // The pack has it too, and serves at once.
            Completion::Failed | Completion::Broken if done.place.offset >= LAYOUT_AT => self.counts.failed += 1,
            Completion::Failed => self.note_failure(event.page, now_secs),
            Completion::Broken => {
                self.counts.failed += 1;
                self.note_fault(event.page, Fault::Broken);
            }
            Completion::Cancelled => {}
        }
        self.pace.note_end(now_secs, self.reads.is_empty());
    }

    fn note_failure(&mut self, page: PageId, now_secs: f64) {
        self.counts.failed += 1;
        let attempts = match self.faults.get(&page) {
            Some(Fault::Failed { attempts, .. }) => attempts.saturating_add(1),
            _ => 1,
        };
        let wait_secs = (RETRY_FIRST_SECS * 2f64.powi(attempts.min(16) as i32 - 1)).min(RETRY_MAX_SECS);
        self.note_fault(page, Fault::Failed { attempts, retry_at_secs: now_secs + wait_secs });
    }

    fn note_fault(&mut self, page: PageId, fault: Fault) {
        if self.faults.len() >= FAULTS_MAX {
            self.faults.pop_first();
        }
        self.faults.insert(page, fault);
    }

    fn is_awaited(&self, page: PageId) -> bool {
        let given_up = match self.faults.get(&page) {
            Some(Fault::Failed { attempts, .. }) => *attempts >= ATTEMPTS_TO_SETTLE,
            Some(Fault::Broken) => true,
            None => false,
        };
        !given_up && !self.residents.contains(page)
    }

    fn held_bytes(&self) -> u64 {
        self.residents.bytes() + self.reserved_bytes
    }

    /// What the front will hold, and what the largest of its pages takes beyond that while it comes in.
    fn front_bytes_of(&self, demands: &[Demand]) -> u64 {
        let (mut held_bytes, mut arriving_bytes) = (0, 0);
        let is_counted = |demand: &&Demand| is_front(demand) && self.faults.get(&demand.page) != Some(&Fault::Broken);
        for &Demand { page, place, .. } in demands.iter().filter(is_counted) {
            held_bytes += self.residents.bytes_of(page).unwrap_or_else(|| {
                let held_bytes = self.estimator.held_bytes(page.kind, place);
                arriving_bytes = arriving_bytes.max(self.estimator.arriving_bytes(page.kind, place) - held_bytes);
                held_bytes
            });
        }
        held_bytes + arriving_bytes
    }

    /// Whether a front would fit into the footprint, by estimates where its pages are not resident. Ask before
    /// [`RequestManager::update`], and select with a raised tolerance until it does.
    pub fn fits(&self, demands: &[Demand]) -> bool {
        self.front_bytes_of(&ranked(demands)) <= self.plan_bytes()
    }

    /// Decoded bytes of the last update's front, by estimates where its pages are not resident.
    pub fn front_bytes(&self) -> u64 {
        self.front_bytes
    }

    /// Whether nothing is under way and nothing more of the front can come: what a settled frame waits for.
    /// Pages that have failed several times are not waited for.
    pub fn is_idle(&self) -> bool {
        self.under_way.is_empty() && (self.missing == 0 || self.out_of_room)
    }

    /// Whether the last update's front still waits for pages.
    pub fn lacks_front(&self) -> bool {
        self.missing > 0
    }

    pub fn is_resident(&self, page: PageId) -> bool {
        self.residents.contains(page)
    }

    /// Whether a page is resident or on its way.
    pub fn is_held(&self, page: PageId) -> bool {
        self.is_resident(page) || self.under_way.get(&page).is_some_and(|under_way| !under_way.cancelled)
    }

    /// Bytes of resident pages and of reads under way.
    pub fn footprint_bytes(&self) -> u64 {
        self.held_bytes()
    }

    pub fn stats(&self) -> ManagerStats {
        ManagerStats {
            resident_pages: self.residents.len() as u64,
            resident_bytes: self.residents.bytes(),
            in_flight: self.under_way.len() as u64,
            ..self.counts
        }
    }
}

/// The least footprint that can work with a world, bytes.
pub fn least_footprint_bytes(index: &IndexForest) -> u64 {
    footprint_for(least_plan_bytes(index).max(2 * largest_bytes()))
}

/// The pinned pages of the zones, and a page of each layer under way.
fn least_plan_bytes(index: &IndexForest) -> u64 {
    let estimator = Estimator::new();
    let pinned: u64 =
        pinned_demands(index).iter().map(|demand| estimator.held_bytes(demand.page.kind, demand.place)).sum();
    pinned + 2 * largest_bytes()
}

/// The footprint whose plannable part is at least `plan_bytes`.
fn footprint_for(plan_bytes: u64) -> u64 {
    (plan_bytes as f64 / (1.0 - 0.5f64.powi(RESERVE_SHIFT as i32))).ceil() as u64 + 1
}

/// The coarsest terrain of all zones: it is loaded before anything else, and stays.
pub fn pinned_demands(index: &IndexForest) -> Vec<Demand> {
    let roots = index.trees().map(|tree| tree.root());
    roots
        .filter_map(|root| {
            let page = PageId { cell: root.cell(), kind: PageKind::Terrain };
            let place = root.terrain()?.place;
            Some(Demand { page, place, urgency: Urgency::Blocking, gain: f64::INFINITY })
        })
        .collect()
}
