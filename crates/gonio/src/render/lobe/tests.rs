use glam::DVec3;

use super::super::{IntegratorSettings, LightTree, radiance};
use super::*;
use crate::reflectance::MerlTable;
use crate::testing::{ball, environment_map};

/// Returns the sorted relative errors of the half vectors against the integrator.
fn errors(brdf: &dyn Brdf, tree: &LightTree) -> Vec<f64> {
    let light = PrefilteredLight::of(tree);
    let lobe = HalfVectorSampler::new(&[brdf], &light);
    let fine = IntegratorSettings { tolerance: 0.05, ..IntegratorSettings::default() };
    let points: Vec<SurfacePoint> = ball(24).into_iter().filter(|p| p.normal.z > 0.2).collect();
    let envelope = brdf.envelope();
    let off = points.iter().map(|point| {
        let want = radiance(point, brdf, &envelope, tree, &fine);
        let got = lobe.radiance(point, &light, |_| 1.0)[0].as_dvec3();
        (got - want).length() / want.length()
    });
    let mut off: Vec<f64> = off.collect();
    off.sort_by(f64::total_cmp);
    off
}

fn lamp(d: DVec3) -> f64 {
    let lamp = DVec3::new(0.4, 0.5, 0.6).normalize();
    if d.angle_between(lamp) < 0.05 { 300.0 } else { 1.0 + d.y }
}

#[test]
fn matches_the_integrator() {
    let tree = LightTree::of_map(&environment_map(256, lamp));
    let lobe = |width: f64| BivariateTable::from_fn(|h, d| 0.1 + d + 3.0 / (1.0 + (h / width).powi(2)).powi(2));
    for (width, median, worst) in [(1.0, 0.003, 0.02), (0.2, 0.003, 0.03), (0.05, 0.005, 0.08)] {
        let off = errors(&lobe(width), &tree);
        let (middle, last) = (off[off.len() / 2], off[off.len() - 1]);
        assert!(middle < median && last < worst, "{width}: {middle} {last}");
    }
}

#[test]
fn rotated_light_matches_rotated_map() {
    let map = environment_map(64, lamp);
    let mut tree = LightTree::of_map(&map);
    let turn = glam::DQuat::from_rotation_y(-std::f64::consts::TAU * 16.0 / 128.0);
    let want = PrefilteredLight::of(&LightTree::of_map(&map.shifted_columns(16)));
    tree.set_rotation(turn);
    let got = PrefilteredLight::of(&tree);
    let table = BivariateTable::from_fn(|h, _| 0.1 + 2.0 / (1.0 + (h / 0.3).powi(2)).powi(2));
    let lobe = HalfVectorSampler::new(&[&table], &want);
    for point in ball(10).into_iter().filter(|p| p.normal.z > 0.2) {
        let [want, got] = [&want, &got].map(|light| lobe.radiance(&point, light, |_| 1.0)[0]);
        assert!((want - got).length() < 0.01 * want.length(), "{want} {got}");
    }
}

#[test]
fn approximate_angles_match_the_standard_library() {
    for i in 0..720 {
        let angle = 0.5 * i as f32 + 0.01;
        let (y, x) = angle.to_radians().sin_cos();
        let want = (angle % 180.0) / 180.0;
        assert!((share_of_half_turn(y, x) - want).abs() < 2e-5, "{angle}");
        if angle < 90.0 {
            assert!((degrees_of_cosine(x) - angle).abs() < 0.02, "{angle}");
        }
    }
}

#[test]
fn renders_tables_that_depend_on_phi_d() {
    let tree = LightTree::of_map(&environment_map(64, |d| 1.5 + d.y));
    let table = BivariateTable::from_fn(|h, _| 0.1 + 2.0 / (1.0 + (h / 0.3).powi(2)).powi(2));
    let even = MerlTable::from_bivariate([&table; 3]);
    assert!(even.is_bivariate());
    let turned = |(k, value): (usize, &f32)| {
        let phi_d = ((k % crate::reflectance::PHI_D) as f32).to_radians();
        if *value < 0.0 { *value } else { value * (1.0 + 0.5 * phi_d.cos().powi(2)) }
    };
    let merl = MerlTable::from_channels([0, 1, 2].map(|c| even.channel(c).iter().enumerate().map(turned).collect()));
    assert!(!merl.is_bivariate());
    let off = errors(&merl, &tree);
    assert!(off[off.len() / 2] < 0.005 && off[off.len() - 1] < 0.02, "{off:?}");
}
