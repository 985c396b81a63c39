//! At which level the quadtree hands over to linked cells of objects (Davis et al. 1999, §III.B), computed per
//! collection.
//!
//! At a candidate level, objects with `reach < L_q` live in the cell that holds their centre; larger ones live at the
//! deepest level where `reach < L_q`. A query looks at the at most four cells whose objects can reach into a quadrant,
//! at the candidate level and at each coarser one that holds large objects. Its work is the plain sum of cells
//! visited, objects looked at there, large objects in the coarser lists, and pages requested.
//!
//! Queries are drawn where the objects are, one at the centre of each of at most [`QUERIES_MAX`] objects spread evenly
//! over the collection's order in space: that is where a viewer who looks at them asks. All counts are real ones.
//!
//! For objects of one size the rule is VGIS's, the deepest level with `L_0 < L_q`: up to it the linked cells of a
//! level lie within those of the level above, so that the objects looked at do not grow with depth (and ties go to
//! the deeper level); beyond it all objects are large, and four empty cells are visited for nothing.

use super::pack;
use crate::forest::{CellId, LEVEL_MAX};
use crate::geodesy::SEMI_MAJOR_M;
use crate::store::CostPoint;
use rayon::prelude::*;
use std::collections::{BTreeMap, HashMap, HashSet};
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI, TAU};

/// Queries that a cost is measured by.
pub const QUERIES_MAX: usize = 2000;
/// Levels above VGIS's that are tried as well.
const LEVELS_ABOVE: u8 = 3;

/// What the choice needs to know of an object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Item {
    pub lat_rad: f64,
    pub lon_rad: f64,
    /// Deepest level with `reach < L_q`.
    pub deepest: u8,
    /// Bytes that it takes in a page, about.
    pub bytes: u32,
}

impl Item {
    pub fn new(lat_rad: f64, lon_rad: f64, reach_m: f64, bytes: u32) -> Self {
        Self { lat_rad, lon_rad, deepest: deepest_level(lat_rad, lon_rad, reach_m), bytes }
    }

    /// The cell that it lives in when the changeover level is `level`.
    pub fn home(&self, level: u8) -> CellId {
        CellId::containing(self.lat_rad, self.lon_rad, level.min(self.deepest))
    }
}

/// What was chosen, and why.
#[derive(Clone, Debug, PartialEq)]
pub struct Changeover {
    pub level: u8,
    /// The deepest level at which no object is too large.
    pub vgis_level: u8,
    pub curve: Vec<CostPoint>,
}

/// The deepest level where a reach is below `L_q` of the cell around a place; 0 where it is below none.
pub fn deepest_level(lat_rad: f64, lon_rad: f64, reach_m: f64) -> u8 {
    // Cells of level n are about this side; L_q is at most a little more and may be half.
    let guess = (SEMI_MAJOR_M * 1.01 * FRAC_PI_4 / reach_m.max(0.1)).log2().floor();
    let mut level = (guess as i64 + 1).clamp(0, i64::from(LEVEL_MAX)) as u8;
    while level > 0 && reach_m >= least_side_m(lat_rad, lon_rad, level) {
        level -= 1;
    }
    level
}

fn least_side_m(lat_rad: f64, lon_rad: f64, level: u8) -> f64 {
    CellId::containing(lat_rad, lon_rad, level).l_q_m()
}

/// Chooses the level with the least expected work per query, the deeper of equal ones. Items must be ordered in space.
pub fn choose(items: &[Item]) -> Changeover {
    let vgis_level = items.iter().map(|item| item.deepest).min().unwrap_or(0);
    let last = items.iter().map(|item| item.deepest).max().unwrap_or(0);
    let first = vgis_level.saturating_sub(LEVELS_ABOVE);
    let large = large_by_cell(items);
    let levels = first..=(last + 1).min(LEVEL_MAX);
    let curve: Vec<_> = levels.into_par_iter().map(|level| cost_at(items, &large, level)).collect();
    let level = curve.iter().rev().min_by(|a, b| a.cost.total_cmp(&b.cost)).map_or(0, |point| point.level);
    Changeover { level, vgis_level, curve }
}

/// For each level, how many objects have their deepest cells there.
fn large_by_cell(items: &[Item]) -> BTreeMap<u8, HashMap<CellId, u32>> {
    let mut levels: BTreeMap<u8, HashMap<CellId, u32>> = BTreeMap::new();
    for item in items {
        *levels.entry(item.deepest).or_default().entry(item.home(LEVEL_MAX)).or_default() += 1;
    }
    levels
}

/// Mean work of a query with the changeover at `level`.
fn cost_at(items: &[Item], large: &BTreeMap<u8, HashMap<CellId, u32>>, level: u8) -> CostPoint {
    let mut linked_objects: HashMap<CellId, u32> = HashMap::new();
    let mut homes: Vec<(CellId, u32)> = Vec::with_capacity(items.len());
    for item in items {
        let home = item.home(level);
        homes.push((home, item.bytes));
        if item.deepest >= level {
            *linked_objects.entry(home).or_default() += 1;
        }
    }
    let page_of = pages_by_cell(&homes);
    let mut sum = CostPoint { level, cells: 0.0, objects: 0.0, large_objects: 0.0, pages: 0.0, cost: 0.0 };
    let step = items.len().div_ceil(QUERIES_MAX).max(1);
    let queries: Vec<_> = items.iter().step_by(step).collect();
    for query in &queries {
        let mut pages: HashSet<u32> = HashSet::new();
        for cell in linked(query.lat_rad, query.lon_rad, level) {
            sum.cells += 1.0;
            sum.objects += f64::from(linked_objects.get(&cell).copied().unwrap_or(0));
            pages.extend(page_of.get(&cell));
        }
        for (&coarser, counts) in large.range(..level) {
            for cell in linked(query.lat_rad, query.lon_rad, coarser) {
                sum.cells += 1.0;
                sum.large_objects += f64::from(counts.get(&cell).copied().unwrap_or(0));
                pages.extend(page_of.get(&cell));
            }
        }
        sum.pages += pages.len() as f64;
    }
    let mean = |total: f64| total / queries.len().max(1) as f64;
    let (cells, objects) = (mean(sum.cells), mean(sum.objects));
    let (large_objects, pages) = (mean(sum.large_objects), mean(sum.pages));
    CostPoint { level, cells, objects, large_objects, pages, cost: cells + objects + large_objects + pages }
}

fn pages_by_cell(homes: &[(CellId, u32)]) -> HashMap<CellId, u32> {
    let mut sizes: BTreeMap<CellId, u64> = BTreeMap::new();
    for &(cell, bytes) in homes {
        *sizes.entry(cell).or_default() += u64::from(bytes);
    }
    let sizes: Vec<_> = sizes.into_iter().collect();
    let mut page_of = HashMap::new();
    for (at, page) in pack::plan(&sizes, pack::PAGE_BYTES_MAX).iter().enumerate() {
        page_of.extend(page.cells.iter().map(|&cell| (sizes[cell].0, at as u32)));
    }
    page_of
}

/// The cell at a place and its nearest neighbours: those that objects with `reach < L_q` can reach into the place's
/// quadrant from. Found by stepping a cell's width and height towards the nearer sides; as good as exact for a count.
fn linked(lat_rad: f64, lon_rad: f64, level: u8) -> Vec<CellId> {
    let bounds = CellId::containing(lat_rad, lon_rad, level).bounds();
    let (u, v) = bounds.fractions(lat_rad, lon_rad);
    let east = bounds.width_rad() * if u < 0.5 { -1.0 } else { 1.0 };
    let north = bounds.height_rad() * if v < 0.5 { -1.0 } else { 1.0 };
    let mut cells: Vec<CellId> = [(0.0, 0.0), (east, 0.0), (0.0, north), (east, north)]
        .into_iter()
        .map(|(east, north)| {
            let (mut lat, mut lon) = (lat_rad + north, lon_rad + east);
            if lat.abs() > FRAC_PI_2 {
                (lat, lon) = (lat.signum() * PI - lat, lon + PI);
            }
            CellId::containing(lat, (lon + PI).rem_euclid(TAU) - PI, level)
        })
        .collect();
    cells.sort_unstable();
    cells.dedup();
    cells
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prepare::buildings::spatial_order;

    /// A made-up city: `count` objects about a place, spread over `radius_m`.
    fn city(lat_deg: f64, lon_deg: f64, count: u32, radius_m: f64, reach_m: impl Fn(u32) -> f64) -> Vec<Item> {
        let mut items: Vec<Item> = (0..count)
            .map(|at| {
                // The plastic number's lattice: even, and the same each time.
                let (x, y) =
                    ((f64::from(at) * 0.754_877_666).fract() - 0.5, (f64::from(at) * 0.569_840_291).fract() - 0.5);
                let lat = lat_deg.to_radians() + y * 2.0 * radius_m / SEMI_MAJOR_M;
                let lon = lon_deg.to_radians() + x * 2.0 * radius_m / SEMI_MAJOR_M / lat.cos();
                Item::new(lat, lon, reach_m(at), 40)
            })
            .collect();
        items.sort_by_key(|item| spatial_order(item.lat_rad, item.lon_rad));
        items
    }

    #[test]
    fn fifty_metres_at_the_equator_are_level_16() {
        let changeover = choose(&city(0.3, 20.3, 20_000, 5_000.0, |_| 50.0));
        assert_eq!((changeover.level, changeover.vgis_level), (16, 16));
    }

    #[test]
    fn one_size_gives_vgis_rule_anywhere() {
        for (lat, lon) in [(0.0, 0.0), (33.75, -84.4), (45.0, 10.0), (60.17, 24.9), (-77.8, 166.7), (12.0, 179.99)] {
            for (reach, count, radius) in
                [(5.0, 20_000, 2_000.0), (50.0, 3_000, 8_000.0), (50.0, 12, 9_000.0), (700.0, 500, 40_000.0)]
            {
                let changeover = choose(&city(lat, lon, count, radius, |_| reach));
                let expected =
                    (0..=LEVEL_MAX).rev().find(|&level| changeover_fits(lat, lon, radius, reach, level)).unwrap();
                // Where L_q itself changes within the city, VGIS's rule has no one answer.
                if changeover.curve.last().map(|p| p.level) == Some(expected + 1) {
                    assert_eq!(changeover.level, expected, "{lat} {lon} {reach} {changeover:?}");
                    assert_eq!(changeover.vgis_level, expected);
                }
            }
        }
    }

    fn changeover_fits(lat: f64, lon: f64, radius_m: f64, reach_m: f64, level: u8) -> bool {
        let spread = radius_m / SEMI_MAJOR_M;
        [-spread, 0.0, spread]
            .into_iter()
            .all(|north| reach_m < least_side_m(lat.to_radians() + north, lon.to_radians(), level))
    }

    #[test]
    fn a_few_large_objects_do_not_hold_the_many_back() {
        let changeover = choose(&city(33.75, -84.4, 20_000, 5_000.0, |at| if at % 1000 == 0 { 400.0 } else { 18.0 }));
        assert!(changeover.level > changeover.vgis_level, "{changeover:?}");
        let cost = |level| changeover.curve.iter().find(|point| point.level == level).unwrap().cost;
        assert!(cost(changeover.level) < cost(changeover.vgis_level));
    }

    #[test]
    fn no_object_reaches_beyond_the_neighbours_of_its_cell() {
        for item in [(60.0, 5.0), (89.99, 100.0), (-45.0, -90.0), (0.0, 180.0), (33.0, 7.0)] {
            for reach_m in [0.05, 3.0, 50.0, 800.0, 20_000.0, 3e6] {
                let (lat, lon) = (f64::to_radians(item.0), f64::to_radians(item.1));
                let level = deepest_level(lat, lon, reach_m);
                assert!(level == 0 || reach_m < least_side_m(lat, lon, level), "{item:?} {reach_m} {level}");
                assert!(level == LEVEL_MAX || reach_m >= least_side_m(lat, lon, level + 1));
            }
        }
    }

    #[test]
    fn an_empty_collection_has_a_level_too() {
        assert!(choose(&[]).level <= LEVEL_MAX);
    }
}
