//! Gradient descent.

use std::ops::Range;

/// AdamW (Loshchilov & Hutter 2019) with a bound on the norm of the gradient, and a moving average
/// of the values.
pub(crate) struct Optimiser {
    mean: Vec<f32>,
    square: Vec<f32>,
    average: Vec<f32>,
    steps: i32,
}

/// Settings of one step.
pub(crate) struct StepSettings {
    /// Learning rate of this step.
    pub(crate) rate: f32,
    /// Weight decay: each step reduces the weights by this share times the rate.
    pub(crate) decay: f32,
    /// Largest norm of a gradient; longer gradients are scaled down to it.
    pub(crate) max_gradient_norm: f64,
    /// Share of the moving average that is kept.
    pub(crate) ema_decay: f32,
}

impl Optimiser {
    pub(crate) fn new(values: &[f32]) -> Self {
        let zeros = vec![0.0; values.len()];
        Self { mean: zeros.clone(), square: zeros, average: values.to_vec(), steps: 0 }
    }

    /// Restores the optimiser after some steps from the result of [`Self::moments`].
    pub(crate) fn resume([mean, square, average]: [Vec<f32>; 3], steps: usize) -> Self {
        Self { mean, square, average, steps: steps as i32 }
    }

    /// Moving averages of the gradient, of its square, and of the values.
    pub(crate) fn moments(&self) -> [Vec<f32>; 3] {
        [&self.mean, &self.square, &self.average].map(Clone::clone)
    }

    /// The moving average of the values over the steps so far.
    pub(crate) fn average(&self) -> &[f32] {
        &self.average
    }

    /// Updates the values. Those in the ranges of `decaying` also decay.
    pub(crate) fn step(
        &mut self,
        values: &mut [f32],
        gradient: &[f32],
        decaying: impl Iterator<Item = Range<usize>>,
        settings: &StepSettings,
    ) {
        const MEAN: f32 = 0.9;
        const SQUARE: f32 = 0.999;
        self.steps += 1;
        let norm = gradient.iter().map(|g| f64::from(*g).powi(2)).sum::<f64>().sqrt();
        let scale = if norm > settings.max_gradient_norm { (settings.max_gradient_norm / norm) as f32 } else { 1.0 };
        let (first, second) = (1.0 - MEAN.powi(self.steps), 1.0 - SQUARE.powi(self.steps));
        for range in decaying {
            values[range].iter_mut().for_each(|v| *v *= 1.0 - settings.rate * settings.decay);
        }
        // Excludes the start of a short run from its average.
        let keep = settings.ema_decay.min((1 + self.steps) as f32 / (10 + self.steps) as f32);
        let moments = self.mean.iter_mut().zip(&mut self.square).zip(&mut self.average);
        for ((value, gradient), ((mean, square), average)) in values.iter_mut().zip(gradient).zip(moments) {
            let g = scale * gradient;
            *mean = MEAN * *mean + (1.0 - MEAN) * g;
            *square = SQUARE * *square + (1.0 - SQUARE) * g * g;
            *value -= settings.rate * (*mean / first) / ((*square / second).sqrt() + 1e-8);
            *average = keep * *average + (1.0 - keep) * *value;
        }
    }
}

/// Returns the learning rate at a share of the steps, relative to the largest rate, by the
/// one-cycle schedule. The rate rises over three tenths of the steps and falls over the rest, both
/// along a cosine (Smith & Topin 2019).
pub(crate) fn one_cycle(at: f64) -> f64 {
    let cosine = |from: f64, to: f64, t: f64| to + 0.5 * (from - to) * (1.0 + (std::f64::consts::PI * t).cos());
    if at < 0.3 { cosine(0.04, 1.0, at / 0.3) } else { cosine(1.0, 1e-5, (at - 0.3) / 0.7) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_and_their_average_converge_to_the_minimum() {
        let mut values = vec![3.0, -2.0, 8.0];
        let mut optimiser = Optimiser::new(&values);
        let steps = 800;
        for step in 0..steps {
            let gradient: Vec<f32> = values.iter().zip([1.0, 10.0, 0.1]).map(|(v, a)| a * (v - 1.0)).collect();
            let rate = 0.1 * one_cycle(f64::from(step) / f64::from(steps)) as f32;
            let settings = StepSettings { rate, decay: 0.0, max_gradient_norm: 5.0, ema_decay: 0.95 };
            optimiser.step(&mut values, &gradient, std::iter::empty(), &settings);
        }
        assert!(values.iter().chain(optimiser.average()).all(|v| (v - 1.0).abs() < 0.02), "{values:?}");
    }

    #[test]
    fn without_a_gradient_only_decaying_values_shrink() {
        let mut values = vec![1.0; 3];
        let mut optimiser = Optimiser::new(&values);
        let settings = StepSettings { rate: 0.5, decay: 0.2, max_gradient_norm: 5.0, ema_decay: 0.9 };
        optimiser.step(&mut values, &[0.0; 3], std::iter::once(1..2), &settings);
        assert_eq!(values, [1.0, 0.9, 1.0]);
    }
}
