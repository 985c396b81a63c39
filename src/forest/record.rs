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

/// Objects of one collection and rep whose page is rooted at a node.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct ObjectsRecord {
    place: [u32; 2],
    collection: u8,
    rep: u8,
    dimension: u16,
}

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
    /// Largest bounding dimension in the page, metres.
    pub dimension_m: f64,
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
        if info.objects.len() > 255 {
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
            objects: (first_object as u32) << 8 | info.objects.len() as u32,
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
    pub(super) fn pack(entry: &ObjectsEntry) -> Self {
        let place = entry.place.pack();
        Self {
            place: [place as u32, (place >> 32) as u32],
            collection: entry.collection,
            rep: entry.rep,
            dimension: pack_size(entry.dimension_m),
        }
    }

    pub(super) fn unpack(&self) -> ObjectsEntry {
        ObjectsEntry {
            collection: self.collection,
            rep: self.rep,
            place: Place::unpack(u64::from(self.place[0]) | u64::from(self.place[1]) << 32),
            dimension_m: unpack_size(self.dimension),
        }
    }
}
