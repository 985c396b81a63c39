//! What heights count from, and how high that lies above the ellipsoid.

use std::sync::LazyLock;
use std::sync::atomic::{AtomicU32, Ordering};

/// The surface that a source's heights count from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum VerticalDatum {
    /// The WGS84 ellipsoid.
    #[default]
    Ellipsoid,
    /// Mean sea level by EGM96 (Lemoine et al. 1998).
    Egm96,
    /// Mean sea level by EGM2008 (Pavlis et al. 2012), good to half a metre: see [`VerticalDatum::undulation_m`].
    Egm2008,
}

impl VerticalDatum {
    /// Height of the datum above the WGS84 ellipsoid, metres: add it to a source's heights. Any longitude; latitudes
    /// beyond a pole count as the pole.
    ///
    /// - `Egm96`: the model's harmonics to degree 360 at nodes of 15′, worked out when first asked for, bilinear
    ///   between: the same values as the grid `egm96_15` that PROJ ships. Between nodes that is off the harmonics by
    ///   4 cm in the mean square and by half a metre at steep trenches.
    /// - `Egm2008`: EGM96 plus the difference of the two models, which is known at nodes of 3° only and bilinear
    ///   between. Left out and worked out from its neighbours at 6°, a node of EGM2008 is off by 0.50 m in the mean
    ///   square (6.7 m at worst, in mountains); EGM2008's own nodes alone would give 2.3 m (18 m).
    pub fn undulation_m(self, lat_rad: f64, lon_rad: f64) -> f64 {
        let (lat_deg, lon_deg) = (lat_rad.to_degrees().clamp(-90.0, 90.0), lon_rad.to_degrees());
        match self {
            Self::Ellipsoid => 0.0,
            Self::Egm96 => EGM96_15.at(lat_deg, lon_deg),
            Self::Egm2008 => EGM96_15.at(lat_deg, lon_deg) + EGM2008_LESS_EGM96.at(lat_deg, lon_deg),
        }
    }
}

static EGM96_15: LazyLock<NodeGrid> = LazyLock::new(|| NodeGrid::new(0.25, egm96_m));
static EGM2008_LESS_EGM96: LazyLock<NodeGrid> = LazyLock::new(|| {
    NodeGrid::new(EGM2008_NODES_DEG, |lat_deg, lon_deg| egm2008_m(lat_deg, lon_deg) - egm96_m(lat_deg, lon_deg))
});

/// Spacing of the nodes at which the crate `egm2008` knows the model.
const EGM2008_NODES_DEG: f64 = 3.0;

fn egm96_m(lat_deg: f64, lon_deg: f64) -> f64 {
    egm96::egm96_compute_altitude_offset(lat_deg, lon_deg)
}

/// Exact at nodes only.
fn egm2008_m(lat_deg: f64, lon_deg: f64) -> f64 {
    // Nodes are in range, so that the error cannot happen; no correction is the harmless answer.
    egm2008::geoid_height(lat_deg as f32, lon_deg as f32).map_or(0.0, f64::from)
}

/// A function of latitude and longitude in degrees, known at the nodes of a global grid. Nodes are worked out when
/// first asked for and kept: (360/s) × (180/s + 1) values of 4 bytes, which is the limit of this cache (4.2 MB at 15′).
/// Threads may ask at once; at worst one works out a node again.
struct NodeGrid {
    step_deg: f64,
    columns: usize,
    rows: usize,
    value_at: fn(f64, f64) -> f64,
    /// Bits of an f32; [`UNKNOWN`] until asked for.
    nodes: Vec<AtomicU32>,
}

/// A NaN that no value is.
const UNKNOWN: u32 = u32::MAX;

impl NodeGrid {
    fn new(step_deg: f64, value_at: fn(f64, f64) -> f64) -> Self {
        let columns = (360.0 / step_deg).round() as usize;
        let rows = (180.0 / step_deg).round() as usize + 1;
        let nodes = (0..columns * rows).map(|_| AtomicU32::new(UNKNOWN)).collect();
        Self { step_deg, columns, rows, value_at, nodes }
    }

    /// Bilinear between nodes; latitude in −90..=90.
    fn at(&self, lat_deg: f64, lon_deg: f64) -> f64 {
        let row = (lat_deg + 90.0) / self.step_deg;
        let column = (lon_deg + 180.0).rem_euclid(360.0) / self.step_deg;
        let south = (row.floor() as usize).min(self.rows - 2);
        let west = (column.floor() as usize).min(self.columns - 1);
        let (v, u) = (row - south as f64, column - west as f64);
        let along = |row| self.node(row, west) * (1.0 - u) + self.node(row, west + 1) * u;
        along(south) * (1.0 - v) + along(south + 1) * v
    }

    fn node(&self, row: usize, column: usize) -> f64 {
        let column = column % self.columns;
        let slot = &self.nodes[row * self.columns + column];
        let known = slot.load(Ordering::Relaxed);
        if known != UNKNOWN {
            return f64::from(f32::from_bits(known));
        }
        let value = (self.value_at)(row as f64 * self.step_deg - 90.0, column as f64 * self.step_deg - 180.0) as f32;
        slot.store(value.to_bits(), Ordering::Relaxed);
        f64::from(value)
    }
}
