//! Balls before one background: the outline of one, or several that do not touch.

use super::components::flood;
use super::{Circle, SceneError, coverage_of, find_sphere};
use crate::picture::{Picture, Plane};

/// Pixels of a ball, at least, and its share of the largest one.
const LEAST: (usize, f64) = (200, 0.03);

/// Distance in pixels to which the soft outline of a ball reaches.
const SOFT: usize = 2;

/// Outline of the largest ball in a picture. `mask` says where it is; without one the alpha channel
/// does, or a constant background.
///
/// # Errors
/// Errors of the outline ([`SceneError::is_of_outline`]).
pub fn outline_of_ball(picture: &Picture, mask: Option<&Plane<f32>>) -> Result<Circle, SceneError> {
    Ok(find_sphere(&coverage_of(picture, mask).ok_or(SceneError::NoOutline)?)?.circle)
}

/// Coverage of each ball, by falling size, where a picture shows several that do not touch. What is
/// small beside the largest, or no ball, is left out. Where objects are is told as for
/// [`outline_of_ball`]; empty if nothing tells.
pub fn separate_balls(picture: &Picture, mask: Option<&Plane<f32>>) -> Vec<Plane<f32>> {
    let found = coverage_of(picture, mask).filter(|coverage| coverage.size() == picture.rgb.size());
    let Some(coverage) = found else { return Vec::new() };
    let (width, height) = coverage.size();
    let open = |at: (usize, usize)| coverage[at] >= 0.5;
    let mut reached = coverage.map(|_| false);
    let mut parts = Vec::new();
    for seed in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
        let count = flood(&mut reached, [seed], true, open);
        if count >= LEAST.0 {
            parts.push((count, seed));
        }
    }
    parts.sort_by_key(|(count, _)| std::cmp::Reverse(*count));
    let largest = parts.first().map_or(0, |(count, _)| *count) as f64;
    let parts = parts.into_iter().filter(|(count, _)| *count as f64 >= LEAST.1 * largest);
    let alone = parts.map(|(_, seed)| {
        let mut own = coverage.map(|_| false);
        flood(&mut own, [seed], true, open);
        soft(&coverage, &own)
    });
    alone.filter(|ball| find_sphere(ball).is_ok()).collect()
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
    fn balls_are_told_apart_and_what_is_none_is_left_out() {
        let inside = |x: usize, y: usize, cx: f32, r: f32| (x as f32 - cx).hypot(y as f32 - 40.0) < r;
        let rgb = Plane::from_fn(200, 80, |x, y| {
            let ball = inside(x, y, 40.0, 20.0) || inside(x, y, 110.0, 30.0);
            let other = inside(x, y, 155.0, 2.0) || (x > 165 && y > 20 && y < 60);
            if ball || other { Vec3::splat(0.3 + 0.01 * x as f32) } else { Vec3::ZERO }
        });
        let picture = Picture { rgb, alpha: None };
        let parts = separate_balls(&picture, None);
        assert_eq!(parts.len(), 2);
        assert!(parts[0][(110, 40)] == 1.0 && parts[0][(40, 40)] == 0.0);
        assert!(parts[1][(40, 40)] == 1.0 && parts[1][(110, 40)] == 0.0 && parts[1][(155, 40)] == 0.0);
        let outline = outline_of_ball(&picture, Some(&parts[1])).unwrap();
        assert!((outline.x - 40.5).abs() < 0.5 && (outline.radius - 20.0).abs() < 0.7, "{outline:?}");
        let plain = Picture { rgb: Plane::from_fn(20, 20, |x, y| Vec3::splat((x + 20 * y) as f32)), alpha: None };
        assert!(separate_balls(&plain, None).is_empty());
    }
}
