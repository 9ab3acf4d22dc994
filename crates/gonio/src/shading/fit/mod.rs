//! Fits of shading models to tables.

mod sketch;

use glam::{DQuat, DVec3};
use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt};
use nalgebra::{DMatrix, DVector, Dyn, Owned};
use rayon::prelude::*;

use super::Shading;
use crate::appearance::Lattice;
use crate::lighting::studio_light;
use crate::reflectance::parametric::directions;
use crate::reflectance::{BivariateTable, THETA_H};
use crate::reflectance::{theta_d_of, theta_h_of};
use crate::render::{IntegratorSettings, LightTree, Relighter};
use sketch::Sketch;

/// Step between half angles, in samples of a table, which are dense at the peak.
const STEP_H: usize = 3;
/// Difference angles in degrees.
const DIFFERENCE: [usize; 10] = [0, 10, 20, 30, 40, 50, 60, 68, 74, 79];
/// Azimuths `phi_d` in degrees.
const AZIMUTHS: [f64; 3] = [0.0, 90.0, 180.0];
/// Floor of the fitted logarithm relative to the mean; differences below it hardly count.
const FLOOR: f64 = 0.1;
/// Step of the finite differences, in the argument of the logistic function.
const STEP: f64 = 1e-4;
/// Degrees between azimuths of the tables by which fits are compared.
const FINE: usize = 6;
/// Number of starts, those with the smallest error, that are fitted to the samples.
const PROMISING: usize = 5;
/// Number of fits to the samples that are refined on the picture.
const REFINED: usize = 3;

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
}

impl<S> Fitted<S> {
    fn off(&self) -> f64 {
        criterion((self.relight, self.log_relight))
    }
}

/// Table to fit, and the sphere by which fits are compared.
pub struct Fitter {
    samples: Vec<Sample>,
    floor: f64,
    body: DVec3,
    highlight: DVec3,
    relighters: [Relighter; 3],
    picture: Vec<DVec3>,
    sketch: Sketch,
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
        let floor = FLOOR * albedo.element_sum() / 3.0 / std::f64::consts::PI;
        for sample in &mut samples {
            sample.logs = logs(sample.logs * sample.wi.z, floor);
        }
        let points = Lattice::new().points(DQuat::IDENTITY);
        let settings = IntegratorSettings { tolerance: 0.5, max_cells: 8000 };
        let relighters = Relighter::of_channels(&points, tables, &LightTree::of_map(&studio_light(64)), &settings);
        let picture = picture(&relighters, tables);
        let sketch = Sketch::new(&relighters, tables);
        Self { samples, floor, body, highlight, relighters, picture, sketch }
    }

    /// Fits a model from the most promising starts.
    ///
    /// A first search fits samples of the table; a second one refines its best results on the
    /// picture of a sphere, in which a peak has its visual weight. The result is the best model of
    /// both searches.
    pub fn fit<S: Shading>(&self) -> Fitted<S> {
        let starts = S::starts(self.body, self.highlight).into_par_iter();
        let mut starts: Vec<(f64, Vec<f64>)> = starts.map(|start| (self.sketched(&S::of(&start)), start)).collect();
        starts.sort_by(|a, b| a.0.total_cmp(&b.0));
        starts.truncate(PROMISING);
        let search = |start: &[f64], goal: Goal, patience: usize| {
            let problem = Search::<S>::new(self, start, goal);
            let (found, _) =
                LevenbergMarquardt::new().with_patience(patience).with_ftol(1e-3).with_xtol(1e-3).minimize(problem);
            found.parameters()
        };
        let first = starts.par_iter().map(|(_, start)| {
            let found = search(start, Goal::Samples, 12);
            (self.sketched(&S::of(&found)), found)
        });
        let mut first: Vec<(f64, Vec<f64>)> = first.collect();
        first.sort_by(|a, b| a.0.total_cmp(&b.0));
        first.truncate(REFINED);
        let found = first.into_par_iter().flat_map_iter(|(_, at)| {
            let refined = search(&at, Goal::Picture, 2);
            [at, refined].map(|parameters| (self.judge(S::of(&parameters)), parameters))
        });
        let found: Vec<(Fitted<S>, Vec<f64>)> = found.collect();
        let best = found.into_iter().min_by(|a, b| a.0.off().total_cmp(&b.0.off()));
        let (mut best, mut parameters) = best.expect("every model has starting parameters");
        // The logistic function never reaches the ends of its range, so they are tried separately.
        for (k, range) in S::PARAMETERS.iter().enumerate() {
            for end in [range.low, range.high] {
                if (parameters[k] - end).abs() < NEAR_END * (range.high - range.low) {
                    let inner = std::mem::replace(&mut parameters[k], end);
                    let there = self.judge(S::of(&parameters));
                    if there.off() <= best.off() {
                        best = there;
                    } else {
                        parameters[k] = inner;
                    }
                }
            }
        }
        best
    }

    /// Computes the errors of a model.
    pub fn judge<S: Shading>(&self, model: S) -> Fitted<S> {
        let (relight, log_relight) = self.compare(&model.to_bivariate(FINE));
        Fitted { model, relight, log_relight }
    }

    /// Returns the mean over all channels of the picture.
    fn mean(&self) -> f64 {
        self.picture.iter().map(|p| p.element_sum()).sum::<f64>() / (3 * self.picture.len()) as f64
    }

    /// Returns the errors [`Fitted::relight`] and [`Fitted::log_relight`] of other tables.
    pub fn compare(&self, tables: &[BivariateTable; 3]) -> (f64, f64) {
        self.errors(&self.picture, &picture(&self.relighters, tables))
    }

    /// Returns the [`criterion`] of a model, approximated by the sketch.
    fn sketched<S: Shading>(&self, model: &S) -> f64 {
        let shown = self.sketch.picture(&self.sketch.values(|wi, wo| model.eval(wi, wo)));
        criterion(self.errors(&self.sketch.target, &shown))
    }

    fn errors(&self, want: &[DVec3], shown: &[DVec3]) -> (f64, f64) {
        let (mut off, mut all, mut logs, least) = (0.0, 0.0, 0.0, 0.01 * self.mean());
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

/// Goal of a search.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Goal {
    /// Match the values of the table.
    Samples,
    /// Match the picture of a sphere in a studio light.
    Picture,
}

/// Parameters during a search, each limited to its range by a logistic function.
struct Search<'a, S> {
    fitter: &'a Fitter,
    goal: Goal,
    at: DVector<f64>,
    model: std::marker::PhantomData<S>,
}

impl<'a, S: Shading> Search<'a, S> {
    fn new(fitter: &'a Fitter, start: &[f64], goal: Goal) -> Self {
        let inverse = |(x, p): (&f64, &super::Parameter)| {
            let share = ((x - p.low) / (p.high - p.low)).clamp(0.005, 0.995);
            (share / (1.0 - share)).ln()
        };
        let at = DVector::from_iterator(start.len(), start.iter().zip(S::PARAMETERS).map(inverse));
        Self { fitter, goal, at, model: std::marker::PhantomData }
    }

    fn parameters(&self) -> Vec<f64> {
        Self::within(&self.at)
    }

    fn within(at: &DVector<f64>) -> Vec<f64> {
        let ranges = S::PARAMETERS.iter();
        at.iter().zip(ranges).map(|(x, p)| p.low + (p.high - p.low) / (1.0 + (-x).exp())).collect()
    }

    fn off(&self, at: &DVector<f64>) -> Vec<f64> {
        let model = S::of(&Self::within(at));
        if self.goal == Goal::Picture {
            let sketch = &self.fitter.sketch;
            let shown = sketch.picture(&sketch.values(|wi, wo| model.eval(wi, wo)));
            let mean = self.fitter.mean();
            // The cube root is a compromise between the value, in which the peak dominates, and its
            // logarithm, in which the peak is a few pixels of many.
            let bright = |c: DVec3| c.to_array().map(|c| (c / mean + FLOOR).cbrt());
            let pixels = shown.iter().zip(&sketch.target);
            return pixels.flat_map(|(a, b)| (DVec3::from(bright(*a)) - DVec3::from(bright(*b))).to_array()).collect();
        }
        let each = |s: &Sample| {
            let got = logs(model.eval(s.wi, s.wo) * s.wi.z, self.fitter.floor);
            (got - s.logs).to_array()
        };
        self.fitter.samples.iter().flat_map(each).collect()
    }
}

impl<S: Shading> LeastSquaresProblem<f64, Dyn, Dyn> for Search<'_, S> {
    type ResidualStorage = Owned<f64, Dyn>;
    type JacobianStorage = Owned<f64, Dyn, Dyn>;
    type ParameterStorage = Owned<f64, Dyn>;

    fn set_params(&mut self, x: &DVector<f64>) {
        self.at.copy_from(x);
    }

    fn params(&self) -> DVector<f64> {
        self.at.clone()
    }

    fn residuals(&self) -> Option<DVector<f64>> {
        Some(DVector::from_vec(self.off(&self.at)))
    }

    fn jacobian(&self) -> Option<DMatrix<f64>> {
        let (here, mut columns) = (self.off(&self.at), Vec::new());
        for k in 0..self.at.len() {
            let mut at = self.at.clone();
            at[k] += STEP;
            columns.extend(self.off(&at).iter().zip(&here).map(|(there, here)| (there - here) / STEP));
        }
        Some(DMatrix::from_vec(columns.len() / self.at.len(), self.at.len(), columns))
    }
}

#[cfg(test)]
mod tests {
    use super::super::{ColourCookTorrance, ColourWard, Layered, MetallicRoughness, Principled};
    use super::*;

    /// Fits a model to its own table.
    fn found_again<S: Shading>(parameters: &[f64], log: f64) -> S {
        let tables = S::of(parameters).to_bivariate(FINE);
        let found = Fitter::new(&tables).fit::<S>();
        assert!(found.log_relight < log, "{} {}", found.relight, found.log_relight);
        found.model
    }

    #[test]
    fn recovers_metallic_roughness() {
        let got: MetallicRoughness = found_again(&[0.5, 0.2, 0.1, 0.05, 0.35, 1.5], 0.01);
        assert!((got.roughness - 0.35).abs() < 0.01 && (got.base_color.x - 0.5).abs() < 0.02, "{got:?}");
    }

    #[test]
    fn recovers_a_layered_metal() {
        let got: Layered = found_again(&[0.9, 0.6, 0.3, 1.0, 0.25, 1.5], 0.02);
        assert!((got.roughness - 0.25).abs() < 0.01 && got.metalness > 0.9, "{got:?}");
    }

    #[test]
    fn recovers_a_principled_body_with_sheen() {
        let got: Principled = found_again(&[0.2, 0.3, 0.6, 0.0, 0.4, 1.5, 0.0, 0.0, 0.9], 0.02);
        assert!((got.roughness - 0.4).abs() < 0.02 && got.metallic < 0.1, "{got:?}");
    }

    #[test]
    fn recovers_the_classic_models() {
        let got: ColourWard = found_again(&[0.3, 0.2, 0.1, 0.1, 0.1, 0.1, 0.08], 0.01);
        assert!((got.roughness - 0.08).abs() < 0.004, "{got:?}");
        let got: ColourCookTorrance = found_again(&[0.3, 0.2, 0.1, 0.5, 0.5, 0.5, 0.1, 0.15], 0.02);
        assert!((got.roughness - 0.15).abs() < 0.01, "{got:?}");
    }

    #[test]
    fn jacobian_matches_finite_differences() {
        let tables = MetallicRoughness::of(&[0.5, 0.2, 0.1, 0.3, 0.35, 1.4]).to_bivariate(FINE);
        let fitter = Fitter::new(&tables);
        let search = Search::<MetallicRoughness>::new(&fitter, &[0.4, 0.3, 0.2, 0.2, 0.5, 1.5], Goal::Samples);
        let slopes = search.jacobian().unwrap();
        for k in 0..6 {
            let mut at = search.at.clone();
            at[k] += 1e-3;
            let (far, near) = (search.off(&at), search.off(&search.at));
            for (row, (far, near)) in far.iter().zip(&near).enumerate() {
                let want = (far - near) / 1e-3;
                assert!((slopes[(row, k)] - want).abs() < 2e-3 * (1.0 + want.abs()), "{row} {k}");
            }
        }
    }
}
