//! One frame, in order; the only module that sees everything.
//!
//! Selection and requests stay pure values; what is not pure (reads, threads, uploads, the real clock in `timings`)
//! meets them here. In lock-step the same code runs without threads, and a frame's report follows from the world and
//! the views alone.

mod atlas_reader;
mod audit;
mod cost;
mod footprint;
mod frame;
mod ground;
mod lift;
mod live;
mod lookout;
mod params;
mod pick_mesh;
mod picture;
mod reader;
mod residency;
mod scene;
mod sink;
mod stills;
mod surroundings;
mod throttle;
mod upload;
mod world_image;

pub use crate::paging::{Aim, FrameReport, FrameTimings, Lack};
pub use cost::{CostModel, Load, TimeBudget};
pub use footprint::{
    FLUSH_BYTES, IN_FLIGHT_MAX, MESH_MIN_BYTES, PAGES_IN_FLIGHT_MAX, Partition, READ_BYTES_PER_FRAME,
    REMOTE_BYTES_IN_FLIGHT, REMOTE_MODEL, REMOTE_THREADS_PER_LAYER, Reading, SCRATCH_PER_SERVER_BYTES, SLACK_BYTES,
    THREADS_PER_LAYER,
};
pub use frame::Engine;
pub use ground::GroundProbe;
pub use lift::{KnownLifts, LiftCopies, Lifts};
pub use live::{DisplayList, Live, Notify, Pace};
pub use lookout::{LOOKOUT_PX, Lookout, SeenObject};
pub use params::{EngineError, EngineParams, FrameRequest, Mode};
pub use pick_mesh::{PICK_MESH_BYTES_MAX, PickWork};
pub use picture::LastPicture;
pub use reader::Source;
pub use stills::Stills;
pub use surroundings::{DrawnGround, PickCache};
pub use throttle::{ClockSecs, ThrottledServer};
pub use upload::{UPLOAD_BYTES_PER_FRAME, UploadRate};
