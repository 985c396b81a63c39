//! One collection on the way down its tree of pages: what its front wants, and what is there to be drawn.

use super::super::layer::Rep;
use super::super::region::{FrontRegion, VisitRegion};
use super::super::sight::Tolerance;
use super::Thresholds;
use crate::cells::LiveTree;
use crate::content::{FIRST_GROUPS, ObjectPage, PageKind};
use crate::forest::CellId;
use crate::forest::index::ObjectsEntry;
use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;

/// What a collection has at a node in view.
pub struct Offer<'o> {
    pub cell: CellId,
    /// Pages rooted here, the coarsest first.
    pub entries: &'o [ObjectsEntry],
    /// Largest bounding dimension in the subtree, metres, where there are groups.
    pub dimension_m: Option<f64>,
    pub px_per_m: f64,
    /// Share of the screen.
    pub share: f64,
    /// Largest reach in the subtree, metres.
    pub reach_m: f64,
    /// Half of the longest side of the subtree's box, metres.
    pub widest_m: f64,
}

/// A resident page to draw from.
#[derive(Clone)]
pub struct Draw {
    pub page: Arc<ObjectPage>,
    /// Only what stands for this subtree; for a page's own cell, for its own objects.
    pub part: Option<CellId>,
    pub reach_m: f64,
    pub widest_m: f64,
}

/// What the front has for a whole subtree at the tolerance drawn.
#[derive(Clone, Copy)]
struct Settled {
    /// Places in the chain; beyond its end where nothing is wanted.
    front: usize,
    drawn: Option<usize>,
}

/// What is chosen by: what was asked for, or what is drawn where memory or time lack.
#[derive(Clone, Copy)]
enum Standard {
    Asked,
    Drawn,
}

/// A page tree on the way down.
struct Cover {
    cell: CellId,
    /// Where the groups of the cover above begin in the chain, where its own do, and the chain's length with them.
    above: usize,
    own: usize,
    end: usize,
    /// The front's choice for all of it, made here or above.
    settled: Option<Settled>,
    /// Its regions are seen, or there is nothing to be seen.
    seen: bool,
    /// The front's choice is not there, and finer pages are gathered in its stead: from here on, or from above.
    gathers: bool,
    gathering: bool,
    /// Something of it can not be drawn from its own pages.
    missing: bool,
    /// What was drawn and seen before it.
    drawn_before: usize,
    regions_before: usize,
    reach_m: f64,
    widest_m: f64,
}

impl Cover {
    fn draw(&self, page: &Arc<ObjectPage>, part: Option<CellId>) -> Draw {
        Draw { page: page.clone(), part, reach_m: self.reach_m, widest_m: self.widest_m }
    }
}

/// A region, kept until it is known what is drawn of it.
struct Seen {
    cell: CellId,
    kind: PageKind,
    share: f64,
    chain: Range<usize>,
    px_per_m: f64,
    absent_px: f64,
    front: usize,
    best: usize,
    drawn: Option<usize>,
    /// Finer pages are drawn in its place.
    covered: bool,
}

#[derive(Default)]
struct Family {
    covers: Vec<Cover>,
    /// The groups from the top down to the innermost cover.
    chain: Vec<Rep>,
    drawn: Vec<Draw>,
    regions: Vec<Seen>,
}

/// All collections in view.
pub struct Families<'a> {
    cells: &'a LiveTree,
    tolerance: Tolerance,
    thresholds: Thresholds,
    by_collection: BTreeMap<u8, Family>,
    /// The chains of the regions.
    reps: Vec<Rep>,
}

impl<'a> Families<'a> {
    pub fn new(cells: &'a LiveTree, tolerance: Tolerance, thresholds: Thresholds) -> Self {
        Self { cells, tolerance, thresholds, by_collection: BTreeMap::new(), reps: Vec::new() }
    }

    /// Goes down into a node; false where nothing of the collection is to be looked at below.
    pub fn enter(&mut self, collection: u8, offer: &Offer<'_>) -> bool {
        let family = self.by_collection.entry(collection).or_default();
        let mut step = Step {
            cells: self.cells,
            tolerance: self.tolerance,
            thresholds: self.thresholds,
            reps: &mut self.reps,
            family,
            offer,
        };
        let cover = step.cover();
        let goes_on = !cover.seen || cover.gathering;
        family.covers.push(cover);
        goes_on
    }

    /// Comes back from a node.
    pub fn leave(&mut self, collection: u8) {
        if let Some(family) = self.by_collection.get_mut(&collection) {
            family.leave(self.cells);
        }
    }

    /// Shows all regions, collection by collection.
    pub fn show(&self, visit_region: &mut VisitRegion<'_>) {
        for seen in self.by_collection.values().flat_map(|family| &family.regions) {
            let chain = &self.reps[seen.chain.clone()];
            let mut region = FrontRegion {
                kind: seen.kind,
                cell: seen.cell,
                share: seen.share,
                chain,
                px_per_m: seen.px_per_m,
                absent_px: seen.absent_px,
                drawn_px: 0.0,
                front: seen.front,
                best: seen.best,
                drawn: seen.drawn,
                open: false,
            };
            region.drawn_px = region.error_px(if seen.covered { Some(seen.front) } else { seen.drawn });
            visit_region(&region);
        }
    }

    pub fn drawn(&self) -> impl Iterator<Item = &Draw> {
        self.by_collection.values().flat_map(|family| &family.drawn)
    }
}

/// Finds the resident page of a rep.
fn resident<'c>(cells: &'c LiveTree, rep: &Rep) -> Option<&'c Arc<ObjectPage>> {
    match rep.kind {
        PageKind::Objects { collection, rep: number } => cells.objects(rep.cell, collection, number),
        _ => None,
    }
}

/// One step down a collection.
struct Step<'s, 'o> {
    cells: &'s LiveTree,
    tolerance: Tolerance,
    thresholds: Thresholds,
    reps: &'s mut Vec<Rep>,
    family: &'s mut Family,
    offer: &'s Offer<'o>,
}

impl Step<'_, '_> {
    fn cover(&mut self) -> Cover {
        let mut cover = self.below_the_last();
        self.push_groups(&mut cover);
        let subtree_px = self.offer.dimension_m.map(|dimension_m| dimension_m * self.offer.px_per_m);
        if subtree_px.is_some_and(|px| px < self.thresholds.asked_px) {
            (cover.seen, cover.gathering) = (true, false);
            return cover;
        }
        // A page without groups of its own is as large as itself.
        let absent_px = subtree_px.or_else(|| self.own_px()).unwrap_or(0.0);
        if cover.gathering {
            self.gather(&mut cover);
        } else if cover.settled.is_none() {
            self.settle_front(&mut cover, absent_px);
        }
        if !cover.seen {
            match self.choose(&cover, absent_px, Standard::Asked) {
                Some(best) => {
                    self.see_groups(&cover, best, absent_px);
                    cover.seen = true;
                }
                None => self.see_own(&mut cover),
            }
        }
        cover
    }

    fn below_the_last(&self) -> Cover {
        let last = self.family.covers.last();
        let own = self.family.chain.len();
        Cover {
            cell: self.offer.cell,
            above: last.map_or(0, |above| above.own),
            own,
            end: own,
            settled: last.and_then(|above| above.settled),
            seen: last.is_some_and(|above| above.seen),
            gathers: false,
            gathering: last.is_some_and(|above| above.gathering),
            missing: false,
            drawn_before: self.family.drawn.len(),
            regions_before: self.family.regions.len(),
            reach_m: self.offer.reach_m,
            widest_m: self.offer.widest_m,
        }
    }

    fn push_groups(&mut self, cover: &mut Cover) {
        if self.thresholds.groups {
            let groups = self.offer.entries.iter().filter(|entry| entry.rep >= FIRST_GROUPS);
            self.family.chain.extend(groups.map(|entry| rep_of(self.offer.cell, entry)));
            cover.end = self.family.chain.len();
        }
    }

    /// Pages of the node's own objects, the coarsest first.
    fn own(&self) -> impl DoubleEndedIterator<Item = Rep> + use<'_> {
        let own = self.offer.entries.iter().filter(|entry| entry.rep < FIRST_GROUPS);
        own.map(|entry| rep_of(self.offer.cell, entry))
    }

    fn own_px(&self) -> Option<f64> {
        let own = self.offer.entries.iter().find(|entry| entry.rep == 0)?;
        Some(own.dimension_m * self.offer.px_per_m)
    }

    /// The groups that stand for a cover: the coarsest whose error is within the tolerance here; by VGIS's rule the finest,
    /// as long as no object is large enough to be drawn singly.
    fn choose(&self, cover: &Cover, absent_px: f64, standard: Standard) -> Option<usize> {
        let mut among = cover.above..cover.end;
        let by = |asked_and_drawn: [f64; 2]| asked_and_drawn[standard as usize];
        match self.thresholds.single_px {
            Some(single_px) => among.next_back().filter(|_| absent_px < by(single_px)),
            None => {
                let tolerance_px = by([self.tolerance.asked_px, self.tolerance.drawn_px]);
                among.find(|&at| self.family.chain[at].error_m * self.offer.px_per_m <= tolerance_px)
            }
        }
    }

    /// Chooses for the whole subtree where the tolerance drawn is content with groups, and draws what is there of them:
    /// the wanted ones, else finer ones; else finer pages are gathered.
    fn settle_front(&mut self, cover: &mut Cover, absent_px: f64) {
        if absent_px < self.thresholds.drawn_px {
            cover.settled = Some(Settled { front: usize::MAX, drawn: None });
            return;
        }
        let Some(front) = self.choose(cover, absent_px, Standard::Drawn) else { return };
        let drawn = self.family.draw_groups(self.cells, cover, front..cover.end);
        cover.settled = Some(Settled { front, drawn });
        if drawn.is_none() {
            (cover.gathers, cover.gathering) = (true, true);
            self.gather(cover);
        }
    }

    /// Finer pages in place of the front's: groups, or the node's own objects and what is below.
    fn gather(&mut self, cover: &mut Cover) {
        if !cover.gathers {
            let groups = self.family.chain[cover.own..cover.end].iter().rev();
            if let Some(page) = groups.into_iter().find_map(|rep| resident(self.cells, rep)) {
                self.family.drawn.push(cover.draw(page, None));
                cover.gathering = false;
                return;
            }
        }
        let own = self.own().rev().find_map(|rep| resident(self.cells, &rep));
        match own {
            Some(page) => self.family.drawn.push(cover.draw(page, None)),
            None if self.own_px().is_some_and(|px| px >= self.thresholds.drawn_px) => {
                // Nothing below can mend it.
                (cover.missing, cover.gathering) = (true, false);
            }
            None => {}
        }
    }

    /// A region that groups stand for.
    fn see_groups(&mut self, cover: &Cover, best: usize, absent_px: f64) {
        let kind = self.family.chain[best].kind;
        let chain = self.keep_chain(best + 1, &[]);
        let settled = cover.settled.unwrap_or(Settled { front: best, drawn: None });
        self.see(kind, chain, absent_px, settled, best);
    }

    /// The node's own objects: a region of their own.
    fn see_own(&mut self, cover: &mut Cover) {
        let Some(absent_px) = self.own_px().filter(|&px| px >= self.thresholds.asked_px) else { return };
        let own: Vec<Rep> = self.own().collect();
        let within = |tolerance_px: f64| {
            let at = own.iter().position(|rep| rep.error_m * self.offer.px_per_m <= tolerance_px);
            at.unwrap_or(own.len() - 1)
        };
        let (best, front) = (within(self.tolerance.asked_px), within(self.tolerance.drawn_px));
        let settled = match cover.settled {
            Some(settled) => settled,
            None if absent_px < self.thresholds.drawn_px => Settled { front: usize::MAX, drawn: None },
            None => self.draw_own(cover, &own, front),
        };
        let chain = self.keep_chain(cover.end, &own[..=best]);
        self.see(own[best].kind, chain, absent_px, settled, cover.end + best);
    }

    /// Draws the wanted one of the own pages, else a finer one, else a coarser one, else the part of the groups.
    fn draw_own(&mut self, cover: &mut Cover, own: &[Rep], front: usize) -> Settled {
        let mut order = (front..own.len()).chain((0..front).rev());
        let of_own = order.find_map(|at| Some((cover.end + at, resident(self.cells, &own[at])?, None)));
        let found = of_own.or_else(|| {
            let groups = &self.family.chain[..cover.end];
            (cover.own..cover.end).rev().find_map(|at| Some((at, resident(self.cells, &groups[at])?, Some(cover.cell))))
        });
        let drawn = found.map(|(at, page, part)| {
            self.family.drawn.push(cover.draw(page, part));
            at
        });
        cover.missing = drawn.is_none();
        Settled { front: cover.end + front, drawn }
    }

    /// Keeps the groups down to `end`, and pages of objects behind them.
    fn keep_chain(&mut self, end: usize, own: &[Rep]) -> Range<usize> {
        let start = self.reps.len();
        self.reps.extend(&self.family.chain[..end]);
        self.reps.extend(own);
        start..self.reps.len()
    }

    fn see(&mut self, kind: PageKind, chain: Range<usize>, absent_px: f64, settled: Settled, best: usize) {
        self.family.regions.push(Seen {
            cell: self.offer.cell,
            kind,
            share: self.offer.share,
            px_per_m: self.offer.px_per_m,
            absent_px,
            front: settled.front.min(chain.len()),
            best,
            // What is finer than the best is as good.
            drawn: settled.drawn.map(|at| at.min(best)),
            covered: false,
            chain,
        });
    }
}

fn rep_of(cell: CellId, entry: &ObjectsEntry) -> Rep {
    let kind = PageKind::Objects { collection: entry.collection, rep: entry.rep };
    Rep { cell, kind, place: entry.place, error_m: entry.error_m, parent_error_m: entry.error_m }
}

impl Family {
    /// Draws all of a cover from the first resident groups of the chain: its own whole, or its part of those above.
    fn draw_groups(
        &mut self,
        cells: &LiveTree,
        cover: &Cover,
        mut order: impl Iterator<Item = usize>,
    ) -> Option<usize> {
        let (at, page) = order.find_map(|at| Some((at, resident(cells, &self.chain[at])?)))?;
        self.drawn.push(cover.draw(page, (at < cover.own).then_some(cover.cell)));
        Some(at)
    }

    /// Makes up for what is missing below a cover by the coarser groups of which it is a part.
    fn leave(&mut self, cells: &LiveTree) {
        let Some(cover) = self.covers.pop() else { return };
        if cover.gathers && !cover.missing {
            self.regions[cover.regions_before..].iter_mut().for_each(|region| region.covered = true);
        } else if cover.missing {
            let is_free = cover.gathers || cover.settled.is_none();
            let coarser_end = cover.settled.map_or(cover.own, |settled| settled.front.min(cover.end));
            let kept = if is_free { self.replace(cells, &cover, cover.above..coarser_end) } else { false };
            if let Some(above) = self.covers.last_mut().filter(|_| !kept) {
                above.missing = true;
            }
        }
        self.chain.truncate(cover.own);
    }

    /// Draws all of a cover anew from the finest resident of some groups; false where there are none.
    fn replace(&mut self, cells: &LiveTree, cover: &Cover, among: Range<usize>) -> bool {
        if !among.clone().any(|at| resident(cells, &self.chain[at]).is_some()) {
            return false;
        }
        self.drawn.truncate(cover.drawn_before);
        let drawn = self.draw_groups(cells, cover, among.rev());
        for region in &mut self.regions[cover.regions_before..] {
            (region.drawn, region.covered) = (drawn, false);
        }
        true
    }
}
