//! Source files → world. The only user of PROJ and of the readers of raster and vector formats; run-time code never
//! sees what is in here. Behind the feature `prepare`.

pub mod against;
pub mod against_buildings;
pub mod against_reps;
pub mod assemble;
pub mod buildings;
pub mod collections;
pub mod crs;
pub mod elevation;
pub mod error;
pub mod expression;
mod geotiff_write;
mod graft;
pub mod imagery;
pub mod imagery_source;
pub mod into;
pub mod model;
pub mod paint;
pub mod pipeline;
pub mod placement;
pub mod raster;
pub mod recipe;
mod recipe_hash;
mod relief;
pub mod source;
pub mod stage;
pub mod task;
pub mod terrain;
pub mod textures;
pub mod vector;
mod view_section;
mod world_ground;
pub mod zone;

pub use elevation::Elevation;
pub use error::PrepareError;
pub use geotiff_write::write_geotiff;
pub use imagery_source::{PictureSource, Pictures};
pub use recipe::{LayoutSection, Recipe};

/// How far a long job is; called often, from several threads.
#[derive(Clone, Copy, Debug)]
pub struct Progress<'a> {
    /// What is being done, such as "read elevation".
    pub stage: &'static str,
    /// The file or thing it is being done to.
    pub item: &'a str,
    pub done: u64,
    pub total: u64,
}

/// Receives progress; `&|_| {}` ignores it.
pub type OnProgress<'a> = &'a (dyn Fn(Progress<'_>) + Sync);
