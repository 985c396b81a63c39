//! What is fetched, when, in which order, and what is dropped. Pure but for the servers, which are threads without
//! policy.

mod estimate;
mod forecast;
mod levels;
mod manager;
mod modelled;
mod order;
mod pace;
mod planner;
pub mod policy;
mod report;
mod servers;
mod slow;
mod tolerance;
mod usage;

pub use crate::select::service_order;
pub use estimate::{PICTURE_GPU_BYTES, held_bytes, least_held_bytes};
pub use forecast::{Forecast, Forecaster, KnownWay, Predicted};
pub use levels::DrawnLevels;
pub use manager::pinned_demands;
pub use manager::{
    Command, Completion, Event, LayerCounts, Limits, ManagerError, ManagerStats, PageCounts, PageState, RangeRead,
    RequestManager, least_footprint_bytes,
};
pub use modelled::Modelled;
pub use order::{is_front, ranked};
pub use pace::Pace;
pub use planner::{Frame, Planner, PlannerParams};
pub use policy::{ForesightParams, FrontParams, PolicyName, PolicyParams, RangeParams, UnknownPolicy, VgisParams};
pub use report::{FrameReport, FrameTimings, Totals};
pub use servers::{
    Delivery, InlineServer, OneByOne, Outcome, PageReader, PageRun, PageServer, RUNS_AT_ONCE, ReadError, SHUTDOWN_WAIT,
    ServerError, ServerLimits, ThreadedServers,
};
pub use slow::{Gate, SlowReader, Stall, StallError};
pub use tolerance::{Aim, DrawnTolerance, Lack};
pub use usage::{Usage, drawn_pages};
