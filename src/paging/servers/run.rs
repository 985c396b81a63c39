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
    is_cancelled: impl FnMut(PageId) -> bool,
) -> (Fetched, Vec<Part>) {
    fetch_all(reader, vec![read], is_cancelled).pop().unwrap_or((Fetched::OneByOne, Vec::new()))
}

/// The same for several runs, together.
pub(super) fn fetch_all(
    reader: &dyn PageReader,
    reads: Vec<RangeRead>,
    mut is_cancelled: impl FnMut(PageId) -> bool,
) -> Vec<(Fetched, Vec<Part>)> {
    let (mut taken, mut runs) = (Vec::with_capacity(reads.len()), Vec::with_capacity(reads.len()));
    for read in reads {
        let part = |&(page, place): &_| Part { page, place, read_bytes: 0, is_cancelled: is_cancelled(page) };
        let parts: Vec<Part> = read.pages.iter().map(part).collect();
        let wanted = parts.iter().filter(|part| !part.is_cancelled).map(|part| (part.page, part.place)).collect();
        let run = read.of_pages(wanted);
        taken.push((parts, run.is_some()));
        runs.extend(run);
    }
    let count = runs.len();
    let read = guarded("runs", || Ok(reader.read_runs(&runs)));
    let mut read = read.unwrap_or_else(|error| vec![Err(error); count]).into_iter();
    let mut next = || match read.next() {
        Some(Ok(Some(run))) => Fetched::Run(run),
        Some(Ok(None)) | None => Fetched::OneByOne,
        Some(Err(error)) => Fetched::Failed(error),
    };
    let fetched = taken.into_iter().map(|(mut parts, is_read)| {
        let fetched = if is_read { next() } else { Fetched::OneByOne };
        count_bytes(&fetched, &mut parts);
        (fetched, parts)
    });
    fetched.collect()
}

/// What was read for each page: of a run that was read as one, gaps too; nothing where it did not come.
fn count_bytes(fetched: &Fetched, parts: &mut [Part]) {
    if matches!(fetched, Fetched::Failed(_)) {
        return;
    }
    let mut end = None;
    for part in parts.iter_mut().filter(|part| !part.is_cancelled) {
        let start = part.place.offset;
        let from = end.filter(|_| !matches!(fetched, Fetched::OneByOne)).map_or(start, |end: u64| end.min(start));
        let own_end = start + u64::from(part.place.len);
        part.read_bytes = own_end - from;
        end = Some(own_end);
    }
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
        // What is broken came.
        let read_bytes = if matches!(loaded, Err(ReadError::Failed(_))) { 0 } else { self.read_bytes };
        Delivery { page, place, outcome: loaded.map_or_else(Outcome::Failed, Outcome::Loaded), read_bytes }
    }
}

/// A decoder that panics must cost its page only, and not a delivery that the manager waits for.
fn guarded<T>(what: impl std::fmt::Debug, run: impl FnOnce() -> Result<T, ReadError>) -> Result<T, ReadError> {
    catch_unwind(AssertUnwindSafe(run))
        .unwrap_or_else(|_| Err(ReadError::Broken(format!("decoding {what:?} failed unexpectedly"))))
}
