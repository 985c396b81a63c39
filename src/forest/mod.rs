//! 32 zones of 45° × 45°, each the root of a quadtree (Davis et al. 1999, §III), thinned towards the poles.

mod cell;
pub mod index;
mod neighbors;
mod record;
mod sides;
mod thinning;

pub use cell::{CellId, LEVEL_MAX, Quadrant, ZONE_COUNT, ZONE_DEG, Zone};
pub use neighbors::{FewCells, Side};
pub use sides::CellSides;
pub use thinning::{columns, thinning};
