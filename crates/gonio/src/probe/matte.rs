//! Distinguishes a matte ball from a mirror ball.

use glam::{DVec3, Vec3};

use super::View;
use crate::picture::luminance;
use crate::scene::{PixelStatus, ShadingBasis};

/// Share of the variation explained by smooth shading above which a ball appears matte. Matte balls
/// reach 0.99: shading by any light has hardly more than nine harmonics of the normal (Ramamoorthi
/// and Hanrahan 2001). Mirrors of lights with any detail remain far below.
const MATTE: f64 = 0.97;
/// Standard deviation of the brightness, relative to its mean, below which there is no shading.
const EVEN: f64 = 0.02;
/// Approximate number of pixels that are examined.
const PIXELS: usize = 4000;
/// Smallest number of examined pixels.
const MIN_PIXELS: usize = 100;

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
    let (normals, values): (Vec<Vec3>, Vec<DVec3>) = used()
        .step_by(step)
        .filter_map(|i| {
            let seen = view.ball().reflection_at(((i % width) as f64 + 0.5, (i / width) as f64 + 0.5))?;
            let value = f64::from(luminance(view.rgb().as_slice()[i]));
            Some((seen.normal.as_vec3(), DVec3::splat(value)))
        })
        .unzip();
    let mean = values.iter().map(|v| v.x).sum::<f64>() / values.len() as f64;
    let variation = values.iter().map(|v| (v.x - mean).powi(2)).sum::<f64>();
    if values.len() < MIN_PIXELS || variation <= (EVEN * mean).powi(2) * values.len() as f64 {
        return None;
    }
    let basis = ShadingBasis::new(&normals, 2);
    let shading = basis.values(&basis.fit(&values, &vec![1.0; values.len()])?);
    let rest = values.iter().zip(shading).map(|(v, s)| (v.x - s.x).powi(2)).sum::<f64>();
    let explained = 1.0 - rest / variation;
    (explained >= MATTE).then_some(explained)
}
