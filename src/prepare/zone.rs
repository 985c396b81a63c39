//! The pages of a zone in the order in which they lie in its pack: the children of a cell together, then what is below
//! each of them; a cell's imagery behind its terrain.

use super::task::{Stopped, Task};
use super::terrain::{self, Truth, ZonePlan};
use super::{Pictures, imagery};
use crate::content::TerrainPage;
use crate::forest::{CellId, Zone};
use crate::store;
use rayon::prelude::*;
use std::collections::BTreeSet;

/// Subtrees of up to this many cells are made in parallel and wait in memory for their turn.
const GATHERED_CELLS: usize = 2048;

/// The encoded pages of a cell.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CellPages {
    pub terrain: Option<EncodedTerrain>,
    pub imagery: Option<Vec<u8>>,
}

#[derive(Clone, Debug, PartialEq)]
pub struct EncodedTerrain {
    pub bytes: Vec<u8>,
    pub error_m: f32,
    /// Lowest and highest post, metres.
    pub height_range_m: (f32, f32),
}

/// Why pages could not be made or put away.
#[derive(Debug, thiserror::Error)]
pub enum EmitError<E> {
    #[error(transparent)]
    Stopped(#[from] Stopped),
    #[error(transparent)]
    Encode(#[from] store::EncodeError),
    #[error("{0}")]
    Sink(E),
}

type Made = (CellId, Option<TerrainPage>, CellPages);

/// What the pages of a zone are made of.
pub struct ZonePages<'a> {
    pub truth: &'a dyn Truth,
    pub terrain: &'a ZonePlan,
    pub pictures: &'a Pictures,
    pub imagery: &'a BTreeSet<CellId>,
    pub task: &'a Task<'a>,
}

impl ZonePages<'_> {
    /// Hands over all pages in their order.
    pub fn emit<E: Send>(
        &self,
        zone: Zone,
        sink: &mut dyn FnMut(CellId, CellPages) -> Result<(), E>,
    ) -> Result<(), EmitError<E>> {
        let (root, page, pages) = self.make(zone.root(), None)?;
        sink(root, pages).map_err(EmitError::Sink)?;
        self.emit_below(root, page.as_ref(), sink)
    }

    fn emit_below<E: Send>(
        &self,
        cell: CellId,
        page: Option<&TerrainPage>,
        sink: &mut dyn FnMut(CellId, CellPages) -> Result<(), E>,
    ) -> Result<(), EmitError<E>> {
        if self.count_below(cell) <= GATHERED_CELLS {
            for (cell, pages) in self.gather_below(cell, page)? {
                sink(cell, pages).map_err(EmitError::Sink)?;
            }
            return Ok(());
        }
        let mut made = self.make_children(cell, page)?;
        for (child, _, pages) in &mut made {
            sink(*child, std::mem::take(pages)).map_err(EmitError::Sink)?;
        }
        made.iter().try_for_each(|(child, page, _)| self.emit_below(*child, page.as_ref(), sink))
    }

    fn gather_below<E: Send>(
        &self,
        cell: CellId,
        page: Option<&TerrainPage>,
    ) -> Result<Vec<(CellId, CellPages)>, EmitError<E>> {
        let mut made = self.make_children(cell, page)?;
        let mut pages: Vec<_> = made.iter_mut().map(|(child, _, pages)| (*child, std::mem::take(pages))).collect();
        let below: Result<Vec<_>, EmitError<E>> =
            made.par_iter().map(|(child, page, _)| self.gather_below(*child, page.as_ref())).collect();
        pages.extend(below?.into_iter().flatten());
        Ok(pages)
    }

    fn make_children<E: Send>(&self, cell: CellId, page: Option<&TerrainPage>) -> Result<Vec<Made>, EmitError<E>> {
        let children: Vec<_> = cell.children().filter(|child| self.exists(*child)).collect();
        children.into_par_iter().map(|child| self.make(child, page)).collect()
    }

    fn make<E: Send>(&self, cell: CellId, parent: Option<&TerrainPage>) -> Result<Made, EmitError<E>> {
        self.task.step()?;
        let page = self.terrain.get(&cell).map(|plan| terrain::build(self.truth, cell, plan, parent));
        let terrain = page.as_ref().map(encode_terrain).transpose()?;
        let texels = self.imagery.contains(&cell).then(|| imagery::texels(self.pictures, cell));
        let imagery = texels.map(|rgb| store::encode_imagery(cell, &rgb, store::JPEG_QUALITY)).transpose()?;
        Ok((cell, page, CellPages { terrain, imagery }))
    }

    fn exists(&self, cell: CellId) -> bool {
        self.terrain.contains_key(&cell) || self.imagery.contains(&cell)
    }

    /// Cells below a cell; those with both layers count twice.
    fn count_below(&self, cell: CellId) -> usize {
        self.terrain.range(cell.subtree()).count() + self.imagery.range(cell.subtree()).count()
    }
}

fn encode_terrain(page: &TerrainPage) -> Result<EncodedTerrain, store::EncodeError> {
    let heights = page.posts.iter().map(|post| post.height_m);
    let range = heights.fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), h| (low.min(h), high.max(h)));
    Ok(EncodedTerrain {
        bytes: store::encode_terrain(page, store::height_step_m(page.error_m))?,
        error_m: page.error_m,
        height_range_m: range,
    })
}
