//! What an index tree knows of a cell, and the 32 bytes it takes.

use super::CellId;
use super::index::IndexError;
use bytemuck::{Pod, Zeroable};
use std::ops::Range;

const OFFSET_BITS: u32 = 40;

/// Where a page lies in its zone's pack. Offsets are below 2⁴⁰, lengths below 2²⁴ bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Place {
    pub offset: u64,
    pub len: u32,
}

impl Place {
    /// `None` when offset or length do not fit.
    pub fn new(offset: u64, len: u32) -> Option<Self> {
        (offset < 1 << OFFSET_BITS && len < 1 << 24).then_some(Self { offset, len })
    }

    fn pack(self) -> u64 {
        self.offset | u64::from(self.len) << OFFSET_BITS
    }

    fn unpack(bits: u64) -> Self {
        Self { offset: bits & ((1 << OFFSET_BITS) - 1), len: (bits >> OFFSET_BITS) as u32 }
    }
}

/// One node as it lies in a file, little-endian.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct NodeRecord {
    /// Place of the terrain page; imagery follows it directly. Length 0: no terrain page.
    terrain: u64,
    /// Low 24 bits: length of the imagery page (0: none). Bits 24–27: children that exist.
    imagery_len_children: u32,
    /// Index in this segment of the first child; in the last level of a segment, index of the first child's segment.
    first_child: u32,
    terrain_error_m: f32,
    height_min_m: i16,
    height_max_m: i16,
    /// Largest bounding dimension and reach of objects in the subtree, in units of 1/8 m rounded up, saturating.
    dimension: u16,
    reach: u16,
    /// High 24 bits: index of the first objects entry; low 8: their number.
    objects: u32,
}

/// Objects of one collection and rep whose page is rooted at a node, or what lies below the node of a collection.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct ObjectsRecord {
    /// Of the page; in a record of what lies below, 1 where no other collection does, else 0.
    place: [u32; 2],
    collection: u8,
    /// [`REP_BELOW`] in a record of what lies below.
    rep: u8,
    /// Largest bounding dimension; of reps above 0 `error_m`. Units of 1/8 m rounded up, saturating.
    size: u16,
}

/// Stands in the place of a rep where a record tells what lies below.
const REP_BELOW: u8 = u8::MAX;

const _: () = assert!(size_of::<NodeRecord>() == 32 && size_of::<ObjectsRecord>() == 12);

/// Sizes are stored in eighths of a metre, rounded up so that a bound stays a bound; u16::MAX stands for "larger".
fn pack_size(metres: f64) -> u16 {
    (metres.max(0.0) * 8.0).ceil().min(f64::from(u16::MAX)) as u16
}

fn unpack_size(eighths: u16) -> f64 {
    if eighths == u16::MAX { f64::INFINITY } else { f64::from(eighths) / 8.0 }
}

/// Everything the index knows of a cell; what [`IndexTree::build`] takes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NodeInfo {
    pub terrain: Option<TerrainEntry>,
    pub imagery: Option<Place>,
    /// Lowest and highest drawn height in the subtree, objects included; metres above the ellipsoid.
    pub height_range_m: (f64, f64),
    /// Largest bounding dimension of the objects in the subtree, metres.
    pub dimension_m: f64,
    /// Largest reach of the objects in the subtree, metres.
    pub reach_m: f64,
    pub objects: Vec<ObjectsEntry>,
    pub below: Vec<ObjectsBelow>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TerrainEntry {
    pub place: Place,
    pub error_m: f32,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ObjectsEntry {
    pub collection: u8,
    /// 0 is the finest.
    pub rep: u8,
    pub place: Place,
    /// Rep 0: largest bounding dimension in the page, metres. Else 0.
    pub dimension_m: f64,
    /// How far the rep may be off the finest one, metres; 0 for rep 0.
    pub error_m: f64,
}

/// What lies in a node's subtree of a collection that has groups: the coarsest rep of all, which draws nothing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ObjectsBelow {
    pub collection: u8,
    /// Largest bounding dimension, metres.
    pub dimension_m: f64,
    /// No other collection has pages here.
    pub alone: bool,
}

impl NodeRecord {
    /// Packs what is known of `cell`.
    pub(super) fn pack(
        cell: CellId,
        info: &NodeInfo,
        mask: u32,
        first_child: u32,
        first_object: usize,
    ) -> Result<Self, IndexError> {
        let terrain = match (info.terrain, info.imagery) {
            (Some(terrain), Some(imagery)) if terrain.place.offset + u64::from(terrain.place.len) != imagery.offset => {
                return Err(IndexError::Apart(cell));
            }
            (Some(terrain), _) => terrain.place,
            (None, Some(imagery)) => Place { offset: imagery.offset, len: 0 },
            (None, None) => Place { offset: 0, len: 0 },
        };
        let pages = info.objects.iter().map(|entry| entry.place).chain(info.imagery).chain([terrain]);
        if pages.into_iter().any(|place| Place::new(place.offset, place.len).is_none()) {
            return Err(IndexError::TooLarge(cell));
        }
        let records = info.objects.len() + info.below.len();
        if records > 255 || info.objects.iter().any(|entry| entry.rep == REP_BELOW) {
            return Err(IndexError::TooManyObjects(cell));
        }
        let height = |m: f64| m.clamp(f64::from(i16::MIN), f64::from(i16::MAX)) as i16;
        Ok(Self {
            terrain: terrain.pack(),
            imagery_len_children: info.imagery.map_or(0, |place| place.len) | mask << 24,
            first_child,
            terrain_error_m: info.terrain.map_or(0.0, |terrain| terrain.error_m),
            height_min_m: height(info.height_range_m.0.floor()),
            height_max_m: height(info.height_range_m.1.ceil()),
            dimension: pack_size(info.dimension_m),
            reach: pack_size(info.reach_m),
            objects: (first_object as u32) << 8 | records as u32,
        })
    }

    pub(super) fn terrain(&self) -> Option<TerrainEntry> {
        let place = Place::unpack(self.terrain);
        (place.len > 0).then_some(TerrainEntry { place, error_m: self.terrain_error_m })
    }

    pub(super) fn imagery(&self) -> Option<Place> {
        let len = self.imagery_len_children & 0xff_ffff;
        let terrain = Place::unpack(self.terrain);
        (len > 0).then_some(Place { offset: terrain.offset + u64::from(terrain.len), len })
    }

    /// Bits of the quadrants that have a child; no more than four in a sound record.
    pub(super) fn children(&self) -> u32 {
        self.imagery_len_children >> 24
    }

    pub(super) fn first_child(&self) -> u32 {
        self.first_child
    }

    pub(super) fn height_range_m(&self) -> (f64, f64) {
        (f64::from(self.height_min_m), f64::from(self.height_max_m))
    }

    pub(super) fn dimension_m(&self) -> f64 {
        unpack_size(self.dimension)
    }

    pub(super) fn reach_m(&self) -> f64 {
        unpack_size(self.reach)
    }

    /// Its entries among the segment's objects.
    pub(super) fn objects(&self) -> Range<usize> {
        let first = (self.objects >> 8) as usize;
        first..first + (self.objects & 255) as usize
    }

    pub(super) fn is_error_a_length(&self) -> bool {
        (0.0..f32::INFINITY).contains(&self.terrain_error_m)
    }
}

impl ObjectsRecord {
    /// The records of a node.
    pub(super) fn pack(info: &NodeInfo) -> impl Iterator<Item = Self> + '_ {
        info.objects.iter().map(Self::of_page).chain(info.below.iter().map(Self::of_below))
    }

    fn of_page(entry: &ObjectsEntry) -> Self {
        let size = pack_size(if entry.rep == 0 { entry.dimension_m } else { entry.error_m });
        Self::with_bits(entry.place.pack(), entry.collection, entry.rep, size)
    }

    fn of_below(below: &ObjectsBelow) -> Self {
        Self::with_bits(below.alone.into(), below.collection, REP_BELOW, pack_size(below.dimension_m))
    }

    fn with_bits(place: u64, collection: u8, rep: u8, size: u16) -> Self {
        Self { place: [place as u32, (place >> 32) as u32], collection, rep, size }
    }

    fn place_bits(&self) -> u64 {
        u64::from(self.place[0]) | u64::from(self.place[1]) << 32
    }

    pub(super) fn page(&self) -> Option<ObjectsEntry> {
        let (place, size_m) = (Place::unpack(self.place_bits()), unpack_size(self.size));
        let (dimension_m, error_m) = if self.rep == 0 { (size_m, 0.0) } else { (0.0, size_m) };
        let entry = ObjectsEntry { collection: self.collection, rep: self.rep, place, dimension_m, error_m };
        (self.rep != REP_BELOW).then_some(entry)
    }

    pub(super) fn below(&self) -> Option<ObjectsBelow> {
        let (collection, dimension_m) = (self.collection, unpack_size(self.size));
        (self.rep == REP_BELOW).then_some(ObjectsBelow { collection, dimension_m, alone: self.place_bits() & 1 == 1 })
    }
}
