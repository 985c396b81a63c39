//! The front of terrain and imagery: one walk from the zones' roots, culled by view and horizon.
//!
//! The walk goes down while a layer's error is above the tolerance and the world has finer pages of it. Each layer
//! stops for itself: below its front its page is cut, not loaded finer. Each quadrant resolves alone; where the index
//! has no child, the parent is cut to the quadrant. Pages are taken from the cell or its nearest resident ancestor; where
//! a page of the front is missing and finer ones are resident below, those stand in for it. At last quadrants that
//! draw the same pages as their parent become one piece again.

use super::demands::{DemandList, Part};
use super::layer::{Layer, Offer, Rep};
use super::measure::LayerMeasure;
use super::sight::Sight;
use super::{DrawPiece, OutOfView, SelectStats};
use crate::cells::LiveTree;
use crate::content::{PageId, PageKind};
use crate::forest::index::{IndexForest, Node};
use crate::forest::{CellId, Quadrant};
use crate::geodesy::{OrientedBox, SEMI_MAJOR_M};
use glam::DVec3;

/// How many levels below a missing page of the front finer pages may stand in for it.
const STAND_IN_LEVELS: u8 = 3;

/// A piece before its skirts are known.
#[derive(Clone, Copy, Debug)]
pub struct Piece {
    pub cell: CellId,
    pub terrain: Rep,
    pub imagery: Option<CellId>,
    pub own: f64,
    pub distance_m: f64,
    pub around: OrientedBox,
}

impl Piece {
    /// Error of the surface that is drawn, metres.
    pub fn error_m(&self) -> f64 {
        self.terrain.morphed_error_m(self.own)
    }

    fn draws_like(&self, other: &Self) -> bool {
        self.terrain.cell == other.terrain.cell && self.imagery == other.imagery
    }
}

pub struct Front {
    /// Apart from one another, ascending by cell.
    pub pieces: Vec<Piece>,
    /// Of terrain and of imagery.
    pub measures: Vec<LayerMeasure>,
}

/// A cell of the walk: with its node, or below the world's finest.
#[derive(Clone, Copy)]
struct Region<'a> {
    cell: CellId,
    node: Option<Node<'a>>,
    /// Lowest and highest drawn height, metres.
    heights_m: (f64, f64),
    /// Distance of the cell above. A cell lies in its own box and in all those above it, whose axes differ; the
    /// farthest of them bounds its distance, so that distances never fall on the way down.
    above_m: f64,
}

#[derive(Clone, Copy, Default)]
struct Layers {
    terrain: Layer,
    imagery: Layer,
}

struct Walk<'a, 'b> {
    cells: &'a LiveTree,
    sight: &'a Sight<'a>,
    out_of_view: OutOfView,
    demands: &'b mut DemandList,
    stats: &'b mut SelectStats,
    pieces: Vec<Piece>,
    terrain: LayerMeasure,
    imagery: LayerMeasure,
}

pub fn walk(
    index: &IndexForest,
    cells: &LiveTree,
    sight: &Sight<'_>,
    out_of_view: OutOfView,
    demands: &mut DemandList,
    stats: &mut SelectStats,
) -> Front {
    let mut walk = Walk {
        cells,
        sight,
        out_of_view,
        demands,
        stats,
        pieces: Vec::new(),
        terrain: LayerMeasure::default(),
        imagery: LayerMeasure::default(),
    };
    for root in index.trees().map(|tree| tree.root()) {
        let region = Region { cell: root.cell(), node: Some(root), heights_m: root.height_range_m(), above_m: 0.0 };
        walk.visit(region, Layers::default(), STAND_IN_LEVELS);
    }
    walk.pieces.sort_by_key(|piece| piece.cell);
    Front { pieces: walk.pieces, measures: vec![walk.terrain, walk.imagery] }
}

/// Takes the pages of the pieces; nearest first, so that what is behind is hidden before it is shaded.
pub fn draw(pieces: Vec<Piece>, skirts_m: &[f64], cells: &LiveTree) -> Vec<DrawPiece> {
    let mut order: Vec<(Piece, f64)> = pieces.into_iter().zip(skirts_m.iter().copied()).collect();
    order.sort_by(|(a, _), (b, _)| a.distance_m.total_cmp(&b.distance_m).then(a.cell.cmp(&b.cell)));
    order
        .into_iter()
        .filter_map(|(piece, skirt_m)| {
            Some(DrawPiece {
                cell: piece.cell,
                terrain: cells.terrain(piece.terrain.cell)?.clone(),
                imagery: piece.imagery,
                own: piece.own as f32,
                error_m: piece.error_m() as f32,
                skirt_m: skirt_m as f32,
                around: piece.around,
            })
        })
        .collect()
}

/// Steps the terrain layer to a node; also the way down under the eye.
pub fn step_terrain(layer: &mut Layer, node: &Node<'_>, cells: &LiveTree, px_per_m: f64, sight: &Sight<'_>) {
    let offer = Offer {
        rep: layer.terrain_rep(node),
        resident: cells.terrain(node.cell()).is_some(),
        finer: node.children().any(|child| child.terrain().is_some()),
    };
    layer.step(&offer, px_per_m, sight.tolerance);
}

impl<'a> Walk<'a, '_> {
    fn visit(&mut self, region: Region<'a>, mut layers: Layers, stand_in_levels: u8) {
        let bounds = region.cell.bounds();
        let (low_m, high_m) = region.heights_m;
        let around = OrientedBox::around(&bounds, low_m, high_m);
        self.stats.cells_tested += 1;
        if !self.sight.sees(&around) {
            self.stats.cells_culled += 1;
            if self.out_of_view == OutOfView::Coarse && !self.sight.horizon.hides_box(&around) {
                self.keep_coarse(&region, layers, around);
            }
            return;
        }
        let distance_m = around.distance_m(self.sight.eye).max(region.above_m);
        let px_per_m = self.sight.view.projected_px(1.0, distance_m);
        let children = self.step(&region, &mut layers, px_per_m);
        let here = piece(&region, &layers, distance_m, around, self.sight);
        let first = self.pieces.len();
        let settled = layers.terrain.is_settled() && layers.imagery.is_settled();
        let stands_in = settled
            && stand_in_levels > 0
            && !(layers.terrain.front_is_drawn() && layers.imagery.front_is_drawn())
            && self.cells.has_finer(region.cell);
        if !settled || stands_in {
            let left = if settled { stand_in_levels - 1 } else { stand_in_levels };
            for quadrant in Quadrant::ALL {
                if let Some(cell) = region.cell.child(quadrant) {
                    let node = children[quadrant as usize];
                    let heights_m = node.map_or(region.heights_m, |node| node.height_range_m());
                    self.visit(Region { cell, node, heights_m, above_m: distance_m }, layers, left);
                }
            }
            self.merge(first, here);
        } else {
            let share = self.sight.screen_share(&bounds, low_m);
            self.measure(&layers, share, px_per_m);
            self.pieces.extend(here);
        }
    }

    /// A piece out of view, from the pages drawn above it; from its own where nothing is above.
    fn keep_coarse(&mut self, region: &Region<'a>, mut layers: Layers, around: OrientedBox) {
        let distance_m = around.distance_m(self.sight.eye).max(region.above_m);
        if layers.terrain.drawn().is_none() {
            self.step(region, &mut layers, self.sight.view.projected_px(1.0, distance_m));
        }
        self.pieces.extend(piece(region, &layers, distance_m, around, self.sight));
    }

    /// Steps both layers to the region's node, and gives its children.
    fn step(&self, region: &Region<'a>, layers: &mut Layers, px_per_m: f64) -> [Option<Node<'a>>; 4] {
        let Some(node) = region.node else {
            layers.terrain.settle();
            layers.imagery.settle();
            return [None; 4];
        };
        let children = Quadrant::ALL.map(|quadrant| if node.has_children() { node.child(quadrant) } else { None });
        let terrain = Offer {
            rep: layers.terrain.terrain_rep(&node),
            resident: self.cells.terrain(region.cell).is_some(),
            finer: children.iter().flatten().any(|child| child.terrain().is_some()),
        };
        let imagery = Offer {
            rep: layers.imagery.imagery_rep(&node),
            resident: self.cells.has_imagery(region.cell),
            finer: children.iter().flatten().any(|child| child.imagery().is_some()),
        };
        layers.terrain.step(&terrain, px_per_m, self.sight.tolerance);
        layers.imagery.step(&imagery, px_per_m, self.sight.tolerance);
        children
    }

    /// Makes one piece of the pieces below a cell when all of them draw what the cell itself would draw.
    fn merge(&mut self, first: usize, here: Option<Piece>) {
        if let Some(here) = here
            && self.pieces.len() > first
            && self.pieces[first..].iter().all(|piece| piece.draws_like(&here))
        {
            self.pieces.truncate(first);
            self.pieces.push(here);
        }
    }

    /// Measures a cell of the front and demands its pages.
    fn measure(&mut self, layers: &Layers, share: f64, px_per_m: f64) {
        let tolerance = self.sight.tolerance;
        let terrain_px =
            |rep: Rep, tolerance_px| rep.morphed_error_m(rep.own_weight(px_per_m, tolerance_px)) * px_per_m;
        let drawn = layers.terrain.drawn().map(|rep| terrain_px(rep, tolerance.drawn_px));
        Self::measure_layer(
            self.demands,
            &mut self.terrain,
            &layers.terrain,
            Look { kind: PageKind::Terrain, share, drawn_px: drawn, px_per_m, asked_px: tolerance.asked_px },
        );
        let drawn = layers.imagery.drawn().map(|rep| rep.error_m * px_per_m);
        Self::measure_layer(
            self.demands,
            &mut self.imagery,
            &layers.imagery,
            Look { kind: PageKind::Imagery, share, drawn_px: drawn, px_per_m, asked_px: tolerance.asked_px },
        );
    }

    fn measure_layer(demands: &mut DemandList, measure: &mut LayerMeasure, layer: &Layer, look: Look) {
        let (Some(front), Some(best)) = (layer.front(), layer.best()) else {
            return;
        };
        let front_px = front.error_m * look.px_per_m;
        // Where nothing is drawn, the whole side of the cell is taken for the error.
        let side_m = front.cell.bounds().height_rad() * SEMI_MAJOR_M;
        let drawn_px = look.drawn_px.unwrap_or(side_m * look.px_per_m);
        measure.add(look.share, drawn_px, best.error_m * look.px_per_m, look.asked_px);
        let missing = layer.drawn().is_none_or(|drawn| drawn.cell != front.cell);
        let page = PageId { cell: front.cell, kind: look.kind };
        let fall_px = if missing { drawn_px - front_px.max(look.asked_px) } else { 0.0 };
        demands.visible(page, front.place, Part { share: look.share, fall_px, error_px: drawn_px, missing });
    }
}

/// How a layer of a cell is looked at.
#[derive(Clone, Copy)]
struct Look {
    kind: PageKind,
    share: f64,
    /// `None` where nothing is resident.
    drawn_px: Option<f64>,
    px_per_m: f64,
    asked_px: f64,
}

fn piece(
    region: &Region<'_>,
    layers: &Layers,
    distance_m: f64,
    around: OrientedBox,
    sight: &Sight<'_>,
) -> Option<Piece> {
    let px_per_m = sight.view.projected_px(1.0, distance_m);
    layers.terrain.drawn().map(|terrain| {
        let own = terrain.own_weight(px_per_m, sight.tolerance.drawn_px);
        // The box bounds the finest surface; the drawn one lies within its error of that.
        let half_m = around.half_m + DVec3::splat(terrain.morphed_error_m(own));
        Piece {
            cell: region.cell,
            terrain,
            imagery: layers.imagery.drawn().map(|rep| rep.cell),
            own,
            distance_m,
            around: OrientedBox { half_m, ..around },
        }
    })
}
