//! Searches for the value at which something stops to hold.

/// Bisections of a search on a logarithmic scale: to a thousandth over thirty orders of magnitude.
const STEPS: u32 = 40;

/// The value between `holds_at` and `fails_at`, both above 0, up to which `holds` is true, by bisection of logarithms.
/// Both ends are tried first: a search whose ends do not differ finds nothing.
pub fn limit(holds_at: f64, fails_at: f64, holds: impl Fn(f64) -> bool) -> f64 {
    assert!(holds(holds_at), "it does not even hold at {holds_at}");
    assert!(!holds(fails_at), "it still holds at {fails_at}");
    let (mut good, mut bad) = (holds_at.ln(), fails_at.ln());
    for _ in 0..STEPS {
        let middle = (good + bad) / 2.0;
        if holds(middle.exp()) {
            good = middle;
        } else {
            bad = middle;
        }
    }
    good.exp()
}

/// The first of `values` for which `holds` is true for it and for all that follow; `None` where the last one fails.
pub fn first_of_all_that_hold(values: &[f64], holds: impl Fn(f64) -> bool) -> Option<f64> {
    let failing = values.iter().rposition(|&value| !holds(value));
    values.get(failing.map_or(0, |at| at + 1)).copied()
}
