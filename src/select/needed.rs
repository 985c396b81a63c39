//! What a picture needs: the triangles and pages of the front over all stored reps, by exact tests. What is drawn and held
//! beyond that is over-modelling.
//!
//! Exact means: a triangle of the ground counts where it has a part in the view's pyramid that the horizon does not hide,
//! and the distance that a cell is judged by is that of the nearest such part, not of its box. Objects count one by one,
//! by the balls round them; which rep stands for them is chosen as a selection does. There are no skirts, no pages kept
//! for later, no cells beside the view. What of it shows beside what stands in front of it: [`Seen`].

use super::front::Purpose;
use super::layer::ground_page;
use super::objects;
use super::region::FrontRegion;
use super::seen::{Scene, Seen, StoredMeshes, triangle_count};
use super::sight::{Sight, Tolerance};
use super::solid::{Part, part_in_view};
use super::{OutOfView, SelectParams, SelectStats};
use crate::camera::View;
use crate::cells::LiveTree;
use crate::content::rtin::{Active, Triangle};
use crate::content::{ObjectPage, PageId, PageKind, TerrainPage, WORLD_IMAGE_COARSER};
use crate::forest::index::{IndexForest, Node, Place};
use crate::forest::{CellId, Quadrant};
use crate::geodesy::{Ecef, OrientedBox, Point, SEMI_MAJOR_M};
use glam::DVec3;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Gives stored pages, resident or not; `None` where one cannot be read.
pub trait StoredPages {
    fn terrain(&self, cell: CellId, place: Place) -> Option<Arc<TerrainPage>>;
    fn objects(&self, page: PageId, place: Place) -> Option<Arc<ObjectPage>>;
}

/// What is resident alone: a page that is not is taken for the nearest coarser one, so that the ground counts too few
/// triangles until the front is there.
impl StoredPages for LiveTree {
    fn terrain(&self, cell: CellId, _place: Place) -> Option<Arc<TerrainPage>> {
        Self::terrain(self, cell).cloned()
    }

    fn objects(&self, page: PageId, _place: Place) -> Option<Arc<ObjectPage>> {
        match page.kind {
            PageKind::Objects { collection, rep } => Self::objects(self, page.cell, collection, rep).cloned(),
            _ => None,
        }
    }
}

/// What one view needs.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Needed {
    /// Pages that a part in view is drawn from.
    pub pages: BTreeMap<PageId, Place>,
    /// Of the ground and of objects, each with a part in view.
    pub terrain_triangles: u64,
    pub object_triangles: u64,
    /// Of the ground's pages as wholes: what pages reach beyond the view is in it.
    pub page_triangles: u64,
    /// Of the ground, were each page's network cut to the tolerance at the distance of each triangle instead of that of
    /// the page's nearest part (Lindstrom & Pascucci 2001; conforming inside pages): one cut over the whole view.
    pub view_cut_triangles: u64,
}

impl Needed {
    /// Those in view.
    pub fn triangles(&self) -> u64 {
        self.terrain_triangles + self.object_triangles
    }

    /// Those of the front's reps, were the ground's pages not cut.
    pub fn front_triangles(&self) -> u64 {
        self.page_triangles + self.object_triangles
    }
}

/// What a view needs at a tolerance. Pure but for what `pages` reads; where segments of the index are absent it ends as if
/// the world did.
pub fn needed(index: &IndexForest, view: &View, params: &SelectParams, pages: &dyn StoredPages) -> Needed {
    let tolerance = Tolerance::new(params.tolerance_px, params.tolerance_px);
    let sight = Sight::new(index, view, tolerance, OutOfView::Left);
    gather(index, &sight, params, pages).needed
}

/// The same, and what of it shows; costs as much again, and a picture by the processor.
pub fn needed_and_seen(
    index: &IndexForest,
    view: &View,
    params: &SelectParams,
    pages: &dyn StoredMeshes,
) -> (Needed, Seen) {
    let tolerance = Tolerance::new(params.tolerance_px, params.tolerance_px);
    let sight = Sight::new(index, view, tolerance, OutOfView::Left);
    let scene = gather(index, &sight, params, pages);
    let seen = scene.seen(&sight, pages);
    (scene.needed, seen)
}

fn gather(index: &IndexForest, sight: &Sight<'_>, params: &SelectParams, pages: &dyn StoredPages) -> Scene {
    let mut walk = Walk { sight, tolerance_px: params.tolerance_px, pages, found: Scene::default() };
    for root in index.trees().map(|tree| tree.root()) {
        walk.visit(root.cell(), Some(root), &Ground::default());
    }
    let mut found = walk.found;
    gather_objects(index, sight, params, pages, &mut found);
    found
}

/// State of the ground on the way down.
#[derive(Clone, Default)]
struct Ground {
    /// The page met last.
    page: Option<(Arc<TerrainPage>, Place)>,
    terrain_settled: bool,
    imagery: Option<(CellId, Place)>,
    imagery_settled: bool,
}

struct Walk<'a> {
    sight: &'a Sight<'a>,
    tolerance_px: f64,
    pages: &'a dyn StoredPages,
    found: Scene,
}

impl Walk<'_> {
    fn visit(&mut self, cell: CellId, node: Option<Node<'_>>, above: &Ground) {
        let (low_m, high_m) = node.map_or_else(|| height_range_m(above), |node| node.height_range_m());
        let around = OrientedBox::around(&cell.bounds(), low_m, high_m);
        if !self.sight.sees(&around) {
            return;
        }
        let mut ground = above.clone();
        self.take_page(cell, node.as_ref(), &mut ground);
        let Some((page, place)) = ground.page.clone() else { return };
        let (parts, of_page) = self.parts(&page, cell);
        let nearest_m = parts.iter().map(|part| part.distance_m).fold(f64::INFINITY, f64::min);
        let distance_m = if parts.is_empty() { around.distance_m(self.sight.eye) } else { nearest_m };
        let px_per_m = self.sight.view.projected_px(1.0, distance_m);
        self.settle(cell, node.as_ref(), &mut ground, px_per_m);
        if ground.terrain_settled && !above.terrain_settled && !parts.is_empty() {
            let id = PageId { cell: page.cell, kind: PageKind::Terrain };
            let cut = if page.cell == cell { self.view_cut(&page) } else { parts.len() as u64 };
            let needed = &mut self.found.needed;
            needed.pages.insert(id, place);
            needed.terrain_triangles += parts.len() as u64;
            needed.page_triangles += of_page as u64;
            needed.view_cut_triangles += cut;
            self.found.ground.push((id, parts.clone()));
        }
        if ground.terrain_settled && ground.imagery_settled {
            if let Some((cell, place)) = ground.imagery.filter(|_| !parts.is_empty()) {
                let id = PageId { cell, kind: PageKind::Imagery };
                self.found.needed.pages.insert(id, place);
                self.found.pictures.push((id, parts));
            }
            return;
        }
        for quadrant in Quadrant::ALL {
            if let Some(child) = cell.child(quadrant) {
                self.visit(child, node.and_then(|node| node.child(quadrant)), &ground);
            }
        }
    }

    fn take_page(&self, cell: CellId, node: Option<&Node<'_>>, ground: &mut Ground) {
        let entry = node.and_then(Node::terrain).filter(|_| !ground.terrain_settled);
        if let Some(page) = entry.as_ref().and_then(|entry| self.pages.terrain(cell, entry.place)) {
            ground.page = entry.map(|entry| (page, entry.place));
        }
        let picture = node.and_then(Node::imagery).filter(|_| !ground.imagery_settled);
        ground.imagery = picture.map(|place| (cell, place)).or(ground.imagery);
    }

    /// Each layer goes down until its error is within the tolerance, or the world has nothing finer.
    fn settle(&self, cell: CellId, node: Option<&Node<'_>>, ground: &mut Ground, px_per_m: f64) {
        let Some(node) = node else {
            (ground.terrain_settled, ground.imagery_settled) = (true, true);
            return;
        };
        let error_px = |kind: PageKind| ground_page(node, kind).map(|(_, error_m)| error_m * px_per_m);
        let is_fine = |kind: PageKind| error_px(kind).is_some_and(|px| px <= self.tolerance_px);
        let is_finest = |kind: PageKind| !node.children().any(|child| ground_page(&child, kind).is_some());
        let [terrain, imagery] = [PageKind::Terrain, PageKind::Imagery].map(|kind| is_fine(kind) || is_finest(kind));
        ground.terrain_settled |= terrain;
        if cell.level() == 0
            && error_px(PageKind::Imagery).is_some_and(|px| WORLD_IMAGE_COARSER * px <= self.tolerance_px)
        {
            // What is always there is fine enough.
            (ground.imagery, ground.imagery_settled) = (None, true);
        }
        ground.imagery_settled |= imagery;
    }

    /// The parts in view of a page's surface, cut to a cell, and of how many triangles.
    fn parts(&self, page: &TerrainPage, cell: CellId) -> (Vec<Part>, usize) {
        if page.cell == cell {
            let positions = page.positions();
            let corners = |triangle: &[u16; 3]| triangle.map(|at| positions[usize::from(at)]);
            let parts = page.triangles.iter().filter_map(|triangle| self.part(corners(triangle)));
            return (parts.collect(), page.triangles.len());
        }
        let mesh = page.cut(cell);
        let origin = mesh.origin.xyz();
        let position = |at: u32| {
            let vertex = mesh.vertices.get(at as usize)?;
            Some(origin + DVec3::from(vertex.position_m.map(f64::from)))
        };
        let surface = mesh.indices.get(..mesh.surface_len as usize).unwrap_or_default();
        let corners =
            surface.chunks_exact(3).filter_map(|of| Some([position(of[0])?, position(of[1])?, position(of[2])?]));
        (corners.filter_map(|corners| self.part(corners)).collect(), surface.len() / 3)
    }

    fn part(&self, corners: [DVec3; 3]) -> Option<Part> {
        part_in_view(corners.map(Point::<Ecef>::new), self.sight)
    }

    /// Triangles in view of the coarsest network over a page's posts that keeps the tolerance at each triangle's own
    /// distance.
    fn view_cut(&self, page: &TerrainPage) -> u64 {
        let positions = page.positions();
        let at = |post| page.index_of(post).map(|index| positions[index]);
        let corners = |triangle: Triangle| {
            let [a, b, c] = triangle.vertices(page.diagonal).map(at);
            Some([a?, b?, c?])
        };
        let off_m = deviations_m(page, &positions, &corners);
        let exceeds = |triangle: Triangle| {
            let Some(part) = off_m.get(&triangle).zip(corners(triangle)) else { return false };
            let (off_m, corners) = part;
            let Some(part) = self.part(corners) else { return false };
            (off_m + f64::from(page.error_m)) * self.sight.view.projected_px(1.0, part.distance_m) > self.tolerance_px
        };
        let cut = Active::corners().refine(page.diagonal, &exceeds);
        let mut count = 0;
        cut.visit(page.diagonal, &mut |triangle| {
            count += u64::from(corners(triangle).is_some_and(|corners| self.part(corners).is_some()));
        });
        count
    }
}

/// How far the posts inside each triangle that the page's network splits lie from it, metres.
fn deviations_m(
    page: &TerrainPage,
    positions: &[DVec3],
    corners: &dyn Fn(Triangle) -> Option<[DVec3; 3]>,
) -> BTreeMap<Triangle, f64> {
    let mut off_m: BTreeMap<Triangle, f64> = BTreeMap::new();
    for (post, &position) in page.posts.iter().zip(positions) {
        let lineage = Triangle::lineage(page.diagonal, f64::from(post.column), f64::from(post.row));
        for triangle in lineage {
            let is_split = triangle.split_post(page.diagonal).is_some_and(|post| page.index_of(post).is_some());
            if !is_split {
                break;
            }
            let Some([a, b, c]) = corners(triangle) else { break };
            let normal = (b - a).cross(c - a).normalize_or_zero();
            let off = off_m.entry(triangle).or_default();
            *off = off.max((position - a).dot(normal).abs());
        }
    }
    off_m
}

fn height_range_m(ground: &Ground) -> (f64, f64) {
    let heights = ground.page.iter().flat_map(|(page, _)| &page.posts).map(|post| f64::from(post.height_m));
    let (low_m, high_m) = heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), m| (low.min(m), high.max(m)));
    if low_m <= high_m { (low_m, high_m) } else { (0.0, 0.0) }
}

/// Objects in view above the threshold, each in the rep that the front has for it.
fn gather_objects(
    index: &IndexForest,
    sight: &Sight<'_>,
    params: &SelectParams,
    pages: &dyn StoredPages,
    found: &mut Scene,
) {
    // Pages, or their parts for a subtree.
    let mut wanted: BTreeMap<(PageId, Option<CellId>), Place> = BTreeMap::new();
    let mut want = |region: &FrontRegion<'_>| {
        if let Some(rep) = region.chain.get(region.best).filter(|rep| matches!(rep.kind, PageKind::Objects { .. })) {
            wanted.insert((rep.page(), (rep.cell != region.cell).then_some(region.cell)), rep.place);
        }
    };
    let (nothing, mut stats) = (LiveTree::default(), SelectStats::default());
    objects::walk(index, &nothing, sight, params, Purpose::Survey, &mut want, &mut stats);
    for ((id, part), place) in wanted {
        let Some(page) = pages.objects(id, place) else { continue };
        let in_view = objects_in_view(&page, part, sight, params.threshold_px);
        let triangles = in_view.iter().map(|&object| triangle_count(&page.objects[object])).sum::<u64>();
        if triangles > 0 {
            found.needed.pages.insert(id, place);
            found.needed.object_triangles += triangles;
            found.objects.push((id, page, in_view));
        }
    }
}

/// Their numbers in the page.
fn objects_in_view(page: &ObjectPage, part: Option<CellId>, sight: &Sight<'_>, threshold_px: f64) -> Vec<usize> {
    let cells = page.cells.iter().filter(|cell| part.is_none_or(|part| part == cell.cell));
    let numbers = cells.flat_map(|cell| cell.objects.start as usize..cell.objects.end as usize);
    let is_in_view = |&number: &usize| {
        let Some(object) = page.objects.get(number) else { return false };
        let (dimension_m, distance_m) = (f64::from(object.dimension_m), sight.eye.distance_m(object.place));
        // A ball round the middle of the base that holds the object.
        let radius_m = dimension_m * std::f64::consts::SQRT_2;
        let raised = object.place.xyz() * (1.0 + radius_m / SEMI_MAJOR_M);
        sight.view.projected_px(dimension_m, distance_m) >= threshold_px
            && sight.frustum.meets_ball(object.place, radius_m)
            && !sight.horizon.hides(Point::new(raised))
    };
    numbers.filter(is_in_view).collect()
}
