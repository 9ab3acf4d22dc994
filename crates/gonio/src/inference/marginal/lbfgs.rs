//! Directions of ascent from the last few steps: limited-memory BFGS (Nocedal 1980).

use std::collections::VecDeque;

use crate::transfer::kernels::dot;

/// Steps and changes of the gradient that are remembered.
pub(super) struct Memory {
    pairs: VecDeque<(Vec<f64>, Vec<f64>)>,
}

/// How many pairs are kept.
const KEPT: usize = 12;

impl Memory {
    pub(super) fn new() -> Self {
        Self { pairs: VecDeque::new() }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.pairs.is_empty()
    }

    pub(super) fn forget(&mut self) {
        self.pairs.clear();
    }

    /// Remembers a step along which the gradient of the objective changed by `change`, if it says
    /// something of the curvature of a concave function.
    pub(super) fn learn(&mut self, step: Vec<f64>, change: Vec<f64>) {
        let fall: Vec<f64> = change.into_iter().map(|x| -x).collect();
        if dot(&step, &fall) > 1e-10 * (dot(&step, &step) * dot(&fall, &fall)).sqrt() {
            self.pairs.push_back((step, fall));
            if self.pairs.len() > KEPT {
                self.pairs.pop_front();
            }
        }
    }

    /// The quasi-Newton direction of ascent for a gradient; the gradient itself as long as nothing
    /// is known.
    pub(super) fn direction(&self, gradient: &[f64]) -> Vec<f64> {
        let mut d = gradient.to_vec();
        let mut weights = Vec::with_capacity(self.pairs.len());
        for (s, y) in self.pairs.iter().rev() {
            let weight = dot(s, &d) / dot(s, y);
            d.iter_mut().zip(y).for_each(|(d, y)| *d -= weight * y);
            weights.push(weight);
        }
        if let Some((s, y)) = self.pairs.back() {
            let scale = dot(s, y) / dot(y, y);
            d.iter_mut().for_each(|d| *d *= scale);
        }
        for ((s, y), weight) in self.pairs.iter().zip(weights.into_iter().rev()) {
            let correction = weight - dot(y, &d) / dot(s, y);
            d.iter_mut().zip(s).for_each(|(d, s)| *d += correction * s);
        }
        d
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quadratic_is_climbed_in_few_steps() {
        // -x'Hx/2 + c'x with eigenvalues over four decades.
        let n = 8;
        let stiff: Vec<f64> = (0..n).map(|i| 10.0_f64.powf(0.5 * i as f64)).collect();
        let gradient = |x: &[f64]| -> Vec<f64> { x.iter().zip(&stiff).map(|(x, h)| h * (1.0 - x)).collect() };
        let mut memory = Memory::new();
        let mut x = vec![0.0; n];
        for _ in 0..40 {
            let g = gradient(&x);
            let d = memory.direction(&g);
            assert!(dot(&g, &d) >= 0.0);
            // Exact line search.
            let curvature: f64 = d.iter().zip(&stiff).map(|(d, h)| h * d * d).sum();
            if curvature < 1e-28 {
                break;
            }
            let alpha = dot(&g, &d) / curvature;
            let step: Vec<f64> = d.iter().map(|d| alpha * d).collect();
            x.iter_mut().zip(&step).for_each(|(x, s)| *x += s);
            let change = gradient(&x).iter().zip(&g).map(|(a, b)| a - b).collect();
            memory.learn(step, change);
        }
        assert!(x.iter().all(|x| (x - 1.0).abs() < 1e-8), "{x:?}");
    }
}
