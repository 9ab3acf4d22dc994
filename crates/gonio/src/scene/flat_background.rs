//! The background of a normal map in which every pixel has the same vector.
//!
//! Many programs fill the pixels around the object with (0, 0, 1), which looks like a surface that
//! faces the camera.

use glam::Vec3;

use super::components::{border, connected_to_border, neighbours};
use crate::picture::Plane;
use crate::statistics::median;

/// Largest deviation of a component from the vector of the background: about one code of 8 bits.
const MAX_DEVIATION: f32 = 0.012;
/// Smallest share of the border with the vector of the background.
const BORDER_SHARE: f64 = 0.75;
/// Smallest share of the map that is background.
const MIN_SHARE: f64 = 0.1;
/// Smallest share of the map that is not background.
const MIN_OBJECT: f64 = 0.01;
/// Smallest median difference of the normals on both sides of the outline: 15 degrees. A flat
/// object with raised parts has smaller differences.
const MIN_STEP: f32 = 0.26;

/// Detects a background of one vector, connected to the border, and marks its pixels. Returns
/// `None` if the map has no such background.
pub(super) fn flat_background(normals: &Plane<Vec3>) -> Option<Plane<bool>> {
    let size = normals.size();
    let on_border: Vec<Vec3> = border(size).map(|at| normals[at]).collect();
    let middle = |component: usize| median(on_border.iter().map(|n| n[component]).filter(|v| v.is_finite()));
    let vector = Vec3::new(middle(0)?, middle(1)?, middle(2)?);
    // Pixels without a normal are no background that must be removed.
    if vector == Vec3::ZERO {
        return None;
    }
    let is_same = |n: Vec3| (n - vector).abs().max_element() < MAX_DEVIATION;
    let share = |count: usize, of: usize| count as f64 / of as f64;
    if share(on_border.iter().filter(|n| is_same(**n)).count(), on_border.len()) < BORDER_SHARE {
        return None;
    }
    let (background, count) = connected_to_border(size, false, |at| is_same(normals[at]));
    let all = size.0 * size.1;
    if share(count, all) < MIN_SHARE || share(all - count, all) < MIN_OBJECT {
        return None;
    }
    let inside = |at: &(usize, usize)| !background[*at] && neighbours(*at, size, true).any(|next| background[next]);
    let pixels = (0..size.1).flat_map(|y| (0..size.0).map(move |x| (x, y)));
    let step = median(pixels.filter(inside).map(|at| (normals[at] - vector).length()))?;
    (step > MIN_STEP).then_some(background)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: usize = 100;

    /// A hemisphere of a radius in pixels, before a background.
    fn ball(radius: f32, background: Vec3) -> Plane<Vec3> {
        Plane::from_fn(SIZE, SIZE, |x, y| {
            let (x, y) = ((x as f32 + 0.5 - 50.0) / radius, (50.0 - y as f32 - 0.5) / radius);
            let square = x * x + y * y;
            if square < 1.0 { Vec3::new(x, y, (1.0 - square).sqrt()) } else { background }
        })
    }

    #[test]
    fn marks_the_background_only() {
        // Facing the camera, tilted, and white.
        for vector in [Vec3::Z, Vec3::new(0.6, 0.0, 0.8), Vec3::ONE] {
            let got = flat_background(&ball(40.0, vector)).unwrap();
            let want = ball(40.0, Vec3::ZERO).map(|n| *n == Vec3::ZERO);
            assert_eq!(got, want, "{vector}");
        }
        // Rounded to codes of 8 bits.
        let coded = ball(40.0, Vec3::Z).map(|n| ((*n * 127.5 + 127.5).round() / 127.5 - 1.0).normalize());
        let marked = flat_background(&coded).unwrap().as_slice().iter().filter(|b| **b).count();
        assert_eq!(marked, ball(40.0, Vec3::ZERO).as_slice().iter().filter(|n| **n == Vec3::ZERO).count());
    }

    #[test]
    fn keeps_maps_without_a_flat_background() {
        assert_eq!(flat_background(&ball(40.0, Vec3::ZERO)), None);
        assert_eq!(flat_background(&ball(40.0, Vec3::NAN)), None);
        assert_eq!(flat_background(&ball(80.0, Vec3::Z)), None, "the object fills the picture");
        assert_eq!(flat_background(&Plane::from_fn(SIZE, SIZE, |_, _| Vec3::Z)), None, "a flat object");
        // A board with a bump, and fabric.
        let bump = ball(30.0, Vec3::Z).map(|n| (*n + 9.0 * Vec3::Z).normalize());
        assert_eq!(flat_background(&bump), None);
        let fabric = |x: usize, y: usize| Vec3::new((x as f32).sin(), (y as f32).cos(), 3.0).normalize();
        assert_eq!(flat_background(&Plane::from_fn(SIZE, SIZE, fabric)), None);
    }
}
