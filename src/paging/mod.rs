//! What is fetched, when, in which order, and what is dropped. Pure but for the servers, which are threads without
//! policy.

mod manager;

pub use manager::{Command, Completion, Event, Limits, ManagerError, ManagerStats, RequestManager};
