//! The front of terrain and imagery: one walk from the zones' roots, culled by view and horizon.
//!
//! The walk goes down while a layer's error is above the tolerance and the world has finer pages of it. Each layer
//! stops for itself: below its front its page is cut, not loaded finer. Each quadrant resolves alone; where the index
//! has no child, the parent is cut to the quadrant; where the child's segment is not resident, that is asked for. Pages are taken from the cell or its nearest resident ancestor; where
//! a page of the front is missing and finer ones are resident below, those stand in for it. At last quadrants that
//! draw the same pages as their parent become one piece again.
//!
//! The cells at which the walk settles are the regions that everything is measured by: they follow from the index, the
//! view and the tolerance, and not from what is resident. So debt, what a page would take off it, and the debt that no
//! policy can beat are sums over the same regions with the same weights.

use super::layer::{Layer, Offer, Posed, Rep, is_finer};
use super::region::{FrontRegion, SeenSegment, VisitRegion};
use super::sight::Sight;
use super::{DrawPiece, OutOfView, SelectStats};
use crate::cells::LiveTree;
use crate::content::{PageId, PageKind, WORLD_IMAGE_COARSER};
use crate::forest::index::{IndexForest, Node, SegmentRef};
use crate::forest::{CellId, Quadrant};
use crate::geodesy::{GeoBounds, OrientedBox, SEMI_MAJOR_M};
use glam::DVec3;

/// How many levels below a missing page of the front finer pages may stand in for it.
pub const STAND_IN_LEVELS: u8 = 3;

/// Pieces with more triangles than this are parted where quadrants of theirs are out of view. What a part has more of skirts and
/// calls is less than what a quadrant of fewer saves.
const PARTED_TRIANGLES: usize = 192;

/// A piece before its skirts are known.
#[derive(Clone, Copy, Debug)]
pub struct Piece {
    pub cell: CellId,
    pub terrain: Posed,
    pub imagery: Option<CellId>,
    pub distance_m: f64,
    pub around: OrientedBox,
}

impl Piece {
    /// Error of the surface that is drawn, metres.
    pub fn error_m(&self) -> f64 {
        self.terrain.error_m()
    }

    fn draws_like(&self, other: &Self) -> bool {
        self.terrain.rep.cell == other.terrain.rep.cell && self.imagery == other.imagery
    }
}

/// A cell of the walk: with its node, or below the world's finest.
#[derive(Clone, Copy)]
struct Region<'a> {
    cell: CellId,
    node: Option<Node<'a>>,
    /// The segment that begins here, where it is not resident.
    absent: Option<SegmentRef>,
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

/// What a walk is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// Pieces to draw.
    Draw(OutOfView),
    /// The regions alone.
    Survey,
}

struct Walk<'a, 'b> {
    cells: &'a LiveTree,
    sight: &'a Sight<'a>,
    purpose: Purpose,
    visit_region: &'b mut VisitRegion<'b>,
    stats: &'b mut SelectStats,
    pieces: Vec<Piece>,
    /// Existing pages of terrain and of imagery from the root down to the cell of the walk.
    chains: [Vec<Rep>; 2],
}

/// Shows each layer of each region of the front, and gives the pieces to draw: apart from one another, ascending by
/// cell.
pub fn walk<'b>(
    index: &IndexForest,
    cells: &LiveTree,
    sight: &Sight<'_>,
    purpose: Purpose,
    visit_region: &'b mut VisitRegion<'b>,
    stats: &'b mut SelectStats,
) -> Vec<Piece> {
    let mut walk = Walk { cells, sight, purpose, visit_region, stats, pieces: Vec::new(), chains: Default::default() };
    for root in index.trees().map(|tree| tree.root()) {
        let (cell, heights_m) = (root.cell(), root.height_range_m());
        let region = Region { cell, node: Some(root), absent: None, heights_m, above_m: 0.0 };
        walk.visit(region, Layers::default(), None);
    }
    walk.pieces.sort_by_key(|piece| piece.cell);
    walk.pieces
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
                terrain: cells.terrain(piece.terrain.rep.cell)?.clone(),
                imagery: piece.imagery,
                own: piece.terrain.own as f32,
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
        resident: cells.has_terrain(node.cell()),
        finer: is_finer(node, |child| child.terrain().is_some()),
    };
    layer.step(&offer, px_per_m, sight.tolerance);
}

impl<'a> Walk<'a, '_> {
    /// `standing` is how many levels further down pages may stand in for one of a region above; the region is measured
    /// already.
    fn visit(&mut self, region: Region<'a>, mut layers: Layers, standing: Option<u8>) {
        let bounds = region.cell.bounds();
        let (low_m, high_m) = region.heights_m;
        let around = OrientedBox::around(&bounds, low_m, high_m);
        self.stats.cells_tested += 1;
        if !self.sight.sees(&around) {
            self.stats.cells_culled += 1;
            if self.purpose == Purpose::Draw(OutOfView::Coarse) && !self.sight.horizon.hides_box(&around) {
                self.keep_coarse(&region, layers, around);
            }
            return;
        }
        let distance_m = around.distance_m(self.sight.eye).max(region.above_m);
        let px_per_m = self.sight.view.projected_px(1.0, distance_m);
        if standing.is_none() {
            self.show_segment(&region, &layers, &bounds, px_per_m);
        }
        let children = self.step(&region, &mut layers, px_per_m);
        let settled = layers.terrain.is_settled() && layers.imagery.is_settled();
        if settled && standing.is_none() {
            let share = self.sight.screen_share(&bounds, low_m);
            self.measure(&region, &layers, share, px_per_m);
        }
        if settled && self.purpose == Purpose::Survey {
            return;
        }
        let left = standing.unwrap_or(STAND_IN_LEVELS);
        let stands_in = settled
            && left > 0
            && !(layers.terrain.front_is_drawn() && layers.imagery.front_is_drawn())
            && self.cells.has_finer(region.cell);
        let here = piece(&region, &layers, distance_m, around);
        if settled && !stands_in {
            here.into_iter().for_each(|here| self.draw(&region, &layers, here));
            return;
        }
        let first = self.pieces.len();
        let standing = if settled { Some(left - 1) } else { standing };
        for quadrant in Quadrant::ALL {
            if let Some(cell) = region.cell.child(quadrant) {
                let node = children[quadrant as usize];
                let absent = region.node.and_then(|node| node.absent_child(quadrant));
                let heights_m = node.map_or(region.heights_m, |node| node.height_range_m());
                self.visit(Region { cell, node, absent, heights_m, above_m: distance_m }, layers, standing);
            }
        }
        // One piece of those below where all of them draw what the cell itself would draw.
        if let Some(here) = here
            && self.pieces.len() > first
            && self.pieces[first..].iter().all(|piece| piece.draws_like(&here))
        {
            self.pieces.truncate(first);
            self.draw(&region, &layers, here);
        }
    }

    /// Draws a piece, or its parts where some of them are out of view: a coarse page reaches far beyond a narrow view.
    fn draw(&mut self, region: &Region<'a>, layers: &Layers, here: Piece) {
        if self.triangles_about(&here) <= PARTED_TRIANGLES || self.sight.sees_all(&here.around) {
            self.pieces.push(here);
            return;
        }
        let (first, mut is_whole) = (self.pieces.len(), true);
        for quadrant in Quadrant::ALL {
            let Some(cell) = region.cell.child(quadrant) else { continue };
            let node = region.node.filter(Node::has_children).and_then(|node| node.child(quadrant));
            let heights_m = node.map_or(region.heights_m, |node| node.height_range_m());
            let around = OrientedBox::around(&cell.bounds(), heights_m.0, heights_m.1);
            let distance_m = around.distance_m(self.sight.eye).max(here.distance_m);
            let part = Region { cell, node, absent: None, heights_m, above_m: here.distance_m };
            let Some(piece) = piece(&part, layers, distance_m, around) else { continue };
            self.stats.cells_tested += 1;
            if self.sight.sees(&piece.around) {
                let before = self.pieces.len();
                self.draw(&part, layers, piece);
                is_whole &= self.pieces.len() == before + 1 && self.pieces[before].cell == cell;
                continue;
            }
            is_whole = false;
            self.stats.cells_culled += 1;
            if self.purpose == Purpose::Draw(OutOfView::Coarse) && !self.sight.horizon.hides_box(&piece.around) {
                self.pieces.push(piece);
            }
        }
        if is_whole {
            self.pieces.truncate(first);
            self.pieces.push(here);
        }
    }

    /// Of a piece, were its page's spread evenly.
    fn triangles_about(&self, piece: &Piece) -> usize {
        let page = self.cells.terrain(piece.terrain.rep.cell);
        let levels = u32::from(piece.cell.level().saturating_sub(piece.terrain.rep.cell.level()));
        page.map_or(0, |page| page.triangles.len() >> (2 * levels).min(usize::BITS - 1))
    }

    /// A piece out of view, from the pages drawn above it; from its own where nothing is above.
    fn keep_coarse(&mut self, region: &Region<'a>, mut layers: Layers, around: OrientedBox) {
        let distance_m = around.distance_m(self.sight.eye).max(region.above_m);
        if layers.terrain.drawn().is_none() {
            self.step(region, &mut layers, self.sight.view.projected_px(1.0, distance_m));
        }
        self.pieces.extend(piece(region, &layers, distance_m, around));
    }

    /// Steps both layers to the region's node, and gives its children.
    fn step(&mut self, region: &Region<'a>, layers: &mut Layers, px_per_m: f64) -> [Option<Node<'a>>; 4] {
        // A layer has pages from the root down without gaps: a chain's length is the level it has reached.
        self.chains.iter_mut().for_each(|chain| chain.truncate(region.cell.level().into()));
        let Some(node) = region.node else {
            let end = if region.absent.is_some() { Layer::cut_off } else { Layer::settle };
            end(&mut layers.terrain);
            end(&mut layers.imagery);
            return [None; 4];
        };
        let may_be_finer = node.absent_children().next().is_some();
        let children = Quadrant::ALL.map(|quadrant| if node.has_children() { node.child(quadrant) } else { None });
        let terrain = Offer {
            rep: layers.terrain.terrain_rep(&node),
            resident: self.cells.has_terrain(region.cell),
            finer: may_be_finer || children.iter().flatten().any(|child| child.terrain().is_some()),
        };
        let imagery = Offer {
            rep: layers.imagery.imagery_rep(&node),
            resident: self.cells.has_imagery(region.cell),
            finer: may_be_finer || children.iter().flatten().any(|child| child.imagery().is_some()),
        };
        self.chains[0].extend(terrain.rep);
        self.chains[1].extend(imagery.rep);
        if let Some(root) = imagery.rep.filter(|_| region.cell.level() == 0) {
            layers.imagery.begin(WORLD_IMAGE_COARSER * root.error_m * px_per_m, self.sight.tolerance);
        }
        layers.terrain.step(&terrain, px_per_m, self.sight.tolerance);
        layers.imagery.step(&imagery, px_per_m, self.sight.tolerance);
        children
    }

    /// Shows the segment that begins at a cell in view, if it comes and goes.
    fn show_segment(&mut self, region: &Region<'_>, layers: &Layers, bounds: &GeoBounds, px_per_m: f64) {
        let paged = region.node.and_then(|node| node.paged_segment());
        let Some(segment) = paged.or(region.absent) else { return };
        let side_px = bounds.height_rad() * SEMI_MAJOR_M * px_per_m;
        let drawn_px = |layer: &Layer| layer.drawn().map_or(side_px, |drawn| drawn.rep.error_m * px_per_m);
        let absent_px = drawn_px(&layers.terrain).max(drawn_px(&layers.imagery));
        let share = self.sight.screen_share(bounds, region.heights_m.0);
        SeenSegment { segment, resident: paged.is_some(), share, absent_px, open: false }.show(self.visit_region);
    }

    /// Shows both layers of a region of the front.
    fn measure(&mut self, region: &Region<'_>, layers: &Layers, share: f64, px_per_m: f64) {
        for (kind, layer, chain) in [
            (PageKind::Terrain, &layers.terrain, &self.chains[0]),
            (PageKind::Imagery, &layers.imagery, &self.chains[1]),
        ] {
            let Some(root) = chain.first() else { continue };
            // Without pictures the world image is drawn; where no terrain is, the whole side of the cell is the error.
            let absent_m = match kind {
                PageKind::Imagery => WORLD_IMAGE_COARSER * root.error_m,
                _ => layer.front().map_or(*root, |front| front.rep).cell.bounds().height_rad() * SEMI_MAJOR_M,
            };
            let absent_px = absent_m * px_per_m;
            let is_covered = || {
                region
                    .node
                    .is_some_and(|node| self.cells.has_finer(region.cell) && self.covers(&node, kind, STAND_IN_LEVELS))
            };
            let shown = if !layer.front_is_drawn() && is_covered() { layer.front() } else { layer.drawn() };
            let drawn_px = shown.map_or(absent_px, |shown| shown.error_m() * px_per_m);
            let place = |rep: Option<Rep>| rep.map_or(chain.len(), |rep| usize::from(rep.cell.level()));
            (self.visit_region)(&FrontRegion {
                kind,
                cell: region.cell,
                share,
                chain,
                px_per_m,
                absent_px,
                drawn_px,
                front: place(layer.front().map(|front| front.rep)),
                best: place(layer.best()),
                drawn: layer.drawn().map(|drawn| usize::from(drawn.rep.cell.level())),
                open: layer.is_open(),
            });
        }
    }

    /// Whether resident pages below a node cover all of it; its own does not count.
    fn covers(&self, node: &Node<'_>, kind: PageKind, levels: u8) -> bool {
        levels > 0
            && node.cell().children().all(|cell| {
                self.cells.contains(PageId { cell, kind })
                    || (self.cells.has_finer(cell)
                        && cell
                            .quadrant()
                            .and_then(|quadrant| node.child(quadrant))
                            .is_some_and(|child| self.covers(&child, kind, levels - 1)))
            })
    }
}

fn piece(region: &Region<'_>, layers: &Layers, distance_m: f64, around: OrientedBox) -> Option<Piece> {
    layers.terrain.drawn().map(|terrain| {
        // The box bounds the finest surface; the drawn one lies within its error of that.
        let half_m = around.half_m + DVec3::splat(terrain.error_m());
        let imagery = layers.imagery.drawn().map(|drawn| drawn.rep.cell);
        Piece { cell: region.cell, terrain, imagery, distance_m, around: OrientedBox { half_m, ..around } }
    })
}
