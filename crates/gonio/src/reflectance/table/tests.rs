use super::*;

fn wavy() -> BivariateTable {
    BivariateTable::from_fn(|h, d| 1.0 + h.sin() * (3.0 * d).cos())
}

#[test]
fn interpolation_reproduces_samples() {
    let t = wavy();
    for (i, j) in [(0, 0), (1, 3), (44, 60), (88, 88), (89, 89)] {
        let got = t.eval(theta_h_of(i), theta_d_of(j));
        assert!((got - f64::from(t.cell(i, j))).abs() < 1e-6, "{i} {j}");
    }
}

#[test]
fn stencil_matches_interpolation() {
    let t = wavy();
    for (h, d) in [(0.0, 0.0), (0.013, 0.4), (1.2, 1.56), (FRAC_PI_2, FRAC_PI_2)] {
        let sum: f64 = BivariateTable::stencil(h, d).iter().map(|&(c, w)| w * f64::from(t.as_slice()[c])).sum();
        assert!((sum - t.eval(h, d)).abs() < 1e-12, "{h} {d}");
    }
}

#[test]
fn lambertian_surface_of_one_over_pi_has_albedo_one() {
    let t = BivariateTable::from_fn(|_, _| 1.0 / PI);
    assert!((t.normal_albedo() - 1.0).abs() < 1e-6);
}

#[test]
fn with_normal_albedo_sets_the_albedo() {
    let (half, scale) = wavy().with_normal_albedo(0.5);
    assert!((half.normal_albedo() - 0.5).abs() < 1e-6);
    assert!((f64::from(half.cell(3, 4)) - scale * f64::from(wavy().cell(3, 4))).abs() < 1e-6);
}

#[test]
fn scaling_a_table_scales_its_albedo() {
    let t = wavy();
    let scaled = t.scaled(0.25);
    assert_eq!(scaled.cell(7, 30), 0.25 * t.cell(7, 30));
    assert!((scaled.normal_albedo() / t.normal_albedo() - 0.25).abs() < 1e-6);
}

#[test]
fn last_value_applies_beyond_the_last_sample() {
    let t = wavy();
    assert_eq!(t.eval(FRAC_PI_2, FRAC_PI_2) as f32, t.cell(89, 89));
}

#[test]
fn from_bivariate_and_bivariate_are_inverse() {
    let t = wavy();
    let full = MerlTable::from_bivariate([&t, &t, &t]);
    let back = full.bivariate(1);
    for (a, b) in t.as_slice().iter().zip(back.as_slice()) {
        assert!((a - b).abs() < 1e-6);
    }
}

#[test]
fn full_tables_interpolate_across_the_seam_of_phi() {
    let t = wavy();
    let full = MerlTable::from_bivariate([&t, &t, &t]);
    let (h, d) = (0.3, 0.4);
    for phi in [0.0, 3.12, 3.135, -0.005, 4.0] {
        assert!((full.eval(h, d, phi)[2] - t.eval(h, d)).abs() < 1e-6, "{phi}");
    }
}

#[test]
fn extension_repeats_the_last_trusted_value() {
    let mut t = wavy();
    t.extend_from_trusted();
    assert_eq!(t.cell(20, 89), t.cell(20, 79));
    assert_eq!(t.cell(89, 20), t.cell(84, 20));
    assert_eq!(t.cell(89, 89), t.cell(84, 79));
    assert_eq!(t.cell(10, 10), wavy().cell(10, 10));
}

#[test]
fn every_cell_has_a_valid_phi_d() {
    for c in 0..CELLS {
        let (h, d) = angles_of(c);
        assert!(above_horizon(h, d, FRAC_PI_2), "cell {c}");
    }
}
