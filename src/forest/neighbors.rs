//! Neighbours by arithmetic, across zones, the antimeridian, thinned rows and the poles.

/// A side of a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Side {
    West,
    East,
    South,
    North,
}
