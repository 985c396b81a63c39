//! What a caller chooses, and what it gets told.

use serde::Serialize;

/// Hard limits of the arenas on the GPU, bytes. What a frame needs beside them (targets, uniforms) is not in them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GpuLimits {
    /// Pictures: texture arrays, allocated in chunks.
    pub imagery_bytes: u64,
    /// Terrain meshes: a cache that drops the least recently drawn.
    pub mesh_bytes: u64,
    /// Pages of objects.
    pub objects_bytes: u64,
}

/// Where the sun stands in the sky of the eye's own place. It is fixed there, not in space, so that the side of the
/// globe that is looked at is lit wherever a flight goes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sun {
    /// Clockwise from north.
    pub azimuth_rad: f64,
    /// Above the horizon.
    pub elevation_rad: f64,
}

impl Default for Sun {
    fn default() -> Self {
        Self { azimuth_rad: 150f64.to_radians(), elevation_rad: 48f64.to_radians() }
    }
}

/// Haze near the ground, exponential in height.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Haze {
    /// Distance at sea level at which 2 % of the contrast is left (Koschmieder: 3.912 / extinction), metres.
    pub visibility_m: f64,
    /// Height over which the haze thins by e, metres.
    pub scale_m: f64,
}

impl Default for Haze {
    fn default() -> Self {
        Self { visibility_m: 90_000.0, scale_m: 1_200.0 }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DrawOptions {
    pub sun: Sun,
    pub haze: Haze,
    /// Whether ids and depths are drawn beside the colour; without, they cannot be read.
    pub aov: bool,
    /// No ground of the world lies below this height, metres above the ellipsoid: the higher, the more of what is
    /// beyond the horizon is left out.
    pub lowest_m: f64,
}

impl DrawOptions {
    /// Below all ground of the Earth: the Challenger Deep lies 10.9 km under the ellipsoid.
    pub const LOWEST_M: f64 = -12_000.0;
}

impl Default for DrawOptions {
    fn default() -> Self {
        Self { sun: Sun::default(), haze: Haze::default(), aov: false, lowest_m: Self::LOWEST_M }
    }
}

/// Counts of one drawn frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct FrameStats {
    /// Of terrain, skirts and objects.
    pub triangles: u64,
    pub terrain_triangles: u64,
    pub object_triangles: u64,
    pub draw_calls: u32,
    /// Pieces drawn.
    pub pieces: u32,
    /// Pieces of the selection that lie out of the drawn view; nothing else counts them.
    pub pieces_culled: u32,
    /// Terrain meshes that were cut in this frame.
    pub pieces_built: u32,
    /// Pieces whose own picture was not in the arena: drawn with a coarser one, or in plain colour.
    pub pieces_without_picture: u32,
    /// Pages of objects that were to be drawn and are not in the arena.
    pub objects_missing: u32,
    /// How often the frame had to be cut because its meshes did not fit into the arena at once.
    pub mesh_flushes: u32,
}
