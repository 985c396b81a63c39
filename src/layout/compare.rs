//! What crossings cost by a storage model: from a layout, from packs, from any linear order.

use super::order::LinearOrder;
use crate::content::PageId;
use crate::forest::index::Place;
use crate::storage::{Disk, Faults, Request, StorageModel};

/// What a crossing reads.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Crossing {
    /// Pages with their places in the packs.
    pub pages: Vec<(PageId, Place)>,
}

impl Crossing {
    /// Stored bytes of its pages.
    pub fn bytes(&self) -> u64 {
        self.pages.iter().map(|(_, place)| u64::from(place.len)).sum()
    }
}

/// Time until all pages of a crossing are there, over many crossings, and what was read for them.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Delays {
    pub mean_s: f64,
    pub p99_s: f64,
    pub max_s: f64,
    pub seeks_mean: f64,
    pub seeks_max: u64,
    pub bytes_mean: f64,
}

/// How crossings are read.
#[derive(Clone, Copy)]
pub enum From<'o> {
    /// Each as one run.
    Layout,
    /// As ranges of neighbours, by the limits of the storage model.
    Linear(&'o LinearOrder),
}

/// Crossings one after the other, each begun when all before it is there, and the head is elsewhere.
pub fn crossing_delays(crossings: &[Crossing], from: From<'_>, storage: StorageModel) -> Delays {
    let (mut delays_s, mut delays) = (Vec::with_capacity(crossings.len()), Delays::default());
    for crossing in crossings {
        let requests = match from {
            From::Layout => one_run(&crossing.pages),
            From::Linear(order) => ranges(&crossing.pages, order, storage),
        };
        let mut disk = Disk::new(storage, Faults::NONE, 0);
        for request in requests {
            disk.start(request, 0.0);
        }
        let delay_s = disk.advance(f64::INFINITY).iter().map(|arrival| arrival.at_s).fold(0.0, f64::max);
        let counters = disk.counters();
        // Each request is a round trip; a disk counts those that move its head.
        let seeks = if storage.seek_only { counters.seeks } else { counters.requests };
        delays_s.push(delay_s);
        delays.seeks_mean += seeks as f64;
        delays.seeks_max = delays.seeks_max.max(seeks);
        delays.bytes_mean += counters.bytes as f64;
    }
    let count = delays_s.len().max(1) as f64;
    delays_s.sort_by(f64::total_cmp);
    delays.mean_s = delays_s.iter().sum::<f64>() / count;
    delays.max_s = delays_s.last().copied().unwrap_or(0.0);
    delays.p99_s =
        delays_s.get((delays_s.len() * 99 / 100).min(delays_s.len().saturating_sub(1))).copied().unwrap_or(0.0);
    delays.seeks_mean /= count;
    delays.bytes_mean /= count;
    delays
}

fn one_run(pages: &[(PageId, Place)]) -> Vec<Request> {
    let mut end = 0;
    let parts: Vec<u64> = pages
        .iter()
        .map(|(_, place)| {
            end += u64::from(place.len);
            end
        })
        .collect();
    if parts.is_empty() { Vec::new() } else { vec![Request { id: 0, file: 0, offset: 0, parts }] }
}

/// As the request manager makes them: neighbours no further apart than a gap, no longer than a run.
fn ranges(pages: &[(PageId, Place)], order: &LinearOrder, storage: StorageModel) -> Vec<Request> {
    let limits = storage.reads(0.0);
    let mut places: Vec<(u32, Place)> = pages.iter().filter_map(|(page, _)| order.0.get(page).copied()).collect();
    places.sort_by_key(|(file, place)| (*file, place.offset));
    let mut requests: Vec<Request> = Vec::new();
    for (file, place) in places {
        let end = place.offset + u64::from(place.len);
        let joins = requests.last_mut().filter(|last| {
            let last_end = last.offset + last.len_bytes();
            last.file == file
                && place.offset - last_end <= u64::from(limits.gap_bytes)
                && end - last.offset <= u64::from(limits.run_bytes)
        });
        match joins {
            Some(last) => last.parts.push(end - last.offset),
            None => {
                let id = requests.len() as u64;
                requests.push(Request { id, file, offset: place.offset, parts: vec![end - place.offset] });
            }
        }
    }
    requests
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::content::PageKind;
    use crate::forest::CellId;

    #[test]
    fn a_run_costs_one_seek_and_scattered_pages_one_each() {
        let cells: Vec<CellId> = CellId::containing(0.5, 0.5, 10).children().collect();
        let page =
            |at: usize, offset| (PageId { cell: cells[at], kind: PageKind::Terrain }, Place { offset, len: 12_000 });
        let pages = vec![page(0, 0), page(1, 50_000_000), page(2, 90_000_000)];
        let order = LinearOrder::packs(&pages);
        let crossings = [Crossing { pages: pages.clone() }, Crossing::default()];
        let (layout, packs) = (From::Layout, From::Linear(&order));
        let layout = crossing_delays(&crossings, layout, StorageModel::HDD);
        let packs = crossing_delays(&crossings, packs, StorageModel::HDD);
        assert_eq!((layout.seeks_max, packs.seeks_max), (1, 3));
        assert!((layout.max_s - (0.010 + 36_000.0 / 120e6)).abs() < 1e-9, "{layout:?}");
        assert!((packs.max_s - (0.030 + 36_000.0 / 120e6)).abs() < 1e-9, "{packs:?}");
        assert_eq!(layout.bytes_mean, 18_000.0);
    }
}
