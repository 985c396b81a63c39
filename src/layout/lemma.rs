//! Lemmas 1 and 2: what redundancy and what volume of transfer are to be expected of a cell's side.
//!
//! Pages of a class (a rep) are wanted between two distances from the eye, `r_in` and `r_out`; what any place of a square
//! cell of side a wants is the ring widened by the square. When the eye goes on by a, new pages of the class lie in front of
//! the ring's outer edge, (2 r_out + a)·a of ground, and behind its inner one, (2 r_in + a)·a where r_in > 0. With S_i bytes of
//! class i evenly on an area A_i, and C_i = a²/A_i the share of it that a cell has:
//!
//! - Lemma 2, bytes of a crossing: `V = Σ_i C_i S_i [(2 r_out,i/a + 1) + (2 r_in,i/a + 1)]`, the second term where r_in,i > 0;
//! - Lemma 1, redundancy: four crossings for each cell over the distinct bytes, `R = 4 V / Σ_i C_i S_i`, i from 0.
//!
//! As derived here: with four reps, r_out doubling and S_i falling by four from one to the next, 61 at a = r/4 and 19 at r, and
//! never below 5; Stoop's design quotes 63, 23 and 10 from Jiang, Sajadi & Gopi 2013. An edge is no longer than its area is
//! wide: beyond a city's border there is nothing to come in.

/// Pages of one fineness of a layer.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RepClass {
    /// Distances between which they are wanted, metres.
    pub in_m: f64,
    pub out_m: f64,
    /// Stored bytes, and the ground that they are of, square metres; above 0.
    pub bytes: f64,
    pub area_m2: f64,
}

/// What the lemmas foretell.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Prediction {
    /// Bytes in the layout for each distinct byte (Lemma 1).
    pub redundancy: f64,
    /// Bytes of a crossing (Lemma 2).
    pub run_bytes: f64,
}

impl RepClass {
    /// Bytes on the ground of a cell.
    fn cell_bytes(&self, side_m: f64) -> f64 {
        self.bytes * side_m * side_m / self.area_m2
    }

    /// Bytes that come in when the eye goes on by a cell.
    fn swept_bytes(&self, side_m: f64) -> f64 {
        let edge = |radius_m: f64| (2.0 * radius_m + side_m).min(self.area_m2.sqrt()) / side_m;
        let inner = if self.in_m > 0.0 { edge(self.in_m) } else { 0.0 };
        self.cell_bytes(side_m) * (edge(self.out_m) + inner)
    }
}

/// For cells of a side, metres.
pub fn lemmas(classes: &[RepClass], side_m: f64) -> Prediction {
    let total: f64 = classes.iter().map(|class| class.cell_bytes(side_m)).sum();
    let run_bytes: f64 = classes.iter().map(|class| class.swept_bytes(side_m)).sum();
    if total <= 0.0 {
        return Prediction::default();
    }
    Prediction { redundancy: 4.0 * run_bytes / total, run_bytes }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Four reps: radii r, 2r, 4r, 8r, and a quarter of the bytes from one to the next.
    fn four(r: f64) -> Vec<RepClass> {
        let class = |at: i32| RepClass {
            in_m: if at == 0 { 0.0 } else { r * 2f64.powi(at - 1) },
            out_m: r * 2f64.powi(at),
            bytes: 1e9 * 4f64.powi(-at),
            area_m2: 1e30,
        };
        (0..4).map(class).collect()
    }

    #[test]
    fn four_reps_give_the_figures_told_above() {
        let at = |side_m| lemmas(&four(100.0), side_m);
        assert!((at(25.0).redundancy - 60.7).abs() < 0.1, "{:?}", at(25.0));
        assert!((at(100.0).redundancy - 18.9).abs() < 0.1, "{:?}", at(100.0));
        assert!((at(1e9).redundancy - 4.99).abs() < 0.01, "{:?}", at(1e9));
    }

    /// Counted on a grid of points, each a page, for a ring round every place of a cell.
    #[test]
    fn swept_areas_are_those_of_a_count() {
        let (side_m, ring) = (20.0, RepClass { in_m: 60.0, out_m: 150.0, bytes: 1e12, area_m2: 1e12 });
        let wanted = |west_m: f64, x: f64, y: f64| {
            let nearest = |from: f64, at: f64| at.clamp(from, from + side_m) - at;
            let near_m = nearest(west_m, x).hypot(nearest(0.0, y));
            near_m >= ring.in_m && near_m <= ring.out_m
        };
        let axis = || (-200..=240).map(|at| f64::from(at) + 0.5);
        let news = axis().flat_map(|x| axis().map(move |y| (x, y)));
        let count = news.filter(|&(x, y)| wanted(side_m, x, y) && !wanted(0.0, x, y)).count() as f64;
        let expected = lemmas(&[ring], side_m).run_bytes;
        assert!((count / expected - 1.0).abs() < 0.02, "{count} against {expected}");
    }
}
