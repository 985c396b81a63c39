//! One layer on the way down the tree: what the front wants, what is there to be drawn, what the world has.

use super::sight::Tolerance;
use crate::content::{PageId, PageKind};
use crate::forest::CellId;
use crate::forest::index::{Node, Place};

/// A page that exists, with its error on the ground.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rep {
    pub cell: CellId,
    pub kind: PageKind,
    pub place: Place,
    /// `error_m` of terrain and of objects; ground size of a texel of imagery.
    pub error_m: f64,
    /// Of the parent's page; its own where there is no parent.
    pub parent_error_m: f64,
}

impl Rep {
    pub fn page(&self) -> PageId {
        PageId { cell: self.cell, kind: self.kind }
    }

    /// Morph weight: at the distance where the parent's error is the tolerance 0, which draws the parent's surface;
    /// at that where the own error is, 1. So a page comes out of its parent without a pop. Only terrain is morphed.
    fn own_weight(&self, px_per_m: f64, tolerance_px: f64) -> f64 {
        let (own_px, parent_px) = (self.error_m * px_per_m, self.parent_error_m * px_per_m);
        if self.kind != PageKind::Terrain || self.parent_error_m <= self.error_m {
            // No terrain, the root, or a parent that is no worse: nothing to morph from.
            return 1.0;
        }
        ((parent_px - tolerance_px) / (parent_px - own_px)).clamp(0.0, 1.0)
    }
}

/// A page as it is drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Posed {
    pub rep: Rep,
    /// Morph weight by the distance of the page's own cell, which is what it gives way to finer pages by: all pieces of a
    /// page are drawn alike, and none jumps when those come.
    pub own: f64,
}

impl Posed {
    /// Error of the morphed surface, metres.
    pub fn error_m(&self) -> f64 {
        self.own * self.rep.error_m + (1.0 - self.own) * self.rep.parent_error_m
    }
}

/// What a node offers in a layer.
#[derive(Clone, Copy, Debug)]
pub struct Offer {
    pub rep: Option<Rep>,
    pub resident: bool,
    /// Whether a child has a page of the layer. Pages of a layer exist from the root down without gaps, so that no
    /// deeper look is needed. A child in an absent segment may have one.
    pub finer: bool,
}

impl Offer {
    fn posed(&self, px_per_m: f64, tolerance_px: f64) -> Option<Posed> {
        self.rep.map(|rep| Posed { rep, own: rep.own_weight(px_per_m, tolerance_px) })
    }
}

/// Whether a node's children have pages of a layer, or may have them, as far as the index is resident.
pub fn is_finer(node: &Node<'_>, has_page: impl Fn(&Node<'_>) -> bool) -> bool {
    node.children().any(|child| has_page(&child)) || node.absent_children().next().is_some()
}

/// How far down to go.
#[derive(Clone, Copy, Debug, Default)]
struct Descent {
    page: Option<Posed>,
    settled: bool,
}

impl Descent {
    fn step(&mut self, offer: &Offer, px_per_m: f64, tolerance_px: f64) {
        if self.settled {
            return;
        }
        self.page = offer.posed(px_per_m, tolerance_px).or(self.page);
        let fine = offer.rep.is_some_and(|rep| rep.error_m * px_per_m <= tolerance_px);
        self.settled = fine || !offer.finer;
    }
}

/// State of a layer at a cell, carried from the root down.
#[derive(Clone, Copy, Debug, Default)]
pub struct Layer {
    /// At the tolerance drawn.
    front: Descent,
    /// At the tolerance asked for: what the settled front has.
    best: Descent,
    drawn: Option<Posed>,
    /// The page of the cell above, resident or not.
    above: Option<Rep>,
    /// The index ends here before the layer does.
    open: bool,
}

impl Layer {
    /// Nothing is wanted where what is always there has an error within the tolerance.
    pub fn begin(&mut self, always_px: f64, tolerance: Tolerance) {
        self.front.settled = always_px <= tolerance.drawn_px;
        self.best.settled = always_px <= tolerance.asked_px;
    }

    pub fn step(&mut self, offer: &Offer, px_per_m: f64, tolerance: Tolerance) {
        let still_wanted = !self.front.settled || !self.front_is_drawn();
        self.front.step(offer, px_per_m, tolerance.drawn_px);
        self.best.step(offer, px_per_m, tolerance.asked_px);
        self.above = offer.rep.or(self.above);
        // Below the front pages are drawn only while they stand in for a page of the front that is missing.
        if offer.resident && still_wanted {
            self.drawn = offer.posed(px_per_m, tolerance.drawn_px).or(self.drawn);
        }
    }

    /// Nothing finer exists here: the cell has no node.
    pub fn settle(&mut self) {
        self.front.settled = true;
        self.best.settled = true;
    }

    /// What exists here is in a segment that is not resident.
    pub fn cut_off(&mut self) {
        self.open = !self.best.settled;
        self.settle();
    }

    /// Whether finer pages may exist that the index does not tell of.
    pub fn is_open(&self) -> bool {
        self.open
    }

    pub fn is_settled(&self) -> bool {
        self.front.settled && self.best.settled
    }

    pub fn front_is_settled(&self) -> bool {
        self.front.settled
    }

    /// Whether the page of the front is drawn, or a finer one in its place.
    pub fn front_is_drawn(&self) -> bool {
        match (self.front.page, self.drawn) {
            (Some(front), Some(drawn)) => drawn.rep.cell.level() >= front.rep.cell.level(),
            (front, _) => front.is_none(),
        }
    }

    pub fn front(&self) -> Option<Posed> {
        self.front.page
    }

    pub fn best(&self) -> Option<Rep> {
        self.best.page.map(|page| page.rep)
    }

    pub fn drawn(&self) -> Option<Posed> {
        self.drawn
    }

    /// The rep of a node's page, whose parent is the page met before.
    fn rep_below(&self, node: &Node<'_>, kind: PageKind) -> Option<Rep> {
        let (place, error_m) = ground_page(node, kind)?;
        let parent_error_m = self.above.map_or(error_m, |above| above.error_m);
        Some(Rep { cell: node.cell(), kind, place, error_m, parent_error_m })
    }

    pub fn terrain_rep(&self, node: &Node<'_>) -> Option<Rep> {
        self.rep_below(node, PageKind::Terrain)
    }

    pub fn imagery_rep(&self, node: &Node<'_>) -> Option<Rep> {
        self.rep_below(node, PageKind::Imagery)
    }
}

/// The page that a node has in a layer of the ground, with its error there: `error_m` of terrain, the size of a texel of
/// imagery; metres. `None` for what is no ground.
pub fn ground_page(node: &Node<'_>, kind: PageKind) -> Option<(Place, f64)> {
    match kind {
        PageKind::Terrain => node.terrain().map(|entry| (entry.place, f64::from(entry.error_m))),
        PageKind::Imagery => node.imagery().map(|place| (place, texel_m(node.cell()))),
        PageKind::Objects { .. } | PageKind::Segment => None,
    }
}

/// Ground size of a texel: that of the longer side over the texels along it, metres.
fn texel_m(cell: CellId) -> f64 {
    let sides = cell.sides_m();
    sides.south_m.max(sides.north_m).max(sides.height_m) / f64::from(crate::content::IMAGERY_PX)
}
