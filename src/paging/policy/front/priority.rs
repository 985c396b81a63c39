//! How near a rep is to being replaced (Varadhan & Manocha 2002, §4.2).

/// Where the prefetch bins lie and how angles count.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    /// δ, px; above 0.
    pub tolerance_px: f64,
    /// θ₀: within this angle from the view direction all count alike, radians.
    pub theta0_rad: f64,
    /// θ₁: this far beyond θ₀ a rep counts half, radians.
    pub theta1_rad: f64,
}

impl Scale {
    /// AngPr = 1 / (1 + (θ ∸ θ₀) / θ₁), 0 to 1; a ∸ b is a − b, and 0 where b is larger.
    pub fn angular(&self, theta_rad: f64) -> f64 {
        1.0 / (1.0 + (theta_rad - self.theta0_rad).max(0.0) / self.theta1_rad.max(1e-9))
    }

    /// Priority: ε · AngPr up to the tolerance, ε / AngPr above it, px. Both lead away from the tolerance the farther a
    /// rep is from what is looked at.
    pub fn priority_px(&self, error_px: f64, theta_rad: f64) -> f64 {
        let angular = self.angular(theta_rad);
        if error_px <= self.tolerance_px { error_px * angular } else { error_px / angular }
    }

    /// |δ − Priority| / δ: 0 is due now; above 1 lie reps with errors beyond 2 δ.
    pub fn distance(&self, error_px: f64, theta_rad: f64) -> f64 {
        (self.tolerance_px - self.priority_px(error_px, theta_rad)).abs() / self.tolerance_px
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SCALE: Scale = Scale { tolerance_px: 2.0, theta0_rad: 0.5, theta1_rad: 0.25 };

    #[test]
    fn angles_count_from_the_edge_of_the_view_on() {
        let expected = [(0.0, 1.0), (0.5, 1.0), (0.75, 0.5), (1.0, 1.0 / 3.0), (2.5, 1.0 / 9.0)];
        for (theta_rad, angular) in expected {
            assert!((SCALE.angular(theta_rad) - angular).abs() < 1e-12, "{theta_rad}");
        }
    }

    #[test]
    fn angles_lead_away_from_the_tolerance_on_both_sides() {
        assert_eq!(SCALE.priority_px(1.5, 0.2), 1.5);
        assert_eq!(SCALE.priority_px(1.5, 0.75), 0.75);
        assert_eq!(SCALE.priority_px(2.0, 0.75), 1.0);
        assert_eq!(SCALE.priority_px(3.0, 0.2), 3.0);
        assert_eq!(SCALE.priority_px(3.0, 0.75), 6.0);
        assert_eq!(
            [(1.5, 0.2), (1.5, 0.75), (3.0, 0.2), (3.0, 0.75)].map(|(e, t)| SCALE.distance(e, t)),
            [0.25, 0.625, 0.5, 2.0]
        );
    }
}
