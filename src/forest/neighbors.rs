//! Neighbours by arithmetic, across zones, the antimeridian, thinned rows and the poles.
//!
//! Rows are counted from the south pole and columns from 180°W. Next to a row of k there is one of k − 1, k or k + 1, so
//! that an edge is shared with one or two cells.

use super::cell::{ZONE_COLUMNS, ZONE_ROWS};
use super::thinning::thinning;
use super::{CellId, Zone};
use std::ops::Deref;

/// A side of a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Side {
    West,
    East,
    South,
    North,
}

impl Side {
    pub const ALL: [Self; 4] = [Self::West, Self::East, Self::South, Self::North];
}

/// A short list of cells, without an allocation.
#[derive(Clone, Copy, Debug)]
pub struct FewCells {
    cells: [CellId; Self::MAX],
    len: usize,
}

impl FewCells {
    /// The most that is needed is 11: round a polar cell, the seven others and four in the next row.
    pub const MAX: usize = 12;

    pub fn new(first: CellId) -> Self {
        Self { cells: [first; Self::MAX], len: 1 }
    }

    fn none() -> Self {
        Self { cells: [CellId::FIRST; Self::MAX], len: 0 }
    }

    /// Adds a cell that is not in the list yet. What does not fit is dropped.
    pub fn push(&mut self, cell: CellId) {
        debug_assert!(self.len < Self::MAX, "the callers' lists are shorter by construction");
        if self.len < Self::MAX && !self.contains(&cell) {
            self.cells[self.len] = cell;
            self.len += 1;
        }
    }
}

impl Deref for FewCells {
    type Target = [CellId];

    fn deref(&self) -> &[CellId] {
        &self.cells[..self.len]
    }
}

impl IntoIterator for FewCells {
    type Item = CellId;
    type IntoIter = std::iter::Take<std::array::IntoIter<CellId, { Self::MAX }>>;

    fn into_iter(self) -> Self::IntoIter {
        self.cells.into_iter().take(self.len)
    }
}

/// A row of cells round the Earth.
#[derive(Clone, Copy)]
struct Row {
    level: u8,
    row: u32,
    thinning: u8,
}

impl Row {
    fn new(level: u8, row: u32) -> Self {
        let zone = Zone::from_row_column(row >> level, 0);
        Self { level, row, thinning: thinning(zone, level, row & ((1 << level) - 1)) }
    }

    /// The row north (+1) or south (−1) of this one; `None` beyond a pole.
    fn next(self, step: i32) -> Option<Self> {
        let row = self.row.checked_add_signed(step)?;
        (row < ZONE_ROWS << self.level).then(|| Self::new(self.level, row))
    }

    fn columns(self) -> u32 {
        ZONE_COLUMNS << (self.level - self.thinning)
    }

    /// The cell `offset` columns east of `column`, round the Earth.
    fn cell(self, column: u32, offset: i64) -> CellId {
        let column = (i64::from(column) + offset).rem_euclid(i64::from(self.columns()));
        CellId::at_row_column(self.level, self.row, column as u32)
    }

    /// The columns that touch the closed span `from..=to`, in columns of an unthinned row of this level.
    fn touching(self, from: i64, to: i64) -> impl Iterator<Item = CellId> {
        (from >> self.thinning..=to >> self.thinning).map(move |column| self.cell(0, column))
    }
}

impl CellId {
    /// All other cells of the level that share at least a point with this one; round a pole all seven other polar
    /// cells. Symmetric.
    pub fn neighbors(self) -> FewCells {
        let (row, column) = self.row_column();
        let own = Row::new(self.level(), row);
        // The span of this cell and what touches it, in columns of an unthinned row.
        let from = i64::from(column) << own.thinning;
        let to = i64::from(column + 1) << own.thinning;
        let mut found = FewCells::none();
        for step in [-1, 1] {
            match own.next(step) {
                Some(next) => next.touching(from - 1, to).for_each(|cell| found.push(cell)),
                None => (1..i64::from(ZONE_COLUMNS)).for_each(|east| found.push(own.cell(column, east))),
            }
        }
        found.push(own.cell(column, -1));
        found.push(own.cell(column, 1));
        found
    }

    /// The cells of the level that share an edge on this side: one, or two where the next row has twice as many
    /// columns. At a pole, where the edge is a point, the cell opposite across it. Symmetric, up to turning north into
    /// south (at a pole the side stays).
    pub fn edge_neighbors(self, side: Side) -> FewCells {
        let (row, column) = self.row_column();
        let own = Row::new(self.level(), row);
        let step = match side {
            Side::West => return FewCells::new(own.cell(column, -1)),
            Side::East => return FewCells::new(own.cell(column, 1)),
            Side::South => -1,
            Side::North => 1,
        };
        let Some(next) = own.next(step) else {
            return FewCells::new(own.cell(column, i64::from(ZONE_COLUMNS / 2)));
        };
        let mut found = FewCells::none();
        let from = i64::from(column) << own.thinning;
        let to = i64::from(column + 1) << own.thinning;
        next.touching(from, to - 1).for_each(|cell| found.push(cell));
        found
    }

    /// Whether the cell has a pole for its south or north side.
    pub fn touches_pole(self, side: Side) -> bool {
        let row = self.row_column().0;
        match side {
            Side::South => row == 0,
            Side::North => row + 1 == ZONE_ROWS << self.level(),
            Side::West | Side::East => false,
        }
    }
}
