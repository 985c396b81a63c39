//! The tree of a collection's pages, and the coarser reps in it.
//!
//! A page's parent is the page of the nearest root above. Its own objects may have reps with simpler outlines. At a root
//! from [`GROUPS_LEVEL_MIN`] on, groups stand for all objects below: the finest that fit in a page, and coarser ones by
//! doubled error until the groups of the root above take over; at the top until next to nothing is left.

use super::groups::{Group, Part, Plane, group, plane, simpler};
use super::pack::{PAGE_BYTES_MAX, PagePlan};
use super::place::Ground;
use super::{ERROR_M, ObjectsPage, Placed, PrepareError, encode_page, largest_first};
use crate::content::{FIRST_GROUPS, ObjectPage, Prism};
use crate::forest::CellId;
use crate::store::{FOOTPRINT_UNIT_PER_ERROR, PrismPage};
use rayon::prelude::*;

/// Roots above this level are too wide for a plane, and what they hold is of no size from as far.
const GROUPS_LEVEL_MIN: u8 = 6;
/// Errors aimed at: this, and doubled again and again; metres.
const ERROR_FIRST_M: f64 = 0.5;
const ERRORS: u32 = 15;
/// As many of them are tried for simpler outlines.
const SIMPLER_POWERS: u32 = 4;
/// Groups that save less than half of the triangles are not worth a page.
const SAVED_MIN: f64 = 0.5;
/// Fewer triangles are not worth a coarser page.
const COARSER_TRIANGLES_MIN: usize = 200;

/// A page's root with what lies below.
struct Node<'a> {
    root: CellId,
    own: Vec<&'a Placed>,
    parent: Option<usize>,
    children: Vec<usize>,
    /// Largest bounding dimension of all objects of the subtree, metres.
    dimension_m: f64,
    /// The node after the last of the subtree.
    end: usize,
    depth: usize,
}

/// Groups of one node, the finest first.
type Ladder = Vec<Made>;

struct Made {
    page: ObjectsPage,
    triangles: usize,
    /// The error that was aimed at, as a power of two over the first.
    power: u32,
}

/// The objects of a node's subtree.
struct Parts<'a> {
    parts: Vec<Part<'a>>,
    plane: Plane,
}

/// What comes of an error aimed at.
enum Making {
    Made(Made),
    /// More than a page can hold, or than is worth one.
    TooMany,
    /// All that there is may vanish.
    Nothing,
}

/// Adds the groups to the pages of a collection, which are in the order of their plans; `cells` are what those name.
pub fn with_groups(
    pages: Vec<ObjectsPage>,
    plans: &[PagePlan],
    cells: &[&[Placed]],
    collection: u8,
    name: &str,
    ground: &Ground,
) -> Result<Vec<ObjectsPage>, PrepareError> {
    let nodes = nodes(&pages, plans, cells);
    let tree = Tree { nodes: &nodes, collection, name, ground };
    let simpler: Result<Vec<Ladder>, PrepareError> = nodes.par_iter().map(|node| tree.simpler(node)).collect();
    let simpler = simpler?;
    let finest = tree.finest(&simpler)?;
    let coarser: Result<Vec<Ladder>, PrepareError> =
        (0..nodes.len()).into_par_iter().map(|at| tree.coarser(at, &finest)).collect();
    let mut ladders: Vec<Ladder> = coarser?;
    for ((ladder, finest), simpler) in ladders.iter_mut().zip(finest).zip(simpler) {
        ladder.splice(0..0, simpler.into_iter().chain(finest));
    }
    let mut all = Vec::new();
    for (at, mut page) in pages.into_iter().enumerate() {
        page.below_dimension_m = Some(nodes[at].dimension_m);
        let ladder = std::mem::take(&mut ladders[at]);
        all.extend(ladder.into_iter().rev().map(|made| made.page));
        all.push(page);
    }
    Ok(all)
}

fn nodes<'a>(pages: &[ObjectsPage], plans: &[PagePlan], cells: &[&'a [Placed]]) -> Vec<Node<'a>> {
    let mut nodes: Vec<Node> = Vec::with_capacity(plans.len());
    let mut above: Vec<usize> = Vec::new();
    // The pages are those of the plans. Roots are in the order of a walk down the tree.
    for (at, (plan, page)) in plans.iter().zip(pages).enumerate() {
        while above.last().is_some_and(|&last| !nodes[last].root.contains(plan.root)) {
            above.pop();
        }
        let parent = above.last().copied();
        if let Some(parent) = parent {
            nodes[parent].children.push(at);
        }
        let own = plan.cells.iter().flat_map(|&cell| cells[cell]).collect();
        let depth = above.len();
        let dimension_m = page.dimension_m;
        nodes.push(Node { root: plan.root, own, parent, children: Vec::new(), dimension_m, end: at + 1, depth });
        for &ancestor in &above {
            let ancestor = &mut nodes[ancestor];
            (ancestor.end, ancestor.dimension_m) = (at + 1, ancestor.dimension_m.max(dimension_m));
        }
        above.push(at);
    }
    nodes
}

struct Tree<'t, 'a> {
    nodes: &'t [Node<'a>],
    collection: u8,
    name: &'t str,
    ground: &'t Ground<'t>,
}

impl<'t, 'a> Tree<'t, 'a> {
    fn subtree(&self, at: usize) -> impl Iterator<Item = &'t Node<'a>> {
        self.nodes[at..self.nodes[at].end].iter()
    }

    /// Reps of a node's own objects with simpler outlines, the finest first.
    fn simpler(&self, node: &Node<'_>) -> Result<Ladder, PrepareError> {
        let mut ladder = Ladder::new();
        let mut triangles = triangles(&node.own);
        let plane = Plane::along_walls(node.own.iter().map(|object| object.plain()));
        for power in 0..SIMPLER_POWERS {
            let rep = 1 + ladder.len() as u8;
            if rep == FIRST_GROUPS || triangles < COARSER_TRIANGLES_MIN {
                break;
            }
            let error_m = ERROR_FIRST_M * f64::from(1u32 << power);
            let prisms = simpler(&node.own, &plane, error_m);
            let left = triangles_of(&prisms);
            if left as f64 <= triangles as f64 * SAVED_MIN && left > 0 {
                triangles = left;
                ladder.push(self.encode(node, rep, Group { prisms, error_m }, power, left)?);
            }
        }
        Ok(ladder)
    }

    /// The finest groups of each node that fit in a page, children before parents, whose error is no less.
    fn finest(&self, simpler: &[Ladder]) -> Result<Vec<Option<Made>>, PrepareError> {
        let mut finest: Vec<Option<Made>> = Vec::new();
        finest.resize_with(self.nodes.len(), || None);
        let deepest = self.nodes.iter().map(|node| node.depth).max().unwrap_or(0);
        for depth in (0..=deepest).rev() {
            let of_depth = (0..self.nodes.len()).filter(|&at| self.nodes[at].depth == depth);
            let of_depth: Vec<usize> = of_depth.collect();
            let made: Result<Vec<_>, PrepareError> =
                of_depth.par_iter().map(|&at| self.finest_of(at, simpler[at].last(), &finest)).collect();
            for (at, made) in of_depth.into_iter().zip(made?) {
                finest[at] = made;
            }
        }
        Ok(finest)
    }

    fn finest_of(
        &self,
        at: usize,
        simplest: Option<&Made>,
        finest: &[Option<Made>],
    ) -> Result<Option<Made>, PrepareError> {
        let node = &self.nodes[at];
        let own = simplest.map_or_else(|| triangles(&node.own), |made| made.triangles);
        let below = node.children.iter().map(|&child| finest[child].as_ref().map_or(0, |made| made.triangles));
        let limit = ((own + below.sum::<usize>()) as f64 * SAVED_MIN) as usize;
        let first = node.children.iter().filter_map(|&child| finest[child].as_ref().map(|made| made.power)).max();
        let own_power = simplest.map_or(0, |made| made.power + 1);
        let parts = self.parts(at);
        for power in first.unwrap_or_else(|| first_power(&node.own)).max(own_power)..ERRORS {
            match self.make(at, &parts, FIRST_GROUPS, power, limit)? {
                Making::Made(made) if made.page.bytes.len() as u64 <= PAGE_BYTES_MAX => {
                    return Ok(Some(made));
                }
                Making::Made(_) | Making::TooMany => {}
                Making::Nothing => break,
            }
        }
        Ok(None)
    }

    /// Groups coarser than a node's finest, down to where those of the root above begin.
    fn coarser(&self, at: usize, finest: &[Option<Made>]) -> Result<Ladder, PrepareError> {
        let Some(first) = &finest[at] else { return Ok(Vec::new()) };
        let above = self.nodes[at].parent.and_then(|parent| finest[parent].as_ref()).map_or(ERRORS, |made| made.power);
        let mut ladder = Ladder::new();
        let (mut triangles, mut error_m) = (first.triangles, first.page.error_m);
        let parts = self.parts(at);
        for power in first.power + 1..above {
            let rep = usize::from(FIRST_GROUPS) + 1 + ladder.len();
            let Ok(rep) = u8::try_from(rep) else { break };
            if triangles < COARSER_TRIANGLES_MIN {
                break;
            }
            let limit = (triangles as f64 * SAVED_MIN) as usize;
            match self.make(at, &parts, rep, power, limit)? {
                Making::Made(made) if made.page.error_m > error_m => {
                    (triangles, error_m) = (made.triangles, made.page.error_m);
                    ladder.push(made);
                }
                Making::Made(_) | Making::TooMany => {}
                Making::Nothing => break,
            }
        }
        Ok(ladder)
    }

    /// What groups at a node stand for: its own objects and those of each tree below it.
    fn parts(&self, at: usize) -> Parts<'a> {
        let node = &self.nodes[at];
        let below = |child: usize| self.subtree(child).flat_map(|node| node.own.iter().copied()).collect();
        let children = node.children.iter().map(|&child| (self.nodes[child].root, below(child)));
        let parts: Vec<Part> = std::iter::once((node.root, node.own.clone())).chain(children).collect();
        Parts { plane: plane(&parts), parts }
    }

    /// Groups of at most `limit` triangles.
    fn make(&self, at: usize, of: &Parts<'a>, rep: u8, power: u32, limit: usize) -> Result<Making, PrepareError> {
        let node = &self.nodes[at];
        let error_m = ERROR_FIRST_M * f64::from(1u32 << power);
        if node.root.level() < GROUPS_LEVEL_MIN || error_m >= node.dimension_m {
            return Ok(Making::Nothing);
        }
        let Some(group) = group(&of.parts, &of.plane, error_m, self.ground, limit) else {
            return Ok(Making::TooMany);
        };
        if group.prisms.is_empty() {
            return Ok(Making::Nothing);
        }
        let triangles = triangles_of(&group.prisms);
        if group.prisms.len() > ObjectPage::OBJECTS_MAX || triangles > limit {
            return Ok(Making::TooMany);
        }
        Ok(Making::Made(self.encode(node, rep, group, power, triangles)?))
    }

    fn encode(
        &self,
        node: &Node<'_>,
        rep: u8,
        mut group: Group,
        power: u32,
        triangles: usize,
    ) -> Result<Made, PrepareError> {
        group.prisms.sort_by_cached_key(|prism| (prism.cell, largest_first(prism)));
        let of = PrismPage {
            root: node.root,
            collection: self.collection,
            rep,
            // Corners are stored to half of a unit.
            error_m: (group.error_m * (1.0 + FOOTPRINT_UNIT_PER_ERROR)) as f32 + ERROR_M,
            prisms: group.prisms,
            atlas: None,
        };
        Ok(Made { page: encode_page(of, &[], self.name)?, triangles, power })
    }
}

fn triangles(objects: &[&Placed]) -> usize {
    objects.iter().map(|object| object.prism.triangles()).sum()
}

fn triangles_of(prisms: &[Prism]) -> usize {
    prisms.iter().map(Prism::triangles).sum()
}

/// Below half of what most objects measure, groups have nothing to join.
fn first_power(objects: &[&Placed]) -> u32 {
    let mut dimensions_m: Vec<f64> = objects.iter().map(|object| object.dimension_m()).collect();
    let middle = dimensions_m.len() / 2;
    if dimensions_m.is_empty() {
        return 0;
    }
    let (_, median_m, _) = dimensions_m.select_nth_unstable_by(middle, f64::total_cmp);
    (*median_m / 2.0 / ERROR_FIRST_M).log2().floor().clamp(0.0, f64::from(ERRORS - 1)) as u32
}
