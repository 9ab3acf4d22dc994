//! Axes: ranges, positions of marks, and labels.

use std::ops::Range;

use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};

use super::Axis;

/// A range of values on an axis. Bounds are finite, ascending and distinct; positive if the axis is
/// logarithmic, and not negative if it shows square roots.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Scale {
    axis: Axis,
    low: f64,
    high: f64,
}

impl Scale {
    /// Returns a scale a little larger than the range of `values`, or exactly `range` if given and
    /// valid.
    pub(crate) fn around(axis: Axis, values: impl Iterator<Item = f64>, range: Option<(f64, f64)>) -> Self {
        if let Some((low, high)) = range.filter(|(a, b)| axis.shows(*a) && axis.shows(*b) && a < b) {
            return Self { axis, low, high };
        }
        let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
        if low > high {
            return Self { axis, low: 0.1, high: 1.0 };
        }
        match axis {
            Axis::Linear => {
                let room = if high > low { 0.04 * (high - low) } else { 0.5 * high.abs().max(1e-9) };
                Self { axis, low: low - room, high: high + room }
            }
            Axis::SquareRoot => Self { axis, low: 0.0, high: if high > 0.0 { high } else { 1.0 } },
            Axis::Log => {
                let room = if high > low { (high / low).powf(0.04).min(1e3) } else { 2.0 };
                Self { axis, low: (low / room).max(f64::MIN_POSITIVE), high: (high * room).min(f64::MAX) }
            }
        }
    }

    /// Makes the scale start at zero, for values that are not negative.
    pub(super) fn starting_at_zero(self) -> Self {
        if self.high > 0.0 { Self { low: 0.0, ..self } } else { self }
    }

    /// Returns the lower end.
    pub(super) fn low(&self) -> f64 {
        self.low
    }

    /// Returns the position of a value: 0 at the lower end, 1 at the upper one; clamped to them.
    pub(crate) fn share(&self, value: f64) -> f64 {
        let share = match self.axis {
            Axis::Linear => (value - self.low) / (self.high - self.low),
            Axis::SquareRoot => (value.max(0.0).sqrt() - self.low.sqrt()) / (self.high.sqrt() - self.low.sqrt()),
            Axis::Log => (value.max(f64::MIN_POSITIVE) / self.low).ln() / (self.high / self.low).ln(),
        };
        if share.is_nan() { 0.0 } else { share.clamp(0.0, 1.0) }
    }

    /// Returns round values within the range, at most about `most`.
    pub(crate) fn marks(&self, most: usize) -> Vec<f64> {
        let most = most.max(2) as f64;
        if self.axis == Axis::Linear {
            let rough = (self.high - self.low) / most;
            let power = 10.0_f64.powf(rough.log10().floor());
            let step = [1.0, 2.0, 5.0, 10.0].map(|m| m * power).into_iter().find(|s| *s >= rough).unwrap_or(rough);
            let first = (self.low / step).ceil();
            return (0..100)
                .map(|i| (first + f64::from(i)) * step)
                .take_while(|v| *v <= self.high * (1.0 + 1e-12))
                .collect();
        }
        if self.axis == Axis::SquareRoot {
            let first = self.high.log10().floor() as i32 - 4;
            let round = (0..6).flat_map(|d| [1.0, 2.0, 5.0].map(|m| m * 10.0_f64.powi(first + d)));
            let mut marks = vec![self.low];
            for value in round.filter(|v| (self.low..=self.high).contains(v)) {
                if self.share(value) - self.share(marks[marks.len() - 1]) >= 0.6 / most {
                    marks.push(value);
                }
            }
            return marks;
        }
        let (from, to) = (self.low.log10(), self.high.log10());
        let powers = |every: f64| {
            let first = (from / every).ceil() as i32;
            (0..100)
                .map(move |i| 10.0_f64.powf(f64::from(first + i) * every))
                .take_while(|v| *v <= self.high * (1.0 + 1e-12))
        };
        let decades = to - from;
        if decades < 2.2 {
            let first = from.floor() as i32;
            let each = (0..5).flat_map(|d| [1.0, 2.0, 5.0].map(|m| m * 10.0_f64.powi(first + d)));
            return each.filter(|v| (self.low..=self.high).contains(v)).collect();
        }
        powers((decades / most).ceil().max(1.0)).collect()
    }
}

impl Ranged for Scale {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, limit: (i32, i32)) -> i32 {
        limit.0 + (f64::from(limit.1 - limit.0) * self.share(*value)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        self.marks(hint.bold_points().min(8))
    }

    fn range(&self) -> Range<f64> {
        self.low..self.high
    }
}

impl ValueFormatter<f64> for Scale {
    fn format_ext(&self, value: &f64) -> String {
        short(*value)
    }
}

/// Formats a number in few characters.
pub(crate) fn short(value: f64) -> String {
    let size = value.abs();
    if size < 1e-12 {
        return "0".into();
    }
    if (1e-3..1e5).contains(&size) {
        let digits = (2 - size.log10().floor() as i32).clamp(0, 5) as usize;
        let text = format!("{value:.digits$}");
        if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
    } else {
        let text = format!("{value:.1e}");
        text.replace(".0e", "e")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_are_round_and_inside() {
        let check = |axis, low: f64, high: f64, want: &[&str]| {
            let scale = Scale::around(axis, std::iter::empty(), Some((low, high)));
            let got: Vec<String> = scale.marks(6).into_iter().map(short).collect();
            assert_eq!(got, want, "{low} {high}");
        };
        check(Axis::Linear, 0.0, 1.0, &["0", "0.2", "0.4", "0.6", "0.8", "1"]);
        check(Axis::SquareRoot, 0.0, 80.0, &["0", "1", "5", "10", "20", "50"]);
        check(Axis::Linear, -0.03, 0.03, &["-0.03", "-0.02", "-0.01", "0", "0.01", "0.02", "0.03"]);
        check(Axis::Log, 0.05, 3.0, &["0.05", "0.1", "0.2", "0.5", "1", "2"]);
        check(Axis::Log, 1e-5, 200.0, &["1e-4", "0.01", "1", "100"]);
    }

    #[test]
    fn maps_values_to_positions() {
        let log = Scale::around(Axis::Log, std::iter::empty(), Some((1.0, 100.0)));
        assert_eq!(log.map(&10.0, (0, 200)), 100);
        let linear = Scale::around(Axis::Linear, [0.0, 1.0].into_iter(), None);
        assert_eq!((linear.map(&0.5, (0, 100)), linear.map(&-9.0, (0, 100))), (50, 0));
        // The vertical axis of pictures points down.
        assert_eq!(linear.map(&9.0, (300, 20)), 20);
    }

    #[test]
    fn accepts_empty_and_extreme_ranges() {
        for axis in [Axis::Linear, Axis::SquareRoot, Axis::Log] {
            for values in [vec![], vec![3.0], vec![f64::MAX, 1.0], vec![f64::MIN_POSITIVE, f64::MAX]] {
                let scale = Scale::around(axis, values.clone().into_iter(), None);
                assert!(scale.low < scale.high && scale.marks(6).len() < 101, "{values:?} {scale:?}");
            }
        }
    }
}
