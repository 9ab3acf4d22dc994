//! Converts observations of any shape to the equivalent image of a sphere with the same material
//! and light.
//!
//! The learnt posterior is trained only on images of spheres, which receive all light above the
//! horizon and are seen by an orthographic camera. For shapes with self-shadowing and for nearby
//! cameras, an estimate of material and light predicts the ratio between the brightness of each
//! point on the sphere and on the shape. The observation is multiplied by this ratio, and the
//! estimate is repeated.

use super::LearntPosterior;
use crate::appearance::{DiskImage, Lattice, Sample};
use crate::inference::ImageError;
use crate::inference::light::{LightError, LightProblem, cut_off_at_zero};
use crate::lighting::{LightGrid, LightPrior};
use crate::scene::Observations;
use crate::transfer::{Prediction, QuadratureSettings, TransferSettings, predict};

/// Largest number of estimates of material and light.
const ROUNDS: usize = 5;

/// Mean absolute change of the log ratios below which they have converged.
const TOLERANCE: f64 = 0.03;

/// Number of observations for each normal of the lattice.
const OBSERVATIONS_PER_NORMAL: usize = 4;

/// Approximate number of observations from which the light is estimated.
const LIGHT_OBSERVATIONS: usize = 1200;

/// Largest ratio, and inverse of the smallest. Where a point receives a fifth of the light that the
/// sphere would receive, noise and interreflections dominate.
const MAX_RATIO: f64 = 5.0;

/// Quadrature of the predictions. Only ratios of predictions matter, in which its errors nearly
/// cancel. It takes a quarter of the time of the default quadrature.
const QUADRATURE: QuadratureSettings = QuadratureSettings { base: 5, ratio: 0.6, core: 0.02 };

/// Smallest factor, before squaring, of the weight of observations on the edge of a shadow. They
/// matter only where their normal has no other observations.
const EDGE_WEIGHT: f64 = 1e-3;

/// Image on the disk of normals, corrected for shadows.
#[derive(Clone, Debug, PartialEq)]
pub struct SphereEquivalent {
    /// Luminance image of the equivalent sphere.
    pub image: DiskImage,
    /// Images of red, green and blue; `None` for a black channel.
    pub channels: [Option<DiskImage>; 3],
    /// Mean absolute logarithm of the ratios by which values were changed; zero if no correction
    /// was necessary.
    pub change: f64,
}

/// Converts observations to the image of the equivalent sphere on the disk of normals.
///
/// # Errors
/// [`LightError`] if nothing is observed or all observations are black; also the errors of
/// [`LightProblem::new`] and [`LightProblem::posterior`].
pub fn to_sphere_equivalent(
    observations: &Observations,
    learnt: &LearntPosterior,
    prior: &LightPrior,
    transfer: &TransferSettings,
) -> Result<SphereEquivalent, LightError> {
    let weights = observations.effective_weights();
    let points = &observations.points;
    let samples = observations.samples();
    let mut image = DiskImage::gather(&samples).ok_or(LightError::Image(ImageError::Black))?;
    let mut channels = channels_of(&samples, &image);
    let parallel = points.iter().all(|p| p.view == glam::DVec3::Z);
    let mut change = 0.0;
    if observations.visibility.is_none() && parallel {
        return Ok(SphereEquivalent { image, channels, change });
    }
    let lattice = Lattice::new();
    let few = observations.thinned(LIGHT_OBSERVATIONS);
    let chosen = observations.select(&lattice.choose(points, &weights, OBSERVATIONS_PER_NORMAL));
    let weights = chosen.effective_weights();
    let mut last = vec![0.0; weights.len()];
    for _ in 0..ROUNDS {
        let posterior = learnt.posterior(&image);
        let problem = LightProblem::of_observations(&few, &posterior.mean, prior, transfer)?;
        let evidence = problem.posterior()?;
        let radiance: Vec<f64> = cut_off_at_zero(&evidence.light).iter().map(|l| l * evidence.exposure).collect();
        let light = LightGrid::from_coefficients(prior.map, &radiance).non_negative();
        let predictions = predict(chosen.points_with_visibility(), &posterior.mean, &light, QUADRATURE);
        let log = |p: &Prediction| {
            // In complete shadow, the largest ratio also gives the point a small weight.
            let ratio = p.on_sphere / p.shadowed.max(f64::MIN_POSITIVE);
            if p.on_sphere > 0.0 || p.shadowed > 0.0 { ratio.clamp(1.0 / MAX_RATIO, MAX_RATIO).ln() } else { 0.0 }
        };
        let logs: Vec<f64> = predictions.iter().map(log).collect();
        // A large factor also amplifies the noise. Where most light passes the edge of a shadow,
        // the ratio is unreliable.
        let reliable = |((weight, log), prediction): ((&f64, &f64), &Prediction)| {
            weight * (-2.0 * log.max(0.0)).exp() * (1.0 - prediction.edge).max(EDGE_WEIGHT).powi(2)
        };
        let reliable: Vec<f64> = weights.iter().zip(&logs).zip(&predictions).map(reliable).collect();
        let sample = |at: usize| {
            let (point, factor) = (&chosen.points[at], logs[at].exp());
            let sample = Sample::of(point.in_view(), factor * chosen.values[at]?, reliable[at]);
            Some(chosen.colours[at].map_or(sample, |rgb| sample.coloured(factor as f32 * rgb)))
        };
        let samples: Vec<Sample> = (0..logs.len()).filter_map(sample).collect();
        let Some(corrected) = DiskImage::gather(&samples) else { break };
        image = corrected;
        channels = channels_of(&samples, &image);
        let mean = |each: &mut dyn Iterator<Item = f64>| each.map(f64::abs).sum::<f64>() / weights.len() as f64;
        change = mean(&mut logs.iter().copied());
        let moved = mean(&mut logs.iter().zip(&last).map(|(a, b)| a - b));
        last = logs;
        if moved < TOLERANCE {
            break;
        }
    }
    Ok(SphereEquivalent { image, channels, change })
}

/// Returns the images of the channels of samples whose luminance is `image`.
fn channels_of(samples: &[Sample], image: &DiskImage) -> [Option<DiskImage>; 3] {
    [0, 1, 2].map(|channel| DiskImage::gather_channel(samples, channel, image))
}
