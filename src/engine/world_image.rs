//! The world image, made from the zones' pictures.

use super::Source;
use crate::content::{Page, PageId, PageKind};
use crate::forest::index::Place;
use crate::render::Renderer;

/// What was read for it, and what went wrong: a zone whose picture cannot be read has none in it.
#[derive(Debug, Default)]
pub struct WorldImageLoad {
    pub read: Vec<(PageId, Place)>,
    pub failures: Vec<String>,
}

/// Reads the zones' pictures one after the other: they themselves come and go like all others.
pub fn load_world_image(source: &Source, renderer: &mut Renderer) -> WorldImageLoad {
    let mut load = WorldImageLoad::default();
    for root in source.index.trees().map(|tree| tree.root()) {
        let Some(place) = root.imagery() else { continue };
        let id = PageId { cell: root.cell(), kind: PageKind::Imagery };
        load.read.push((id, place));
        match source.reader.load(id, place) {
            Ok(Page::Imagery(picture)) => renderer.add_to_world_image(&picture),
            Ok(_) => {}
            Err(error) => load.failures.push(error.to_string()),
        }
    }
    renderer.flush_uploads();
    load
}
