//! Distinguishes a matte ball from a mirror ball.

use faer::Mat;
use gonio_linalg::solve_positive;

use super::View;
use crate::picture::luminance;
use crate::scene::PixelStatus;

/// Share of the variation explained by smooth shading above which a ball appears matte. Matte balls
/// reach 0.99: shading by any light has hardly more than nine harmonics of the normal (Ramamoorthi
/// and Hanrahan 2001). Mirrors of lights with any detail remain far below.
const MATTE: f64 = 0.97;
/// Standard deviation of the brightness, relative to its mean, below which there is no shading.
const EVEN: f64 = 0.02;
/// Approximate number of pixels that are examined.
const PIXELS: usize = 4000;

/// Returns the share of the ball's variation that shading by nine harmonics of the normal explains.
///
/// Returns `None` if the share is too small for a matte ball.
pub(super) fn matte(view: &View) -> Option<f64> {
    let width = view.rgb().width();
    let used = || {
        view.statuses()
            .as_slice()
            .iter()
            .enumerate()
            .filter(|(_, status)| **status == PixelStatus::Used)
            .map(|(i, _)| i)
    };
    let step = (used().count() / PIXELS).max(1);
    let mut gram = Mat::<f64>::zeros(9, 9);
    let mut right = vec![0.0; 9];
    let (mut count, mut sum, mut squares) = (0.0, 0.0, 0.0);
    for i in used().step_by(step) {
        let Some(seen) = view.ball().reflection_at(((i % width) as f64 + 0.5, (i / width) as f64 + 0.5)) else {
            continue;
        };
        let n = seen.normal;
        let row = [1.0, n.x, n.y, n.z, n.x * n.y, n.y * n.z, n.z * n.x, n.x * n.x - n.y * n.y, 3.0 * n.z * n.z - 1.0];
        let value = f64::from(luminance(view.rgb().as_slice()[i]));
        for a in 0..9 {
            right[a] += row[a] * value;
            (0..9).for_each(|b| gram[(a, b)] += row[a] * row[b]);
        }
        count += 1.0;
        sum += value;
        squares += value * value;
    }
    let variation = squares - sum * sum / count;
    if count < 100.0 || variation <= (EVEN * sum / count).powi(2) * count {
        return None;
    }
    let solution = solve_positive(gram, &right)?;
    // The residual is the sum of squares minus the explained part.
    let left = squares - solution.iter().zip(&right).map(|(x, r)| x * r).sum::<f64>();
    let explained = 1.0 - left / variation;
    (explained >= MATTE).then_some(explained.min(1.0))
}
