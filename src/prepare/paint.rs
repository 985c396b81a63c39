//! Pictures of the ground painted from OpenStreetMap: land use, parks, water, roads, railways, and faint footprints
//! under the buildings. Tiles are painted when first asked for, at the texel size asked for.

mod coast;
mod coverage;
mod style;

use super::PrepareError;
use super::imagery_source::PictureSource;
use super::recipe::{DEFAULT_PAINT_TEXEL_M, ImagerySection};
use super::source::SourceFile;
use super::vector::osm::{OsmFile, RelationKind, Way};
use crate::geodesy::{GeoBounds, SEMI_MAJOR_M};
use crate::store::SourceInfo;
use coverage::Coverage;
use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};
use style::{Color, Form, Style};
use tiny_skia::{FillRule, LineCap, LineJoin, Paint, Path, PathBuilder, Pixmap, Stroke, Transform};

/// Pixels along a side of a painted tile, without its border of one.
const TILE_PX: u32 = 256;
const BORDER_PX: u32 = 1;
/// Painted tiles that are kept; 264 KiB each.
const TILES_MAX: usize = 96;
/// Side of the buckets that shapes are found by, metres.
const BUCKET_M: f64 = 512.0;
/// Lines thinner than this are drawn this wide, and paler; pixels.
const LINE_MIN_PX: f64 = 0.75;

/// A picture source over one extract.
pub struct OsmPainter {
    plane: Plane,
    shapes: Vec<Shape>,
    buckets: HashMap<(i32, i32), Vec<u32>>,
    coverage: Coverage,
    bounds: GeoBounds,
    texel_m: f64,
    info: SourceInfo,
    tiles: Mutex<Tiles>,
}

/// Metres east and north of the extract's middle, on a plane whose east–west scale is that of the middle.
#[derive(Clone, Copy, Debug)]
struct Plane {
    lat_rad: f64,
    lon_rad: f64,
    cos_lat: f64,
}

impl Plane {
    fn about(bounds: &GeoBounds) -> Self {
        let center = bounds.center();
        Self { lat_rad: center.lat_rad, lon_rad: center.lon_rad, cos_lat: center.lat_rad.cos() }
    }

    fn metres(&self, lat_rad: f64, lon_rad: f64) -> [f64; 2] {
        [(lon_rad - self.lon_rad) * self.cos_lat * SEMI_MAJOR_M, (lat_rad - self.lat_rad) * SEMI_MAJOR_M]
    }

    fn of_degrees(&self, point: &[f64; 2]) -> [f64; 2] {
        self.metres(point[1].to_radians(), point[0].to_radians())
    }
}

/// Something to paint; metres on the plane.
struct Shape {
    lines: Vec<Vec<[f64; 2]>>,
    form: Form,
    color: Color,
    /// West, south, east, north.
    bounds: [f64; 4],
}

impl Shape {
    fn new(lines: Vec<Vec<[f64; 2]>>, form: Form, color: Color) -> Self {
        let margin = match form {
            Form::Area => 0.0,
            Form::Line { width_m } => width_m / 2.0,
        };
        let empty = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
        let bounds = lines.iter().flatten().fold(empty, |b, p| {
            [b[0].min(p[0] - margin), b[1].min(p[1] - margin), b[2].max(p[0] + margin), b[3].max(p[1] + margin)]
        });
        Self { lines, form, color, bounds }
    }
}

/// Which tile: n doublings of the finest texel, column and row on the plane.
type TileKey = (u8, i32, i32);

#[derive(Default)]
struct Tiles {
    kept: HashMap<TileKey, (Arc<Pixmap>, u64)>,
    clock: u64,
}

impl OsmPainter {
    pub fn open(section: &ImagerySection, file: &SourceFile) -> Result<Self, PrepareError> {
        let osm = OsmFile::load(file, &style::is_painted)?;
        let [west, south, east, north] = osm.bounds_deg;
        if !(west < east && south < north) {
            return Err(PrepareError::value(
                file,
                "the whole",
                "it holds nothing to paint",
                "take it out of the recipe",
            ));
        }
        let bounds = GeoBounds::from_degrees(west, south, east, north);
        let plane = Plane::about(&bounds);
        let mut shapes = Vec::new();
        for sea in coast::sea(&osm) {
            let lines = sea.iter().map(|ring| ring.iter().map(|p| plane.of_degrees(p)).collect()).collect();
            shapes.push((style::SEA, Shape::new(lines, Form::Area, style::WATER)));
        }
        let land = shapes.len();
        for way in &osm.ways {
            add_way(&osm, way, &plane, &mut shapes);
        }
        for relation in osm.relations.iter().filter(|relation| relation.kind == RelationKind::Area) {
            for style in style::of(&relation.tags, true).into_iter().filter(|style| style.form == Form::Area) {
                for rings in osm.assemble(relation).polygons {
                    let lines = rings.iter().map(|ring| ring.iter().map(|p| plane.of_degrees(p)).collect()).collect();
                    shapes.push((style.order, Shape::new(lines, style.form, style.color)));
                }
            }
        }
        let corners =
            [plane.metres(bounds.south_rad, bounds.west_rad), plane.metres(bounds.north_rad, bounds.east_rad)];
        let coverage = Coverage::new(corners, shapes[land..].iter().map(|(_, s)| (s.form, &s.lines[..])));
        let count = shapes.len() as u64;
        shapes.sort_by_key(|(order, _)| *order);
        let shapes: Vec<Shape> = shapes.into_iter().map(|(_, shape)| shape).collect();
        let texel_m = section.texel_m.unwrap_or(DEFAULT_PAINT_TEXEL_M);
        let or_default = |text: &str, default: &str| if text.is_empty() { default.to_owned() } else { text.to_owned() };
        let info = SourceInfo {
            kind: "painted".into(),
            file: section.file.clone(),
            credit: or_default(&section.credit, "© OpenStreetMap contributors"),
            licence: or_default(&section.licence, "ODbL 1.0"),
            spacing_m: texel_m,
            count,
        };
        let buckets = bucket(&shapes);
        Ok(Self { plane, shapes, buckets, coverage, bounds, texel_m, info, tiles: Mutex::default() })
    }

    fn texel_m(&self, doublings: u8) -> f64 {
        self.texel_m * f64::from(1u32 << doublings)
    }

    fn tile(&self, key: TileKey) -> Arc<Pixmap> {
        {
            let mut tiles = self.tiles.lock().unwrap_or_else(PoisonError::into_inner);
            tiles.clock += 1;
            let now = tiles.clock;
            if let Some((tile, used)) = tiles.kept.get_mut(&key) {
                *used = now;
                return tile.clone();
            }
        }
        let tile = Arc::new(self.paint(key));
        let mut tiles = self.tiles.lock().unwrap_or_else(PoisonError::into_inner);
        let now = tiles.clock;
        if tiles.kept.len() >= TILES_MAX {
            let oldest = tiles.kept.iter().min_by_key(|(_, (_, used))| *used).map(|(key, _)| *key);
            oldest.and_then(|key| tiles.kept.remove(&key));
        }
        tiles.kept.insert(key, (tile.clone(), now));
        tile
    }

    fn paint(&self, (doublings, column, row): TileKey) -> Pixmap {
        let texel_m = self.texel_m(doublings);
        let side = TILE_PX + 2 * BORDER_PX;
        let Some(mut pixmap) = Pixmap::new(side, side) else { unreachable!("a tile's side is not 0") };
        let [r, g, b] = style::GROUND;
        pixmap.fill(tiny_skia::Color::from_rgba8(r, g, b, 255));
        let origin = [f64::from(column), f64::from(row)].map(|at| at * f64::from(TILE_PX) * texel_m);
        let border_m = f64::from(BORDER_PX) * texel_m;
        let side_m = f64::from(side) * texel_m;
        let area =
            [origin[0] - border_m, origin[1] - border_m, origin[0] - border_m + side_m, origin[1] - border_m + side_m];
        let pen = Pen { west_m: area[0], north_m: area[3], texel_m };
        for at in self.shapes_in(area) {
            pen.draw(&self.shapes[at as usize], &mut pixmap);
        }
        pixmap
    }

    /// Shapes that may show in an area, in the order of painting.
    fn shapes_in(&self, area: [f64; 4]) -> Vec<u32> {
        let mut found: Vec<u32> = buckets_of(area, &self.extent())
            .filter_map(|key| self.buckets.get(&key))
            .flatten()
            .copied()
            .filter(|&at| meets(&self.shapes[at as usize].bounds, &area))
            .collect();
        found.sort_unstable();
        found.dedup();
        found
    }

    fn extent(&self) -> [f64; 4] {
        self.coverage.extent()
    }

    /// Bilinear colour at a place on the plane.
    fn sample(&self, doublings: u8, [east, north]: [f64; 2]) -> [f32; 3] {
        let texel_m = self.texel_m(doublings);
        let (x, y) = (east / texel_m, north / texel_m);
        let tile_px = f64::from(TILE_PX);
        let (column, row) = ((x / tile_px).floor(), (y / tile_px).floor());
        let tile = self.tile((doublings, column as i32, row as i32));
        // Texel centres; rows of the pixmap run south, and the border shifts by one.
        let u = x - column * tile_px - 0.5 + f64::from(BORDER_PX);
        let v = tile_px - (y - row * tile_px) - 0.5 + f64::from(BORDER_PX);
        let (left, top) = (u.floor(), v.floor());
        let (fu, fv) = ((u - left) as f32, (v - top) as f32);
        let pixel = |dx: f64, dy: f64| {
            let last = f64::from(TILE_PX + 2 * BORDER_PX - 1);
            let (x, y) = ((left + dx).clamp(0.0, last) as u32, (top + dy).clamp(0.0, last) as u32);
            tile.pixel(x, y).map_or([0.0; 3], |p| [p.red(), p.green(), p.blue()].map(f32::from))
        };
        let (a, b, c, d) = (pixel(0.0, 0.0), pixel(1.0, 0.0), pixel(0.0, 1.0), pixel(1.0, 1.0));
        std::array::from_fn(|i| {
            let upper = a[i] + (b[i] - a[i]) * fu;
            let lower = c[i] + (d[i] - c[i]) * fu;
            upper + (lower - upper) * fv
        })
    }
}

impl PictureSource for OsmPainter {
    fn color(&self, lat_rad: f64, lon_rad: f64, texel_rad: f64) -> Option<[u8; 4]> {
        if !self.bounds.contains(lat_rad, lon_rad) {
            return None;
        }
        let place = self.plane.metres(lat_rad, lon_rad);
        let coverage = self.coverage.at(place);
        if coverage <= 0.0 {
            return None;
        }
        let asked_m = texel_rad * SEMI_MAJOR_M;
        let doublings = (asked_m / self.texel_m).log2().floor().clamp(0.0, 20.0) as u8;
        let spread_m = asked_m - self.texel_m(doublings);
        let sum = if spread_m > 0.05 * asked_m {
            // Between two sizes: four places of the finer one.
            let quarter = asked_m / 4.0;
            let mut sum = [0.0f32; 3];
            for (east, north) in [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)] {
                let color = self.sample(doublings, [place[0] + east * quarter, place[1] + north * quarter]);
                sum = std::array::from_fn(|i| sum[i] + color[i] / 4.0);
            }
            sum
        } else {
            self.sample(doublings, place)
        };
        let [r, g, b] = sum.map(|channel| channel.round().clamp(0.0, 255.0) as u8);
        Some([r, g, b, (coverage * 255.0).round().clamp(1.0, 255.0) as u8])
    }

    fn texel_rad(&self) -> f64 {
        self.texel_m / SEMI_MAJOR_M
    }

    fn bounds(&self) -> Vec<GeoBounds> {
        vec![self.bounds]
    }

    fn info(&self) -> SourceInfo {
        self.info.clone()
    }
}

fn add_way(osm: &OsmFile, way: &Way, plane: &Plane, shapes: &mut Vec<(u16, Shape)>) {
    for Style { order, form, color } in style::of(&way.tags, way.is_closed()) {
        let pieces = osm.pieces(way);
        if form == Form::Area && (pieces.len() != 1 || pieces[0].points.len() < 4) {
            continue;
        }
        let lines = pieces.iter().map(|piece| piece.points.iter().map(|p| plane.of_degrees(p)).collect()).collect();
        shapes.push((order, Shape::new(lines, form, color)));
    }
}

fn bucket(shapes: &[Shape]) -> HashMap<(i32, i32), Vec<u32>> {
    let mut buckets: HashMap<(i32, i32), Vec<u32>> = HashMap::new();
    let everywhere = [f64::NEG_INFINITY, f64::NEG_INFINITY, f64::INFINITY, f64::INFINITY];
    for (at, shape) in shapes.iter().enumerate().filter(|(_, shape)| shape.bounds[0].is_finite()) {
        for key in buckets_of(shape.bounds, &everywhere) {
            buckets.entry(key).or_default().push(at as u32);
        }
    }
    buckets
}

/// Buckets that an area meets within an extent.
fn buckets_of(area: [f64; 4], within: &[f64; 4]) -> impl Iterator<Item = (i32, i32)> {
    let low = |at: usize| (area[at].max(within[at] - 2.0 * BUCKET_M) / BUCKET_M).floor() as i32;
    let high = |at: usize| (area[at].min(within[at] + 2.0 * BUCKET_M) / BUCKET_M).floor() as i32;
    let (west, south, east, north) = (low(0), low(1), high(2), high(3));
    (south..=north).flat_map(move |y| (west..=east).map(move |x| (x, y)))
}

fn meets(a: &[f64; 4], b: &[f64; 4]) -> bool {
    a[0] <= b[2] && b[0] <= a[2] && a[1] <= b[3] && b[1] <= a[3]
}

/// Draws on a tile.
struct Pen {
    west_m: f64,
    north_m: f64,
    texel_m: f64,
}

impl Pen {
    fn draw(&self, shape: &Shape, pixmap: &mut Pixmap) {
        let Some(path) = self.path(shape) else { return };
        let [r, g, b] = shape.color;
        let mut paint = Paint { anti_alias: true, ..Paint::default() };
        match shape.form {
            Form::Area => {
                paint.set_color_rgba8(r, g, b, 255);
                pixmap.fill_path(&path, &paint, FillRule::EvenOdd, Transform::identity(), None);
            }
            Form::Line { width_m } => {
                let width_px = width_m / self.texel_m;
                let paleness = (width_px / LINE_MIN_PX).min(1.0);
                if paleness < 0.02 {
                    return;
                }
                paint.set_color_rgba8(r, g, b, (paleness * 255.0) as u8);
                let stroke = Stroke {
                    width: width_px.max(LINE_MIN_PX) as f32,
                    line_cap: LineCap::Round,
                    line_join: LineJoin::Round,
                    ..Stroke::default()
                };
                pixmap.stroke_path(&path, &paint, &stroke, Transform::identity(), None);
            }
        }
    }

    fn path(&self, shape: &Shape) -> Option<Path> {
        let mut path = PathBuilder::new();
        for line in shape.lines.iter().filter(|line| line.len() >= 2) {
            for (at, point) in line.iter().enumerate() {
                let x = ((point[0] - self.west_m) / self.texel_m) as f32;
                let y = ((self.north_m - point[1]) / self.texel_m) as f32;
                if at == 0 { path.move_to(x, y) } else { path.line_to(x, y) }
            }
            if shape.form == Form::Area {
                path.close();
            }
        }
        path.finish()
    }
}
