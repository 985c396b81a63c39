//! The live tree: which pages are resident, and so what is drawable. Nothing else may call a page drawable.

mod linked;
mod live;

pub use linked::{linked_cells, linked_cells_at, quadrant_at};
pub use live::LiveTree;
