//! Linked cells: where to look for the objects that can reach into a quadrant (Davis et al. 1999, §III).
//!
//! Objects are kept in the cell that holds their centre, and are smaller than `L_q` there, so that they reach at most
//! half a cell beyond it: what reaches into a quadrant has its centre in the cell or in the nearest neighbours.

use crate::forest::{CellId, FewCells, Quadrant, Side};

/// The cells whose objects can reach into a quadrant of `cell`, `cell` first: all objects with
/// `reach < l_q_m` of the cell that holds their centre (see [`CellId::l_q_m`]). Quadrants are the halves of the cell
/// E–W and N–S, also where a child row is thinned.
///
/// - Four: the cell, its neighbour at the quadrant's E or W side, and the two beyond its N or S side.
/// - Five where the row on that side has twice as many columns: three stand there, the one at the quadrant and one on
///   each side of it.
/// - Four or three where the row on that side has half as many: the two coincide when the quadrant lies in the middle
///   of their cell.
/// - Eight at a pole: all polar cells.
///
/// Across zones and the antimeridian alike.
pub fn linked_cells(cell: CellId, quadrant: Quadrant) -> FewCells {
    let outward = if quadrant.is_east() { Side::East } else { Side::West };
    let vertical = if quadrant.is_north() { Side::North } else { Side::South };
    let mut linked = FewCells::new(cell);
    if cell.touches_pole(vertical) {
        let mut next = cell;
        for _ in 0..7 {
            next = beside(next, Side::East);
            linked.push(next);
        }
        return linked;
    }
    linked.push(beside(cell, outward));
    let beyond = cell.edge_neighbors(vertical);
    match *beyond {
        [west, east] => {
            let at = if quadrant.is_east() { east } else { west };
            linked.push(at);
            linked.push(beside(at, Side::West));
            linked.push(beside(at, Side::East));
        }
        [at, ..] => {
            linked.push(at);
            let coincide = at.thinning() > cell.thinning() && !is_at_edge(cell, quadrant);
            if !coincide {
                linked.push(beside(at, outward));
            }
        }
        [] => {}
    }
    linked
}

/// The linked cells of the quadrant that holds a place, at a level.
pub fn linked_cells_at(lat_rad: f64, lon_rad: f64, level: u8) -> FewCells {
    let cell = CellId::containing(lat_rad, lon_rad, level);
    linked_cells(cell, quadrant_at(cell, lat_rad, lon_rad))
}

/// The quadrant of the cell that is nearest to a place in it.
pub fn quadrant_at(cell: CellId, lat_rad: f64, lon_rad: f64) -> Quadrant {
    let center = cell.bounds().center();
    let from_center = (lon_rad - center.lon_rad + std::f64::consts::PI).rem_euclid(std::f64::consts::TAU);
    match (lat_rad >= center.lat_rad, from_center >= std::f64::consts::PI) {
        (false, false) => Quadrant::SouthWest,
        (false, true) => Quadrant::SouthEast,
        (true, false) => Quadrant::NorthWest,
        (true, true) => Quadrant::NorthEast,
    }
}

/// The next cell in the row.
fn beside(cell: CellId, side: Side) -> CellId {
    cell.edge_neighbors(side).first().copied().unwrap_or(cell)
}

/// Next to a row of half as many columns: whether the quadrant's outer side is a side of the wide cell as well.
fn is_at_edge(cell: CellId, quadrant: Quadrant) -> bool {
    (cell.xy().0 & 1 == 1) == quadrant.is_east()
}
