//! Flying by a layout: which run to read when, what to keep, what to leave to the packs. Pure.

use super::grid::NavCell;
use super::head::Layout;
use crate::camera::View;
use crate::content::{PageId, PageKind};
use crate::forest::index::Place;
use crate::geodesy::Geodetic;
use crate::select::{Demand, Urgency};
use std::collections::HashSet;
use std::sync::Arc;

/// Cells ahead whose runs are fetched before they are entered.
const AHEAD_MAX: usize = 2;
/// Runs that are fetched ahead from one cell, whatever becomes of the forecast: what was begun is not broken off, since a
/// forecast that wavers would bring nothing at all.
const ASKED_MAX: usize = 3;

/// Gains of what is kept: beyond any page of a policy's forecast, and the cell's own beyond what is fetched ahead.
const KEEP_GAIN: f64 = 1e12;
const AHEAD_GAIN: f64 = 1e11;
/// Of what a cell that was entered without a run still lacks.
const SETTLE_GAIN: f64 = 1e-12;

/// Pages to be read in one go from the layout's file.
#[derive(Clone, Debug, PartialEq)]
pub struct Run {
    /// With their places in the file, ascending.
    pub pages: Vec<(PageId, Place)>,
    pub cause: RunCause,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RunCause {
    Crossing,
    Ahead,
    Entry,
}

/// What a step found.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Ride {
    pub runs: Vec<Run>,
    /// Whether a border was crossed to an adjacent cell in this step.
    pub crossed: bool,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct RideCounts {
    /// Moves to an adjacent cell.
    pub crossings: u64,
    /// Moves to any other cell, by diagonals and jumps, and entries at cells that have no run of their own: there the packs
    /// serve; and runs for which there was no room.
    pub fallbacks: u64,
    /// Runs that were fetched ahead.
    pub ahead: u64,
    pub entries: u64,
    /// Most reads that a frame began in which a border was crossed, those ahead of later crossings left out.
    pub crossing_seeks_max: u64,
}

/// How far ahead of the eye runs are looked for, in times of what a page takes from being asked for to being there.
const LEADS: [f64; 4] = [1.0, 2.0, 3.0, 4.0];

/// Times from now at which the next places of the eye are asked for, when a page takes `lead_s`; seconds.
pub fn times_ahead_s(lead_s: f64) -> [f64; 4] {
    LEADS.map(|leads| leads * lead_s)
}

/// Follows an eye through a layout.
pub struct Rider {
    layout: Arc<Layout>,
    /// The cell that the eye is in; `None` where the packs alone serve.
    at: Option<NavCell>,
    set: HashSet<PageId>,
    /// Of the runs in `asked`.
    ahead: HashSet<PageId>,
    /// Runs that were asked for ahead: from, to.
    asked: Vec<(NavCell, NavCell)>,
    /// Until all of the cell's set has come: after a move that no run was made for.
    is_settling: bool,
    counts: RideCounts,
}

impl Rider {
    pub fn new(layout: Arc<Layout>) -> Self {
        Self {
            layout,
            at: None,
            set: HashSet::new(),
            ahead: HashSet::new(),
            asked: Vec::new(),
            is_settling: false,
            counts: RideCounts::default(),
        }
    }

    pub fn counts(&self) -> RideCounts {
        self.counts
    }

    /// Goes on to a view at tolerances; `ahead` are the next places of the eye, as far as they are foretold (none while the
    /// present frame lacks something: that comes first), and `is_held` tells what is resident or on its way.
    pub fn step(
        &mut self,
        view: &View,
        (tolerance_px, threshold_px): (f64, f64),
        ahead: &[Geodetic],
        is_held: &dyn Fn(PageId) -> bool,
    ) -> Ride {
        let suits = self.layout.params.suffice(view, tolerance_px, threshold_px);
        let now = self.layout.grid.locate(view.pose.eye).filter(|_| suits);
        let mut ride = Ride::default();
        if now != self.at {
            self.go_to(now, is_held, &mut ride);
        }
        self.is_settling = self.is_settling && self.set.iter().any(|&page| !is_held(page));
        if let Some(cell) = now.filter(|_| !self.is_settling) {
            self.look_ahead(cell, ahead, is_held, &mut ride);
        }
        ride
    }

    /// Told of a step that crossed a border: how many reads it began, those ahead of later crossings left out.
    pub fn note_reads(&mut self, reads: u64) {
        self.counts.crossing_seeks_max = self.counts.crossing_seeks_max.max(reads);
    }

    /// Told of a crossing's or an entry's run that was left out in part for lack of room.
    pub fn note_cut(&mut self) {
        self.counts.fallbacks += 1;
    }

    fn go_to(&mut self, now: Option<NavCell>, is_held: &dyn Fn(PageId) -> bool, ride: &mut Ride) {
        let before = std::mem::replace(&mut self.at, now);
        self.set = now.map(|cell| self.layout.set(cell).into_iter().collect()).unwrap_or_default();
        self.asked.retain(|(from, _)| Some(*from) == now);
        self.ahead =
            self.asked.iter().flat_map(|&(from, to)| self.layout.run(from, to)).map(|(page, _)| page).collect();
        let Some(now) = now else { return };
        let adjacent = before.filter(|&before| self.layout.grid.direction(before, now).is_some());
        if let Some(before) = adjacent {
            self.counts.crossings += 1;
            ride.crossed = true;
            ride.runs.extend(run(self.layout.run(before, now), RunCause::Crossing, is_held));
            return;
        }
        self.is_settling = true;
        match self.layout.entry(now).and_then(|pages| run(pages, RunCause::Entry, is_held)) {
            Some(entry) => {
                self.counts.entries += 1;
                ride.runs.push(entry);
            }
            None => self.counts.fallbacks += 1,
        }
    }

    /// Fetches the runs of the next cells on the way, as far as each is adjacent to the one before.
    fn look_ahead(&mut self, cell: NavCell, eyes: &[Geodetic], is_held: &dyn Fn(PageId) -> bool, ride: &mut Ride) {
        let mut way = vec![cell];
        for next in eyes.iter().filter_map(|&eye| self.layout.grid.locate(eye)) {
            let last = way[way.len() - 1];
            if next == last {
                continue;
            }
            let is_next = self.layout.grid.direction(last, next).is_some();
            if way.len() > AHEAD_MAX || self.asked.len() >= ASKED_MAX || !is_next {
                break;
            }
            if !self.asked.contains(&(last, next)) {
                let pages = self.layout.run(last, next);
                self.asked.push((last, next));
                self.ahead.extend(pages.iter().map(|(page, _)| *page));
                if let Some(run) = run(pages, RunCause::Ahead, is_held) {
                    self.counts.ahead += 1;
                    ride.runs.push(run);
                }
            }
            way.push(next);
        }
    }

    /// A frame's demands as the layout has them: its cell's pages are kept, those of the next cells too. Once all of the
    /// cell's are held or coming, what is in neither is not asked for: it is hidden, or finer pages stand in for it. What
    /// `runs` are about to bring is left out. Outside of the layout demands stay as they are.
    pub fn demands(
        &self,
        demands: Vec<Demand>,
        runs: &[Run],
        is_held: &dyn Fn(PageId) -> bool,
        place: &dyn Fn(PageId) -> Option<Place>,
    ) -> Vec<Demand> {
        if self.at.is_none() {
            return demands;
        }
        let coming: HashSet<PageId> = runs.iter().flat_map(|run| &run.pages).map(|(page, _)| *page).collect();
        let is_complete = self.set.iter().all(|page| is_held(*page) || coming.contains(page));
        let is_ours = |page: PageId| self.set.contains(&page) || self.ahead.contains(&page);
        let stays = |demand: &Demand| {
            let page = demand.page;
            let is_asked = match demand.urgency {
                Urgency::Blocking => true,
                Urgency::Visible => !is_complete || page.kind == PageKind::Segment || is_ours(page) || is_held(page),
                // Ahead of the eye the layout reads, and nothing else.
                Urgency::Predicted => !is_complete || (is_ours(page) && is_held(page)),
            };
            is_asked && !coming.contains(&page)
        };
        let mut kept: Vec<Demand> = demands.into_iter().filter(stays).collect();
        let known: HashSet<PageId> = kept.iter().map(|demand| demand.page).collect();
        let more = self
            .set
            .iter()
            .map(|page| (*page, KEEP_GAIN))
            .chain(self.ahead.iter().filter(|page| !self.set.contains(page)).map(|page| (*page, AHEAD_GAIN)));
        let wanted = more.filter(|&(page, _)| {
            let is_wanted = is_held(page) || (self.is_settling && self.set.contains(&page));
            is_wanted && !known.contains(&page) && !coming.contains(&page)
        });
        let mut more: Vec<Demand> = wanted
            .filter_map(|(page, gain)| {
                // What is still to come from the packs comes after all that the policy foresees.
                let gain = if is_held(page) { gain } else { SETTLE_GAIN };
                Some(Demand { page, place: place(page)?, urgency: Urgency::Predicted, gain })
            })
            .collect();
        more.sort_by_key(|demand| demand.page);
        kept.extend(more);
        kept
    }
}

/// The pages that are not held; `None` where all are.
fn run(pages: Vec<(PageId, Place)>, cause: RunCause, is_held: &dyn Fn(PageId) -> bool) -> Option<Run> {
    let pages: Vec<(PageId, Place)> = pages.into_iter().filter(|(page, _)| !is_held(*page)).collect();
    (!pages.is_empty()).then_some(Run { pages, cause })
}
