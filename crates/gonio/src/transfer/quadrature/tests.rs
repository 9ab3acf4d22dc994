use glam::DVec3;

use super::super::polar_reference;
use super::*;
use crate::sphere::fibonacci_hemisphere;

fn lobe(width: f64) -> BivariateTable {
    BivariateTable::from_fn(|h, _| 1.0 / (1.0 + (h / width).powi(2)).powi(2))
}

fn integrate(quadrature: &Quadrature, normal: DVec3, tables: &[BivariateTable]) -> Vec<f32> {
    let tables = InterleavedTables::new(tables);
    let mut out = vec![0.0; quadrature.texels() * tables.stride()];
    quadrature.integrate(&SurfacePoint { normal, view: DVec3::Z }, &tables, &mut out);
    out
}

#[test]
fn normals_rotate_with_the_view_and_face_it() {
    let view = DVec3::new(0.3, -0.2, 0.9).normalize();
    for normal in fibonacci_hemisphere(40) {
        let point = SurfacePoint { normal, view };
        let turned = point.in_view();
        assert!((turned.z - normal.dot(view)).abs() < 1e-12 && (turned.length() - 1.0).abs() < 1e-12);
        let facing = point.facing();
        assert!(facing.normal.dot(view) > 0.999e-3 * 0.5, "{normal}");
        assert_eq!(facing == point, normal.dot(view) >= 1e-3);
    }
}

#[test]
fn constant_brdf_under_uniform_light_integrates_to_pi() {
    let one = [BivariateTable::from_fn(|_, _| 1.0)];
    for map in [OctahedralMap::EqualArea, OctahedralMap::PraunHoppe] {
        let quadrature = Quadrature::new(map, 32, QuadratureSettings::default());
        for normal in fibonacci_hemisphere(20) {
            let out = integrate(&quadrature, normal, &one);
            let total: f32 = out.iter().sum();
            assert!((total / PI - 1.0).abs() < 2e-3, "{map:?} {normal} {total}");
        }
    }
}

#[test]
fn sharp_lobes_match_the_polar_reference_texel_by_texel() {
    // Widths of 0.25 degrees, as of chrome, and of 0.5, 5 and 30 degrees.
    let tables: Vec<BivariateTable> = [0.25, 0.5, 5.0, 30.0_f64].map(|w| lobe(w.to_radians())).to_vec();
    let quadrature = Quadrature::new(OctahedralMap::EqualArea, 32, QuadratureSettings::default());
    for normal in fibonacci_hemisphere(12).filter(|n| n.z > 0.2) {
        let out = integrate(&quadrature, normal, &tables);
        let point = SurfacePoint { normal, view: DVec3::Z };
        for (k, table) in tables.iter().enumerate() {
            let reference = polar_reference(&point, table, OctahedralMap::EqualArea, 32, 1000, 700);
            let stride = kernels::LANES;
            let (mut error, mut norm) = (0.0, 0.0);
            for (t, r) in reference.iter().enumerate() {
                error += (f64::from(out[t * stride + k]) - r).powi(2);
                norm += r * r;
            }
            let relative = (error / norm).sqrt();
            assert!(relative < 0.02, "{normal} lobe {k}: {relative}");
        }
    }
}

#[test]
fn refinement_converges() {
    let tables = [lobe(0.4_f64.to_radians())];
    let normal = DVec3::new(0.31, 0.22, 0.8).normalize();
    let mut settings = QuadratureSettings { base: 5, ratio: 1.0, core: 0.02 };
    let mut errors = Vec::new();
    let finest = QuadratureSettings { base: 8, ratio: 0.06, core: 0.001 };
    let best = integrate(&Quadrature::new(OctahedralMap::EqualArea, 32, finest), normal, &tables);
    for _ in 0..4 {
        let out = integrate(&Quadrature::new(OctahedralMap::EqualArea, 32, settings), normal, &tables);
        let norm: f32 = best.iter().map(|x| x * x).sum();
        let error: f32 = out.iter().zip(&best).map(|(a, b)| (a - b).powi(2)).sum();
        errors.push((error / norm).sqrt());
        settings =
            QuadratureSettings { base: settings.base + 1, ratio: settings.ratio / 2.0, core: settings.core / 2.0 };
    }
    assert!(errors[3] < 0.15 * errors[0] && errors[3] < 5e-3, "{errors:?}");
}
