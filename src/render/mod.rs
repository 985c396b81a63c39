//! Pictures of a selection: device, arenas, passes, read-back.
//!
//! One pass is one Rust file and one WGSL file of the same name; bind group 0 is always the frame. Arenas have hard
//! limits; nothing here knows of paging. Only `eye` subtracts the eye: everything before it is f64, all behind it f32.
//!
//! A renderer draws into its own pictures. Behind the feature `window` one of them can be copied to what a window shows
//! (`surface`: what is shown; `present`: the copy; `overlay`: egui's panels over it; `screen`: the three together).

mod atlases;
mod culling;
mod device;
mod eye;
mod frame;
mod ids;
mod imagery;
mod layout;
mod meshes;
mod objects;
mod options;
#[cfg(feature = "window")]
mod overlay;
#[cfg(feature = "window")]
mod overlay_textures;
mod pass;
#[cfg(feature = "window")]
mod present;
mod read_back;
mod renderer;
mod runs;
#[cfg(feature = "window")]
mod screen;
mod sky;
#[cfg(feature = "window")]
mod surface;
mod targets;
mod terrain;
mod timing;

pub use device::RenderError;
pub use eye::eye_relative;
pub use ids::{IdOf, SKY_ID, is_cell};
pub use layout::{Field, Mirror, mirrored_structs, shader_sources};
pub use objects::Fading;
pub use options::{DrawOptions, FrameStats, GpuLimits, Haze, Sun};
#[cfg(feature = "window")]
pub use overlay::Overlay;
pub use renderer::{ArenaFull, Renderer, SizedPixels};
#[cfg(feature = "window")]
pub use screen::Presented;
#[cfg(feature = "window")]
pub use surface::Skip;
