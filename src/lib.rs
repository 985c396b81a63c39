//! Stoop flies from the whole Earth to a doorstep without a pause, over worlds far larger than memory.
//!
//! The modules, lowest first, and who may use whom: ARCHITECTURE.md; `tests/layers.rs` enforces it.

pub mod camera;
pub mod cells;
pub mod chart;
pub mod content;
pub mod engine;
pub mod forest;
pub mod geodesy;
pub mod layout;
pub mod paging;
#[cfg(feature = "prepare")]
pub mod prepare;
pub mod record;
pub mod render;
pub mod select;
pub mod simulate;
pub mod storage;
pub mod store;
pub mod units;
#[cfg(feature = "window")]
pub mod window;
