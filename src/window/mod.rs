//! The native window: input, frames, panels. The only module that sees winit; what it draws beside the world is egui's.

pub mod files;
pub mod overlays;
pub mod panels;
pub mod settings;
