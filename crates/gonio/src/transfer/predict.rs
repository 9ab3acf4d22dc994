//! Predicted luminance of points of a surface, for one BRDF in one light.

use glam::DVec3;
use rayon::prelude::*;

use super::{InterleavedTables, Quadrature, QuadratureSettings};
use crate::lighting::LightGrid;
use crate::picture::luminance;
use crate::reflectance::BivariateTable;
use crate::shape::{Points, SurfacePoint};

/// Predicted luminances of a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prediction {
    /// Luminance of the point in its own view, under the light that reaches it.
    pub shadowed: f64,
    /// Luminance at the same normal of a sphere, without occlusion.
    ///
    /// The normal is relative to the view; the sphere is viewed from `+z` in the same light.
    pub on_sphere: f64,
    /// Fraction of `shadowed` that comes through partly open texels, in 0..=1.
    ///
    /// Near one, the edge of a shadow lies on the point, and the luminance depends on where within
    /// a texel the light comes from.
    pub edge: f64,
}

/// Predicts the luminance of each point under a light that is constant on its texels.
///
/// # Panics
/// If the visibility of the points is on another grid than the light.
pub fn predict<'a>(
    points: impl Into<Points<'a>>,
    table: &BivariateTable,
    light: &LightGrid,
    settings: QuadratureSettings,
) -> Vec<Prediction> {
    let Points { points, visibility } = points.into();
    assert!(
        visibility.is_none_or(|v| (v.side(), v.map()) == (light.side(), light.map())),
        "visibility and light have different grids"
    );
    let quadrature = Quadrature::new(light.map(), light.side(), settings);
    let tables = InterleavedTables::new(std::slice::from_ref(table));
    let stride = tables.stride();
    let radiance: Vec<f64> = light.texels().iter().map(|t| f64::from(luminance(*t))).collect();
    let sum =
        |texels: &[f32]| -> f64 { texels.chunks_exact(stride).zip(&radiance).map(|(t, l)| f64::from(t[0]) * l).sum() };
    let each = points.par_iter().enumerate().map_init(
        || vec![0.0_f32; quadrature.texels() * stride],
        |texels, (i, point)| {
            texels.fill(0.0);
            quadrature.integrate(point, &tables, texels);
            let all = sum(texels);
            let (shadowed, through) = match visibility {
                Some(visibility) => {
                    visibility.apply(i, texels, stride);
                    let at = |t: usize| f64::from(texels[t * stride]) * radiance[t];
                    (sum(texels), visibility.partial(i).map(|(t, _)| at(t)).sum())
                }
                None => (all, 0.0),
            };
            let edge = if shadowed > 0.0 { through / shadowed } else { 0.0 };
            let on_sphere = if point.view == DVec3::Z {
                all
            } else {
                texels.fill(0.0);
                let turned = SurfacePoint { normal: point.in_view(), view: DVec3::Z };
                quadrature.integrate(&turned, &tables, texels);
                sum(texels)
            };
            Prediction { shadowed, on_sphere, edge }
        },
    );
    each.collect()
}

#[cfg(test)]
mod tests {
    use glam::{DQuat, Vec3};

    use super::*;
    use crate::shape::{BuiltInShape, Ray, Surface, Tracer, Visibility, VisibilityPoint};
    use crate::sphere::{OctahedralMap, fibonacci_hemisphere};
    use crate::testing::ball;

    const SIDE: usize = 16;
    const MAP: OctahedralMap = OctahedralMap::EqualArea;

    fn table() -> BivariateTable {
        BivariateTable::from_fn(|h, _| 0.1 + 0.5 / (1.0 + (h / 0.2_f64).powi(2)))
    }

    /// Returns points inside a bowl, viewed from its front, and their visibility.
    fn bowl() -> (Vec<SurfacePoint>, Visibility) {
        let tracer = Tracer::new(BuiltInShape::Bowl.mesh(30).unwrap());
        let view = DVec3::Z;
        let (mut points, mut lookouts) = (Vec::new(), Vec::new());
        for from in fibonacci_hemisphere(60).map(|n| DVec3::new(0.9 * n.x, 0.9 * n.y, 3.0)) {
            if let Some(hit) = tracer.hit(&Ray { origin: from, direction: -view }) {
                points.push(SurfacePoint { normal: hit.normal, view });
                lookouts.push(VisibilityPoint { from: hit.ray_origin, normal: hit.normal });
            }
        }
        (points, Visibility::trace(&tracer, &lookouts, MAP, SIDE, &|_| ()))
    }

    #[test]
    fn predictions_are_sums_over_the_texels() {
        let (points, visibility) = bowl();
        let light =
            LightGrid::from_texels(MAP, SIDE, (0..SIDE * SIDE).map(|t| Vec3::splat(1.0 + (t % 7) as f32)).collect());
        let settings = QuadratureSettings::default();
        let got = predict(Points::new(&points, Some(&visibility)), &table(), &light, settings);
        let quadrature = Quadrature::new(MAP, SIDE, settings);
        let tables = InterleavedTables::new(&[table()]);
        let mut shadowed = 0;
        for (i, (point, got)) in points.iter().zip(&got).enumerate() {
            let mut texels = vec![0.0; SIDE * SIDE * tables.stride()];
            quadrature.integrate(point, &tables, &mut texels);
            let (mut seen, mut open, mut edge) = (0.0, 0.0, 0.0);
            for (t, texel) in texels.chunks_exact(tables.stride()).enumerate() {
                let all = f64::from(texel[0]) * (1.0 + (t % 7) as f64);
                let share = f64::from(visibility.share(i, t));
                open += all;
                seen += share * all;
                edge += if share > 0.0 && share < 1.0 { share * all } else { 0.0 };
            }
            assert!((got.on_sphere / open - 1.0).abs() < 1e-4 && (got.shadowed / seen - 1.0).abs() < 1e-4, "{got:?}");
            assert!((got.edge - edge / seen).abs() < 1e-4, "{got:?} {edge} {seen}");
            shadowed += usize::from(seen < 0.8 * open);
        }
        assert!(shadowed > 10, "{shadowed} of {}", points.len());
    }

    #[test]
    fn lamp_at_the_edge_of_a_shadow_has_an_edge_of_one() {
        let (points, visibility) = bowl();
        let at = |i: usize, texel: usize| {
            let lamp = |t: usize| Vec3::splat(if t == texel { 1.0 } else { 0.0 });
            let light = LightGrid::from_texels(MAP, SIDE, (0..SIDE * SIDE).map(lamp).collect());
            predict(Points::new(&points, Some(&visibility)), &table(), &light, QuadratureSettings::default())[i]
        };
        let i =
            (0..points.len()).find(|&i| visibility.partial(i).any(|(_, share)| share > 0.2 && share < 0.8)).unwrap();
        let (texel, share) = visibility.partial(i).find(|(_, share)| *share > 0.2 && *share < 0.8).unwrap();
        let edge = at(i, texel);
        assert!(
            (edge.edge - 1.0).abs() < 1e-9 && (edge.shadowed / edge.on_sphere - f64::from(share)).abs() < 1e-6,
            "{edge:?}"
        );
    }

    #[test]
    fn on_sphere_rotates_with_the_view() {
        let view = DVec3::new(0.3, 0.1, 1.0).normalize();
        let turn = DQuat::from_rotation_arc(DVec3::Z, view);
        let light = LightGrid::from_texels(MAP, SIDE, (0..SIDE * SIDE).map(|t| Vec3::splat((t % 5) as f32)).collect());
        let straight: Vec<SurfacePoint> = ball(30).into_iter().filter(|p| p.normal.z > 0.3).collect();
        let turned: Vec<SurfacePoint> =
            straight.iter().map(|p| SurfacePoint { normal: turn * p.normal, view }).collect();
        let (a, b) = (
            predict(&turned, &table(), &light, QuadratureSettings::default()),
            predict(&straight, &table(), &light, QuadratureSettings::default()),
        );
        for (a, b) in a.iter().zip(&b) {
            assert!((a.on_sphere / b.shadowed - 1.0).abs() < 1e-3 && a.edge == 0.0, "{a:?} {b:?}");
        }
    }
}
