//! What is seen from observer cells, remembered (Funkhouser 1996, §4.2: his is precomputed).

use super::super::Situation;
use super::RangeParams;
use super::directions::Direction;
use super::observer::{Eye, ObserverCell};
use crate::content::{PageId, PageKind};
use crate::forest::index::{IndexForest, Place};
use crate::select::{FrontRegion, SelectParams, survey};
use std::cmp::Reverse;
use std::collections::BTreeMap;

/// Pages remembered at most, over all surveys.
const PAGES_MAX: usize = 1 << 16;
/// A survey that segments of the index were missing for is made again after this time, seconds.
const RENEW_S: f64 = 0.1;
/// Coarser levels at most.
const COARSER_MAX: u32 = 8;
/// Tolerances raised for lack of memory or time count in steps of this factor, so that surveys keep.
const TOLERANCE_STEP: f64 = std::f64::consts::SQRT_2;

/// A page that is seen from a cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Want {
    pub page: PageId,
    pub place: Place,
    /// By how many levels it is coarser than what is wanted; 0 is what is wanted.
    pub coarser: u32,
}

/// What surveys depend on beside the place and the direction.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Lens {
    fov_y_rad: f64,
    size_px: [u32; 2],
    params: SelectParams,
    tolerance_px: f64,
}

#[derive(Clone, Debug)]
struct Survey {
    wants: Vec<Want>,
    made_s: f64,
    /// Whether all segments of the index that it needs were there.
    is_whole: bool,
    /// The plan that looked at it last.
    used: u64,
}

#[derive(Default)]
pub struct Surveys {
    lens: Option<Lens>,
    known: BTreeMap<(ObserverCell, Direction), Survey>,
    plans: u64,
    /// New surveys that this plan may still make.
    left: u32,
}

impl Surveys {
    /// Begins a plan with at most so many new surveys.
    pub fn begin(&mut self, situation: &Situation<'_>, at_most: u32) {
        let lens = Lens::of(situation);
        if self.lens != Some(lens) {
            self.known.clear();
            self.lens = Some(lens);
        }
        self.plans += 1;
        self.left = at_most.max(1);
    }

    /// What is seen from a cell, coarse to fine; `None` where it is not known and no survey is left.
    pub fn from(
        &mut self,
        situation: &Situation<'_>,
        params: &RangeParams,
        eye: &Eye,
        at: (ObserverCell, Direction),
    ) -> Option<&[Want]> {
        let now_s = situation.frame.now_s;
        let lens = self.lens?;
        let is_fresh = |known: &Survey| known.is_whole || (known.made_s..known.made_s + RENEW_S).contains(&now_s);
        if !self.known.get(&at).is_some_and(is_fresh) && self.left > 0 {
            self.left -= 1;
            let (wants, is_whole) = lens.survey(situation, params, eye, at);
            self.known.insert(at, Survey { wants, made_s: now_s, is_whole, used: self.plans });
        }
        let known = self.known.get_mut(&at)?;
        known.used = self.plans;
        Some(&known.wants)
    }

    /// Ends a plan: beyond the limit, what was looked at longest ago is forgotten.
    pub fn end(&mut self) {
        let mut pages: usize = self.known.values().map(|survey| survey.wants.len()).sum();
        while pages > PAGES_MAX {
            let oldest = self.known.iter().min_by_key(|(at, survey)| (survey.used, **at)).map(|(at, _)| *at);
            let Some(survey) = oldest.and_then(|at| self.known.remove(&at)) else { return };
            pages -= survey.wants.len();
        }
    }
}

impl Lens {
    fn of(situation: &Situation<'_>) -> Self {
        let (view, params) = (situation.frame.view, situation.frame.params);
        let raised = (situation.frame.drawn_tolerance_px / params.tolerance_px).max(1.0);
        let steps = (raised.log(TOLERANCE_STEP) - 1e-9).ceil().max(0.0);
        Self {
            fov_y_rad: view.fov_y_rad,
            size_px: view.size_px,
            params: *params,
            tolerance_px: params.tolerance_px * TOLERANCE_STEP.powf(steps),
        }
    }

    /// What is seen, and whether the index could tell all of it.
    fn survey(
        &self,
        situation: &Situation<'_>,
        params: &RangeParams,
        eye: &Eye,
        (cell, direction): (ObserverCell, Direction),
    ) -> (Vec<Want>, bool) {
        let frame = &situation.frame;
        let center = cell.place.bounds().center();
        let ground_m = ground_m(frame.index, &cell, eye.ground_m());
        let view = direction.view(center.at_height(ground_m + cell.above_m()), self.fov_y_rad, self.size_px);
        let coarser_levels = params.coarser_levels.min(COARSER_MAX) as usize;
        let (mut wants, mut is_whole) = (Vec::new(), true);
        survey(frame.index, frame.cells, &view, &self.params, self.tolerance_px, |region: &FrontRegion<'_>| {
            is_whole &= region.kind != PageKind::Segment || region.drawn.is_some();
            for at in region.front.saturating_sub(coarser_levels)..=region.front {
                if let Some(rep) = region.chain.get(at) {
                    let page = rep.page();
                    let above_front = (region.front - at) as u32;
                    // Segments of the index come before all that they tell of.
                    let coarser = if region.kind == PageKind::Segment { COARSER_MAX + 1 } else { above_front };
                    wants.push(Want { page, place: rep.place, coarser });
                }
            }
        });
        (coarse_to_fine(wants), is_whole)
    }
}

/// Each page once, as the coarsest that it stands for.
fn coarse_to_fine(mut wants: Vec<Want>) -> Vec<Want> {
    wants.sort_by_key(|want| (want.page, Reverse(want.coarser)));
    wants.dedup_by_key(|want| want.page);
    wants.sort_by_key(|want| (Reverse(want.coarser), want.page));
    wants
}

/// Height of the ground at a cell, metres: as under the eye, as far as the index has such heights there.
fn ground_m(index: &IndexForest, cell: &ObserverCell, here_m: f64) -> f64 {
    index.find_deepest(cell.place).map_or(here_m, |node| {
        let (low_m, high_m) = node.height_range_m();
        here_m.max(low_m).min(high_m.max(low_m))
    })
}
