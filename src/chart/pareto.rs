//! Pareto fronts: what cannot be had cheaper without being worse.

/// A choice: what it costs and how far it is off; less is better in both.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Choice {
    pub cost: f64,
    pub error: f64,
}

/// Figures as near as this to one another are the same: a share of them, and for errors a part of a pixel on top.
pub const SAME_SHARE: f64 = 0.01;
pub const SAME_PX: f64 = 0.001;

impl Choice {
    /// At most as dear and as far off, and better in one.
    fn beats(self, other: Self) -> bool {
        self.cost <= other.cost && self.error <= other.error && self != other
    }

    /// At most as dear and as far off as the other, but for what is the same.
    pub fn covers(self, other: Self) -> bool {
        self.cost <= other.cost * (1.0 + SAME_SHARE) && self.error <= other.error * (1.0 + SAME_SHARE) + SAME_PX
    }
}

/// Places of the choices that no other one beats, by ascending cost; of those that are alike the first.
///
/// ```
/// # use stoop::chart::{Choice, pareto_front};
/// let choices = [(3.0, 1.0), (1.0, 4.0), (2.0, 5.0), (1.0, 4.0)].map(|(cost, error)| Choice { cost, error });
/// assert_eq!(pareto_front(&choices), [1, 0]);
/// ```
pub fn pareto_front(choices: &[Choice]) -> Vec<usize> {
    let is_best = |at: usize| {
        let beaten = choices.iter().any(|&other| other.beats(choices[at]));
        !beaten && !choices[..at].contains(&choices[at])
    };
    let mut front: Vec<usize> = (0..choices.len()).filter(|&at| is_best(at)).collect();
    front.sort_by(|&a, &b| choices[a].cost.total_cmp(&choices[b].cost));
    front
}

/// Of `others` those that none of `ours` covers.
pub fn not_covered(ours: &[Choice], others: &[Choice]) -> Vec<usize> {
    (0..others.len()).filter(|&at| !ours.iter().any(|&choice| choice.covers(others[at]))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn choice(cost: f64, error: f64) -> Choice {
        Choice { cost, error }
    }

    #[test]
    fn what_is_dearer_by_less_than_a_hundredth_is_covered() {
        let ours = [choice(100.9, 1.0), choice(200.0, 0.5)];
        let others = [choice(100.0, 1.0), choice(150.0, 0.7), choice(300.0, 0.4995)];
        assert_eq!(not_covered(&ours, &others), [1]);
    }

    proptest! {
        #[test]
        fn a_front_falls_and_covers_all(pairs in prop::collection::vec((0u8..20, 0u8..20), 1..30)) {
            let all: Vec<Choice> = pairs.iter().map(|&(cost, error)| choice(cost.into(), error.into())).collect();
            let front: Vec<Choice> = pareto_front(&all).into_iter().map(|at| all[at]).collect();
            prop_assert!(front.windows(2).all(|pair| pair[0].cost < pair[1].cost && pair[0].error > pair[1].error));
            prop_assert!(all.iter().all(|&one| front.iter().any(|&best| best == one || best.beats(one))));
        }
    }
}
