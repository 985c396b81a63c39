//! Cells and their arithmetic: zones, levels, the thinning of columns with latitude, parents and children.

use crate::geodesy::{GeoBounds, meridian_radius_m, prime_vertical_radius_m};
use std::f64::consts::{FRAC_PI_4, PI};
use std::fmt;
use std::sync::LazyLock;

/// The deepest level; its cells are about 1.2 m high.
pub const LEVEL_MAX: u8 = 22;
/// The side of a zone in degrees.
pub const ZONE_DEG: f64 = 45.0;
const ZONE_ROWS: u32 = 4;
const ZONE_COLUMNS: u32 = 8;

/// One of the 32 zones: `row · 8 + column`, row 0 from 90°S to 45°S, column 0 from 180°W to 135°W.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Zone(u8);

impl Zone {
    pub const COUNT: usize = 32;

    /// `None` when `index` is not below 32.
    pub fn new(index: u8) -> Option<Self> {
        (usize::from(index) < Self::COUNT).then_some(Self(index))
    }

    pub fn all() -> impl DoubleEndedIterator<Item = Self> {
        (0..Self::COUNT as u8).map(Self)
    }

    pub(super) fn from_row_column(row: u32, column: u32) -> Self {
        debug_assert!(row < ZONE_ROWS && column < ZONE_COLUMNS);
        Self((row * ZONE_COLUMNS + column) as u8)
    }

    pub fn index(self) -> usize {
        usize::from(self.0)
    }

    pub fn row(self) -> u32 {
        u32::from(self.0) / ZONE_COLUMNS
    }

    pub fn column(self) -> u32 {
        u32::from(self.0) % ZONE_COLUMNS
    }

    pub fn root(self) -> CellId {
        CellId::pack(self, 0, 0)
    }

    fn is_northern(self) -> bool {
        self.row() >= ZONE_ROWS / 2
    }

    fn touches_pole(self) -> bool {
        self.row() == 0 || self.row() == ZONE_ROWS - 1
    }
}

/// k: how many E–W splits less the row of cells `y` of `level` has, `⌊log2(1/cos φ)⌋` with φ the latitude of the
/// row's equatorward edge.
pub fn thinning(zone: Zone, level: u8, y: u32) -> u8 {
    if !zone.touches_pole() {
        return 0;
    }
    // Rows from the equatorward edge of the zone, in units of the deepest level.
    let from_equator = if zone.is_northern() { y } else { (1 << level) - 1 - y };
    let edge = u64::from(from_equator) << (LEVEL_MAX - level);
    THINNING_EDGES.partition_point(|&threshold| threshold <= edge) as u8
}

/// Where k grows: for k = 1, 2, …, the first row edge of the deepest level, counted from 45°, with cos φ ≤ 2⁻ᵏ.
static THINNING_EDGES: LazyLock<Vec<u64>> = LazyLock::new(|| {
    let rows = f64::from(1 << LEVEL_MAX);
    (1..=i32::from(LEVEL_MAX))
        .map(|k| ((0.5f64.powi(k).acos() / FRAC_PI_4 - 1.0) * rows).ceil() as u64)
        .take_while(|&edge| edge < 1 << LEVEL_MAX)
        .collect()
});

/// The number of cells in a row within its zone, 2^(level − k).
pub fn columns(zone: Zone, level: u8, y: u32) -> u32 {
    1 << (level - thinning(zone, level, y))
}

/// Which child of its parent a cell is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(u8)]
pub enum Quadrant {
    SouthWest = 0,
    SouthEast = 1,
    NorthWest = 2,
    NorthEast = 3,
}

impl Quadrant {
    pub const ALL: [Self; 4] = [Self::SouthWest, Self::SouthEast, Self::NorthWest, Self::NorthEast];

    pub fn is_north(self) -> bool {
        self as u8 >= 2
    }

    pub fn is_east(self) -> bool {
        self as u8 & 1 == 1
    }
}

/// A node of a zone's quadtree. The order is (zone, Morton path), parents before their children, so that a subtree
/// is a contiguous range.
///
/// Bits from the top: zone (5), path of 22 two-bit quadrants (44), level (5).
///
/// Where a child row is thinned its one cell spans the parent's width; its quadrant is the western one.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct CellId(u64);

const LEVEL_BITS: u32 = 5;
const PATH_BITS: u32 = 2 * LEVEL_MAX as u32;

impl CellId {
    const fn pack(zone: Zone, level: u8, path: u64) -> Self {
        Self((zone.0 as u64) << (PATH_BITS + LEVEL_BITS) | path << LEVEL_BITS | level as u64)
    }

    /// The cell of `zone` at `level`, column `x` from the west and row `y` from the south; `None` when there is none.
    pub fn new(zone: Zone, level: u8, x: u32, y: u32) -> Option<Self> {
        if level > LEVEL_MAX || y >= 1 << level || x >= columns(zone, level, y) {
            return None;
        }
        let (mut path, mut x, mut y) = (0u64, x, y);
        for depth in (1..=level).rev() {
            let thinned = thinning(zone, depth, y) > thinning(zone, depth - 1, y / 2);
            let column = if thinned { 0 } else { x & 1 };
            path |= u64::from((y & 1) << 1 | column) << (2 * (LEVEL_MAX - depth));
            if !thinned {
                x /= 2;
            }
            y /= 2;
        }
        Some(Self::pack(zone, level, path))
    }

    /// The cell of `level` that holds a place. Edges belong to the cell north and east of them; the north pole to the
    /// last row.
    pub fn containing(lat_rad: f64, lon_rad: f64, level: u8) -> Self {
        let level = level.min(LEVEL_MAX);
        let rows = f64::from(ZONE_ROWS << level);
        let row = (((lat_rad + PI / 2.0) / PI * rows).floor().clamp(0.0, rows - 1.0)) as u32;
        let (zone_row, y) = (row >> level, row & ((1 << level) - 1));
        let per_zone = columns(Zone::from_row_column(zone_row, 0), level, y);
        let all = f64::from(ZONE_COLUMNS * per_zone);
        let turns = (lon_rad + PI) / (2.0 * PI);
        let column = (((turns - turns.floor()) * all).floor().clamp(0.0, all - 1.0)) as u32;
        let zone = Zone::from_row_column(zone_row, column / per_zone);
        Self::new(zone, level, column % per_zone, y).expect("row and column are in range by construction")
    }

    /// The cell with this ordinal; `None` when the bits name no cell.
    pub fn from_u64(bits: u64) -> Option<Self> {
        let level = (bits & ((1 << LEVEL_BITS) - 1)) as u8;
        let zone = Zone::new(u8::try_from(bits >> (PATH_BITS + LEVEL_BITS)).ok()?)?;
        let path = bits >> LEVEL_BITS & ((1 << PATH_BITS) - 1);
        if level > LEVEL_MAX || path & ((1 << (2 * (LEVEL_MAX - level))) - 1) != 0 {
            return None;
        }
        let cell = Self(bits);
        let (x, y) = cell.xy();
        (Self::new(zone, level, x, y) == Some(cell)).then_some(cell)
    }

    pub fn to_u64(self) -> u64 {
        self.0
    }

    pub fn zone(self) -> Zone {
        Zone((self.0 >> (PATH_BITS + LEVEL_BITS)) as u8)
    }

    pub fn level(self) -> u8 {
        (self.0 & ((1 << LEVEL_BITS) - 1)) as u8
    }

    fn path(self) -> u64 {
        self.0 >> LEVEL_BITS & ((1 << PATH_BITS) - 1)
    }

    /// Column from the west and row from the south, within the zone.
    pub fn xy(self) -> (u32, u32) {
        let (zone, mut x, mut y) = (self.zone(), 0, 0);
        for depth in 1..=self.level() {
            let quadrant = (self.path() >> (2 * (LEVEL_MAX - depth)) & 3) as u32;
            let parent_y = y;
            y = y * 2 + (quadrant >> 1);
            let thinned = thinning(zone, depth, y) > thinning(zone, depth - 1, parent_y);
            x = if thinned { x } else { x * 2 + (quadrant & 1) };
        }
        (x, y)
    }

    /// k of the cell's row.
    pub fn thinning(self) -> u8 {
        thinning(self.zone(), self.level(), self.xy().1)
    }

    /// `None` for a zone's root.
    pub fn parent(self) -> Option<Self> {
        self.level().checked_sub(1).and_then(|level| self.ancestor(level))
    }

    /// The ancestor at `level`, the cell itself included; `None` when `level` is deeper than the cell.
    pub fn ancestor(self, level: u8) -> Option<Self> {
        (level <= self.level()).then(|| {
            let keep = !((1u64 << (2 * (LEVEL_MAX - level))) - 1);
            Self::pack(self.zone(), level, self.path() & keep)
        })
    }

    /// Which child of its parent this is; the only one of a thinned row counts as western. `None` for a root.
    pub fn quadrant(self) -> Option<Quadrant> {
        let level = self.level().checked_sub(1)? + 1;
        Some(Quadrant::ALL[(self.path() >> (2 * (LEVEL_MAX - level)) & 3) as usize])
    }

    /// The child in a quadrant; `None` at the deepest level, and for the eastern quadrant of a thinned row.
    pub fn child(self, quadrant: Quadrant) -> Option<Self> {
        let level = self.level() + 1;
        if level > LEVEL_MAX || (quadrant.is_east() && self.child_row_is_thinned(quadrant.is_north())) {
            return None;
        }
        let path = self.path() | (quadrant as u64) << (2 * (LEVEL_MAX - level));
        Some(Self::pack(self.zone(), level, path))
    }

    /// Whether the child row has one cell across this one instead of two.
    pub fn child_row_is_thinned(self, north: bool) -> bool {
        let ((_, y), zone, level) = (self.xy(), self.zone(), self.level());
        level < LEVEL_MAX && thinning(zone, level + 1, y * 2 + u32::from(north)) > thinning(zone, level, y)
    }

    /// Four children, or three where k grows; none at the deepest level.
    pub fn children(self) -> impl Iterator<Item = Self> {
        Quadrant::ALL.into_iter().filter_map(move |quadrant| self.child(quadrant))
    }

    /// The cell itself and all above it, finest first.
    pub fn ancestors(self) -> impl Iterator<Item = Self> {
        (0..=self.level()).rev().filter_map(move |level| self.ancestor(level))
    }

    /// Whether `other` is this cell or lies in its subtree.
    pub fn contains(self, other: Self) -> bool {
        other.ancestor(self.level()) == Some(self)
    }

    /// All ordinals of the subtree, this cell first.
    pub fn subtree(self) -> std::ops::RangeInclusive<Self> {
        let below = (1u64 << (2 * (LEVEL_MAX - self.level()))) - 1;
        self..=Self(
            (self.path() | below) << LEVEL_BITS | LEVEL_MAX as u64 | (self.zone().0 as u64) << (PATH_BITS + LEVEL_BITS),
        )
    }

    pub fn bounds(self) -> GeoBounds {
        let (x, y) = self.xy();
        let (zone, level) = (self.zone(), self.level());
        let side = FRAC_PI_4 / f64::from(1u32 << level);
        let width = FRAC_PI_4 / f64::from(columns(zone, level, y));
        let west = f64::from(zone.column()) * FRAC_PI_4 - PI;
        let south = f64::from(zone.row()) * FRAC_PI_4 - PI / 2.0;
        GeoBounds {
            west_rad: west + f64::from(x) * width,
            south_rad: south + f64::from(y) * side,
            east_rad: west + f64::from(x + 1) * width,
            north_rad: south + f64::from(y + 1) * side,
        }
    }

    /// The sides in metres on the ellipsoid: south, north (along the parallels), west–east height (along the
    /// meridian, by its radius in the middle).
    pub fn sides_m(self) -> CellSides {
        let bounds = self.bounds();
        let along_parallel = |lat_rad: f64| {
            let (sin, cos) = lat_rad.sin_cos();
            prime_vertical_radius_m(sin) * cos.max(0.0) * bounds.width_rad()
        };
        CellSides {
            south_m: along_parallel(bounds.south_rad),
            north_m: along_parallel(bounds.north_rad),
            height_m: meridian_radius_m(bounds.center().lat_rad.sin()) * bounds.height_rad(),
        }
    }
}

/// Lengths of a cell's sides, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CellSides {
    pub south_m: f64,
    pub north_m: f64,
    pub height_m: f64,
}

impl fmt::Debug for CellId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

/// `zone/level/x/y`
impl fmt::Display for CellId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (x, y) = self.xy();
        write!(f, "{}/{}/{x}/{y}", self.zone().0, self.level())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eight_cells_stand_round_each_pole_at_every_level() {
        for level in 0..=LEVEL_MAX {
            assert_eq!(columns(Zone(24), level, (1 << level) - 1), 1);
            assert_eq!(columns(Zone(0), level, 0), 1);
        }
    }

    #[test]
    fn a_cell_survives_its_ordinal_and_its_coordinates() {
        for zone in Zone::all() {
            for level in 0..6 {
                for y in 0..1 << level {
                    for x in 0..columns(zone, level, y) {
                        let cell = CellId::new(zone, level, x, y).unwrap();
                        assert_eq!(cell.xy(), (x, y));
                        assert_eq!(CellId::from_u64(cell.to_u64()), Some(cell));
                        for child in cell.children() {
                            assert_eq!(child.parent(), Some(cell));
                            assert!(cell.subtree().contains(&child));
                        }
                        let center = cell.bounds().center();
                        assert_eq!(CellId::containing(center.lat_rad, center.lon_rad, level), cell);
                    }
                }
            }
        }
    }
}
