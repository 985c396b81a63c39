//! What the front of the widened view may want next: PAR and CHD of its reps, and what a pan brings into view
//! (Varadhan & Manocha 2002, §4.2; the terms in §3.1).

use super::super::Situation;
use super::super::wide::half_diagonal_rad;
use super::FrontParams;
use super::priority::Scale;
use crate::camera::{Frustum, View};
use crate::content::{PageId, PageKind};
use crate::forest::CellId;
use crate::forest::index::{Node, Place, SegmentRef};
use crate::geodesy::{HorizonCone, OrientedBox};
use crate::select::{Demand, FrontRegion, SelectParams, ground_page, survey};
use std::collections::{BTreeMap, HashMap, HashSet, VecDeque};

/// Candidates at most; the next ones from the front come first.
const CANDIDATES_MAX: usize = 4096;
/// Levels from the front at most.
const LEVELS_MAX: u32 = 8;

/// A page that may be needed next.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    pub page: PageId,
    pub place: Place,
    /// |δ − Priority| / δ of the rep whose replacement needs it.
    pub distance: f64,
}

/// A page of the front of the widened view.
#[derive(Clone, Copy)]
struct FrontPage {
    place: Place,
    /// Of objects: the projected dimension as a share of the threshold drawn.
    share: f64,
}

/// A node as the widened view sees it.
#[derive(Clone, Copy)]
struct Sighting<'a> {
    node: Node<'a>,
    px_per_m: f64,
    theta_rad: f64,
    is_in_view: bool,
}

/// The widened view.
struct Wide<'a> {
    view: View,
    frustum: Frustum,
    horizon: HorizonCone,
    seen: HashMap<CellId, Sighting<'a>>,
}

pub struct Candidates<'a, 'b> {
    situation: &'b Situation<'a>,
    levels: u32,
    scale: Scale,
    wide: Wide<'a>,
    /// Pages that the present front asks for itself.
    present: HashSet<PageId>,
    found: Vec<Candidate>,
    at: HashMap<PageId, usize>,
    /// Reps to classify, with how many levels they are from the front.
    to_classify: VecDeque<(PageId, u32)>,
}

impl<'a> Candidates<'a, '_> {
    /// All candidates, each page once, those of pans and next to the front first.
    pub fn gather(params: &FrontParams, situation: &Situation<'a>, wide: &View, present: &[Demand]) -> Vec<Candidate> {
        let frame = &situation.frame;
        let scale = Scale {
            tolerance_px: frame.drawn_tolerance_px.max(frame.params.tolerance_px),
            theta0_rad: half_diagonal_rad(frame.view),
            theta1_rad: params.theta1_rad,
        };
        let mut candidates = Candidates {
            situation,
            levels: params.levels.min(LEVELS_MAX),
            scale,
            wide: Wide::new(situation, wide),
            present: present.iter().map(|demand| demand.page).collect(),
            found: Vec::new(),
            at: HashMap::new(),
            to_classify: VecDeque::new(),
        };
        for (page, front) in wide_front(params, situation, wide) {
            candidates.add_front(page, &front);
        }
        candidates.classify_all();
        candidates.found
    }

    fn add_front(&mut self, page: PageId, front: &FrontPage) {
        if page.kind == PageKind::Segment {
            self.add(page, front.place, 0.0);
            return;
        }
        let Some(sighting) = self.wide.sighting(self.situation, page.cell) else { return };
        let is_object = matches!(page.kind, PageKind::Objects { .. });
        // The ground of the wider front is due as soon as it is in view; so are objects that pass the threshold.
        let error_px = if is_object { front.share.min(1.0) } else { 1.0 } * self.scale.tolerance_px;
        self.add(page, front.place, self.scale.distance(error_px, sighting.theta_rad));
        if !is_object && self.levels > 0 {
            self.to_classify.push_back((page, 0));
        }
    }

    fn add(&mut self, page: PageId, place: Place, distance: f64) -> bool {
        if self.present.contains(&page) {
            return false;
        }
        if let Some(&at) = self.at.get(&page) {
            self.found[at].distance = self.found[at].distance.min(distance);
            return false;
        }
        if self.found.len() >= CANDIDATES_MAX {
            return false;
        }
        self.at.insert(page, self.found.len());
        self.found.push(Candidate { page, place, distance });
        true
    }

    fn classify_all(&mut self) {
        while let Some((page, levels)) = self.to_classify.pop_front() {
            let Some(sighting) = self.wide.sighting(self.situation, page.cell) else { continue };
            let Some((_, error_m)) = ground_page(&sighting.node, page.kind) else { continue };
            let error_px = error_m * sighting.px_per_m;
            if error_px <= self.scale.tolerance_px {
                self.add_children(page, &sighting, self.scale.distance(error_px, sighting.theta_rad), levels + 1);
            }
            self.add_parent(page, levels + 1);
        }
    }

    /// CHD: needed when the rep's error passes the tolerance.
    fn add_children(&mut self, page: PageId, of: &Sighting<'a>, distance: f64, levels: u32) {
        for segment in of.node.absent_children() {
            self.add_segment(segment);
        }
        for node in of.node.children() {
            node.paged_segment().into_iter().for_each(|segment| self.add_segment(segment));
            let Some((place, _)) = ground_page(&node, page.kind) else { continue };
            if self.wide.sight(node).is_in_view {
                self.add_next(PageId { cell: node.cell(), ..page }, place, distance, levels);
            }
        }
    }

    /// What children are in.
    fn add_segment(&mut self, segment: SegmentRef) {
        self.add(PageId { cell: segment.root, kind: PageKind::Segment }, segment.place, 0.0);
    }

    /// PAR: needed when the parent's own error falls to the tolerance.
    fn add_parent(&mut self, page: PageId, levels: u32) {
        let sighting = page.cell.parent().and_then(|cell| self.wide.sighting(self.situation, cell));
        let Some((sighting, (place, error_m))) =
            sighting.and_then(|sighting| Some((sighting, ground_page(&sighting.node, page.kind)?)))
        else {
            return;
        };
        let error_px = error_m * sighting.px_per_m;
        if error_px > self.scale.tolerance_px {
            let distance = self.scale.distance(error_px, sighting.theta_rad);
            self.add_next(PageId { cell: sighting.node.cell(), ..page }, place, distance, levels);
        }
    }

    /// What has been prefetched already is classified in its turn.
    fn add_next(&mut self, page: PageId, place: Place, distance: f64, levels: u32) {
        let is_new = self.add(page, place, distance);
        if is_new && levels < self.levels && self.situation.frame.manager.is_resident(page) {
            self.to_classify.push_back((page, levels));
        }
    }
}

/// The pages that the widened view wants, objects some way below the threshold included; by page.
fn wide_front(params: &FrontParams, situation: &Situation<'_>, wide: &View) -> BTreeMap<PageId, FrontPage> {
    let frame = &situation.frame;
    let raised = (frame.drawn_tolerance_px / frame.params.tolerance_px).max(1.0);
    let threshold_px = frame.params.threshold_px * raised;
    let objects_from = params.objects_from.clamp(0.0, 1.0);
    let lowered = SelectParams { threshold_px: frame.params.threshold_px * objects_from, ..*frame.params };
    let mut pages = BTreeMap::new();
    survey(frame.index, frame.cells, wide, &lowered, frame.drawn_tolerance_px, |region: &FrontRegion<'_>| {
        if let Some(rep) = region.chain.get(region.front) {
            let share = region.absent_px / threshold_px.max(1e-9);
            pages.insert(rep.page(), FrontPage { place: rep.place, share });
        }
    });
    pages
}

impl<'a> Wide<'a> {
    fn new(situation: &Situation<'a>, view: &View) -> Self {
        let lowest_m = situation.frame.index.trees().map(|tree| tree.root().height_range_m().0).fold(0.0, f64::min);
        let horizon = HorizonCone::new(view.eye(), -lowest_m);
        Self { view: *view, frustum: view.frustum(), horizon, seen: HashMap::new() }
    }

    fn sighting(&mut self, situation: &Situation<'a>, cell: CellId) -> Option<Sighting<'a>> {
        match self.seen.get(&cell) {
            Some(sighting) => Some(*sighting),
            None => situation.frame.index.find(cell).map(|node| self.sight(node)),
        }
    }

    fn sight(&mut self, node: Node<'a>) -> Sighting<'a> {
        if let Some(sighting) = self.seen.get(&node.cell()) {
            return *sighting;
        }
        let (low_m, high_m) = node.height_range_m();
        let around = OrientedBox::around(&node.cell().bounds(), low_m, high_m);
        let sighting = Sighting {
            node,
            px_per_m: self.view.projected_px(1.0, around.distance_m(self.view.eye())),
            theta_rad: self.view.forward().angle_between((around.center - self.view.eye()).xyz()),
            is_in_view: self.frustum.meets(&around) && !self.horizon.hides_box(&around),
        };
        self.seen.insert(node.cell(), sighting);
        sighting
    }
}
