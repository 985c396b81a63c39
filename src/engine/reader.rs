//! What the engine flies over: an index, a description, and pages behind a reader.

use crate::forest::index::IndexForest;
use crate::paging::PageReader;
use crate::store::Manifest;
use std::sync::Arc;

/// A world as the engine sees it. The index is light to clone: its segments are shared.
#[derive(Clone)]
pub struct Source {
    pub manifest: Arc<Manifest>,
    pub index: IndexForest,
    pub reader: Arc<dyn PageReader>,
}
