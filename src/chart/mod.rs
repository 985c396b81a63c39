//! From runs to charts: speed against accuracy.

mod choose;
mod compare;
mod figure;
mod figures;
mod flown;
mod gauge;
mod heights;
mod images;
mod live;
mod page;
mod pareto;
mod plot;
mod profile;
mod report;
mod rows;
mod sheet;
mod sweep;
mod table;

pub use choose::{Candidate, DEBT_AIM_PX, FRAME_AIM_MS, FrameTimes};
pub use compare::{Case, Flight, Outcome, WARM_S, run};
pub use figure::{Axis, Curve, Figure, Panel, Scale, Spot, Stroke};
pub use figures::distance::cost_by_distance;
pub use figures::heights::height_errors;
pub use figures::layouts::redundancy_by_delay;
pub use flown::{Flown, Measured, Moment, REFERENCE_PX, fly_all};
pub use heights::Truth;
pub use images::{ImageError, PICTURES_MAX, PictureError, compare, picture_errors};
pub use live::{LiveFlight, fly_live, frame_time_figures, frame_times};
pub use pareto::{Choice, pareto_front};
pub use plot::{Palette, PlotError, svg};
pub use profile::{Profile, ProfileError};
pub use report::{DATA_FILE, PAGE_FILE, PROFILE_FILE, Report, ReportError};
pub use rows::{RowsError, figure_of_rows};
pub use sheet::{Cell, Sheet};
pub use sweep::{RUNS_MAX, Run, Sweep};
pub use table::{csv, markdown};
