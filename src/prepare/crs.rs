//! Coordinate systems by PROJ, and control grids that make them fast.
