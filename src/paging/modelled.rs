//! Over-modelling: what a frame draws and holds beyond what its picture needs.

use super::FrameReport;
use crate::camera::View;
use crate::forest::index::Place;
use crate::select::{Needed, Seen, Selection};

/// Counts of one frame. What is needed is so without occlusion; what is seen, with it.
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
    /// Of those needed, what is not wholly behind something nearer; `None` where it was not looked for.
    pub seen_triangles: Option<u64>,
    pub seen_bytes: Option<u64>,
}

impl Modelled {
    /// Holds a selection against what its view needs, and against what of that shows where it is known. `resident_bytes`
    /// are stored bytes that are held.
    pub fn of(view: &View, selection: &Selection, needed: &Needed, seen: Option<&Seen>, resident_bytes: u64) -> Self {
        Self {
            drawn_triangles: drawn_triangles(view, selection),
            needed_triangles: needed.triangles(),
            front_triangles: needed.front_triangles(),
            view_cut_triangles: needed.view_cut_triangles,
            needed_ground_triangles: needed.terrain_triangles,
            resident_bytes,
            needed_bytes: stored_bytes(needed.pages.values()),
            seen_triangles: seen.map(Seen::triangles),
            seen_bytes: seen.map(|seen| stored_bytes(seen.pages.values())),
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
        self.seen_triangles = modelled.seen_triangles;
        self.seen_bytes = modelled.seen_bytes;
    }

    /// Drawn over needed triangles, occlusion left out; aim: at most 1.3.
    pub fn drawn_over_needed(&self) -> Option<f64> {
        share(self.modelled_triangles, self.needed_triangles)
    }

    /// Drawn triangles over those of the needed reps, which the view need not hold wholly.
    pub fn drawn_over_front(&self) -> Option<f64> {
        share(self.modelled_triangles, self.front_triangles)
    }

    /// Drawn triangles over those needed that nothing nearer hides.
    pub fn drawn_over_seen(&self) -> Option<f64> {
        share(self.modelled_triangles, self.seen_triangles)
    }

    /// Held bytes over those of pages needed that something shows of, as stored.
    pub fn resident_over_seen(&self) -> Option<f64> {
        share(self.resident_bytes, self.seen_bytes)
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

fn stored_bytes<'a>(places: impl Iterator<Item = &'a Place>) -> u64 {
    places.map(|place| u64::from(place.len)).sum()
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
