//! Terrain: the pyramid of cells, what each draws, and how far that is from the truth.

mod measure;
mod page;
mod pyramid;
mod truth;

pub use page::build;
pub use pyramid::{CellPlan, Terrain, ZonePlan, deviation_m};
pub use truth::Truth;

#[cfg(test)]
mod tests;
