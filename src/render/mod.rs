//! Pictures of a selection: device, arenas, passes, read-back.
//!
//! One pass is one Rust file and one WGSL file of the same name; bind group 0 is always the frame. Arenas have hard
//! limits; nothing here knows of paging. Only `eye` subtracts the eye: everything before it is f64, all behind it f32.

mod device;
mod eye;
mod frame;
mod ids;
mod imagery;
mod layout;
mod meshes;
mod objects;
mod options;
mod pass;
mod renderer;
mod sky;
mod targets;
mod terrain;

pub use device::RenderError;
pub use eye::eye_relative;
pub use ids::{IdOf, SKY_ID, is_cell};
pub use layout::{Field, Mirror, mirrored_structs, shader_sources};
pub use options::{DrawOptions, FrameStats, GpuLimits, Haze, Sun};
pub use renderer::{ArenaFull, Renderer};
