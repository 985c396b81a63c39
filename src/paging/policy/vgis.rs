//! `vgis`: demand paging with level skips (Davis, Ribarsky, Jiang, Faust, Ho 1999, §IV).
//!
//! Their paging "takes into account the user's viewing direction and speed" and predicts the level that the view will
//! need when a page arrives; intermediate levels that would be passed before that are not loaded. Here: the front of the
//! view expected after the lead time is paged. Of the present front stays what is resident, and what that view still
//! wants. Their predictor is linear in speed and direction; ours is that of all policies, without its uncertainty.

use super::{Policy, Situation};
use crate::content::{PageId, PageKind};
use crate::select::{Demand, FrontRegion, Urgency, survey};
use serde::{Deserialize, Serialize};
use std::collections::HashMap;

/// Parameters of [`VgisPolicy`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct VgisParams {
    /// How many lead times to look ahead.
    pub leads: f64,
}

impl Default for VgisParams {
    fn default() -> Self {
        Self { leads: 1.0 }
    }
}

/// What a segment of the index counts: above all pages.
const SEGMENT_GAIN: f64 = 1e12;
/// Lead times that a view is foretold for at most.
const LEADS_MAX: f64 = 100.0;

pub struct VgisPolicy {
    params: VgisParams,
}

impl VgisPolicy {
    pub fn new(params: VgisParams) -> Self {
        Self { params: VgisParams { leads: params.leads.clamp(0.0, LEADS_MAX) } }
    }
}

impl Policy for VgisPolicy {
    fn demands(&mut self, situation: &Situation<'_>, front: &[Demand]) -> Vec<Demand> {
        let frame = &situation.frame;
        let ahead = situation.forecast.at(self.params.leads * situation.lead_s, 0.0).view;
        let mut wanted: HashMap<PageId, Demand> = HashMap::new();
        let asked_px = frame.params.tolerance_px;
        survey(frame.index, frame.cells, &ahead, frame.params, frame.drawn_tolerance_px, |region: &FrontRegion<'_>| {
            let Some(rep) = region.chain.get(region.front) else { return };
            let page = rep.page();
            let fall_px = region.drawn_px - region.error_px(Some(region.front)).max(asked_px);
            let demand =
                wanted.entry(page).or_insert(Demand { page, place: rep.place, urgency: Urgency::Visible, gain: 0.0 });
            // What a segment tells of cannot be asked for before it is there.
            let first = if region.kind == PageKind::Segment { SEGMENT_GAIN } else { 0.0 };
            demand.gain += first + region.share * fall_px.max(0.0) / f64::from(rep.place.len.max(1));
        });
        let passed = |demand: &&Demand| {
            situation.level_skip
                && demand.urgency == Urgency::Visible
                && !frame.manager.is_held(demand.page)
                && !wanted.contains_key(&demand.page)
        };
        let kept: Vec<Demand> = front.iter().filter(|demand| !passed(demand)).copied().collect();
        let mut demands: Vec<Demand> = wanted.into_values().chain(kept).collect();
        demands.sort_by_key(|demand| demand.page);
        demands
    }
}
