//! Least-squares problems of a fit.

use glam::DVec3;
use levenberg_marquardt::LeastSquaresProblem;
use nalgebra::{DMatrix, DVector, Dyn, Owned};

use super::{Fitter, LOG_FLOOR, Sample, logs};
use crate::shading::Shading;

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
    pub(super) fn new(fitter: &'a Fitter, start: &[f64], free: &'a [usize], goal: Goal) -> Self {
        let inverse = |&k: &usize| {
            let range = &S::PARAMETERS[k];
            let share = ((start[k] - range.low) / (range.high - range.low)).clamp(0.005, 0.995);
            (share / (1.0 - share)).ln()
        };
        let at = DVector::from_iterator(free.len(), free.iter().map(inverse));
        Self { fitter, goal, start: start.to_vec(), free, at, model: std::marker::PhantomData }
    }

    pub(super) fn parameters(&self) -> Vec<f64> {
        self.within(&self.at)
    }

    fn within(&self, at: &DVector<f64>) -> Vec<f64> {
        let mut parameters = self.start.clone();
        for (&k, x) in self.free.iter().zip(at.iter()) {
            let range = &S::PARAMETERS[k];
            parameters[k] = range.low + (range.high - range.low) / (1.0 + (-x).exp());
        }
        parameters
    }

    pub(super) fn off(&self, at: &DVector<f64>) -> Vec<f64> {
        let model = S::of(&self.within(at));
        if self.goal == Goal::Picture {
            let shown = self.fitter.sketch.picture_of(&model);
            let mean = self.fitter.mean();
            // The cube root is a compromise between the value, in which the peak dominates, and its
            // logarithm, in which the peak is a few pixels of many.
            let bright = |c: DVec3| c.to_array().map(|c| (c / mean + LOG_FLOOR).cbrt());
            let pixels = shown.iter().zip(&self.fitter.sketched);
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
            at[k] += DIFFERENCE_STEP;
            columns.extend(self.off(&at).iter().zip(&here).map(|(there, here)| (there - here) / DIFFERENCE_STEP));
        }
        Some(DMatrix::from_vec(columns.len() / self.at.len(), self.at.len(), columns))
    }
}
