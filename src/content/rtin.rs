//! Right-triangulated irregular networks over 65 × 65 posts (Evans, Kirkpatrick, Townsend 2001).

/// Intervals along a side.
pub const SIDE: usize = 64;

/// Which way the diagonal of the two root triangles runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Diagonal {
    /// From the south-west corner to the north-east one.
    Rising,
    /// From the north-west corner to the south-east one.
    Falling,
}
