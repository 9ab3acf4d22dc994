//! Newton's method in light, reflectance, exposure and noise at once.
//!
//! The image is bilinear: changes of reflectance and of light can explain the same pixels, so the
//! cost has a narrow valley. Alternating block updates advance slowly along the valley; a joint
//! step follows it.

use faer::Mat;
use gonio::lighting::Moments;
use gonio_linalg::eigenvectors;

use super::Problem;
use super::coordinate::{Point, ReflectanceSystem};
use super::ensemble::AllMoments;
use super::light_system::LightSystem;
use super::printed::search;

/// Smallest curvature that a step uses, relative to that of a single coordinate.
const MIN_CURVATURE: f64 = 1e-8;

/// Searches along Newton's direction for the lowest cost.
///
/// The light of `from` must be optimal for its reflectance. Returns `from` if no step lowers the
/// cost.
pub(super) fn advance(problem: &Problem<'_>, from: Point, light: &LightSystem, noise: bool) -> Point {
    let Point { moments, a, system, .. } = &from;
    let local = Local::new(problem, moments, (a, system), light, noise.then(|| problem.noise_shape()));
    let Some(step) = local.with_entropy(&from).step(light) else { return from };
    let Some(direction) = step.of_locations(&from) else { return from };
    let by = problem.bilinear.under_light(&step.light);
    let along = from.system.moved(problem, &from.a, &by);
    let start = from.ensemble.locations();
    let at = |alpha: f64| {
        let locations: Vec<f64> = start.iter().zip(&direction).map(|(x, d)| x + alpha * d).collect();
        let ensemble = from.ensemble.with_locations(&locations);
        let moments = ensemble.moments(problem);
        (ensemble, moments)
    };
    let cost = |alpha: f64| {
        let moments = at(alpha).1;
        let cost = along(alpha).sums(&moments.f).cost(problem, &moments);
        if cost.is_finite() { cost } else { f64::INFINITY }
    };
    match search(1.0, 64.0, from.cost(problem), cost) {
        Some(alpha) => {
            let (ensemble, moments) = at(alpha);
            let a = from.a.iter().zip(&by).map(|(a, d)| a + alpha * d).collect();
            Point { ensemble, moments, a, system: along(alpha) }
        }
        None => from,
    }
}

/// Step in reflectance (K), exposure and, if it is included, `Phi_5`; and in the light (M).
pub(super) struct Step {
    pub(super) rest: Vec<f64>,
    pub(super) light: Vec<f64>,
}

impl Step {
    /// Converts to a change of the [locations](super::VariationalParameters::locations); `None` if
    /// not finite.
    fn of_locations(&self, at: &Point) -> Option<Vec<f64>> {
        let AllMoments { f, g, .. } = &at.moments;
        // The mean of a rectified Gaussian moves by `var / w` times as much as its location.
        let natural = at.ensemble.natural();
        let moments = f.iter().chain([g]);
        let locations = |x: usize, variance: f64| self.rest[x] / (natural[x].1 * variance);
        let mut rest: Vec<f64> = moments.enumerate().map(|(x, m)| locations(x, m.variance)).collect();
        let exposure = rest.pop()?;
        let noise = self.rest.get(f.len() + 1).copied().unwrap_or(0.0);
        let all: Vec<f64> = rest.into_iter().chain(self.light[1..].iter().copied()).chain([exposure, noise]).collect();
        all.iter().all(|x| x.is_finite()).then_some(all)
    }
}

/// Gradient and curvature of a cost in the means of reflectance (K) and exposure and, if the noise
/// is included, in `Phi_5`.
pub(super) struct Local {
    gradient: Vec<f64>,
    curvature: Mat<f64>,
    /// Mixed curvature with the light (M x size), zero for light coefficients that stay fixed.
    cross: Mat<f64>,
}

impl Local {
    /// Builds the terms of image, priors and noise.
    ///
    /// The entropy of q is not included, as for point estimates. `shape` is the shape of the Gamma
    /// distribution of the noise. `a` is the image of each basis function under the light (rows x
    /// K), `system` the residual in the reflectance.
    pub(super) fn new(
        problem: &Problem<'_>,
        moments: &AllMoments,
        (a, system): (&[f64], &ReflectanceSystem),
        light: &LightSystem,
        shape: Option<f64>,
    ) -> Self {
        let k = problem.k();
        let AllMoments { f, l, g, precision } = moments;
        let (precision, g1, g2, means) = (*precision, g.mean, g.mean_square(), moments.f_means());
        let with_f: Vec<f64> = (0..k).map(|x| system.row(x).iter().zip(&means).map(|(h, f)| h * f).sum()).collect();
        let sums = system.sums(f);
        let size = k + 1 + usize::from(shape.is_some());
        let mut gradient = vec![0.0; size];
        let mut curvature = Mat::zeros(size, size);
        for x in 0..k {
            gradient[x] = precision * (g2 * with_f[x] - g1 * system.target()[x]) + problem.rates[x];
            for y in 0..k {
                curvature[(x, y)] = precision * g2 * system.row(x)[y];
            }
            curvature[(x, k)] = precision * (2.0 * g1 * with_f[x] - system.target()[x]);
        }
        let of_g = precision * (sums.q * g1 - sums.iy);
        gradient[k] = of_g + problem.hyper.exposure_rate;
        curvature[(k, k)] = precision * sums.q;
        if let Some(shape) = shape {
            let left = precision * (problem.hyper.noise_rate + 0.5 * sums.residual(problem, g));
            gradient[k + 1] = shape - left;
            curvature[(k + 1, k + 1)] = left;
            for x in 0..k {
                curvature[(x, k + 1)] = precision * (g1 * system.target()[x] - g2 * with_f[x]);
            }
            curvature[(k, k + 1)] = -of_g;
        }
        for x in 0..size {
            for y in 0..x {
                curvature[(x, y)] = curvature[(y, x)];
            }
        }

        let weights = a.chunks_exact(k).zip(&problem.target).map(|(a, i)| {
            let y: f64 = a.iter().zip(&means).map(|(a, f)| a * f).sum();
            precision * (g2 * y - g1 * i)
        });
        let pulled = problem.bilinear.adjoint(&weights.collect::<Vec<_>>());
        let images = light.images(a, k, precision * g2);
        let cross = Mat::from_fn(l.len(), size, |m, x| {
            if light.is_excluded(m) {
                return 0.0;
            }
            // At the optimum of the light, image and prior together balance its target.
            let (prior, target) = light.balance(problem, m, l[m].mean);
            match x {
                x if x < k => pulled[x * l.len() + m] + images[(m, x)],
                x if x == k => 2.0 * (g1 / g2) * (target - prior) - target / g1,
                _ => prior,
            }
        });
        Self { gradient, curvature, cross }
    }

    /// Adds the entropy of rectified Gaussians of given `w`: its curvature in their means is
    /// `1 / var` minus the contribution of the image through `<x^2>`.
    fn with_entropy(mut self, at: &Point) -> Self {
        let AllMoments { f, g, .. } = &at.moments;
        for (x, ((u, p), m)) in at.ensemble.natural().into_iter().zip(f.iter().chain([g])).enumerate() {
            self.gradient[x] += u - p * m.mean;
            // The image's curvature differs from `p` where a variance is not yet optimal.
            let all = 1.0 / m.variance + self.curvature[(x, x)] - p;
            self.curvature[(x, x)] = all.max(1e-3 / m.variance);
        }
        self
    }

    /// Fixes the reflectances that are at zero and would become negative.
    pub(super) fn without_negative(mut self, f: &[Moments]) -> Self {
        for x in (0..f.len()).filter(|&x| f[x].mean <= 0.0) {
            if self.gradient[x] < 0.0 {
                continue;
            }
            self.gradient[x] = 0.0;
            self.curvature.row_mut(x).fill(0.0);
            self.curvature.col_mut(x).fill(0.0);
            self.curvature[(x, x)] = 1.0;
            self.cross.col_mut(x).fill(0.0);
        }
        self
    }

    /// Computes Newton's step, with the light eliminated: the curvature `C` of the light and the
    /// mixed curvature `X` subtract `X' C^-1 X` from the curvature of the rest. Negative
    /// eigenvalues of the result are used with reversed sign. Returns `None` if `C` has no factor.
    pub(super) fn step(&self, light: &LightSystem) -> Option<Step> {
        let solved = light.factor()?.solve_all(&self.cross);
        let size = self.gradient.len();
        let product =
            |x: usize, y: usize| self.cross.col(x).iter().zip(solved.col(y).iter()).map(|(c, s)| c * s).sum::<f64>();
        let reduced = |x: usize, y: usize| self.curvature[(x, y)] - 0.5 * (product(x, y) + product(y, x));
        let unit: Vec<f64> = (0..size).map(|x| self.curvature[(x, x)].max(f64::MIN_POSITIVE).sqrt().recip()).collect();
        let scaled = Mat::from_fn(size, size, |x, y| reduced(x, y) * unit[x] * unit[y]);
        if !scaled.is_all_finite() {
            return None;
        }
        let (values, vectors) = eigenvectors(scaled.as_ref());
        let mut rest = vec![0.0; size];
        for (value, vector) in values.iter().zip(vectors.col_iter()) {
            let along: f64 = (0..size).map(|x| vector[x] * self.gradient[x] * unit[x]).sum();
            let length = -along / value.abs().max(MIN_CURVATURE);
            (0..size).for_each(|x| rest[x] += length * vector[x] * unit[x]);
        }
        let along = |m: usize| -(0..size).map(|x| solved[(m, x)] * rest[x]).sum::<f64>();
        let light: Vec<f64> = (0..solved.nrows()).map(along).collect();
        Some(Step { rest, light })
    }
}

#[cfg(test)]
mod tests {
    use super::super::grams::Grams;
    use super::super::tests::{planted, start};
    use super::super::{VariationalParameters, coordinate};
    use super::*;

    fn converged(problem: &Problem<'_>, mut ensemble: VariationalParameters, grams: &Grams) -> (Point, LightSystem) {
        for _ in 0..20 {
            ensemble = coordinate::minimise_light(problem, &ensemble, grams).0;
        }
        let light = LightSystem::new(problem, &ensemble.moments(problem), grams);
        (Point::new(problem, ensemble, grams), light)
    }

    /// Indices of the unknowns of [`Local`] among the locations.
    fn places(problem: &Problem<'_>) -> Vec<usize> {
        let (k, m) = (problem.k(), problem.m());
        (0..k).chain([k + m - 1, k + m]).collect()
    }

    #[test]
    fn gradient_matches_finite_differences_of_the_cost() {
        let planted = planted(60, 3, 0.05, 4);
        let problem = planted.problem();
        let grams = Grams::new(&problem);
        // The means are arbitrary; the gradient is exact where the variances are optimal.
        let mut ensemble = start(&planted, 4);
        for _ in 0..100 {
            let (point, _) = converged(&problem, ensemble, &grams);
            ensemble = point.ensemble;
            let AllMoments { g, precision, .. } = point.moments;
            for (k, diagonal) in point.system.diagonal().into_iter().enumerate() {
                let p = precision * g.mean_square() * diagonal;
                ensemble.set_f(k, (0.2 + 0.3 * k as f64) * p, p);
            }
            let p = precision * point.system.sums(&ensemble.moments(&problem).f).q;
            ensemble.set_g(1.1 * p, p);
        }
        let (point, light) = converged(&problem, ensemble, &grams);
        let Point { moments, a, system, .. } = &point;
        let local = Local::new(&problem, moments, (a, system), &light, Some(problem.noise_shape()));
        let local = local.with_entropy(&point);
        let natural = point.ensemble.natural();
        let AllMoments { f, g, .. } = &point.moments;
        for (x, place) in places(&problem).into_iter().enumerate() {
            let cost = |step: f64| {
                let mut locations = point.ensemble.locations();
                locations[place] += step;
                Point::new(&problem, point.ensemble.with_locations(&locations), &grams).cost(&problem)
            };
            let h = 1e-5;
            let by_difference = (cost(h) - cost(-h)) / (2.0 * h);
            let of_location = match x {
                x if x < f.len() => natural[x].1 * f[x].variance,
                x if x == f.len() => natural[x].1 * g.variance,
                _ => 1.0,
            };
            let by_hand = local.gradient[x] * of_location;
            let error = (by_hand - by_difference).abs();
            assert!(error < 1e-5 * by_difference.abs().max(1.0), "{x}: {by_hand} against {by_difference}");
        }
    }

    #[test]
    fn a_step_near_the_minimum_removes_most_of_the_excess_cost() {
        for seed in 1..6 {
            let planted = planted(80, 3, 0.05, seed);
            let problem = planted.problem();
            let grams = Grams::new(&problem);
            let mut ensemble = start(&planted, seed);
            let mut least = f64::INFINITY;
            for _ in 0..500 {
                (ensemble, least) = coordinate::round(&problem, &ensemble, &grams, true);
            }
            let mut locations = ensemble.locations();
            let places = places(&problem);
            for (x, &place) in places.iter().enumerate() {
                locations[place] *= 1.0 + 1e-3 * (x as f64 - 1.7);
            }
            let (point, light) = converged(&problem, ensemble.with_locations(&locations), &grams);
            let before = point.cost(&problem) - least;
            let after = advance(&problem, point, &light, true).cost(&problem) - least;
            assert!(before > 1e-2 && after < 0.1 * before, "{seed}: from {before} to {after} nats above the end");
        }
    }
}
