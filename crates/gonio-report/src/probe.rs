//! Picture of a light probe: the photographs with ignored pixels, and the map with interpolated
//! parts.

use glam::Vec3;
use gonio::picture::Plane;
use gonio::probe::{Probe, View};
use gonio::render::Exposure;
use gonio::scene::PixelStatus;

use crate::canvas::{INK, LINE, OUTLINE, PAPER, fill, legend as legend_line, note, place, sheet, text};
use crate::panels::resize;

/// Height of a panel in pixels; the map is twice as wide.
const PANEL: usize = 400;
/// Distance between panels, in pixels.
const GAP: usize = 16;
/// Factor by which the photograph is darkened outside of the ball.
const SHADE: f32 = 0.25;
/// Width of a stripe of hatching, in pixels.
const STRIPE: usize = 3;
/// Margin around the ball, as a share of its size.
const MARGIN: f64 = 0.04;

const RIM: Vec3 = Vec3::new(0.85, 0.55, 0.02);
const CLIPPED: Vec3 = Vec3::new(0.95, 0.08, 0.05);
const FAULTY: Vec3 = Vec3::new(0.8, 0.0, 0.5);
const CAMERA: Vec3 = Vec3::new(0.03, 0.22, 0.95);

/// Draws the views side by side with outlines and marks on ignored pixels, and the map with
/// interpolated parts hatched. Returns linear display values in 0..=1.
pub fn draw(views: &[&View], probe: &Probe) -> Plane<Vec3> {
    let several = views.len() > 1;
    let (captions, legend) = (captions(probe), legend(views));
    let width = GAP + views.len() * (PANEL + GAP) + 2 * PANEL + GAP;
    let top = GAP + LINE;
    let below = top + PANEL + 10;
    let mut out = sheet(width, below + (1 + captions.len() + legend.len()) * LINE + GAP);
    let mut left = GAP;
    for (n, view) in views.iter().enumerate() {
        text(&mut out, left, GAP, ["first view", "second view"].get(n).filter(|_| several).unwrap_or(&"photograph"));
        place(&mut out, left, top, &photograph(view, several));
        left += PANEL + GAP;
    }
    text(&mut out, left, GAP, "environment map (lat-long)");
    place(&mut out, left, top, &map(probe));
    for (n, label) in ["camera", "left", "behind", "right"].into_iter().enumerate() {
        let at = left + n * PANEL / 2;
        fill(&mut out, (at, top + PANEL), (1, 6), INK);
        note(&mut out, at + 3, below, label);
    }
    let mut row = below + LINE;
    for line in captions {
        text(&mut out, left, row, &line);
        row += LINE;
    }
    for (colour, line) in legend {
        legend_line(&mut out, left, row, colour, line);
        row += LINE;
    }
    out
}

fn captions(probe: &Probe) -> Vec<String> {
    let report = &probe.report;
    let mut lines =
        vec![format!("{} rows; hatched: interpolated, {:.1} % of all directions", report.rows, 100.0 * report.unseen)];
    lines.extend(report.views.map(|views| {
        format!(
            "second camera at {:.1} degrees ({}); views differ by {:.1} %",
            views.azimuth_degrees,
            if views.estimated { "estimated" } else { "specified" },
            100.0 * views.difference
        )
    }));
    lines
}

/// Returns the colours and labels of the marks that occur.
fn legend(views: &[&View]) -> Vec<(Vec3, &'static str)> {
    let any = |statuses: &[PixelStatus]| views.iter().any(|view| view.count(statuses) > 0);
    [
        (true, OUTLINE, "outline of the ball"),
        (any(&[PixelStatus::Edge]), RIM, "rim, ignored"),
        (views.len() > 1, CAMERA, "reflection of the camera, replaced by the other view"),
        (any(&[PixelStatus::Clipped]), CLIPPED, "clipped: true radiance is higher"),
        (any(&[PixelStatus::Negative, PixelStatus::NotFinite]), FAULTY, "invalid radiance, ignored"),
    ]
    .into_iter()
    .filter(|(occurs, ..)| *occurs)
    .map(|(_, colour, label)| (colour, label))
    .collect()
}

fn stripe(x: usize, y: usize) -> bool {
    ((x + y) / STRIPE).is_multiple_of(2)
}

/// Draws the part of the photograph with the ball, with marks on ignored pixels. If `several`, the
/// reflection of the camera is marked, too, because the other view replaces it.
fn photograph(view: &View, several: bool) -> Plane<Vec3> {
    let statuses = view.statuses();
    let (width, height) = statuses.size();
    let (mut low, mut high) = ((width, height), (0, 0));
    for i in (0..width * height).filter(|i| statuses.as_slice()[*i] != PixelStatus::Outside) {
        let (x, y) = (i % width, i / width);
        low = (low.0.min(x), low.1.min(y));
        high = (high.0.max(x + 1), high.1.max(y + 1));
    }
    let side = high.0.saturating_sub(low.0).max(high.1.saturating_sub(low.1)) as f64 * (1.0 + 2.0 * MARGIN);
    let middle = (0.5 * (low.0 + high.0) as f64, 0.5 * (low.1 + high.1) as f64);
    let behind = |x: usize, y: usize| {
        let at = |i: usize, middle: f64| middle + side * ((i as f64 + 0.5) / PANEL as f64 - 0.5);
        let (u, v) = (at(x, middle.0), at(y, middle.1));
        let inside = u >= 0.0 && v >= 0.0 && u < width as f64 && v < height as f64;
        inside.then_some((u as usize, v as usize))
    };
    let on_ball = |i: usize| matches!(statuses.as_slice()[i], PixelStatus::Used | PixelStatus::Clipped);
    let exposure = Exposure::by_quantile(view.rgb(), on_ball, 0.9, 0.6);
    let status = |x: usize, y: usize| behind(x, y).map_or(PixelStatus::Outside, |at| statuses[at]);
    Plane::from_fn(PANEL, PANEL, |x, y| {
        let Some(at) = behind(x, y) else { return PAPER };
        let rgb = view.rgb()[at];
        let shown = exposure.apply(if rgb.is_finite() { rgb } else { Vec3::ZERO });
        let own = statuses[at];
        let beside = [(x.saturating_sub(1), y), (x + 1, y), (x, y.saturating_sub(1)), (x, y + 1)];
        let ends = beside.iter().any(|&(x, y)| x < PANEL && y < PANEL && status(x, y) == PixelStatus::Outside);
        match own {
            PixelStatus::Outside => SHADE * shown,
            _ if ends => OUTLINE,
            PixelStatus::Clipped => CLIPPED,
            PixelStatus::Negative | PixelStatus::NotFinite => FAULTY,
            PixelStatus::Edge if stripe(x, y) => RIM,
            PixelStatus::Used if several && stripe(x, y) && view.shows_camera(at) => CAMERA,
            _ => shown,
        }
    })
}

/// Draws the tone-mapped map with interpolated parts hatched.
fn map(probe: &Probe) -> Plane<Vec3> {
    let (width, height) = (2 * PANEL, PANEL);
    let light = resize(probe.light.radiance(), width, height);
    let exposure = Exposure::by_quantile(&light, |_| true, 0.9, 0.6);
    Plane::from_fn(width, height, |x, y| {
        let shown = exposure.apply(light[(x, y)]);
        let at = (x * probe.coverage.width() / width, y * probe.coverage.height() / height);
        if probe.coverage[at] < 0.5 && stripe(x, y) { 0.4 * shown + 0.12 * INK } else { shown }
    })
}
