//! Where an extract has something to say: near what it holds, fading out beyond, and at its border.

use super::style::Form;

/// Full this near to a mapped thing, metres.
const FULL_M: f64 = 60.0;
/// Nothing beyond this, metres.
const NONE_M: f64 = 160.0;
/// Width of the fade at the extract's border, metres.
const BORDER_M: f64 = 40.0;
/// Side of the cells that distances are known in, metres; more where the extract is large.
const CELL_M: f64 = 10.0;
const CELLS_MAX: f64 = 4e6;

/// Distances to mapped things, on a grid; metres on the painter's plane.
pub struct Coverage {
    low: [f64; 2],
    high: [f64; 2],
    cell_m: f64,
    columns: usize,
    rows: usize,
    distances_m: Vec<f32>,
}

impl Coverage {
    /// `corners`: south-west and north-east.
    /// What is mapped: the rings of areas, and lines.
    pub fn new<'a>(corners: [[f64; 2]; 2], mapped: impl Iterator<Item = (Form, &'a [Vec<[f64; 2]>])>) -> Self {
        let [low, high] = corners;
        let (width, height) = (high[0] - low[0], high[1] - low[1]);
        let cell_m = CELL_M.max((width * height / CELLS_MAX).sqrt());
        let (columns, rows) = ((width / cell_m).ceil() as usize + 1, (height / cell_m).ceil() as usize + 1);
        let mut coverage = Self { low, high, cell_m, columns, rows, distances_m: vec![f32::INFINITY; columns * rows] };
        for (form, lines) in mapped {
            lines.iter().for_each(|line| coverage.mark(line));
            if form == Form::Area {
                coverage.fill(lines);
            }
        }
        coverage.spread();
        coverage
    }

    /// West, south, east, north.
    pub fn extent(&self) -> [f64; 4] {
        [self.low[0], self.low[1], self.high[0], self.high[1]]
    }

    /// 0 nothing to 1 full.
    pub fn at(&self, place: [f64; 2]) -> f64 {
        let inside =
            (0..2).map(|i| (place[i] - self.low[i]).min(self.high[i] - place[i])).fold(f64::INFINITY, f64::min);
        let near = (NONE_M - self.distance_m(place)) / (NONE_M - FULL_M);
        smooth(near) * smooth(inside / BORDER_M)
    }

    fn distance_m(&self, place: [f64; 2]) -> f64 {
        let at = |i: usize, count: usize| ((place[i] - self.low[i]) / self.cell_m).clamp(0.0, (count - 1) as f64);
        let (x, y) = (at(0, self.columns), at(1, self.rows));
        let (left, below) = (x.floor() as usize, y.floor() as usize);
        let (right, above) = ((left + 1).min(self.columns - 1), (below + 1).min(self.rows - 1));
        let (fx, fy) = (x - left as f64, y - below as f64);
        let d = |x: usize, y: usize| f64::from(self.distances_m[y * self.columns + x]).min(10.0 * NONE_M);
        let lower = d(left, below) * (1.0 - fx) + d(right, below) * fx;
        let upper = d(left, above) * (1.0 - fx) + d(right, above) * fx;
        lower * (1.0 - fy) + upper * fy
    }

    fn mark(&mut self, line: &[[f64; 2]]) {
        for pair in line.windows(2) {
            let (a, b) = (pair[0], pair[1]);
            let steps = ((b[0] - a[0]).hypot(b[1] - a[1]) / self.cell_m).ceil().clamp(1.0, 1e5) as u32;
            for step in 0..=steps {
                let t = f64::from(step) / f64::from(steps);
                let place: [f64; 2] = std::array::from_fn(|i| a[i] + t * (b[i] - a[i]) - self.low[i]);
                let (x, y) = ((place[0] / self.cell_m).round(), (place[1] / self.cell_m).round());
                if x >= 0.0 && y >= 0.0 && x < self.columns as f64 && y < self.rows as f64 {
                    self.distances_m[y as usize * self.columns + x as usize] = 0.0;
                }
            }
        }
    }

    /// Marks the cells inside an area's rings (even–odd, row by row).
    fn fill(&mut self, rings: &[Vec<[f64; 2]>]) {
        let row_of = |north: f64| (north - self.low[1]) / self.cell_m;
        let (south, north) = rings
            .iter()
            .flatten()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), p| (low.min(row_of(p[1])), high.max(row_of(p[1]))));
        let last = (self.rows - 1) as f64;
        if !(south <= last && north >= 0.0) {
            return;
        }
        for row in south.max(0.0).ceil() as usize..=north.min(last).floor() as usize {
            let crossings = self.crossings(rings, row as f64 * self.cell_m + self.low[1]);
            for pair in crossings.chunks_exact(2) {
                let (from, to) = (pair[0].max(0.0).ceil(), pair[1].min((self.columns - 1) as f64).floor());
                if from <= to {
                    let start = row * self.columns;
                    self.distances_m[start + from as usize..=start + to as usize].fill(0.0);
                }
            }
        }
    }

    /// Where rings cross a parallel, in columns, ascending.
    fn crossings(&self, rings: &[Vec<[f64; 2]>], north: f64) -> Vec<f64> {
        let edges = rings.iter().flat_map(|ring| ring.iter().zip(ring.iter().cycle().skip(1)));
        let mut crossings: Vec<f64> = edges
            .filter(|(a, b)| (a[1] > north) != (b[1] > north))
            .map(|(a, b)| ((b[0] - a[0]) * (north - a[1]) / (b[1] - a[1]) + a[0] - self.low[0]) / self.cell_m)
            .collect();
        crossings.sort_by(f64::total_cmp);
        crossings
    }

    /// Two passes with the chamfer (1, √2) (Borgefors 1986): within 8 % of the distance.
    fn spread(&mut self) {
        let (columns, rows) = (self.columns as isize, self.rows as isize);
        let (side, diagonal) = (self.cell_m as f32, (self.cell_m * std::f64::consts::SQRT_2) as f32);
        let before = [(-1, 0, side), (0, -1, side), (-1, -1, diagonal), (1, -1, diagonal)];
        let mut relax = |x: isize, y: isize, sign: isize| {
            let at = (y * columns + x) as usize;
            for (dx, dy, length) in before {
                let (nx, ny) = (x + sign * dx, y + sign * dy);
                if (0..columns).contains(&nx) && (0..rows).contains(&ny) {
                    let other = self.distances_m[(ny * columns + nx) as usize] + length;
                    self.distances_m[at] = self.distances_m[at].min(other);
                }
            }
        };
        for y in 0..rows {
            (0..columns).for_each(|x| relax(x, y, 1));
        }
        for y in (0..rows).rev() {
            (0..columns).rev().for_each(|x| relax(x, y, -1));
        }
    }
}

fn smooth(t: f64) -> f64 {
    let t = t.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coverage_fades_away_from_what_is_mapped_and_at_the_border() {
        let road = [vec![[-1000.0, 0.0], [1000.0, 0.0]]];
        let park = [vec![[0.0, 400.0], [500.0, 400.0], [500.0, 900.0], [0.0, 900.0]]];
        let mapped = [(Form::Line { width_m: 5.0 }, &road[..]), (Form::Area, &park[..])];
        let coverage = Coverage::new([[-1000.0, -1000.0], [1000.0, 1000.0]], mapped.into_iter());
        assert_eq!(coverage.at([250.0, 650.0]), 1.0);
        assert_eq!(coverage.at([0.0, 20.0]), 1.0);
        assert_eq!(coverage.at([-400.0, 300.0]), 0.0);
        let (near, far) = (coverage.at([3.0, 90.0]), coverage.at([3.0, 130.0]));
        assert!(1.0 > near && near > far && far > 0.0, "{near} {far}");
        assert!(coverage.at([990.0, 0.0]) < 0.2);
    }
}
