//! Picture of a photograph before anything is inferred: where the object is, and which pixels of it
//! are left out.

use glam::Vec3;
use gonio::picture::{Picture, Plane};
use gonio::render::Exposure;
use gonio::scene::{Fate, Sighting};

use crate::canvas::{OUTLINE, with_legend};
use crate::panels::over_paper;
use crate::panels::used::{MARKS, legend};

/// Longest side of the photograph in the picture, pixels.
const SIDE: usize = 1024;
/// Side up to which small photographs are enlarged.
const LEAST: usize = 480;
/// Width of the picture for the legend to fit.
const WIDTH: usize = 320;
/// Factor by which the photograph is darkened outside of the objects.
const SHADE: f32 = 0.35;

/// Width of the outline, pixels.
const WEIGHT: usize = 2;

/// Draws the photograph, dark outside of the objects, with their outlines and the pixels that are
/// left out. Linear display values in 0..=1.
pub fn draw(picture: &Picture, sightings: &[&Sighting]) -> Plane<Vec3> {
    let (width, height) = picture.rgb.size();
    let owner = Plane::from_fn(width, height, |x, y| sightings.iter().position(|sighting| sighting.contains(x, y)));
    let fates = Plane::from_fn(width, height, |x, y| {
        let of = |sighting: &&Sighting| sighting.observations.fates.as_ref().map(|fates| fates[(x, y)]);
        sightings.iter().filter_map(of).find(|fate| *fate != Fate::Outside).unwrap_or_default()
    });
    // Fates are told only where pixels are left out.
    let observed = |i: usize| {
        owner.as_slice()[i].is_some()
            && matches!(fates.as_slice()[i], Fate::Used | Fate::Outside)
            && picture.rgb.as_slice()[i].is_finite()
    };
    let exposure = Exposure::by_quantile(&picture.rgb, observed, 0.9, 0.6);
    let shown = over_paper(picture, exposure);
    let longest = width.max(height);
    // Of large photographs several pixels share one of the picture, and the reverse of small ones.
    let (step, times) = (longest.div_ceil(SIDE), (LEAST / longest).max(1));
    let size = (width.div_ceil(step) * times, height.div_ceil(step) * times);
    let behind = |x: usize, y: usize| {
        let span = |at: usize, most: usize| at / times * step..((at / times + 1) * step).min(most);
        span(y, height).flat_map(move |v| span(x, width).map(move |u| (u, v)))
    };
    let first = |x: usize, y: usize| (x / times * step, y / times * step);
    let photograph = Plane::from_fn(size.0, size.1, |x, y| {
        let mark = MARKS.iter().find(|mark| behind(x, y).any(|at| mark.marks(fates[at])));
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
    lines.extend(legend(&fates));
    with_legend(&photograph, WIDTH, &lines)
}
