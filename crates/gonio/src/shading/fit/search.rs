//! Least-squares problems of a fit.

use glam::DVec3;
use levenberg_marquardt::LeastSquaresProblem;
use nalgebra::{DMatrix, DVector, Dyn, Owned};

use super::{Fitter, LOG_FLOOR, logs};
use crate::shading::{Parameter, Shading};

/// Step of the finite differences, in the argument of the logistic function.
const DIFFERENCE_STEP: f64 = 1e-4;

/// Goal of a search.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Goal {
    /// Match the values of the table.
    Samples,
    /// Match the picture of a sphere in a studio light.
    Picture,
}

/// Parameters during a search. The free ones are limited to their ranges by a logistic function.
pub(super) struct Search<'a, S> {
    fitter: &'a Fitter,
    ranges: &'a [Parameter],
    goal: Goal,
    /// All parameters at the start.
    start: Vec<f64>,
    /// Indices of the free parameters.
    free: &'a [usize],
    /// Arguments of the logistic function, by free parameter.
    pub(super) at: DVector<f64>,
    model: std::marker::PhantomData<S>,
}

impl<'a, S: Shading> Search<'a, S> {
    pub(super) fn new(
        fitter: &'a Fitter,
        ranges: &'a [Parameter],
        start: &[f64],
        free: &'a [usize],
        goal: Goal,
    ) -> Self {
        let inverse = |&k: &usize| {
            let range = &ranges[k];
            let share = ((start[k] - range.low) / (range.high - range.low)).clamp(0.005, 0.995);
            (share / (1.0 - share)).ln()
        };
        let at = DVector::from_iterator(free.len(), free.iter().map(inverse));
        Self { fitter, ranges, goal, start: start.to_vec(), free, at, model: std::marker::PhantomData }
    }

    pub(super) fn parameters(&self) -> Vec<f64> {
        self.within(&self.at)
    }

    fn within(&self, at: &DVector<f64>) -> Vec<f64> {
        let mut parameters = self.start.clone();
        for (&k, x) in self.free.iter().zip(at.iter()) {
            let range = &self.ranges[k];
            parameters[k] = range.low + (range.high - range.low) / (1.0 + (-x).exp());
        }
        parameters
    }

    fn model(&self, at: &DVector<f64>) -> S {
        S::of(&self.within(at))
    }

    /// Appends the values of a model at the samples, as logarithms.
    fn append_samples(&self, model: &S, to: &mut Vec<f64>) {
        let eval = model.evaluator();
        for sample in self.fitter.samples.iter() {
            to.extend_from_slice(&logs(eval(sample.wi, sample.wo) * sample.wi.z, self.fitter.floor).to_array());
        }
    }

    pub(super) fn residuals_at(&self, at: &DVector<f64>) -> Vec<f64> {
        let model = self.model(at);
        match self.goal {
            Goal::Samples => {
                let mut values = Vec::with_capacity(3 * self.fitter.samples.len());
                self.append_samples(&model, &mut values);
                let wanted = self.fitter.samples.iter().flat_map(|sample| sample.logs.to_array());
                values.iter_mut().zip(wanted).for_each(|(value, wanted)| *value -= wanted);
                values
            }
            Goal::Picture => {
                let pixels = self.fitter.sketch.picture_of(&model).into_iter().zip(&self.fitter.compressed);
                pixels.flat_map(|(got, want)| (compressed(got, self.fitter.mean) - *want).to_array()).collect()
            }
        }
    }

    /// Returns the models a step from the current parameters, one for each free parameter.
    fn neighbours(&self) -> impl Iterator<Item = S> {
        (0..self.at.len()).map(|k| {
            let mut at = self.at.clone();
            at[k] += DIFFERENCE_STEP;
            self.model(&at)
        })
    }

    /// Derivatives of the values at the samples, one parameter after the other.
    fn slopes_of_samples(&self) -> Vec<f64> {
        let mut here = Vec::with_capacity(3 * self.fitter.samples.len());
        self.append_samples(&self.model(&self.at), &mut here);
        let mut slopes = Vec::with_capacity(here.len() * self.at.len());
        for model in self.neighbours() {
            let first = slopes.len();
            self.append_samples(&model, &mut slopes);
            let new = slopes[first..].iter_mut();
            new.zip(&here).for_each(|(there, here)| *there = (*there - here) / DIFFERENCE_STEP);
        }
        slopes
    }

    /// Derivatives of the compressed colours of the picture, one parameter after the other. The
    /// picture is linear in the values of the model.
    fn slopes_of_picture(&self) -> Vec<f64> {
        let (sketch, mean) = (&self.fitter.sketch, self.fitter.mean);
        let here = sketch.values(self.model(&self.at).evaluator());
        let of_values = |model: S| {
            let there = sketch.values(model.evaluator());
            there.iter().zip(&here).map(|(there, here)| (*there - *here) / DIFFERENCE_STEP).collect()
        };
        let of_values: Vec<Vec<DVec3>> = self.neighbours().map(of_values).collect();
        let inner = |colour: &DVec3| {
            let root = compressed(*colour, mean);
            (3.0 * mean * root * root).recip()
        };
        let inner: Vec<DVec3> = sketch.picture(here).iter().map(inner).collect();
        let of_pictures = sketch.unclamped_pictures(&of_values);
        let product = |(slope, inner): (&DVec3, &DVec3)| (*slope * *inner).to_array();
        of_pictures.iter().flat_map(|slopes| slopes.iter().zip(&inner).flat_map(product)).collect()
    }
}

/// Returns a colour of the picture as [`Goal::Picture`] compares it, given the mean of the picture.
///
/// The cube root is a compromise between the value, in which the peak dominates, and its logarithm,
/// in which the peak is a few pixels of many.
pub(super) fn compressed(colour: DVec3, mean: f64) -> DVec3 {
    DVec3::from_array(colour.to_array().map(|c| (c / mean + LOG_FLOOR).cbrt()))
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
        Some(DVector::from_vec(self.residuals_at(&self.at)))
    }

    fn jacobian(&self) -> Option<DMatrix<f64>> {
        let slopes = match self.goal {
            Goal::Samples => self.slopes_of_samples(),
            Goal::Picture => self.slopes_of_picture(),
        };
        Some(DMatrix::from_vec(slopes.len() / self.at.len(), self.at.len(), slopes))
    }
}
