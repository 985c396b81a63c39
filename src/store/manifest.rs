//! `world.json`.

use serde::{Deserialize, Serialize};

/// A world's description; unknown keys are kept out, missing ones refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// Of the format; 1.
    pub version: u32,
    pub name: String,
    /// Always "WGS84 ellipsoidal".
    pub datum: String,
    /// xxh3 of the recipe and of what its sources were, hexadecimal.
    pub recipe_hash: String,
    pub terrain: Option<LayerInfo>,
    pub imagery: Option<LayerInfo>,
    pub collections: Vec<CollectionInfo>,
    pub sources: Vec<SourceInfo>,
    /// Lowest and highest drawn height, metres above the ellipsoid.
    pub height_range_m: (f64, f64),
    /// Zones with an index, ascending.
    pub zones: Vec<u8>,
    pub index_bytes: u64,
    pub pack_bytes: u64,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LayerInfo {
    pub level_max: u8,
    /// Pages at level 0, 1, …
    pub pages_by_level: Vec<u64>,
    pub bytes_by_level: Vec<u64>,
}

/// A building set or the like.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CollectionInfo {
    pub name: String,
    pub objects: u64,
    pub pages: u64,
    pub bytes: u64,
    pub changeover_level: u8,
    /// The level of VGIS's rule for one size, the deepest with L₀ < L_q (Davis et al. 1999, §III.B).
    pub vgis_level: u8,
    /// Expected work per query by candidate level.
    pub cost_curve: Vec<CostPoint>,
    /// Objects that live in a coarser level than the changeover level.
    pub large_objects: u64,
    /// Features of the source set aside, by reason.
    pub set_aside: std::collections::BTreeMap<String, u64>,
    pub repaired: std::collections::BTreeMap<String, u64>,
    pub bounds_deg: [f64; 4],
    pub attributes: Vec<String>,
}

/// Expected work of one query at a candidate changeover level.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CostPoint {
    pub level: u8,
    pub cells: f64,
    pub objects: f64,
    pub large_objects: f64,
    pub pages: f64,
    pub cost: f64,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SourceInfo {
    pub kind: String,
    pub file: String,
    /// Credit line to show; empty when the recipe gives none.
    #[serde(default)]
    pub credit: String,
    #[serde(default)]
    pub licence: String,
    /// Finest spacing of its samples, metres; 0 for vectors.
    pub spacing_m: f64,
    /// Features or samples.
    pub count: u64,
}
