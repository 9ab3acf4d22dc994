use std::sync::LazyLock;

use gonio::shape::SurfacePoint;

use super::*;
use crate::testing::{sphere_points, toy_prior, toy_tables};

fn toy() -> (Vec<SurfacePoint>, Vec<BivariateTable>, LightPrior, PlanSettings) {
    let settings = PlanSettings { rank: 300, oversampling: 20, ..PlanSettings::of_side(16) };
    (sphere_points(600), toy_tables(), toy_prior(16), settings)
}

fn build(settings: &PlanSettings) -> Plan {
    let (points, tables, prior, _) = toy();
    Plan::build(&points, &tables, &prior, settings, &|_| ()).unwrap()
}

static PLAN: LazyLock<Plan> = LazyLock::new(|| build(&toy().3));

#[test]
fn recomputed_and_stored_rows_give_the_same_plan() {
    let (.., settings) = toy();
    let streamed = build(&PlanSettings { hold: 0, ..settings });
    let held = &*PLAN;
    assert!(held.left_out() < 1e-3, "{}", held.left_out());
    let difference = streamed.energies.iter().zip(&held.energies).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(difference < 1e-4 * held.energies[0], "{difference}");
}

#[test]
fn projection_matches_the_full_rows() {
    let (points, tables, prior, settings) = toy();
    let plan = &*PLAN;
    let nothing = vec![Some(0.0); points.len()];
    let (rows, _) = observed_rows((&points).into(), &nothing, &tables, &prior, &settings.transfer).unwrap();
    let full = Bilinear::new(points.len(), 3, 256, rows);
    let mut l: Vec<f64> = prior.mean_and_variance(16).iter().map(|m| m.0).collect();
    l[5] = 0.1;
    l[40] = -0.05;
    let f = [0.4, 0.3, 0.2];
    let image: Vec<Option<f64>> = full.apply(&l, &f).into_iter().map(Some).collect();
    let projected = plan.project(&image, 0.0).unwrap();
    assert!(projected.left_over() < 1e-4, "{}", projected.left_over());
    let scale = projected.energy().sqrt();
    for (got, want) in projected.bilinear.apply(&l, &f).iter().zip(&projected.target) {
        assert!((got - want).abs() < 1e-5 * scale, "{got} {want}");
    }
    // The same with a tenth of the pixels missing.
    let holes: Vec<Option<f64>> = image.iter().enumerate().map(|(i, v)| v.filter(|_| i % 10 != 3)).collect();
    let partial = plan.project(&holes, 0.0).unwrap();
    assert_eq!(partial.pixels, holes.iter().flatten().count());
    assert!((partial.energy() - holes.iter().flatten().map(|x| x * x).sum::<f64>()).abs() < 1e-6 * scale * scale);
    for (got, want) in partial.bilinear.apply(&l, &f).iter().zip(&partial.target) {
        assert!((got - want).abs() < 1e-4 * scale, "{got} {want}");
    }
    // The same without projection.
    let direct = Projected::unprojected(&points, &image, &tables, &prior, &settings.transfer).unwrap();
    assert_eq!(direct.pixels, points.len());
}

#[test]
fn rank_decreases_with_slack() {
    let plan = &*PLAN;
    let image: Vec<Option<f64>> = sphere_points(600).iter().map(|p| Some(p.normal.y + 2.0)).collect();
    let (tight, loose) = (plan.project(&image, 0.0).unwrap(), plan.project(&image, 0.5).unwrap());
    assert_eq!((tight.bilinear.rows(), loose.bilinear.rows()), (300, 50));
}

#[test]
fn rejects_unusable_inputs() {
    let (points, tables, prior, settings) = toy();
    let few = Plan::build(&points[..10], &tables, &prior, &settings, &|_| ()).unwrap_err();
    assert_eq!(few, TransferError::TooFewPoints(10).into());
    let plan = &*PLAN;
    assert!(matches!(
        plan.project(&[Some(1.0)], 0.0),
        Err(PlanError::Transfer(TransferError::Points { image: 1, .. }))
    ));
    assert_eq!(plan.project(&vec![None; points.len()], 0.0).unwrap_err(), TransferError::TooFewPoints(0).into());
    let few: Vec<Option<f64>> = (0..points.len()).map(|i| (i < 100).then_some(1.0)).collect();
    assert_eq!(plan.project(&few, 0.0).unwrap_err(), PlanError::TooFewForPlan { kept: 100, rank: 300 });
}
