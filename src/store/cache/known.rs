//! The entries that a process knows of: where a range is, and which one goes next.

use super::name::EntryName;
use std::collections::{BTreeMap, BTreeSet, HashMap};

/// Entries that are looked at for one range: of more that begin before it, those further away are passed over.
const LOOKED_AT_MAX: usize = 64;

#[derive(Default)]
pub(super) struct Known {
    entries: HashMap<EntryName, Entry>,
    /// By the time of their last use.
    by_use: BTreeMap<u64, EntryName>,
    /// Sorted by file and offset.
    in_order: BTreeSet<(u128, u64, EntryName)>,
    clock: u64,
    bytes: u64,
    vital_bytes: u64,
}

#[derive(Clone, Copy)]
struct Entry {
    cost_bytes: u64,
    used: u64,
}

impl Known {
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    pub fn add(&mut self, name: EntryName, cost_bytes: u64) {
        self.remove(&name);
        self.clock += 1;
        self.entries.insert(name, Entry { cost_bytes, used: self.clock });
        self.by_use.insert(self.clock, name);
        self.in_order.insert((name.file, name.offset, name));
        self.bytes += cost_bytes;
        self.vital_bytes += if name.kind.is_vital() { cost_bytes } else { 0 };
    }

    /// What it took on the disk.
    pub fn remove(&mut self, name: &EntryName) -> Option<u64> {
        let entry = self.entries.remove(name)?;
        self.by_use.remove(&entry.used);
        self.in_order.remove(&(name.file, name.offset, *name));
        self.bytes -= entry.cost_bytes;
        self.vital_bytes -= if name.kind.is_vital() { entry.cost_bytes } else { 0 };
        Some(entry.cost_bytes)
    }

    pub fn touch(&mut self, name: &EntryName) {
        if let Some(entry) = self.entries.get_mut(name) {
            self.clock += 1;
            self.by_use.remove(&entry.used);
            self.by_use.insert(self.clock, *name);
            entry.used = self.clock;
        }
    }

    pub fn contains(&self, name: &EntryName) -> bool {
        self.entries.contains_key(name)
    }

    /// An entry of a file that holds all of a range.
    pub fn covering(&self, file: u128, offset: u64, len: u32) -> Option<EntryName> {
        let last = EntryName { kind: super::Kind::Manifest, file: u128::MAX, offset: u64::MAX, len: u32::MAX };
        let before = self.in_order.range((file, 0, EntryName::whole(super::Kind::Pages, 0))..=(file, offset, last));
        before.rev().take(LOOKED_AT_MAX).map(|known| known.2).find(|name| name.covers(offset, len))
    }

    /// What is dropped first: pages, the least recently used one. What worlds are opened with is used but once a flight;
    /// so it goes only after all pages, or where it takes more than half of `limit_bytes`.
    pub fn next_to_go(&self, limit_bytes: u64) -> Option<EntryName> {
        let oldest = |vital: bool| self.by_use.values().find(move |name| name.kind.is_vital() == vital).copied();
        let vital_first = self.vital_bytes > limit_bytes / 2;
        oldest(vital_first).or_else(|| oldest(!vital_first))
    }
}
