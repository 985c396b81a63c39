//! `--against` where readers of source formats are not built in.

use std::path::Path;
use stoop::chart::Truth;
use stoop::geodesy::{GeoBounds, Geodetic};

/// There are none.
pub enum Sources {}

impl Sources {
    pub fn open(_: &Path, _: Option<&Path>) -> anyhow::Result<Self> {
        anyhow::bail!("--against without the feature `prepare`: build stoop-chart with it")
    }

    pub fn check(&self) -> anyhow::Result<()> {
        match *self {}
    }
}

impl Truth for Sources {
    fn height_m(&self, _: f64, _: f64) -> Option<f64> {
        match *self {}
    }

    fn post_near(&self, _: f64, _: f64, _: &GeoBounds) -> Option<Geodetic> {
        match *self {}
    }
}
