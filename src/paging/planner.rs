//! The planner: what to ask for in a frame, by policy. It remembers the last views, foretells the next ones, and turns the
//! front of the frame into the demands that the request manager serves.

use super::forecast::{Forecaster, KnownWay};
use super::policy::{Policy, PolicyName, PolicyParams, Situation};
use super::{RequestManager, service_order};
use crate::camera::View;
use crate::cells::LiveTree;
use crate::content::{PageId, PageKind};
use crate::forest::CellId;
use crate::forest::index::IndexForest;
use crate::geodesy::Geodetic;
use crate::select::{Demand, SelectParams, Urgency, ground_demands};
use std::collections::HashSet;

/// How a run chooses what to fetch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlannerParams {
    pub policy: PolicyName,
    pub params: PolicyParams,
    /// Whether levels that would be passed before they arrive are left out; else each page waits for its parent.
    pub level_skip: bool,
}

impl Default for PlannerParams {
    fn default() -> Self {
        Self { policy: PolicyName::default(), params: PolicyParams::default(), level_skip: true }
    }
}

/// What a frame shows, and what is held.
#[derive(Clone, Copy)]
pub struct Frame<'a> {
    pub index: &'a IndexForest,
    pub cells: &'a LiveTree,
    pub manager: &'a RequestManager,
    pub view: &'a View,
    pub now_s: f64,
    /// From frame to frame, seconds.
    pub step_s: f64,
    pub params: &'a SelectParams,
    /// The tolerance that the front was cut to, px.
    pub drawn_tolerance_px: f64,
}

/// A policy with what it remembers.
pub struct Planner {
    policy: Box<dyn Policy>,
    forecaster: Forecaster,
    level_skip: bool,
    /// The way of the eye, where it is known.
    known: Option<KnownWay>,
}

impl Planner {
    pub fn new(params: &PlannerParams) -> Self {
        Self {
            policy: params.policy.make(&params.params),
            forecaster: Forecaster::default(),
            level_skip: params.level_skip,
            known: None,
        }
    }

    /// Tells the way of the eye from now on, or that it is not known.
    pub fn set_way(&mut self, known: Option<KnownWay>) {
        self.known = known;
    }

    /// Where the eye will be at times from now, seconds; nowhere for policies that do not look ahead. After
    /// [`Planner::plan`] of the same frame.
    pub fn eyes_ahead(&self, frame: &Frame<'_>, times_s: &[f64]) -> Vec<Geodetic> {
        if !self.policy.looks_ahead() {
            return Vec::new();
        }
        let forecast = self.forecaster.forecast(frame.view, frame.now_s, self.known.clone());
        times_s.iter().map(|&after_s| forecast.pose(after_s).eye).collect()
    }

    /// All demands of a frame whose front is `front`.
    pub fn plan(&mut self, frame: &Frame<'_>, front: &[Demand]) -> Vec<Demand> {
        self.forecaster.note(frame.view, frame.now_s, frame.cells);
        let forecast = self.forecaster.forecast(frame.view, frame.now_s, self.known.clone());
        let lead_s = frame.manager.pace().lead_secs() + frame.step_s;
        let situation = Situation { frame: *frame, forecast: &forecast, lead_s, level_skip: self.level_skip };
        let mut demands = self.policy.demands(&situation, front);
        if self.policy.looks_ahead() {
            demands.extend(ground_ahead(&situation));
        }
        match (self.level_skip, self.policy.looks_ahead()) {
            (false, _) => parents_first(frame, demands),
            (true, true) => without_passed_ground(frame, demands),
            (true, false) => demands,
        }
    }
}

/// The ground under the eye at the end of the lead time.
fn ground_ahead(situation: &Situation<'_>) -> Vec<Demand> {
    let frame = &situation.frame;
    let ahead = situation.forecast.at(situation.lead_s, 0.0).view;
    ground_demands(frame.index, frame.cells, &ahead, frame.params)
}

/// Leaves out missing ground under the eye where finer ground is asked for as well: it would be passed.
fn without_passed_ground(frame: &Frame<'_>, mut demands: Vec<Demand>) -> Vec<Demand> {
    let is_ground = |demand: &Demand| demand.urgency == Urgency::Blocking && demand.page.kind == PageKind::Terrain;
    let ground: HashSet<CellId> =
        demands.iter().filter(|demand| is_ground(demand)).map(|demand| demand.page.cell).collect();
    let is_passed = |cell: CellId| cell.level() > 0 && cell.children().any(|child| ground.contains(&child));
    demands.retain(|demand| !is_ground(demand) || frame.manager.is_held(demand.page) || !is_passed(demand.page.cell));
    demands
}

/// Asks for the coarsest missing page on the way down to each missing one, so that every level is loaded in turn.
fn parents_first(frame: &Frame<'_>, demands: Vec<Demand>) -> Vec<Demand> {
    let mut first: Vec<Demand> = demands.iter().map(|demand| coarsest_missing(frame, demand)).collect();
    first.sort_by(service_order);
    first
}

fn coarsest_missing(frame: &Frame<'_>, demand: &Demand) -> Demand {
    if !matches!(demand.page.kind, PageKind::Terrain | PageKind::Imagery) || frame.manager.is_resident(demand.page) {
        return *demand;
    }
    let mut above: Vec<_> = demand.page.cell.ancestors().skip(1).collect();
    above.reverse();
    let missing = above.into_iter().find_map(|cell| {
        let page = PageId { cell, ..demand.page };
        let node = frame.index.find(cell).filter(|_| !frame.manager.is_resident(page))?;
        let place = match page.kind {
            PageKind::Terrain => node.terrain()?.place,
            _ => node.imagery()?,
        };
        Some(Demand { page, place, ..*demand })
    });
    missing.unwrap_or(*demand)
}
