//! The native window: input, frames, panels. The only module that sees winit; what it draws beside the world is egui's.
