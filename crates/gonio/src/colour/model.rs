//! Prior of the colours, and posterior of the channels.

use faer::Mat;
use gonio_linalg::{Cholesky, eigenvectors, product};
use rand::{Rng, RngExt, SeedableRng};
use rand_distr::{ChiSquared, Distribution, StandardNormal};
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

use super::chroma::Chroma;
use super::differences::ChannelReading;
use super::field::ChromaField;
use crate::parallel;
use crate::reflectance::{BivariateTable, CELLS, LatentSpace, nearest_trusted};

/// Largest number of axes of the differences used under a known light.
const MAX_AXES: usize = 12;

/// Prior variance of the last coefficient: the mean chroma of materials is free.
const FREE_VARIANCE: f64 = 25.0;

/// Standard deviation of a given chroma of the light: a grey card is accurate to about two per
/// cent.
const GIVEN_CHROMA_SD: f64 = 0.02;

/// Factor by which draws of the channel differences are widened, under unknown and known light.
///
/// Three errors require it (`gonio-eval calibration`). Photographs and materials differ from the
/// simulated ones. The posterior under a known light is the Gaussian of one linearisation. Neither
/// light nor table is exact.
pub(crate) const DRAW_INFLATION: f64 = 1.5;

/// Degrees of freedom of Student's distribution of these draws: some materials differ far more than
/// others.
pub(crate) const DRAW_FREEDOM: f64 = 3.0;

/// Largest absolute logarithm of a channel relative to the luminance, before its albedo is set.
const MAX_LOG_RATIO: f32 = 12.0;

/// Component of the prior of the chroma of lights, a mixture of Gaussians around neutral.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LightComponent {
    /// Weight of the component, in 0..=1.
    pub weight: f64,
    /// Covariance of `(ln R/G, ln B/G)`.
    pub covariance: [[f64; 2]; 2],
}

/// Prior of the channels of materials and of the chroma of lights, and the error of readings.
///
/// The model is learnt by [`ColourModel::learn`] and part of a
/// [`LearntPosterior`](crate::inference::learnt::LearntPosterior).
///
/// All matrices are row-major, with one row per material coordinate and a last row for the log
/// ratio of the albedos.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ColourModel {
    /// Covariance of the difference of a channel from the luminance
    /// ([`channel_difference`](super::channel_difference)).
    pub differences: Vec<Vec<f64>>,
    /// The same covariance with mean logarithms
    /// ([`mean_log_difference`](super::mean_log_difference)).
    pub mean_log_differences: Vec<Vec<f64>>,
    /// Covariance of the error of the reading of red, green and blue ([`ChannelReading::minus`]).
    pub errors: [Vec<Vec<f64>>; 3],
    /// Prior of the chroma of lights, as returned by [`white_chroma`](super::white_chroma).
    pub lights: Vec<LightComponent>,
}

/// Posterior of the difference of each channel from the luminance, given readings.
#[derive(Clone, Debug)]
pub struct DifferencePosterior {
    /// Mean coefficients of red, green and blue.
    means: [Vec<f64>; 3],
    /// Square roots of their covariances.
    factors: [Mat<f64>; 3],
    /// Distribution of the chroma of the light around `light`.
    lights: Vec<LightComponent>,
    /// Chroma of the light: the given one, or neutral.
    light: Chroma,
}

impl ColourModel {
    /// Whether all matrices are valid for this number of coordinates.
    ///
    /// They must be finite and have positive diagonals.
    pub(crate) fn is_proper(&self, dimensions: usize) -> bool {
        let size = dimensions + 1;
        let matrices = [&self.differences, &self.mean_log_differences].into_iter().chain(&self.errors);
        let sound = |rows: &Vec<Vec<f64>>| {
            let shape = rows.len() == size && rows.iter().all(|row| row.len() == size);
            let finite = rows.iter().flatten().all(|x| x.is_finite());
            shape && finite && (0..size).all(|i| rows[i][i] > 0.0)
        };
        let light = |component: &LightComponent| {
            let [[a, b], [c, d]] = component.covariance;
            component.weight >= 0.0 && [a, b, c, d].iter().all(|x| x.is_finite()) && a > 0.0 && a * d > b * c
        };
        let total: f64 = self.lights.iter().map(|component| component.weight).sum();
        matrices.into_iter().all(sound) && total > 0.0 && self.lights.iter().all(light)
    }

    /// Computes the posterior from the readings of luminance, red, green and blue.
    ///
    /// A channel is `None` if it is black. `light` is the chroma of the light, if known. Returns
    /// `None` if the covariances are not positive definite.
    pub fn posterior(
        &self,
        luminance: &ChannelReading,
        channels: &[Option<ChannelReading>; 3],
        light: Option<Chroma>,
    ) -> Option<DifferencePosterior> {
        let chroma = light.unwrap_or_default();
        let of_light = chroma.rgb();
        let n = self.differences.len();
        let prior = free_last(&self.differences);
        let one = |c: usize| -> Option<(Vec<f64>, Mat<f64>)> {
            let mut read = match &channels[c] {
                Some(reading) => reading.minus(luminance),
                None => ChannelReading { mean: 0.0, ..luminance.clone() }.minus(luminance),
            };
            read[n - 1] -= of_light[c].ln();
            // x | y = K (K + E)^-1 y with the covariance K - K (K + E)^-1 K.
            let sum = Cholesky::new(Mat::from_fn(n, n, |i, j| prior[(i, j)] + self.errors[c][i][j]))?;
            let solved = sum.solve(&read);
            let mean = (0..n).map(|i| (0..n).map(|j| prior[(i, j)] * solved[j]).sum()).collect();
            let gained = sum.solve_all(&prior);
            let remaining = Mat::from_fn(n, n, |i, j| {
                let known: f64 = (0..n).map(|k| prior[(i, k)] * gained[(k, j)]).sum();
                prior[(i, j)] - known + if i == j { 1e-9 } else { 0.0 }
            });
            Some((mean, square_root(&remaining)))
        };
        let [red, green, blue] = [one(0)?, one(1)?, one(2)?];
        let lights = match light {
            Some(_) => {
                let variance = GIVEN_CHROMA_SD * GIVEN_CHROMA_SD;
                vec![LightComponent { weight: 1.0, covariance: [[variance, 0.0], [0.0, variance]] }]
            }
            None => self.lights.clone(),
        };
        Some(DifferencePosterior {
            means: [red.0, green.0, blue.0],
            factors: [red.1, green.1, blue.1],
            lights,
            light: chroma,
        })
    }

    /// Returns axes of unit variance along which a channel differs from the luminance,
    /// `[axis][cell]`.
    ///
    /// The differences are those of the logarithms. The axes are ordered by decreasing variance.
    pub(crate) fn axes(&self, coordinates: &LatentSpace) -> Vec<Vec<f32>> {
        let n = self.mean_log_differences.len();
        let covariance = Mat::from_fn(n, n, |i, j| self.mean_log_differences[i][j]);
        let (values, vectors) = eigenvectors(covariance.as_ref());
        let mut order: Vec<usize> = (0..n).collect();
        order.sort_by(|a, b| values[*b].total_cmp(&values[*a]));
        let directions = coordinates.directions();
        let field = |k: usize| {
            let weight = |i: usize| (vectors[(i, k)] * values[k].max(0.0).sqrt()) as f32;
            let mut out = vec![weight(n - 1); CELLS];
            for (i, direction) in directions.iter().enumerate() {
                out.iter_mut().zip(direction).for_each(|(sum, value)| *sum += weight(i) * value);
            }
            out
        };
        order.into_iter().take(MAX_AXES).map(field).collect()
    }
}

/// Returns the covariance with a free last coefficient.
///
/// The regression of the other coefficients on the last one is unchanged, and so is its residual.
fn free_last(covariance: &[Vec<f64>]) -> Mat<f64> {
    let n = covariance.len();
    let last = covariance[n - 1][n - 1];
    let slope = |i: usize| covariance[i][n - 1] / last;
    Mat::from_fn(n, n, |i, j| covariance[i][j] + slope(i) * slope(j) * (FREE_VARIANCE - last))
}

/// Returns the symmetric square root of a positive semidefinite matrix.
fn square_root(matrix: &Mat<f64>) -> Mat<f64> {
    let (values, vectors) = eigenvectors(matrix.as_ref());
    let n = values.len();
    let scaled = Mat::from_fn(n, n, |i, k| vectors[(i, k)] * values[k].max(0.0).sqrt());
    product(scaled.as_ref(), vectors.transpose())
}

impl DifferencePosterior {
    /// Returns the chroma of the light: the given one, or neutral.
    pub fn light(&self) -> Chroma {
        self.light
    }

    /// Returns the most probable field of a material whose luminance is `table`.
    pub fn field(&self, coordinates: &LatentSpace, table: &BivariateTable) -> ChromaField {
        let directions = coordinates.directions();
        let means = self.means.each_ref().map(|mean| &mean[..]);
        field_of(&directions, table, means, [0.0; 3])
    }

    /// Draws fields, each with the corresponding chroma of the light.
    ///
    /// The same seed produces the same draws.
    pub fn draws(
        &self,
        coordinates: &LatentSpace,
        table: &BivariateTable,
        count: usize,
        seed: u64,
    ) -> Vec<(ChromaField, Chroma)> {
        let mut rng = Pcg64::seed_from_u64(seed);
        let drawn: Vec<([Vec<f64>; 3], Chroma)> = (0..count).map(|_| self.draw(&mut rng)).collect();
        let directions = coordinates.directions();
        let made = |(coefficients, light): &([Vec<f64>; 3], Chroma)| {
            // A larger share of a channel in the light means a smaller share in the material.
            let shift = light.rgb().to_array().map(|value| -value.ln());
            let field = field_of(&directions, table, coefficients.each_ref().map(|x| &x[..]), shift);
            (field, Chroma([self.light.0[0] + light.0[0], self.light.0[1] + light.0[1]]))
        };
        parallel::map(&drawn, made)
    }

    /// Draws coefficients and the error of the chroma of the light.
    fn draw(&self, rng: &mut Pcg64) -> ([Vec<f64>; 3], Chroma) {
        let scale =
            DRAW_INFLATION * (DRAW_FREEDOM / ChiSquared::new(DRAW_FREEDOM).expect("it is positive").sample(rng)).sqrt();
        let coefficients = std::array::from_fn(|c| {
            let white: Vec<f64> = self.means[c].iter().map(|_| StandardNormal.sample(rng)).collect();
            let step = |i: usize| (0..white.len()).map(|j| self.factors[c][(i, j)] * white[j]).sum::<f64>();
            self.means[c].iter().enumerate().map(|(i, mean)| mean + scale * step(i)).collect()
        });
        (coefficients, draw_light(&self.lights, rng))
    }
}

/// Draws a chroma from a mixture around neutral.
fn draw_light(lights: &[LightComponent], rng: &mut impl Rng) -> Chroma {
    let total: f64 = lights.iter().map(|component| component.weight).sum();
    let mut left = rng.random_range(0.0..1.0) * total;
    let inside = |component: &&LightComponent| {
        left -= component.weight;
        left < 0.0
    };
    let component = lights.iter().find(inside).unwrap_or(&lights[lights.len() - 1]);
    let [[a, b], [_, d]] = component.covariance;
    let (first, slope) = (a.sqrt(), b / a.sqrt());
    let white: [f64; 2] = [StandardNormal.sample(rng), StandardNormal.sample(rng)];
    Chroma([first * white[0], slope * white[0] + (d - slope * slope).max(0.0).sqrt() * white[1]])
}

/// Returns the field of channels given by coefficients of the directions.
///
/// The logarithm of a channel is that of `table` plus the weighted directions. The last coefficient
/// plus `shift` is the logarithm of the ratio of the albedos along the normal.
fn field_of(
    directions: &[Vec<f32>],
    table: &BivariateTable,
    coefficients: [&[f64]; 3],
    shift: [f64; 3],
) -> ChromaField {
    let albedo = table.normal_albedo();
    ChromaField::of_logs(std::array::from_fn(|c| {
        let (last, weights) = coefficients[c].split_last().expect("the last coefficient is that of the albedo");
        let mut logs = vec![0.0_f32; CELLS];
        for (direction, weight) in directions.iter().zip(weights) {
            logs.iter_mut().zip(direction).for_each(|(sum, value)| *sum += *weight as f32 * value);
        }
        // The model contains no information outside the trusted cells.
        let logs: Vec<f32> =
            (0..CELLS).map(|cell| logs[nearest_trusted(cell)].clamp(-MAX_LOG_RATIO, MAX_LOG_RATIO)).collect();
        let channel = table.as_slice().iter().zip(&logs).map(|(value, log)| value * log.exp());
        let own = BivariateTable::from_vec(channel.collect()).normal_albedo();
        let level = (last + shift[c] - (own / albedo).max(1e-300).ln()) as f32;
        logs.into_iter().map(|log| log + level).collect()
    }))
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::inference::learnt::tests::WORLD;

    /// Model with differences of 0.5, reading errors of 0.1 and lights of 0.2 (standard
    /// deviations).
    pub(crate) fn plain() -> ColourModel {
        let size = WORLD.latent_space.axes.len() + 1;
        let round = |sd: f64| -> Vec<Vec<f64>> {
            (0..size).map(|i| (0..size).map(|j| if i == j { sd * sd } else { 0.0 }).collect()).collect()
        };
        ColourModel {
            differences: round(0.5),
            mean_log_differences: round(0.5),
            errors: [0; 3].map(|_| round(0.1)),
            lights: vec![LightComponent { weight: 1.0, covariance: [[0.04, 0.0], [0.0, 0.04]] }],
        }
    }

    fn reading(first: f64, mean: f64) -> ChannelReading {
        let mut place = vec![0.0; WORLD.latent_space.axes.len()];
        place[0] = first;
        ChannelReading { coordinates: place, mean }
    }

    /// The mean solves `K^-1 x = E^-1 (y - x)`, the equations of the maximum of the posterior.
    #[test]
    fn the_mean_is_the_maximum_of_the_posterior() {
        let mut model = plain();
        let n = model.differences.len();
        // Correlated differences and errors.
        for i in 0..n {
            for j in 0..n {
                model.differences[i][j] += 0.05 * ((i + 1) * (j + 1)) as f64 / n as f64;
                model.errors[0][i][j] += 0.002 * (i as f64 - 2.0) * (j as f64 - 2.0);
            }
        }
        let (luminance, red) = (reading(0.0, 1.0), reading(0.7, 1.8));
        let channels = [Some(red.clone()), Some(luminance.clone()), Some(luminance.clone())];
        let found = model.posterior(&luminance, &channels, None).unwrap();
        let (prior, read) = (free_last(&model.differences), red.minus(&luminance));
        let error = Mat::from_fn(n, n, |i, j| model.errors[0][i][j]);
        let residuals: Vec<f64> = read.iter().zip(&found.means[0]).map(|(y, x)| y - x).collect();
        let (of_prior, of_reading) =
            (Cholesky::new(prior).unwrap().solve(&found.means[0]), Cholesky::new(error).unwrap().solve(&residuals));
        for (a, b) in of_prior.iter().zip(&of_reading) {
            assert!((a - b).abs() < 1e-6 * (1.0 + a.abs()), "{a} {b}");
        }
        // The prior does not pull the mean colour to grey. The reading of green is that of the
        // luminance.
        assert!((found.means[0][n - 1] - 1.8_f64.ln()).abs() < 0.05, "{:?}", found.means[0]);
        assert!(found.means[1].iter().all(|x| x.abs() < 1e-9));
    }

    #[test]
    fn draws_vary_with_the_light_and_less_with_a_given_light() {
        let (model, table) = (plain(), WORLD.table(&WORLD.entries[2]));
        let luminance = reading(0.0, 1.0);
        let channels = [Some(reading(0.1, 1.5)), Some(reading(0.0, 1.0)), Some(reading(0.0, 0.5))];
        let spread = |light: Option<Chroma>| {
            let found = model.posterior(&luminance, &channels, light).unwrap();
            let draws = found.draws(&WORLD.latent_space, &table, 400, 3);
            assert_eq!(draws[..3], found.draws(&WORLD.latent_space, &table, 3, 3)[..]);
            // Quantiles, since the tails are heavy.
            let mut all: Vec<f64> = draws.iter().map(|(field, _)| field.body(&table).0[0]).collect();
            all.sort_by(f64::total_cmp);
            let middle = found.field(&WORLD.latent_space, &table).body(&table).0[0];
            (middle, all[200], all[300] - all[100])
        };
        let (blind, given) = (spread(None), spread(Some(Chroma([0.3, 0.0]))));
        assert!((blind.1 - blind.0).abs() < 0.08 && blind.2 > 1.1 * given.2, "{blind:?} {given:?}");
        // A larger share of a channel in the light means a smaller share in the material.
        assert!((blind.0 - given.0 - 0.3).abs() < 0.02, "{blind:?} {given:?}");
    }

    #[test]
    fn a_black_channel_is_dark_but_not_an_error() {
        let (model, table) = (plain(), WORLD.table(&WORLD.entries[2]));
        let luminance = reading(0.0, 1.0);
        let channels = [Some(luminance.clone()), Some(luminance.clone()), None];
        let found = model.posterior(&luminance, &channels, None).unwrap();
        let body = found.field(&WORLD.latent_space, &table).body(&table);
        assert!(body.0[1] < -3.0 && body.0[1].is_finite(), "{body:?}");
    }

    #[test]
    fn damaged_models_are_not_proper() {
        let dimensions = WORLD.latent_space.axes.len();
        assert!(plain().is_proper(dimensions) && !plain().is_proper(dimensions + 1));
        let spoilt = |change: fn(&mut ColourModel)| {
            let mut model = plain();
            change(&mut model);
            !model.is_proper(dimensions)
        };
        assert!(spoilt(|model| model.errors[1][2][2] = 0.0) && spoilt(|model| model.differences[0][1] = f64::NAN));
        assert!(spoilt(|model| model.lights.clear()) && spoilt(|model| model.lights[0].covariance[0][0] = -1.0));
        assert!(spoilt(|model| model.mean_log_differences[0].clear()));
    }
}
