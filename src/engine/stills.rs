//! Pictures of selections that were made elsewhere, as a flight by the virtual clock makes them: its pages carry no
//! texels, so what a picture shows is read for that picture. Nothing of this counts in the flight's report.

use super::audit::Auditor;
use super::footprint::{FLUSH_BYTES, MESH_MIN_BYTES, MESH_SHARE, SLACK_BYTES};
use super::lift::Lifts;
use super::picture::LastPicture;
use super::world_image::load_world_image;
use super::{EngineError, EngineParams, FrameReport, FrameRequest, Source};
use crate::content::{Page, PageId, PageKind};
use crate::forest::index::IndexForest;
use crate::paging::drawn_pages;
use crate::render::{ArenaFull, DrawOptions, GpuLimits, RenderError, Renderer};
use crate::select::Selection;
use std::collections::{BTreeSet, HashSet};

/// Pages that could not be read and are not tried again; any more are.
const UNREADABLE_MAX: usize = 1024;

/// A renderer with the pages of the selection that it drew last, and no others.
pub struct Stills {
    source: Source,
    renderer: Renderer,
    auditor: Auditor,
    /// Pictures and objects in the arenas.
    uploaded: HashSet<PageId>,
    lifts: Lifts,
    unreadable: HashSet<PageId>,
    messages: Vec<String>,
    /// Uploaded since the driver last let go of its copies.
    unflushed_bytes: u64,
}

impl Stills {
    /// Opens the renderer. `params` are those that the selections are made by.
    pub fn open(source: Source, params: &EngineParams) -> Result<Self, EngineError> {
        let mut renderer = Renderer::new(limits(params.footprint.0))?;
        let messages = load_world_image(&source, &mut renderer).failures;
        Ok(Self {
            renderer,
            auditor: Auditor::new(&source, params),
            source,
            uploaded: HashSet::new(),
            lifts: Lifts::default(),
            unreadable: HashSet::new(),
            messages,
            unflushed_bytes: 0,
        })
    }

    pub fn adapter_name(&self) -> &str {
        self.renderer.adapter_name()
    }

    /// Draws a selection as the view of `request` sees it. `index` is the one that it was selected by.
    pub fn draw(
        &mut self,
        index: &IndexForest,
        selection: &Selection,
        request: &FrameRequest,
    ) -> Result<(), EngineError> {
        self.bring(index, selection)?;
        if !index.is_whole() {
            self.lifts.look_again();
        }
        self.lifts.follow(index, selection, |page, lifts_m| self.renderer.set_lifts(page, lifts_m));
        let options = DrawOptions { aov: request.ids, ..DrawOptions::default() };
        self.renderer.draw(&request.view, selection, &options)?;
        Ok(())
    }

    /// The last picture, to be read back.
    pub fn picture(&self) -> LastPicture<'_> {
        LastPicture::new(&self.renderer, &self.source.manifest)
    }

    /// Compares the picture just drawn, with ids, with the settled frame of its view, and completes the report of its
    /// frame.
    pub fn audit(&mut self, request: &FrameRequest, report: &mut FrameReport) -> Result<(), EngineError> {
        let drawn = self.picture().read_ids()?;
        self.auditor.audit(&drawn, request, report)
    }

    /// Messages of pages that could not be read since the last call, each page once; what is coarser stands in for them.
    pub fn take_failures(&mut self) -> Vec<String> {
        std::mem::take(&mut self.messages)
    }

    /// Has in the arenas what a selection draws, and nothing else.
    fn bring(&mut self, index: &IndexForest, selection: &Selection) -> Result<(), EngineError> {
        let mut begins_anew = false;
        loop {
            let unreadable = self.unreadable.len();
            let wanted = self.wanted(selection);
            self.drop_others(&wanted);
            match self.upload_all(index, &wanted) {
                // What could not be read has a coarser page that stands in for it.
                Ok(()) if self.unreadable.len() > unreadable => {}
                Ok(()) => return Ok(()),
                // Pages that went have left holes.
                Err(_) if !begins_anew => {
                    begins_anew = true;
                    self.drop_others(&BTreeSet::new());
                }
                Err(full) => return Err(RenderError::Device(full.to_string()).into()),
            }
        }
    }

    /// The pages that go to the GPU; terrain is drawn as it comes with the selection.
    fn wanted(&self, selection: &Selection) -> BTreeSet<PageId> {
        drawn_pages(selection).filter_map(|page| self.readable(page)).collect()
    }

    /// A page, or what stands in for it.
    fn readable(&self, page: PageId) -> Option<PageId> {
        let is_readable = |page: &PageId| !self.unreadable.contains(page);
        match page.kind {
            PageKind::Terrain | PageKind::Segment => None,
            PageKind::Imagery => page.cell.ancestors().map(|cell| PageId { cell, ..page }).find(is_readable),
            PageKind::Objects { .. } => Some(page).filter(is_readable),
        }
    }

    fn drop_others(&mut self, wanted: &BTreeSet<PageId>) {
        for page in self.uploaded.extract_if(|page| !wanted.contains(page)) {
            self.renderer.remove(page);
            self.lifts.forget(page);
        }
    }

    fn upload_all(&mut self, index: &IndexForest, wanted: &BTreeSet<PageId>) -> Result<(), ArenaFull> {
        for &page in wanted {
            if !self.uploaded.contains(&page)
                && let Some(loaded) = self.load(index, page)
            {
                self.upload(&loaded)?;
            }
        }
        Ok(())
    }

    fn load(&mut self, index: &IndexForest, page: PageId) -> Option<Page> {
        // A page that is drawn lies somewhere; the pictures above it need not.
        let place = page.place(index)?;
        match self.source.reader.load(page, place) {
            Ok(loaded) => Some(loaded),
            Err(error) => {
                if self.unreadable.len() < UNREADABLE_MAX && self.unreadable.insert(page) {
                    self.messages.push(error.to_string());
                }
                None
            }
        }
    }

    fn upload(&mut self, page: &Page) -> Result<(), ArenaFull> {
        self.unflushed_bytes += self.renderer.upload(page)?;
        self.uploaded.insert(page.id());
        // The driver holds what is uploaded a second time until it is told to go on.
        if self.unflushed_bytes >= FLUSH_BYTES {
            self.unflushed_bytes = 0;
            self.renderer.flush_uploads();
        }
        Ok(())
    }
}

/// What a selection draws fits into its flight's footprint; arenas have chunks that are only begun on top.
fn limits(footprint_bytes: u64) -> GpuLimits {
    let arena_bytes = footprint_bytes.saturating_add(SLACK_BYTES);
    let mesh_bytes = (footprint_bytes / MESH_SHARE).max(MESH_MIN_BYTES);
    GpuLimits { imagery_bytes: arena_bytes, mesh_bytes, objects_bytes: arena_bytes }
}
