//! Where the picture is taken from: views, and flights.

mod path;
mod surroundings;
mod view;

pub use path::{FlightPath, PathError};
pub use surroundings::{Obstacle, Surroundings};
pub use view::{Frustum, Pose, View, ViewAxes};
