//! From logs to charts: speed against accuracy.

mod compare;
mod table;

pub use compare::{Case, Flight, Outcome, WARM_S, run};
pub use table::{csv, markdown};
