//! Worlds over one another: one index and one description, and each page from the world that it is of.
//!
//! The packs of a zone are taken as one row of bytes, a world's behind those of the worlds named before it; so a place
//! tells its world, and its length in the index stays as it is. Imagery must follow its terrain in the index; where the
//! two are of different worlds, they get a place of their own beyond all packs (a [`Splice`]).

use super::error::{PageFault, StoreError};
use super::ground::GroundPages;
use super::manifest::Manifest;
use super::merge;
use super::objects::drawn_up;
use super::pack::{PageRange, PageSource};
use super::world::World;
use super::{PrismPage, seat};
use crate::content::{Page, PageId, PageKind};
use crate::forest::Zone;
use crate::forest::index::{IndexForest, Place, SharedBytes};
use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::Arc;

/// Worlds that may lie over one another.
pub const STACK_WORLDS_MAX: usize = 16;
/// Bytes that no world has between the packs of two: more than any range that is read as one.
const GAP_BYTES: u64 = 4 << 20;
/// Where places of pages of several worlds begin; the packs of a zone end before.
pub(super) const SPLICES_AT: u64 = 1 << 39;
/// Decoded terrain that is kept for setting objects on the ground, by world, bytes.
const GROUND_BYTES_MAX: u64 = 1 << 20;

/// What [`World::stack`] is made of.
pub(super) struct Stacked {
    pub manifest: Manifest,
    pub index: IndexForest,
    pub stack: Stack,
}

/// Whose pages are whose.
pub(super) struct Stack {
    pub worlds: Vec<Arc<World>>,
    /// The first number of each world's collections in the whole.
    pub first_collections: Vec<u8>,
    /// By zone.
    pub rows: Vec<Row>,
    pub index: IndexForest,
    pub grounds: Vec<GroundPages>,
}

/// The packs of a zone, end to end.
#[derive(Clone, Debug, Default)]
pub(super) struct Row {
    /// Where each world's begins.
    pub starts: Vec<u64>,
    pub splices: Vec<Splice>,
    by_page: HashMap<(usize, Place), usize>,
}

/// A page whose place in the whole is not that in its world's pack.
#[derive(Clone, Copy, Debug)]
pub(super) struct Splice {
    pub start: u64,
    pub world: usize,
    /// In its world.
    pub place: Place,
}

/// `before`: the stack that the last of the worlds is put over; its places stay what they are.
pub(super) fn stack(worlds: &[Arc<World>], before: Option<&Stack>) -> Result<Stacked, StoreError> {
    check(worlds)?;
    let first_collections = first_collections(worlds)?;
    let mut rows = Zone::all().map(|zone| row(worlds, zone)).collect::<Result<Vec<_>, _>>()?;
    for (row, old) in rows.iter_mut().zip(before.into_iter().flat_map(|stack| &stack.rows)) {
        row.splices.clone_from(&old.splices);
    }
    let index = merge::index(worlds, &first_collections, &mut rows)?;
    let manifest = merge::manifest(worlds, &index);
    let grounds = worlds.iter().map(|_| GroundPages::new(GROUND_BYTES_MAX)).collect();
    let stack = Stack { worlds: worlds.to_vec(), first_collections, rows, index: index.clone(), grounds };
    Ok(Stacked { manifest, index, stack })
}

pub(super) fn refused(world: &World, cause: impl Into<String>) -> StoreError {
    StoreError::Stack { world: world.name().to_owned(), cause: cause.into() }
}

fn check(worlds: &[Arc<World>]) -> Result<(), StoreError> {
    if let Some(world) = worlds.get(STACK_WORLDS_MAX) {
        return Err(refused(world, format!("it is one more than the {STACK_WORLDS_MAX} that there may be")));
    }
    match worlds.iter().find(|world| !world.index().is_whole()) {
        Some(world) => Err(refused(world, "its index is too large to be held in memory whole")),
        None => Ok(()),
    }
}

fn first_collections(worlds: &[Arc<World>]) -> Result<Vec<u8>, StoreError> {
    let mut next = 0usize;
    let first = |world: &Arc<World>| {
        let first = next;
        next += world.manifest().collections.len();
        let fits = u8::try_from(first).ok().filter(|_| next <= usize::from(u8::MAX));
        fits.ok_or_else(|| refused(world, format!("there would be {next} collections, more than {}", u8::MAX)))
    };
    worlds.iter().map(first).collect()
}

/// Where the packs of a zone begin; a world without the zone takes no room.
fn row(worlds: &[Arc<World>], zone: Zone) -> Result<Row, StoreError> {
    let mut row = Row::default();
    let mut end = 0u64;
    for world in worlds {
        row.starts.push(end);
        if world.index().tree(zone).is_some() {
            let len = world.source().pack_len(zone)?;
            end = end.saturating_add(len).saturating_add(GAP_BYTES);
        }
        if end > SPLICES_AT {
            return Err(refused(world, format!("the packs of zone {} are too long together", zone.index())));
        }
    }
    Ok(row)
}

impl Row {
    /// Places for terrain and imagery of two worlds, the one right behind the other; those they have already.
    pub fn splice(&mut self, pages: [(usize, Place); 2]) -> [Place; 2] {
        let are = |pair: &[Splice]| pair[0].is(pages[0]) && pair[1].is(pages[1]);
        let known = self.known_splice(pages[0]).filter(|&at| self.splices.get(at..at + 2).is_some_and(are));
        let at = known.unwrap_or_else(|| {
            for (world, place) in pages {
                let end = self.splices.last().map_or(SPLICES_AT, |last| last.start + u64::from(last.place.len));
                self.splices.push(Splice { start: end, world, place });
                self.by_page.insert((world, place), self.splices.len() - 1);
            }
            self.splices.len() - 2
        });
        [at, at + 1].map(|at| Place { offset: self.splices[at].start, len: self.splices[at].place.len })
    }

    fn known_splice(&mut self, page: (usize, Place)) -> Option<usize> {
        if self.by_page.len() < self.splices.len() {
            self.by_page =
                self.splices.iter().zip(0..).map(|(splice, at)| ((splice.world, splice.place), at)).collect();
        }
        self.by_page.get(&page).copied()
    }

    /// The world of a place, and where it lies there.
    pub fn locate(&self, place: Place) -> Option<(usize, Place)> {
        if place.offset >= SPLICES_AT {
            let at = self.splices.partition_point(|splice| splice.start <= place.offset).checked_sub(1)?;
            let splice = &self.splices[at];
            let is_it = splice.start == place.offset && splice.place.len == place.len;
            return is_it.then_some((splice.world, splice.place));
        }
        let world = self.starts.partition_point(|&start| start <= place.offset).checked_sub(1)?;
        Some((world, Place { offset: place.offset - self.starts[world], len: place.len }))
    }
}

impl Splice {
    fn is(&self, (world, place): (usize, Place)) -> bool {
        self.world == world && self.place == place
    }
}

impl Stack {
    fn locate(&self, zone: Zone, place: Place) -> Result<(&World, usize, Place), StoreError> {
        let found = self.rows.get(zone.index()).and_then(|row| row.locate(place));
        let world = found.and_then(|(at, place)| Some((&**self.worlds.get(at)?, at, place)));
        world.ok_or_else(|| StoreError::Pack {
            file: format!("zone {:02}", zone.index()).into(),
            cause: format!("byte {} belongs to none of the worlds", place.offset),
        })
    }

    /// The name of a page in its own world.
    fn own_id(&self, world: usize, id: PageId) -> PageId {
        match id.kind {
            PageKind::Objects { collection, rep } => {
                let collection = collection.wrapping_sub(self.first_collections[world]);
                PageId { kind: PageKind::Objects { collection, rep }, ..id }
            }
            _ => id,
        }
    }

    pub fn decode(&self, id: PageId, place: Place, bytes: &[u8]) -> Result<Page, StoreError> {
        if !matches!(id.kind, PageKind::Objects { .. }) {
            let (world, at, own) = self.locate(id.cell.zone(), place)?;
            return world.decode(self.own_id(at, id), own, bytes);
        }
        let (world, _, own) = self.locate(id.cell.zone(), place)?;
        let drawn = drawn_up(self.prisms(id, place, bytes)?);
        let (page, mesh) = drawn.map_err(|fault| world.page_error(id, own, fault))?;
        Ok(Page::Objects(Arc::new(page), Arc::new(mesh)))
    }

    /// A page's prisms, numbered and set on the ground as in the whole.
    pub fn prisms(&self, id: PageId, place: Place, bytes: &[u8]) -> Result<PrismPage, StoreError> {
        let (world, at, own) = self.locate(id.cell.zone(), place)?;
        let mut page = world.prisms(self.own_id(at, id), own, bytes)?;
        if page.id() != self.own_id(at, id) {
            return Err(world.page_error(id, own, PageFault::WrongPage));
        }
        if let PageKind::Objects { collection, .. } = id.kind {
            page.collection = collection;
        }
        seat::reseat(self, at, &mut page.prisms)?;
        Ok(page)
    }

    pub fn attributes(&self, id: PageId, place: Place, bytes: &[u8]) -> Result<Vec<String>, StoreError> {
        let (world, at, own) = self.locate(id.cell.zone(), place)?;
        world.attributes(self.own_id(at, id), own, bytes)
    }
}

/// Reads pages of all worlds. Its index is in memory whole, and in none of their files.
pub(super) struct StackSource(pub Arc<Stack>);

impl StackSource {
    fn no_index(&self, zone: Zone) -> StoreError {
        let cause = "worlds over one another have no index file".to_owned();
        StoreError::Index { file: self.index_name(zone), cause }
    }

    /// The world of a range of plain places, and the range and its pages there.
    fn own(&self, range: &PageRange<'_>) -> Result<(usize, Place, Vec<Place>), StoreError> {
        let (_, at, place) = self.0.locate(range.zone, range.place)?;
        let start = self.0.rows[range.zone.index()].starts[at];
        let own = |page: &Place| Place { offset: page.offset.saturating_sub(start), len: page.len };
        Ok((at, place, range.pages.iter().map(own).collect()))
    }

    fn read_spliced(&self, range: &PageRange<'_>) -> Result<Vec<u8>, StoreError> {
        let mut bytes = vec![0; range.place.len as usize];
        for &page in range.pages {
            let own = self.read(range.zone, page)?;
            if let Some(part) = range.part(page) {
                bytes[part].copy_from_slice(&own);
            }
        }
        Ok(bytes)
    }

    fn first(&self) -> Option<&World> {
        self.0.worlds.first().map(|world| &**world)
    }
}

impl PageSource for StackSource {
    fn read(&self, zone: Zone, place: Place) -> Result<Vec<u8>, StoreError> {
        let (world, _, own) = self.0.locate(zone, place)?;
        world.source().read(zone, own)
    }

    /// One read, as worlds lie further apart than any range is long; of pages with places of their own one for each.
    fn read_range(&self, range: &PageRange<'_>) -> Result<Vec<u8>, StoreError> {
        if range.place.offset >= SPLICES_AT {
            return self.read_spliced(range);
        }
        let (at, place, pages) = self.own(range)?;
        self.0.worlds[at].source().read_range(&PageRange { place, pages: &pages, ..*range })
    }

    /// Those of each world together.
    fn read_ranges(&self, ranges: &[PageRange<'_>]) -> Vec<Result<Vec<u8>, StoreError>> {
        let mut read: Vec<Option<Result<Vec<u8>, StoreError>>> = ranges.iter().map(|_| None).collect();
        let owned: Vec<_> = ranges.iter().map(|range| self.own(range).ok()).collect();
        for (number, world) in self.0.worlds.iter().enumerate() {
            let (mut slots, mut its) = (Vec::new(), Vec::new());
            for (slot, (range, own)) in ranges.iter().zip(&owned).enumerate() {
                let is_plain = range.place.offset < SPLICES_AT;
                if let Some((_, place, pages)) = own.as_ref().filter(|own| own.0 == number && is_plain) {
                    slots.push(slot);
                    its.push(PageRange { place: *place, pages, ..*range });
                }
            }
            for (slot, bytes) in slots.into_iter().zip(world.source().read_ranges(&its)) {
                read[slot] = Some(bytes);
            }
        }
        ranges.iter().zip(read).map(|(range, read)| read.unwrap_or_else(|| self.read_range(range))).collect()
    }

    fn is_remote(&self) -> bool {
        self.0.worlds.iter().any(|world| world.is_remote())
    }

    fn pack_len(&self, zone: Zone) -> Result<u64, StoreError> {
        self.0
            .worlds
            .iter()
            .filter(|world| world.index().tree(zone).is_some())
            .map(|world| world.source().pack_len(zone))
            .sum()
    }

    fn pack_name(&self, zone: Zone) -> PathBuf {
        self.first().map_or_else(PathBuf::new, |world| world.source().pack_name(zone))
    }

    fn file_of(&self, zone: Zone, place: Place) -> (PathBuf, u64) {
        match self.0.locate(zone, place) {
            Ok((world, _, own)) => world.source().file_of(zone, own),
            Err(_) => (self.pack_name(zone), place.offset),
        }
    }

    fn read_index(&self, zone: Zone, _: Place) -> Result<Vec<u8>, StoreError> {
        Err(self.no_index(zone))
    }

    fn whole_index(&self, zone: Zone) -> Result<SharedBytes, StoreError> {
        Err(self.no_index(zone))
    }

    fn index_len(&self, zone: Zone) -> Result<u64, StoreError> {
        Err(self.no_index(zone))
    }

    fn index_name(&self, zone: Zone) -> PathBuf {
        self.first().map_or_else(PathBuf::new, |world| world.source().index_name(zone))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_tells_its_world() {
        let splice = Splice { start: SPLICES_AT + 10, world: 0, place: Place { offset: 77, len: 5 } };
        let row = Row { starts: vec![0, 1000, 1000], splices: vec![splice], ..Row::default() };
        let locate = |offset, len| row.locate(Place { offset, len });
        assert_eq!(locate(999, 1), Some((0, Place { offset: 999, len: 1 })));
        // A world without the zone takes no room.
        assert_eq!(locate(1000, 1), Some((2, Place { offset: 0, len: 1 })));
        assert_eq!(locate(SPLICES_AT + 10, 5), Some((0, Place { offset: 77, len: 5 })));
        assert_eq!((locate(SPLICES_AT + 10, 6), locate(SPLICES_AT + 11, 5), locate(SPLICES_AT, 1)), (None, None, None));
    }

    #[test]
    fn places_of_two_worlds_follow_one_another_and_stay() {
        let mut row = Row::default();
        let page = |world, offset, len| (world, Place { offset, len });
        let first = row.splice([page(0, 100, 7), page(1, 900, 9)]);
        let second = row.splice([page(0, 300, 5), page(1, 100, 3)]);
        assert_eq!(first.map(|place| place.offset - SPLICES_AT), [0, 7]);
        assert_eq!(second.map(|place| place.offset - SPLICES_AT), [16, 21]);
        // Of another row with the same splices too.
        let mut later = Row { splices: row.splices.clone(), ..Row::default() };
        assert_eq!(later.splice([page(0, 300, 5), page(1, 100, 3)]), second);
        assert_eq!(later.splice([page(0, 100, 7), page(1, 900, 9)]), first);
        // The terrain has another picture now.
        assert_eq!(later.splice([page(0, 100, 7), page(2, 0, 4)]).map(|place| place.offset - SPLICES_AT), [24, 31]);
        assert_eq!(later.splices[..4].len(), row.splices.len());
    }
}
