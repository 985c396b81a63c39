//! Looks around from places by settled pictures of ids: what is in sight there, and what is hidden.

use super::{Engine, EngineError, EngineParams, FrameRequest, Mode, Source};
use crate::camera::View;
use crate::content::{PageId, PageKind};
use crate::geodesy::Geodetic;
use crate::layout::{LayoutParams, Seen, Witness, directions, octant_fov_rad, octant_px};
use crate::render::IdOf;
use crate::units::ByteSize;
use std::collections::{BTreeSet, HashMap};

/// Side of a picture, pixels, unless another is asked for.
pub const LOOKOUT_PX: u32 = 512;

/// Takes pictures in eight directions, and reads what they show.
pub struct Lookout {
    engine: Engine,
    size_px: [u32; 2],
    pictures: u64,
}

/// An object in sight: the page that drew it, and its number.
pub type SeenObject = (PageId, u32);

impl Lookout {
    /// Pictures of `side_px`, drawn with the reps that views of `params` have, whatever their own size.
    pub fn new(source: Source, params: &LayoutParams, side_px: u32, footprint: ByteSize) -> Result<Self, EngineError> {
        let coarser = f64::from(side_px) / octant_px(params.focal_px);
        let params = EngineParams {
            tolerance_px: params.tolerance_px * coarser,
            threshold_px: params.threshold_px * coarser,
            mode: Mode::Settled,
            footprint,
            ..EngineParams::default()
        };
        Ok(Self { engine: Engine::new(source, params)?, size_px: [side_px; 2], pictures: 0 })
    }

    /// Pictures taken so far.
    pub fn pictures(&self) -> u64 {
        self.pictures
    }

    /// What is in sight from a place, and each object there for itself.
    pub fn look(&mut self, eye: Geodetic) -> Result<(Seen, BTreeSet<SeenObject>), EngineError> {
        let (mut seen, mut objects) = (Seen::default(), BTreeSet::new());
        for pose in directions(eye) {
            let view = View::new(pose, octant_fov_rad(), self.size_px);
            self.engine.frame(&FrameRequest { view, t_s: self.pictures as f64, ids: true })?;
            self.pictures += 1;
            let ids: BTreeSet<u32> = self.engine.picture().read_ids()?.into_iter().collect();
            let mut pages: HashMap<(u8, u32), Vec<PageId>> = HashMap::new();
            for drawn in &self.engine.drawn().objects {
                let all = drawn.objects.iter().cloned().flatten();
                for object in all.filter_map(|at| drawn.page.objects.get(at as usize)) {
                    let kind = PageKind::Objects { collection: drawn.page.collection, rep: drawn.page.rep };
                    let page = PageId { cell: drawn.page.root, kind };
                    pages.entry((drawn.page.collection, object.id)).or_default().push(page);
                }
            }
            for id in ids {
                match self.engine.picture().resolve_id(id) {
                    Some(IdOf::Cell(cell)) => seen.add_ground(cell),
                    Some(IdOf::Object { collection, id }) => {
                        for &page in pages.get(&(collection, id)).into_iter().flatten() {
                            seen.add_objects(collection, page.cell);
                            objects.insert((page, id));
                        }
                    }
                    None => {}
                }
            }
        }
        Ok((seen, objects))
    }
}

impl Witness for Lookout {
    fn seen(&mut self, eye: Geodetic) -> Result<Seen, String> {
        self.look(eye).map(|(seen, _)| seen).map_err(|error| error.to_string())
    }
}
