//! A Gaussian density whose mean and precision are a network's outputs.

/// Bound of the logarithms on the diagonal of the factor: densities neither narrower nor wider than `e^-4` to `e^4`.
const LARGEST: f32 = 4.0;

/// A Gaussian with precision `T' T`, `T` lower triangular with positive diagonal.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Gaussian {
    mean: Vec<f64>,
    /// `T`, row by row, lower triangle only.
    factor: Vec<f64>,
}

/// Outputs of a network that describe a density over so many dimensions: the mean, then the lower triangle of `T` row by row with the logarithm of its diagonal.
pub(super) fn outputs(dimensions: usize) -> usize {
    dimensions + dimensions * (dimensions + 1) / 2
}

impl Gaussian {
    /// From a network's outputs.
    pub(super) fn of(outputs: &[f32], dimensions: usize) -> Self {
        assert_eq!(outputs.len(), self::outputs(dimensions));
        let mut factor: Vec<f64> = outputs[dimensions..].iter().map(|v| f64::from(*v)).collect();
        for i in 0..dimensions {
            let at = diagonal(i);
            factor[at] = f64::from(outputs[dimensions + at].clamp(-LARGEST, LARGEST)).exp();
        }
        Self { mean: outputs[..dimensions].iter().map(|v| f64::from(*v)).collect(), factor }
    }

    /// `T (z - mean)`.
    fn whiten(&self, z: &[f64]) -> Vec<f64> {
        let gap: Vec<f64> = z.iter().zip(&self.mean).map(|(z, m)| z - m).collect();
        (0..gap.len()).map(|i| self.row(i).iter().zip(&gap).map(|(t, g)| t * g).sum()).collect()
    }

    fn row(&self, i: usize) -> &[f64] {
        &self.factor[i * (i + 1) / 2..][..=i]
    }

    /// Logarithm of the density, without the constant of the dimension.
    pub(super) fn log_density(&self, z: &[f64]) -> f64 {
        let square: f64 = self.whiten(z).iter().map(|r| r * r).sum();
        let log_determinant: f64 = (0..z.len()).map(|i| self.factor[diagonal(i)].ln()).sum();
        log_determinant - 0.5 * square
    }

    /// Mean of the density.
    #[cfg(test)]
    pub(super) fn mean(&self) -> &[f64] {
        &self.mean
    }
}

/// Place of a diagonal entry in the triangle.
fn diagonal(i: usize) -> usize {
    i * (i + 3) / 2
}

/// Minus the log density of `z`, and its gradient written over the outputs.
pub(super) fn loss(outputs: &mut [f32], z: &[f32]) -> f64 {
    let d = z.len();
    let gaussian = Gaussian::of(outputs, d);
    let z: Vec<f64> = z.iter().map(|v| f64::from(*v)).collect();
    let whitened = gaussian.whiten(&z);
    let value = -gaussian.log_density(&z);
    let mut mean = vec![0.0; d];
    for (i, r) in whitened.iter().enumerate() {
        let row = gaussian.row(i);
        for (j, t) in row.iter().enumerate() {
            mean[j] -= t * r;
            let gap = z[j] - gaussian.mean[j];
            let at = d + i * (i + 1) / 2 + j;
            outputs[at] = if i == j {
                // Outside of the bound the density does not follow.
                if outputs[at].abs() < LARGEST { (r * gap * t - 1.0) as f32 } else { 0.0 }
            } else {
                (r * gap) as f32
            };
        }
    }
    outputs[..d].iter_mut().zip(mean).for_each(|(out, m)| *out = m as f32);
    value
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_density_is_that_of_its_precision() {
        // T = [2 0; 1 3]: precision [5 3; 3 9], determinant 36.
        let gaussian = Gaussian::of(&[0.5, -1.0, 2.0_f32.ln(), 1.0, 3.0_f32.ln()], 2);
        let z = [1.0, 1.0];
        let (a, b) = (0.5, 2.0);
        let want = 0.5 * 36.0_f64.ln() - 0.5 * (5.0 * a * a + 6.0 * a * b + 9.0 * b * b);
        assert!((gaussian.log_density(&z) - want).abs() < 1e-6);
        assert_eq!(gaussian.mean(), [0.5, -1.0]);
    }

    #[test]
    fn the_gradient_is_that_of_the_loss() {
        let outputs: Vec<f32> = vec![0.3, -0.2, 0.9, 0.1, 0.4, -0.3, -0.7, 0.2, 0.05];
        let z = [0.1, 0.6, -0.4];
        let mut gradient = outputs.clone();
        loss(&mut gradient, &z);
        for i in 0..outputs.len() {
            let at = |step: f32| {
                let mut moved = outputs.clone();
                moved[i] += step;
                loss(&mut moved, &z)
            };
            let step = 1e-3;
            let numeric = (at(step) - at(-step)) / f64::from(2.0 * step);
            assert!(
                (numeric - f64::from(gradient[i])).abs() < 2e-3 * (1.0 + numeric.abs()),
                "{i} {numeric} {}",
                gradient[i]
            );
        }
    }
}
