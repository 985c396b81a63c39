//! `foresight`: ours. A page is worth by how much it is expected to lower the detail debt, per byte, integrated over the
//! views that are expected from the moment on at which it could be drawn.
//!
//! Views are foretold for the end of the lead time and some times after it. Each is surveyed: every layer of every
//! region of its front tells by how much each page of its chain would lower the excess there. Pages that would be passed
//! before they arrive help in no such view, and so are not asked for; angle, visibility, distance and level all act
//! through the excess, and none of them needs a weight of its own.
//!
//! Where the storage is behind, a coarser page that serves several regions may come first: along each chain, pages are
//! taken by what the next one takes off per byte, the bytes of a page shared by the regions under it. Where all that is
//! missing comes at once, they would be read in vain, and the front is asked for directly.
//!
//! Visible is what the present front draws, and the next page of each region of the view at the end of the lead time;
//! all else is predicted, and gives way to it.
//!
//! `oracle` is the same with the path told beforehand, and looks further.

use super::{Policy, Situation, is_due};
use crate::camera::View;
use crate::content::PageId;
use crate::forest::index::Place;
use crate::select::{Demand, FrontRegion, LAYERS, SHARE_MIN, Urgency, layer_of, survey};
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::ops::Range;

/// Parameters of [`Foresight`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ForesightParams {
    /// How many views are foretold, and for how long after the lead time, seconds: the first for its end, the others
    /// ever further apart. Views 1 to 64, reach 0.001 to 60.
    pub views: u32,
    pub reach_s: f64,
    /// Time constant with which trust in them falls, seconds, at least 0.001; a way that is told to `oracle` is trusted.
    pub trust_s: f64,
    /// Factor on the uncertainty by which they are wider; 0 takes them as certain.
    pub widen: f64,
    /// Whether coarser pages may come first where the storage is behind.
    pub steps: bool,
    /// What is missing and comes within this time is asked for directly, seconds.
    pub direct_s: f64,
    /// Whether the gain counts per byte.
    pub per_byte: bool,
    /// Plans are made anew after this time, seconds.
    pub replan_s: f64,
}

impl Default for ForesightParams {
    fn default() -> Self {
        Self {
            views: 5,
            reach_s: 1.5,
            trust_s: 1.0,
            widen: 1.0,
            steps: true,
            direct_s: 0.05,
            per_byte: true,
            replan_s: 0.03,
        }
    }
}

impl ForesightParams {
    /// Times after the lead time for which views are foretold.
    fn after_s(&self) -> Vec<f64> {
        let views = self.views.clamp(1, VIEWS_MAX);
        let last = f64::from(views.max(2) - 1);
        (0..views).map(|at| self.reach_s * (f64::from(at) / last).powi(2)).collect()
    }

    /// With the path known there is no doubt, and a longer way to see.
    pub fn oracle() -> Self {
        Self { views: 9, reach_s: 8.0, trust_s: 4.0, widen: 0.0, ..Self::default() }
    }
}

/// What a segment of the index counts for each view that needs it, px·s: above all pages.
const SEGMENT_GAIN: f64 = 1e12;
/// Times of parameters are at least this, and views are foretold no further than that, seconds.
const TIME_MIN_S: f64 = 1e-3;
const REACH_MAX_S: f64 = 60.0;
/// Views foretold at most.
const VIEWS_MAX: u32 = 64;
/// What a page counts that is held and would not be missed: it is the last to be asked for, and the first to go.
const KEEP_MIN_PX: f64 = 1e-6;

/// The policy with its last plan.
pub struct Foresight {
    params: ForesightParams,
    is_oracle: bool,
    plan: Vec<Demand>,
    planned_s: Option<f64>,
}

/// What a page of the plan promises.
#[derive(Clone, Copy, Debug)]
struct Prospect {
    place: Place,
    /// Weight of the regions that it would serve.
    served: f64,
    /// Expected fall of debt, px·s.
    gain: f64,
    /// Whether a region of the view at the end of the lead time wants it next.
    is_next: bool,
}

/// A layer of a region of a foretold view.
struct Wish {
    layer: usize,
    /// Share of its layer, times the time that the view stands for, seconds.
    weight: f64,
    /// Excess now, px.
    excess_px: f64,
    is_due: bool,
    /// Pages that are resident or on their way, coarse to fine, with what each takes off the excess.
    keeps: Range<usize>,
    /// Pages that are not held and would lower the excess, coarse to fine, with the excess that they leave.
    steps: Range<usize>,
}

/// All foretold views.
#[derive(Default)]
struct Outlook {
    wishes: Vec<Wish>,
    keeps: Vec<(PageId, f64)>,
    steps: Vec<(PageId, f64)>,
    pages: HashMap<PageId, Prospect>,
}

impl Foresight {
    pub fn new(params: ForesightParams) -> Self {
        let (reach_s, trust_s) = (params.reach_s.clamp(TIME_MIN_S, REACH_MAX_S), params.trust_s.max(TIME_MIN_S));
        let params = ForesightParams { reach_s, trust_s, ..params };
        Self { params, is_oracle: false, plan: Vec::new(), planned_s: None }
    }

    pub fn oracle(params: ForesightParams) -> Self {
        Self { is_oracle: true, ..Self::new(params) }
    }

    /// Views with the time that each stands for, seconds, discounted by trust; the first is that of the lead time.
    fn views(&self, situation: &Situation<'_>) -> Vec<(View, f64)> {
        let after_s = self.params.after_s();
        let gap_s = |at: usize| match (after_s.get(at), after_s.get(at + 1)) {
            (Some(from), Some(to)) => (to - from).max(0.0),
            _ => 0.0,
        };
        let sure = situation.forecast.is_known();
        let mut views = Vec::new();
        for (at, &view_s) in after_s.iter().enumerate() {
            let before_s = if at == 0 { 0.0 } else { gap_s(at - 1) };
            // A view alone stands for all.
            let stands_s = if after_s.len() == 1 { self.params.reach_s } else { (before_s + gap_s(at)) / 2.0 };
            let trust = if sure && self.is_oracle { 1.0 } else { (-view_s / self.params.trust_s).exp() };
            let view = situation.forecast.at(situation.lead_s + view_s, self.params.widen).view;
            views.push((view, stands_s * trust));
        }
        views
    }

    fn outlook(&self, situation: &Situation<'_>) -> Outlook {
        let mut outlook = Outlook::default();
        for (at, (view, weight_s)) in self.views(situation).into_iter().enumerate() {
            outlook.add_view(situation, &view, weight_s, at == 0);
        }
        outlook
    }

    fn make_plan(&self, situation: &Situation<'_>) -> Vec<Demand> {
        let mut outlook = self.outlook(situation);
        let direct = !self.params.steps || outlook.missing_secs(situation) <= self.params.direct_s;
        outlook.choose(direct);
        let mut plan: Vec<Demand> = outlook
            .pages
            .iter()
            .filter(|(_, prospect)| prospect.gain > 0.0)
            .map(|(&page, prospect)| Demand {
                page,
                place: prospect.place,
                urgency: if prospect.is_next { Urgency::Visible } else { Urgency::Predicted },
                gain: if self.params.per_byte {
                    prospect.gain / f64::from(prospect.place.len.max(1))
                } else {
                    prospect.gain
                },
            })
            .collect();
        plan.sort_by_key(|demand| demand.page);
        plan
    }
}

impl Policy for Foresight {
    fn demands(&mut self, situation: &Situation<'_>, front: &[Demand]) -> Vec<Demand> {
        let frame = &situation.frame;
        if is_due(self.planned_s, frame.now_s, self.params.replan_s) {
            self.plan = self.make_plan(situation);
            self.planned_s = Some(frame.now_s);
        }
        // What is drawn now or on its way stays; what is missing now is asked for only where the plan has it.
        let stays = |demand: &&Demand| {
            !situation.level_skip || demand.urgency == Urgency::Blocking || frame.manager.is_held(demand.page)
        };
        front.iter().filter(stays).chain(&self.plan).copied().collect()
    }
}

impl Outlook {
    fn add_view(&mut self, situation: &Situation<'_>, view: &View, weight_s: f64, is_due: bool) {
        let frame = &situation.frame;
        let first = self.wishes.len();
        let mut shares = [0.0; LAYERS];
        survey(frame.index, frame.cells, view, frame.params, frame.drawn_tolerance_px, |region| {
            match layer_of(region.kind) {
                Some(layer) => {
                    shares[layer] += region.share;
                    self.add_region(situation, region, layer, is_due);
                }
                None => self.add_segment(region, is_due),
            }
        });
        // As debt does, each layer's shares count against their sum.
        for wish in &mut self.wishes[first..] {
            wish.weight *= weight_s / shares[wish.layer].max(1e-12);
            for (page, _) in &self.steps[wish.steps.clone()] {
                if let Some(prospect) = self.pages.get_mut(page) {
                    prospect.served += wish.weight;
                }
            }
        }
    }

    /// A segment of the index comes before all that it tells of.
    fn add_segment(&mut self, region: &FrontRegion<'_>, is_due: bool) {
        for rep in region.chain {
            let page = rep.page();
            self.page(page, rep.place);
            self.promise(page, SEGMENT_GAIN, is_due);
        }
    }

    fn add_region(&mut self, situation: &Situation<'_>, region: &FrontRegion<'_>, layer: usize, is_due: bool) {
        let (manager, asked_px) = (situation.frame.manager, situation.frame.params.tolerance_px);
        if region.front >= region.chain.len() {
            return;
        }
        let page_at = |at: usize| region.chain[at].page();
        let excess_px = |at: Option<usize>| region.excess_px(region.error_px(at), asked_px);
        let last = region.front;
        let drawn = (0..=last).rev().find(|&at| manager.is_resident(page_at(at)));
        // What is drawn stays until what is on its way is there; the next ones are compared with that.
        let without = drawn.and_then(|drawn| (0..drawn).rev().find(|&at| manager.is_resident(page_at(at))));
        let first_kept = self.keeps.len();
        let mut finest = drawn;
        if let Some(at) = drawn {
            self.keep(page_at(at), region.chain[at].place, excess_px(without) - excess_px(drawn));
        }
        for at in drawn.map_or(0, |at| at + 1)..=last {
            if manager.is_held(page_at(at)) {
                self.keep(page_at(at), region.chain[at].place, excess_px(finest) - excess_px(Some(at)));
                finest = Some(at);
            }
        }
        let keeps = first_kept..self.keeps.len();
        let from = self.steps.len();
        let now_px = excess_px(finest);
        let mut left_px = now_px;
        for at in finest.map_or(0, |at| at + 1)..=last {
            let after_px = excess_px(Some(at));
            // What the front wants comes at last even where it lowers no bound.
            let is_front = is_due && at == last;
            if after_px < left_px || is_front {
                left_px = after_px;
                self.page(page_at(at), region.chain[at].place);
                self.steps.push((page_at(at), after_px));
            }
        }
        let steps = from..self.steps.len();
        // The front is whole only with what is in view by its box alone: that comes last.
        let weight = if is_due { region.share.max(SHARE_MIN) } else { region.share };
        let is_due = is_due && region.share > 0.0;
        self.wishes.push(Wish { layer, weight, excess_px: now_px, is_due, keeps, steps });
    }

    fn keep(&mut self, page: PageId, place: Place, falls_px: f64) {
        self.page(page, place);
        self.keeps.push((page, falls_px.max(KEEP_MIN_PX)));
    }

    fn page(&mut self, page: PageId, place: Place) {
        self.pages.entry(page).or_insert(Prospect { place, served: 0.0, gain: 0.0, is_next: false });
    }

    /// How long all that is missing at the end of the lead time would take.
    fn missing_secs(&self, situation: &Situation<'_>) -> f64 {
        let mut fronts: Vec<PageId> = self
            .wishes
            .iter()
            .filter(|wish| wish.is_due)
            .filter_map(|wish| self.steps[wish.steps.clone()].last().map(|step| step.0))
            .collect();
        fronts.sort();
        fronts.dedup();
        let bytes: f64 = fronts.iter().map(|page| f64::from(self.pages[page].place.len)).sum();
        bytes / situation.frame.manager.pace().bytes_per_sec()
    }

    /// Gives each page what it takes off the debt, in the order in which the pages of each chain would be fetched.
    fn choose(&mut self, direct: bool) {
        for at in 0..self.wishes.len() {
            let wish = &self.wishes[at];
            let (weight, is_due, steps) = (wish.weight, wish.is_due, wish.steps.clone());
            let (mut left_px, keeps) = (wish.excess_px, wish.keeps.clone());
            for kept in keeps {
                let (page, falls_px) = self.keeps[kept];
                self.promise(page, weight * falls_px, false);
            }
            let mut next = steps.start;
            while next < steps.end {
                let chosen = if direct { steps.end - 1 } else { self.best_step(next..steps.end, left_px) };
                let (page, after_px) = self.steps[chosen];
                let is_next = is_due && next == steps.start;
                self.promise(page, weight * (left_px - after_px).max(KEEP_MIN_PX), is_next);
                left_px = after_px;
                next = chosen + 1;
            }
        }
    }

    fn promise(&mut self, page: PageId, gain: f64, is_next: bool) {
        if let Some(prospect) = self.pages.get_mut(&page) {
            prospect.gain += gain;
            prospect.is_next |= is_next;
        }
    }

    /// The step that takes off most per byte, where the bytes of a page are shared by the regions under it.
    fn best_step(&self, steps: Range<usize>, left_px: f64) -> usize {
        let worth = |at: usize| {
            let (page, after_px) = self.steps[at];
            let prospect = &self.pages[&page];
            (left_px - after_px) * prospect.served / f64::from(prospect.place.len.max(1))
        };
        let mut best = steps.end - 1;
        let mut best_worth = worth(best);
        for at in steps.start..steps.end - 1 {
            let here = worth(at);
            if here > best_worth {
                (best, best_worth) = (at, here);
            }
        }
        best
    }
}
