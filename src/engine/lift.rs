//! Objects stand on the terrain that is drawn: where coarse terrain lies above an object's base, the object is lifted by
//! the difference, and comes back as the terrain arrives; where it lies below, the foundation goes down by the
//! difference, which is a lift below 0.
//!
//! Where the finest terrain of the world is drawn there is no lift: the walls were fitted to it at preparation.

use crate::content::{CellObjects, Object, ObjectPage, PageId, TerrainPage};
use crate::forest::index::IndexForest;
use crate::forest::{CellId, LEVEL_MAX};
use crate::select::{DrawObjects, DrawPiece, Selection};
use std::collections::HashMap;
use std::sync::Arc;

/// Morph weights are rounded to one of so many steps, and lifts to this many metres, so that a slow morph does not send
/// them to the GPU in every frame. A lift depends on what is drawn alone, not on what was drawn before.
const OWN_STEPS: f32 = 64.0;
const LIFT_STEP_M: f64 = 0.01;

/// What following the lift of an object takes, bytes.
pub const LIFT_BYTES_PER_OBJECT: usize = size_of::<Option<Standing>>() + size_of::<f32>() + size_of::<u8>();

/// The pieces of a frame by cell.
pub struct Ground<'a> {
    pieces: HashMap<CellId, &'a DrawPiece>,
    /// Levels that occur, deepest first.
    levels: Vec<u8>,
}

impl<'a> Ground<'a> {
    pub fn new(pieces: &'a [DrawPiece]) -> Self {
        let pieces: HashMap<_, _> = pieces.iter().map(|piece| (piece.cell, piece)).collect();
        let levels = (0..=LEVEL_MAX).rev().filter(|&level| pieces.keys().any(|cell| cell.level() == level)).collect();
        Self { pieces, levels }
    }

    /// The piece that covers the whole of a cell.
    pub fn covering(&self, cell: CellId) -> Option<&'a DrawPiece> {
        self.levels.iter().find_map(|&level| self.pieces.get(&cell.ancestor(level)?).copied())
    }
}

/// Which surface lies under a cell of objects.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Under {
    /// Nothing is drawn there.
    Nothing,
    /// One piece under all of it: the terrain page's cell and the morph weight in steps.
    One { terrain: CellId, own: u32 },
    /// Several finer pieces.
    Several,
}

/// Heights of a terrain page's two surfaces at an object.
#[derive(Clone, Copy, Debug)]
struct Standing {
    terrain: CellId,
    parent_m: f64,
    own_m: f64,
}

/// What lies below objects: what the world has there, and what is drawn.
struct Below<'a> {
    index: &'a IndexForest,
    ground: &'a Ground<'a>,
}

struct PageLifts {
    under: Vec<Under>,
    standing: Vec<Option<Standing>>,
    /// Level of the world's finest terrain at each object; `None` while the index does not tell, as the segment is not
    /// resident.
    finest: Vec<Option<u8>>,
    lifts_m: Vec<f32>,
    highest_m: f32,
}

/// The lifts of the pages that were drawn since they arrived.
#[derive(Default)]
pub struct Lifts {
    pages: HashMap<PageId, PageLifts>,
}

impl Lifts {
    pub(super) fn forget(&mut self, page: PageId) {
        self.pages.remove(&page);
    }

    /// The index tells more than before: what it left open is worked out anew.
    pub(super) fn look_again(&mut self) {
        for known in self.pages.values_mut().filter(|known| known.finest.contains(&None)) {
            known.under.fill(Under::Nothing);
        }
    }

    /// There may be other ground below: all is worked out anew as it is drawn next.
    pub(super) fn start_over(&mut self) {
        for known in self.pages.values_mut() {
            known.under.fill(Under::Nothing);
            known.finest.fill(None);
        }
    }

    /// Sets the objects of a selection on its ground, and tells the lifts of pages where they changed since the last call,
    /// metres; below 0, how far foundations go down.
    pub fn follow(&mut self, index: &IndexForest, selection: &Selection, mut on_change: impl FnMut(PageId, &[f32])) {
        let ground = Ground::new(&selection.pieces);
        for drawn in &selection.objects {
            if let Some((page, lifts_m)) = self.update(index, &ground, drawn) {
                on_change(page, lifts_m);
            }
        }
    }

    /// The page of drawn objects and their lifts in metres, or `None` where nothing changed since the last call.
    pub(super) fn update(
        &mut self,
        index: &IndexForest,
        ground: &Ground<'_>,
        drawn: &DrawObjects,
    ) -> Option<(PageId, &[f32])> {
        let page = &*drawn.page;
        let id = page.id();
        let known = self.pages.entry(id).or_insert_with(|| PageLifts::new(page));
        let mut changed = false;
        for (at, cell) in page.cells.iter().enumerate() {
            changed |= known.update_cell(at, cell, page, &Below { index, ground });
        }
        if changed {
            known.highest_m = known.lifts_m.iter().copied().fold(0.0, f32::max);
        }
        changed.then_some((id, &*known.lifts_m))
    }
}

/// Lifts as they are drawn.
pub trait KnownLifts {
    /// The lifts of a page's objects and the highest of them, metres; none for pages never drawn.
    fn of(&self, page: &ObjectPage) -> (&[f32], f32);
}

impl KnownLifts for Lifts {
    fn of(&self, page: &ObjectPage) -> (&[f32], f32) {
        self.pages.get(&page.id()).map_or((&[], 0.0), |known| (&*known.lifts_m, known.highest_m))
    }
}

/// Copies of the lifts, for a thread that only draws.
#[derive(Default)]
pub struct LiftCopies {
    pages: HashMap<PageId, (Arc<[f32]>, f32)>,
}

impl LiftCopies {
    pub fn set(&mut self, page: PageId, lifts_m: &Arc<[f32]>) {
        let highest_m = lifts_m.iter().copied().fold(0.0, f32::max);
        self.pages.insert(page, (lifts_m.clone(), highest_m));
    }

    pub fn forget(&mut self, page: PageId) {
        self.pages.remove(&page);
    }
}

impl KnownLifts for LiftCopies {
    fn of(&self, page: &ObjectPage) -> (&[f32], f32) {
        self.pages.get(&page.id()).map_or((&[], 0.0), |(lifts_m, highest_m)| (lifts_m, *highest_m))
    }
}

impl PageLifts {
    fn new(page: &ObjectPage) -> Self {
        Self {
            under: vec![Under::Nothing; page.cells.len()],
            standing: vec![None; page.objects.len()],
            finest: vec![None; page.objects.len()],
            lifts_m: vec![0.0; page.objects.len()],
            highest_m: 0.0,
        }
    }

    fn update_cell(&mut self, at: usize, cell: &CellObjects, page: &ObjectPage, below: &Below<'_>) -> bool {
        let covering = below.ground.covering(cell.cell);
        let under = match covering {
            Some(piece) => Under::One { terrain: piece.terrain.cell, own: (piece.own * OWN_STEPS).round() as u32 },
            None => Under::Several,
        };
        if under != Under::Several && under == self.under[at] {
            return false;
        }
        self.under[at] = under;
        let mut changed = false;
        for which in cell.objects.start as usize..cell.objects.end as usize {
            let Some(object) = page.objects.get(which) else { break };
            let piece = covering.or_else(|| below.ground.covering(place_cell(object)));
            let has_foundation = page.foundation_m(which) > 0.0;
            changed |= piece.is_some_and(|piece| self.update_object(which, object, has_foundation, piece, below.index));
        }
        changed
    }

    fn update_object(
        &mut self,
        which: usize,
        object: &Object,
        has_foundation: bool,
        piece: &DrawPiece,
        index: &IndexForest,
    ) -> bool {
        let finest = self.finest[which].or_else(|| finest_terrain_level(index, object));
        self.finest[which] = finest;
        let known = self.standing[which].filter(|standing| standing.terrain == piece.terrain.cell);
        let Some(standing) = known.or_else(|| Standing::of(object, &piece.terrain)) else { return false };
        self.standing[which] = Some(standing);
        let own = f64::from((piece.own * OWN_STEPS).round() / OWN_STEPS);
        let lift_m = (standing.lift_m(object, own, finest, has_foundation) / LIFT_STEP_M).round() * LIFT_STEP_M;
        std::mem::replace(&mut self.lifts_m[which], lift_m as f32) != lift_m as f32
    }
}

impl Standing {
    fn of(object: &Object, terrain: &TerrainPage) -> Option<Self> {
        let height_m = |own| terrain.surface_height_m(object.lat_rad, object.lon_rad, own);
        Some(Self { terrain: terrain.cell, parent_m: height_m(0.0)?, own_m: height_m(1.0)? })
    }

    /// Below 0 only for objects with a foundation.
    fn lift_m(&self, object: &Object, own: f64, finest_level: Option<u8>, has_foundation: bool) -> f64 {
        let base_m = f64::from(object.base_m);
        let above_base_m = if finest_level.is_some_and(|finest| self.terrain.level() >= finest) {
            (1.0 - own) * (self.parent_m - base_m)
        } else {
            self.parent_m + (self.own_m - self.parent_m) * own - base_m
        };
        if has_foundation { above_base_m } else { above_base_m.max(0.0) }
    }
}

fn place_cell(object: &Object) -> CellId {
    CellId::containing(object.lat_rad, object.lon_rad, LEVEL_MAX)
}

/// Level of the finest terrain page that the world has at an object; 0 where it has none, `None` where the index goes
/// on in a segment that is not resident.
fn finest_terrain_level(index: &IndexForest, object: &Object) -> Option<u8> {
    let Some(tree) = index.tree(place_cell(object).zone()) else { return Some(0) };
    let path = place_cell(object);
    let (mut node, mut finest) = (tree.root(), 0);
    for level in 1..=LEVEL_MAX {
        let next = path.ancestor(level).and_then(CellId::quadrant).and_then(|quadrant| node.child(quadrant));
        let Some(child) = next else { break };
        node = child;
        if node.terrain().is_some() {
            finest = level;
        }
    }
    let goes_on = node.absent_children().any(|segment| segment.root.contains(path));
    (!goes_on).then_some(finest)
}
