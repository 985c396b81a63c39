//! What a view wants of a part of the ground, layer by layer: the one measure that debt, gains and the lower bound of
//! debt are taken with.

use super::layer::Rep;
use crate::content::PageKind;
use crate::forest::CellId;
use crate::forest::index::SegmentRef;

/// One layer of a region of the front: a cell at the finer of what its layers want, or the subtree that a page of
/// objects or of groups stands for;
/// or a segment of the index that the view needs, as if it were a page whose arrival cures all.
#[derive(Clone, Copy, Debug)]
pub struct FrontRegion<'a> {
    pub kind: PageKind,
    pub cell: CellId,
    /// Share of the screen, 0 to 1: of the bounding quad clipped to the viewport, horizon applied.
    pub share: f64,
    /// The pages that exist here, the coarsest first: of terrain and imagery from the zone's root down to the region
    /// itself, of objects from the whole collection's groups down to the region's own page.
    pub chain: &'a [Rep],
    /// Pixels that an error of one metre takes at the region's distance.
    pub px_per_m: f64,
    /// Error where nothing of the chain is resident.
    pub absent_px: f64,
    /// Error that is drawn now.
    pub drawn_px: f64,
    /// Place in the chain of the page that the tolerance drawn wants, of the one that the tolerance asked for wants,
    /// and of the one that is drawn. Those before `best` cure less, those behind it no more. The chain's length where
    /// the tolerance wants none of them.
    pub front: usize,
    pub best: usize,
    pub drawn: Option<usize>,
    /// Finer pages may exist that the index does not tell of, as their segment is not resident: the best error is not
    /// known, and counts as none.
    pub open: bool,
}

/// Takes the regions of a view, one after the other.
pub type VisitRegion<'v> = dyn FnMut(&FrontRegion<'_>) + 'v;

impl FrontRegion<'_> {
    /// The layer in whose debt it counts. A segment counts where it stands for the objects in it; what lacks of terrain
    /// and imagery for want of a segment is in the regions of those.
    pub fn layer(&self) -> Option<usize> {
        if self.kind == PageKind::Segment && self.open {
            return Some(super::OBJECTS_LAYER);
        }
        super::layer_of(self.kind)
    }

    /// Error of the settled front, px.
    pub fn best_px(&self) -> f64 {
        if self.open { 0.0 } else { self.error_px(Some(self.best)) }
    }

    /// Error once the page at that place of the chain is drawn; of `None`, where nothing is. Px.
    pub fn error_px(&self, at: Option<usize>) -> f64 {
        at.and_then(|at| self.chain.get(at)).map_or(self.absent_px, |rep| rep.error_m * self.px_per_m)
    }

    /// How far an error is above what can be drawn here at a tolerance, px.
    pub fn excess_px(&self, error_px: f64, tolerance_px: f64) -> f64 {
        let excess_px = (error_px - tolerance_px.max(self.best_px())).max(0.0);
        // Rounding of the same error at the same distance is no excess.
        if excess_px <= 1e-9 * error_px { 0.0 } else { excess_px }
    }
}

/// A segment that a view needs.
#[derive(Clone, Copy, Debug)]
pub struct SeenSegment {
    pub segment: SegmentRef,
    pub resident: bool,
    pub share: f64,
    /// Error without it, px; with it everything below could be drawn.
    pub absent_px: f64,
    /// Whether debt counts it, for the objects in it.
    pub open: bool,
}

impl SeenSegment {
    pub fn show(&self, visit_region: &mut VisitRegion<'_>) {
        let (cell, place) = (self.segment.root, self.segment.place);
        visit_region(&FrontRegion {
            kind: PageKind::Segment,
            cell,
            share: self.share,
            chain: &[Rep { cell, kind: PageKind::Segment, place, error_m: 0.0, parent_error_m: 0.0 }],
            px_per_m: 0.0,
            absent_px: self.absent_px,
            drawn_px: if self.resident { 0.0 } else { self.absent_px },
            front: 0,
            best: 0,
            drawn: self.resident.then_some(0),
            open: self.open,
        });
    }
}
