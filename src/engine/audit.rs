//! Holes: what a settled frame covers and a frame does not.

use super::{Engine, EngineError, EngineParams, FrameReport, FrameRequest, Mode, Partition, Reading, Source};
use crate::render::{SKY_ID, is_cell};

/// Silhouettes are looked for no further than this, pixels.
const REACH_MAX_PX: usize = 64;

/// Pixels of a frame that show the sky where the settled frame of the same view shows something.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Uncovered {
    /// All of them.
    pixels: u64,
    /// Those further inside, and from the picture's edge, than a silhouette may move: drawn error shifts the border
    /// against the sky, and is counted as error already.
    holes: u64,
}

/// Compares frames with the settled frames of their views, which an engine of its own makes.
pub struct Auditor {
    source: Source,
    params: EngineParams,
    /// Opened when first needed.
    twin: Option<Box<Engine>>,
}

impl Auditor {
    /// `params` are those of the frames; settled frames have no less than the footprint that they need.
    pub fn new(source: &Source, params: &EngineParams) -> Self {
        let footprint = params.footprint.max(Partition::least(Reading::of(Mode::Settled, source), &source.index));
        let params = EngineParams { mode: Mode::Settled, footprint, ..*params };
        Self { source: source.clone(), params, twin: None }
    }

    /// Completes the report of a frame, given the ids that it drew.
    pub fn audit(
        &mut self,
        drawn: &[u32],
        request: &FrameRequest,
        report: &mut FrameReport,
    ) -> Result<(), EngineError> {
        let uncovered = if may_have_holes(drawn) {
            let settled = self.settled_ids(request)?;
            compare(drawn, &settled, request.view.size_px[0] as usize, Silhouettes::of(report))
        } else {
            Uncovered::default()
        };
        report.holes = Some(uncovered.holes);
        report.uncovered_px = Some(uncovered.pixels);
        Ok(())
    }

    fn settled_ids(&mut self, request: &FrameRequest) -> Result<Vec<u32>, EngineError> {
        let twin = match &mut self.twin {
            Some(twin) => twin,
            none => none.insert(Box::new(Engine::new(self.source.clone(), self.params)?)),
        };
        twin.frame(&FrameRequest { ids: true, ..*request })?;
        Ok(twin.picture().read_ids()?)
    }
}

/// A frame without sky has no hole, whatever the settled one shows.
fn may_have_holes(drawn: &[u32]) -> bool {
    drawn.contains(&SKY_ID)
}

/// How far silhouettes may move in a frame, pixels: by the error that was allowed and what was still owed, and by the
/// pixel's rounding. What an absent object owes does not excuse the ground.
#[derive(Clone, Copy, Debug)]
struct Silhouettes {
    ground_px: usize,
    objects_px: usize,
}

impl Silhouettes {
    fn of(report: &FrameReport) -> Self {
        let reach = |excess_px: f64| {
            let allowed_px = (report.tolerance_drawn_px + excess_px).ceil();
            (allowed_px.clamp(1.0, REACH_MAX_PX as f64) as usize).max(1)
        };
        Self { ground_px: reach(report.terrain_excess_max_px), objects_px: reach(report.excess_max_px) }
    }

    fn reach_px(self, settled_id: u32) -> usize {
        if is_cell(settled_id) { self.ground_px } else { self.objects_px }
    }
}

/// Compares ids of the same view, rows from the top.
fn compare(drawn: &[u32], settled: &[u32], width_px: usize, silhouettes: Silhouettes) -> Uncovered {
    let mut uncovered = Uncovered::default();
    for (at, (&drawn, &wanted)) in drawn.iter().zip(settled).enumerate() {
        if drawn == SKY_ID && wanted != SKY_ID {
            uncovered.pixels += 1;
            let reach_px = silhouettes.reach_px(wanted);
            uncovered.holes += u64::from(!is_near_sky(settled, width_px, at, reach_px));
        }
    }
    uncovered
}

fn is_near_sky(ids: &[u32], width_px: usize, at: usize, reach_px: usize) -> bool {
    let (x, y) = (at % width_px, at / width_px);
    let height_px = ids.len() / width_px;
    // Beyond the picture's edge there may be sky.
    if x < reach_px || y < reach_px || x + reach_px >= width_px || y + reach_px >= height_px {
        return true;
    }
    let columns = x - reach_px..x + reach_px + 1;
    (y - reach_px..=y + reach_px).any(|row| ids[row * width_px..][columns.clone()].contains(&SKY_ID))
}

#[cfg(test)]
mod tests {
    use super::*;

    const NARROW: Silhouettes = Silhouettes { ground_px: 1, objects_px: 1 };

    #[test]
    fn sky_inside_what_the_settled_frame_covers_is_a_hole_and_a_moved_border_is_not() {
        // The upper row of the settled frame is sky.
        let settled = [[0; 5], [7; 5], [7; 5], [7; 5], [7; 5]].concat();
        let mut drawn = settled.clone();
        drawn[5 + 2] = 0;
        assert_eq!(compare(&drawn, &settled, 5, NARROW), Uncovered { pixels: 1, holes: 0 });
        drawn[3 * 5 + 1] = 0;
        assert_eq!(compare(&drawn, &settled, 5, NARROW), Uncovered { pixels: 2, holes: 1 });
        drawn[4 * 5] = 0;
        assert_eq!(compare(&drawn, &settled, 5, NARROW), Uncovered { pixels: 3, holes: 1 }, "the picture's edge");
        assert!(may_have_holes(&drawn) && !may_have_holes(&[3, 4]));
        // What the settled frame does not show either is no hole.
        assert_eq!(compare(&[0; 25], &[0; 25], 5, NARROW), Uncovered::default());
    }
}
