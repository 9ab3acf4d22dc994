//! The compared estimators: trivial estimates, oracles, and the methods of the library.

use anyhow::{Context, Result};
use glam::{DQuat, DVec3, Vec3};
use gonio::colour::{ChromaField, is_grey};
use gonio::estimate::{Colouring, ColouringRule};
use gonio::inference::known_light::{
    Alignment, KnownLight, KnownLightPosterior, ObservedPoints, Operator, PriorMaterials,
};
use gonio::inference::learnt::MaterialPosterior;
use gonio::lighting::EnvironmentMap;
use gonio::reflectance::BivariateTable;
use gonio::scene::Observations;
use gonio_paper::{JointMapSettings, Method, Posterior, Problem, Projected, Solver, VariationalSettings, infer};
use serde::{Deserialize, Serialize};

use super::learning::{LearntModels, MaterialSpace};
use super::options::Separable;
use crate::metrics::brdf_error;
use crate::posteriors::on_disk;

/// A photograph with all inputs of the estimators and oracles.
pub(crate) struct Photograph<'a> {
    pub(crate) knowledge: &'a LearntModels,
    /// Linear RGB of every point.
    pub(crate) colours: &'a [Vec3],
    /// Luminance of every point.
    pub(crate) image: &'a [Option<f64>],
    /// The image projected onto the rows of the plan.
    pub(crate) projected: &'a Projected,
    /// The true light.
    pub(crate) operator: Option<&'a Lit>,
    /// Images of the basis functions in the true light, `[point][function]`.
    pub(crate) under_true_light: &'a [f32],
    /// Luminance table of the true material.
    pub(crate) truth: &'a BivariateTable,
    /// Chroma of the true material.
    pub(crate) chroma: &'a ChromaField,
    /// Random starts of each method.
    pub(crate) starts: usize,
    /// Settings of the separable posterior and of the joint maximum.
    pub(crate) separable: Separable,
}

/// A known light.
pub(crate) struct Lit {
    /// Matrix of the light at every `step`-th point.
    pub(crate) operator: Operator,
    pub(crate) step: usize,
    /// Environment map of the light.
    pub(crate) map: EnvironmentMap,
}

/// Result of an estimator.
#[derive(Clone, Debug, Default)]
pub(crate) struct Estimate {
    /// The BRDF, up to scale; `None` if the estimator failed.
    pub(crate) table: Option<BivariateTable>,
    /// Chroma of every cell; `None` for the median colour of the photograph, in which the paper
    /// displays its results.
    pub(crate) chroma: Option<ChromaField>,
    /// Ends of the central 50 % and 90 % intervals of each cell, on the scale of `table`: 5, 25,
    /// 75, 95 %.
    pub(crate) quantiles: Option<[Vec<f32>; 4]>,
    /// Report of the optimiser.
    pub(crate) report: Report,
}

/// Report of a method on its run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Report {
    /// Cost of the kept start.
    pub(crate) cost: Option<f64>,
    /// Iterations of all starts together.
    pub(crate) iterations: usize,
    /// Whether the kept start met its stopping rule.
    pub(crate) converged: Option<bool>,
    /// Noise relative to the root mean square of the image.
    pub(crate) noise: Option<f64>,
    /// Anything else worth noting, such as the name of a material.
    pub(crate) note: String,
}

/// One row of the comparison.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Estimator {
    /// Mean of the training materials, each scaled to albedo one: an estimate that ignores the
    /// image.
    TrainingMean,
    /// A Lambertian surface.
    Lambertian,
    /// The training material with the least BRDF error: an oracle.
    NearestMaterial,
    /// The true table of each channel without `phi_d`: no bivariate estimate has a smaller error,
    /// except by luck.
    TrueBivariate,
    /// The posterior given the true light at its full resolution: an oracle.
    KnownLight,
    /// The same posterior given a map of the light rotated by five degrees; it estimates the
    /// rotation.
    KnownLightRotated,
    /// The separable posterior in the basis given the true light: an oracle.
    KnownLightBasis,
    /// Joint maximum over light and reflectance.
    JointMap,
    /// The mean of the posterior learnt from simulated photographs: the default method.
    Learnt,
    /// The separable posterior, `C_KL` minimised by blocks.
    Variational,
    /// The separable posterior by Algorithm 1 as printed. Slow.
    Algorithm1,
}

impl Estimator {
    /// Name for readers.
    pub(crate) fn title(self) -> &'static str {
        match self {
            Self::TrainingMean => "training mean",
            Self::Lambertian => "Lambertian",
            Self::NearestMaterial => "nearest training material (oracle)",
            Self::TrueBivariate => "true bivariate table (floor)",
            Self::KnownLight => "known light (oracle)",
            Self::KnownLightRotated => "known light, map turned by 5 degrees (oracle)",
            Self::KnownLightBasis => "known light, ten functions (oracle)",
            Self::JointMap => "joint MAP",
            Self::Learnt => "learnt posterior",
            Self::Variational => "Algorithm 1 (block solver)",
            Self::Algorithm1 => "Algorithm 1 as printed",
        }
    }

    /// Whether the estimator uses ground truth that a photograph does not contain.
    pub(crate) fn is_oracle(self) -> bool {
        let lit = matches!(self, Self::KnownLight | Self::KnownLightRotated | Self::KnownLightBasis);
        lit || matches!(self, Self::NearestMaterial | Self::TrueBivariate)
    }

    /// Whether the estimator ignores the image.
    pub(crate) fn is_trivial(self) -> bool {
        matches!(self, Self::TrainingMean | Self::Lambertian)
    }

    /// Whether the estimator estimates colours; the others are shown in the median colour.
    pub(crate) fn finds_colours(self) -> bool {
        matches!(self, Self::TrueBivariate | Self::KnownLight | Self::KnownLightRotated | Self::Learnt)
    }

    /// Estimators compared by default.
    pub(crate) fn usual() -> Vec<Self> {
        vec![
            Self::TrainingMean,
            Self::Lambertian,
            Self::NearestMaterial,
            Self::TrueBivariate,
            Self::KnownLight,
            Self::KnownLightBasis,
            Self::JointMap,
            Self::Variational,
            Self::Learnt,
        ]
    }

    /// Estimates the BRDF from a photograph.
    pub(crate) fn estimate(self, photograph: &Photograph<'_>) -> Result<Estimate> {
        let Photograph { knowledge, image, projected, under_true_light, truth, starts, separable, .. } = *photograph;
        let Separable { paper, tolerance, variance, iterations, .. } = separable;
        let basis = &knowledge.model.reflectance;
        let hyper = separable.hyper(projected.pixels);
        let variational = |solver| VariationalSettings {
            solver,
            starts,
            tolerance,
            variance,
            max_iterations: iterations,
            ..VariationalSettings::default()
        };
        let blind = || -> Result<Problem<'_>> {
            let examples = basis.materials.iter().map(|m| m.coefficients.clone()).collect();
            let problem = Problem::blind(projected, &knowledge.model.light, &basis.rates, hyper)?;
            Ok(if paper { problem } else { problem.starting_from(examples) })
        };
        let (problem_scale, posterior) = match self {
            Self::TrainingMean => return Ok(Estimate::of(mean_of(&knowledge.training))),
            Self::Lambertian => return Ok(Estimate::of(BivariateTable::from_fn(|_, _| 1.0))),
            Self::NearestMaterial => return Ok(nearest(&knowledge.training, truth)),
            Self::TrueBivariate => {
                let chroma = Some(photograph.chroma.clone());
                return Ok(Estimate { chroma, ..Estimate::of(truth.clone()) });
            }
            Self::Learnt => return learnt_posterior(photograph),
            Self::KnownLight => return known_light(photograph, false),
            Self::KnownLightRotated => return known_light(photograph, true),
            Self::KnownLightBasis => {
                let known = Projected::under_known_light(under_true_light, basis.len(), image);
                let problem = Problem::with_known_light(&known, &basis.rates, hyper)?;
                (rms(&known), infer(&problem, &Method::Variational(variational(Solver::Blocks)), &|_| ()))
            }
            Self::JointMap => {
                let settings =
                    JointMapSettings { starts, tolerance, max_iterations: iterations, ..JointMapSettings::default() };
                (rms(projected), infer(&blind()?, &Method::JointMap(settings), &|_| ()))
            }
            Self::Variational => {
                (rms(projected), infer(&blind()?, &Method::Variational(variational(Solver::Blocks)), &|_| ()))
            }
            Self::Algorithm1 => {
                (rms(projected), infer(&blind()?, &Method::Variational(variational(Solver::Printed)), &|_| ()))
            }
        };
        let table = basis.combine(&posterior.reflectance)?;
        let uncertain = posterior.reflectance_sd.iter().any(|sd| *sd > 0.0);
        let quantiles = uncertain.then(|| gaussian_quantiles(&table, &basis.functions, &posterior.reflectance_sd));
        Ok(Estimate { quantiles, report: Report::of(&posterior, problem_scale), ..Estimate::of(table) })
    }
}

/// Estimates the BRDF with the posterior learnt from simulated photographs.
fn learnt_posterior(photograph: &Photograph<'_>) -> Result<Estimate> {
    let Photograph { knowledge, colours, image, .. } = *photograph;
    let learnt = knowledge.model.learnt.as_ref().context("no posterior was learnt")?;
    let posterior = learnt.posterior(&on_disk(&knowledge.points, image.iter().copied())?);
    let quantiles = posterior.quantiles(&[0.05, 0.25, 0.75, 0.95]);
    let quantiles = quantiles.try_into().ok().context("four quantiles")?;
    let nearest = &posterior.neighbours[0];
    let note = format!("{} {:.2}", nearest.name, nearest.weight);
    let report = Report { note, ..Report::default() };
    let observations = Observations::of_points(knowledge.points.clone(), colours);
    let rule = ColouringRule::default();
    let chroma = Some(Colouring::of(&knowledge.model, &observations, &posterior.mean, &rule).field());
    Ok(Estimate { table: Some(posterior.mean), chroma, quantiles: Some(quantiles), report })
}

/// Estimates the BRDF with the posterior under the true light, or under its map rotated by five
/// degrees.
fn known_light(photograph: &Photograph<'_>, turned: bool) -> Result<Estimate> {
    let Photograph { knowledge, colours, image, operator, .. } = *photograph;
    let Lit { operator, map, step } = operator.context("no operator of the light")?;
    let MaterialSpace { coordinates, places, colours: prior } =
        knowledge.space.as_ref().context("no space of materials")?;
    let materials = PriorMaterials::of(coordinates, places);
    let observed = knowledge.points.iter().zip(image).step_by(*step);
    let (points, values): (Vec<_>, Vec<f64>) = observed.map(|(p, v)| (*p, v.unwrap_or(0.0))).unzip();
    let trust = vec![1.0; values.len()];
    let rows = ObservedPoints { points: &points, visibility: None, values: &values, weights: &trust };
    let (light, mut found) = if turned {
        let turn = DQuat::from_axis_angle(DVec3::new(1.0, 2.0, 1.0).normalize(), 5_f64.to_radians());
        let light = KnownLight::of_map(&map.rotated(turn));
        let found = KnownLightPosterior::of(&rows, light.clone(), Alignment::Small, &materials)?;
        (light, found)
    } else {
        (KnownLight::of_map(map), KnownLightPosterior::under(operator, &rows, &materials)?)
    };
    let colours: Vec<Vec3> = colours.iter().step_by(*step).copied().collect();
    let mut chroma = is_grey(&colours).then_some(ChromaField::GREY);
    if chroma.is_none() {
        let colours: Vec<DVec3> = colours.iter().map(|rgb| rgb.as_dvec3()).collect();
        // A black channel has no solution; the estimate is then in the median colour.
        if let Ok((anew, channels)) = found.clone().with_channels(&rows, &colours, &light, &materials, prior) {
            (found, chroma) = (anew, Some(channels.field()));
        }
    }
    let posterior = MaterialPosterior::of_gaussian(coordinates, found.gaussian()?, Vec::new());
    let posterior = posterior.context("the posterior is not a Gaussian")?;
    let quantiles = posterior.quantiles(&[0.05, 0.25, 0.75, 0.95]).try_into().ok().context("four quantiles")?;
    let angle = found.rotation.to_scaled_axis().length().to_degrees();
    let note = format!("noise {:.3}, discrepancy {:.3}, turn {angle:.1}", found.noise, found.discrepancy);
    let report = Report { converged: Some(found.converged), noise: Some(found.misfit), note, ..Report::default() };
    Ok(Estimate { table: Some(posterior.mean), chroma, quantiles: Some(quantiles), report })
}

fn rms(image: &Projected) -> f64 {
    (image.energy() / image.pixels as f64).sqrt()
}

impl Estimate {
    fn of(table: BivariateTable) -> Self {
        Self { table: Some(table), ..Self::default() }
    }
}

impl Report {
    fn of(posterior: &Posterior, rms: f64) -> Self {
        let best = &posterior.starts[posterior.best_start];
        Self {
            cost: Some(best.cost),
            iterations: posterior.starts.iter().map(|s| s.iterations).sum(),
            converged: Some(best.converged),
            noise: Some(posterior.noise / rms),
            note: String::new(),
        }
    }
}

/// Mean of tables scaled to albedo one.
fn mean_of(tables: &[(String, BivariateTable)]) -> BivariateTable {
    let scales: Vec<f64> = tables.iter().map(|(_, t)| 1.0 / t.normal_albedo().max(1e-300)).collect();
    let mut sum = BivariateTable::from_fn(|_, _| 0.0);
    for ((_, table), scale) in tables.iter().zip(&scales) {
        for (sum, value) in sum.as_mut_slice().iter_mut().zip(table.as_slice()) {
            *sum += (scale / tables.len() as f64) as f32 * value;
        }
    }
    sum
}

fn nearest(tables: &[(String, BivariateTable)], truth: &BivariateTable) -> Estimate {
    let errors = tables.iter().map(|(name, table)| (brdf_error(table, truth), name, table));
    match errors.min_by(|a, b| a.0.total_cmp(&b.0)) {
        Some((_, name, table)) => {
            let report = Report { note: name.clone(), ..Report::default() };
            Estimate { report, ..Estimate::of(table.clone()) }
        }
        None => Estimate::default(),
    }
}

/// Quantiles (5, 25, 75, 95 %) of each cell of `F = sum_k f_k phi_k` with independent Gaussian
/// `f_k`, cut off at zero.
fn gaussian_quantiles(mean: &BivariateTable, functions: &[BivariateTable], sd: &[f64]) -> [Vec<f32>; 4] {
    let spread: Vec<f64> = (0..mean.as_slice().len())
        .map(|c| {
            let square = functions.iter().zip(sd).map(|(phi, s)| (s * f64::from(phi.as_slice()[c])).powi(2));
            square.sum::<f64>().sqrt()
        })
        .collect();
    [-1.644_854, -0.674_490, 0.674_490, 1.644_854].map(|z| {
        let cells = mean.as_slice().iter().zip(&spread);
        cells.map(|(m, s)| (f64::from(*m) + z * s).max(0.0) as f32).collect()
    })
}

#[cfg(test)]
mod tests {
    use clap::ValueEnum;

    use super::*;
    use crate::bench::id;

    #[test]
    fn names_on_the_command_line_equal_those_in_json() {
        for estimator in Estimator::value_variants() {
            assert_eq!(serde_json::to_value(estimator).unwrap(), id(estimator));
        }
    }

    #[test]
    fn the_nearest_material_is_the_scaled_twin() {
        let lobe = |w: f64, s: f64| BivariateTable::from_fn(move |h, _| s * (0.1 + (-(h / w).powi(2)).exp()));
        let training = vec![("wide".to_owned(), lobe(0.5, 1.0)), ("narrow".to_owned(), lobe(0.1, 7.0))];
        assert_eq!(nearest(&training, &lobe(0.1, 1.0)).report.note, "narrow");
    }

    #[test]
    fn the_mean_weighs_materials_by_albedo() {
        let flat = |x: f64| ("flat".to_owned(), BivariateTable::from_fn(move |_, _| x));
        let mean = mean_of(&[flat(1.0), flat(100.0)]);
        assert!((mean.normal_albedo() - 1.0).abs() < 1e-5);
    }
}
