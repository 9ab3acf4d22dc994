//! Tests with planted materials under planted lights.

use glam::Vec3;

use super::*;
use crate::inference::learnt::MaterialPosterior;
use crate::inference::learnt::tests::{WORLD, environment_map};
use crate::lighting::EnvironmentMap;
use crate::picture::Plane;
use crate::reflectance::trusted_cells;
use crate::sphere::direction_of_lat_long;
use crate::testing::ball;

/// Operator of a light for the materials of the world.
pub(super) fn under(points: &[SurfacePoint], light: &EnvironmentMap) -> Operator {
    Operator::of(points, None, &KnownLight::of_map(light), &materials())
}

/// Values of a material of the world under an operator, at this scale.
fn image(operator: &Operator, material: usize, scale: f64) -> Vec<f64> {
    let table = WORLD.table(&WORLD.entries[material]);
    operator.apply(&table.as_slice().iter().map(|v| scale * f64::from(*v)).collect::<Vec<f64>>(), 1.0)
}

fn materials() -> PriorMaterials<'static> {
    PriorMaterials::of(&WORLD.latent_space, &WORLD.coordinates)
}

fn infer(points: &[SurfacePoint], operator: &Operator, values: &[f64]) -> Result<KnownLightPosterior, KnownLightError> {
    let trust = vec![1.0; values.len()];
    KnownLightPosterior::under(
        operator,
        &ObservedPoints { points, visibility: None, values, weights: &trust },
        &materials(),
    )
}

#[test]
fn recovers_a_planted_material_and_its_scale() {
    let points = ball(400);
    let operator = under(&points, &environment_map(7));
    for material in [0, 2, 4] {
        let found = infer(&points, &operator, &image(&operator, material, 3.0)).unwrap();
        let truth = WORLD.table(&WORLD.entries[material]);
        assert!(found.misfit < 0.02 && found.converged, "{material}: {}", found.misfit);
        let albedo = found.table().normal_albedo() / (3.0 * truth.normal_albedo());
        assert!((albedo - 1.0).abs() < 0.03, "{material}: {albedo}");

        let gaussian = found.gaussian().unwrap();
        let posterior = MaterialPosterior::of_gaussian(&WORLD.latent_space, gaussian, Vec::new()).unwrap();
        let quantiles = posterior.quantiles(&[0.05, 0.95]);
        let truth = truth.with_normal_albedo(1.0).0;
        let held =
            trusted_cells().filter(|&c| (quantiles[0][c]..=quantiles[1][c]).contains(&truth.as_slice()[c])).count();
        assert!(held as f64 > 0.85 * trusted_cells().count() as f64, "{material}: {held}");
    }
}

#[test]
fn draws_depend_on_the_seed_and_have_the_variance_of_the_curvature() {
    let points = ball(150);
    let operator = under(&points, &environment_map(7));
    let found = infer(&points, &operator, &image(&operator, 2, 1.0)).unwrap();
    let gaussian = found.gaussian().unwrap();
    let draws = |count: usize, seed: u64| gaussian.draws(&WORLD.latent_space, count, seed).unwrap();
    assert_eq!(draws(5, 1), draws(5, 1));
    assert_ne!(draws(5, 1), draws(5, 2));
    // Compares the variance of the log ratio of two cells, which is independent of the scale,
    // between draws and the inverse of the curvature.
    let cells = [1234, 20].map(|n| trusted_cells().nth(n).unwrap());
    let mut row = found.space.sum_of_derivatives([(cells[0], 1.0), (cells[1], -1.0)].into_iter());
    row.resize(found.coefficients.len(), 0.0);
    let exact: f64 = row.iter().zip(found.curvature.solve(&row)).map(|(a, b)| a * b).sum();
    let log = |t: &BivariateTable, c: usize| f64::from(t.as_slice()[c]).ln();
    let logs: Vec<f64> = draws(2000, 3).iter().map(|t| log(t, cells[0]) - log(t, cells[1])).collect();
    let mean = logs.iter().sum::<f64>() / 2000.0;
    let variance = logs.iter().map(|l| (l - mean).powi(2)).sum::<f64>() / 2000.0;
    assert!((variance / exact - 1.0).abs() < 0.15, "{variance} {exact}");
}

#[test]
fn tolerates_a_fifth_of_outliers() {
    let points = ball(400);
    let operator = under(&points, &environment_map(7));
    let mut values = image(&operator, 2, 1.0);
    values.iter_mut().step_by(5).for_each(|v| *v *= 0.2);
    let found = infer(&points, &operator, &values).unwrap();
    let truth = WORLD.table(&WORLD.entries[2]);
    for (a, b) in found.gaussian().unwrap().coordinates().iter().zip(WORLD.latent_space.of(&truth)).take(2) {
        assert!((a - b).abs() < 0.4, "{a} {b}");
    }
}

#[test]
fn rejects_black_images_and_dark_lights() {
    let points = ball(30);
    let operator = under(&points, &environment_map(7));
    assert_eq!(infer(&points, &operator, &[0.0; 30]).unwrap_err(), KnownLightError::Black);
    // A lamp behind the ball.
    let behind = Plane::from_fn(96, 48, |x, y| {
        let d = direction_of_lat_long((x as f64 + 0.5) / 96.0, (y as f64 + 0.5) / 48.0);
        Vec3::splat(f32::from(u8::from(d.z < -0.95)))
    });
    let front: Vec<SurfacePoint> = points.iter().filter(|p| p.normal.z > 0.6).copied().collect();
    let dark = under(&front, &EnvironmentMap::new(behind).unwrap());
    assert_eq!(infer(&front, &dark, &vec![1.0; front.len()]).unwrap_err(), KnownLightError::Dark);
}

/// Returns the posterior for an image under one light, given another.
fn given(points: &[SurfacePoint], values: &[f64], light: &EnvironmentMap, alignment: Alignment) -> KnownLightPosterior {
    let trust = vec![1.0; values.len()];
    let rows = ObservedPoints { points, visibility: None, values, weights: &trust };
    KnownLightPosterior::of(&rows, KnownLight::of_map(light), alignment, &materials()).unwrap()
}

#[test]
fn recovers_the_rotation_of_a_light() {
    let points = ball(400);
    let (map, turn) = (environment_map(7), DQuat::from_scaled_axis(DVec3::new(0.05, -0.06, 0.03)));
    let turned = KnownLight::of_map(&map).rotated(turn);
    let operator = Operator::of(&points, None, &turned, &materials());
    let values = image(&operator, 2, 1.0);
    let (fixed, near) =
        (given(&points, &values, &map, Alignment::Fixed), given(&points, &values, &map, Alignment::Small));
    let off = near.rotation.angle_between(turn).to_degrees();
    assert!(off < 0.5, "{off}");
    assert_eq!(fixed.rotation, DQuat::IDENTITY);
    assert!(near.misfit < 0.02 && fixed.misfit > 2.0 * near.misfit, "{} {}", near.misfit, fixed.misfit);
}

#[test]
fn keeps_an_aligned_light() {
    let points = ball(400);
    let operator = under(&points, &environment_map(7));
    for material in [1, 4] {
        let values = image(&operator, material, 1.0);
        assert_eq!(given(&points, &values, &environment_map(7), Alignment::Small).rotation, DQuat::IDENTITY);
    }
}

#[test]
fn recovers_any_rotation_about_the_vertical() {
    let points = ball(400);
    let turn = DQuat::from_rotation_y(-2.0);
    let turned = KnownLight::of_map(&environment_map(7)).rotated(turn);
    let operator = Operator::of(&points, None, &turned, &materials());
    let found = given(&points, &image(&operator, 1, 1.0), &environment_map(7), Alignment::Vertical);
    let off = found.rotation.angle_between(turn).to_degrees();
    assert!(off < 1.0, "{off}");
    assert!(found.rotation.to_scaled_axis().length() < std::f64::consts::PI);
}

#[test]
fn recovers_the_radiance_of_clipped_pixels() {
    let points = ball(400);
    // A sun in a sky that is brighter towards it.
    let sun = DVec3::new(0.5, 0.6, 0.6).normalize();
    let sky = |clip: f32| {
        let map = Plane::from_fn(256, 128, |x, y| {
            let d = direction_of_lat_long((x as f64 + 0.5) / 256.0, (y as f64 + 0.5) / 128.0);
            let sun = if d.angle_between(sun) < 0.04 { 3000.0 } else { 0.0 };
            Vec3::splat((sun + 1.0 + d.y as f32 + 2.0 * d.dot(DVec3::X) as f32 * d.z as f32 + 1.0).min(clip))
        });
        EnvironmentMap::new(map).unwrap()
    };
    let (map, clipped) = (sky(1e9), sky(300.0));
    let operator = under(&points, &map);
    let values = image(&operator, 1, 1.0);
    let found = given(&points, &values, &clipped, Alignment::Small);
    let (gain, sd) = found.gain.unwrap();
    assert!((gain / 10.0).ln().abs() < 0.1 && sd < 0.3, "{gain} {sd}");
    assert!(found.misfit < 0.03, "{}", found.misfit);
    // A lamp that only looks clipped keeps its brightness.
    let found = given(&points, &values, &map, Alignment::Small);
    assert!(found.gain.is_some_and(|(gain, _)| gain.ln().abs() < 0.05), "{:?}", found.gain);
}
