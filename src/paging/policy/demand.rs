//! `demand`: the front only, nothing ahead (Varadhan & Manocha 2002, §5, OOCNoPre; Davis et al. 1999 without prediction).
//! The demands of the present view are served as selection ranks them.

use super::{Policy, Situation};
use crate::select::Demand;

pub struct DemandOnly;

impl Policy for DemandOnly {
    fn demands(&mut self, _: &Situation<'_>, front: &[Demand]) -> Vec<Demand> {
        front.to_vec()
    }

    fn looks_ahead(&self) -> bool {
        false
    }
}
