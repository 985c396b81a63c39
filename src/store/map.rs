//! Files mapped into memory; the only place with `unsafe`.

use super::StoreError;
use crate::forest::index::SharedBytes;
use memmap2::Mmap;
use std::fs::File;
use std::path::Path;
use std::sync::Arc;

/// Maps a file that nothing changes while it is open.
#[expect(unsafe_code, reason = "a map is undefined when its file is cut short by another program meanwhile")]
pub(super) fn map(path: &Path) -> Result<SharedBytes, StoreError> {
    let io = |error| StoreError::io(path, error);
    let file = File::open(path).map_err(io)?;
    // SAFETY: worlds are never changed in place: the writer makes a new directory and renames it, a change makes new files
    // beside the old ones, so that the mapped file keeps its bytes, under another name or none. What is read is checked and is plain old data.
    let map: Mmap = unsafe { Mmap::map(&file) }.map_err(io)?;
    Ok(Arc::new(map))
}
