//! The channels of a material under a known light, given its luminance.
//!
//! Each channel `F_c` is estimated from the channel `I_c` of the photograph under the same channel
//! of the light, like the luminance. Its logarithm varies around that of the luminance `F` along
//! the axes by which channels of measured materials differ ([`ColourModel`]), so undetermined cells
//! have typical differences between channels.
//!
//! Most of the residual of the luminance, from wrong normals, shadows and an inexact light, is
//! common to all channels. Before the fit, each channel is therefore divided by this residual,
//! which leaves the error of the colours.

use glam::DVec3;
use rand::SeedableRng;
use rand_distr::{ChiSquared, Distribution, StandardNormal};
use rand_pcg::Pcg64;

use super::fit::{FitPrior, ImageModel, LaplaceFit};
use super::light::{KnownLight, Operator};
use super::space::ParameterSpace;
use super::{KnownLightError, KnownLightPosterior, ObservedPoints, PriorMaterials, relative_rms, thinned};
use crate::colour::{ChromaField, ColourModel, DRAW_FREEDOM, DRAW_INFLATION};
use crate::parallel;
use crate::reflectance::BivariateTable;

/// Largest number of observations for the channels. Colours vary more slowly than luminance.
const CHANNEL_ROWS: usize = 500;

/// Share of the mean luminance that is added to values before the division by residuals, since
/// camera noise dominates dark pixels.
const RESIDUAL_FLOOR: f64 = 0.01;

/// Prior of the differences of channels and of the errors of colours.
const CHANNEL: FitPrior = FitPrior {
    deviation: 0.1,
    deviations: (0.03, 2.0),
    axis_deviations: (0.2, 10.0),
    constant_precision: 0.1,
    min_discrepancy: 0.01,
};

/// Relative root mean square change of the image's luminance by the colours above which the
/// luminance is re-estimated. Cameras are accurate to about one percent.
const COLOUR_CHANGE: f64 = 0.01;

/// Posterior of the three channels of a material relative to its luminance.
#[derive(Clone, Debug)]
pub struct ChannelPosterior {
    space: ParameterSpace,
    fits: Vec<LaplaceFit>,
    /// Root mean square residual of each channel, relative to the photograph.
    pub misfit: [f64; 3],
}

/// Colour observations under a given light.
struct ColouredRows<'a> {
    rows: &'a ObservedPoints<'a>,
    colours: &'a [DVec3],
    operators: [Operator; 3],
    /// Axes of the differences of channels.
    axes: Vec<Vec<f32>>,
}

impl KnownLightPosterior {
    /// Estimates the channels, and returns them with the re-estimated luminance.
    ///
    /// `colours` are the linear RGB values of the rows, and `light` is that of the luminance
    /// estimate. If light and material are both coloured, the luminance of the image differs from
    /// that of a grey material in grey light.
    ///
    /// # Errors
    /// If a channel of the light or of the photograph is black, or the equations have no solution.
    ///
    /// # Panics
    /// If the numbers of rows differ.
    pub fn with_channels(
        self,
        rows: &ObservedPoints<'_>,
        colours: &[DVec3],
        light: &KnownLight,
        materials: &PriorMaterials<'_>,
        prior: &ColourModel,
    ) -> Result<(Self, ChannelPosterior), KnownLightError> {
        assert!(colours.len() == rows.values.len() && colours.len() == self.predicted.len());
        let gain = self.gain.map_or(1.0, |(gain, _)| gain);
        let light = light.clone().rotated(self.rotation);
        let operators = Operator::of_channels(rows.points, rows.visibility, (&light, gain), materials);
        let all = ColouredRows { rows, colours, operators, axes: prior.axes(materials.coordinates()) };
        let channels = all.channels(&self.table(), &self.predicted)?;
        let whole = Operator::of_colours(&all.operators, &channels.field());
        let coloured = whole.apply(&self.space.values(&self.coefficients), 1.0);
        if relative_rms(&self.predicted, &coloured) < COLOUR_CHANGE {
            return Ok((self, channels));
        }
        let mut image = ImageModel::of(&whole, rows, &self.space, FitPrior::MATERIAL)?;
        let state = image.state(self.coefficients[..self.space.len()].to_vec());
        let fit = image.fit_to(rows, state)?;
        let anew = Self { gain: self.gain, ..Self::found(&image, fit, rows, &self.space, self.rotation) };
        let channels = all.channels(&anew.table(), &anew.predicted)?;
        Ok((anew, channels))
    }
}

impl ColouredRows<'_> {
    /// Estimates the channels around a luminance table with the image `predicted`.
    fn channels(&self, table: &BivariateTable, predicted: &[f64]) -> Result<ChannelPosterior, KnownLightError> {
        let Self { rows, colours, operators, axes } = self;
        let total = colours.len();
        let some = thinned(total, CHANNEL_ROWS);
        let points: Vec<_> = some.iter().map(|&at| rows.points[at]).collect();
        let visibility = rows.visibility.map(|visibility| visibility.select(&some));
        let trust: Vec<f64> = some.iter().map(|&at| rows.weights[at]).collect();
        let mean: Vec<f32> = table.as_slice().iter().map(|value| value.max(1e-12).ln()).collect();
        let space = ParameterSpace::around(&mean, axes);
        let floor = RESIDUAL_FLOOR * rows.values.iter().sum::<f64>() / total as f64;
        let common = |at: usize| (predicted[at] + floor) / (rows.values[at] + floor);
        let one = |c: usize| -> Result<(LaplaceFit, f64), KnownLightError> {
            let operator = operators[c].select(&some);
            let values: Vec<f64> = some.iter().map(|&at| colours[at][c].max(0.0) * common(at)).collect();
            let rows =
                ObservedPoints { points: &points, visibility: visibility.as_ref(), values: &values, weights: &trust };
            let mut image = ImageModel::of(&operator, &rows, &space, CHANNEL)?;
            let state = image.start(&vec![0.0; space.dimensions], 1.0);
            let fit = image.fit_to(&rows, state)?;
            let misfit = relative_rms(&values, &fit.state.predicted);
            Ok((fit, misfit))
        };
        let found: Vec<(LaplaceFit, f64)> = parallel::map_range(3, one).into_iter().collect::<Result<_, _>>()?;
        let misfit = [found[0].1, found[1].1, found[2].1];
        Ok(ChannelPosterior { space, fits: found.into_iter().map(|(fit, _)| fit).collect(), misfit })
    }
}

impl ChannelPosterior {
    /// Returns the most probable chroma of every cell.
    pub fn field(&self) -> ChromaField {
        self.at(|fit, _| fit.state.coefficients.clone())
    }

    /// Draws chromas of every cell; the same seed gives the same draws.
    pub fn draws(&self, count: usize, seed: u64) -> Vec<ChromaField> {
        let mut rng = Pcg64::seed_from_u64(seed);
        let size = self.space.len();
        let spread = ChiSquared::new(DRAW_FREEDOM).expect("the degrees of freedom are positive");
        let mut white = || -> [Vec<f64>; 3] {
            let scale: f64 = DRAW_INFLATION * (DRAW_FREEDOM / spread.sample(&mut rng)).sqrt();
            let mut normal = || scale * Distribution::<f64>::sample(&StandardNormal, &mut rng);
            std::array::from_fn(|_| (0..size).map(|_| normal()).collect())
        };
        let white: Vec<[Vec<f64>; 3]> = (0..count).map(|_| white()).collect();
        let draw = |white: &[Vec<f64>; 3]| {
            self.at(|fit, c| {
                let step = fit.curvature.colour(&white[c]);
                fit.state.coefficients.iter().zip(step).map(|(x, step)| x + step).collect()
            })
        };
        parallel::map(&white, draw)
    }

    fn at(&self, coefficients: impl Fn(&LaplaceFit, usize) -> Vec<f64>) -> ChromaField {
        ChromaField::of_logs(std::array::from_fn(|c| {
            let change = self.space.change(&coefficients(&self.fits[c], c));
            change.into_iter().map(|log| log as f32).collect()
        }))
    }
}
