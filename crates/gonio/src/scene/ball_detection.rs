//! Detection of a ball in an image by a mask, an alpha channel, a uniform background, or its edges.

use glam::Vec3;

use super::background::plain_coverage;
use super::balls::single;
use super::circle::{DetectedCircle, outline};
use super::circle_detection::{CircleDetection, OutlineReliability, SURE};
use super::circle_fit::fit_circle;
use super::edges::Edges;
use super::rim::polished;
use super::small::Small;
use super::{Circle, SceneError, coverage_of, find_sphere};
use crate::picture::{Picture, Plane};

/// Longer side of the reduced picture in which the object is detected, in pixels.
pub(super) const REDUCED_SIDE: usize = 512;
/// Smallest share of the object on a plain background that a circle detected by its edges must
/// contain.
const HELD: f64 = 0.9;
/// Support from which a circle is the ball although it does not contain that share.
const DISTINCT: f64 = 0.8;
/// Error of a given outline above which it is reported: pixels, and share of the radius.
const OFF: (f64, f64) = (1.5, 0.01);
/// Sizes of the ball, relative to a given outline, near which its edges are also searched.
const SIZES: [f64; 4] = [0.92, 0.96, 1.04, 1.08];
/// Largest residual of an outline in a file without compression losses, in pixels.
const CRISP: f64 = 0.6;
/// Largest deviation of an outline from a circle near which edges are searched: in pixels, plus a
/// share of the radius.
const ROUGH: (f64, f64) = (3.0, 0.06);

/// A detected ball.
pub(super) struct BallDetection {
    /// Outline of the ball.
    pub(super) circle: Circle,
    /// Coverage by mask, alpha channel or constant background; `None` without them.
    pub(super) coverage: Option<Plane<f32>>,
    /// Reliability of the outline, if it was detected by a vote.
    pub(super) reliability: Option<OutlineReliability>,
}

/// Detects the ball in a picture.
///
/// The ball is the result of [`find_sphere`] in the mask, alpha channel or constant background,
/// else the most distinct circle. If the background is plain except for noise, this circle must
/// contain the object.
///
/// # Errors
/// Errors of the outline; [`SceneError::Several`] for several objects without a mask;
/// [`SceneError::Unsure`] if no circle is distinct enough; [`SceneError::NoOutline`] if there is no
/// circle.
pub(super) fn detect_ball(picture: &Picture, mask: Option<&Plane<f32>>) -> Result<BallDetection, SceneError> {
    let known = coverage_of(picture, mask).map(|coverage| {
        let ball = in_coverage(&coverage, mask.is_some());
        (coverage, ball)
    });
    let of_background = mask.is_none() && picture.varying_alpha().is_none();
    let by_edges = match &known {
        Some((_, Ok(ball))) => of_background && !is_crisp(ball),
        Some((_, Err(_))) => of_background,
        None => true,
    };
    let detected = if by_edges { detect_by_edges(&picture.rgb) } else { Err(SceneError::NoOutline) };
    match (detected, known) {
        (Ok((circle, reliability)), _) => Ok(BallDetection { circle, coverage: None, reliability: Some(reliability) }),
        // The background value is exact, except for compression losses.
        (Err(_), Some((coverage, Ok(ball)))) => {
            Ok(BallDetection { circle: ball.circle, coverage: Some(coverage), reliability: None })
        }
        // A texture of few values, such as stripes, is not a background.
        (Err(unsure @ SceneError::Unsure { .. }), Some((_, Err(_)))) => Err(unsure),
        (Err(_), Some((_, Err(error)))) => Err(error),
        (Err(error), None) => Err(error),
    }
}

/// Detects the single ball in a coverage.
///
/// If the coverage is a `given` mask, only its largest part counts.
fn in_coverage(coverage: &Plane<f32>, given: bool) -> Result<DetectedCircle, SceneError> {
    if !given {
        single(coverage, |part| find_sphere(part).ok().map(|ball| ball.circle))?;
    }
    find_sphere(coverage)
}

/// Whether an outline is as accurate as that of a picture without compression losses.
pub(super) fn is_crisp(ball: &DetectedCircle) -> bool {
    ball.residual <= CRISP
}

/// Detects the most distinct circle.
fn detect_by_edges(rgb: &Plane<Vec3>) -> Result<(Circle, OutlineReliability), SceneError> {
    let small = Small::of(rgb, REDUCED_SIDE);
    let edges = Edges::of(&small);
    let Some(coverage) = plain_coverage(&small, rgb.size()) else {
        let vote = CircleDetection::of(rgb, &small, &edges, None);
        return match vote.winner(false) {
            Some(winner) => Ok(winner),
            None if vote.candidates.is_empty() => Err(SceneError::NoOutline),
            None => Err(vote.unsure()),
        };
    };
    single(&coverage, |part| on_edges(rgb, &small, &edges, part))?;
    let vote = CircleDetection::of(rgb, &small, &edges, rough(&coverage).as_ref());
    // If all foreground lies within the circle, no other object can be the ball.
    if let Some(winner) = vote.winner(true)
        && share_within(&coverage, &winner.0) >= HELD
    {
        return Ok(winner);
    }
    match vote.winner(false) {
        Some(winner) if winner.1.support >= DISTINCT => Ok(winner),
        _ => Err(find_sphere(&coverage).err().unwrap_or_else(|| vote.unsure())),
    }
}

/// Fits a circle to the outline of a roughly circular coverage.
///
/// Compression losses may blur the outline by some pixels.
fn rough(coverage: &Plane<f32>) -> Option<Circle> {
    let fit = fit_circle(&outline(coverage).ok()?)?;
    (fit.spread <= ROUGH.0 + ROUGH.1 * fit.circle.radius).then_some(fit.circle)
}

/// Returns the circle on the edges near a given outline of a ball, if the given one is clearly off
/// these edges.
pub(super) fn corrected(rgb: &Plane<Vec3>, given: &Circle) -> Option<Circle> {
    let small = Small::of(rgb, REDUCED_SIDE);
    let edges = Edges::of(&small);
    let near = |factor: f64| {
        let rough = edges.ring(&Circle { radius: factor * given.radius, ..*given });
        edges.refined(rgb, &small, &rough).filter(|(ring, _)| edges.support(ring) >= DISTINCT)
    };
    let is_off = |circle: &Circle| {
        let off = (circle.x - given.x).hypot(circle.y - given.y) + (circle.radius - given.radius).abs();
        off > OFF.0 + OFF.1 * circle.radius
    };
    let nearest = near(1.0);
    if nearest.as_ref().is_some_and(|(_, circle)| !is_off(circle)) {
        return None;
    }
    let found = SIZES.into_iter().filter_map(near).chain(nearest);
    let (ring, circle) = found.max_by(|a, b| a.0.weight().total_cmp(&b.0.weight()))?;
    let circle = polished(rgb, &small, &circle);
    let is_better = edges.tight_support(&edges.ring(given)) < edges.tight_support(&ring);
    (is_off(&circle) && is_better).then_some(circle)
}

/// Detects the outline of a ball on edges of the photograph near the outline of a coverage.
pub(super) fn on_edges(rgb: &Plane<Vec3>, small: &Small, edges: &Edges, coverage: &Plane<f32>) -> Option<Circle> {
    let (ring, circle) = edges.refined(rgb, small, &edges.ring(&rough(coverage)?))?;
    let is_ball = edges.support(&ring) >= SURE && share_within(coverage, &circle) >= HELD;
    is_ball.then(|| polished(rgb, small, &circle))
}

/// Returns the share of the coverage that lies within a circle.
fn share_within(coverage: &Plane<f32>, circle: &Circle) -> f64 {
    let width = coverage.width();
    let (mut all, mut within) = (0.0, 0.0);
    for (i, covered) in coverage.as_slice().iter().enumerate() {
        let off = ((i % width) as f64 + 0.5 - circle.x).hypot((i / width) as f64 + 0.5 - circle.y);
        all += f64::from(*covered);
        if off <= circle.radius + 2.0 {
            within += f64::from(*covered);
        }
    }
    within / f64::max(all, 1.0)
}

/// Returns the coverage of an object that is not a distant ball.
///
/// The sources are those of [`coverage_of`], or else a background that is plain except for noise.
///
/// # Errors
/// [`SceneError::NoOutline`] if no source is available; [`SceneError::Several`] as for
/// [`detect_ball`].
pub(crate) fn outlined(picture: &Picture, mask: Option<&Plane<f32>>) -> Result<Plane<f32>, SceneError> {
    let plain = || plain_coverage(&Small::of(&picture.rgb, REDUCED_SIDE), picture.rgb.size());
    let coverage = coverage_of(picture, mask).or_else(plain).ok_or(SceneError::NoOutline)?;
    if mask.is_none() {
        single(&coverage, |part| find_sphere(part).ok().map(|ball| ball.circle))?;
    }
    Ok(coverage)
}

#[cfg(test)]
mod tests;
