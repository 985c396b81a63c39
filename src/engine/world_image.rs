//! The world image, made from the zones' pictures.

use super::Source;
use crate::content::{Page, PageId, PageKind};
use crate::forest::index::Place;
use crate::paging::{Delivery, InlineServer, Outcome, PageServer, RangeRead};
use crate::render::Renderer;

/// What was read for it, and what went wrong: a zone whose picture cannot be read has none in it.
#[derive(Debug, Default)]
pub struct WorldImageLoad {
    pub read: Vec<(PageId, Place)>,
    pub failures: Vec<String>,
}

/// Reads the zones' pictures: they themselves come and go like all others.
pub fn load_world_image(source: &Source, renderer: &mut Renderer) -> WorldImageLoad {
    let mut load = WorldImageLoad::default();
    let mut server = InlineServer::new(source.reader.clone());
    for (id, root) in (0..).zip(source.index.trees().map(|tree| tree.root())) {
        let Some(place) = root.imagery() else { continue };
        let page = PageId { cell: root.cell(), kind: PageKind::Imagery };
        server.start(RangeRead::of_page(id, page, place));
    }
    while let Some(Delivery { page, place, outcome, .. }) = server.poll() {
        load.read.push((page, place));
        match outcome {
            Outcome::Loaded(Page::Imagery(picture)) => renderer.add_to_world_image(&picture),
            Outcome::Loaded(_) | Outcome::Cancelled => {}
            Outcome::Failed(error) => load.failures.push(error.to_string()),
        }
    }
    renderer.flush_uploads();
    load
}
