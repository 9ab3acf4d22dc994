//! Estimation when the light is given.

use std::f64::consts::PI;

use glam::{DQuat, DVec3};

use super::colouring::{COLOUR_DRAWS, COLOUR_SEED};
use super::material::MaterialDraft;
use super::misfit::{MAX_NOISE, MISFIT_WARNING_RATIO};
use super::{Colouring, ColouringRule, Diagnostic, EstimateError, EstimateStage, MaterialEstimate, MisfitCause};
use crate::appearance::DiskImage;
use crate::colour::{Chroma, ColourEstimate, is_grey};
use crate::inference::known_light::{
    Alignment, EncoderLikelihood, KnownLight, KnownLightError, KnownLightPosterior, ObservedPoints, PriorMaterials,
    ROWS, clipped,
};
use crate::inference::learnt::MaterialPosterior;
use crate::inference::light::LightError;
use crate::inference::{ImageError, Likelihood};
use crate::lighting::EnvironmentMap;
use crate::model::Model;
use crate::picture::Plane;
use crate::reflectance::BivariateTable;
use crate::scene::Observations;

/// Relative root mean square residual of a clean photograph under the correct light: about the 95 %
/// quantile over left-out materials (`gonio-eval bench`, docs/results.md).
const EXPECTED: f64 = 0.1;

/// Residual of a channel, beyond that of the luminance, above which it is reported.
const MAX_CHANNEL_MISFIT: f64 = 0.1;

/// Brightness factor of clipped pixels above which it is reported, if its logarithm also exceeds
/// two standard deviations.
const BRIGHTER: f64 = 1.2;

/// Estimate from a photograph under a known light.
#[derive(Clone, Debug)]
pub struct KnownLightEstimate {
    /// Material of the object, in luminance, of albedo [`ALBEDO`](super::ALBEDO).
    pub material: MaterialEstimate,
    /// Factor from [`MaterialEstimate::table`] to reflectance on the scale of photograph and light.
    /// The albedo on this scale is absolute if both have the same exposure.
    pub exposure: f64,
    /// Standard deviation of the independent error of the logarithm of the image.
    pub noise: f64,
    /// Standard deviation of the smooth error of the logarithm of the image.
    pub discrepancy: f64,
    /// Root mean square of the residual, relative to that of the observations.
    pub misfit: f64,
    /// Rotation from the given orientation of the map to the fitted one.
    pub rotation: DQuat,
    /// Ratio of the true radiance of the clipped map pixels to their values, and the standard
    /// deviation of its logarithm; `None` if no pixels are clipped.
    pub gain: Option<(f64, f64)>,
    /// Number of rows of the map.
    pub map_rows: usize,
    /// Number of observations used.
    pub observations: usize,
    /// Whether the iteration converged.
    pub converged: bool,
    /// Colours of material and light.
    pub colouring: Colouring,
    /// Root mean square residual of each channel beyond that of the luminance, relative to the
    /// photograph; `None` if the channels were not estimated.
    pub channel_misfit: Option<[f64; 3]>,
}

impl KnownLightEstimate {
    /// Returns the residual expected from noise and texture if material and light are correct.
    pub fn expected_misfit(&self) -> f64 {
        EXPECTED.hypot(self.material.scatter.min(MAX_NOISE))
    }

    /// Returns the diagnostics, misfit first, including the corrections of the environment map.
    pub fn diagnostics(&self) -> Vec<Diagnostic> {
        let (misfit, expected) = (self.misfit, self.expected_misfit());
        let of_misfit = (misfit > MISFIT_WARNING_RATIO * expected).then_some(Diagnostic::Misfit {
            misfit,
            expected,
            cause: MisfitCause::KnownLight,
        });
        let turn = self.rotation.to_scaled_axis();
        let turned =
            (self.rotation != DQuat::IDENTITY).then(|| Diagnostic::LightRotated(turn.to_array().map(f64::to_degrees)));
        let clipped = self.gain.filter(|(gain, sd)| *gain > BRIGHTER && gain.ln() > 2.0 * sd);
        let pixel = PI / self.map_rows as f64;
        let coarse = (highlight(&self.material.table) < pixel).then(|| Diagnostic::Coarse(pixel.to_degrees()));
        let channel = self.channel_misfit.and_then(|misfits| {
            let worst = (0..3).max_by(|a, b| misfits[*a].total_cmp(&misfits[*b]))?;
            (misfits[worst] > MAX_CHANNEL_MISFIT.hypot(self.material.scatter))
                .then_some(Diagnostic::Channel { channel: worst, misfit: misfits[worst] })
        });
        let of_light = [channel, turned, clipped.map(|(gain, sd)| Diagnostic::Clipped { gain, sd }), coarse];
        of_misfit.into_iter().chain(of_light.into_iter().flatten()).chain(self.material.diagnostics()).collect()
    }

    /// Returns the given map with the fitted gain of its clipped pixels and the fitted rotation.
    pub fn corrected(&self, map: &EnvironmentMap) -> EnvironmentMap {
        let mut map = map.clone();
        if let (Some((gain, _)), Some(mask)) = (self.gain, clipped(&map)) {
            let (width, height) = mask.size();
            let radiance = map.radiance();
            let pixel = |x, y| radiance[(x, y)] * if mask[(x, y)] { gain as f32 } else { 1.0 };
            map = EnvironmentMap::new(Plane::from_fn(width, height, pixel)).unwrap_or(map);
        }
        if self.rotation == DQuat::IDENTITY { map } else { map.rotated(self.rotation) }
    }
}

/// Returns the width (radians) over which a highlight spreads the light of a point.
///
/// It is four times the half angle at which the table falls to half of its peak. The factor is four
/// because the lobe extends to both sides, and a rotation of the half vector rotates the mirror
/// direction by twice the angle. The width is infinite without a highlight.
fn highlight(table: &BivariateTable) -> f64 {
    let peak = table.eval(0.0, 0.0);
    if peak < 4.0 * table.eval(1.0, 0.0) {
        return f64::INFINITY;
    }
    let degree = |at: usize| (at as f64 * 0.25).to_radians();
    let half = (0..240).map(degree).find(|h| table.eval(*h, 0.0) < 0.5 * peak);
    half.map_or(f64::INFINITY, |half| 4.0 * half)
}

/// Estimates the material and its colours under an environment map in camera space. `progress` is
/// called when a stage begins.
///
/// # Errors
/// If the model has no posterior of materials, light or image are black, or nothing is observed.
pub fn estimate_known_light(
    model: &Model,
    observations: &Observations,
    (light, alignment): (&EnvironmentMap, Alignment),
    colouring: &ColouringRule,
    progress: &(dyn Fn(EstimateStage) + Sync),
) -> Result<KnownLightEstimate, EstimateError> {
    let learnt = model.learnt.as_ref().ok_or(EstimateError::NotLearnt)?;
    super::check_observed(observations)?;
    progress(EstimateStage::Material);
    let few = observations.thinned(ROWS);
    let seen: Vec<usize> = (0..few.points.len()).filter(|&i| few.values[i].is_some()).collect();
    let few = few.select(&seen);
    let places: Vec<Vec<f64>> =
        learnt.prior.coordinates.iter().map(|place| place.iter().map(|z| f64::from(*z)).collect()).collect();
    let values: Vec<f64> = few.values.iter().flatten().copied().collect();
    let (points, visibility, trust) = (&few.points[..], few.visibility.as_ref(), few.effective_weights());
    let rows = ObservedPoints { points, visibility, values: &values, weights: &trust };
    let materials = PriorMaterials::of(&learnt.latent_space, &places);
    let given = KnownLight::of_map(light);
    let mut found = KnownLightPosterior::of(&rows, given.clone(), alignment, &materials)?;
    let colours: Vec<DVec3> = few.colours.iter().map(|rgb| rgb.unwrap_or_default().as_dvec3()).collect();
    let mut channels = None;
    let wanted = matches!(colouring, ColouringRule::Estimate { .. }) && !is_grey(few.colours.iter().flatten());
    if let Some(prior) = model.colours().filter(|_| wanted) {
        progress(EstimateStage::Colours);
        // If light or photograph is black in a channel, the colours are estimated as under an
        // unknown light below.
        if let Ok((anew, of_channels)) = found.clone().with_channels(&rows, &colours, &given, &materials, prior) {
            (found, channels) = (anew, Some(of_channels));
        }
    }
    // Self-shadowing is not removed: the encoder is accurate often enough despite it, and removing
    // it without the light would take longer than all other steps.
    let image = DiskImage::gather(&observations.samples()).ok_or(LightError::Image(ImageError::Black))?;
    let hint = EncoderLikelihood::of(learnt, &learnt.encode(&image).embedding).ok_or(KnownLightError::Unsolvable)?;
    let gaussian = found.gaussian()?.informed_by(&hint).ok_or(KnownLightError::Unsolvable)?;
    let likelihood = Likelihood::Gaussian(gaussian);
    let posterior = MaterialPosterior::of(learnt, likelihood).ok_or(KnownLightError::Unsolvable)?;
    let material = MaterialDraft::with(learnt, f64::from(image.scatter), posterior).describe();
    let channel_misfit = channels.as_ref().map(|channels| channels.misfit);
    let colouring = match channels {
        Some(channels) => {
            let (field, draws) = (channels.field(), channels.draws(COLOUR_DRAWS, COLOUR_SEED));
            let chroma = match colouring {
                ColouringRule::Estimate { light: Some(light) } => *light,
                _ => Chroma::default(),
            };
            Colouring::Estimate(Box::new(ColourEstimate::of(&material.table, field, draws, (chroma, &[], true))))
        }
        None => Colouring::of(model, observations, &material.table, colouring),
    };
    Ok(KnownLightEstimate {
        exposure: found.table().normal_albedo() / material.table.normal_albedo(),
        colouring,
        channel_misfit,
        material,
        noise: found.noise,
        discrepancy: found.discrepancy,
        misfit: found.misfit,
        rotation: found.rotation,
        gain: found.gain,
        map_rows: light.radiance().height(),
        observations: values.len(),
        converged: found.converged,
    })
}
