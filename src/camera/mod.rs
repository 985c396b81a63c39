//! Where the picture is taken from: views, flights, and the controller that moves the eye by hand.

mod arc;
mod clearance;
mod fly_to;
mod grab;
mod hold;
mod motion;
mod navigator;
mod orbit;
mod path;
mod pointer;
mod surroundings;
mod view;
mod walk;
mod zoom;

pub use clearance::{EYE_FROM_WALLS_M, EYE_OVER_GROUND_M};
pub use fly_to::{Destination, FlyTo};
pub use motion::{MAX_HEIGHT_M, MAX_HEIGHTS_PER_S, MAX_LOG_HEIGHT_PER_S};
pub use navigator::{Button, NavInput, Navigator, WHOLE_EARTH};
pub use path::{FlightPath, PathError};
pub use surroundings::{Obstacle, Surroundings};
pub use view::{Frustum, Pose, View, ViewAxes};
pub use walk::Held;
