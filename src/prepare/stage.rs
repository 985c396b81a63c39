//! Results of finished stages, kept beside the world while it is made, so that a second run goes on where the first
//! one stopped. `DIR.partial` holds the recipe's hash and one file for each zone and collection that is done.
//!
//! A stage file: magic, hash of the recipe (u64), records, then a record of length 0 and the xxh3 of all before it.
//! It is written under a temporary name and renamed, so that a file that is there is whole. A record is a length (u32)
//! and as many bytes.

use std::fs::{File, TryLockError};
use std::io::{self, BufReader, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use xxhash_rust::xxh3::Xxh3;

const MAGIC: [u8; 8] = *b"stpstg01";
/// Holds the hash of the recipe, and is locked by the run that works here.
const MARK_FILE: &str = "recipe.hash";
/// A record is at most this long, bytes.
const RECORD_MAX: usize = 1 << 26;

/// Reading and writing stage files failed.
#[derive(Debug, thiserror::Error)]
#[error("{}: {cause}; {}", path.display(), remedy(cause))]
pub struct StageError {
    path: PathBuf,
    cause: io::Error,
}

fn remedy(error: &io::Error) -> &'static str {
    match error.kind() {
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => {
            "free some space and run the same command again: finished stages are kept"
        }
        io::ErrorKind::ResourceBusy => "wait for it, or name another folder by --out",
        io::ErrorKind::InvalidData => "remove it and run the same command again",
        _ => "check that the folder exists and that you may write there",
    }
}

/// The folder of one build; no other run may work in it meanwhile.
#[derive(Clone, Debug)]
pub struct Stages {
    folder: PathBuf,
    hash: u64,
    /// Locked. The lock goes with its process, whatever becomes of it.
    _mark: Arc<File>,
}

impl Stages {
    /// Opens `DIR.partial`. What another recipe left there is removed; says whether that was so.
    pub fn open(out: &Path, hash: u64) -> Result<(Self, bool), StageError> {
        let mut name = out.file_name().unwrap_or_default().to_owned();
        name.push(".partial");
        let folder = out.with_file_name(name);
        let fail = |cause| StageError { path: folder.clone(), cause };
        let is_new = !folder.join(MARK_FILE).exists();
        if is_new && std::fs::read_dir(&folder).is_ok_and(|mut entries| entries.next().is_some()) {
            return Err(fail(invalid("holds files that are not of this program")));
        }
        std::fs::create_dir_all(&folder).map_err(fail)?;
        let mut mark = lock(&folder).map_err(fail)?;
        let (mut found, ours) = (String::new(), format!("{hash:016x}\n"));
        mark.read_to_string(&mut found).map_err(fail)?;
        let is_other = found != ours;
        if is_other {
            remove_all_but_the_mark(&folder).map_err(fail)?;
            mark.set_len(0).and_then(|()| mark.rewind()).map_err(fail)?;
            mark.write_all(ours.as_bytes()).map_err(fail)?;
        }
        Ok((Self { folder, hash, _mark: Arc::new(mark) }, is_other && !found.is_empty()))
    }

    /// Removes everything.
    pub fn remove(&self) -> Result<(), StageError> {
        std::fs::remove_dir_all(&self.folder).map_err(|cause| StageError { path: self.folder.clone(), cause })
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.join(format!("{name}.stage"))
    }

    /// The finished stage of that name; `None` when it is not done.
    pub fn read(&self, name: &str) -> Result<Option<StageReader>, StageError> {
        let path = self.path(name);
        if !path.exists() {
            return Ok(None);
        }
        let fail = |cause| StageError { path: path.clone(), cause };
        let file = File::open(&path).map_err(fail)?;
        let mut reader = StageReader { path: path.clone(), input: BufReader::new(file), sum: Xxh3::new(), at: 0 };
        let mut head = [0; 16];
        reader.fill(&mut head)?;
        if head[..8] != MAGIC || head[8..] != self.hash.to_le_bytes() {
            return Err(fail(invalid("not a stage of this build")));
        }
        Ok(Some(reader))
    }

    /// The records of a finished stage by their places, for whoever has read it through.
    pub fn records(&self, name: &str) -> Result<StageRecords, StageError> {
        let path = self.path(name);
        let file = File::open(&path).map_err(|cause| StageError { path: path.clone(), cause })?;
        Ok(StageRecords { path, file })
    }

    /// Begins a stage; nothing shows before [`StageWriter::finish`].
    pub fn write(&self, name: &str) -> Result<StageWriter, StageError> {
        let path = self.path(name);
        let temporary = path.with_extension("tmp");
        let file = File::create(&temporary).map_err(|cause| StageError { path: temporary.clone(), cause })?;
        let mut writer =
            StageWriter { path, temporary, output: BufWriter::new(file), sum: Xxh3::new(), is_finished: false };
        writer.put(&MAGIC)?;
        writer.put(&self.hash.to_le_bytes())?;
        Ok(writer)
    }
}

/// Opens the file that holds the recipe's hash, and locks it.
fn lock(folder: &Path) -> io::Result<File> {
    let path = folder.join(MARK_FILE);
    let file = File::options().create(true).truncate(false).read(true).write(true).open(path)?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(TryLockError::WouldBlock) => {
            Err(io::Error::new(io::ErrorKind::ResourceBusy, "another run is at work on this world"))
        }
        Err(TryLockError::Error(error)) => Err(error),
    }
}

fn remove_all_but_the_mark(folder: &Path) -> io::Result<()> {
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        if entry.file_name() != MARK_FILE {
            std::fs::remove_file(entry.path())?;
        }
    }
    Ok(())
}

fn invalid(what: &str) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, what)
}

pub struct StageWriter {
    path: PathBuf,
    temporary: PathBuf,
    output: BufWriter<File>,
    sum: Xxh3,
    is_finished: bool,
}

impl Drop for StageWriter {
    fn drop(&mut self) {
        if !self.is_finished {
            // A part of a stage is of no use, and its room may be needed; a failure has been told already.
            let _ = std::fs::remove_file(&self.temporary);
        }
    }
}

impl StageWriter {
    fn put(&mut self, bytes: &[u8]) -> Result<(), StageError> {
        self.sum.update(bytes);
        self.output.write_all(bytes).map_err(|cause| StageError { path: self.temporary.clone(), cause })
    }

    /// Empty records are not kept apart from the end.
    pub fn record(&mut self, bytes: &[u8]) -> Result<(), StageError> {
        let len = u32::try_from(bytes.len()).ok().filter(|&len| len > 0 && len as usize <= RECORD_MAX);
        let Some(len) = len else {
            return Err(StageError { path: self.temporary.clone(), cause: invalid("a record of a wrong length") });
        };
        self.put(&len.to_le_bytes())?;
        self.put(bytes)
    }

    pub fn finish(mut self) -> Result<(), StageError> {
        self.put(&0u32.to_le_bytes())?;
        let sum = self.sum.digest();
        self.put(&sum.to_le_bytes())?;
        let fail = |cause| StageError { path: self.temporary.clone(), cause };
        self.output.flush().map_err(fail)?;
        self.output.get_ref().sync_all().map_err(fail)?;
        std::fs::rename(&self.temporary, &self.path).map_err(fail)?;
        self.is_finished = true;
        Ok(())
    }
}

pub struct StageReader {
    path: PathBuf,
    input: BufReader<File>,
    sum: Xxh3,
    /// Bytes read.
    at: u64,
}

impl StageReader {
    fn fill(&mut self, bytes: &mut [u8]) -> Result<(), StageError> {
        self.input.read_exact(bytes).map_err(|cause| StageError { path: self.path.clone(), cause })?;
        self.sum.update(bytes);
        self.at += bytes.len() as u64;
        Ok(())
    }

    /// Where the next record begins, for [`StageRecords::read`].
    pub fn position(&self) -> u64 {
        self.at
    }

    /// The next record; `None` after the last one, when the checksum was right.
    pub fn record(&mut self) -> Result<Option<Vec<u8>>, StageError> {
        let mut len = [0; 4];
        self.fill(&mut len)?;
        let len = u32::from_le_bytes(len) as usize;
        if len > RECORD_MAX {
            return Err(self.damaged());
        }
        if len > 0 {
            let mut bytes = vec![0; len];
            self.fill(&mut bytes)?;
            return Ok(Some(bytes));
        }
        let expected = self.sum.digest();
        let mut sum = [0; 8];
        self.fill(&mut sum)?;
        if u64::from_le_bytes(sum) == expected { Ok(None) } else { Err(self.damaged()) }
    }

    fn damaged(&self) -> StageError {
        StageError { path: self.path.clone(), cause: invalid("damaged") }
    }
}

/// A finished stage whose checksum was right, read here and there.
pub struct StageRecords {
    path: PathBuf,
    file: File,
}

impl StageRecords {
    /// The record that begins at a position.
    pub fn read(&mut self, position: u64) -> Result<Vec<u8>, StageError> {
        let fail = |cause| StageError { path: self.path.clone(), cause };
        let mut len = [0; 4];
        self.file.seek(SeekFrom::Start(position)).map_err(fail)?;
        self.file.read_exact(&mut len).map_err(fail)?;
        let len = u32::from_le_bytes(len) as usize;
        if len > RECORD_MAX {
            return Err(fail(invalid("changed while it was read")));
        }
        let mut bytes = vec![0; len];
        self.file.read_exact(&mut bytes).map_err(fail)?;
        Ok(bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stage_is_there_only_when_finished_and_only_for_its_recipe() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("world");
        let (stages, other) = Stages::open(&out, 7).unwrap();
        assert!(!other);
        let mut writer = stages.write("zone-03").unwrap();
        writer.record(b"one").unwrap();
        writer.record(b"two").unwrap();
        assert!(stages.read("zone-03").unwrap().is_none());
        writer.finish().unwrap();
        let busy = Stages::open(&out, 7).unwrap_err().to_string();
        assert!(busy.contains("another run is at work") && busy.contains("--out"), "{busy}");
        drop(stages);
        let (stages, _) = Stages::open(&out, 7).unwrap();
        let mut reader = stages.read("zone-03").unwrap().unwrap();
        assert_eq!(reader.record().unwrap().as_deref(), Some(&b"one"[..]));
        let second = reader.position();
        assert_eq!(stages.records("zone-03").unwrap().read(second).unwrap(), b"two");
        assert_eq!(reader.record().unwrap().as_deref(), Some(&b"two"[..]));
        assert_eq!(reader.record().unwrap(), None);
        drop(stages);
        let (stages, other) = Stages::open(&out, 8).unwrap();
        assert!(other && stages.read("zone-03").unwrap().is_none());
    }

    #[test]
    fn a_damaged_stage_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let (stages, _) = Stages::open(&folder.path().join("world"), 7).unwrap();
        let mut writer = stages.write("a").unwrap();
        writer.record(b"hello").unwrap();
        writer.finish().unwrap();
        let whole = std::fs::read(stages.path("a")).unwrap();
        for at in 0..whole.len() {
            let mut bytes = whole.clone();
            bytes[at] ^= 1;
            std::fs::write(stages.path("a"), &bytes).unwrap();
            let read = stages.read("a").and_then(|reader| {
                let mut reader = reader.unwrap();
                while reader.record()?.is_some() {}
                Ok(())
            });
            assert!(read.is_err(), "byte {at}");
        }
    }
}
