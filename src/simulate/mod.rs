//! Flights by a virtual clock: select and paging are driven as in real runs, the storage is a model, and nothing is drawn.
//! No GPU, no thread, no clock: the same input and seed give the same frames to the bit, hundreds of them a second.

mod bound;
mod pages;
mod run;

pub use bound::{Budget, FrameBound, bytes_by};
pub use pages::{CACHE_BYTES_MAX, Library};
pub use run::{FIXED_BYTES, Frame, Setup, Simulation, SimulationError, fly};
