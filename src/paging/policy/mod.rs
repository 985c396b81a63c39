//! Policies: which pages are asked for, and in which order, over the same machinery. Each file holds one and names its
//! source.

mod classes;
mod demand;
mod foresight;
mod front;
mod range;
mod vgis;
mod wide;

pub use foresight::ForesightParams;
pub use front::FrontParams;
pub use range::RangeParams;
pub use vgis::VgisParams;

use super::forecast::Forecast;
use super::planner::Frame;
use crate::select::Demand;
use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize};
use std::fmt;
use std::str::FromStr;

/// The policies that can be chosen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PolicyName {
    /// The front only.
    Demand,
    /// Varadhan & Manocha 2002.
    Front,
    /// Funkhouser 1996.
    Range,
    /// Davis et al. 1999.
    Vgis,
    /// Ours.
    #[default]
    Foresight,
    /// Ours, told the path beforehand; for comparison only.
    Oracle,
}

impl PolicyName {
    pub const ALL: [Self; 6] = [Self::Demand, Self::Front, Self::Range, Self::Vgis, Self::Foresight, Self::Oracle];

    pub fn name(self) -> &'static str {
        match self {
            Self::Demand => "demand",
            Self::Front => "front",
            Self::Range => "range",
            Self::Vgis => "vgis",
            Self::Foresight => "foresight",
            Self::Oracle => "oracle",
        }
    }

    pub(super) fn make(self, params: &PolicyParams) -> Box<dyn Policy> {
        match self {
            Self::Demand => Box::new(demand::DemandOnly),
            Self::Front => Box::new(front::FrontPolicy::new(params.front)),
            Self::Range => Box::new(range::RangePolicy::new(params.range)),
            Self::Vgis => Box::new(vgis::VgisPolicy::new(params.vgis)),
            Self::Foresight => Box::new(foresight::Foresight::new(params.foresight)),
            Self::Oracle => Box::new(foresight::Foresight::oracle(params.oracle)),
        }
    }
}

impl fmt::Display for PolicyName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("there is no policy {0:?}: use demand, front, range, vgis, foresight or oracle")]
pub struct UnknownPolicy(String);

impl FromStr for PolicyName {
    type Err = UnknownPolicy;

    fn from_str(text: &str) -> Result<Self, UnknownPolicy> {
        Self::ALL.into_iter().find(|policy| policy.name() == text).ok_or_else(|| UnknownPolicy(text.to_owned()))
    }
}

/// Parameters of all policies, as a file gives them; what it leaves out has its default.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PolicyParams {
    pub front: FrontParams,
    pub range: RangeParams,
    pub vgis: VgisParams,
    pub foresight: ForesightParams,
    #[serde(deserialize_with = "over_oracle")]
    pub oracle: ForesightParams,
}

/// What a file leaves out of the oracle's parameters is as the oracle has it, not as `foresight` has.
fn over_oracle<'de, D: Deserializer<'de>>(deserializer: D) -> Result<ForesightParams, D::Error> {
    let given = serde_json::Map::deserialize(deserializer)?;
    let mut params = serde_json::to_value(ForesightParams::oracle()).map_err(D::Error::custom)?;
    given.into_iter().for_each(|(name, value)| params[name] = value);
    serde_json::from_value(params).map_err(D::Error::custom)
}

impl Default for PolicyParams {
    fn default() -> Self {
        Self {
            front: FrontParams::default(),
            range: RangeParams::default(),
            vgis: VgisParams::default(),
            foresight: ForesightParams::default(),
            oracle: ForesightParams::oracle(),
        }
    }
}

/// What a policy sees of a frame.
#[derive(Clone, Copy)]
pub struct Situation<'a> {
    pub frame: Frame<'a>,
    pub forecast: &'a Forecast,
    /// How long a page takes that is asked for now, until it can be drawn; seconds.
    pub lead_s: f64,
    /// Whether levels that would be passed may be left out.
    pub level_skip: bool,
}

/// Whether a plan is to be made anew: after `replan_s`, and when time went back.
fn is_due(planned_s: Option<f64>, now_s: f64, replan_s: f64) -> bool {
    planned_s.is_none_or(|planned_s| now_s < planned_s || now_s - planned_s >= replan_s - 1e-9)
}

/// Turns the front of a frame into demands.
pub trait Policy: Send {
    /// All demands of the frame, in any order: those of `front` that are still wanted, and those for later frames.
    /// Pages that are resident and needed again soon are demanded too, so that they stay.
    fn demands(&mut self, situation: &Situation<'_>, front: &[Demand]) -> Vec<Demand>;

    /// Whether the ground under the eye's next places is demanded as well.
    fn looks_ahead(&self) -> bool {
        true
    }
}
