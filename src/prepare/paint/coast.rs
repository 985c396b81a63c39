//! The sea of an extract: coastlines have land on their left (OSM wiki, *Tag:natural=coastline*), so that what lies
//! on their right, up to the extract's border, is water.

use crate::prepare::vector::osm::{OsmFile, Piece, area, contains};
use crate::prepare::vector::{FootprintPolygon, Ring};

/// An end of a coastline that stops inside is led to the border, if that is within this share of the extract's size.
const LEAD_MAX: f64 = 0.3;

/// Share of an extract's buildings that may stand in one sea.
const BUILT_MAX: f64 = 0.2;

/// Water areas within the extract's bounds, degrees; none where coastlines do not close.
pub fn sea(osm: &OsmFile) -> Vec<FootprintPolygon> {
    let ways = osm.ways.iter().filter(|way| way.tags.get("natural").is_some_and(|value| value == "coastline"));
    let pieces: Vec<Piece> = ways.flat_map(|way| osm.pieces(way)).filter(|piece| piece.points.len() >= 2).collect();
    let mut seas = close(join(pieces.into_iter().map(|piece| piece.points).collect()), osm.bounds_deg);
    let buildings: Vec<[f64; 2]> = osm
        .ways
        .iter()
        .filter(|way| way.tags.contains_key("building"))
        .filter_map(|way| osm.line(way).first().copied())
        .collect();
    seas.retain(|sea| !is_built_on(sea, &buildings));
    seas
}

/// Coasts that are cut off where they should not be can turn land into water; a sea full of houses is none.
fn is_built_on(sea: &FootprintPolygon, buildings: &[[f64; 2]]) -> bool {
    let drowned = buildings.iter().filter(|&&place| contains(&sea[0], place)).count();
    drowned as f64 > BUILT_MAX * buildings.len() as f64
}

/// Joins lines end to start.
fn join(mut lines: Vec<Ring>) -> Vec<Ring> {
    let mut joined = Vec::new();
    while let Some(mut line) = lines.pop() {
        loop {
            let (first, last) = (line[0], line[line.len() - 1]);
            if first == last {
                break;
            }
            if let Some(next) = lines.iter().position(|other| other[0] == last) {
                let other = lines.swap_remove(next);
                line.extend_from_slice(&other[1..]);
            } else if let Some(previous) = lines.iter().position(|other| other[other.len() - 1] == first) {
                let mut other = lines.swap_remove(previous);
                other.extend_from_slice(&line[1..]);
                line = other;
            } else {
                break;
            }
        }
        joined.push(line);
    }
    joined
}

/// Closes open coasts along the border, clockwise, so that the water is inside; islands are holes.
fn close(lines: Vec<Ring>, bounds: [f64; 4]) -> Vec<FootprintPolygon> {
    let (closed, open): (Vec<Ring>, Vec<Ring>) = lines.into_iter().partition(|line| line[0] == line[line.len() - 1]);
    let frame = Frame { bounds };
    let mut coasts: Vec<Coast> = open.into_iter().flat_map(|line| frame.clip(&line)).collect();
    let mut seas: Vec<FootprintPolygon> = Vec::new();
    while let Some(first) = coasts.pop() {
        let mut ring = first.points;
        let mut leaves = first.leaves;
        loop {
            // The next coast that begins clockwise from where this one left.
            let next = (0..coasts.len()).min_by(|&a, &b| {
                let way = |at: usize| frame.clockwise(leaves, coasts[at].enters);
                way(a).total_cmp(&way(b))
            });
            let home = frame.clockwise(leaves, first.enters);
            match next.filter(|&at| frame.clockwise(leaves, coasts[at].enters) < home) {
                Some(at) => {
                    let coast = coasts.swap_remove(at);
                    ring.extend(frame.corners(leaves, coast.enters));
                    ring.extend(coast.points);
                    leaves = coast.leaves;
                }
                None => {
                    ring.extend(frame.corners(leaves, first.enters));
                    break;
                }
            }
        }
        seas.push(vec![ring]);
    }
    // Islands run counter-clockwise; lakes that are mapped as coastline run clockwise.
    let (islands, lakes): (Vec<Ring>, Vec<Ring>) = closed.into_iter().partition(|ring| area(ring) > 0.0);
    for island in islands {
        if let Some(sea) = seas.iter_mut().find(|sea| contains(&sea[0], island[0])) {
            sea.push(island);
        }
    }
    seas.extend(lakes.into_iter().map(|lake| vec![lake]));
    seas
}

/// A run of coastline through the extract, from border to border.
struct Coast {
    points: Ring,
    /// Places on the border, as in [`Frame::along`].
    enters: f64,
    leaves: f64,
}

/// The extract's border.
struct Frame {
    bounds: [f64; 4],
}

impl Frame {
    /// The runs of a line inside, with ends that stop inside led to the border.
    fn clip(&self, line: &Ring) -> Vec<Coast> {
        let mut runs: Vec<Ring> = Vec::new();
        let mut run: Ring = Vec::new();
        for pair in line.windows(2) {
            let Some((a, b)) = self.segment(pair[0], pair[1]) else {
                runs.extend((!run.is_empty()).then(|| std::mem::take(&mut run)));
                continue;
            };
            if run.last() != Some(&a) {
                runs.extend((!run.is_empty()).then(|| std::mem::take(&mut run)));
                run.push(a);
            }
            run.push(b);
        }
        runs.extend((!run.is_empty()).then_some(run));
        runs.into_iter().filter_map(|run| self.coast(run)).collect()
    }

    fn coast(&self, run: Ring) -> Option<Coast> {
        let start = self.nearest(run[0])?;
        let end = self.nearest(run[run.len() - 1])?;
        let points = std::iter::once(start).chain(run).chain(std::iter::once(end)).collect();
        Some(Coast { points, enters: self.along(start), leaves: self.along(end) })
    }

    /// The part of a segment inside (Liang & Barsky 1984).
    fn segment(&self, a: [f64; 2], b: [f64; 2]) -> Option<([f64; 2], [f64; 2])> {
        let (mut from, mut to) = (0.0f64, 1.0f64);
        for axis in 0..2 {
            let run = b[axis] - a[axis];
            for (distance, step) in [(a[axis] - self.bounds[axis], -run), (self.bounds[axis + 2] - a[axis], run)] {
                if step == 0.0 {
                    if distance < 0.0 {
                        return None;
                    }
                } else if step < 0.0 {
                    from = from.max(distance / step);
                } else {
                    to = to.min(distance / step);
                }
            }
        }
        let at = |t: f64| [a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])];
        (from < to).then(|| (if from == 0.0 { a } else { at(from) }, if to == 1.0 { b } else { at(to) }))
    }

    /// The nearest place on the border; `None` when it is far.
    fn nearest(&self, p: [f64; 2]) -> Option<[f64; 2]> {
        let [west, south, east, north] = self.bounds;
        let ways = [
            (p[0] - west, [west, p[1]]),
            (east - p[0], [east, p[1]]),
            (p[1] - south, [p[0], south]),
            (north - p[1], [p[0], north]),
        ];
        let nearest = ways.into_iter().min_by(|a, b| a.0.total_cmp(&b.0))?;
        (nearest.0 < LEAD_MAX * (east - west).min(north - south)).then_some(nearest.1)
    }

    /// Where on the border a place lies: 0 at the south-west corner, growing clockwise by 1 a side.
    fn along(&self, p: [f64; 2]) -> f64 {
        let [west, south, east, north] = self.bounds;
        let (u, v) = ((p[0] - west) / (east - west), (p[1] - south) / (north - south));
        let sides = [(u, v), (1.0 - v, 1.0 + u), (1.0 - u, 2.0 + (1.0 - v)), (v, 3.0 + (1.0 - u))];
        sides.into_iter().min_by(|a, b| a.0.abs().total_cmp(&b.0.abs())).map_or(0.0, |side| side.1)
    }

    /// How far it is clockwise from one place on the border to another, in sides.
    fn clockwise(&self, from: f64, to: f64) -> f64 {
        (to - from).rem_euclid(4.0)
    }

    /// Corners passed clockwise between two places.
    fn corners(&self, from: f64, to: f64) -> Vec<[f64; 2]> {
        let [west, south, east, north] = self.bounds;
        let corners = [[west, south], [west, north], [east, north], [east, south]];
        let way = self.clockwise(from, to);
        let first = from.floor() as usize + 1;
        (first..first + 4).take_while(|&corner| corner as f64 - from < way).map(|corner| corners[corner % 4]).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BOUNDS: [f64; 4] = [0.0, 0.0, 10.0, 10.0];

    fn water(seas: &[FootprintPolygon], p: [f64; 2]) -> bool {
        seas.iter().any(|sea| contains(&sea[0], p) && !sea[1..].iter().any(|island| contains(island, p)))
    }

    #[test]
    fn water_is_right_of_the_coast() {
        // Eastward: land in the north.
        let east = close(vec![vec![[-1.0, 4.0], [5.0, 5.0], [11.0, 4.0]]], BOUNDS);
        assert!(water(&east, [5.0, 2.0]) && !water(&east, [5.0, 7.0]));
        let west = close(vec![vec![[11.0, 4.0], [5.0, 5.0], [-1.0, 4.0]]], BOUNDS);
        assert!(!water(&west, [5.0, 2.0]) && water(&west, [5.0, 7.0]));
    }

    #[test]
    fn straits_and_islands() {
        let north = vec![[-1.0, 7.0], [11.0, 7.0]];
        let south = vec![[11.0, 3.0], [-1.0, 3.0]];
        let island = vec![[4.0, 4.0], [6.0, 4.0], [6.0, 6.0], [4.0, 6.0], [4.0, 4.0]];
        let strait = close(join(vec![north, south, island]), BOUNDS);
        assert!(water(&strait, [2.0, 5.0]) && water(&strait, [8.0, 5.0]));
        assert!(!water(&strait, [5.0, 5.0]) && !water(&strait, [5.0, 8.0]) && !water(&strait, [5.0, 2.0]));
    }

    #[test]
    fn ends_inside_are_led_to_the_border_or_given_up() {
        let short = close(vec![vec![[1.0, 4.0], [5.0, 5.0], [9.0, 4.0]]], BOUNDS);
        assert!(water(&short, [5.0, 2.0]) && !water(&short, [5.0, 7.0]));
        assert!(close(vec![vec![[4.0, 4.0], [5.0, 5.0], [9.0, 4.0]]], BOUNDS).is_empty());
    }
}
