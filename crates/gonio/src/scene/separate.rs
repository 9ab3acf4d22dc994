//! Several objects before one background.

use super::background_coverage;
use super::components::flood;
use crate::picture::{Picture, Plane};

/// Pixels of an object, at least, and its share of the largest one.
const LEAST: (usize, f64) = (200, 0.03);

/// Distance in pixels to which the soft outline of an object reaches.
const SOFT: usize = 2;

/// Coverage of each of several objects that do not touch, by falling size. `mask` says where they
/// are; without one the alpha channel does, or a constant background. Specks are left out. Empty if
/// nothing tells where objects are.
pub fn separate(picture: &Picture, mask: Option<&Plane<f32>>) -> Vec<Plane<f32>> {
    let found = mask.cloned().or_else(|| picture.alpha.clone()).or_else(|| background_coverage(&picture.rgb));
    let Some(coverage) = found.filter(|coverage| coverage.size() == picture.rgb.size()) else { return Vec::new() };
    let (width, height) = coverage.size();
    let mut taken = coverage.map(|_| false);
    let mut parts: Vec<(usize, Plane<bool>)> = Vec::new();
    for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
        if coverage[(x, y)] < 0.5 || taken[(x, y)] {
            continue;
        }
        let mut own = coverage.map(|_| false);
        let count = flood(&mut own, [(x, y)], true, |at| coverage[at] >= 0.5);
        let pixels = own.as_slice().iter().enumerate().filter(|(_, inside)| **inside).map(|(at, _)| at);
        pixels.for_each(|at| taken.as_mut_slice()[at] = true);
        if count >= LEAST.0 {
            parts.push((count, own));
        }
    }
    parts.sort_by_key(|(count, _)| std::cmp::Reverse(*count));
    let largest = parts.first().map_or(0, |(count, _)| *count) as f64;
    let parts = parts.into_iter().filter(|(count, _)| *count as f64 >= LEAST.1 * largest);
    parts.map(|(_, own)| soft(&coverage, &own)).collect()
}

/// The coverage on and around a set of pixels.
fn soft(coverage: &Plane<f32>, own: &Plane<bool>) -> Plane<f32> {
    let (width, height) = coverage.size();
    Plane::from_fn(width, height, |x, y| {
        let near = |at: usize, most: usize| at.saturating_sub(SOFT)..(at + SOFT + 1).min(most);
        let touches = near(y, height).any(|v| near(x, width).any(|u| own[(u, v)]));
        if touches { coverage[(x, y)] } else { 0.0 }
    })
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    #[test]
    fn discs_are_told_apart_and_specks_left_out() {
        let inside = |x: usize, y: usize, cx: f32, r: f32| (x as f32 - cx).hypot(y as f32 - 40.0) < r;
        let rgb = Plane::from_fn(160, 80, |x, y| {
            let bright = inside(x, y, 40.0, 20.0) || inside(x, y, 110.0, 30.0) || inside(x, y, 155.0, 2.0);
            if bright { Vec3::splat(0.3 + 0.01 * x as f32) } else { Vec3::ZERO }
        });
        let parts = separate(&Picture { rgb, alpha: None }, None);
        assert_eq!(parts.len(), 2);
        assert!(parts[0][(110, 40)] == 1.0 && parts[0][(40, 40)] == 0.0);
        assert!(parts[1][(40, 40)] == 1.0 && parts[1][(110, 40)] == 0.0 && parts[1][(155, 40)] == 0.0);
        let plain = Picture { rgb: Plane::from_fn(20, 20, |x, y| Vec3::splat((x + 20 * y) as f32)), alpha: None };
        assert!(separate(&plain, None).is_empty());
    }
}
