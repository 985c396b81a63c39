//! Reading a run and taking it apart, for servers of either kind.

use super::{Delivery, Outcome, PageReader, PageRun, RangeRead, ReadError};
use crate::content::PageId;
use crate::forest::index::Place;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

/// What reading a run gave.
#[derive(Clone)]
pub(super) enum Fetched {
    Run(Arc<dyn PageRun>),
    /// Nothing yet: each page is read for itself.
    OneByOne,
    Failed(ReadError),
}

/// A page of a run.
pub(super) struct Part {
    pub page: PageId,
    pub place: Place,
    /// See [`Delivery::read_bytes`].
    read_bytes: u64,
    /// Before anything was read for it.
    is_cancelled: bool,
}

/// Reads a run, less the ends of it that nobody wants any more; nothing where all of it is cancelled.
pub(super) fn fetch(
    reader: &dyn PageReader,
    read: RangeRead,
    mut is_cancelled: impl FnMut(PageId) -> bool,
) -> (Fetched, Vec<Part>) {
    let mut parts: Vec<Part> = read
        .pages
        .iter()
        .map(|&(page, place)| Part { page, place, read_bytes: 0, is_cancelled: is_cancelled(page) })
        .collect();
    let wanted = parts.iter().filter(|part| !part.is_cancelled).map(|part| (part.page, part.place)).collect();
    let Some(run) = read.of_pages(wanted) else { return (Fetched::OneByOne, parts) };
    let fetched = match guarded("reading a run", || reader.read_run(&run)) {
        Ok(Some(pages)) => Fetched::Run(pages),
        Ok(None) => Fetched::OneByOne,
        Err(error) => Fetched::Failed(error),
    };
    let reads_gaps = !matches!(fetched, Fetched::OneByOne);
    let mut end = run.offset;
    for part in parts.iter_mut().filter(|part| !part.is_cancelled) {
        let from = if reads_gaps { end.min(part.place.offset) } else { part.place.offset };
        end = part.place.offset + u64::from(part.place.len);
        part.read_bytes = end - from;
    }
    (fetched, parts)
}

impl Part {
    /// `is_cancelled`: since the run was read.
    pub fn deliver(self, reader: &dyn PageReader, fetched: &Fetched, is_cancelled: bool) -> Delivery {
        let Self { page, place, .. } = self;
        if is_cancelled || self.is_cancelled {
            // Of a run that was read for others its bytes came along.
            let read_bytes = if matches!(fetched, Fetched::OneByOne) { 0 } else { self.read_bytes };
            return Delivery { page, place, outcome: Outcome::Cancelled, read_bytes };
        }
        let loaded = match fetched {
            Fetched::Run(run) => guarded(page, || run.page(page, place)),
            Fetched::OneByOne => guarded(page, || reader.load(page, place)),
            Fetched::Failed(error) => Err(error.clone()),
        };
        let outcome = loaded.map_or_else(Outcome::Failed, Outcome::Loaded);
        Delivery { page, place, outcome, read_bytes: self.read_bytes }
    }
}

/// A decoder that panics must cost its page only, and not a delivery that the manager waits for.
fn guarded<T>(what: impl std::fmt::Debug, run: impl FnOnce() -> Result<T, ReadError>) -> Result<T, ReadError> {
    catch_unwind(AssertUnwindSafe(run))
        .unwrap_or_else(|_| Err(ReadError::Broken(format!("decoding {what:?} failed unexpectedly"))))
}
