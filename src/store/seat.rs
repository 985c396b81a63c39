//! Objects of one world on the ground of another.
//!
//! A set was prepared on the ground of its own world. Where worlds lie over one another and the finest terrain there is
//! another world's, each building moves up or down to it; parts of one building move together. A building that stood on
//! its ground, up to the error of that, stands on the new one; one whose base the source put elsewhere keeps its height
//! over the ground. Walls go on down to the lowest new ground along the footprint.

use super::error::StoreError;
use super::ground::finest_terrain;
use super::stack::Stack;
use crate::content::Prism;
use std::collections::HashMap;
use std::f64::consts::{PI, TAU};

/// Differences below this are left, metres: half of what heights are stored by.
const LEAST_M: f64 = 0.01;

/// Where one object's ground is, in its own world and in the whole.
struct Grounds {
    own_m: f64,
    own_error_m: f64,
    whole_m: f64,
    whole_error_m: f64,
}

impl Grounds {
    /// How far an object moves.
    fn shift_m(&self, prism: &Prism) -> f64 {
        let base_m = f64::from(prism.base_m);
        let stands = prism.foundation_m > 0.0 && (base_m - self.own_m).abs() <= self.own_error_m + LEAST_M;
        self.whole_m - if stands { base_m } else { self.own_m }
    }
}

/// Sets the prisms of a page of the world numbered `world` on the ground of the whole; false where nothing moved.
pub(super) fn reseat(stack: &Stack, world: usize, prisms: &mut [Prism]) -> Result<bool, StoreError> {
    let known = prisms.iter().map(|prism| grounds(stack, world, prism)).collect::<Result<Vec<_>, _>>()?;
    let mut shifts: HashMap<u32, f64> = HashMap::new();
    // Parts in the air go with those that stand.
    for is_standing in [true, false] {
        for (prism, grounds) in prisms.iter().zip(&known) {
            if let Some(grounds) = grounds.as_ref().filter(|_| (prism.foundation_m > 0.0) == is_standing) {
                shifts.entry(prism.id).or_insert_with(|| grounds.shift_m(prism));
            }
        }
    }
    let mut moved = false;
    for (prism, grounds) in prisms.iter_mut().zip(&known) {
        let (Some(grounds), Some(&shift_m)) = (grounds, shifts.get(&prism.id)) else { continue };
        if shift_m.abs() >= LEAST_M {
            let lowest_m = lowest_m(stack, prism)?.unwrap_or(grounds.whole_m);
            set(prism, shift_m, grounds, lowest_m);
            moved = true;
        }
    }
    Ok(moved)
}

fn set(prism: &mut Prism, shift_m: f64, grounds: &Grounds, lowest_m: f64) {
    let top_m = f64::from(prism.top_m) + shift_m;
    let base_m = f64::from(prism.base_m) + shift_m;
    prism.top_m = top_m as f32;
    for corner in prism.detail.iter_mut().flat_map(|detail| &mut detail.corners) {
        corner.height_m = (f64::from(corner.height_m) + shift_m) as f32;
    }
    if prism.foundation_m <= 0.0 {
        prism.base_m = base_m as f32;
        return;
    }
    let base_m = base_m.max(grounds.whole_m).min(top_m - Prism::WALL_MIN_M);
    prism.base_m = base_m as f32;
    prism.foundation_m = ((base_m - lowest_m).max(0.0) + grounds.whole_error_m).max(Prism::FOUNDATION_MIN_M) as f32;
}

/// `None` where the whole's ground is that of the object's own world, or one of them has none.
fn grounds(stack: &Stack, world: usize, prism: &Prism) -> Result<Option<Grounds>, StoreError> {
    let middle = prism.footprint();
    let (lat_rad, lon_rad) = (middle.lat_rad, wrap(middle.lon_rad));
    let Some((whole_m, whole_error_m)) = whole_m(stack, lat_rad, lon_rad, Some(world))? else { return Ok(None) };
    let own = &stack.worlds[world];
    let Some((cell, terrain)) = finest_terrain(own.index(), lat_rad, lon_rad) else { return Ok(None) };
    let page = stack.grounds[world].page(own, cell, terrain)?;
    let own_error_m = f64::from(terrain.error_m);
    let own_m = page.surface_height_m(lat_rad, lon_rad, 1.0);
    Ok(own_m.map(|own_m| Grounds { own_m, own_error_m, whole_m, whole_error_m }))
}

/// The ground of the whole and its error; `None` where there is none, or it is that of the world left out.
fn whole_m(stack: &Stack, lat_rad: f64, lon_rad: f64, but: Option<usize>) -> Result<Option<(f64, f64)>, StoreError> {
    let Some((cell, terrain)) = finest_terrain(&stack.index, lat_rad, lon_rad) else { return Ok(None) };
    let found = stack.rows[cell.zone().index()].locate(terrain.place);
    let Some((at, place)) = found.filter(|(at, _)| Some(*at) != but) else { return Ok(None) };
    let own = crate::forest::index::TerrainEntry { place, ..terrain };
    let page = stack.grounds[at].page(&stack.worlds[at], cell, own)?;
    Ok(page.surface_height_m(lat_rad, lon_rad, 1.0).map(|height_m| (height_m, f64::from(terrain.error_m))))
}

/// Lowest ground of the whole at the corners.
fn lowest_m(stack: &Stack, prism: &Prism) -> Result<Option<f64>, StoreError> {
    let mut lowest: Option<f64> = None;
    for &[lon_rad, lat_rad] in prism.rings.first().into_iter().flatten() {
        if let Some((height_m, _)) = whole_m(stack, lat_rad, wrap(lon_rad), None)? {
            lowest = Some(lowest.map_or(height_m, |lowest| lowest.min(height_m)));
        }
    }
    Ok(lowest)
}

/// A longitude within ±π.
fn wrap(lon_rad: f64) -> f64 {
    (lon_rad + PI).rem_euclid(TAU) - PI
}
