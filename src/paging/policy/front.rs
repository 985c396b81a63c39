//! `front`: placeholder of this working tree, replaced before it is committed.

use super::demand::DemandOnly;
use super::{Policy, Situation};
use crate::select::Demand;
use serde::{Deserialize, Serialize};

#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FrontParams {}

pub struct FrontPolicy(DemandOnly);

impl FrontPolicy {
    pub fn new(_: FrontParams) -> Self {
        Self(DemandOnly)
    }
}

impl Policy for FrontPolicy {
    fn demands(&mut self, situation: &Situation<'_>, front: &[Demand]) -> Vec<Demand> {
        self.0.demands(situation, front)
    }
}
