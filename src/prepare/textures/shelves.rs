//! Boxes side by side on shelves, the highest first (next-fit decreasing height; Coffman, Garey, Johnson, Tarjan 1980).

use crate::content::{ATLAS_SIDE_MAX, Atlas};

/// Where boxes lie, and the sides of what holds them.
#[derive(Clone, Debug, PartialEq)]
pub struct Layout {
    pub size_px: [u32; 2],
    /// Left and upper end of each box, in the order given.
    pub places: Vec<[u32; 2]>,
}

/// The layout of least area in an atlas's bounds; `None` where there is none. Sides of boxes are multiples of what an
/// atlas is aligned to.
pub fn layout(boxes: &[[u32; 2]]) -> Option<Layout> {
    let mut order: Vec<usize> = (0..boxes.len()).collect();
    order.sort_by_key(|&at| (std::cmp::Reverse(boxes[at][1]), std::cmp::Reverse(boxes[at][0]), at));
    let widest = boxes.iter().map(|side| side[0]).max()?;
    let widths = (4..=ATLAS_SIDE_MAX.ilog2()).map(|power| 1 << power).chain([widest]).filter(|&width| width >= widest);
    let layouts = widths.map(|width| on_shelves(boxes, &order, width));
    let fitting = layouts.filter(|layout| Atlas::is_size(layout.size_px[0], layout.size_px[1]));
    fitting.min_by_key(|layout| layout.size_px[0] * layout.size_px[1])
}

fn on_shelves(boxes: &[[u32; 2]], order: &[usize], width: u32) -> Layout {
    let mut places = vec![[0; 2]; boxes.len()];
    let (mut x, mut y, mut shelf) = (0, 0, 0);
    for &at in order {
        let [wide, high] = boxes[at];
        if x + wide > width {
            (x, y, shelf) = (0, y + shelf, 0);
        }
        places[at] = [x, y];
        x += wide;
        shelf = shelf.max(high);
    }
    Layout { size_px: [width, y + shelf], places }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn boxes_lie_inside_and_apart(sides in proptest::collection::vec((1u32..20, 1u32..20), 1..60)) {
            let boxes: Vec<[u32; 2]> = sides.into_iter().map(|(wide, high)| [8 * wide, 8 * high]).collect();
            let Some(layout) = layout(&boxes) else {
                return Err(TestCaseError::reject("too many"));
            };
            let ends = |at: usize| (0..2).map(|axis| (layout.places[at][axis], layout.places[at][axis] + boxes[at][axis])).collect::<Vec<_>>();
            for a in 0..boxes.len() {
                let ends_a = ends(a);
                prop_assert!((0..2).all(|axis| ends_a[axis].1 <= layout.size_px[axis]));
                for b in 0..a {
                    let ends_b = ends(b);
                    prop_assert!((0..2).any(|axis| ends_a[axis].1 <= ends_b[axis].0 || ends_b[axis].1 <= ends_a[axis].0));
                }
            }
        }
    }
}
