//! Coarser reps of building sets against the cleaned sources: how far are drawn roofs from the source's and these from
//! those, over samples of both (the two sides of a Hausdorff distance, from below).

use super::against::AgainstError;
use crate::content::{FIRST_GROUPS, FaceKind, PageId, PageKind, Prism};
use crate::forest::CellId;
use crate::forest::index::Place;
use crate::geodesy::{meridian_radius_m, prime_vertical_radius_m};
use crate::store::World;
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use serde::Serialize;
use std::collections::{BTreeMap, HashMap};

/// Points on each edge of a roof, its first corner among them.
const EDGE_POINTS: u32 = 4;
/// Points inside of a roof's triangle, by weights of its corners.
const INSIDE: [[f64; 3]; 4] = [[1.0 / 3.0; 3], [0.6, 0.2, 0.2], [0.2, 0.6, 0.2], [0.2, 0.2, 0.6]];
/// Squares of the grid in which near roofs are looked for have at least this side, metres.
const SQUARE_MIN_M: f64 = 16.0;
/// A square names no more triangles than a page has, and a triangle no more squares along a side than this.
const SQUARES_MAX: i32 = 4096;
/// Rings of squares that are looked through: what is no nearer counts as so far away.
const RINGS_MAX: i32 = 24;
/// What f32 heights and their storage in centimetres take beside the error, metres.
const ROUNDING_M: f64 = 0.02;

/// One coarser rep of a collection.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct RepReport {
    pub name: String,
    pub rep: u8,
    pub pages: u64,
    /// Points of the source's roofs, and of the drawn ones.
    pub samples: u64,
    pub drawn_samples: u64,
    /// Largest distance of a point of the source's roofs from those drawn, metres; no more than the bounding dimension
    /// of its object, which may be absent.
    pub worst_m: f64,
    /// Largest distance ÷ the `error_m` of its page, and the same from drawn roofs to the source's.
    pub worst_ratio: f64,
    pub drawn_worst_ratio: f64,
    /// Samples of either farther away than the `error_m` of their page.
    pub violations: u64,
    /// The worst place.
    pub worst_cell: String,
    pub worst_lon_deg: f64,
    pub worst_lat_deg: f64,
}

/// Objects of a source by the root of the page that holds them.
pub type Homes = BTreeMap<CellId, Vec<Prism>>;

/// Measures all pages of a collection's coarser reps.
pub fn compare(world: &World, name: &str, collection: u8, homes: &Homes) -> Result<Vec<RepReport>, AgainstError> {
    let pages: Vec<(PageId, Place)> = world
        .index()
        .trees()
        .flat_map(|tree| tree.nodes())
        .flat_map(|node| {
            let coarser = node.objects().filter(|entry| entry.collection == collection && entry.rep > 0);
            let cell = node.cell();
            let page = |entry: crate::forest::index::ObjectsEntry| {
                (PageId { cell, kind: PageKind::Objects { collection, rep: entry.rep } }, entry.place)
            };
            coarser.map(page).collect::<Vec<_>>()
        })
        .collect();
    let measured: Vec<(u8, RepReport)> =
        pages.par_iter().map(|&(id, place)| page_of(world, id, place, homes)).collect::<Result<_, _>>()?;
    let mut reports: BTreeMap<u8, RepReport> = BTreeMap::new();
    for (rep, page) in measured {
        let report = reports.entry(rep).or_insert(RepReport { name: name.to_owned(), rep, ..RepReport::default() });
        report.add(page);
    }
    Ok(reports.into_values().collect())
}

fn page_of(world: &World, id: PageId, place: Place, homes: &Homes) -> Result<(u8, RepReport), AgainstError> {
    let bytes = world.read(id, place)?;
    let page = world.prisms(id, place, &bytes)?;
    let of_it = |root: &CellId| if page.rep < FIRST_GROUPS { *root == id.cell } else { id.cell.contains(*root) };
    let sources: Vec<&Prism> = homes.iter().filter(|(root, _)| of_it(root)).flat_map(|(_, prisms)| prisms).collect();
    let mut report = measure(&sources, &page.prisms, id.cell, f64::from(page.error_m));
    report.worst_cell = id.cell.to_string();
    Ok((page.rep, report))
}

impl RepReport {
    fn add(&mut self, page: Self) {
        self.pages += 1;
        self.samples += page.samples;
        self.drawn_samples += page.drawn_samples;
        self.violations += page.violations;
        self.worst_m = self.worst_m.max(page.worst_m);
        let worst = |report: &Self| report.worst_ratio.max(report.drawn_worst_ratio);
        if worst(&page) > worst(self) {
            self.worst_cell = page.worst_cell;
            (self.worst_lon_deg, self.worst_lat_deg) = (page.worst_lon_deg, page.worst_lat_deg);
        }
        self.worst_ratio = self.worst_ratio.max(page.worst_ratio);
        self.drawn_worst_ratio = self.drawn_worst_ratio.max(page.drawn_worst_ratio);
    }
}

/// One page: sources and what is drawn for them within `error_m`.
fn measure(sources: &[&Prism], drawn: &[Prism], root: CellId, error_m: f64) -> RepReport {
    let metres = Metres::about(root);
    let roofs = |prism: &Prism| roof(prism, &metres);
    let source_roofs: Vec<Vec<Triangle>> = sources.iter().map(|prism| roofs(prism)).collect();
    let drawn_roofs: Vec<Vec<Triangle>> = drawn.iter().map(roofs).collect();
    let side_m = SQUARE_MIN_M.max(error_m);
    let (all_sources, all_drawn) = (Grid::new(&source_roofs, side_m), Grid::new(&drawn_roofs, side_m));
    let mut report = RepReport { pages: 1, ..RepReport::default() };
    let allowed_m = error_m + ROUNDING_M;
    let mut worst = (0.0, DVec3::ZERO);
    for (prism, roof) in sources.iter().zip(&source_roofs) {
        let enough_m = prism.dimension_m();
        for point in samples(roof) {
            report.samples += 1;
            let off_m = all_drawn.distance_m(point, enough_m).min(enough_m);
            report.worst_m = report.worst_m.max(off_m);
            report.worst_ratio = report.worst_ratio.max(off_m / allowed_m);
            report.violations += u64::from(off_m > allowed_m);
            worst = if off_m > worst.0 { (off_m, point) } else { worst };
        }
    }
    for point in drawn_roofs.iter().flat_map(|roof| samples(roof)) {
        report.drawn_samples += 1;
        let off_m = all_sources.distance_m(point, f64::INFINITY);
        report.drawn_worst_ratio = report.drawn_worst_ratio.max(off_m / allowed_m);
        report.violations += u64::from(off_m > allowed_m);
        worst = if off_m > worst.0 { (off_m, point) } else { worst };
    }
    [report.worst_lon_deg, report.worst_lat_deg] = metres.back_deg(worst.1);
    report
}

/// Metres east and north of a cell's middle, good for what is near each other.
struct Metres {
    origin: DVec2,
    per_rad: DVec2,
}

impl Metres {
    fn about(cell: CellId) -> Self {
        let middle = cell.bounds().center();
        let sin = middle.lat_rad.sin();
        let per_rad = DVec2::new(prime_vertical_radius_m(sin) * middle.lat_rad.cos(), meridian_radius_m(sin));
        Self { origin: DVec2::new(middle.lon_rad, middle.lat_rad), per_rad }
    }

    fn to(&self, [lon_rad, lat_rad]: [f64; 2], height_m: f32) -> DVec3 {
        ((DVec2::new(lon_rad, lat_rad) - self.origin) * self.per_rad).extend(f64::from(height_m))
    }

    fn back_deg(&self, point: DVec3) -> [f64; 2] {
        (point.truncate() / self.per_rad + self.origin).to_array().map(f64::to_degrees)
    }
}

type Triangle = [DVec3; 3];

/// What is drawn of a prism as its roof.
fn roof(prism: &Prism, metres: &Metres) -> Vec<Triangle> {
    if let Some(detail) = &prism.detail {
        let roofs = detail.groups.iter().filter(|group| group.kind != FaceKind::Wall);
        let triangles = roofs.flat_map(|group| &group.triangles);
        let corner = |at: u32| detail.corners.get(at as usize).map(|c| metres.to([c.lon_rad, c.lat_rad], c.height_m));
        return triangles.filter_map(|t| Some([corner(t[0])?, corner(t[1])?, corner(t[2])?])).collect();
    }
    let corners: Vec<DVec3> = prism.rings.iter().flatten().map(|&corner| metres.to(corner, prism.top_m)).collect();
    let corner = |at: u16| corners.get(usize::from(at)).copied();
    prism.roof.iter().filter_map(|t| Some([corner(t[0])?, corner(t[1])?, corner(t[2])?])).collect()
}

/// Corners, points along the edges and inside.
fn samples(roof: &[Triangle]) -> impl Iterator<Item = DVec3> + '_ {
    roof.iter().flat_map(|corners| {
        let edges = (0..3).flat_map(move |at| {
            let (from, to) = (corners[at], corners[(at + 1) % 3]);
            (0..EDGE_POINTS).map(move |step| from.lerp(to, f64::from(step) / f64::from(EDGE_POINTS)))
        });
        let inside = INSIDE.iter().map(|weights| (0..3).map(|at| corners[at] * weights[at]).sum());
        edges.chain(inside)
    })
}

/// Triangles by the squares that their boxes touch.
struct Grid {
    side_m: f64,
    triangles: Vec<Triangle>,
    squares: HashMap<[i32; 2], Vec<u32>>,
}

impl Grid {
    fn new(roofs: &[Vec<Triangle>], side_m: f64) -> Self {
        let mut grid = Self { side_m, triangles: roofs.concat(), squares: HashMap::new() };
        for (at, corners) in grid.triangles.iter().enumerate() {
            let low = corners[0].min(corners[1]).min(corners[2]);
            let high = corners[0].max(corners[1]).max(corners[2]);
            let ([x, y], [x_end, y_end]) = (grid.square(low), grid.square(high));
            for square in
                (x..=x_end.min(x + SQUARES_MAX)).flat_map(|x| (y..=y_end.min(y + SQUARES_MAX)).map(move |y| [x, y]))
            {
                grid.squares.entry(square).or_default().push(at as u32);
            }
        }
        grid
    }

    fn square(&self, point: DVec3) -> [i32; 2] {
        [point.x, point.y].map(|metres| (metres / self.side_m).floor() as i32)
    }

    /// From a point to the nearest triangle; what is farther than `enough_m` need not be exact.
    fn distance_m(&self, point: DVec3, enough_m: f64) -> f64 {
        let [x, y] = self.square(point);
        let mut nearest_m2 = f64::INFINITY;
        for ring in 0..=RINGS_MAX {
            // Nothing in this ring is nearer than so.
            let least_m = f64::from(ring - 1).max(0.0) * self.side_m;
            if least_m * least_m >= nearest_m2 || least_m > enough_m {
                break;
            }
            for square in around(ring) {
                for &at in self.squares.get(&[x + square[0], y + square[1]]).into_iter().flatten() {
                    nearest_m2 = nearest_m2.min(distance_m2(point, &self.triangles[at as usize]));
                }
            }
        }
        nearest_m2.sqrt().min(f64::from(RINGS_MAX) * self.side_m)
    }
}

/// The squares of a ring about (0, 0).
fn around(ring: i32) -> impl Iterator<Item = [i32; 2]> {
    (-ring..=ring).flat_map(move |x| {
        let step = if x.abs() == ring { 1 } else { (2 * ring).max(1) };
        (-ring..=ring).step_by(step as usize).map(move |y| [x, y])
    })
}

/// From a point to a triangle, squared (Ericson 2005, §5.1.5).
fn distance_m2(p: DVec3, &[a, b, c]: &Triangle) -> f64 {
    let normal = (b - a).cross(c - a);
    let is_over = |from: DVec3, to: DVec3| normal.dot((to - from).cross(p - from)) >= 0.0;
    if normal.length_squared() > 0.0 && is_over(a, b) && is_over(b, c) && is_over(c, a) {
        return (p - a).dot(normal).powi(2) / normal.length_squared();
    }
    [(a, b), (b, c), (c, a)].map(|(from, to)| edge_m2(p, from, to)).into_iter().fold(f64::INFINITY, f64::min)
}

fn edge_m2(p: DVec3, from: DVec3, to: DVec3) -> f64 {
    let along = to - from;
    let share = (p - from).dot(along) / along.length_squared();
    // An edge without length is a point.
    p.distance_squared(from + along * if share.is_nan() { 0.0 } else { share.clamp(0.0, 1.0) })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn block(root: CellId, west_m: f64, size_m: f64, top_m: f32) -> Prism {
        let metres = Metres::about(root);
        let corner = |x: f64, y: f64| (DVec2::new(west_m + x, y) / metres.per_rad + metres.origin).to_array();
        Prism {
            id: 0,
            cell: root,
            rings: vec![vec![corner(0.0, 0.0), corner(size_m, 0.0), corner(size_m, size_m), corner(0.0, size_m)]],
            roof: vec![[0, 1, 2], [0, 2, 3]],
            base_m: 0.0,
            top_m,
            foundation_m: 0.0,
            wall_color: [0; 3],
            roof_color: [0; 3],
            detail: None,
        }
    }

    #[test]
    fn what_is_off_is_measured_and_what_vanished_counts_its_size() {
        let root = CellId::containing(0.7, 0.3, 14);
        let source = block(root, 0.0, 20.0, 30.0);
        let same = measure(&[&source], std::slice::from_ref(&source), root, 1.0);
        assert!(same.worst_m < 1e-6 && same.violations == 0 && same.samples == 32, "{same:?}");
        let higher = measure(&[&source], &[block(root, 0.0, 20.0, 33.0)], root, 4.0);
        assert!((higher.worst_m - 3.0).abs() < 1e-6 && higher.violations == 0, "{higher:?}");
        let aside = measure(&[&source], &[block(root, 5.0, 20.0, 30.0)], root, 4.0);
        assert!((aside.worst_m - 5.0).abs() < 1e-6 && aside.violations > 0, "{aside:?}");
        assert!((aside.drawn_worst_ratio - 5.0 / 4.02).abs() < 1e-6, "{aside:?}");
        let gone = measure(&[&source, &block(root, 300.0, 8.0, 9.0)], std::slice::from_ref(&source), root, 10.0);
        assert!((gone.worst_m - 9.0).abs() < 1e-3 && gone.violations == 0, "{gone:?}");
        // What stands where nothing was is as wrong as what is absent.
        let surplus = measure(&[&source], &[source.clone(), block(root, 300.0, 8.0, 9.0)], root, 10.0);
        assert!(surplus.drawn_worst_ratio > 25.0 && surplus.violations > 0, "{surplus:?}");
    }

    #[test]
    fn distances_to_triangles() {
        let triangle = [DVec3::ZERO, DVec3::new(4.0, 0.0, 0.0), DVec3::new(0.0, 4.0, 0.0)];
        let cases = [([1.0, 1.0, 3.0], 3.0), ([-3.0, 0.0, 4.0], 5.0), ([2.0, -2.0, 0.0], 2.0), ([7.0, 0.0, 4.0], 5.0)];
        for (point, expected) in cases {
            assert!((distance_m2(DVec3::from(point), &triangle).sqrt() - expected).abs() < 1e-12, "{point:?}");
        }
        assert!((distance_m2(DVec3::new(3.0, 4.0, 0.0), &[DVec3::ZERO; 3]).sqrt() - 5.0).abs() < 1e-12);
        assert_eq!((0..4).map(|ring| around(ring).count()).collect::<Vec<_>>(), [1, 8, 16, 24]);
    }
}
