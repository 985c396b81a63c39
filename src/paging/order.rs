//! The order of service: urgency is a named class, then gain per byte.

use crate::select::{Demand, Urgency, service_order};
use std::collections::HashSet;

/// Demands in the order of service, each page once, at its highest rank.
pub fn ranked(demands: &[Demand]) -> Vec<Demand> {
    let mut seen = HashSet::with_capacity(demands.len());
    let mut ranked = demands.to_vec();
    ranked.sort_by(service_order);
    ranked.retain(|demand| seen.insert(demand.page));
    ranked
}

/// Whether a demand is for what the present frame shows, and not for a guess about later ones.
pub fn is_front(demand: &Demand) -> bool {
    demand.urgency > Urgency::Predicted
}
