//! Pictures on faces: from files or models, into one atlas for each page of objects.
//!
//! Faces that meet in their picture make an island; the box round it is a part of the atlas, with a gutter. Parts are
//! scaled down together until the atlas is in its bounds. What repeats is baked into the part as often as faces need it.

mod bake;
mod islands;
mod picture;
mod shelves;

pub use bake::{ATLAS_BYTES_MAX, Baked, REPEATS_MAX, bake, texels};
pub use picture::{Picture, Wrap};
