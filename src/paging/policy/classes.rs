//! Gains for an order by classes.

use crate::content::PageId;
use crate::forest::index::Place;
use crate::select::{Demand, Urgency};

/// From class to class gains fall by this factor, inside a class by less than 2, which is what the request manager lets a
/// resident page give way for: so it gives way to one of a better class, and two of one class do not drive each other out.
const GAIN_PER_CLASS: f64 = 0.25;

/// Demands ahead of the front in the order given; classes count from 0, the best, and do not fall.
pub fn predicted(queue: impl ExactSizeIterator<Item = (u32, PageId, Place)>) -> Vec<Demand> {
    let in_all = queue.len().max(1) as f64;
    let demand = |(at, (class, page, place)): (usize, (u32, PageId, Place))| {
        let gain = GAIN_PER_CLASS.powf(f64::from(class)) * (1.0 - at as f64 / (2.0 * in_all));
        Demand { page, place, urgency: Urgency::Predicted, gain }
    };
    queue.enumerate().map(demand).collect()
}
