//! Which reps should be drawn, which can be, and which pages to ask for. Pure: reads no clock, file, thread or GPU.

mod collections;
mod demands;
mod front;
mod ground;
mod hidden;
mod layer;
mod measure;
mod needed;
mod objects;
mod polygon;
mod region;
mod seen;
mod sight;
mod skirts;
mod solid;

use crate::camera::View;
use crate::cells::LiveTree;
use crate::content::{ObjectPage, PageId, PageKind, TerrainPage};
use crate::forest::CellId;
use crate::forest::index::{IndexForest, Place};
use crate::geodesy::OrientedBox;
use demands::DemandList;
use front::Purpose;
use measure::LayerMeasure;
use std::ops::Range;
use std::sync::Arc;

pub use collections::CollectionSet;
pub use demands::{SHARE_MIN, service_order};
pub use front::STAND_IN_LEVELS;
pub use layer::{Rep, ground_page};
pub use needed::{Needed, StoredPages, needed, needed_and_seen};
pub use region::{FrontRegion, VisitRegion};
pub use seen::{Seen, StoredMeshes};
pub(crate) use sight::{Sight, Tolerance};

/// VGIS's four ways to draw objects (Davis et al. 1999, §V).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ObjectsMode {
    /// No objects.
    Off,
    /// All objects of the cells in view, without thresholds.
    Flat,
    /// Objects above the threshold, by cell.
    Cells,
    /// The coarsest reps within the tolerance: groups and simpler outlines where the world has them.
    Groups,
    /// Groups by VGIS's own rule: they stand for objects until the largest of them projects to `single_px` pixels.
    Vgis { single_px: f64 },
}

/// What a selection holds of the ground out of view.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OutOfView {
    /// Nothing: the selection is drawn in the view that it was made for.
    Left,
    /// Its coarsest pieces, without demands or measures, as far as they are resident: the whole Earth is covered,
    /// so that views that turned since show no hole.
    Coarse,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SelectParams {
    /// Allowed screen-space error, pixels; above 0.
    pub tolerance_px: f64,
    /// Projected bounding dimension below which an object is neither drawn nor paged, pixels.
    pub threshold_px: f64,
    pub objects: ObjectsMode,
    /// Collections that are neither drawn nor paged.
    pub hidden: CollectionSet,
    pub out_of_view: OutOfView,
}

impl SelectParams {
    /// One pixel for everything, coarser reps where they are within it, all collections, nothing out of view.
    pub const DEFAULT: Self = Self {
        tolerance_px: 1.0,
        threshold_px: 1.0,
        objects: ObjectsMode::Groups,
        hidden: CollectionSet::NONE,
        out_of_view: OutOfView::Left,
    };
}

/// How badly a page is wanted; the order is the order of service.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Urgency {
    Predicted,
    Visible,
    /// The ground under the eye.
    Blocking,
}

/// A wish for a page. All pages of the front are demanded in every frame, resident ones too, so that the request
/// manager knows what not to drop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Demand {
    pub page: PageId,
    pub place: Place,
    pub urgency: Urgency,
    /// Within a class: larger first; expected fall of debt per byte.
    pub gain: f64,
}

/// A piece of terrain to draw: a cell with the pages that its layers come from.
#[derive(Clone, Debug)]
pub struct DrawPiece {
    pub cell: CellId,
    /// Of the cell or its nearest drawable ancestor; cut to the cell.
    pub terrain: Arc<TerrainPage>,
    /// Cell of the picture, this one or an ancestor; `None` draws a plain colour.
    pub imagery: Option<CellId>,
    /// Morph weight: 0 draws the parent's surface, 1 the page's own.
    pub own: f32,
    /// Bounds the distance between what is drawn and the truth, metres.
    pub error_m: f32,
    /// Depth of the skirts: the largest errors drawn on both sides of the seam, metres.
    pub skirt_m: f32,
    /// Bounds the surface that is drawn, less its skirts.
    pub around: OrientedBox,
}

impl DrawPiece {
    /// Cell of the finer of its pages; the piece may be a part of it.
    pub fn page_cell(&self) -> CellId {
        let finer = self.imagery.filter(|imagery| imagery.level() > self.terrain.cell.level());
        finer.unwrap_or(self.terrain.cell)
    }
}

/// Objects to draw of a resident page.
#[derive(Clone, Debug)]
pub struct DrawObjects {
    pub page: Arc<ObjectPage>,
    /// Ranges of `page.objects`, ascending and apart.
    pub objects: Vec<Range<u32>>,
}

/// Where drawn ground would bury the eye: it is pressed down round the eye in the vertex shader.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GroundPress {
    /// How far the ground is lowered at the eye, metres.
    pub depth_m: f32,
    /// Full depth within this horizontal distance of the eye, none beyond twice of it, metres.
    pub radius_m: f32,
}

/// Counts and measures of one selection.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct SelectStats {
    pub cells_tested: u32,
    pub cells_culled: u32,
    pub objects_tested: u32,
    pub objects_drawn: u32,
    pub objects_culled: u32,
    pub pages_missing: u32,
    /// Of terrain in view and objects, as far as selection can tell: a page cut to a smaller cell counts by area.
    pub triangles: u64,
    /// Detail debt, px: sum over the layers of the screen-weighted mean excess.
    pub debt_px: f64,
    pub excess_max_px: f64,
    /// Of terrain alone.
    pub terrain_excess_max_px: f64,
    pub excess_p99_px: f64,
    /// Largest drawn screen error, whether or not the world has better, px.
    pub raw_error_px: f64,
    /// Share of the screen with excess 0, 0 to 1.
    pub coverage: f64,
}

#[derive(Clone, Debug, Default)]
pub struct Selection {
    pub pieces: Vec<DrawPiece>,
    pub objects: Vec<DrawObjects>,
    pub demands: Vec<Demand>,
    pub press: Option<GroundPress>,
    pub stats: SelectStats,
}

/// The front of a view over what is resident.
pub fn select(index: &IndexForest, cells: &LiveTree, view: &View, params: &SelectParams) -> Selection {
    select_raised(index, cells, view, params, params.tolerance_px)
}

/// The same where memory or time lack: the front is that of `drawn_tolerance_px`, which is at least
/// `params.tolerance_px`, and objects below a threshold raised by the same factor are left out. Debt and excess stay
/// those of the tolerance asked for.
pub fn select_raised(
    index: &IndexForest,
    cells: &LiveTree,
    view: &View,
    params: &SelectParams,
    drawn_tolerance_px: f64,
) -> Selection {
    let tolerance = Tolerance::new(params.tolerance_px, drawn_tolerance_px);
    let sight = Sight::new(index, view, tolerance, params.out_of_view);
    let mut stats = SelectStats::default();
    let mut demands = DemandList::default();
    demands.pin_roots(index);
    let ground = ground::under_eye(index, cells, &sight, &mut demands);
    let press = ground.and_then(|ground| ground.press(view.pose.eye.height_m));
    let mut measures = [(); LAYERS].map(|()| LayerMeasure::default());
    let mut measure = |region: &FrontRegion<'_>| {
        let excess_px = region.excess_px(region.drawn_px, params.tolerance_px);
        if let Some(layer) = region.layer() {
            measures[layer].add(region.share, region.drawn_px, excess_px);
        }
        demands.region(region, params.tolerance_px);
    };
    let purpose = Purpose::Draw(params.out_of_view);
    let pieces = front::walk(index, cells, &sight, purpose, &mut measure, &mut stats);
    let objects = objects::walk(index, cells, &sight, params, purpose, &mut measure, &mut stats);
    let skirts_m = skirts::depths_m(&pieces, press.as_ref());
    stats.terrain_excess_max_px = measures[TERRAIN_LAYER].excess_max_px();
    measure::summarize(&measures, &mut stats);
    stats.pages_missing = u32::try_from(demands.missing()).unwrap_or(u32::MAX);
    let pieces = front::draw(pieces, &skirts_m, cells);
    stats.triangles = triangles(&sight, &pieces, &objects);
    Selection { pieces, objects, demands: demands.finish(), press, stats }
}

/// Shows what a view wants of each part of the ground, without choosing what to draw: the regions of the front, terrain
/// and imagery of a region one after the other, then the pages of objects. Segments of the index that the view needs
/// come in between, those that stay left out.
pub fn survey(
    index: &IndexForest,
    cells: &LiveTree,
    view: &View,
    params: &SelectParams,
    drawn_tolerance_px: f64,
    mut visit_region: impl FnMut(&FrontRegion<'_>),
) {
    let tolerance = Tolerance::new(params.tolerance_px, drawn_tolerance_px);
    let sight = Sight::new(index, view, tolerance, params.out_of_view);
    let mut stats = SelectStats::default();
    front::walk(index, cells, &sight, Purpose::Survey, &mut visit_region, &mut stats);
    objects::walk(index, cells, &sight, params, Purpose::Survey, &mut visit_region, &mut stats);
}

/// The terrain under an eye, finest first: blocking demands.
pub fn ground_demands(index: &IndexForest, cells: &LiveTree, view: &View, params: &SelectParams) -> Vec<Demand> {
    let tolerance = Tolerance::new(params.tolerance_px, params.tolerance_px);
    let mut demands = DemandList::default();
    ground::under_eye(index, cells, &Sight::new(index, view, tolerance, OutOfView::Left), &mut demands);
    demands.finish()
}

/// Layers that lie over one another, each measured for itself.
pub const LAYERS: usize = 3;

const TERRAIN_LAYER: usize = 0;
const IMAGERY_LAYER: usize = 1;
const OBJECTS_LAYER: usize = 2;

/// A page's place among [`LAYERS`]; segments of the index have none.
pub fn layer_of(kind: PageKind) -> Option<usize> {
    match kind {
        PageKind::Terrain => Some(TERRAIN_LAYER),
        PageKind::Imagery => Some(IMAGERY_LAYER),
        PageKind::Objects { .. } => Some(OBJECTS_LAYER),
        PageKind::Segment => None,
    }
}

fn triangles(sight: &Sight<'_>, pieces: &[DrawPiece], objects: &[DrawObjects]) -> u64 {
    let terrain = pieces.iter().filter(|piece| sight.sees(&piece.around)).map(|piece| {
        let quarterings = 2 * u32::from(piece.cell.level() - piece.terrain.cell.level());
        (piece.terrain.triangles.len() as u64).checked_shr(quarterings).unwrap_or(0).max(2)
    });
    let ranges =
        objects.iter().flat_map(|drawn| drawn.objects.iter().map(|range| drawn.page.indices_of(range.clone())));
    terrain.sum::<u64>() + ranges.map(|range| u64::from(range.end - range.start) / 3).sum::<u64>()
}
