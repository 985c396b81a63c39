//! The world format: manifest, index files, packs, codecs; local directories and memory.

mod manifest;

pub use manifest::{CollectionInfo, CostPoint, LayerInfo, Manifest, SourceInfo};
