//! Picture of `gonio check`: the detected object and its ignored pixels.

use std::f64::consts::{PI, TAU};

use glam::Vec3;
use gonio::picture::{Picture, Plane};
use gonio::render::Exposure;
use gonio::scene::{Circle, Detection, PixelStatus};

use crate::canvas::{OUTLINE, PAPER, fill, heading, with_legend};
use crate::panels::over_paper;
use crate::panels::used::{IGNORE_REASONS, legend};

/// Longest side of the photograph in the picture, in pixels.
const PHOTOGRAPH_SIDE: usize = 1024;
/// Side up to which small photographs are enlarged.
const MIN_PHOTOGRAPH_SIDE: usize = 480;
/// Smallest width of the picture, so that the legend fits.
const WIDTH: usize = 320;
/// Factor by which the photograph is darkened outside of the objects.
const SHADE: f32 = 0.35;

/// Width of the outline, in pixels.
const WEIGHT: usize = 2;

/// Factor by which the photograph is darkened under numbered circles.
const UNDER: f32 = 0.6;
/// Side of the square behind a number, in pixels.
const BADGE: usize = 28;

/// Draws the photograph with numbered circles, and a legend of their parameters in pixels of the
/// photograph. Returns linear display values in 0..=1.
pub fn draw_candidates(picture: &Picture, circles: &[Circle]) -> Plane<Vec3> {
    let finite = |i: usize| picture.rgb.as_slice()[i].is_finite();
    let shown = over_paper(picture, Exposure::by_quantile(&picture.rgb, finite, 0.9, 0.6));
    let frame = Frame::of(shown.size());
    let mut drawn = Plane::from_fn(frame.size.0, frame.size.1, |x, y| {
        let on_rim = |circle: &Circle| {
            let pixel = frame.pixel();
            let off = ((x as f64 + 0.5) * pixel - circle.x).hypot((y as f64 + 0.5) * pixel - circle.y);
            (off - circle.radius).abs() <= 0.5 * WEIGHT as f64 * pixel
        };
        if circles.iter().any(on_rim) { OUTLINE } else { UNDER * shown[frame.first(x, y)] }
    });
    let mut lines = Vec::new();
    for (at, Circle { x, y, radius }) in circles.iter().enumerate() {
        // Numbers are at different sides of their circles, because nested circles often touch.
        let (down, right) = (1.25 * PI + TAU * at as f64 / 5.0).sin_cos();
        let corner = |centre: f64, toward: f64, most: usize| {
            let place = (centre + toward * radius) / frame.pixel() - 0.5 * BADGE as f64;
            (place.max(0.0) as usize).min(most.saturating_sub(BADGE))
        };
        let (left, top) = (corner(*x, right, frame.size.0), corner(*y, down, frame.size.1));
        fill(&mut drawn, (left, top), (BADGE, BADGE), PAPER);
        heading(&mut drawn, left + 9, top + 3, &format!("{}", at + 1));
        lines.push((OUTLINE, format!("{}: centre {x:.1}, {y:.1}, radius {radius:.1}", at + 1)));
    }
    with_legend(&drawn, WIDTH, &lines)
}

/// Scaling of a photograph by an integer factor: large ones are reduced, small ones enlarged.
struct Frame {
    /// Columns and rows of the picture.
    size: (usize, usize),
    /// Pixels of the photograph per pixel of the picture along a side, and vice versa.
    step: usize,
    times: usize,
}

impl Frame {
    fn of((width, height): (usize, usize)) -> Self {
        let longest = width.max(height);
        let (step, times) = (longest.div_ceil(PHOTOGRAPH_SIDE), (MIN_PHOTOGRAPH_SIDE / longest).max(1));
        Self { size: (width.div_ceil(step) * times, height.div_ceil(step) * times), step, times }
    }

    /// Returns the side of a pixel of the picture in pixels of the photograph.
    fn pixel(&self) -> f64 {
        self.step as f64 / self.times as f64
    }

    /// Returns the first pixel of the photograph in a pixel of the picture.
    fn first(&self, x: usize, y: usize) -> (usize, usize) {
        (x / self.times * self.step, y / self.times * self.step)
    }

    /// Iterates over the pixels of a photograph of `size` in a pixel of the picture.
    fn behind(&self, x: usize, y: usize, size: (usize, usize)) -> impl Iterator<Item = (usize, usize)> + use<> {
        let (first, step) = (self.first(x, y), self.step);
        let span = move |from: usize, most: usize| from..(from + step).min(most);
        span(first.1, size.1).flat_map(move |v| span(first.0, size.0).map(move |u| (u, v)))
    }
}

/// Draws the photograph, dark outside of the objects, with their outlines and marks on ignored
/// pixels. Returns linear display values in 0..=1.
pub fn draw(picture: &Picture, sightings: &[&Detection]) -> Plane<Vec3> {
    let (width, height) = picture.rgb.size();
    let owner = Plane::from_fn(width, height, |x, y| sightings.iter().position(|detection| detection.contains(x, y)));
    let statuses = Plane::from_fn(width, height, |x, y| {
        let of = |detection: &&Detection| detection.observations.statuses.as_ref().map(|statuses| statuses[(x, y)]);
        sightings.iter().filter_map(of).find(|status| *status != PixelStatus::Outside).unwrap_or_default()
    });
    // A detection without ignored pixels has no statuses; its pixels are `Outside` here.
    let observed = |i: usize| {
        owner.as_slice()[i].is_some()
            && (statuses.as_slice()[i].is_used() || statuses.as_slice()[i] == PixelStatus::Outside)
            && picture.rgb.as_slice()[i].is_finite()
    };
    let exposure = Exposure::by_quantile(&picture.rgb, observed, 0.9, 0.6);
    let shown = over_paper(picture, exposure);
    let frame = Frame::of((width, height));
    let (size, first) = (frame.size, |x: usize, y: usize| frame.first(x, y));
    let photograph = Plane::from_fn(size.0, size.1, |x, y| {
        let mark =
            IGNORE_REASONS.iter().find(|mark| frame.behind(x, y, (width, height)).any(|at| mark.marks(statuses[at])));
        let own = owner[first(x, y)];
        let ends = (1..=WEIGHT)
            .flat_map(|d| [(x.saturating_sub(d), y), (x, y.saturating_sub(d)), (x + d, y), (x, y + d)])
            .any(|(u, v)| u < size.0 && v < size.1 && owner[first(u, v)].is_none());
        match (mark, own) {
            (_, Some(_)) if ends => OUTLINE,
            (Some(mark), _) => mark.colour,
            (None, Some(_)) => shown[first(x, y)],
            (None, None) => SHADE * shown[first(x, y)],
        }
    });
    let mut lines = vec![(OUTLINE, "outline".to_owned())];
    lines.extend(legend(&statuses));
    with_legend(&photograph, WIDTH, &lines)
}
