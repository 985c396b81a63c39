//! Where the picture is taken from: views, and flights.

mod view;

pub use view::{Frustum, Pose, View, ViewAxes};
