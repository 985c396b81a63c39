//! Imagery: which cells have a picture, and their texels. Every level is made from the composite picture, averaged
//! over the level's own texels, so that neighbours agree on the gutter between them.

use super::Pictures;
use super::task::{Stopped, Task};
use crate::content::{IMAGERY_GUTTER_PX, IMAGERY_PX, IMAGERY_STORED_PX};
use crate::forest::{CellId, Zone};
use crate::geodesy::GeoBounds;
use std::collections::BTreeSet;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// What shows where no picture is: the colour of bare ground from afar.
const BARE_RGB: [u8; 3] = [122, 118, 104];
/// Cells are not refined for less than this gain.
const HAIR: f64 = 1e-6;

/// N–S size of a texel of a cell's picture, radians.
pub fn texel_rad(bounds: &GeoBounds) -> f64 {
    bounds.height_rad() / f64::from(IMAGERY_PX)
}

/// The cells of a zone that have a picture: down to where texels are as fine as the finest picture there, and none
/// that shows no more than its parent's picture does.
pub fn plan(pictures: &Pictures, zone: Zone, task: &Task) -> Result<BTreeSet<CellId>, Stopped> {
    let finest = |cell: CellId| pictures.finest_texel_rad(&cell.bounds());
    let mut cells = BTreeSet::new();
    let mut open: Vec<_> = [zone.root()].into_iter().filter(|&root| finest(root).is_some()).collect();
    while let Some(cell) = open.pop() {
        task.step()?;
        cells.insert(cell);
        let worth = texel_rad(&cell.bounds()) * (1.0 - HAIR);
        open.extend(cell.children().filter(|&child| finest(child).is_some_and(|finest| finest < worth)));
    }
    Ok(cells)
}

/// The texels of a cell with their gutter: RGB8, rows from the north; bare ground where no picture shows anything. A
/// planned cell always has a page, though its picture be smaller than its texels: a layer has no gaps from the root down.
pub fn texels(pictures: &Pictures, cell: CellId) -> Vec<u8> {
    let bounds = cell.bounds();
    let texel_rad = texel_rad(&bounds);
    let middle = |i: u32| (f64::from(i) - f64::from(IMAGERY_GUTTER_PX) + 0.5) / f64::from(IMAGERY_PX);
    let mut rgb = Vec::with_capacity((IMAGERY_STORED_PX * IMAGERY_STORED_PX * 3) as usize);
    for row in 0..IMAGERY_STORED_PX {
        for column in 0..IMAGERY_STORED_PX {
            let place = bounds.at(middle(column), 1.0 - middle(row), 0.0);
            let (lat_rad, lon_rad) = on_globe(place.lat_rad, place.lon_rad);
            rgb.extend(pictures.color(lat_rad, lon_rad, texel_rad).unwrap_or(BARE_RGB));
        }
    }
    rgb
}

/// The gutter beyond a pole repeats the last row; beyond the antimeridian it goes round.
fn on_globe(lat_rad: f64, lon_rad: f64) -> (f64, f64) {
    let turns = (lon_rad + PI).rem_euclid(TAU);
    (lat_rad.clamp(-FRAC_PI_2, FRAC_PI_2), turns - PI)
}
