//! The request manager: a value. Demands in, commands out, completions in.
//!
//! The footprint is hard: a page is asked for only when what is held, what is under way and its own estimate fit; a
//! sixteenth of the footprint is kept back for pages that turn out larger than their estimate. What is dropped for
//! another page was not demanded in this update, or was only predicted; of it, the least recently demanded first. The
//! front is never dropped for itself: where it does not fit, [`RequestManager::needs_coarser`] says so, and the engine
//! raises the tolerance.

mod progress;

pub use progress::{LayerCounts, PageCounts, PageState};

use super::estimate::{Estimator, largest_bytes};
use super::policy::{is_front, ranked};
use crate::content::{PageId, PageKind};
use crate::forest::index::{IndexForest, Place};
use crate::select::{Demand, Urgency};
use crate::units::ByteSize;
use std::collections::{BTreeMap, HashMap};

/// Hard limits, each of which is named in the report.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// All bytes held: decoded pages, GPU parts, reads under way.
    pub footprint_bytes: u64,
    pub in_flight: usize,
    /// Bytes that one update may start to read.
    pub read_bytes_per_update: u64,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Command {
    Start { page: PageId, place: Place },
    Cancel(PageId),
    Evict(PageId),
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
    pub started: u64,
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
/// Failed and broken pages remembered; beyond it the first ones in the order of pages are forgotten and tried
/// again.
const FAULTS_MAX: usize = 1 << 16;

#[derive(Clone, Copy, Debug, PartialEq)]
enum Slot {
    Requested {
        place: Place,
        reserved_bytes: u64,
    },
    /// Cancelled, and not yet confirmed: its bytes may still be held.
    Cancelling {
        place: Place,
        reserved_bytes: u64,
    },
    Resident {
        bytes: u64,
    },
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Fault {
    Failed { attempts: u32, retry_at_secs: f64 },
    Broken,
}

/// When and how a resident page was last demanded: the order in which pages are dropped.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Wanted {
    update: u64,
    urgency: Urgency,
    gain: f64,
    /// When the page was first asked for since it is demanded without a break, seconds.
    asked_at_secs: Option<f64>,
}

pub struct RequestManager {
    limits: Limits,
    estimator: Estimator,
    slots: HashMap<PageId, Slot>,
    wanted: HashMap<PageId, Wanted>,
    faults: BTreeMap<PageId, Fault>,
    resident_bytes: u64,
    reserved_bytes: u64,
    in_flight: usize,
    /// Bytes that may still be read; below 0 after a page larger than an update's share.
    read_credit: i64,
    updates: u64,
    front_bytes: u64,
    /// Demanded pages that are neither there nor given up.
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
            slots: HashMap::new(),
            wanted: HashMap::new(),
            faults: BTreeMap::new(),
            resident_bytes: 0,
            reserved_bytes: 0,
            in_flight: 0,
            read_credit: 0,
            updates: 0,
            front_bytes: 0,
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

    /// Demands of the frame in any order, resident pages included; `now_secs` from any start.
    pub fn update(&mut self, demands: &[Demand], now_secs: f64) -> Vec<Command> {
        let demands = ranked(demands);
        self.updates += 1;
        self.refill();
        self.note_wanted(&demands);
        self.front_bytes = self.front_bytes_of(&demands);
        let mut commands = Vec::new();
        self.cancel_unwanted(&mut commands);
        self.get_under_limit(&mut commands);
        self.start_wanted(&demands, now_secs, &mut commands);
        self.missing = demands.iter().filter(|demand| self.is_awaited(demand.page)).count();
        commands
    }

    fn refill(&mut self) {
        let share = i64::try_from(self.limits.read_bytes_per_update).unwrap_or(i64::MAX / 2).min(i64::MAX / 2);
        self.read_credit = self.read_credit.min(0).saturating_add(share.max(1));
    }

    fn note_wanted(&mut self, demands: &[Demand]) {
        for demand in demands {
            let known = self.wanted.get(&demand.page).filter(|known| known.update + 1 >= self.updates);
            let asked_at_secs = known.and_then(|known| known.asked_at_secs);
            let wanted = Wanted { update: self.updates, urgency: demand.urgency, gain: demand.gain, asked_at_secs };
            self.wanted.insert(demand.page, wanted);
        }
        let slots = &self.slots;
        let now = self.updates;
        self.wanted.retain(|page, wanted| wanted.update == now || slots.contains_key(page));
    }

    fn is_wanted(&self, page: PageId) -> bool {
        self.wanted.get(&page).is_some_and(|wanted| wanted.update == self.updates)
    }

    fn cancel_unwanted(&mut self, commands: &mut Vec<Command>) {
        let mut unwanted: Vec<PageId> = self
            .slots
            .iter()
            .filter(|(page, slot)| matches!(slot, Slot::Requested { .. }) && !self.is_wanted(**page))
            .map(|(&page, _)| page)
            .collect();
        unwanted.sort();
        for page in unwanted {
            if let Some(slot) = self.slots.get_mut(&page)
                && let Slot::Requested { place, reserved_bytes } = *slot
            {
                *slot = Slot::Cancelling { place, reserved_bytes };
                self.counts.cancelled += 1;
                commands.push(Command::Cancel(page));
            }
        }
    }

    /// Drops pages when some came in larger than estimated, the front last.
    fn get_under_limit(&mut self, commands: &mut Vec<Command>) {
        if self.held_bytes() <= self.limits.footprint_bytes {
            return;
        }
        for page in self.in_order_of_eviction(None) {
            if self.held_bytes() <= self.limits.footprint_bytes {
                break;
            }
            self.evict(page, commands);
        }
    }

    fn start_wanted(&mut self, demands: &[Demand], now_secs: f64, commands: &mut Vec<Command>) {
        let mut droppable: Option<Vec<PageId>> = None;
        self.out_of_room = false;
        for demand in demands {
            if self.in_flight >= self.limits.in_flight || self.read_credit <= 0 {
                break;
            }
            if self.slots.contains_key(&demand.page) || !self.may_try(demand.page, now_secs) {
                continue;
            }
            let bytes = self.estimator.bytes(demand.page.kind, demand.place);
            if bytes > self.plan_bytes() {
                self.out_of_room = true;
                continue;
            }
            let pages = droppable.get_or_insert_with(|| self.in_order_of_eviction(Some(Urgency::Predicted)));
            let mut dropped = pages.split_off(0).into_iter().peekable();
            while self.held_bytes() + bytes > self.plan_bytes() {
                let Some(page) = dropped.next_if(|&page| is_front(demand) || !self.is_wanted(page)) else {
                    break;
                };
                self.evict(page, commands);
            }
            droppable = Some(dropped.collect());
            if self.held_bytes() + bytes > self.plan_bytes() {
                // Lesser demands must not take the room that this one waits for.
                self.out_of_room = true;
                break;
            }
            self.start(demand, bytes, now_secs, commands);
        }
    }

    fn start(&mut self, demand: &Demand, reserved_bytes: u64, now_secs: f64, commands: &mut Vec<Command>) {
        if let Some(wanted) = self.wanted.get_mut(&demand.page) {
            wanted.asked_at_secs.get_or_insert(now_secs);
        }
        self.slots.insert(demand.page, Slot::Requested { place: demand.place, reserved_bytes });
        self.reserved_bytes += reserved_bytes;
        self.in_flight += 1;
        self.read_credit -= i64::from(demand.place.len);
        self.counts.started += 1;
        commands.push(Command::Start { page: demand.page, place: demand.place });
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
        let may_start = self.in_flight < self.limits.in_flight && !self.out_of_room;
        may_start
            && self.faults.iter().any(|(&page, fault)| {
                matches!(fault, Fault::Failed { retry_at_secs, .. } if now_secs >= *retry_at_secs)
                    && self.is_wanted(page)
                    && !self.slots.contains_key(&page)
            })
    }

    /// Resident pages, those to drop first first: what is not demanded now, by its last demand, then what is only
    /// predicted, by ascending gain, then the rest. `up_to` leaves out what is demanded now above that class.
    fn in_order_of_eviction(&self, up_to: Option<Urgency>) -> Vec<PageId> {
        let mut pages: Vec<(u64, Urgency, f64, PageId)> = self
            .slots
            .iter()
            .filter(|(_, slot)| matches!(slot, Slot::Resident { .. }))
            .map(|(&page, _)| match self.wanted.get(&page) {
                Some(wanted) => (wanted.update, wanted.urgency, wanted.gain, page),
                None => (0, Urgency::Predicted, 0.0, page),
            })
            .filter(|&(update, urgency, ..)| update < self.updates || up_to.is_none_or(|class| urgency <= class))
            .collect();
        pages.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.cmp(&b.1)).then(a.2.total_cmp(&b.2)).then(a.3.cmp(&b.3)));
        pages.into_iter().map(|(.., page)| page).collect()
    }

    fn evict(&mut self, page: PageId, commands: &mut Vec<Command>) {
        if let Some(&Slot::Resident { bytes }) = self.slots.get(&page) {
            self.slots.remove(&page);
            self.resident_bytes -= bytes;
            self.counts.evicted += 1;
            commands.push(Command::Evict(page));
        }
    }

    pub fn complete(&mut self, event: Event, now_secs: f64) {
        let (place, reserved_bytes) = match self.slots.get(&event.page) {
            Some(&(Slot::Requested { place, reserved_bytes } | Slot::Cancelling { place, reserved_bytes })) => {
                (place, reserved_bytes)
            }
            // Nothing was asked for: nothing changes.
            _ => return,
        };
        self.slots.remove(&event.page);
        self.reserved_bytes -= reserved_bytes;
        self.in_flight -= 1;
        match event.completion {
            Completion::Loaded { bytes } => {
                self.slots.insert(event.page, Slot::Resident { bytes });
                self.resident_bytes += bytes;
                self.estimator.learn(event.page.kind, place, bytes);
                self.faults.remove(&event.page);
                if let Some(wanted) = self.wanted.get_mut(&event.page) {
                    wanted.asked_at_secs = None;
                }
            }
            Completion::Failed => self.note_failure(event.page, now_secs),
            Completion::Broken => {
                self.counts.failed += 1;
                self.note_fault(event.page, Fault::Broken);
            }
            Completion::Cancelled => {}
        }
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
        !given_up && !matches!(self.slots.get(&page), Some(Slot::Resident { .. }))
    }

    fn held_bytes(&self) -> u64 {
        self.resident_bytes + self.reserved_bytes
    }

    fn front_bytes_of(&self, demands: &[Demand]) -> u64 {
        demands
            .iter()
            .filter(|demand| is_front(demand) && self.faults.get(&demand.page) != Some(&Fault::Broken))
            .map(|demand| match self.slots.get(&demand.page) {
                Some(&Slot::Resident { bytes }) => bytes,
                _ => self.estimator.bytes(demand.page.kind, demand.place),
            })
            .sum()
    }

    /// Whether a front would fit into the footprint, by estimates where its pages are not resident. Ask before
    /// [`RequestManager::update`], and select with a raised tolerance until it does.
    pub fn fits(&self, demands: &[Demand]) -> bool {
        self.front_bytes_of(&ranked(demands)) <= self.plan_bytes()
    }

    /// Whether the front of the last update does not fit into the footprint.
    pub fn needs_coarser(&self) -> bool {
        self.front_bytes > self.plan_bytes()
    }

    /// Whether nothing is under way and nothing more of the last demands can come: what a settled frame waits for.
    /// Pages that have failed several times are not waited for.
    pub fn is_idle(&self) -> bool {
        self.in_flight == 0 && (self.missing == 0 || self.out_of_room)
    }

    pub fn is_resident(&self, page: PageId) -> bool {
        matches!(self.slots.get(&page), Some(Slot::Resident { .. }))
    }

    /// Bytes of resident pages and of reads under way.
    pub fn footprint_bytes(&self) -> u64 {
        self.held_bytes()
    }

    pub fn stats(&self) -> ManagerStats {
        ManagerStats {
            resident_pages: (self.slots.len() - self.in_flight) as u64,
            resident_bytes: self.resident_bytes,
            in_flight: self.in_flight as u64,
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
    let roots = index.trees().map(|tree| tree.root());
    let pinned: u64 = roots
        .map(|root| {
            let terrain = root.terrain().map_or(0, |entry| estimator.bytes(PageKind::Terrain, entry.place));
            let imagery = root.imagery().map_or(0, |place| estimator.bytes(PageKind::Imagery, place));
            terrain + imagery
        })
        .sum();
    pinned + 2 * largest_bytes()
}

/// The footprint whose plannable part is at least `plan_bytes`.
fn footprint_for(plan_bytes: u64) -> u64 {
    (plan_bytes as f64 / (1.0 - 0.5f64.powi(RESERVE_SHIFT as i32))).ceil() as u64 + 1
}
