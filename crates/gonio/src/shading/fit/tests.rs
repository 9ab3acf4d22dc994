use levenberg_marquardt::LeastSquaresProblem;

use super::super::{ColourCookTorrance, ColourWard, MetallicRoughness, Principled};
use super::*;

/// Fits a model to its own table.
fn found_again<S: Shading>(parameters: &[f64], log: f64) -> S {
    let tables = S::of(parameters).to_bivariate(FINE_AZIMUTHS);
    let found = Fitter::new(&tables).fit::<S>();
    assert!(found.log_relight < log, "{} {}", found.relight, found.log_relight);
    found.model
}

#[test]
fn recovers_metallic_roughness() {
    let got: MetallicRoughness = found_again(&[0.5, 0.2, 0.1, 0.05, 0.35, 1.5, 1.0, 1.0, 1.0, 0.0, 0.02], 0.01);
    assert!((got.roughness - 0.35).abs() < 0.01 && (got.base_color.x - 0.5).abs() < 0.02, "{got:?}");
    // Neither a coat nor a tint improves the fit.
    assert!(got.clearcoat == 0.0 && got.specular_color == DVec3::ONE, "{got:?}");
}

#[test]
fn recovers_a_layered_metal() {
    let got: Layered = found_again(&[0.9, 0.6, 0.3, 1.0, 0.25, 1.5, 1.0, 1.0, 1.0, 0.0, 0.02], 0.02);
    assert!((got.roughness - 0.25).abs() < 0.01 && got.metalness > 0.9, "{got:?}");
}

#[test]
fn recovers_a_principled_body() {
    let got: Principled = found_again(&[0.2, 0.3, 0.6, 0.0, 0.4, 1.5, 0.0, 0.0, 0.9], 0.02);
    assert!((got.roughness - 0.4).abs() < 0.02 && got.metallic < 0.1, "{got:?}");
    assert!(got.sheen == 0.0 && got.clearcoat == 0.0, "{got:?}");
}

#[test]
fn recovers_a_sharp_coat_over_a_wide_lobe() {
    let got: Layered = found_again(&[0.4, 0.1, 0.05, 0.0, 0.6, 1.5, 1.0, 1.0, 1.0, 0.9, 0.25], 0.03);
    assert!((got.coat_roughness - 0.15).abs() < 0.02 && (got.coat_weight - 0.9).abs() < 0.15, "{got:?}");
    assert!((got.roughness - 0.6).abs() < 0.06, "{got:?}");
}

#[test]
fn recovers_the_classic_models() {
    let got: ColourWard = found_again(&[0.3, 0.2, 0.1, 0.1, 0.1, 0.1, 0.08], 0.01);
    assert!((got.roughness - 0.08).abs() < 0.004, "{got:?}");
    let got: ColourCookTorrance = found_again(&[0.3, 0.2, 0.1, 0.5, 0.5, 0.5, 0.1, 0.15], 0.02);
    assert!((got.roughness - 0.15).abs() < 0.01, "{got:?}");
}

#[test]
fn recovers_the_scale_of_a_dark_plastic() {
    let model = Layered::of(&[0.04, 0.03, 0.02, 0.0, 0.3, 1.5, 1.0, 1.0, 1.0, 0.0, 0.02]);
    let tables = model.to_bivariate(FINE_AZIMUTHS);
    let brighter = 0.5 / BivariateTable::luminance(&tables).normal_albedo();
    assert!(brighter > 5.0);
    let fitter = Fitter::new(&tables.map(|table| table.scaled(brighter)));
    let found = fitter.plausible_scale() * brighter;
    assert!((0.5..2.0).contains(&found), "{found}");
    // A fit of the scaled table is the same as one of the table scaled before.
    let fitted = fitter.scaled(1.0 / brighter).fit::<Layered>();
    assert!(fitted.log_relight < 0.02 && (fitted.model.roughness - 0.3).abs() < 0.01, "{fitted:?}");
}

#[test]
fn recovers_the_parameters_of_draws() {
    let parameters = |roughness: f64| [0.3, 0.2, 0.1, 0.0, roughness, 1.5, 1.0, 1.0, 1.0, 0.0, 0.02];
    let tables = |roughness| Layered::of(&parameters(roughness)).to_bivariate(FINE_AZIMUTHS);
    let fitter = Fitter::new(&tables(0.35));
    let fitted = fitter.fit::<Layered>();
    for roughness in [0.25, 0.35, 0.5] {
        let got = fitter.of_draw(&tables(roughness)).refit(&fitted);
        assert!((got.roughness - roughness).abs() < 0.02 && got.coat_weight == 0.0, "{roughness}: {got:?}");
    }
}

#[test]
fn prefers_the_known_roughness_without_coat() {
    // Two lobes of similar width: a coat imitates the difference.
    let tables = Layered::of(&[0.3, 0.2, 0.1, 0.0, 0.35, 1.5, 1.0, 1.0, 1.0, 0.3, 0.8]).to_bivariate(FINE_AZIMUTHS);
    let fitter = Fitter::new(&tables).with_roughness([0.28, 0.33]);
    let near = fitter.fit::<Layered>();
    assert!((0.28..=0.33).contains(&near.model.roughness) && near.model.coat_weight == 0.0, "{near:?}");
    // A sharp coat over a wide lobe is no single lobe.
    let tables = Layered::of(&[0.6, 0.4, 0.2, 1.0, 0.6, 1.5, 1.0, 1.0, 1.0, 0.9, 0.25]).to_bivariate(FINE_AZIMUTHS);
    let coated = Fitter::new(&tables).with_roughness([0.14, 0.16]).fit::<Layered>();
    assert!(coated.model.coat_weight > 0.5 && coated.log_relight < 0.03, "{coated:?}");
}

#[test]
fn jacobian_matches_finite_differences() {
    let tables =
        MetallicRoughness::of(&[0.5, 0.2, 0.1, 0.3, 0.35, 1.4, 1.0, 0.9, 0.8, 0.5, 0.4]).to_bivariate(FINE_AZIMUTHS);
    let fitter = Fitter::new(&tables);
    let (start, free) = ([0.4, 0.3, 0.2, 0.2, 0.5, 1.5, 0.9, 1.0, 0.8, 0.4, 0.3], [0, 1, 3, 4, 5, 7, 9, 10]);
    for goal in [Goal::Samples, Goal::Picture] {
        let search = Search::<MetallicRoughness>::new(&fitter, MetallicRoughness::PARAMETERS, &start, &free, goal);
        assert_eq!(search.parameters()[8], 0.8);
        let slopes = search.jacobian().unwrap();
        for k in 0..free.len() {
            let mut at = search.at.clone();
            at[k] += 1e-3;
            let (far, near) = (search.residuals_at(&at), search.residuals_at(&search.at));
            for (row, (far, near)) in far.iter().zip(&near).enumerate() {
                let want = (far - near) / 1e-3;
                assert!((slopes[(row, k)] - want).abs() < 2e-3 * (1.0 + want.abs()), "{goal:?} {row} {k}");
            }
        }
    }
}
