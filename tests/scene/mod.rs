//! Small made-up worlds for pictures: pages from formulas, no files.

#![allow(
    clippy::unwrap_used,
    clippy::single_range_in_vec_init,
    reason = "tests fail by panicking; ranges are meant as ranges"
)]
#![allow(dead_code, reason = "each test program uses its own part")]

use glam::DVec3;
use std::f64::consts::TAU;
use std::sync::Arc;
use stoop::camera::{Pose, View};
use stoop::content::rtin::SIDE;
use stoop::content::{
    IMAGERY_GUTTER_PX, IMAGERY_PX, IMAGERY_STORED_PX, ImageryPage, Object, ObjectMesh, ObjectPage, ObjectVertex, Page,
    TerrainPage, TerrainPost,
};
use stoop::forest::{CellId, Zone};
use stoop::geodesy::{Ecef, Geodetic, OrientedBox, Point};
use stoop::render::{DrawOptions, FrameStats, GpuLimits, Renderer};
use stoop::select::{DrawObjects, DrawPiece, Selection};

pub const LIMITS: GpuLimits = GpuLimits { imagery_bytes: 64 << 20, mesh_bytes: 32 << 20, objects_bytes: 16 << 20 };
pub const AOV: DrawOptions = DrawOptions {
    sun: stoop::render::Sun { azimuth_rad: 2.6, elevation_rad: 0.8 },
    haze: stoop::render::Haze { visibility_m: 90_000.0, scale_m: 1_200.0 },
    aov: true,
    lowest_m: DrawOptions::LOWEST_M,
};

pub fn renderer() -> Renderer {
    Renderer::new(LIMITS).unwrap()
}

/// A view from degrees and metres.
pub fn view([lat, lon, height_m]: [f64; 3], [heading, pitch]: [f64; 2], fov_y: f64, size_px: [u32; 2]) -> View {
    let eye = Geodetic::from_degrees(lat, lon, height_m);
    let pose = Pose { eye, heading_rad: heading.to_radians(), pitch_rad: pitch.to_radians() };
    View::new(pose, fov_y.to_radians(), size_px)
}

/// Heights by formula at every `stride`th post (a power of two); those of the parent's surface by another.
pub fn terrain(
    cell: CellId,
    stride: usize,
    height_m: &dyn Fn(f64, f64) -> f64,
    parent_m: &dyn Fn(f64, f64) -> f64,
) -> Arc<TerrainPage> {
    let bounds = cell.bounds();
    let sides = cell.sides_m();
    let mut posts = Vec::new();
    for row in (0..=SIDE).step_by(stride) {
        for column in (0..=SIDE).step_by(stride) {
            let at = |column: f64, row: f64| bounds.at(column / SIDE as f64, row / SIDE as f64, 0.0);
            let (x, y) = (column as f64, row as f64);
            let height = |x: f64, y: f64| {
                let place = at(x, y);
                height_m(place.lat_rad, place.lon_rad)
            };
            let (spacing_x, spacing_y) = (sides.south_m.max(1.0) / SIDE as f64, sides.height_m / SIDE as f64);
            let slope = |rise: f64| ((rise.atan() / (TAU / 4.0)) * 127.0).round().clamp(-127.0, 127.0) as i8;
            let place = at(x, y);
            posts.push(TerrainPost {
                column: column as u8,
                row: row as u8,
                height_m: height(x, y) as f32,
                parent_height_m: parent_m(place.lat_rad, place.lon_rad) as f32,
                slope: [
                    slope((height(x + 0.5, y) - height(x - 0.5, y)) / spacing_x),
                    slope((height(x, y + 0.5) - height(x, y - 0.5)) / spacing_y),
                ],
            });
        }
    }
    Arc::new(TerrainPage::from_posts(cell, 1.0, posts).unwrap())
}

/// A picture by formula: sRGB at latitude and longitude.
pub fn imagery(cell: CellId, color: &dyn Fn(f64, f64) -> [u8; 3]) -> Page {
    let bounds = cell.bounds();
    let texel = |index: u32| (f64::from(index) + 0.5 - f64::from(IMAGERY_GUTTER_PX)) / f64::from(IMAGERY_PX);
    let mut finest = Vec::new();
    for row in 0..IMAGERY_STORED_PX {
        for column in 0..IMAGERY_STORED_PX {
            let place = bounds.at(texel(column), 1.0 - texel(row), 0.0);
            let [r, g, b] = color(place.lat_rad, place.lon_rad);
            finest.extend([r, g, b, 255]);
        }
    }
    let mut mips = vec![finest];
    let mut side = IMAGERY_STORED_PX as usize;
    while side > 1 {
        let half = side / 2;
        let above = &mips[mips.len() - 1];
        let mean = |i: usize| {
            let (row, column, channel) = (i / 4 / half, i / 4 % half, i % 4);
            let at = |r: usize, c: usize| u32::from(above[((2 * row + r) * side + 2 * column + c) * 4 + channel]);
            ((at(0, 0) + at(0, 1) + at(1, 0) + at(1, 1)) / 4) as u8
        };
        let next = (0..half * half * 4).map(mean).collect();
        mips.push(next);
        side = half;
    }
    Page::Imagery(Arc::new(ImageryPage { cell, mips }))
}

pub fn piece(cell: CellId, terrain: &Arc<TerrainPage>, imagery: Option<CellId>) -> DrawPiece {
    let around = OrientedBox::around(&cell.bounds(), -12_000.0, 12_000.0);
    DrawPiece { cell, terrain: Arc::clone(terrain), imagery, own: 1.0, error_m: 0.0, skirt_m: 0.0, around }
}

/// The 32 zones over the bare ellipsoid.
pub fn bare_globe() -> Selection {
    let pieces = Zone::all().map(Zone::root).map(|cell| piece(cell, &terrain(cell, 1, &|_, _| 0.0, &|_, _| 0.0), None));
    Selection { pieces: pieces.collect(), ..Default::default() }
}

/// A made-up Earth: smooth continents over a sea.
pub fn land_m(lat: f64, lon: f64) -> f64 {
    let wave = (2.0 * lon + 1.3 * lat.sin() * 3.0).sin() * (3.0 * lat + 0.7 * lon.cos()).cos()
        + 0.5 * (5.0 * lon - 2.0 * lat).cos() * (4.0 * lat).sin();
    (wave * 4000.0 - 600.0).max(0.0)
}

pub fn land_color(lat: f64, lon: f64) -> [u8; 3] {
    let height_m = land_m(lat, lon);
    let grid = ((lat.to_degrees() / 15.0).fract().abs() < 0.02 || (lon.to_degrees() / 15.0).fract().abs() < 0.02) as u8;
    let [r, g, b] = match height_m {
        h if h <= 0.0 => [18, 42, 84],
        h if h < 1000.0 => [74, 98, 52],
        h if h < 2500.0 => [150, 132, 88],
        _ => [226, 226, 230],
    };
    [r + 20 * grid, g + 20 * grid, b + 20 * grid]
}

pub fn painted_globe(renderer: &mut Renderer) -> Selection {
    let mut selection = Selection::default();
    for cell in Zone::all().map(Zone::root) {
        renderer.upload(&imagery(cell, &land_color)).unwrap();
        selection.pieces.push(piece(cell, &terrain(cell, 1, &land_m, &land_m), Some(cell)));
    }
    selection
}

/// A page of flat plates: four corners each, counter-clockwise as seen; object `i` has ordinal `i`.
pub fn plates(root: CellId, origin: Point<Ecef>, corners: &[[Point<Ecef>; 4]]) -> (Page, DrawObjects) {
    let mut mesh = ObjectMesh::default();
    let mut objects = Vec::new();
    for (index, plate) in corners.iter().enumerate() {
        let first = mesh.vertices.len() as u32;
        mesh.vertices.extend(plate.iter().map(|&corner| ObjectVertex {
            position_m: (corner - origin).xyz().as_vec3().to_array(),
            look: index as u16,
            facing: ObjectVertex::facing(DVec3::X, false),
        }));
        mesh.indices.extend([0, 1, 2, 0, 2, 3].map(|i| first + i));
        let middle = plate.iter().map(Point::xyz).sum::<DVec3>() / 4.0;
        let place = Point::new(middle);
        let geodetic = Geodetic::from_ecef(place);
        objects.push(Object {
            id: index as u32,
            cell: root,
            place,
            lat_rad: geodetic.lat_rad,
            lon_rad: geodetic.lon_rad,
            base_m: 0.0,
            top_m: 1.0,
            dimension_m: 1.0,
            reach_m: 1.0,
            wall_color: [200, 120 + (index as u8 * 37) % 100, 80],
            roof_color: [90, 90, 90],
            indices: 6 * index as u32..6 * (index as u32 + 1),
        });
    }
    let count = objects.len() as u32;
    let page = Arc::new(ObjectPage {
        root,
        collection: 1,
        rep: 0,
        error_m: 0.0,
        origin,
        objects,
        cells: Vec::new(),
        footprints: Default::default(),
        looks: Vec::new(),
    });
    (Page::Objects(Arc::clone(&page), Arc::new(mesh)), DrawObjects { page, objects: vec![0..count] })
}

/// A plate that faces the view: its middle at (x, y) metres right and up of the axis at a distance, with these sides.
pub fn facing_plate(view: &View, [x, y, distance_m]: [f64; 3], [width, height]: [f64; 2]) -> [Point<Ecef>; 4] {
    let corner = |dx: f64, dy: f64| {
        view.ecef_from_view() * Point::new(DVec3::new(x + dx * width / 2.0, y + dy * height / 2.0, -distance_m))
    };
    [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)]
}

pub fn draw(renderer: &mut Renderer, view: &View, selection: &Selection) -> FrameStats {
    renderer.draw(view, selection, &AOV).unwrap()
}
