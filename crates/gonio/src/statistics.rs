//! Order statistics.

use std::cmp::Ordering;

/// A number with a total order.
pub(crate) trait Number: Copy {
    /// Compares as `total_cmp` of the standard library.
    fn compare(&self, other: &Self) -> Ordering;
}

impl Number for f32 {
    fn compare(&self, other: &Self) -> Ordering {
        self.total_cmp(other)
    }
}

impl Number for f64 {
    fn compare(&self, other: &Self) -> Ordering {
        self.total_cmp(other)
    }
}

/// Returns the smallest value that more than `share` (0..1) of the values do not exceed, and
/// reorders the values; `None` without values.
pub(crate) fn quantile<T: Number>(values: &mut [T], share: f64) -> Option<T> {
    let at = ((share * values.len() as f64) as usize).min(values.len().checked_sub(1)?);
    Some(*values.select_nth_unstable_by(at, T::compare).1)
}

/// Returns the median, the larger of the two middle values of an even number of values; `None`
/// without values.
pub(crate) fn median<T: Number>(values: impl IntoIterator<Item = T>) -> Option<T> {
    quantile(&mut values.into_iter().collect::<Vec<T>>(), 0.5)
}

/// Returns the median of pairs of value and weight; `None` without values.
pub(crate) fn weighted_median(values: impl IntoIterator<Item = (f64, f64)>) -> Option<f64> {
    let mut values: Vec<(f64, f64)> = values.into_iter().collect();
    values.sort_by(|a, b| a.0.total_cmp(&b.0));
    let half = 0.5 * values.iter().map(|(_, weight)| weight).sum::<f64>();
    let mut sum = 0.0;
    let reaches_half = |(_, weight): &&(f64, f64)| {
        sum += weight;
        sum >= half
    };
    values.iter().find(reaches_half).or(values.last()).map(|(value, _)| *value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn medians_are_values_of_the_sample() {
        assert_eq!(median([3.0, 1.0, 2.0]), Some(2.0));
        assert_eq!(median([4.0_f32, 1.0, 3.0, 2.0]), Some(3.0));
        assert_eq!(median(Vec::<f64>::new()), None);
        assert_eq!(quantile(&mut [5.0, 1.0, 4.0, 2.0, 3.0], 0.2), Some(2.0));
        assert_eq!(quantile(&mut [5.0, 1.0], 1.0), Some(5.0));
    }

    #[test]
    fn weights_shift_the_median() {
        assert_eq!(weighted_median([(1.0, 1.0), (3.0, 1.0), (2.0, 5.0)]), Some(2.0));
        assert_eq!(weighted_median([(1.0, 0.1), (9.0, 3.0), (2.0, 1.0)]), Some(9.0));
        assert_eq!(weighted_median([]), None);
    }
}
