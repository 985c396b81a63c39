//! The order of service: urgency is a named class, then gain per byte.

use crate::select::{Demand, Urgency};
use std::cmp::Ordering;
use std::collections::HashSet;

/// More urgent first; within a class larger gain first; then by page, so that the order is total.
pub fn service_order(a: &Demand, b: &Demand) -> Ordering {
    b.urgency.cmp(&a.urgency).then(b.gain.total_cmp(&a.gain)).then(a.page.cmp(&b.page))
}

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
