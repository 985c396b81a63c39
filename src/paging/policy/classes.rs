//! Gains for an order by classes.

use crate::content::{PageId, PageKind};
use crate::forest::index::Place;
use crate::select::{Demand, Urgency};

/// From class to class gains fall by this factor, inside a class by less than 2, which is what the request manager lets a
/// resident page give way for: so it gives way to one of a better class, and two of one class do not drive each other out.
const GAIN_PER_CLASS: f64 = 0.25;

/// Segments of the index are a class before all others: nothing below them can be asked for without them.
const SEGMENT_GAIN: f64 = 1.0 / GAIN_PER_CLASS;

/// Demands ahead of the front in the order given, but for segments; classes count from 0, the best, and do not fall.
pub fn predicted(queue: impl ExactSizeIterator<Item = (u32, PageId, Place)>) -> Vec<Demand> {
    let in_all = queue.len().max(1) as f64;
    let demand = |(at, (class, page, place)): (usize, (u32, PageId, Place))| {
        let of_class =
            if page.kind == PageKind::Segment { SEGMENT_GAIN } else { GAIN_PER_CLASS.powf(f64::from(class)) };
        let gain = of_class * (1.0 - at as f64 / (2.0 * in_all));
        Demand { page, place, urgency: Urgency::Predicted, gain }
    };
    queue.enumerate().map(demand).collect()
}
