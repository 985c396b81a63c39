//! Objects of one world on the ground of another.
//!
//! A set was prepared on the finest terrain of its own world. Where worlds lie over one another and the finest terrain
//! there is another world's, each building moves up or down by the difference of the two at the middle of its box; parts
//! of one building move together. Walls go on down to the lowest new ground along the footprint.

use super::error::StoreError;
use super::ground::finest_terrain;
use super::stack::Stack;
use crate::content::Prism;
use std::collections::HashMap;
use std::f64::consts::{PI, TAU};

/// Differences below this are left, metres: half of what heights are stored by.
const LEAST_M: f64 = 0.01;
/// Visible walls are never less than this, metres.
const WALL_MIN_M: f64 = 0.05;

/// Where one object's ground is, in its own world and in the whole.
struct Grounds {
    own_m: f64,
    whole_m: f64,
    /// Of the whole's terrain.
    error_m: f64,
}

/// Sets the prisms of a page of the world numbered `world` on the ground of the whole; false where nothing moved.
pub(super) fn reseat(stack: &Stack, world: usize, prisms: &mut [Prism]) -> Result<bool, StoreError> {
    let mut shifts: HashMap<u32, f64> = HashMap::new();
    let mut moved = false;
    for prism in prisms {
        let middle = prism.footprint();
        let Some(grounds) = grounds(stack, world, middle.lat_rad, middle.lon_rad)? else { continue };
        let shift_m = *shifts.entry(prism.id).or_insert(grounds.whole_m - grounds.own_m);
        if shift_m.abs() >= LEAST_M {
            let lowest_m = lowest_m(stack, prism)?.unwrap_or(grounds.whole_m);
            set(prism, shift_m, &grounds, lowest_m);
            moved = true;
        }
    }
    Ok(moved)
}

fn set(prism: &mut Prism, shift_m: f64, grounds: &Grounds, lowest_m: f64) {
    let top_m = f64::from(prism.top_m) + shift_m;
    let base_m = f64::from(prism.base_m) + shift_m;
    prism.top_m = top_m as f32;
    if prism.foundation_m <= 0.0 {
        prism.base_m = base_m as f32;
        return;
    }
    let base_m = base_m.max(grounds.whole_m).min(top_m - WALL_MIN_M);
    prism.base_m = base_m as f32;
    prism.foundation_m = ((base_m - lowest_m).max(0.0) + grounds.error_m) as f32;
}

/// `None` where the whole's ground is that of the object's own world, or one of them has none.
fn grounds(stack: &Stack, world: usize, lat_rad: f64, lon_rad: f64) -> Result<Option<Grounds>, StoreError> {
    let lon_rad = wrap(lon_rad);
    let Some((whole, error_m)) = whole_m(stack, lat_rad, lon_rad, Some(world))? else { return Ok(None) };
    let own_m = stack.grounds[world].height_m(&stack.worlds[world], lat_rad, lon_rad)?;
    Ok(own_m.map(|own_m| Grounds { own_m, whole_m: whole, error_m }))
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
