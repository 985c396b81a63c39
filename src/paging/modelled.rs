//! Over-modelling: what a frame draws and holds beyond what its picture needs.

use super::FrameReport;
use crate::camera::View;
use crate::forest::index::IndexForest;
use crate::select::{SelectParams, Selection, StoredPages, needed};

/// Counts of one frame, all without occlusion.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Modelled {
    /// Of the frame's pieces, cut as they are drawn and with their skirts, and of its objects.
    pub drawn_triangles: u64,
    /// Those with a part in view, and all of the reps that those belong to; see [`crate::select::Needed`].
    pub needed_triangles: u64,
    pub front_triangles: u64,
    pub view_cut_triangles: u64,
    /// Of the needed triangles those of the ground: what a cut over the whole view is compared with.
    pub needed_ground_triangles: u64,
    /// Stored bytes of pages that were read and are still held, and of those needed.
    pub resident_bytes: u64,
    pub needed_bytes: u64,
}

impl Modelled {
    /// Measures a selection. `resident_bytes` are stored bytes that are held.
    pub fn of(
        index: &IndexForest,
        view: &View,
        params: &SelectParams,
        selection: &Selection,
        pages: &dyn StoredPages,
        resident_bytes: u64,
    ) -> Self {
        let needed = needed(index, view, params, pages);
        Self {
            drawn_triangles: drawn_triangles(view, selection),
            needed_triangles: needed.triangles(),
            front_triangles: needed.front_triangles(),
            view_cut_triangles: needed.view_cut_triangles,
            needed_ground_triangles: needed.terrain_triangles,
            resident_bytes,
            needed_bytes: needed.pages.values().map(|place| u64::from(place.len)).sum(),
        }
    }
}

impl FrameReport {
    pub fn take_modelled(&mut self, modelled: &Modelled) {
        self.modelled_triangles = Some(modelled.drawn_triangles);
        self.needed_triangles = Some(modelled.needed_triangles);
        self.front_triangles = Some(modelled.front_triangles);
        self.needed_ground_triangles = Some(modelled.needed_ground_triangles);
        self.view_cut_triangles = Some(modelled.view_cut_triangles);
        self.resident_bytes = Some(modelled.resident_bytes);
        self.needed_bytes = Some(modelled.needed_bytes);
    }

    /// Drawn over needed triangles; aim: at most 1.3.
    pub fn drawn_over_needed(&self) -> Option<f64> {
        share(self.modelled_triangles, self.needed_triangles)
    }

    /// Drawn triangles over those of the needed reps, which the view need not hold wholly.
    pub fn drawn_over_front(&self) -> Option<f64> {
        share(self.modelled_triangles, self.front_triangles)
    }

    /// Held over needed bytes, as stored.
    pub fn resident_over_needed(&self) -> Option<f64> {
        share(self.resident_bytes, self.needed_bytes)
    }

    /// The ground's needed triangles over those of one cut over the whole view.
    pub fn needed_over_view_cut(&self) -> Option<f64> {
        share(self.needed_ground_triangles, self.view_cut_triangles)
    }
}

fn share(of: Option<u64>, whole: Option<u64>) -> Option<f64> {
    let (of, whole) = of.zip(whole)?;
    (whole > 0).then(|| of as f64 / whole as f64)
}

/// Triangles as the renderer draws them: lists for later views hold pieces beside this one too.
fn drawn_triangles(view: &View, selection: &Selection) -> u64 {
    let frustum = view.frustum();
    let in_view = selection.pieces.iter().filter(|piece| frustum.meets(&piece.around));
    let ground = in_view.map(|piece| piece.terrain.cut(piece.cell).indices.len() as u64 / 3);
    let runs = selection.objects.iter().flat_map(|drawn| {
        let indices = |range: &std::ops::Range<u32>| drawn.page.indices_of(range.clone());
        drawn.objects.iter().map(indices)
    });
    ground.sum::<u64>() + runs.map(|run| u64::from(run.end - run.start) / 3).sum::<u64>()
}
