//! Outline of the largest ball in a picture, and separation of balls that do not touch.

use super::background::plain_coverage;
use super::ball_detection::{REDUCED_SIDE, detect_ball, is_crisp, on_edges};
use super::components::{Component, components};
use super::edges::Edges;
use super::small::Small;
use super::{Circle, OutlineReliability, SceneError, coverage_of, find_sphere};
use crate::picture::{Picture, Plane};

/// Smallest number of pixels of a ball, and smallest share of the pixels of the largest one.
const MIN_BALL: (usize, f64) = (200, 0.03);
/// Smallest number of pixels of a separate object, as a share of the largest.
const SECOND: f64 = 0.2;

/// Distance in pixels by which the soft outline of a ball extends beyond its covered pixels.
const SOFT: usize = 2;

/// Extent of one of several objects.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extent {
    /// Column and row of the upper left corner of its bounding box, in pixels.
    pub from: (usize, usize),
    /// Column and row of the lower right corner, exclusive.
    pub to: (usize, usize),
    /// Outline of the object, if it is a ball.
    pub circle: Option<Circle>,
}

/// Returns the outline of the largest ball in a picture, and its reliability if it was detected by
/// its edges.
///
/// The object is given by `mask`, else by the alpha channel, a plain background, or edges.
///
/// # Errors
/// Errors of the outline ([`SceneError::is_of_outline`]); [`SceneError::Several`] for several
/// objects without a mask; [`SceneError::Unsure`] and [`SceneError::NoOutline`] if no ball is
/// detected reliably.
pub fn outline_of_ball(
    picture: &Picture,
    mask: Option<&Plane<f32>>,
) -> Result<(Circle, Option<OutlineReliability>), SceneError> {
    detect_ball(picture, mask).map(|spotted| (spotted.circle, spotted.reliability))
}

/// Returns the coverage of each ball that touches no other, by decreasing size.
///
/// Parts that are small compared with the largest, or that are not balls, are omitted. The coverage
/// has the same sources as for [`outline_of_ball`], except edges; without a source, the result is
/// empty.
pub fn separate_balls(picture: &Picture, mask: Option<&Plane<f32>>) -> Vec<Plane<f32>> {
    let size = picture.rgb.size();
    let alone = |coverage: &Plane<f32>| -> Vec<Plane<f32>> {
        let separate = if coverage.size() == size { parts(coverage, MIN_BALL.1) } else { Vec::new() };
        separate.iter().map(|part| soft(coverage, part)).collect()
    };
    let given = mask.is_some() || picture.varying_alpha().is_some();
    let known = coverage_of(picture, mask).map(|coverage| alone(&coverage)).unwrap_or_default();
    let found = |ball: &Plane<f32>| find_sphere(ball).ok();
    if given || known.iter().filter_map(found).all(|ball| is_crisp(&ball)) && known.len() > 1 {
        return known.into_iter().filter(|ball| found(ball).is_some()).collect();
    }
    // A background that is plain except for noise or compression losses.
    let small = Small::of(&picture.rgb, REDUCED_SIDE);
    let Some(coverage) = plain_coverage(&small, size) else { return Vec::new() };
    let edges = Edges::of(&small);
    let circle = |part: &Plane<f32>| on_edges(&picture.rgb, &small, &edges, part);
    alone(&coverage).iter().filter_map(circle).map(|circle| circle.coverage(size)).collect()
}

/// Checks that there is a single object; `ball` returns the outline of a part that is a ball.
///
/// # Errors
/// [`SceneError::Several`] with all objects that have at least a fifth of the pixels of the
/// largest.
pub(super) fn single(coverage: &Plane<f32>, ball: impl Fn(&Plane<f32>) -> Option<Circle>) -> Result<(), SceneError> {
    let objects = parts(coverage, SECOND);
    if objects.len() < 2 {
        return Ok(());
    }
    Err(SceneError::Several { objects: objects.iter().map(|part| extent(&soft(coverage, part), &ball)).collect() })
}

/// Returns the connected parts by decreasing size.
///
/// Parts with less than `share` of the pixels of the largest are omitted.
fn parts(coverage: &Plane<f32>, share: f64) -> Vec<Component> {
    let mut parts = components(coverage.size(), true, |at| coverage[at] >= 0.5);
    parts.retain(|part| part.len() >= MIN_BALL.0);
    parts.sort_by_key(|part| std::cmp::Reverse(part.len()));
    let largest = parts.first().map_or(0, Component::len) as f64;
    parts.retain(|part| part.len() as f64 >= share * largest);
    parts
}

fn extent(of: &Plane<f32>, ball: impl Fn(&Plane<f32>) -> Option<Circle>) -> Extent {
    let (mut from, mut to) = (of.size(), (0, 0));
    for (i, _) in of.as_slice().iter().enumerate().filter(|(_, covered)| **covered >= 0.5) {
        let (x, y) = (i % of.width(), i / of.width());
        from = (from.0.min(x), from.1.min(y));
        to = (to.0.max(x + 1), to.1.max(y + 1));
    }
    Extent { from, to, circle: ball(of) }
}

/// Returns the coverage on and near a part, zero elsewhere.
fn soft(coverage: &Plane<f32>, part: &Component) -> Plane<f32> {
    let near = part.mask(SOFT, coverage.size());
    let values = coverage.as_slice().iter().zip(near.as_slice());
    Plane::from_vec(coverage.width(), coverage.height(), values.map(|(c, near)| if *near { *c } else { 0.0 }).collect())
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    #[test]
    fn separates_balls_and_omits_other_shapes() {
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
        let (outline, _) = outline_of_ball(&picture, Some(&parts[1])).unwrap();
        assert!((outline.x - 40.5).abs() < 0.5 && (outline.radius - 20.0).abs() < 0.7, "{outline:?}");
        let opaque = Picture { alpha: Some(picture.rgb.map(|_| 1.0)), ..picture.clone() };
        assert_eq!(separate_balls(&opaque, None), parts);
        let plain = Picture { rgb: Plane::from_fn(20, 20, |x, y| Vec3::splat((x + 20 * y) as f32)), alpha: None };
        assert!(separate_balls(&plain, None).is_empty());
    }
}
