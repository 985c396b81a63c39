//! Pages of a world, for servers.

use crate::content::{Page, PageId};
use crate::forest::index::Place;
use crate::paging::{PageReader, ReadError};
use crate::store::{StoreError, World};
use std::sync::Arc;

/// Reads, verifies and decodes pages of a world.
pub struct WorldReader(pub Arc<World>);

impl PageReader for WorldReader {
    fn load(&self, page: PageId, place: Place) -> Result<Page, ReadError> {
        let stored = self.0.read(page, place).map_err(sort)?;
        self.0.decode(page, &stored).map_err(sort)
    }
}

/// Storage that does not answer may do so later; stored bytes that are wrong stay wrong.
fn sort(error: StoreError) -> ReadError {
    let message = error.to_string();
    if matches!(error, StoreError::Io { .. }) { ReadError::Failed(message) } else { ReadError::Broken(message) }
}
