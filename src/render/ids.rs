//! The numbers in the id picture.
//!
//! 0 is the sky. Terrain has bit 31 set and 31 hashed bits of its cell; an object has its collection in bits 27 to 30
//! and its ordinal, plus one, in bits 0 to 26. Ids do not depend on the frame, so that pictures can be compared.

use crate::forest::CellId;
use std::collections::HashMap;

pub const SKY_ID: u32 = 0;
const TERRAIN_BIT: u32 = 1 << 31;
const ORDINAL_BITS: u32 = 27;
const ORDINAL_MASK: u32 = (1 << ORDINAL_BITS) - 1;

/// What a pixel shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum IdOf {
    /// Terrain of a drawn piece.
    Cell(CellId),
    /// An object by its collection and its ordinal there.
    Object { collection: u8, id: u32 },
}

/// Whether an id is that of terrain.
pub fn is_cell(id: u32) -> bool {
    id & TERRAIN_BIT != 0
}

/// Splitmix64's finalizer: neighbours get far-apart ids.
pub(super) fn id_of_cell(cell: CellId) -> u32 {
    let mut bits = cell.to_u64();
    bits = (bits ^ bits >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    bits = (bits ^ bits >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    (bits ^ bits >> 31) as u32 | TERRAIN_BIT
}

pub(super) fn id_of_object(collection: u8, id: u32) -> u32 {
    // The 16 collections × 134 million objects are a limit of the picture, not of the world: more wrap round.
    ((u32::from(collection) & 0xf) << ORDINAL_BITS) | ((id % ORDINAL_MASK) + 1)
}

/// The cells drawn in a frame, by id.
#[derive(Debug, Default)]
pub(super) struct DrawnIds(HashMap<u32, CellId>);

impl DrawnIds {
    pub fn clear(&mut self) {
        self.0.clear();
    }

    pub fn add(&mut self, cell: CellId) -> u32 {
        let id = id_of_cell(cell);
        self.0.insert(id, cell);
        id
    }

    pub fn resolve(&self, id: u32) -> Option<IdOf> {
        if id & TERRAIN_BIT != 0 {
            return self.0.get(&id).copied().map(IdOf::Cell);
        }
        let ordinal = (id & ORDINAL_MASK).checked_sub(1)?;
        Some(IdOf::Object { collection: (id >> ORDINAL_BITS) as u8, id: ordinal })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::forest::Zone;

    #[test]
    fn ids_say_what_they_stand_for() {
        let mut drawn = DrawnIds::default();
        for cell in Zone::all().map(Zone::root) {
            let id = drawn.add(cell);
            assert_eq!(drawn.resolve(id), Some(IdOf::Cell(cell)));
        }
        assert_eq!(drawn.resolve(SKY_ID), None);
        for (collection, id) in [(0, 0), (3, 85_849), (15, 1_000_000)] {
            assert_eq!(drawn.resolve(id_of_object(collection, id)), Some(IdOf::Object { collection, id }));
        }
    }
}
