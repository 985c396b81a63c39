//! What is fetched, when, in which order, and what is dropped. Pure but for the servers, which are threads without
//! policy.

mod estimate;
mod manager;
mod order;
mod pace;
mod servers;
mod slow;

pub use manager::{
    Command, Completion, Event, LayerCounts, Limits, ManagerError, ManagerStats, PageCounts, PageState, RangeRead,
    RequestManager, least_footprint_bytes,
};
pub use order::{is_front, ranked, service_order};
pub use pace::Pace;
pub use servers::{
    Delivery, InlineServer, Outcome, PageReader, PageServer, ReadError, SHUTDOWN_WAIT, ServerError, ServerLimits,
    ThreadedServers,
};
pub use slow::{Gate, SlowReader, Stall, StallError};
