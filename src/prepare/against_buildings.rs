//! Stored building sets against their cleaned sources: is every prism there, and how far are its outline and heights
//! from what they should be.

use super::against::AgainstError;
use super::against_reps::{self, Homes, RepReport};
use super::buildings::{Ground, gather};
use super::{Elevation, OnProgress, Recipe, collections};
use crate::content::{PageId, PageKind, Prism};
use crate::forest::CellId;
use crate::geodesy::SEMI_MAJOR_M;
use crate::store::World;
use serde::Serialize;
use std::collections::HashMap;
use std::path::Path;

/// One rep of a collection; distances in metres.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct BuildingsReport {
    pub name: String,
    /// 0 is the finest.
    pub rep: u8,
    pub prisms: u64,
    /// Prisms of the source that the world lacks, and the other way round.
    pub missing: u64,
    pub surplus: u64,
    /// Between a corner of an outline in the source and the nearest one stored.
    pub outline_worst_m: f64,
    pub outline_mean_m: f64,
    /// Of the upper and lower edges of the walls.
    pub height_worst_m: f64,
    pub height_mean_m: f64,
}

/// Reads the building sets of the recipe again and compares them with the world's.
pub fn compare(
    world: &World,
    recipe: &Recipe,
    root: &Path,
    elevation: &Elevation,
    on_progress: OnProgress<'_>,
) -> Result<(Vec<BuildingsReport>, Vec<RepReport>), AgainstError> {
    let ground = Ground { height_m: &|lat_rad, lon_rad| elevation.height_m(lat_rad, lon_rad), error_m: &|_, _| 0.0 };
    let vertical = collections::vertical_of(recipe);
    let (mut reports, mut reps) = (Vec::new(), Vec::new());
    for (number, section) in recipe.buildings.iter().enumerate() {
        let mut stored = stored_prisms(world, number as u8)?;
        let mut report = BuildingsReport { name: section.name.clone(), ..BuildingsReport::default() };
        let mut corners = 0u64;
        let mut homes = Homes::new();
        for source in gather(section, root, vertical, &ground, on_progress)?.objects {
            match take_nearest(&mut stored, &source.prism) {
                Some((found, root)) => {
                    report.add(&source.prism, &found, &mut corners);
                    homes.entry(root).or_default().push(source.prism);
                }
                None => report.missing += 1,
            }
        }
        report.surplus = stored.values().map(|left| left.len() as u64).sum();
        report.outline_mean_m /= corners.max(1) as f64;
        report.height_mean_m /= (2 * report.prisms).max(1) as f64;
        reports.push(report);
        reps.extend(against_reps::compare(world, &section.name, number as u8, &homes)?);
    }
    Ok((reports, reps))
}

/// With the roots of their pages.
type ById = HashMap<u32, Vec<(Prism, CellId)>>;

/// The finest prisms of a collection by id; those of one building share theirs.
fn stored_prisms(world: &World, collection: u8) -> Result<ById, AgainstError> {
    let mut stored = ById::new();
    for node in world.index().trees().flat_map(|tree| tree.nodes()) {
        for entry in node.objects().filter(|entry| entry.collection == collection && entry.rep == 0) {
            let id = PageId { cell: node.cell(), kind: PageKind::Objects { collection, rep: 0 } };
            let bytes = world.read(id, entry.place)?;
            for prism in world.prisms(id, entry.place, &bytes)?.prisms {
                stored.entry(prism.id).or_default().push((prism, node.cell()));
            }
        }
    }
    Ok(stored)
}

/// Of the stored prisms of a source prism's building, the one that is most like it.
fn take_nearest(stored: &mut ById, source: &Prism) -> Option<(Prism, CellId)> {
    let parts = stored.get_mut(&source.id)?;
    let unlikeness = |prism: &Prism| {
        let heights = f64::from((prism.top_m - source.top_m).abs()) + f64::from((prism.base_m - source.base_m).abs());
        outline(source, prism).0 + heights
    };
    let best = (0..parts.len()).min_by(|&a, &b| unlikeness(&parts[a].0).total_cmp(&unlikeness(&parts[b].0)))?;
    Some(parts.swap_remove(best))
}

impl BuildingsReport {
    fn add(&mut self, source: &Prism, found: &Prism, corners: &mut u64) {
        self.prisms += 1;
        let (worst_m, sum_m, count) = outline(source, found);
        self.outline_worst_m = self.outline_worst_m.max(worst_m);
        self.outline_mean_m += sum_m;
        *corners += count;
        for (a, b) in [(source.top_m, found.top_m), (source.base_m, found.base_m)] {
            let off_m = (f64::from(a) - f64::from(b)).abs();
            self.height_worst_m = self.height_worst_m.max(off_m);
            self.height_mean_m += off_m;
        }
    }
}

/// Worst distance, sum of distances and number of the source's corners, each to the nearest one found.
fn outline(source: &Prism, found: &Prism) -> (f64, f64, u64) {
    let (mut worst_m, mut sum_m, mut count) = (0.0f64, 0.0, 0);
    for corner in source.rings.iter().flatten() {
        let near = found.rings.iter().flatten().map(|other| distance_m(*corner, *other)).fold(f64::INFINITY, f64::min);
        worst_m = worst_m.max(near);
        sum_m += near;
        count += 1;
    }
    (worst_m, sum_m, count)
}

/// Between places a few metres apart; longitude and latitude in radians.
fn distance_m([lon_a, lat_a]: [f64; 2], [lon_b, lat_b]: [f64; 2]) -> f64 {
    ((lon_a - lon_b) * lat_a.cos()).hypot(lat_a - lat_b) * SEMI_MAJOR_M
}
