//! Search along a line.

/// Returns the maximiser of a unimodal function on an interval, to within `tolerance`, by
/// golden-section search (Kiefer 1953).
pub(crate) fn golden_section(f: impl Fn(f64) -> f64, (mut low, mut high): (f64, f64), tolerance: f64) -> f64 {
    let ratio = 0.5 * (5.0_f64.sqrt() - 1.0);
    let (mut a, mut b) = (high - ratio * (high - low), low + ratio * (high - low));
    let (mut at_a, mut at_b) = (f(a), f(b));
    while high - low > tolerance {
        if at_a < at_b {
            (low, a, at_a) = (a, b, at_b);
            b = low + ratio * (high - low);
            at_b = f(b);
        } else {
            (high, b, at_b) = (b, a, at_a);
            a = high - ratio * (high - low);
            at_a = f(a);
        }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_maxima_inside_and_at_the_ends() {
        for (maximum, want) in [(0.3, 0.3), (-2.0, -1.0), (5.0, 2.0)] {
            let found = golden_section(|x| -(x - maximum).powi(2), (-1.0, 2.0), 1e-7);
            assert!((found - want).abs() < 1e-6, "{found} {want}");
        }
    }
}
