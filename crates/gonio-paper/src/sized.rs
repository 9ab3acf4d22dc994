//! Algorithm 1 on lights whose finest scale the image does not determine, up to the real size of 32
//! x 32 texels.

use gonio::inference::Hyperparameters;
use gonio::lighting::LightPrior;
use gonio::transfer::TransferSettings;
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};

use super::component_switch::coordinate_objectives;
use super::variational::end;
use super::*;
use crate::testing::{sphere_points, toy_prior, toy_sky, toy_tables};

/// Image of a sphere with a diffuse part and two lobes under a sky outside the training data of the
/// prior, with noise of 1 % of the root mean square.
fn sphere(side: usize, prior: &LightPrior) -> Projected {
    let (points, tables) = (sphere_points(7 * side * side / 10), toy_tables());
    let settings = TransferSettings::of_side(side);
    let project =
        |image: &[Option<f64>]| Projected::unprojected(&points, image, &tables, prior, &settings).expect("a sphere");
    let mut rng = rand_pcg::Pcg64::seed_from_u64(77);
    let light = toy_sky(side, &mut rng).normalised_coefficients().expect("not black");
    let clean = project(&vec![Some(1.0); points.len()]).bilinear.apply(&light, &[0.5, 0.2, 0.3]);
    let rms = (clean.iter().map(|y| y * y).sum::<f64>() / clean.len() as f64).sqrt();
    let mut noisy = |y: f64| {
        let z: f64 = StandardNormal.sample(&mut rng);
        Some(y + 0.01 * rms * z)
    };
    project(&clean.into_iter().map(&mut noisy).collect::<Vec<_>>())
}

fn problem<'a>(image: &'a Projected, prior: &'a LightPrior) -> Problem<'a> {
    Problem::blind(image, prior, &[1.0; 3], Hyperparameters::with_model_error(image.pixels)).expect("an image")
}

#[test]
fn result_is_independent_of_starting_variance_and_tolerance() {
    let prior = toy_prior(32);
    let image = sphere(32, &prior);
    let problem = problem(&image, &prior);
    let at = |variance, tolerance| {
        let settings = VariationalSettings { variance, tolerance, max_iterations: 20_000, ..Default::default() };
        end(&problem, &settings)
    };
    let tight = at(0.1, 1e-5).1;
    for variance in [0.1, 1e-3, 1e-5] {
        let (ensemble, cost, iterations) = at(variance, 1e-4);
        assert!((cost - tight).abs() < 2.0, "{variance}: {cost} against {tight} in {iterations}");
        let now = Expectations::new(&problem, &ensemble);
        for (m, alone) in coordinate_objectives(&problem, &now) {
            let gain = alone.gain(&now.moments.l[m]);
            assert!(gain < 1e-2, "{variance}: coefficient {m} would gain {gain} in another component");
        }
    }
}
