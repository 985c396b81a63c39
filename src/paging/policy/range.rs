//! `range`: placeholder of this working tree, replaced before it is committed.

use super::demand::DemandOnly;
use super::{Policy, Situation};
use crate::select::Demand;
use serde::{Deserialize, Serialize};

#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RangeParams {}

pub struct RangePolicy(DemandOnly);

impl RangePolicy {
    pub fn new(_: RangeParams) -> Self {
        Self(DemandOnly)
    }
}

impl Policy for RangePolicy {
    fn demands(&mut self, situation: &Situation<'_>, front: &[Demand]) -> Vec<Demand> {
        self.0.demands(situation, front)
    }
}
