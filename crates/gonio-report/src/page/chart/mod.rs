//! Charts as SVG: curves, histograms, scatter, empirical distributions.
//!
//! A [`Frame`] describes the axes, a [`Series`] the data. Charts have a light background, also on a
//! dark page. Values that an axis cannot show (not finite; not positive on a logarithmic axis) are
//! omitted.

mod draw;
pub(crate) mod scale;
mod statistics;

use maud::{Markup, html};

use scale::Scale;
pub use statistics::{Histogram, ecdf_steps};

/// Division of an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axis {
    /// Linear.
    Linear,
    /// Proportional to the square root of values that are not negative, from zero on.
    SquareRoot,
    /// Logarithmic.
    Log,
}

/// Style of a series.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mark {
    /// A line through the points, in their order.
    Line,
    /// A dashed line.
    Dashed,
    /// A dotted line.
    Dotted,
    /// A dot at each point.
    Dots,
    /// Bars from the bottom of the chart; the points are the two upper corners of each bar in turn.
    Bars,
}

/// Data of a chart.
#[derive(Clone, Debug)]
pub struct Series {
    /// Name for the legend.
    pub name: String,
    /// Points `(x, y)` in the units of the axes.
    pub points: Vec<(f64, f64)>,
    /// Style.
    pub mark: Mark,
}

impl Series {
    /// Builds a line.
    pub fn line(name: impl Into<String>, points: Vec<(f64, f64)>) -> Self {
        Self { name: name.into(), points, mark: Mark::Line }
    }

    /// Builds a dashed line.
    pub fn dashed(name: impl Into<String>, points: Vec<(f64, f64)>) -> Self {
        Self { name: name.into(), points, mark: Mark::Dashed }
    }

    /// Builds dots.
    pub fn dots(name: impl Into<String>, points: Vec<(f64, f64)>) -> Self {
        Self { name: name.into(), points, mark: Mark::Dots }
    }
}

/// Styles of lines, used in turn when the colours repeat.
pub(crate) const LINES: [Mark; 3] = [Mark::Line, Mark::Dashed, Mark::Dotted];

/// Number of colours; after these, the colours repeat.
pub(crate) const COLOURS: usize = draw::COLOURS.len();

/// The axes of a chart.
#[derive(Clone, Debug)]
pub struct Frame<'a> {
    /// Title above the chart.
    pub title: &'a str,
    /// Label and division of the horizontal axis.
    pub x: (&'a str, Axis),
    /// Label and division of the vertical axis.
    pub y: (&'a str, Axis),
    /// Range of the vertical axis instead of that of the data.
    pub y_range: Option<(f64, f64)>,
}

/// Draws a chart of series; later series are drawn over earlier ones.
pub fn chart(frame: &Frame<'_>, series: &[Series]) -> Markup {
    // Points below a given range are cut off, not drawn along the edge.
    let foot = frame.y_range.map_or(f64::NEG_INFINITY, |(low, _)| low);
    let drawable = |(x, y): &(f64, f64)| frame.x.1.shows(*x) && frame.y.1.shows(*y) && *y >= foot;
    let shown: Vec<Series> = series
        .iter()
        .map(|s| Series { points: s.points.iter().copied().filter(drawable).collect(), ..s.clone() })
        .collect();
    let all = || shown.iter().flat_map(|s| &s.points);
    let x = Scale::around(frame.x.1, all().map(|p| p.0), None);
    let y = Scale::around(frame.y.1, all().map(|p| p.1), frame.y_range);
    // Bars start at the bottom of the chart: at zero on a linear axis without a given range.
    let bars = shown.iter().any(|s| s.mark == Mark::Bars);
    let y = if bars && frame.y.1 == Axis::Linear && frame.y_range.is_none() { y.starting_at_zero() } else { y };
    let svg = draw::svg(frame, &x, &y, &shown);
    let names: Vec<&str> = series.iter().map(|s| s.name.as_str()).filter(|n| !n.is_empty()).collect();
    let words =
        format!("Chart. {}. Across: {}. Up: {}. Shown: {}.", frame.title, frame.x.0, frame.y.0, names.join("; "));
    html! {
        p style="margin: 0 0 0.3rem" { strong { (frame.title) } }
        div.chart role="img" aria-label=(words) { (svg) }
        @if names.len() > 1 {
            ul.legend {
                @for (i, s) in series.iter().enumerate().filter(|(_, s)| !s.name.is_empty()) {
                    li { (draw::swatch(i, s.mark)) (s.name) }
                }
            }
        }
    }
}

/// Draws curves over the range of their points; `x` and `y` are label and division of the axes.
pub fn lines(title: &str, x: (&str, Axis), y: (&str, Axis), series: &[Series]) -> Markup {
    chart(&Frame { title, x, y, y_range: None }, series)
}

/// Draws the density of samples as bars under curves of model densities.
pub fn histogram(title: &str, x_label: &str, histogram: &Histogram, curves: &[Series], y: Axis) -> Markup {
    let bars = Series { name: "samples".into(), points: histogram.corners(), mark: Mark::Bars };
    let series: Vec<Series> = std::iter::once(bars).chain(curves.iter().cloned()).collect();
    // Curves can fall far below the density of one sample in a bin, so the axis starts at half of
    // this density.
    let top = series.iter().flat_map(|s| &s.points).map(|p| p.1).filter(|y| y.is_finite()).fold(0.0, f64::max);
    let range = match y {
        Axis::Log if top > 0.0 => Some((0.5 * histogram.one_sample().min(0.1 * top), 2.0 * top)),
        _ => None,
    };
    chart(&Frame { title, x: (x_label, Axis::Linear), y: ("density", y), y_range: range }, &series)
}

/// Draws dots, with the line on which both coordinates are equal if `identity`.
pub fn scatter(frame: &Frame<'_>, series: &[Series], identity: bool) -> Markup {
    let mut all = series.to_vec();
    if identity {
        let values = series.iter().flat_map(|s| &s.points).flat_map(|p| [p.0, p.1]).filter(|v| frame.x.1.shows(*v));
        let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
        if low < high {
            all.push(Series::dashed("equal", vec![(low, low), (high, high)]));
        }
    }
    chart(frame, &all)
}

/// Draws empirical distributions: for each named set of values, the share of them that is at most
/// `x`.
pub fn ecdf(title: &str, x_label: &str, x: Axis, sets: &[(&str, Vec<f64>)]) -> Markup {
    let series: Vec<Series> = sets
        .iter()
        .map(|(name, values)| Series::line(*name, ecdf_steps(values.iter().copied().filter(|v| x.shows(*v)).collect())))
        .collect();
    let frame = Frame { title, x: (x_label, x), y: ("share of all", Axis::Linear), y_range: Some((0.0, 1.0)) };
    chart(&frame, &series)
}

impl Axis {
    /// Whether the axis can show the value.
    fn shows(self, value: f64) -> bool {
        let in_domain = match self {
            Self::Linear => true,
            Self::SquareRoot => value >= 0.0,
            Self::Log => value > 0.0,
        };
        value.is_finite() && in_domain
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn omits_invalid_values() {
        let odd = vec![(f64::NAN, 1.0), (1.0, f64::INFINITY), (-1.0, 0.0), (2.0, 3.0)];
        for axis in [Axis::Linear, Axis::Log] {
            for points in [odd.clone(), vec![], vec![(1.0, 1.0)], vec![(1e-300, 1e300), (1.0, 2.0)]] {
                for mark in [Mark::Line, Mark::Dashed, Mark::Dotted, Mark::Dots, Mark::Bars] {
                    let series = Series { name: "s<1".into(), points: points.clone(), mark };
                    let frame = Frame { title: "t & u", x: ("x", axis), y: ("y", axis), y_range: None };
                    let html = chart(&frame, &[series.clone(), series]).into_string();
                    assert!(html.contains("<svg") && html.contains("s&lt;1") && !html.contains("NaN"), "{html}");
                }
            }
        }
        assert!(ecdf("t", "x", Axis::Log, &[("a", vec![]), ("b", vec![1.0, 0.0])]).into_string().contains("<svg"));
    }

    #[test]
    fn one_series_needs_no_legend() {
        let line = Series::line("only", vec![(0.0, 0.0), (1.0, 1.0)]);
        let html = |series: &[Series]| lines("t", ("x", Axis::Linear), ("y", Axis::Linear), series).into_string();
        assert!(!html(std::slice::from_ref(&line)).contains("legend"));
        assert!(html(&[line.clone(), line]).contains("legend"));
    }
}
