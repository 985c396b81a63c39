//! What was changed in a world since it was made: further packs, and the index files that belong to a manifest.
//!
//! No file of a world is ever changed. A change (its number is its *generation*, from 1) writes new files beside the old
//! ones, `packs/ZZ.gN.pack` and `index/ZZ.gN.idx`; the manifest, renamed into place last, names those that count. So a
//! change that is broken off leaves the old world and files that nothing names. The packs of a zone are one row of
//! bytes: offsets in the index run on from the end of one to the next.

use crate::forest::Zone;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// What changed since a world was made.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Additions {
    /// Number of the last change; 0 for none.
    pub generation: u32,
    /// Bytes of packs that no page uses any more.
    pub unused_bytes: u64,
    /// Zones that were changed, ascending; all others have their first files.
    pub zones: Vec<ZoneFiles>,
}

/// The files of a zone that was changed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ZoneFiles {
    pub zone: u8,
    /// Generation of its index file.
    pub index: u32,
    /// The checksum that stands in the head of that file, hexadecimal.
    pub index_checksum: String,
    /// Its packs, in the order of their bytes; never none.
    pub packs: Vec<PackFile>,
}

/// One of the packs of a zone.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PackFile {
    pub generation: u32,
    /// Of the whole file, its header included.
    pub bytes: u64,
}

impl Additions {
    pub fn is_none(&self) -> bool {
        self.generation == 0
    }

    pub fn of(&self, zone: Zone) -> Option<&ZoneFiles> {
        self.zones.iter().find(|files| usize::from(files.zone) == zone.index())
    }

    /// What is wrong with it.
    pub(super) fn check(&self) -> Result<(), String> {
        if self.zones.windows(2).any(|pair| pair[0].zone >= pair[1].zone) {
            return Err("the zones of its additions are out of order".to_owned());
        }
        self.zones.iter().try_for_each(|files| files.check(self.generation))
    }
}

impl ZoneFiles {
    fn check(&self, generation: u32) -> Result<(), String> {
        let zone = self.zone;
        if Zone::new(zone).is_none() {
            return Err(format!("{zone} is no zone"));
        }
        let in_order = self.packs.windows(2).all(|pair| pair[0].generation < pair[1].generation);
        let last = self.packs.last().map(|pack| pack.generation);
        if !in_order || self.index > generation || last.is_none_or(|last| last > generation) {
            return Err(format!("the files of zone {zone} are none that a change could have made"));
        }
        Ok(())
    }

    /// Where each pack begins in the row of all, and where the row ends.
    pub(super) fn starts(&self) -> impl Iterator<Item = u64> + '_ {
        let mut end = 0u64;
        std::iter::once(0).chain(self.packs.iter().map(move |pack| {
            end = end.saturating_add(pack.bytes);
            end
        }))
    }
}

pub(super) fn pack_path(dir: &Path, zone: Zone, generation: u32) -> PathBuf {
    dir.join("packs").join(file_name(zone, generation, "pack"))
}

pub(super) fn index_path(dir: &Path, zone: Zone, generation: u32) -> PathBuf {
    dir.join("index").join(file_name(zone, generation, "idx"))
}

/// The same in an address, which has one kind of separators everywhere.
pub(super) fn pack_name(zone: Zone, generation: u32) -> String {
    format!("packs/{}", file_name(zone, generation, "pack"))
}

pub(super) fn index_name(zone: Zone, generation: u32) -> String {
    format!("index/{}", file_name(zone, generation, "idx"))
}

fn file_name(zone: Zone, generation: u32, extension: &str) -> String {
    let zone = zone.index();
    if generation == 0 { format!("{zone:02}.{extension}") } else { format!("{zone:02}.g{generation}.{extension}") }
}

/// Whether a file's name is one of those that worlds give to their packs and index files.
pub(super) fn is_ours(name: &str) -> bool {
    let mut parts = name.split('.');
    let zone = parts.next().is_some_and(|zone| zone.len() == 2 && zone.bytes().all(|digit| digit.is_ascii_digit()));
    let rest: Vec<&str> = parts.collect();
    let is_generation = |text: &str| text.strip_prefix('g').is_some_and(|number| number.parse::<u32>().is_ok());
    zone && match rest[..] {
        ["idx" | "pack"] => true,
        [generation, "idx" | "pack"] => is_generation(generation),
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_told_from_those_of_others() {
        let zone = Zone::new(7).unwrap();
        for generation in [0, 1, 12] {
            for path in [pack_path(Path::new(""), zone, generation), index_path(Path::new(""), zone, generation)] {
                assert!(is_ours(path.file_name().unwrap().to_str().unwrap()), "{}", path.display());
            }
        }
        for name in ["notes.txt", "7.pack", "07.pack.bak", "07.gx.idx", "ab.idx", "07", "07.g1.g2.pack"] {
            assert!(!is_ours(name), "{name}");
        }
    }

    #[test]
    fn files_that_no_change_makes_are_refused() {
        let files = |zone, index, packs: &[u32]| ZoneFiles {
            zone,
            index,
            index_checksum: String::new(),
            packs: packs.iter().map(|&generation| PackFile { generation, bytes: 100 }).collect(),
        };
        let of = |zones| Additions { generation: 2, unused_bytes: 0, zones };
        assert_eq!(of(vec![files(3, 2, &[0, 1, 2]), files(4, 1, &[1])]).check(), Ok(()));
        for zones in [
            vec![files(4, 1, &[0]), files(3, 1, &[0])],
            vec![files(32, 1, &[0])],
            vec![files(3, 3, &[0])],
            vec![files(3, 1, &[1, 0])],
            vec![files(3, 1, &[0, 3])],
            vec![files(3, 1, &[])],
        ] {
            assert!(of(zones.clone()).check().is_err(), "{zones:?}");
        }
    }

    #[test]
    fn packs_are_one_row_of_bytes() {
        let packs = vec![PackFile { generation: 0, bytes: 100 }, PackFile { generation: 4, bytes: 50 }];
        let files = ZoneFiles { zone: 0, index: 4, index_checksum: String::new(), packs };
        assert_eq!(files.starts().collect::<Vec<_>>(), [0, 100, 150]);
    }
}
