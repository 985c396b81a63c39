//! Cells and their arithmetic: zones, levels, the thinning of columns with latitude, parents and children.

use super::thinning::{columns, thinned_bits, thinning};
use crate::geodesy::GeoBounds;
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI, TAU};
use std::fmt;

/// The deepest level; its cells are about 1.2 m high.
pub const LEVEL_MAX: u8 = 22;
/// The side of a zone in degrees.
pub const ZONE_DEG: f64 = 45.0;
pub(super) const ZONE_ROWS: u32 = 4;
pub(super) const ZONE_COLUMNS: u32 = 8;
pub const ZONE_COUNT: usize = (ZONE_ROWS * ZONE_COLUMNS) as usize;

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

    pub(super) fn is_northern(self) -> bool {
        self.row() >= ZONE_ROWS / 2
    }

    pub(super) fn touches_pole(self) -> bool {
        self.row() == 0 || self.row() == ZONE_ROWS - 1
    }
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
    /// The first in order.
    pub(super) const FIRST: Self = Self::pack(Zone(0), 0, 0);

    const fn pack(zone: Zone, level: u8, path: u64) -> Self {
        Self((zone.0 as u64) << (PATH_BITS + LEVEL_BITS) | path << LEVEL_BITS | level as u64)
    }

    /// The cell of `zone` at `level`, column `x` from the west and row `y` from the south; `None` when there is none.
    pub fn new(zone: Zone, level: u8, x: u32, y: u32) -> Option<Self> {
        (level <= LEVEL_MAX && y < 1 << level && x < columns(zone, level, y)).then(|| Self::at_xy(zone, level, x, y))
    }

    /// [`CellId::new`] where the coordinates are known to be in range.
    fn at_xy(zone: Zone, level: u8, x: u32, y: u32) -> Self {
        let x = open_bits(x, thinned_bits(zone, level, y));
        Self::pack(zone, level, (spread_bits(y) << 1 | spread_bits(x)) << (2 * (LEVEL_MAX - level)))
    }

    /// The cell at a row from the south pole and a column from 180°W, both of the whole Earth and in range.
    pub(super) fn at_row_column(level: u8, row: u32, column: u32) -> Self {
        let (zone_row, y) = (row >> level, row & ((1 << level) - 1));
        let per_zone = columns(Zone::from_row_column(zone_row, 0), level, y);
        let zone = Zone::from_row_column(zone_row, column / per_zone);
        Self::at_xy(zone, level, column % per_zone, y)
    }

    /// Row from the south pole and column from 180°W, of the whole Earth.
    pub(super) fn row_column(self) -> (u32, u32) {
        let ((x, y), zone, level) = (self.xy(), self.zone(), self.level());
        ((zone.row() << level) + y, zone.column() * columns(zone, level, y) + x)
    }

    /// The cell of `level` that holds a place; longitudes count round the Earth. Edges, as [`CellId::bounds`] has
    /// them, belong to the cell north and east of them; the north pole to the last row.
    pub fn containing(lat_rad: f64, lon_rad: f64, level: u8) -> Self {
        let level = level.min(LEVEL_MAX);
        let row = holding(lat_rad, FRAC_PI_2, ZONE_ROWS << level, level);
        let (zone_row, y) = (row >> level, row & ((1 << level) - 1));
        let thin_level = level - thinning(Zone::from_row_column(zone_row, 0), level, y);
        let lon_rad = if (-PI..PI).contains(&lon_rad) { lon_rad } else { (lon_rad + PI).rem_euclid(TAU) - PI };
        let column = holding(lon_rad, PI, ZONE_COLUMNS << thin_level, thin_level);
        Self::at_row_column(level, row, column)
    }

    /// The cell with this ordinal; `None` when the bits name no cell.
    pub fn from_u64(bits: u64) -> Option<Self> {
        let level = (bits & ((1 << LEVEL_BITS) - 1)) as u8;
        Zone::new(u8::try_from(bits >> (PATH_BITS + LEVEL_BITS)).ok()?)?;
        let path = bits >> LEVEL_BITS & ((1 << PATH_BITS) - 1);
        if level > LEVEL_MAX || path & ((1 << (2 * (LEVEL_MAX - level))) - 1) != 0 {
            return None;
        }
        let cell = Self(bits);
        let (east_bits, y) = cell.path_bits();
        (east_bits & thinned_bits(cell.zone(), level, y) == 0).then_some(cell)
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

    /// The path's eastern and northern bits, the last level's lowest; the latter are the row.
    fn path_bits(self) -> (u32, u32) {
        let path = self.path() >> (2 * (LEVEL_MAX - self.level()));
        (gather_bits(path), gather_bits(path >> 1))
    }

    /// Column from the west and row from the south, within the zone.
    pub fn xy(self) -> (u32, u32) {
        let (east_bits, y) = self.path_bits();
        (close_bits(east_bits, thinned_bits(self.zone(), self.level(), y)), y)
    }

    /// k of the cell's row.
    pub fn thinning(self) -> u8 {
        thinning(self.zone(), self.level(), self.path_bits().1)
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
        let ((_, y), zone, level) = (self.path_bits(), self.zone(), self.level());
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

    /// The same numbers on both sides of an edge, at every level.
    pub fn bounds(self) -> GeoBounds {
        // As `row_column`, with all that comes of the path taken from it once: walks ask each cell they look at.
        let (zone, level, (east_bits, y)) = (self.zone(), self.level(), self.path_bits());
        let thinned = thinned_bits(zone, level, y);
        let thin_level = level - thinned.count_ones() as u8;
        let (row, x) = ((zone.row() << level) + y, close_bits(east_bits, thinned));
        let column = (zone.column() << thin_level) + x;
        GeoBounds {
            west_rad: edge_rad(column, PI, thin_level),
            south_rad: edge_rad(row, FRAC_PI_2, level),
            east_rad: edge_rad(column + 1, PI, thin_level),
            north_rad: edge_rad(row + 1, FRAC_PI_2, level),
        }
    }
}

/// The edge `at` of a grid with 45°/2^level between edges that starts at `−from_rad`. Products with powers of two are
/// exact, so that an edge is the same number at every level that has it.
fn edge_rad(at: u32, from_rad: f64, level: u8) -> f64 {
    f64::from(at) * (FRAC_PI_4 / f64::from(1u32 << level)) - from_rad
}

/// Which interval of that grid holds an angle, of `count`; what lies outside goes to the first or last.
fn holding(angle_rad: f64, from_rad: f64, count: u32, level: u8) -> u32 {
    let guess = (angle_rad + from_rad) / FRAC_PI_4 * f64::from(1u32 << level);
    let guess = guess.floor().clamp(0.0, f64::from(count - 1)) as u32;
    // The guess is rounded; the edges decide.
    if guess > 0 && angle_rad < edge_rad(guess, from_rad, level) {
        guess - 1
    } else if guess + 1 < count && angle_rad >= edge_rad(guess + 1, from_rad, level) {
        guess + 1
    } else {
        guess
    }
}

/// Puts a zero bit between any two bits.
fn spread_bits(bits: u32) -> u64 {
    let mut v = u64::from(bits);
    v = (v | v << 16) & 0x0000_ffff_0000_ffff;
    v = (v | v << 8) & 0x00ff_00ff_00ff_00ff;
    v = (v | v << 4) & 0x0f0f_0f0f_0f0f_0f0f;
    v = (v | v << 2) & 0x3333_3333_3333_3333;
    (v | v << 1) & 0x5555_5555_5555_5555
}

/// Takes every other bit, the lowest first: the inverse of [`spread_bits`].
fn gather_bits(bits: u64) -> u32 {
    let mut v = bits & 0x5555_5555_5555_5555;
    v = (v | v >> 1) & 0x3333_3333_3333_3333;
    v = (v | v >> 2) & 0x0f0f_0f0f_0f0f_0f0f;
    v = (v | v >> 4) & 0x00ff_00ff_00ff_00ff;
    v = (v | v >> 8) & 0x0000_ffff_0000_ffff;
    (v | v >> 16) as u32
}

/// Opens a zero at each bit of `places`.
fn open_bits(mut bits: u32, mut places: u32) -> u32 {
    while places != 0 {
        let below = (1 << places.trailing_zeros()) - 1;
        bits = (bits & !below) << 1 | bits & below;
        places &= places - 1;
    }
    bits
}

/// Takes the bits at `places` out: the inverse of [`open_bits`].
fn close_bits(mut bits: u32, mut places: u32) -> u32 {
    while places != 0 {
        let place = 31 - places.leading_zeros();
        let below = (1 << place) - 1;
        bits = bits >> 1 & !below | bits & below;
        places &= !(1 << place);
    }
    bits
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
