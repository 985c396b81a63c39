//! What is fetched, when, in which order, and what is dropped. Pure but for the servers, which are threads without
//! policy.

mod estimate;
mod manager;
mod policy;
mod servers;

pub use manager::{
    Command, Completion, Event, Limits, ManagerError, ManagerStats, RequestManager, least_footprint_bytes,
};
pub use servers::{
    Delivery, InlineServer, Outcome, PageReader, PageServer, ReadError, ServerError, ServerLimits, ThreadedServers,
};
