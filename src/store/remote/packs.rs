//! Pages and indexes of a world on a server.

use super::client::{Client, Request};
use super::file::{RemoteFile, Server};
use super::pin::Pin;
use super::shelf::Shelf;
use crate::content::PageFile;
use crate::forest::Zone;
use crate::forest::index::{Place, SharedBytes, aligned};
use crate::store::additions::{Additions, index_name, pack_name};
use crate::store::cache::Kind;
use crate::store::pack::{PageRange, PageSource};
use crate::store::{MANIFEST_FILE, StoreError, index};
use std::collections::HashMap;
use std::ops::Range;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// The first bytes of an index file, which are read ahead when a world is opened: most indexes are no longer, and of most
/// others it is the table and the first segment.
const INDEX_START_BYTES: u64 = 64 << 10;
/// Index files are read whole in parts of this length.
const INDEX_PART_BYTES: u64 = 1 << 20;

/// The files of a world on a server.
pub(in crate::store) struct RemotePacks {
    client: Arc<Client>,
    shelf: Option<Shelf>,
    /// The version of the manifest; or why it is not known, and all comes from the cache.
    manifest: Result<Pin, StoreError>,
    /// By zone, in the order of their bytes; never none.
    packs: Vec<Vec<RemoteFile>>,
    /// By zone, with the checksum that the head must hold, where the manifest tells.
    indexes: Vec<(RemoteFile, Option<String>)>,
    /// First bytes of index files by zone, while the world is being opened.
    starts: Mutex<HashMap<Zone, Vec<u8>>>,
    /// Files beside them by name.
    beside: Mutex<HashMap<String, Arc<RemoteFile>>>,
}

/// A range to be asked of a file.
struct Wanted<'a> {
    file: &'a RemoteFile,
    own: Range<u64>,
    /// Where its bytes go.
    at: usize,
}

impl RemotePacks {
    pub(super) fn new(
        client: Arc<Client>,
        shelf: Option<Shelf>,
        manifest: Result<Pin, StoreError>,
        additions: &Additions,
    ) -> Self {
        let packs = Zone::all().map(|zone| packs(zone, additions)).collect();
        let indexes = Zone::all().map(|zone| index_file(zone, additions)).collect();
        Self { client, shelf, manifest, packs, indexes, starts: Mutex::default(), beside: Mutex::default() }
    }

    fn server(&self) -> Server<'_> {
        Server { client: &self.client, shelf: self.shelf.as_ref() }
    }

    fn index(&self, zone: Zone) -> &RemoteFile {
        &self.indexes[zone.index()].0
    }

    /// The files that a zone's row of bytes is made of.
    fn row(&self, zone: Zone, file: PageFile) -> &[RemoteFile] {
        match file {
            PageFile::Pack => &self.packs[zone.index()],
            PageFile::Index => std::slice::from_ref(self.index(zone)),
            // No zone has one.
            PageFile::Layout => &[],
        }
    }

    /// A range of a row, by the files that it lies in: one, but for ranges that were joined from several pages.
    fn parts(&self, zone: Zone, file: PageFile, place: Place) -> Vec<(&RemoteFile, Range<u64>)> {
        let row = self.row(zone, file);
        let end = place.offset + u64::from(place.len);
        let ends = row.iter().skip(1).map(|next| next.start).chain([u64::MAX]);
        let parts = row.iter().zip(ends).map(|(file, file_end)| {
            let (from, to) = (place.offset.max(file.start), end.min(file_end));
            (file, from.saturating_sub(file.start)..to.saturating_sub(file.start))
        });
        parts.filter(|(_, range)| range.start < range.end).collect()
    }

    /// Fills in what the cache has; gives the pages that it has not.
    fn load(&self, range: &PageRange<'_>, bytes: &mut [u8]) -> Vec<Place> {
        if self.shelf.is_none() {
            return range.pages.to_vec();
        }
        let mut is_there = vec![false; range.pages.len()];
        for (file, own) in self.parts(range.zone, range.file, range.place) {
            // No page goes on in the next file.
            let inside: Vec<(usize, Place)> = (0..)
                .zip(range.pages)
                .filter_map(|(number, page)| {
                    let offset = page.offset.checked_sub(file.start)?;
                    let fits = own.contains(&offset) && offset + u64::from(page.len) <= own.end;
                    fits.then_some((number, Place { offset, len: page.len }))
                })
                .collect();
            let places: Vec<Place> = inside.iter().map(|page| page.1).collect();
            file.load(self.server(), &places, |at, found| {
                let number = inside[at].0;
                if let Some(at) = range.part(range.pages[number]) {
                    bytes[at].copy_from_slice(found);
                    is_there[number] = true;
                }
            });
        }
        range.pages.iter().zip(is_there).filter(|(_, is_there)| !is_there).map(|(page, _)| *page).collect()
    }

    /// What is to be asked for, so that all of these pages come: from the first to the last of them.
    fn wanted(&self, range: &PageRange<'_>, missing: &[Place]) -> Vec<Wanted<'_>> {
        let (Some(first), Some(last)) = (missing.first(), missing.last()) else { return Vec::new() };
        let end = last.offset + u64::from(last.len);
        let span = Place { offset: first.offset, len: (end - first.offset) as u32 };
        let Some(at) = range.part(span) else { return Vec::new() };
        let mut done = at.start;
        let parts = self.parts(range.zone, range.file, span).into_iter().map(|(file, own)| {
            let at = done;
            done += (own.end - own.start) as usize;
            Wanted { file, own, at }
        });
        parts.collect()
    }

    /// The first bytes of the index files of some zones: from the cache, else several at once.
    fn read_starts(&self, zones: &[Zone]) -> Result<(), StoreError> {
        let mut asked: Vec<Zone> = Vec::new();
        for &zone in zones {
            match self.kept_start(zone) {
                Some(start) => drop(self.starts().insert(zone, start)),
                None => asked.push(zone),
            }
        }
        let request = |&zone: &Zone| self.index(zone).request(self.server(), 0..INDEX_START_BYTES);
        let answers = self.client.get_all(asked.iter().map(request).collect());
        for (zone, answer) in asked.into_iter().zip(answers) {
            let start = self.index(zone).take(self.server(), Kind::Index, 0, answer)?;
            self.starts().insert(zone, start);
        }
        Ok(())
    }

    fn kept_start(&self, zone: Zone) -> Option<Vec<u8>> {
        let file = self.index(zone);
        let len = file.pin(self.server())?.len.min(INDEX_START_BYTES);
        let mut start = None;
        let place = Place { offset: 0, len: len as u32 };
        file.load(self.server(), &[place], |_, found| start = Some(found.to_vec()));
        start
    }

    /// A range of an index file, as far as it begins in what was read ahead.
    fn part_of_start(&self, zone: Zone, place: Place) -> Option<Vec<u8>> {
        let starts = self.starts();
        let start = usize::try_from(place.offset).ok()?;
        Some(starts.get(&zone)?.get(start..start.checked_add(place.len as usize)?)?.to_vec())
    }

    fn read_part(&self, zone: Zone, offset: u64, len: u64) -> Result<Vec<u8>, StoreError> {
        let (file, place) = (self.index(zone), Place { offset, len: len as u32 });
        let mut kept = None;
        file.load(self.server(), &[place], |_, found| kept = Some(found.to_vec()));
        match kept {
            Some(kept) => Ok(kept),
            None => file.fetch(self.server(), Kind::Index, offset..offset + len),
        }
    }

    /// An index that belongs to another manifest would tell places that hold other pages.
    fn check_index(&self, zone: Zone, bytes: &[u8]) -> Result<(), StoreError> {
        match &self.indexes[zone.index()].1 {
            Some(told) if index::checksum(bytes).as_ref() != Some(told) => Err(StoreError::Index {
                file: self.index_name(zone),
                cause: "it is not the index that the manifest names".to_owned(),
            }),
            _ => Ok(()),
        }
    }

    fn beside(&self, name: &str) -> Arc<RemoteFile> {
        let mut beside = self.beside.lock().unwrap_or_else(PoisonError::into_inner);
        beside.entry(name.to_owned()).or_insert_with(|| Arc::new(RemoteFile::new(name.to_owned(), 0, None))).clone()
    }

    fn starts(&self) -> MutexGuard<'_, HashMap<Zone, Vec<u8>>> {
        // Single entries come and go; what a thread that failed left is whole.
        self.starts.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn packs(zone: Zone, additions: &Additions) -> Vec<RemoteFile> {
    match additions.of(zone) {
        None => vec![RemoteFile::new(pack_name(zone, 0), 0, None)],
        Some(files) => {
            let packs = files.packs.iter().zip(files.starts());
            packs.map(|(pack, at)| RemoteFile::new(pack_name(zone, pack.generation), at, Some(pack.bytes))).collect()
        }
    }
}

fn index_file(zone: Zone, additions: &Additions) -> (RemoteFile, Option<String>) {
    let files = additions.of(zone);
    let name = index_name(zone, files.map_or(0, |files| files.index));
    (RemoteFile::new(name, 0, None), files.map(|files| files.index_checksum.clone()))
}

impl PageSource for RemotePacks {
    fn read(&self, zone: Zone, place: Place) -> Result<Vec<u8>, StoreError> {
        self.read_range(&PageRange { zone, file: PageFile::Pack, place, pages: &[place] })
    }

    /// One request, from the first to the last page that the cache has not; none where it has all.
    fn read_range(&self, range: &PageRange<'_>) -> Result<Vec<u8>, StoreError> {
        let mut bytes = vec![0; range.place.len as usize];
        let missing = self.load(range, &mut bytes);
        for Wanted { file, own, at } in self.wanted(range, &missing) {
            let part = file.fetch(self.server(), Kind::Pages, own)?;
            bytes[at..at + part.len()].copy_from_slice(&part);
        }
        Ok(bytes)
    }

    fn read_ranges(&self, ranges: &[PageRange<'_>]) -> Vec<Result<Vec<u8>, StoreError>> {
        let mut all: Vec<(Vec<u8>, Vec<Wanted<'_>>)> = Vec::with_capacity(ranges.len());
        for range in ranges {
            let mut bytes = vec![0; range.place.len as usize];
            let missing = self.load(range, &mut bytes);
            all.push((bytes, self.wanted(range, &missing)));
        }
        let wanted = all.iter().flat_map(|(_, wanted)| wanted);
        let requests = wanted.map(|wanted| wanted.file.request(self.server(), wanted.own.clone())).collect();
        let mut answers = self.client.get_all(requests).into_iter();
        let finish = |(mut bytes, wanted): (Vec<u8>, Vec<Wanted<'_>>)| {
            // All answers of a range are taken from the row, also behind one that failed.
            let parts: Vec<_> = wanted.into_iter().zip(answers.by_ref()).collect();
            for (Wanted { file, own, at }, answer) in parts {
                let part = file.take_all(self.server(), Kind::Pages, own, answer)?;
                bytes[at..at + part.len()].copy_from_slice(&part);
            }
            Ok(bytes)
        };
        all.into_iter().map(finish).collect()
    }

    fn before_open(&self, zones: &[Zone]) -> Result<(), StoreError> {
        self.read_starts(zones)?;
        for zone in zones {
            let start = self.part_of_start(*zone, Place { offset: 0, len: index::HEADER_BYTES as u32 });
            self.check_index(*zone, &start.unwrap_or_default())?;
        }
        Ok(())
    }

    /// The manifest must still be the one that the indexes were read for.
    fn after_open(&self) -> Result<(), StoreError> {
        self.starts().clear();
        let Ok(pin) = &self.manifest else { return Ok(()) };
        let request = Request { name: MANIFEST_FILE.to_owned(), range: Some(0..1), pin: Some(pin.clone()) };
        match self.client.get(request) {
            Err(error @ StoreError::Changed { .. }) => Err(error),
            // What is wrong with the server otherwise is told by what is read of it.
            _ => Ok(()),
        }
    }

    fn is_remote(&self) -> bool {
        true
    }

    fn notice(&self) -> Option<String> {
        let (error, shelf) = (self.manifest.as_ref().err()?, self.shelf.as_ref()?);
        let folder = shelf.folder();
        Some(format!("{error}; opened from the cache in {}, as it was when it was last read", folder.display()))
    }

    fn read_beside(&self, name: &str, place: Place) -> Result<Vec<u8>, StoreError> {
        let (file, mut kept) = (self.beside(name), None);
        file.load(self.server(), &[place], |_, found| kept = Some(found.to_vec()));
        match kept {
            Some(kept) => Ok(kept),
            None => file.fetch(self.server(), Kind::Pages, place.offset..place.offset + u64::from(place.len)),
        }
    }

    fn beside_len(&self, name: &str) -> Result<u64, StoreError> {
        self.beside(name).len(self.server())
    }

    fn pack_len(&self, zone: Zone) -> Result<u64, StoreError> {
        self.packs[zone.index()].iter().map(|file| file.len(self.server())).sum()
    }

    fn pack_name(&self, zone: Zone) -> PathBuf {
        self.client.address().file(&pack_name(zone, 0))
    }

    fn file_of(&self, zone: Zone, place: Place) -> (PathBuf, u64) {
        match self.parts(zone, PageFile::Pack, place).first() {
            Some((file, own)) => (file.path(self.server()), own.start),
            None => (self.pack_name(zone), place.offset),
        }
    }

    fn read_index(&self, zone: Zone, place: Place) -> Result<Vec<u8>, StoreError> {
        if let Some(bytes) = self.part_of_start(zone, place) {
            return Ok(bytes);
        }
        self.read_range(&PageRange { zone, file: PageFile::Index, place, pages: &[place] })
    }

    fn whole_index(&self, zone: Zone) -> Result<SharedBytes, StoreError> {
        let len = self.index_len(zone)?;
        let mut bytes = self.starts().remove(&zone).unwrap_or_default();
        while (bytes.len() as u64) < len {
            let at = bytes.len() as u64;
            bytes.extend_from_slice(&self.read_part(zone, at, (len - at).min(INDEX_PART_BYTES))?);
        }
        self.check_index(zone, &bytes)?;
        Ok(aligned(&bytes))
    }

    fn index_len(&self, zone: Zone) -> Result<u64, StoreError> {
        self.index(zone).len(self.server())
    }

    fn index_name(&self, zone: Zone) -> PathBuf {
        self.index(zone).path(self.server())
    }
}
