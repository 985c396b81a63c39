//! The smoothest way between two places at two heights: van Wijk and Nuij 2003, "Smooth and efficient zooming and
//! panning", section 4, equation 9. The width w of their window is our height above the ground, their u the way over
//! ground. Written with sinh and asinh, so that short ways and great heights lose no digits.

/// How much zooming is preferred to panning: the mean that their users chose (section 6).
const RHO: f64 = 1.42;
/// A way shorter than this share of the heights is a pure zoom (their special case u₀ = u₁).
const STEEP: f64 = 1e-6;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Arc {
    way_m: f64,
    /// Heights at the start and at the end, w₀ and w₁.
    heights_m: [f64; 2],
    /// Parameter at the start, r₀.
    start: f64,
    /// Length of the arc in the paper's metric, S; −S is a descent in a pure zoom.
    length: f64,
}

impl Arc {
    /// `way_m` is not negative, heights are above 0.
    pub(super) fn new(way_m: f64, heights_m: [f64; 2]) -> Self {
        let [from_m, to_m] = heights_m;
        if way_m <= STEEP * from_m.min(to_m) {
            return Self { way_m, heights_m, start: 0.0, length: (to_m / from_m).ln() / RHO };
        }
        let rho_2 = RHO * RHO;
        let b = |sign: f64, height_m: f64| {
            ((to_m - from_m) * (to_m + from_m) + sign * rho_2 * rho_2 * way_m * way_m)
                / (2.0 * height_m * rho_2 * way_m)
        };
        let (start, end) = (-b(1.0, from_m).asinh(), -b(-1.0, to_m).asinh());
        Self { way_m, heights_m, start, length: (end - start) / RHO }
    }

    /// Length of the arc in the paper's metric.
    pub(super) fn length(&self) -> f64 {
        self.length.abs()
    }

    /// Way over ground and height, metres, at a share of the arc, 0 to 1.
    pub(super) fn at(&self, share: f64) -> (f64, f64) {
        let [from_m, to_m] = self.heights_m;
        if self.way_m <= STEEP * from_m.min(to_m) {
            return (self.way_m * share, from_m * (RHO * self.length * share).exp());
        }
        let along = RHO * self.length * share;
        let cosh = (along + self.start).cosh();
        (from_m / (RHO * RHO) * along.sinh() / cosh, from_m * self.start.cosh() / cosh)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arcs_meet_both_ends_and_have_constant_speed() {
        for way_m in [0.0, 1e-3, 1.0, 1e3, 2e7] {
            for heights_m in [[2.0, 2.0], [2.0, 1e7], [1e7, 2.0], [4e7, 30.0], [500.0, 700.0]] {
                let arc = Arc::new(way_m, heights_m);
                let (near, far) = (arc.at(0.0), arc.at(1.0));
                let scale = way_m + heights_m[0] + heights_m[1];
                assert!(near.0.abs() < 1e-9 * scale && (near.1 / heights_m[0] - 1.0).abs() < 1e-9);
                assert!((far.0 - way_m).abs() < 1e-7 * scale, "{way_m} {heights_m:?}: {far:?}");
                assert!((far.1 / heights_m[1] - 1.0).abs() < 1e-7, "{way_m} {heights_m:?}: {far:?}");
                // Equation 8: ρ² u'² + w'²/ρ² = w² where s has unit speed.
                if arc.length() > 0.1 && way_m > 0.0 {
                    let h = 1e-5;
                    let (a, b) = (arc.at(0.4 - h), arc.at(0.4 + h));
                    let per = 2.0 * h * arc.length();
                    let (du, dw) = ((b.0 - a.0) / per, (b.1 - a.1) / per);
                    let speed = (RHO * du).hypot(dw / RHO) / arc.at(0.4).1;
                    assert!((speed - 1.0).abs() < 1e-3, "{way_m} {heights_m:?}: {speed}");
                }
            }
        }
    }
}
