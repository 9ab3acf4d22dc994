use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;

use super::*;
use crate::inference::known_light::tests::under;
use crate::inference::learnt::tests::{WORLD, environment_map};
use crate::testing::ball;

fn normals(count: usize, deviation: f64, seed: u64) -> Vec<f64> {
    let mut rng = Pcg64::seed_from_u64(seed);
    (0..count).map(|_| deviation * Distribution::<f64>::sample(&StandardNormal, &mut rng)).collect()
}

fn moved(x: &[f64], along: &[f64], by: f64) -> Vec<f64> {
    x.iter().zip(along).map(|(x, d)| x + by * d).collect()
}

/// Compares the derivatives of the image, the gradient, and the curvature at an exact fit with
/// finite differences along random directions.
#[test]
fn derivatives_agree_with_finite_differences() {
    let points = ball(60);
    let operator = under(&points, &environment_map(3));
    let space = ParameterSpace::new(&WORLD.latent_space);
    let size = space.len() + usize::from(operator.clips());
    let mut truth = space.at(&WORLD.coordinates[2]);
    truth.resize(size, 1.0);
    let truth = moved(&truth, &normals(size, 0.1, 1), 1.0);
    let values = operator.apply(&space.values(&truth), truth[space.len()].exp());
    let image = ImageModel::new(&operator, &values, &space, FitPrior::MATERIAL);
    let normals_of_points: Vec<_> = points.iter().map(|p| p.in_view()).collect();
    let covariance = ErrorModel::new(&normals_of_points, vec![1.0; points.len()], 0.045).factor().unwrap();
    let elsewhere = image.state(moved(&truth, &normals(size, 0.05, 2), 1.0));
    let derivatives = image.all_derivatives(&elsewhere);
    let (_, gradient) = image.equations(&elsewhere, derivatives.clone(), &covariance);
    let exact = image.state(truth.clone());
    let (normal, _) = image.equations(&exact, image.all_derivatives(&exact), &covariance);
    for seed in 3..8 {
        let along = normals(size, 1.0, seed);
        let at = |x: &[f64], h: f64| image.state(moved(x, &along, h));
        let cost = |x: &[f64], h: f64| image.cost(&at(x, h), &covariance);

        let h = 1e-4;
        let (next, last) = (at(&elsewhere.coefficients, h), at(&elsewhere.coefficients, -h));
        for i in 0..points.len() {
            let slope = (last.residuals[i] - next.residuals[i]) / (2.0 * h);
            let found: f64 = derivatives.row(i).iter().zip(&along).map(|(a, b)| a * b).sum();
            assert!((slope - found).abs() < 1e-5 * (1.0 + slope.abs()), "{slope} {found}");
        }
        let slope = (cost(&elsewhere.coefficients, h) - cost(&elsewhere.coefficients, -h)) / (2.0 * h);
        let found: f64 = gradient.iter().zip(&along).map(|(g, d)| -g * d).sum();
        assert!((slope - found).abs() < 1e-4 * (1.0 + slope.abs()), "{slope} {found}");

        let h = 1e-3;
        let second = (cost(&truth, h) - 2.0 * cost(&truth, 0.0) + cost(&truth, -h)) / (h * h);
        let of_likelihood: f64 = (0..along.len())
            .map(|i| along[i] * normal.row(i).iter().zip(&along).map(|(n, d)| n * d).sum::<f64>())
            .sum();
        let of_prior: f64 = image.precisions.iter().zip(&along).map(|(p, d)| p * d * d).sum();
        let found = of_likelihood + of_prior;
        assert!((second / found - 1.0).abs() < 1e-3, "{second} {found}");
    }
}

/// Every step of a round lowers the cost, and the last round converges.
#[test]
fn the_cost_never_rises() {
    let points = ball(150);
    let operator = under(&points, &environment_map(3));
    let space = ParameterSpace::new(&WORLD.latent_space);
    let noise = normals(points.len(), 0.05, 9);
    let truth: Vec<f64> = WORLD.table(&WORLD.entries[1]).as_slice().iter().map(|v| f64::from(*v)).collect();
    let clean = operator.apply(&truth, 1.0);
    let values: Vec<f64> = clean.iter().zip(&noise).map(|(v, n)| v * n.exp()).collect();
    let mut image = ImageModel::new(&operator, &values, &space, FitPrior::MATERIAL);
    let start = image.start(&WORLD.coordinates[4], 1.0);
    let normals_of_points: Vec<_> = points.iter().map(|p| p.in_view()).collect();
    let found = image.fit(start, ErrorModel::new(&normals_of_points, vec![1.0; points.len()], 0.045)).unwrap();
    assert!(found.converged && found.trace.len() == ROUNDS);
    for costs in &found.trace {
        assert!(costs.windows(2).all(|pair| pair[1] < pair[0]), "{costs:?}");
    }
    assert!(found.trace[0].len() > 2, "{:?}", found.trace);
}
