//! Planted materials under planted lights.

use glam::Vec3;

use super::*;
use crate::inference::learnt::tests::{WORLD, light_map};
use crate::lighting::EnvironmentMap;
use crate::picture::Plane;
use crate::reflectance::trusted_cells;
use crate::sphere::direction_of_lat_long;
use crate::testing::ball;

/// Operator of a light for the materials of the world.
pub(super) fn under(points: &[SurfacePoint], light: &EnvironmentMap) -> Relighter {
    operator(points, None, &LightTree::of_map(light), &WORLD.coordinates, &WORLD.places)
}

/// Values of a material of the world under an operator, at this scale.
fn image(operator: &Relighter, material: usize, scale: f64) -> Vec<f64> {
    let table = WORLD.table(&WORLD.entries[material]);
    operator.apply(&table.as_slice().iter().map(|v| scale * f64::from(*v)).collect::<Vec<f64>>())
}

fn infer(
    points: &[SurfacePoint],
    operator: &Relighter,
    values: &[f64],
) -> Result<KnownLightPosterior, KnownLightError> {
    let normals: Vec<DVec3> = points.iter().map(|p| p.in_view()).collect();
    let trust = vec![1.0; values.len()];
    KnownLightPosterior::of(operator, (&normals, values, &trust), &WORLD.coordinates, &WORLD.places)
}

#[test]
fn a_planted_material_is_found_with_its_scale() {
    let points = ball(400);
    let operator = under(&points, &light_map(7));
    for material in [0, 2, 4] {
        let found = infer(&points, &operator, &image(&operator, material, 3.0)).unwrap();
        let truth = WORLD.table(&WORLD.entries[material]);
        assert!(found.misfit < 0.02 && found.settled, "{material}: {}", found.misfit);
        let albedo = found.table().normal_albedo() / (3.0 * truth.normal_albedo());
        assert!((albedo - 1.0).abs() < 0.03, "{material}: {albedo}");

        let posterior = found.posterior(None);
        let quantiles = posterior.quantiles(&[0.05, 0.95]);
        let truth = truth.with_normal_albedo(1.0).0;
        let held =
            trusted_cells().filter(|&c| (quantiles[0][c]..=quantiles[1][c]).contains(&truth.as_slice()[c])).count();
        assert!(held as f64 > 0.85 * trusted_cells().count() as f64, "{material}: {held}");
    }
}

#[test]
fn draws_follow_the_seed_and_spread_as_the_curvature_says() {
    let points = ball(150);
    let operator = under(&points, &light_map(7));
    let found = infer(&points, &operator, &image(&operator, 2, 1.0)).unwrap();
    assert_eq!(found.draws(5, 1), found.draws(5, 1));
    assert_ne!(found.draws(5, 1), found.draws(5, 2));
    // The variance of a logarithm, by draws and by the inverse of the curvature.
    let cell = trusted_cells().nth(1234).unwrap();
    let mut row = vec![0.0; found.coefficients.len()];
    found.space.add_derivatives(cell, 1.0, &mut row);
    let exact: f64 = row.iter().zip(found.curvature.solve(&row)).map(|(a, b)| a * b).sum();
    let logs: Vec<f64> = found.draws(2000, 3).iter().map(|t| f64::from(t.as_slice()[cell]).ln()).collect();
    let mean = logs.iter().sum::<f64>() / 2000.0;
    let variance = logs.iter().map(|l| (l - mean).powi(2)).sum::<f64>() / 2000.0;
    assert!((variance / exact - 1.0).abs() < 0.15, "{variance} {exact}");
}

#[test]
fn a_fifth_of_spoilt_pixels_costs_little() {
    let points = ball(400);
    let operator = under(&points, &light_map(7));
    let mut values = image(&operator, 2, 1.0);
    values.iter_mut().step_by(5).for_each(|v| *v *= 0.2);
    let found = infer(&points, &operator, &values).unwrap();
    let truth = WORLD.table(&WORLD.entries[2]);
    for (a, b) in found.place().iter().zip(WORLD.coordinates.of(&truth)).take(2) {
        assert!((a - b).abs() < 0.4, "{a} {b}");
    }
}

#[test]
fn what_is_dark_is_said() {
    let points = ball(30);
    let operator = under(&points, &light_map(7));
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
