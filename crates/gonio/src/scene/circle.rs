//! Detection of the outline of a ball in a mask.

use std::f64::consts::{PI, TAU};

use glam::DVec2;

use super::SceneError;
use super::circle_fit::{Circle, Fit, aspect, fit_arc, fit_circle};
use super::components::{border, fill_holes, largest_component, neighbours};
use crate::picture::Plane;

/// Smallest radius of a ball, in pixels.
pub(super) const MIN_BALL_RADIUS: f64 = 8.0;
/// Smallest angle that the visible outline must span, in radians: 75 degrees, so that a ball in a
/// corner of the picture is accepted.
pub(super) const MIN_SPAN: f64 = 5.0 * PI / 12.0;
/// Smallest ratio of the shorter to the longer axis of a ball's outline: that of a ball 18 degrees
/// off the axis of a perspective camera.
const MIN_ASPECT: f64 = 0.95;
/// Largest share of the outline that may lie far off the circle (a stand, a finger).
const MAX_STRAY: f64 = 0.3;
/// The same share of a ball that a straight edge hides up to its middle: 2 / (2 + pi), rounded up.
const MAX_HIDDEN: f64 = 0.4;
/// Largest deviation of an outline from a circle, as a share of the radius, besides half a pixel.
const MAX_SPREAD: f64 = 0.03;
/// The same share for a ball that a straight edge hides in part.
const MAX_HIDDEN_SPREAD: f64 = 0.01;

/// Outline of a ball and its deviation from a circle.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DetectedCircle {
    /// The circle.
    pub circle: Circle,
    /// Root mean square distance of the outline to the circle, in pixels, without the stray points.
    pub residual: f64,
}

/// Detects the outline of an orthographic ball in a mask or an alpha channel.
///
/// Coverage ranges from 0 to 1, with half-covered pixels at the rim; NaN counts as 0.
///
/// The ball is the largest connected set of pixels with a coverage of at least one half, with its
/// holes filled. Its rim is where the coverage, interpolated between neighbouring pixels, is one
/// half; there is no rim where the border of the picture crops the ball. The circle is fitted to
/// the rim by robust least squares, without points far off (a stand, a finger, a straight edge that
/// hides up to half of the ball).
///
/// # Errors
/// * [`SceneError::EmptyMask`] and [`SceneError::MaskEverywhere`].
/// * [`SceneError::TooSmall`] for a radius under 8 pixels.
/// * [`SceneError::ShortOutline`] when the visible outline spans less than 75 degrees.
/// * [`SceneError::Elliptic`] when the shorter axis is under 0.95 of the longer.
/// * [`SceneError::NotACircle`] when the outline deviates by more than half a pixel plus 3 % of the
///   radius, or when more than 30 % of it lies far off (1 % and 40 % for a hidden ball).
pub(crate) fn find_sphere(coverage: &Plane<f32>) -> Result<DetectedCircle, SceneError> {
    let (ball, rim) = ball_and_rim(coverage)?;
    // No circle fits a straight edge: the visible outline spans no angle.
    let short = |span: f64| SceneError::ShortOutline { degrees: span.to_degrees() };
    let cropped = border(ball.size()).any(|at| ball[at]);
    let mut fit = fit_circle(&rim).ok_or_else(|| if cropped { short(0.0) } else { no_circle(&rim) })?;
    let is_good = |fit: &Fit, stray: f64, spread: f64| {
        fit.spread <= 0.5 + spread * fit.circle.radius
            && (rim.len() - fit.near.len()) as f64 <= stray * rim.len() as f64
    };
    let mut accepted = is_good(&fit, MAX_STRAY, MAX_SPREAD);
    if !accepted && let Some(arc) = fit_arc(&rim).filter(|arc| is_good(arc, MAX_HIDDEN, MAX_HIDDEN_SPREAD)) {
        (fit, accepted) = (arc, true);
    }
    let circle = fit.circle;
    let stray = rim.len() - fit.near.len();
    let span = span(&fit.near, &circle);
    let aspect = if span >= PI { aspect(&fit.near, &circle) } else { 1.0 };
    if !accepted {
        // A clear ellipse is reported as such even where no circle fits it.
        return Err(if (0.5..MIN_ASPECT).contains(&aspect) && stray == 0 {
            SceneError::Elliptic { aspect, under_camera: false }
        } else {
            SceneError::NotACircle { residual: fit.spread, radius: circle.radius, stray, rim: rim.len() }
        });
    }
    if span < MIN_SPAN {
        return Err(if cropped { short(span) } else { no_circle(&rim) });
    }
    if circle.radius < MIN_BALL_RADIUS {
        return Err(SceneError::TooSmall { radius: circle.radius });
    }
    if aspect < MIN_ASPECT {
        return Err(SceneError::Elliptic { aspect, under_camera: false });
    }
    let squares = fit.near.iter().map(|p| (p.distance(DVec2::new(circle.x, circle.y)) - circle.radius).powi(2));
    Ok(DetectedCircle { circle, residual: (squares.sum::<f64>() / fit.near.len() as f64).sqrt() })
}

/// Returns the error for a closed outline that no circle fits.
///
/// It reports the circle about the mean of the points, with their mean distance as radius.
fn no_circle(rim: &[DVec2]) -> SceneError {
    let mean = |of: &dyn Fn(&DVec2) -> f64| rim.iter().map(of).sum::<f64>() / rim.len().max(1) as f64;
    let middle = DVec2::new(mean(&|p| p.x), mean(&|p| p.y));
    let radius = mean(&|p| p.distance(middle));
    SceneError::NotACircle {
        residual: mean(&|p| (p.distance(middle) - radius).abs()),
        radius,
        stray: 0,
        rim: rim.len(),
    }
}

/// Returns the largest connected part of a mask, with holes filled, and the points of its rim.
fn ball_and_rim(coverage: &Plane<f32>) -> Result<(Plane<bool>, Vec<DVec2>), SceneError> {
    let covered = |at: (usize, usize)| coverage[at] >= 0.5;
    let largest = largest_component(coverage.size(), covered).ok_or(SceneError::EmptyMask)?;
    let ball = fill_holes(&largest.mask(0, coverage.size()));
    if ball.as_slice().iter().all(|&b| b) {
        return Err(SceneError::MaskEverywhere);
    }
    // The smallest area is a quarter of a disc of the smallest radius, cropped by a picture corner.
    let equal_area = (largest.len() as f64 / PI).sqrt();
    if equal_area < 0.5 * MIN_BALL_RADIUS {
        return Err(SceneError::TooSmall { radius: equal_area });
    }
    let rim = rim_points(coverage, &ball);
    Ok((ball, rim))
}

/// Returns the points of the outline of the largest connected part of a mask, in pixels.
///
/// Points where the border of the picture crops the part are omitted.
pub(super) fn outline(coverage: &Plane<f32>) -> Result<Vec<DVec2>, SceneError> {
    let (_, rim) = ball_and_rim(coverage)?;
    if rim.len() < 16 { Err(SceneError::ShortOutline { degrees: 0.0 }) } else { Ok(rim) }
}

/// Returns the points between the ball and its surroundings where the coverage is one half.
///
/// The coverage is interpolated between each pixel of the ball and its neighbours outside.
fn rim_points(coverage: &Plane<f32>, ball: &Plane<bool>) -> Vec<DVec2> {
    let mut points = Vec::new();
    let (width, mask) = (ball.width(), ball.as_slice());
    for y in 0..ball.height() {
        for x in 0..width {
            let i = y * width + x;
            // A pixel whose four neighbours are in the ball has no point of the outline.
            let is_off_border = x > 0 && x + 1 < width && y > 0 && y + 1 < ball.height();
            let is_inner = is_off_border && [i - 1, i + 1, i - width, i + width].iter().all(|next| mask[*next]);
            if !mask[i] || is_inner {
                continue;
            }
            let inside = f64::from(coverage[(x, y)]).min(1.0);
            for (u, v) in neighbours((x, y), ball.size(), false).filter(|&at| !ball[at]) {
                // NaN becomes 0 here, as `max` does not propagate it.
                let outside = f64::from(coverage[(u, v)]).max(0.0);
                let (from, to) = (DVec2::new(x as f64, y as f64), DVec2::new(u as f64, v as f64));
                points.push(from.lerp(to, (inside - 0.5) / (inside - outside)) + 0.5);
            }
        }
    }
    points
}

/// Returns the full angle minus the largest angular gap between points, in radians.
fn span(points: &[DVec2], circle: &Circle) -> f64 {
    let mut angles: Vec<f64> = points.iter().map(|p| (p.y - circle.y).atan2(p.x - circle.x)).collect();
    angles.sort_unstable_by(f64::total_cmp);
    let (Some(first), Some(last)) = (angles.first(), angles.last()) else { return 0.0 };
    let widest = angles.windows(2).map(|pair| pair[1] - pair[0]).fold(first + TAU - last, f64::max);
    // Neighbouring points of a closed outline are about a pixel apart.
    if widest * circle.radius < 3.0 { TAU } else { TAU - widest }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::suggestion::Suggestion;

    /// Coverage of an ellipse, from 8 x 8 samples per pixel if `soft`, else from the pixel's
    /// centre.
    fn ellipse(size: (usize, usize), (cx, cy): (f64, f64), (a, b): (f64, f64), soft: bool) -> Plane<f32> {
        let n = if soft { 8 } else { 1 };
        Plane::from_fn(size.0, size.1, |x, y| {
            let inside = (0..n * n).filter(|i| {
                let at = |whole: usize, part: usize| whole as f64 + (part as f64 + 0.5) / n as f64;
                ((at(x, i % n) - cx) / a).hypot((at(y, i / n) - cy) / b) <= 1.0
            });
            inside.count() as f32 / (n * n) as f32
        })
    }

    /// Points of the outline of a mask, and how a circle fits them.
    fn outline_of(mask: &Plane<f32>) -> (usize, Fit) {
        let (_, rim) = ball_and_rim(mask).unwrap();
        (rim.len(), fit_circle(&rim).unwrap())
    }

    fn stray(mask: &Plane<f32>) -> usize {
        let (rim, fit) = outline_of(mask);
        rim - fit.near.len()
    }

    fn is_cropped(mask: &Plane<f32>) -> bool {
        let (ball, _) = ball_and_rim(mask).unwrap();
        border(ball.size()).any(|at| ball[at])
    }

    fn check(mask: &Plane<f32>, (x, y): (f64, f64), radius: f64, tolerance: f64) -> DetectedCircle {
        let found = find_sphere(mask).unwrap();
        let c = found.circle;
        let error = (c.x - x).abs().max((c.y - y).abs()).max((c.radius - radius).abs());
        assert!(error < tolerance, "{found:?}");
        found
    }

    #[test]
    fn locates_full_balls_to_a_fraction_of_a_pixel() {
        for (centre, radius) in [((60.3, 55.8), 41.7), ((64.0, 64.0), 50.0), ((30.5, 70.2), 8.4), ((62.1, 61.9), 57.5)]
        {
            let [soft, hard] = [true, false].map(|soft| ellipse((128, 128), centre, (radius, radius), soft));
            let found = check(&soft, centre, radius, 0.02);
            let (_, fit) = outline_of(&soft);
            assert!(found.residual < 0.1 && !is_cropped(&soft) && stray(&soft) == 0, "{found:?}");
            assert_eq!(span(&fit.near, &fit.circle), TAU);
            let found = check(&hard, centre, radius, 0.2);
            let (_, fit) = outline_of(&hard);
            let eccentricity = (1.0 - aspect(&fit.near, &fit.circle).powi(2)).max(0.0).sqrt();
            assert!(found.residual < 0.4 && eccentricity < 0.25, "{found:?} {eccentricity}");
        }
    }

    #[test]
    fn completes_cropped_balls() {
        for (centre, radius) in [((10.0, 60.0), 50.0), ((64.0, 64.0), 75.0), ((0.0, 0.0), 80.0), ((64.0, 120.0), 70.0)]
        {
            let mask = ellipse((128, 128), centre, (radius, radius), true);
            check(&mask, centre, radius, 0.1);
            assert!(is_cropped(&mask));
        }
    }

    #[test]
    fn ignores_specks_holes_and_a_stand() {
        let mut mask = ellipse((128, 128), (60.3, 55.8), (41.7, 41.7), true);
        for (x, y) in [(3, 3), (4, 3), (120, 7), (118, 120)] {
            mask[(x, y)] = 1.0;
        }
        for (x, y) in [(60, 50), (61, 50), (40, 70), (70, 30)] {
            mask[(x, y)] = if x == 40 { f32::NAN } else { 0.0 };
        }
        check(&mask, (60.3, 55.8), 41.7, 0.02);
        let (ball, _) = ball_and_rim(&mask).unwrap();
        let outside = mask.as_slice().iter().zip(ball.as_slice()).filter(|(c, inside)| **c >= 0.5 && !**inside);
        assert_eq!((outside.count(), stray(&mask)), (4, 0));
        for y in 95..128 {
            for x in 55..63 {
                mask[(x, y)] = 1.0;
            }
        }
        check(&mask, (60.3, 55.8), 41.7, 0.05);
        assert!(stray(&mask) > 40 && is_cropped(&mask));
    }

    #[test]
    fn accepts_slight_ellipses_and_measures_their_axes() {
        let mask = ellipse((128, 128), (64.0, 64.0), (50.0, 49.0), true);
        check(&mask, (64.0, 64.0), 49.5, 0.05);
        let (_, fit) = outline_of(&mask);
        let eccentricity = |aspect: f64| (1.0 - aspect * aspect).sqrt();
        let got = eccentricity(aspect(&fit.near, &fit.circle));
        assert!((got - eccentricity(0.98)).abs() < 0.01, "{got}");
    }

    #[test]
    fn finds_balls_that_an_object_in_front_hides_in_part() {
        for (x, y, depth) in [(1.0, 0.0, 0.0), (1.0, 0.0, 0.3), (0.0, 1.0, 0.5), (0.6, -0.8, 0.1)] {
            // Hides what lies beyond `depth` radii along a direction.
            let whole = ellipse((128, 128), (64.0, 64.0), (50.0, 50.0), true);
            let along = |at: (usize, usize)| (at.0 as f64 + 0.5 - 64.0) * x + (at.1 as f64 + 0.5 - 64.0) * y;
            let mask = Plane::from_fn(128, 128, |x, y| if along((x, y)) > 50.0 * depth { 0.0 } else { whole[(x, y)] });
            check(&mask, (64.0, 64.0), 50.0, 0.3);
        }
        // A tenth of the ball is too little.
        let mask = ellipse((128, 128), (64.0, 64.0), (50.0, 50.0), true);
        let tenth = Plane::from_fn(128, 128, |x, y| if x > 25 { 0.0 } else { mask[(x, y)] });
        assert!(matches!(find_sphere(&tenth).unwrap_err(), SceneError::NotACircle { .. }));
    }

    #[test]
    fn rejects_outlines_that_are_not_circles() {
        let refused = |mask: &Plane<f32>| find_sphere(mask).unwrap_err();
        for b in [46.0, 40.0, 30.0] {
            let error = refused(&ellipse((128, 128), (64.0, 64.0), (50.0, b), true));
            assert!(
                matches!(error, SceneError::Elliptic { aspect, .. } if (aspect - b / 50.0).abs() < 0.03),
                "{b} {error}"
            );
        }
        let square = Plane::from_fn(128, 128, |x, y| f32::from((30..90).contains(&x) && (30..90).contains(&y)));
        assert!(matches!(refused(&square), SceneError::NotACircle { .. }));
        assert_eq!(refused(&square).suggestions()[0], Suggestion::Mesh);
        let vase = refused(&ellipse((128, 128), (64.0, 64.0), (50.0, 30.0), true));
        assert_eq!(vase.suggestions()[..2], [Suggestion::Mesh, Suggestion::Normals]);
        let half = Plane::from_fn(128, 128, |x, _| f32::from(x < 60));
        assert!(matches!(refused(&half), SceneError::ShortOutline { .. }), "{}", refused(&half));
        assert!(matches!(
            refused(&ellipse((128, 128), (-400.0, 64.0), (450.0, 450.0), true)),
            SceneError::ShortOutline { .. }
        ));
    }

    #[test]
    fn rejects_masks_without_a_ball() {
        let refused = |mask: &Plane<f32>| find_sphere(mask).unwrap_err();
        assert_eq!(refused(&Plane::from_fn(20, 20, |_, _| 0.4)), SceneError::EmptyMask);
        assert_eq!(refused(&Plane::from_vec(0, 0, vec![])), SceneError::EmptyMask);
        assert_eq!(refused(&Plane::from_fn(20, 20, |_, _| 1.0)), SceneError::MaskEverywhere);
        let inverted = ellipse((64, 64), (32.0, 32.0), (20.0, 20.0), true).map(|c| 1.0 - c);
        assert_eq!(refused(&inverted), SceneError::MaskEverywhere);
        for radius in [2.0, 7.5] {
            let error = refused(&ellipse((64, 64), (32.0, 32.0), (radius, radius), true));
            assert!(matches!(error, SceneError::TooSmall { radius: r, .. } if (r - radius).abs() < 0.2), "{error}");
        }
    }
}
