//! One rep of objects gives way to another over a fraction of a second: both are drawn, each in the pixels that the other
//! leaves out, so that no pixel is drawn twice and none is missing.
//!
//! A page, or a part of a page of groups, that a new list draws where another that overlaps it went, fades in as that
//! fades out. What comes into view without replacing anything is there at once.

use crate::content::{FIRST_GROUPS, ObjectPage, PageId, PageKind};
use crate::forest::CellId;
use crate::render::Fading;
use crate::select::DrawObjects;
use std::collections::BTreeMap;
use std::ops::Range;

/// How long a fade takes, seconds.
const FADE_S: f64 = 0.25;
/// Fades at a time; more are shown at once.
const FADES_MAX: usize = 512;

/// What fades as one: a page, or the part of a page of groups that stands for a subtree.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Unit {
    page: PageId,
    part: CellId,
}

impl Unit {
    fn collection(&self) -> Option<u8> {
        match self.page.kind {
            PageKind::Objects { collection, .. } => Some(collection),
            _ => None,
        }
    }

    /// Whether it stands for some of what another page stands for.
    fn replaces(&self, other: &Self) -> bool {
        self.page != other.page
            && self.collection() == other.collection()
            && (self.part.contains(other.part) || other.part.contains(self.part))
    }
}

struct Fade {
    /// As it was when the fade began.
    draw: DrawObjects,
    begun_s: f64,
    comes: bool,
}

/// The fades under way.
#[derive(Default)]
pub struct Fades {
    fades: BTreeMap<Unit, Fade>,
}

impl Fades {
    /// Takes the change from one list to the next.
    pub fn change(&mut self, old: &[DrawObjects], new: &[DrawObjects], now_s: f64) {
        self.end(now_s);
        let (old, new) = (units(old), units(new));
        // What is drawn again is no longer on its way out.
        self.fades.retain(|unit, fade| fade.comes == new.contains_key(unit));
        let gone: Vec<_> = old.iter().filter(|(unit, _)| !new.contains_key(unit)).collect();
        let come: Vec<_> = new.iter().filter(|(unit, _)| !old.contains_key(unit)).collect();
        for (units, others, comes) in [(&gone, &come, false), (&come, &gone, true)] {
            for &(unit, draw) in units.iter().filter(|(unit, _)| others.iter().any(|(other, _)| unit.replaces(other))) {
                if self.fades.len() < FADES_MAX {
                    self.fades.insert(*unit, Fade { draw: draw.clone(), begun_s: now_s, comes });
                }
            }
        }
    }

    /// A page went from the GPU: what it fades out for is there at once.
    pub fn forget(&mut self, page: PageId) {
        let leaving = |(unit, fade): (&Unit, &Fade)| (unit.page == page && !fade.comes).then_some(*unit);
        let gone: Vec<Unit> = self.fades.iter().filter_map(leaving).collect();
        self.fades
            .retain(|unit, fade| unit.page != page && !(fade.comes && gone.iter().any(|gone| unit.replaces(gone))));
    }

    pub fn is_empty(&self) -> bool {
        self.fades.is_empty()
    }

    /// What fades now, and what of a list is drawn whole; nothing where nothing fades.
    pub fn now(&mut self, list: &[DrawObjects], now_s: f64) -> Option<(Vec<DrawObjects>, Vec<Fading>)> {
        self.end(now_s);
        if self.fades.is_empty() {
            return None;
        }
        let mut units = units(list);
        let fading = self.fades.iter().map(|(unit, fade)| {
            let share = ((now_s - fade.begun_s) / FADE_S).clamp(0.0, 1.0) as f32;
            // What comes is as the list has it by now.
            let draw = units.remove(unit).unwrap_or_else(|| fade.draw.clone());
            Fading { draw, share, comes: fade.comes }
        });
        let fading = fading.collect();
        Some((units.into_values().collect(), fading))
    }

    fn end(&mut self, now_s: f64) {
        self.fades.retain(|_, fade| (fade.begun_s..fade.begun_s + FADE_S).contains(&now_s));
    }
}

/// What a list draws, by unit.
fn units(list: &[DrawObjects]) -> BTreeMap<Unit, DrawObjects> {
    let mut units: BTreeMap<Unit, DrawObjects> = BTreeMap::new();
    for draw in list {
        for range in &draw.objects {
            for (part, objects) in parts(&draw.page, range) {
                let unit = Unit { page: draw.page.id(), part };
                let drawn =
                    units.entry(unit).or_insert_with(|| DrawObjects { page: draw.page.clone(), objects: vec![] });
                drawn.objects.push(objects);
            }
        }
    }
    units
}

/// A run of objects, cut where another part of the page begins.
fn parts<'p>(page: &'p ObjectPage, range: &'p Range<u32>) -> impl Iterator<Item = (CellId, Range<u32>)> + 'p {
    let groups = page.rep >= FIRST_GROUPS;
    let whole = (!groups).then(|| (page.root, range.clone()));
    let cells = page.cells.iter().filter(move |_| groups).filter_map(|cell| {
        let objects = cell.objects.start.max(range.start)..cell.objects.end.min(range.end);
        (!objects.is_empty()).then_some((cell.cell, objects))
    });
    whole.into_iter().chain(cells)
}

#[cfg(test)]
#[allow(clippy::single_range_in_vec_init, reason = "ranges are meant as ranges")]
mod tests {
    use super::*;
    use crate::content::{CellObjects, Object};
    use crate::geodesy::Geodetic;
    use std::sync::Arc;

    fn page(root: CellId, rep: u8, parts: &[CellId]) -> DrawObjects {
        page_of(3, root, rep, parts)
    }

    fn page_of(collection: u8, root: CellId, rep: u8, parts: &[CellId]) -> DrawObjects {
        let place = root.bounds().center();
        let object = |at: u32, cell: CellId| Object {
            id: at,
            cell,
            place: place.to_ecef(),
            lat_rad: place.lat_rad,
            lon_rad: place.lon_rad,
            base_m: 0.0,
            top_m: 10.0,
            dimension_m: 10.0,
            reach_m: 10.0,
            wall_color: [0; 3],
            roof_color: [0; 3],
            indices: at * 3..at * 3 + 3,
        };
        let cells = (0..).zip(parts).map(|(at, &cell)| CellObjects {
            cell,
            objects: at..at + 1,
            height_range_m: (0.0, 10.0),
            dimension_m: 10.0,
        });
        let page = ObjectPage {
            root,
            collection,
            rep,
            error_m: 0.0,
            origin: place.to_ecef(),
            objects: (0..).zip(parts).map(|(at, &cell)| object(at, cell)).collect(),
            cells: cells.collect(),
            footprints: Default::default(),
            looks: Vec::new(),
        };
        DrawObjects { page: Arc::new(page), objects: vec![0..parts.len() as u32] }
    }

    fn cells() -> (CellId, Vec<CellId>) {
        let place = Geodetic::from_degrees(40.0, 10.0, 0.0);
        let root = CellId::containing(place.lat_rad, place.lon_rad, 10);
        (root, root.children().collect())
    }

    #[test]
    fn a_part_of_groups_gives_way_to_the_page_below_it_and_the_rest_stays() {
        let (root, children) = cells();
        let groups = page(root, FIRST_GROUPS, &children);
        let child = page(children[0], 0, &[children[0]]);
        let rest = DrawObjects { objects: vec![1..4], ..groups.clone() };
        let mut fades = Fades::default();
        fades.change(std::slice::from_ref(&groups), &[rest.clone(), child.clone()], 5.0);
        let (steady, fading) = fades.now(&[rest.clone(), child.clone()], 5.1).unwrap();
        let drawn: Vec<_> = steady.iter().flat_map(|draw| draw.objects.clone()).collect();
        assert_eq!(drawn, [1..2, 2..3, 3..4]);
        assert_eq!(fading.len(), 2);
        assert!(fading.iter().all(|fading| (fading.share - 0.4).abs() < 1e-6));
        let coming = fading.iter().find(|fading| fading.comes).unwrap();
        let going = fading.iter().find(|fading| !fading.comes).unwrap();
        assert_eq!((coming.draw.page.id(), going.draw.page.id()), (child.page.id(), groups.page.id()));
        assert_eq!(going.draw.objects, [0..1]);
        assert!(fades.now(&[rest, child], 5.3).is_none() && fades.is_empty());
    }

    #[test]
    fn what_replaces_nothing_is_there_at_once_and_what_goes_for_nothing_is_gone() {
        let (_, children) = cells();
        let [a, b] = [0, 1].map(|at| page(children[at], 0, &[children[at]]));
        let mut fades = Fades::default();
        fades.change(&[], std::slice::from_ref(&a), 0.0);
        fades.change(&[a], &[b], 0.1);
        assert!(fades.is_empty());
    }

    #[test]
    fn sets_do_not_fade_into_one_another_and_what_comes_is_as_the_newest_list_has_it() {
        let (root, children) = cells();
        let groups = page(root, FIRST_GROUPS, &children);
        let (own, trees) = (page(root, 0, &children), page_of(4, root, 0, &children));
        let mut fades = Fades::default();
        fades.change(std::slice::from_ref(&groups), std::slice::from_ref(&trees), 0.0);
        assert!(fades.is_empty());
        let some = DrawObjects { objects: vec![0..2], ..own.clone() };
        fades.change(&[groups], &[some], 1.0);
        let (_, fading) = fades.now(&[own], 1.1).unwrap();
        assert_eq!(fading.iter().find(|fading| fading.comes).unwrap().draw.objects, [0..4]);
    }

    #[test]
    fn a_page_that_leaves_the_gpu_ends_its_fade() {
        let (root, children) = cells();
        let (groups, own) = (page(root, FIRST_GROUPS, &children[..1]), page(children[0], 0, &children[..1]));
        let mut fades = Fades::default();
        fades.change(std::slice::from_ref(&groups), std::slice::from_ref(&own), 1.0);
        assert!(!fades.is_empty());
        fades.forget(groups.page.id());
        assert!(fades.is_empty());
    }
}
