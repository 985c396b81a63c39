//! Single-seek layouts (Jiang, Sajadi, Gopi 2013): a region is cut into navigation cells, a grid over the ground by bands of
//! altitude. What may be needed anywhere in a cell is its set; what the next cell needs and this one does not lies in the
//! layout's file as one run, so that a crossing costs one seek, or one request. The price is redundancy: pages lie in many
//! runs.
//!
//! [`Builder`] finds the sets and chooses the cells' side; [`Layout`] is what a file tells; [`Rider`] follows an eye through
//! it. Nothing here draws: what is seen is asked of a [`Witness`].

mod build;
mod choice;
mod classes;
mod compare;
mod grid;
mod head;
mod lemma;
mod order;
mod packed;
mod ride;
mod sets;
mod sight;
mod survey;

pub use build::{BuildError, Builder, Built, ByStorage, Progress};
pub use choice::{Choice, CurvePoint, PAYS_FROM, Verdict, choose, verdict};
pub use compare::{Crossing, Delays, From, crossing_delays};
pub use grid::{Direction, NavCell, NavGrid};
pub use head::{Layout, LayoutError};
pub use lemma::{Prediction, RepClass, lemmas};
pub use order::{LinearOrder, hilbert_order, pages_of, reordered};
pub use ride::{Ride, RideCounts, Rider, Run, RunCause, times_ahead_s};
pub use sets::{CellSet, Draft, Hidden, Pages, SEEN_BELOW_M, Survey};
pub use sight::{Seen, Witness};
pub use survey::{LayoutParams, Viewpoint, directions, octant_fov_rad, octant_px, wanted};
