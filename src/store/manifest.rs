//! `world.json`: its first line carries what the file is and the xxh3 of all that follows.

use super::{Additions, NamedView, StoreError};
use serde::{Deserialize, Serialize};
use std::path::Path;
use xxhash_rust::xxh3::xxh3_64;

/// A world's description; unknown keys are kept out, missing ones refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// Of the format: [`Manifest::VERSION`], or [`Manifest::CHANGED_VERSION`] once something was added.
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
    /// Bookmarks of the recipe; see [`super::bookmarks`] for what a viewer offers.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub views: Vec<NamedView>,
    /// What was added or replaced since the world was made.
    #[serde(default, skip_serializing_if = "Additions::is_none")]
    pub additions: Additions,
}

const FIRST_LINE: [&str; 2] = ["{ \"format\": \"stoop world\", \"checksum\": \"", "\",\n"];
const CHECKSUM_DIGITS: usize = 16;

impl Manifest {
    pub const VERSION: u32 = 1;
    /// Of worlds with additions: a program that does not know of them would read the old index with the new manifest.
    pub const CHANGED_VERSION: u32 = 2;
    pub const DATUM: &str = "WGS84 ellipsoidal";

    /// The file's bytes.
    pub fn to_bytes(&self) -> Vec<u8> {
        // A structure of strings, numbers and lists has a JSON text.
        let text = serde_json::to_string_pretty(self).unwrap_or_default();
        let rest = text.strip_prefix("{\n").unwrap_or(&text);
        let [before, after] = FIRST_LINE;
        format!("{before}{:016x}{after}{rest}\n", xxh3_64(format!("{rest}\n").as_bytes())).into_bytes()
    }

    /// Credit lines to show, each once, in the order of the sources.
    pub fn credits(&self) -> Vec<String> {
        let mut credits: Vec<String> = Vec::new();
        for source in self.sources.iter().filter(|source| !source.credit.is_empty()) {
            if !credits.contains(&source.credit) {
                credits.push(source.credit.clone());
            }
        }
        credits
    }

    /// Reads a file's bytes; `file` is for messages.
    pub fn parse(bytes: &[u8], file: &Path) -> Result<Self, StoreError> {
        let fail = |cause: &str| StoreError::Manifest { file: file.to_owned(), cause: cause.to_owned() };
        let broken = |error: serde_json::Error| StoreError::Manifest {
            file: file.to_owned(),
            cause: format!("it cannot be read as a manifest: {error}"),
        };
        let value: serde_json::Value = serde_json::from_slice(bytes).map_err(broken)?;
        let version =
            value.get("version").and_then(serde_json::Value::as_u64).ok_or_else(|| fail("it has no version"))?;
        // The checksum's place may move in another version.
        if version > u64::from(Self::CHANGED_VERSION) {
            let found = u32::try_from(version).unwrap_or(u32::MAX);
            return Err(StoreError::FutureVersion { file: file.to_owned(), found, supported: Self::CHANGED_VERSION });
        }
        if !is_whole(bytes) {
            return Err(fail("its checksum is wrong: it was changed after it was written"));
        }
        let manifest: Self = serde_json::from_value(value).map_err(broken)?;
        manifest.additions.check().map_err(|cause| fail(&cause))?;
        match manifest.views.iter().find_map(|view| Some((&view.name, view.check().err()?))) {
            Some((name, cause)) => Err(fail(&format!("the view {name:?} makes no sense: {cause}"))),
            None => Ok(manifest),
        }
    }
}

/// Whether the checksum in the first line is that of what follows.
fn is_whole(bytes: &[u8]) -> bool {
    let [before, after] = FIRST_LINE;
    let parts = bytes.strip_prefix(before.as_bytes()).and_then(|tail| tail.split_at_checked(CHECKSUM_DIGITS));
    let Some((digits, Some(rest))) = parts.map(|(digits, tail)| (digits, tail.strip_prefix(after.as_bytes()))) else {
        return false;
    };
    digits == format!("{:016x}", xxh3_64(rest)).as_bytes()
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LayerInfo {
    pub level_max: u8,
    /// Pages at level 0, 1, …
    pub pages_by_level: Vec<u64>,
    pub bytes_by_level: Vec<u64>,
}

/// A building set or the like.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
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
    /// What there is of each rep, the finest first; empty in worlds made before there were several.
    #[serde(default)]
    pub reps: Vec<RepInfo>,
}

/// The pages of one rep of a collection.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RepInfo {
    pub rep: u8,
    pub pages: u64,
    pub bytes: u64,
    /// Objects, or blocks and landmarks that stand for them.
    pub objects: u64,
    /// Largest error against the finest rep, metres.
    pub error_max_m: f64,
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

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
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
