//! Relight error: invariant to the common scale, which a photograph does not determine.

use glam::Vec3;
use gonio::colour::Chroma;
use gonio::picture::{Picture, luminance};
use gonio::reflectance::log_fit;

/// Relight error and its log version.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Relight {
    /// `min_s |s I^ - I| / |I|`.
    pub(crate) relative: f64,
    /// Root mean square of `ln((s I^ + e) / (I + e))`, `e` one percent of the mean of `I`, with the
    /// `s` that minimises it.
    pub(crate) log: f64,
    /// The `s` of the log version: the scale at which the estimate is shown beside the reference.
    pub(crate) scale: f64,
}

/// Errors of an RGB picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct RgbRelight {
    /// `min_s |s I^ - I| / |I|` over all pixels and channels: one scale for the three channels.
    pub(crate) relative: f64,
    /// Distance of the chroma of the mean pixel from that of the reference, in natural logarithms.
    pub(crate) mean_chroma: f64,
}

/// Luminances of the pixels of a sphere picture whose normal is within 80 degrees of the view.
pub(crate) fn sphere_pixels(picture: &Picture, radius: f64) -> Vec<f64> {
    let (width, height) = picture.rgb.size();
    let limit = 80.0_f64.to_radians().sin() * radius;
    (0..width * height)
        .filter(|i| {
            let (x, y) = ((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
            (x - 0.5 * width as f64).hypot(y - 0.5 * height as f64) < limit
        })
        .map(|i| f64::from(luminance(picture.rgb.as_slice()[i])))
        .collect()
}

/// Compares pictures of the same pixels under the same light.
pub(crate) fn relight(estimate: &[f64], reference: &[f64]) -> Relight {
    let inner = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let best = inner(estimate, reference) / inner(estimate, estimate).max(1e-300);
    let residual: f64 = estimate.iter().zip(reference).map(|(a, b)| (best * a - b).powi(2)).sum();
    let relative = (residual / inner(reference, reference)).sqrt();
    let floor = 0.01 * reference.iter().sum::<f64>() / reference.len() as f64;
    let (scale, log) = log_fit(estimate.iter().copied().zip(reference.iter().copied()), floor);
    Relight { relative, log, scale }
}

/// Compares RGB pictures of the same pixels under the same light.
pub(crate) fn relight_rgb(estimate: &[Vec3], reference: &[Vec3]) -> RgbRelight {
    let flat = |picture: &[Vec3]| picture.iter().flat_map(|rgb| rgb.to_array().map(f64::from)).collect::<Vec<f64>>();
    let chroma = |picture: &[Vec3]| Chroma::of(picture.iter().map(|rgb| rgb.as_dvec3()).sum());
    RgbRelight {
        relative: relight(&flat(estimate), &flat(reference)).relative,
        mean_chroma: chroma(estimate).distance(chroma(reference)),
    }
}

/// Luminances of the pixels of an RGB picture.
pub(crate) fn luminances(picture: &[Vec3]) -> Vec<f64> {
    picture.iter().map(|rgb| f64::from(luminance(*rgb))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// For pictures of one colour each, the error is the sine of the angle between the two colours.
    #[test]
    fn rgb_errors_match_the_colours() {
        let values: Vec<f32> = (0..500).map(|i| 1.0 + (i % 17) as f32).collect();
        let picture = |colour: Vec3| values.iter().map(|v| colour * *v).collect::<Vec<Vec3>>();
        let (truth, wrong) = (Vec3::new(0.7, 0.4, 0.2), Vec3::new(0.3, 0.4, 0.9));
        let same = relight_rgb(&picture(3.0 * truth), &picture(truth));
        assert!(same.relative < 1e-6 && same.mean_chroma < 1e-6, "{same:?}");
        let other = relight_rgb(&picture(wrong), &picture(truth));
        let sine = f64::from(truth.cross(wrong).length() / truth.length() / wrong.length());
        assert!((other.relative - sine).abs() < 1e-6, "{other:?} {sine}");
        let chroma = ((0.3_f64 / 0.4).ln() - (0.7_f64 / 0.4).ln()).hypot((0.9_f64 / 0.4).ln() - (0.2_f64 / 0.4).ln());
        assert!((other.mean_chroma - chroma).abs() < 1e-6, "{other:?} {chroma}");
    }

    #[test]
    fn identical_and_scaled_pictures_have_no_error() {
        let image: Vec<f64> = (0..500).map(|i| 1.0 + f64::from(i % 17)).collect();
        let scaled: Vec<f64> = image.iter().map(|x| 0.01 * x).collect();
        for other in [&image, &scaled] {
            let r = relight(other, &image);
            assert!(r.relative < 1e-9 && r.log < 1e-4, "{r:?}");
        }
        let swapped: Vec<f64> = image.iter().rev().copied().collect();
        assert!(relight(&swapped, &image).relative > 0.1);
    }

    #[test]
    fn a_black_estimate_has_relative_error_one() {
        let r = relight(&[0.0; 4], &[1.0, 2.0, 3.0, 4.0]);
        assert!((r.relative - 1.0).abs() < 1e-12);
    }
}
