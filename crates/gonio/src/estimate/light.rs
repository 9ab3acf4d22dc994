//! Estimation of the light, given the material.

use glam::Vec3;

use super::{EstimateError, EstimateSettings, EstimateStage};
use crate::gloss::lobe_radius;
use crate::inference::light::{LightProblem, cut_off_at_zero, refine};
use crate::lighting::{LightGrid, LightPrior};
use crate::picture::luminance;
use crate::reflectance::BivariateTable;
use crate::scene::Observations;
use crate::transfer::{SparseTransfer, TransferSettings};

/// Largest side of a grid whose posterior is restricted to non-negative lights, which takes a
/// minute at this side. On finer grids, whose dense matrices do not fit in memory, the mean is
/// clamped at zero.
const MAX_BOUNDED_SIDE: usize = 64;

/// Largest side of the grid of a refined light: neighbouring observations of a mirror are about as
/// far apart as its texels.
const MAX_REFINED_SIDE: usize = 128;

/// Largest factor between the sides of the refined grid and that of the posterior.
const MAX_REFINEMENT: usize = 4;

/// Largest width of a texel of the refined light over the diameter of the lobe. Wider texels do not
/// reproduce the reflection of the sun or of small lamps.
const RESOLVED: f64 = 0.35;

/// Method that ensured a non-negative light.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LightEstimator {
    /// Posterior mean over lights without negative texels: the most accurate of the methods on one
    /// grid that `gonio-eval lights` compares.
    NonNegative {
        /// Number of steps of expectation propagation.
        steps: usize,
        /// Whether they converged.
        converged: bool,
    },
    /// Posterior mean, clamped at zero; for grids beyond 64 x 64.
    Clamped,
}

/// Light of a photograph, in luminance, given a BRDF.
#[derive(Clone, Debug, PartialEq)]
pub struct Light {
    /// Radiance on the scale of the photograph, given the BRDF table.
    ///
    /// If the lobe is narrower than the texels of the posterior, this grid is finer, because the
    /// photograph of a mirror shows more detail. The steps of Richardson and Lucy then lead from
    /// the posterior mean to a light that explains the photograph. This light is used if it has the
    /// smaller misfit.
    pub grid: LightGrid,
    /// Coefficients of the posterior mean in units of the prior: radiance over [`Self::exposure`].
    pub coefficients: Vec<f64>,
    /// Standard deviations of the coefficients.
    pub sd: Vec<f64>,
    /// Radiance of a coefficient of one.
    pub exposure: f64,
    /// Method that ensured that the posterior mean is not negative.
    pub estimator: LightEstimator,
    /// Number of observations used for the posterior.
    pub observations: usize,
    /// Final objective of the evidence
    /// ([`LightPosterior::objective`](crate::inference::light::LightPosterior::objective)).
    pub objective: f64,
    /// Effective number of coefficients
    /// ([`LightPosterior::effective`](crate::inference::light::LightPosterior::effective)).
    pub effective: f64,
    /// Objective after each step.
    pub trace: Vec<f64>,
    /// Whether the maximisation of the evidence converged.
    pub converged: bool,
    /// Standard deviation of the residual of posterior and table, estimated by the evidence, on the
    /// scale of the photograph.
    pub noise: f64,
    /// The same over the root mean square of the observations.
    pub relative_noise: f64,
    /// Like [`Self::misfit`], but of the posterior mean.
    pub(super) coarse_misfit: f64,
    /// Root mean square of the residual of [`Self::grid`] and table, relative to that of the
    /// photograph.
    pub misfit: f64,
}

impl Light {
    /// Estimates the light, given a BRDF (1/sr). `progress` receives [`EstimateStage::Transfer`]
    /// and [`EstimateStage::Light`].
    ///
    /// # Errors
    /// If the prior does not cover the grid of the settings, or the image is black.
    pub fn of(
        prior: &LightPrior,
        observations: &Observations,
        table: &BivariateTable,
        settings: &EstimateSettings,
        progress: &(dyn Fn(EstimateStage) + Sync),
    ) -> Result<Self, EstimateError> {
        settings.check(prior)?;
        progress(EstimateStage::Transfer);
        let transfer = TransferSettings::of_side(settings.side);
        let problem =
            LightProblem::of_observations(&observations.thinned(settings.observations), table, prior, &transfer)?;
        progress(EstimateStage::Light);
        let evidence = problem.posterior()?;
        let (coefficients, sd, exposure, estimator) = if settings.side <= MAX_BOUNDED_SIDE {
            let found = problem.non_negative(&evidence)?;
            let how = LightEstimator::NonNegative { steps: found.steps, converged: found.converged };
            (found.light, found.light_sd, found.exposure, how)
        } else {
            let light = cut_off_at_zero(&evidence.light);
            (light, evidence.light_sd.clone(), evidence.exposure, LightEstimator::Clamped)
        };
        let radiance: Vec<f64> = coefficients.iter().map(|l| l * exposure).collect();
        let coarse = LightGrid::from_coefficients(prior.map, &radiance).non_negative();
        let coarse_misfit = problem.misfit(&radiance);
        // For wide lobes, the posterior mean may already have the smaller misfit.
        let better = refined(&coarse, observations, table).filter(|(_, misfit)| *misfit < coarse_misfit);
        let (grid, misfit) = better.unwrap_or((coarse, coarse_misfit));
        Ok(Self {
            grid,
            misfit,
            coarse_misfit,
            coefficients,
            sd,
            exposure,
            estimator,
            observations: problem.rows(),
            objective: evidence.objective,
            effective: evidence.effective,
            converged: evidence.converged,
            noise: evidence.noise,
            relative_noise: evidence.noise / problem.rms(),
            trace: evidence.trace,
        })
    }
}

/// Returns the light on a grid that resolves the lobe of the table, and its misfit; `None` if the
/// grid does already, or the image is black.
fn refined(coarse: &LightGrid, observations: &Observations, table: &BivariateTable) -> Option<(LightGrid, f64)> {
    let side = coarse.side();
    let fine = side_for(table).min(MAX_REFINEMENT * side).clamp(side, MAX_REFINED_SIDE.max(side));
    if fine == side {
        return None;
    }
    let observed = |&i: &usize| observations.values[i].is_some() && observations.weights[i] > 0.0;
    let observations = observations.select(&(0..observations.values.len()).filter(observed).collect::<Vec<_>>());
    let values: Vec<f64> = observations.values.iter().flatten().map(|y| y.max(0.0)).collect();
    // A mean of one keeps single precision from overflowing.
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let scaled = |x: &f64| (x / mean) as f32;
    let values: Vec<f32> = values.iter().map(scaled).collect();
    let start: Vec<f32> =
        coarse.divided(fine).texels().iter().map(|texel| scaled(&f64::from(luminance(*texel)))).collect();
    let weights: Vec<f32> = observations.weights.iter().map(|weight| *weight as f32).collect();
    let transfer = SparseTransfer::new(observations.points_with_visibility(), table, coarse.map(), fine);
    let found = refine(&transfer, &values, &weights, &start)?;
    let (mut residual, mut energy) = (0.0, 0.0);
    for ((y, made), weight) in values.iter().zip(&found.image).zip(&observations.weights) {
        residual += weight * f64::from(y - made).powi(2);
        energy += weight * f64::from(*y).powi(2);
    }
    let texels = found.texels.iter().map(|x| Vec3::splat((f64::from(*x) * mean) as f32)).collect();
    Some((LightGrid::from_texels(coarse.map(), fine, texels), (residual / energy).sqrt()))
}

/// Returns the side of a grid, a power of two, that resolves the lobe of a table.
///
/// A texel is at most [`RESOLVED`] times as wide as the lobe. Without a lobe, the side is small.
fn side_for(table: &BivariateTable) -> usize {
    // A change of the light's direction changes the half angle by half as much.
    let texel = RESOLVED * 2.0 * lobe_radius(table).unwrap_or(1.0);
    let sides = (4.0 * std::f64::consts::PI).sqrt() / texel;
    (sides.ceil().clamp(1.0, 1024.0) as usize).next_power_of_two()
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::sphere::OctahedralMap;
    use crate::testing::{ball, lobe};
    use crate::transfer::{QuadratureSettings, predict};

    #[test]
    fn the_side_follows_the_energy_of_the_lobe() {
        for (width, side) in [(0.2, 32), (0.05, 128), (0.02, 512), (1e-5, 1024)] {
            assert_eq!(side_for(&lobe(0.1, 5.0, width)), side, "{width}");
        }
    }

    #[test]
    fn lights_of_mirrors_are_refined() {
        // Two lamps in a sky.
        let lamps = [(DVec3::new(0.3, 0.4, 0.8), 40.0), (DVec3::new(-0.7, 0.1, 0.2), 25.0)];
        let radiance = |t: usize| {
            let direction = LightGrid::direction_of(OctahedralMap::EqualArea, 64, t);
            let lamp = |(centre, strength): &(DVec3, f64)| {
                strength * (-(direction.angle_between(*centre) / 0.12).powi(2)).exp()
            };
            Vec3::splat((1.0 + 0.5 * direction.y + lamps.iter().map(lamp).sum::<f64>()) as f32)
        };
        let truth = LightGrid::from_texels(OctahedralMap::EqualArea, 64, (0..64 * 64).map(radiance).collect());
        let points: Vec<_> = ball(6000).into_iter().filter(|p| p.normal.z > 0.3).collect();
        let observed = |table: &BivariateTable| {
            let made = predict(&points, table, &truth, QuadratureSettings::default());
            let rgb: Vec<Vec3> = made.iter().map(|made| Vec3::splat(made.shadowed as f32)).collect();
            Observations::of_points(points.clone(), &rgb)
        };
        let coarse = truth.reduced(16);
        let (mirror, matte) = (lobe(0.02, 300.0, 0.015), lobe(0.3, 0.0, 1.0));
        assert!(refined(&coarse, &observed(&matte), &matte).is_none());
        let (found, misfit) = refined(&coarse, &observed(&mirror), &mirror).unwrap();
        assert_eq!((found.side(), found.map()), (64, OctahedralMap::EqualArea));
        assert!(misfit < 0.05, "{misfit}");
        // Directions that the ball reflects to the camera.
        let error = |light: &dyn Fn(usize) -> Vec3| {
            let seen = (0..64 * 64).filter(|&t| LightGrid::direction_of(OctahedralMap::EqualArea, 64, t).z > -0.5);
            seen.map(|t| f64::from((light(t) - truth.texels()[t]).x).powi(2)).sum::<f64>()
        };
        let before = error(&|t| coarse.divided(64).texels()[t]);
        let after = error(&|t| found.texels()[t]);
        assert!(after < 0.05 * before, "{after} {before}");
        // The scale of the photograph does not matter.
        let mut bright = observed(&mirror);
        bright.values.iter_mut().for_each(|value| *value = value.map(|y| 1e12 * y));
        let light = LightGrid::from_texels(coarse.map(), 16, coarse.texels().iter().map(|t| *t * 1e12).collect());
        let (scaled, same) = refined(&light, &bright, &mirror).unwrap();
        assert!((same / misfit - 1.0).abs() < 1e-2);
        assert!(scaled.texels().iter().zip(found.texels()).all(|(a, b)| (a.x / b.x / 1e12 - 1.0).abs() < 1e-2));
    }
}
