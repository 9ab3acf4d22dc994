//! The image that a sphere of the same material would give in the same light, from observations of
//! another shape.
//!
//! The learnt posterior knows images of spheres alone, on which all light above the horizon arrives
//! and which are seen from far away. Where the surface keeps light from itself, or the camera is
//! near, an estimate of material and light tells how much brighter or darker the point would be on
//! the sphere: its value is multiplied by that ratio, and a new estimate made.

use super::LearntPosterior;
use crate::appearance::{DiskImage, Lattice, Sample};
use crate::inference::ProblemError;
use crate::inference::light::{LightError, LightProblem, cut_off_at_zero};
use crate::lighting::{LightGrid, LightPrior};
use crate::scene::Observations;
use crate::transfer::{PlanSettings, Prediction, predict};

/// How shadows are taken away.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UnshadowSettings {
    /// Estimates of material and light, at most.
    pub rounds: usize,
    /// Ratios that change by less than this, as the mean of their absolute logarithm, are taken to
    /// have settled.
    pub tolerance: f64,
    /// Observations for each normal of the lattice.
    pub each: usize,
    /// Observations from which the light is found, about.
    pub rows: usize,
}

impl Default for UnshadowSettings {
    fn default() -> Self {
        Self { rounds: 5, tolerance: 0.03, each: 4, rows: 1200 }
    }
}

/// Ratios are kept between this and its inverse: of a point that gets a fifth of what the sphere
/// would, noise and what the object reflects onto itself are most.
const LARGEST_RATIO: f64 = 5.0;

/// Observations on the edge of a shadow count so little, squared: only where there are no others of
/// their normal.
const EDGE_WEIGHT: f64 = 1e-3;

/// An image on the disk of normals.
#[derive(Clone, Debug, PartialEq)]
pub struct Unshadowed {
    /// The values as a sphere would show them.
    pub image: DiskImage,
    /// Mean of how much values were changed, as the absolute logarithm of the ratio; zero where
    /// nothing was to be done.
    pub change: f64,
}

/// The observations on the disk of normals, as a sphere would show them.
///
/// # Errors
/// [`LightError`] if all are black, and as [`LightProblem::new`] and [`LightProblem::posterior`].
///
/// # Panics
/// If nothing is observed.
pub fn unshadow(
    observations: &Observations,
    learnt: &LearntPosterior,
    prior: &LightPrior,
    plan: &PlanSettings,
    settings: &UnshadowSettings,
) -> Result<Unshadowed, LightError> {
    let weights = observations.trust();
    let points = &observations.points;
    let mut image = DiskImage::gather(&observations.samples()).ok_or(LightError::Image(ProblemError::Black))?;
    let parallel = points.iter().all(|p| p.view == glam::DVec3::Z);
    let mut change = 0.0;
    if observations.visibility.is_none() && parallel {
        return Ok(Unshadowed { image, change });
    }
    let lattice = Lattice::new();
    let few = observations.thinned(settings.rows);
    let chosen = observations.select(&lattice.choose(points, &weights, settings.each));
    let weights = chosen.trust();
    let mut last = vec![0.0; weights.len()];
    for _ in 0..settings.rounds {
        let posterior = learnt.posterior(&image);
        let problem = LightProblem::of_observations(&few, &posterior.mean, prior, plan)?;
        let evidence = problem.posterior()?;
        let radiance: Vec<f64> = cut_off_at_zero(&evidence.light).iter().map(|l| l * evidence.exposure).collect();
        let light = LightGrid::from_coefficients(prior.map, &radiance);
        let predictions = predict(chosen.seen(), &posterior.mean, &light, plan.quadrature);
        let logs: Vec<f64> = predictions
            .iter()
            .map(|p| p.on_sphere / p.seen)
            .map(|ratio| if ratio.is_finite() { ratio.clamp(1.0 / LARGEST_RATIO, LARGEST_RATIO).ln() } else { 0.0 })
            .collect();
        let values: Vec<Option<f64>> =
            chosen.values.iter().zip(&logs).map(|(value, log)| value.map(|v| v * log.exp())).collect();
        // What is multiplied by a large factor brings its noise along; where most light passes a
        // shadow's edge the ratio is a guess.
        let reliable = |((weight, log), prediction): ((&f64, &f64), &Prediction)| {
            weight * (-2.0 * log.max(0.0)).exp() * (1.0 - prediction.edge).max(EDGE_WEIGHT).powi(2)
        };
        let reliable: Vec<f64> = weights.iter().zip(&logs).zip(&predictions).map(reliable).collect();
        let seen = chosen.points.iter().zip(&values).zip(&reliable);
        let samples: Vec<Sample> = seen
            .filter_map(|((point, value), weight)| value.map(|value| Sample::of(point.in_view(), value, *weight)))
            .collect();
        let Some(corrected) = DiskImage::gather(&samples) else { break };
        image = corrected;
        let mean = |each: &mut dyn Iterator<Item = f64>| each.map(f64::abs).sum::<f64>() / weights.len() as f64;
        change = mean(&mut logs.iter().copied());
        let moved = mean(&mut logs.iter().zip(&last).map(|(a, b)| a - b));
        last = logs;
        if moved < settings.tolerance {
            break;
        }
    }
    Ok(Unshadowed { image, change })
}
