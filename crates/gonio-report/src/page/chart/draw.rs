//! Drawing of series and scales as SVG.

use maud::{Markup, PreEscaped, html};
use plotters::prelude::*;

use super::scale::Scale;
use super::{Frame, Mark, Series};

/// Width and height in units of the picture, which the page scales.
const SIZE: (u32, u32) = (480, 330);
/// Colours that most viewers can distinguish (Okabe and Ito), some darkened for contrast on white.
pub(super) const COLOURS: [RGBColor; 8] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 135, 98),
    RGBColor(176, 84, 142),
    RGBColor(30, 30, 30),
    RGBColor(200, 140, 0),
    RGBColor(60, 160, 215),
    RGBColor(130, 130, 130),
];
/// Colour of bars, pale so that curves show over them.
const BAR: RGBColor = RGBColor(186, 202, 216);
const INK: RGBColor = RGBColor(40, 44, 50);
const GRID: RGBColor = RGBColor(226, 229, 232);

fn colour(index: usize, mark: Mark) -> RGBColor {
    if mark == Mark::Bars { BAR } else { COLOURS[index % COLOURS.len()] }
}

/// Draws a sample of a series, for the legend.
pub(super) fn swatch(index: usize, mark: Mark) -> Markup {
    let RGBColor(r, g, b) = colour(index, mark);
    let ink = format!("rgb({r},{g},{b})");
    html! {
        svg viewBox="0 0 24 12" aria-hidden="true" {
            @match mark {
                Mark::Line => { line x1="1" y1="6" x2="23" y2="6" stroke=(ink) stroke-width="3" {} },
                Mark::Dashed => { line x1="1" y1="6" x2="23" y2="6" stroke=(ink) stroke-width="3" stroke-dasharray="6 3" {} },
                Mark::Dotted => { line x1="1" y1="6" x2="23" y2="6" stroke=(ink) stroke-width="3" stroke-dasharray="3 4" {} },
                Mark::Dots => { circle cx="12" cy="6" r="4" fill=(ink) {} },
                Mark::Bars => { rect x="3" y="1" width="18" height="10" fill=(ink) {} },
            }
        }
    }
}

/// Draws the chart. All points must lie on the scales.
pub(super) fn svg(frame: &Frame<'_>, x: &Scale, y: &Scale, series: &[Series]) -> Markup {
    let mut text = String::new();
    draw(&mut text, frame, x, y, series).expect("text can be written to memory");
    // The page sets the width.
    let fixed = format!("width=\"{}\" height=\"{}\" ", SIZE.0, SIZE.1);
    html! { (PreEscaped(text.replacen(&fixed, "", 1))) }
}

type Failure<'a> = DrawingAreaErrorKind<<SVGBackend<'a> as DrawingBackend>::ErrorType>;

fn draw<'a>(
    out: &'a mut String,
    frame: &Frame<'_>,
    x: &Scale,
    y: &Scale,
    series: &[Series],
) -> Result<(), Failure<'a>> {
    let root = SVGBackend::with_string(out, SIZE).into_drawing_area();
    root.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&root)
        .margin(10)
        .margin_right(18)
        .x_label_area_size(50)
        .y_label_area_size(72)
        .build_cartesian_2d(*x, *y)?;
    let label = ("sans-serif", 18).into_font().color(&INK);
    chart
        .configure_mesh()
        .x_desc(frame.x.0)
        .y_desc(frame.y.0)
        .x_labels(6)
        .y_labels(6)
        .label_style(label.clone())
        .axis_desc_style(("sans-serif", 18).into_font().color(&INK))
        .axis_style(INK)
        .bold_line_style(GRID)
        .light_line_style(TRANSPARENT)
        .draw()?;
    for (index, series) in series.iter().enumerate() {
        let ink = colour(index, series.mark);
        let points = || series.points.iter().copied();
        match series.mark {
            Mark::Line => {
                chart.draw_series(LineSeries::new(points(), ink.stroke_width(2)))?;
            }
            Mark::Dashed => {
                chart.draw_series(DashedLineSeries::new(points(), 7, 4, ink.stroke_width(2)))?;
            }
            Mark::Dotted => {
                chart.draw_series(DashedLineSeries::new(points(), 2, 4, ink.stroke_width(2)))?;
            }
            Mark::Dots => {
                chart.draw_series(points().map(|p| Circle::new(p, 5, ink.mix(0.85).filled())))?;
            }
            Mark::Bars => {
                let corners = series.points.chunks_exact(2);
                chart.draw_series(corners.map(|c| Rectangle::new([(c[0].0, y.low()), c[1]], ink.filled())))?;
            }
        }
    }
    root.present()
}
