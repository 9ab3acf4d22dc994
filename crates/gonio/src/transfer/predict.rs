//! What points of a surface would show of one BRDF in one light.

use glam::{DQuat, DVec3};
use rayon::prelude::*;

use super::{InterleavedTables, Points, Quadrature, QuadratureSettings, SurfacePoint};
use crate::lighting::LightGrid;
use crate::picture::luminance;
use crate::reflectance::BivariateTable;

/// Luminances of a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prediction {
    /// As the point is: in its own view, without the light that does not reach it.
    pub seen: f64,
    /// On a sphere: the point of the same normal relative to the view, seen from `+z` in the same light, all of which reaches it.
    pub on_sphere: f64,
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
        "visibility on another grid"
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
            let seen = match visibility {
                Some(visibility) => {
                    visibility.apply(i, texels, stride);
                    sum(texels)
                }
                None => all,
            };
            let on_sphere = if point.view == DVec3::Z {
                all
            } else {
                let normal = DQuat::from_rotation_arc(point.view, DVec3::Z) * point.normal;
                texels.fill(0.0);
                quadrature.integrate(&SurfacePoint { normal, view: DVec3::Z }, &tables, texels);
                sum(texels)
            };
            Prediction { seen, on_sphere }
        },
    );
    each.collect()
}
