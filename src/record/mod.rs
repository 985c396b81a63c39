//! What stays of a flight: logs, summaries, pictures, videos.

mod distribution;
mod flight;
mod memory;
mod pictures;
mod video;

pub use distribution::Distribution;
pub use flight::{
    Arrival, FRAMES_FILE, FlightHeader, FlightLog, FlightSummary, RecordError, SHARP_COVERAGE, TIMINGS_FILE,
};
pub use memory::peak_rss_bytes;
pub use pictures::{NpyScalar, picture_name, png_bytes, write_npy, write_png, write_text};
pub use video::Video;
