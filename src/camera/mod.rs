//! Where the picture is taken from: views, and flights.

mod path;
mod view;

pub use path::{FlightPath, PathError};
pub use view::{Frustum, Pose, View, ViewAxes};
