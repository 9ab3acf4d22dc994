//! Fits of shading models to tables.

mod search;
mod sketch;

use std::sync::Arc;

use glam::{DQuat, DVec3};
use levenberg_marquardt::LevenbergMarquardt;

use super::{Layered, Parameter, Shading};
use crate::appearance::Lattice;
use crate::lighting::studio_light;
use crate::parallel;
use crate::reflectance::parametric::directions;
use crate::reflectance::{BivariateTable, THETA_H};
use crate::reflectance::{theta_d_of, theta_h_of};
use crate::render::{IntegratorSettings, LightTree, Relighter};
use search::{Goal, Search, compressed};
use sketch::Sketch;

/// Step between half angles, in samples of a table, which are dense at the peak.
const STEP_H: usize = 3;
/// Difference angles in degrees.
const DIFFERENCE: [usize; 10] = [0, 10, 20, 30, 40, 50, 60, 68, 74, 79];
/// Azimuths `phi_d` in degrees.
const AZIMUTHS: [f64; 3] = [0.0, 90.0, 180.0];
/// Floor of the fitted logarithm relative to the mean; differences below it hardly count.
const LOG_FLOOR: f64 = 0.1;
/// Degrees between azimuths of the tables by which fits are compared.
const FINE_AZIMUTHS: usize = 6;
/// Number of starts, those with the smallest error, that are fitted to the samples.
const PROMISING: usize = 5;
/// Number of fits to the samples that are refined on the picture.
const REFINED: usize = 3;

/// Factor and term by which the criterion may increase if an optional group of parameters is left
/// out.
const HARDLY: (f64, f64) = (1.05, 0.01);

/// Criterion below which a model without coat, and with the roughness of the highlight, is taken
/// without a search for others.
const GOOD: f64 = 0.08;

/// Increase of the criterion that is accepted for such a model, about the error of the BRDF of a
/// photograph in known light.
const ACCEPTED: f64 = 0.04;

/// Smallest width of the range of the roughness.
const MIN_RANGE: f64 = 0.02;

/// Factors by which a table of unknown scale may be scaled, from an albedo of 0.5 downwards.
const FACTORS: [f64; 7] = [1.0, 0.6, 0.36, 0.22, 0.13, 0.08, 0.05];

/// Factor and term by which the criteria of similar fits of a scale differ at most.
const SIMILAR: (f64, f64) = (1.15, 0.01);

/// Number of starts for a fit with fewer parameters.
const SIMPLER: usize = 2;

/// Fraction of a parameter's range within which the end of the range is tried.
const NEAR_END: f64 = 0.04;

/// Fitted model and its errors.
#[derive(Clone, Debug, PartialEq)]
pub struct Fitted<S> {
    /// Best model.
    pub model: S,
    /// Relative error of the picture of a sphere in a studio light.
    ///
    /// This is the root mean square difference between a sphere of the model and one of the table,
    /// relative to the latter. It covers all channels and the normals up to 80 degrees.
    pub relight: f64,
    /// Root mean square difference of the logarithms, with one percent of the mean added to both.
    pub log_relight: f64,
    /// Parameters of the model, in the order of [`Shading::PARAMETERS`].
    parameters: Vec<f64>,
    /// Ranges of the parameters in the fit.
    ranges: Vec<Parameter>,
}

/// Table to fit, and the sphere by which fits are compared.
#[derive(Clone)]
pub struct Fitter {
    samples: Arc<Vec<Sample>>,
    relighters: Arc<[Relighter; 3]>,
    sketch: Arc<Sketch>,
    floor: f64,
    body: DVec3,
    highlight: DVec3,
    /// Interval of the roughness of the highlight, if it is known.
    roughness: Option<[f64; 2]>,
    /// Picture of the table, exactly and by the sketch.
    picture: Vec<DVec3>,
    sketched: Vec<DVec3>,
    /// Mean over all channels of the exact picture.
    mean: f64,
    /// Compressed colours of the sketched picture, which do not depend on the scale of the table.
    compressed: Vec<DVec3>,
}

/// Pair of directions, and the logarithm of the table's value times the cosine of the light.
struct Sample {
    wi: DVec3,
    wo: DVec3,
    logs: DVec3,
}

impl Fitter {
    /// Prepares the fit of linear RGB tables in 1/sr.
    pub fn new(tables: &[BivariateTable; 3]) -> Self {
        let points = Lattice::new().points(DQuat::IDENTITY);
        let settings = IntegratorSettings { tolerance: 0.5, max_cells: 8000 };
        let relighters = Relighter::of_channels(&points, tables, &LightTree::of_map(&studio_light(64)), &settings);
        let sketch = Sketch::new(&relighters);
        Self::on_sphere(Arc::new(relighters), Arc::new(sketch), tables)
    }

    fn on_sphere(relighters: Arc<[Relighter; 3]>, sketch: Arc<Sketch>, tables: &[BivariateTable; 3]) -> Self {
        let at = |h: f64, d: f64| DVec3::from_array(tables.each_ref().map(|t| t.eval(h, d)));
        let mut samples = Vec::new();
        for i in (0..THETA_H).step_by(STEP_H) {
            for (j, phi) in DIFFERENCE.into_iter().flat_map(|j| AZIMUTHS.map(|phi| (j, phi))) {
                let (h, d) = (theta_h_of(i), theta_d_of(j));
                let (wi, wo) = directions(h, d, phi.to_radians());
                if wi.z > 0.1 && wo.z > 0.1 {
                    samples.push(Sample { wi, wo, logs: at(h, d) });
                }
            }
        }
        // The body is the reflectance far from the peak; the highlight is the rest of the albedo.
        let body = std::f64::consts::PI * at(60_f64.to_radians(), 30_f64.to_radians());
        let albedo = DVec3::from_array(tables.each_ref().map(BivariateTable::normal_albedo));
        let highlight = (albedo - body).max(DVec3::splat(0.01));
        let floor = LOG_FLOOR * albedo.element_sum() / 3.0 / std::f64::consts::PI;
        for sample in &mut samples {
            sample.logs = logs(sample.logs * sample.wi.z, floor);
        }
        let (picture, sketched) = (picture(&relighters, tables), sketch.target(tables));
        let mean = picture.iter().map(|p| p.element_sum()).sum::<f64>() / (3 * picture.len()) as f64;
        let compressed = sketched.iter().map(|colour| compressed(*colour, mean)).collect();
        let samples = Arc::new(samples);
        let roughness = None;
        Self { samples, relighters, sketch, floor, body, highlight, roughness, picture, sketched, mean, compressed }
    }

    /// Prefers models without coat whose roughness is in this interval
    /// ([`Highlight::roughness`](crate::estimate::Highlight::roughness)).
    #[must_use]
    pub fn with_roughness(self, interval: [f64; 2]) -> Self {
        Self { roughness: Some(interval), ..self }
    }

    /// Returns a fitter of other tables with the same sphere. The tables are draws from a posterior
    /// whose estimate is the table of this fitter: the sphere resolves their highlights if they are
    /// not much sharper.
    #[must_use]
    pub fn of_draw(&self, tables: &[BivariateTable; 3]) -> Self {
        Self::on_sphere(self.relighters.clone(), self.sketch.clone(), tables)
    }

    /// Returns the fitter of the table multiplied by a factor.
    #[must_use]
    pub fn scaled(&self, by: f64) -> Self {
        let scaled = |picture: &[DVec3]| picture.iter().map(|p| by * *p).collect();
        // The samples are relative to the floor.
        Self {
            floor: by * self.floor,
            body: by * self.body,
            highlight: by * self.highlight,
            picture: scaled(&self.picture),
            sketched: scaled(&self.sketched),
            mean: by * self.mean,
            ..self.clone()
        }
    }

    /// Returns the factor of the table at which [`Layered`] fits best; of similar fits, the largest
    /// factor.
    ///
    /// A photograph under unknown light does not determine the scale of reflectance. The model
    /// does: the reflectance of dielectrics at normal incidence is about 0.04, and albedos are
    /// below one.
    pub fn plausible_scale(&self) -> f64 {
        let all: Vec<usize> = (0..Layered::PARAMETERS.len()).collect();
        let error = |&by: &f64| {
            let fitter = self.scaled(by);
            let starts = Layered::starts(fitter.body, fitter.highlight);
            fitter.search::<Layered>(Layered::PARAMETERS, starts, &all, SIMPLER, 1).0
        };
        let errors: Vec<f64> = parallel::map(&FACTORS, error);
        let least = errors.iter().copied().fold(f64::INFINITY, f64::min);
        let similar = errors.iter().position(|error| *error <= SIMILAR.0 * least + SIMILAR.1);
        FACTORS[similar.unwrap_or(0)]
    }

    /// Fits a model from the most promising starts, without the [`Shading::OPTIONAL`] parameters
    /// that hardly improve the fit.
    ///
    /// A sum of two lobes can imitate a highlight whose roughness neither of them has. If the
    /// roughness of the highlight is known ([`with_roughness`](Fitter::with_roughness)), the model
    /// has it and no coat, unless that increases the error clearly.
    pub fn fit<S: Shading>(&self) -> Fitted<S> {
        let error = |fitted: &Fitted<S>| criterion((fitted.relight, fitted.log_relight));
        let preferred = self.roughness.zip(S::ROUGHNESS_AND_COAT).map(|([low, high], (roughness, coat))| {
            let mut ranges = S::PARAMETERS.to_vec();
            let Parameter { low: least, high: most } = ranges[roughness];
            let low = low.clamp(least, most - MIN_RANGE);
            ranges[roughness] = Parameter { low, high: high.clamp(low + MIN_RANGE, most) };
            let groups: Vec<_> = (0..S::OPTIONAL.len()).filter(|group| *group != coat).collect();
            self.fit_within(&ranges, S::OPTIONAL[coat].to_vec(), &groups)
        });
        let preferred = match preferred {
            Some(fitted) if error(&fitted) <= GOOD => return fitted,
            preferred => preferred,
        };
        let free = self.fit_within(S::PARAMETERS, Vec::new(), &Vec::from_iter(0..S::OPTIONAL.len()));
        let limit = HARDLY.0 * error(&free) + ACCEPTED;
        preferred.filter(|fitted| error(fitted) <= limit).unwrap_or(free)
    }

    /// Fits a model whose parameters are within `ranges`, except for the `disabled` ones. Leaves
    /// out the optional `groups` that hardly improve the fit.
    fn fit_within<S: Shading>(
        &self,
        ranges: &[Parameter],
        mut disabled: Vec<(usize, f64)>,
        groups: &[usize],
    ) -> Fitted<S> {
        let without = |mut start: Vec<f64>, disabled: &[(usize, f64)]| {
            disabled.iter().for_each(|(k, value)| start[*k] = *value);
            start
        };
        let all = S::starts(self.body, self.highlight);
        let mut free: Vec<usize> = (0..ranges.len()).filter(|k| disabled.iter().all(|(other, _)| other != k)).collect();
        let starts = all.iter().cloned().map(|start| without(start, &disabled)).collect();
        let (mut least, mut parameters) = self.search::<S>(ranges, starts, &free, PROMISING, REFINED);
        let mut found = vec![parameters.clone()];
        for group in groups.iter().map(|group| S::OPTIONAL[*group]) {
            let fewer: Vec<usize> = free.iter().copied().filter(|k| group.iter().all(|(g, _)| g != k)).collect();
            let disabled_too = [&disabled, group].concat();
            let starts = all.iter().cloned().chain([parameters.clone()]);
            let starts = starts.map(|start| without(start, &disabled_too)).collect();
            let (error, simpler) = self.search::<S>(ranges, starts, &fewer, SIMPLER, REFINED);
            found.push(simpler.clone());
            if error <= HARDLY.0 * least + HARDLY.1 {
                (least, parameters, free, disabled) = (error, simpler, fewer, disabled_too);
            }
        }
        // The sketch does not resolve very sharp lobes, so the exact errors decide. Later fits have
        // fewer parameters.
        let mut judged: Vec<Fitted<S>> = parallel::map(&found, |parameters| self.judge(parameters.clone(), ranges));
        let error = |fitted: &Fitted<S>| criterion((fitted.relight, fitted.log_relight));
        let least = judged.iter().map(error).fold(f64::INFINITY, f64::min);
        let simplest = judged.iter().rposition(|fitted| error(fitted) <= HARDLY.0 * least + HARDLY.1);
        judged.swap_remove(simplest.unwrap_or(0))
    }

    /// Fits a model from the parameters of another fit, within the same ranges. Optional parameters
    /// that the other fit left out remain left out.
    pub fn refit<S: Shading>(&self, near: &Fitted<S>) -> S {
        let start = &near.parameters;
        let is_out = |group: &&&[(usize, f64)]| group.iter().all(|(k, value)| start[*k] == *value);
        let out: Vec<usize> =
            S::OPTIONAL.iter().filter(is_out).flat_map(|group| group.iter().map(|(k, _)| *k)).collect();
        let free: Vec<usize> = (0..S::PARAMETERS.len()).filter(|k| !out.contains(k)).collect();
        S::of(&self.search::<S>(&near.ranges, vec![start.clone()], &free, 1, 1).1)
    }

    /// Fits the `free` parameters of a model, within their `ranges`, from the `promising` most
    /// promising starts. Returns the least [`criterion`] and its parameters.
    ///
    /// A first search fits samples of the table; a second one refines its `refined` best results on
    /// the picture of a sphere, in which a peak has its visual weight. The result is the best model
    /// of both searches.
    fn search<S: Shading>(
        &self,
        ranges: &[Parameter],
        starts: Vec<Vec<f64>>,
        free: &[usize],
        promising: usize,
        refined: usize,
    ) -> (f64, Vec<f64>) {
        let judged = |parameters: Vec<f64>| (self.criterion_of(&S::of(&parameters)), parameters);
        let best = |mut found: Vec<(f64, Vec<f64>)>, count: usize| {
            found.sort_by(|a, b| a.0.total_cmp(&b.0));
            found.truncate(count);
            found
        };
        let search = |start: &[f64], goal: Goal, patience: usize| {
            let problem = Search::<S>::new(self, ranges, start, free, goal);
            let (found, _) =
                LevenbergMarquardt::new().with_patience(patience).with_ftol(1e-3).with_xtol(1e-3).minimize(problem);
            found.parameters()
        };
        let starts = best(parallel::map(&starts, |start| judged(start.clone())), promising);
        let first = parallel::map(&starts, |(_, start)| judged(search(start, Goal::Samples, 12)));
        let first = best(first, refined);
        let refined: Vec<_> = parallel::map(&first, |(_, at)| judged(search(at, Goal::Picture, 2)));
        let (mut least, mut parameters) =
            best([first, refined].concat(), 1).pop().expect("every model has starting parameters");
        // The logistic function never reaches the ends of its range, so they are tried separately.
        for (k, range) in free.iter().map(|&k| (k, ranges[k])) {
            for end in [range.low, range.high] {
                if (parameters[k] - end).abs() < NEAR_END * (range.high - range.low) {
                    let inner = std::mem::replace(&mut parameters[k], end);
                    let there = self.criterion_of(&S::of(&parameters));
                    if there <= least {
                        least = there;
                    } else {
                        parameters[k] = inner;
                    }
                }
            }
        }
        (least, parameters)
    }

    /// Computes the errors of the model with these parameters.
    fn judge<S: Shading>(&self, parameters: Vec<f64>, ranges: &[Parameter]) -> Fitted<S> {
        let model = S::of(&parameters);
        let (relight, log_relight) = self.compare(&model.to_bivariate(FINE_AZIMUTHS));
        Fitted { model, relight, log_relight, parameters, ranges: ranges.to_vec() }
    }

    /// Returns the errors [`Fitted::relight`] and [`Fitted::log_relight`] of other tables.
    pub fn compare(&self, tables: &[BivariateTable; 3]) -> (f64, f64) {
        self.errors(&self.picture, &picture(&self.relighters, tables))
    }

    /// Returns the [`criterion`] of a model, approximated by the sketch.
    fn criterion_of<S: Shading>(&self, model: &S) -> f64 {
        criterion(self.errors(&self.sketched, &self.sketch.picture_of(model)))
    }

    fn errors(&self, want: &[DVec3], shown: &[DVec3]) -> (f64, f64) {
        let (mut off, mut all, mut logs, least) = (0.0, 0.0, 0.0, 0.01 * self.mean);
        for (a, b) in want.iter().zip(shown) {
            off += (*a - *b).length_squared();
            all += a.length_squared();
            let ratio = (*b + DVec3::splat(least)) / (*a + DVec3::splat(least));
            logs += ratio.to_array().map(|r| r.ln().powi(2)).iter().sum::<f64>();
        }
        ((off / all).sqrt(), (logs / (3 * shown.len()) as f64).sqrt())
    }
}

/// Returns the criterion that the best fit minimises.
///
/// The peak dominates `relight`, but hardly affects `log_relight`.
fn criterion((relight, log_relight): (f64, f64)) -> f64 {
    log_relight + 0.5 * relight
}

fn logs(value: DVec3, floor: f64) -> DVec3 {
    DVec3::from_array((value / floor).to_array().map(|v| v.max(0.0).ln_1p()))
}

fn picture(relighters: &[Relighter; 3], tables: &[BivariateTable; 3]) -> Vec<DVec3> {
    let [r, g, b]: [Vec<f64>; 3] = std::array::from_fn(|c| relighters[c].render(&tables[c]));
    r.into_iter().zip(g).zip(b).map(|((r, g), b)| DVec3::new(r, g, b).max(DVec3::ZERO)).collect()
}

#[cfg(test)]
mod tests;
