//! What a display needs to know: the state of pages, how many there are of each, and how long one is awaited.

use super::RequestManager;
use crate::content::{PageId, PageKind};
use crate::select::Urgency;

/// What the request manager knows of a page.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum PageState {
    /// Not held, and not asked for.
    Absent,
    /// Asked for; also while a cancellation is not confirmed yet.
    Requested,
    Resident,
    /// The last try failed, and no other is under way.
    Failed,
}

/// Pages of one layer by state.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct PageCounts {
    pub resident: u64,
    /// Under way, cancelled ones included.
    pub requested: u64,
    /// Whether wanted now or not.
    pub failed: u64,
    /// Demanded in the last update as more than predicted, neither resident nor given up: asked for, or waiting for their turn.
    pub missing: u64,
}

/// Pages by layer and state.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct LayerCounts {
    pub terrain: PageCounts,
    pub imagery: PageCounts,
    pub objects: PageCounts,
    /// Segments of the index.
    pub index: PageCounts,
}

impl LayerCounts {
    fn of(&mut self, page: PageId) -> &mut PageCounts {
        match page.kind {
            PageKind::Terrain => &mut self.terrain,
            PageKind::Imagery => &mut self.imagery,
            PageKind::Objects { .. } => &mut self.objects,
            PageKind::Segment => &mut self.index,
        }
    }

    /// With their names.
    pub fn layers(&self) -> [(&'static str, PageCounts); 4] {
        [("terrain", self.terrain), ("imagery", self.imagery), ("objects", self.objects), ("index", self.index)]
    }

    /// Over all layers.
    pub fn total(&self) -> PageCounts {
        self.layers().into_iter().fold(PageCounts::default(), |sum, (_, layer)| PageCounts {
            resident: sum.resident.saturating_add(layer.resident),
            requested: sum.requested.saturating_add(layer.requested),
            failed: sum.failed.saturating_add(layer.failed),
            missing: sum.missing.saturating_add(layer.missing),
        })
    }
}

impl RequestManager {
    pub fn state(&self, page: PageId) -> PageState {
        if self.residents.contains(page) {
            PageState::Resident
        } else if self.under_way.contains_key(&page) {
            PageState::Requested
        } else if self.faults.contains_key(&page) {
            PageState::Failed
        } else {
            PageState::Absent
        }
    }

    /// Counts anew, in time proportional to the pages that are known.
    pub fn page_counts(&self) -> LayerCounts {
        let mut counts = LayerCounts::default();
        self.residents.pages().for_each(|page| counts.of(page).resident += 1);
        self.under_way.keys().for_each(|&page| counts.of(page).requested += 1);
        let failed = self.faults.keys().filter(|page| self.state(**page) == PageState::Failed);
        failed.for_each(|&page| counts.of(page).failed += 1);
        for &page in self.wanted.iter().filter(|(_, wanted)| wanted.urgency > Urgency::Predicted).map(|(page, _)| page)
        {
            counts.of(page).missing += u64::from(self.is_awaited(page));
        }
        counts
    }

    /// When the page that has been waited for longest was first asked for, on the clock of [`RequestManager::update`]:
    /// of those of the front that have been
    /// demanded in every update since, are not resident, and are not given up. Tries that
    /// failed in between count as waiting.
    pub fn awaited_since_secs(&self) -> Option<f64> {
        let awaited =
            self.wanted.iter().filter(|(page, wanted)| wanted.urgency > Urgency::Predicted && self.is_awaited(**page));
        awaited.filter_map(|(_, wanted)| wanted.asked_at_secs).min_by(f64::total_cmp)
    }
}
