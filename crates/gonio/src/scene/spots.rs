//! Small spots on a ball: dust, scratches and print.
//!
//! A spot is narrow, differs from the median of its surroundings, and is not the brightest part of
//! the ball. A reflection of a small lamp can look the same. Therefore, the caller compares
//! estimates with and without the spots ([`crate::estimate::without_misleading_spots`]).

use glam::Vec3;

use super::components::{components, neighbours};
use crate::parallel;
use crate::picture::{Plane, luminance};
use crate::statistics::{median, quantile};

/// Largest radius of the ball, in pixels, at which spots are detected; larger photographs are
/// reduced.
const MAX_RADIUS: f64 = 160.0;
/// Side of the window of the median, relative to the radius.
const WINDOW: f64 = 0.11;
/// Smallest relative difference of a spot from the median, and the same in standard deviations.
const MIN_DIFFERENCE: (f32, f32) = (0.1, 6.0);
/// Largest extent of a spot, and largest half width of a longer one, relative to the window.
const MAX_EXTENT: (f64, f64) = (0.85, 0.3);
/// Smallest number of pixels of a spot.
const MIN_PIXELS: usize = 3;
/// Distances of the ring around a spot, in pixels.
const RING: (usize, usize) = (1, 4);
/// Smallest ratio of the largest difference in a spot to the upper quartile in its ring.
const CONTRAST: f32 = 4.0;
/// Largest brightness of a spot, relative to the brightest median. Brighter spots are lamps.
const MAX_BRIGHTNESS: f32 = 0.8;
/// Width of the margin of the spots that is replaced, in pixels.
const MARGIN: usize = 2;
/// Width of the rim, relative to the radius, where spots are not detected.
const RIM: f64 = 0.04;
/// Largest share of the ball that spots may cover.
const MAX_SHARE: f64 = 0.25;

/// A photograph whose spots are replaced by the median of their surroundings.
pub(super) struct WithoutSpots {
    pub(super) rgb: Plane<Vec3>,
    /// Number of the spots.
    pub(super) count: usize,
}

/// Replaces the spots on a ball of this radius in pixels. `used` are the pixels with valid values.
/// Returns `None` if there are no spots, or if they cover a large part of the ball.
pub(super) fn without_spots(rgb: &Plane<Vec3>, used: &Plane<bool>, radius: f64) -> Option<WithoutSpots> {
    let step = (radius / MAX_RADIUS).ceil().max(1.0) as usize;
    let (colours, used) = reduced(rgb, used, step);
    let radius = radius / step as f64;
    let window = (WINDOW * radius).round() as usize | 1;
    let spots = Spots::of(&colours, &used, window, (RIM * radius).ceil().max(2.0) as usize)?;
    let replaced = spots.within.as_slice().iter().filter(|within| **within).count();
    if replaced as f64 > MAX_SHARE * used.as_slice().iter().filter(|used| **used).count() as f64 {
        return None;
    }
    let size = colours.size();
    let fill = Plane::from_fn(size.0, size.1, |x, y| {
        let unspotted = |at: &(usize, usize)| used[*at] && !spots.within[*at];
        let channel = |c: usize| median(around((x, y), window, size).filter(unspotted).map(|at| colours[at][c]));
        if !spots.within[(x, y)] {
            return None;
        }
        Some(Vec3::new(channel(0)?, channel(1)?, channel(2)?))
    });
    let filled = |x: usize, y: usize| {
        let at = (x / step, y / step);
        (at.0 < size.0 && at.1 < size.1).then(|| fill[at]).flatten()
    };
    let rgb = Plane::from_fn(rgb.width(), rgb.height(), |x, y| filled(x, y).unwrap_or(rgb[(x, y)]));
    Some(WithoutSpots { rgb, count: spots.count })
}

/// Averages blocks of `step` x `step` pixels; a block is used if all its pixels are.
fn reduced(rgb: &Plane<Vec3>, used: &Plane<bool>, step: usize) -> (Plane<Vec3>, Plane<bool>) {
    let (width, height) = (rgb.width() / step, rgb.height() / step);
    let block = |x: usize, y: usize| (0..step * step).map(move |i| (x * step + i % step, y * step + i / step));
    let colours =
        Plane::from_fn(width, height, |x, y| block(x, y).map(|at| rgb[at]).sum::<Vec3>() / (step * step) as f32);
    let used = Plane::from_fn(width, height, |x, y| block(x, y).all(|at| used[at]));
    (colours, used)
}

/// Iterates over the pixels of a window around a pixel.
fn around(
    (x, y): (usize, usize),
    window: usize,
    (width, height): (usize, usize),
) -> impl Iterator<Item = (usize, usize)> {
    let reach = window / 2;
    let range = move |at: usize, length: usize| at.saturating_sub(reach)..(at + reach + 1).min(length);
    range(y, height).flat_map(move |v| range(x, width).map(move |u| (u, v)))
}

/// Returns the pixels at most `steps` rows and columns away from `set`, in order.
fn dilated(set: &[(usize, usize)], steps: usize, size: (usize, usize)) -> Vec<(usize, usize)> {
    let mut all: std::collections::BTreeSet<(usize, usize)> = set.iter().copied().collect();
    let mut edge = set.to_vec();
    for _ in 0..steps {
        edge = edge.iter().flat_map(|at| neighbours(*at, size, true)).filter(|at| all.insert(*at)).collect();
    }
    all.into_iter().collect()
}

/// The spots of a photograph.
struct Spots {
    /// Pixels of the spots and their margins.
    within: Plane<bool>,
    count: usize,
}

impl Spots {
    fn of(colours: &Plane<Vec3>, used: &Plane<bool>, window: usize, rim: usize) -> Option<Self> {
        let size = colours.size();
        let bright = colours.map(|colour| luminance(*colour).max(0.0));
        let is_inner = |at: (usize, usize)| {
            let corners = [(-1, 0), (1, 0), (0, -1), (0, 1)].map(|(dx, dy): (isize, isize)| {
                let reach = rim as isize;
                (at.0.checked_add_signed(dx * reach), at.1.checked_add_signed(dy * reach))
            });
            used[at]
                && corners
                    .into_iter()
                    .all(|(x, y)| x.zip(y).is_some_and(|(x, y)| x < size.0 && y < size.1 && used[(x, y)]))
        };
        let medians: Vec<Option<f32>> = parallel::map_range(size.0 * size.1, |i| {
            let at = (i % size.0, i / size.0);
            let values = around(at, window, size).filter(|at| used[*at]).map(|at| bright[at]);
            is_inner(at).then(|| median(values)).flatten()
        });
        let difference = |at: (usize, usize)| -> Option<f32> {
            let middle = medians[at.1 * size.0 + at.0].filter(|middle| *middle > 0.0)?;
            Some(bright[at] / middle - 1.0)
        };
        let differences = Plane::from_fn(size.0, size.1, |x, y| difference((x, y)));
        let sizes = differences.as_slice().iter().flatten().map(|d| d.abs());
        let threshold = MIN_DIFFERENCE.0.max(MIN_DIFFERENCE.1 * 1.48 * median(sizes)?);
        let brightest = medians.iter().flatten().copied().fold(0.0, f32::max);
        let differs = |at: (usize, usize)| differences[at].is_some_and(|d| d.abs() > threshold);
        let (mut pixels, mut count) = (Vec::new(), 0);
        for component in components(size, true, differs) {
            let part: Vec<(usize, usize)> = component.pixels().collect();
            if is_spot(&part, &differences, &bright, window, brightest) {
                pixels.extend(part);
                count += 1;
            }
        }
        let mut within = Plane::from_fn(size.0, size.1, |_, _| false);
        dilated(&pixels, MARGIN, size).into_iter().for_each(|at| within[at] = true);
        (count > 0).then_some(Self { within, count })
    }
}

/// Whether a component of differing pixels is a spot.
fn is_spot(
    part: &[(usize, usize)],
    differences: &Plane<Option<f32>>,
    bright: &Plane<f32>,
    window: usize,
    brightest: f32,
) -> bool {
    if part.len() < MIN_PIXELS {
        return false;
    }
    let extent = |of: fn(&(usize, usize)) -> usize| {
        let (least, most) = part.iter().map(of).fold((usize::MAX, 0), |(a, b), v| (a.min(v), b.max(v)));
        most - least + 1
    };
    let is_small = extent(|at| at.0).max(extent(|at| at.1)) as f64 <= MAX_EXTENT.0 * window as f64;
    let max_half_width = (MAX_EXTENT.1 * window as f64).max(2.0) as usize;
    if !is_small && half_width(part) > max_half_width {
        return false;
    }
    let size = differences.size();
    let near = dilated(part, RING.0, size);
    let ring = dilated(part, RING.1, size).into_iter().filter(|at| near.binary_search(at).is_err());
    let mut ring: Vec<f32> = ring.filter_map(|at| differences[at]).map(f32::abs).collect();
    let Some(usual) = quantile(&mut ring, 0.75) else { return false };
    let value = |at: &(usize, usize)| differences[*at].unwrap_or(0.0);
    let largest = part.iter().map(value).fold(0.0_f32, |a, b| if b.abs() > a.abs() { b } else { a });
    let peak = part.iter().map(|at| bright[*at]).fold(0.0, f32::max);
    largest.abs() >= CONTRAST * usual && (largest < 0.0 || peak <= MAX_BRIGHTNESS * brightest)
}

/// Returns the number of erosions by one pixel that remove a set.
fn half_width(part: &[(usize, usize)]) -> usize {
    let mut set: std::collections::BTreeSet<(usize, usize)> = part.iter().copied().collect();
    let mut erosions = 0;
    while !set.is_empty() {
        let inner = |at: &(usize, usize)| {
            let (x, y) = *at;
            x > 0 && y > 0 && [(x - 1, y), (x + 1, y), (x, y - 1), (x, y + 1)].iter().all(|at| set.contains(at))
        };
        set = set.iter().copied().filter(inner).collect();
        erosions += 1;
    }
    erosions
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: usize = 201;
    const RADIUS: f64 = 100.0;

    fn used() -> Plane<bool> {
        Plane::from_fn(SIZE, SIZE, |x, y| (x as f64 - 100.0).hypot(y as f64 - 100.0) < RADIUS)
    }

    /// A shaded ball with a broad highlight, times `1 + paint`.
    fn ball(paint: impl Fn(f32, f32) -> f32) -> Plane<Vec3> {
        Plane::from_fn(SIZE, SIZE, |x, y| {
            let (u, v) = ((x as f32 - 100.0) / 100.0, (y as f32 - 100.0) / 100.0);
            let highlight = 4.0 * (-((u + 0.3).powi(2) + (v + 0.3).powi(2)) / 0.05).exp();
            Vec3::new(0.6, 0.4, 0.3) * (0.5 - 0.3 * v + highlight) * (1.0 + paint(x as f32, y as f32))
        })
    }

    fn bump(x: f32, y: f32, at: (f32, f32), width: f32) -> f32 {
        (-((x - at.0).powi(2) + (y - at.1).powi(2)) / (2.0 * width * width)).exp()
    }

    #[test]
    fn dust_and_scratches_are_replaced() {
        let clean = ball(|_, _| 0.0);
        for (name, count, paint) in [
            (
                "bright",
                2,
                (&|x, y| bump(x, y, (120.0, 130.0), 1.5) + bump(x, y, (60.0, 150.0), 1.5)) as &dyn Fn(f32, f32) -> f32,
            ),
            ("dark", 1, &|x, y| -0.6 * bump(x, y, (120.0, 130.0), 1.5)),
            ("scratch", 1, &|x, y| {
                if (40.0..160.0).contains(&x) && (y - 140.0 - 0.1 * x).abs() < 1.0 { 0.8 } else { 0.0 }
            }),
        ] {
            let spotted = ball(paint);
            let found = without_spots(&spotted, &used(), RADIUS).unwrap();
            assert_eq!(found.count, count, "{name}");
            let used = used();
            let off = |rgb: &Plane<Vec3>| {
                let pairs = rgb.as_slice().iter().zip(clean.as_slice()).zip(used.as_slice());
                pairs.filter(|(_, used)| **used).map(|((a, b), _)| (a.y / b.y - 1.0).abs()).fold(0.0, f32::max)
            };
            assert!(off(&spotted) > 0.5 && off(&found.rgb) < 0.08, "{name}: {} {}", off(&spotted), off(&found.rgb));
        }
    }

    #[test]
    fn a_smooth_ball_and_bright_lamps_have_no_spots() {
        assert!(without_spots(&ball(|_, _| 0.0), &used(), RADIUS).is_none());
        assert!(without_spots(&ball(|x, y| 40.0 * bump(x, y, (120.0, 130.0), 1.5)), &used(), RADIUS).is_none());
    }

    #[test]
    fn large_photographs_are_reduced() {
        let small = ball(|x, y| bump(x, y, (120.0, 130.0), 1.5));
        let large = Plane::from_fn(3 * SIZE, 3 * SIZE, |x, y| small[(x / 3, y / 3)]);
        let used = used();
        let used = Plane::from_fn(3 * SIZE, 3 * SIZE, |x, y| used[(x / 3, y / 3)]);
        let found = without_spots(&large, &used, 3.0 * RADIUS).unwrap();
        assert_eq!(found.count, 1);
        assert!(found.rgb[(360, 390)].y < 0.6 * large[(360, 390)].y);
    }
}
