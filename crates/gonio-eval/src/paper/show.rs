//! Pictures of radiance for the report.

use glam::{DVec3, Vec3};
use gonio::picture::{Picture, Plane, luminance};
use gonio::reflectance::{BivariateTable, MerlTable};
use gonio::render::{Accuracy, Brdf, Exposure, IntegratorSettings, LightTree, SphereSettings, radiance, render_sphere};
use gonio::shape::SurfacePoint;
use rayon::prelude::*;

/// Background of every object: dark, but not black, on light and dark pages.
const GROUND: Vec3 = Vec3::new(0.012, 0.013, 0.015);
/// Side of pictures of spheres, pixels.
pub(super) const SPHERE: usize = 96;

/// Settings of the render of a sphere: the default accuracy if errors are measured on it, else a
/// coarser one for display.
pub(super) fn settings(size: usize, measured: bool) -> SphereSettings {
    let integrator =
        if measured { IntegratorSettings::default() } else { IntegratorSettings { tolerance: 0.4, max_cells: 6000 } };
    SphereSettings { size, accuracy: Accuracy::Bound(integrator), ..SphereSettings::default() }
}

/// Renders a sphere of [`SPHERE`] pixels for display.
pub(super) fn sphere(brdf: &dyn Brdf, light: &LightTree) -> Picture {
    render_sphere(brdf, light, &settings(SPHERE, false), &|_| ())
}

/// Luminance of points of a material in a light, with the accuracy for measuring errors.
pub(super) fn luminances(points: &[SurfacePoint], brdf: &MerlTable, light: &LightTree) -> Vec<Option<f64>> {
    let (envelope, accuracy) = (brdf.envelope(), IntegratorSettings::default());
    let rendered = |p| luminance(radiance(p, brdf, &envelope, light, &accuracy).as_vec3());
    points.par_iter().map(|p| Some(f64::from(rendered(p)))).collect()
}

fn covered(picture: &Picture, i: usize) -> bool {
    picture.alpha.as_ref().is_none_or(|a| a.as_slice()[i] > 0.99)
}

/// Exposure that shows most of the object well.
pub(crate) fn exposure(picture: &Picture) -> Exposure {
    Exposure::by_quantile(&picture.rgb, |i| covered(picture, i), 0.9, 0.6)
}

/// Linear display values of a picture whose colour is multiplied by its alpha.
pub(crate) fn display(picture: &Picture, exposure: Exposure) -> Plane<Vec3> {
    Plane::from_fn(picture.rgb.width(), picture.rgb.height(), |x, y| {
        let alpha = picture.alpha.as_ref().map_or(1.0, |a| a[(x, y)].clamp(0.0, 1.0));
        exposure.apply(picture.rgb[(x, y)]) + GROUND * (1.0 - alpha)
    })
}

/// Joins pictures of one height side by side.
pub(super) fn beside(pictures: &[Plane<Vec3>]) -> Plane<Vec3> {
    let height = pictures.iter().map(Plane::height).min().unwrap_or(0);
    let columns: Vec<(usize, usize)> =
        pictures.iter().enumerate().flat_map(|(i, p)| (0..p.width()).map(move |x| (i, x))).collect();
    Plane::from_fn(columns.len(), height, |x, y| {
        let (picture, column) = columns[x];
        pictures[picture][(column, y)]
    })
}

/// Multiplies a picture by a factor.
pub(crate) fn scaled(picture: &Picture, factor: f64) -> Picture {
    Picture { rgb: picture.rgb.map(|p| *p * factor as f32), alpha: picture.alpha.clone() }
}

/// Colours a grey picture to fit the reference, by least squares in each channel over the pixels
/// that both cover fully. The paper displays grey estimates in this way.
pub(super) fn best_coloured(grey: &Picture, reference: &Picture) -> Picture {
    let (ours, theirs) = (grey.rgb.as_slice(), reference.rgb.as_slice());
    let (mut up, mut down) = (DVec3::ZERO, DVec3::ZERO);
    for i in (0..ours.len()).filter(|&i| covered(grey, i) && covered(reference, i)) {
        let (ours, theirs) = (ours[i].as_dvec3(), theirs[i].as_dvec3());
        up += ours * theirs;
        down += ours * ours;
    }
    let colour = (up / down.max(DVec3::splat(f64::MIN_POSITIVE))).as_vec3();
    Picture { rgb: grey.rgb.map(|p| *p * colour), alpha: grey.alpha.clone() }
}

/// Scale at which an estimate matches the reference in most pixels, regardless of highlights: the
/// median ratio.
pub(super) fn median_ratio(estimate: &[f64], reference: &[f64]) -> f64 {
    let ratios = estimate.iter().zip(reference).filter(|(e, _)| **e > 0.0).map(|(e, r)| r / e);
    let median = crate::metrics::median(ratios.collect());
    if median.is_finite() && median > 0.0 { median } else { 1.0 }
}

/// BRDF with the green channel of a measured table in all three channels.
pub(super) struct Green<'a>(pub(super) &'a MerlTable);

impl Brdf for Green<'_> {
    fn eval(&self, theta_h: f64, theta_d: f64, phi_d: f64) -> DVec3 {
        DVec3::splat(self.0.eval(theta_h, theta_d, phi_d)[1])
    }

    fn depends_on_phi(&self) -> bool {
        true
    }

    fn envelope(&self) -> BivariateTable {
        self.0.bivariate(1)
    }

    fn tables(&self) -> Option<[BivariateTable; 3]> {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_are_joined_in_order() {
        let grey = |v: f32| Plane::from_fn(2, 3, move |_, _| Vec3::splat(v));
        let both = beside(&[grey(0.1), grey(0.2)]);
        assert_eq!((both.size(), both[(1, 2)].x, both[(2, 0)].x), ((4, 3), 0.1, 0.2));
    }

    #[test]
    fn the_best_colour_is_that_of_the_reference() {
        let shading = |i: usize| 0.5 + i as f32;
        let grey = Picture { rgb: Plane::from_fn(3, 1, |x, _| Vec3::splat(shading(x))), alpha: None };
        let colour = Vec3::new(0.2, 3.0, 0.0);
        let reference = Picture { rgb: Plane::from_fn(3, 1, |x, _| shading(x) * colour), alpha: None };
        let coloured = best_coloured(&grey, &reference);
        for (got, want) in coloured.rgb.as_slice().iter().zip(reference.rgb.as_slice()) {
            assert!((*got - *want).abs().max_element() < 1e-5, "{got} {want}");
        }
    }

    #[test]
    fn the_median_ratio_ignores_highlights() {
        let reference = [2.0, 4.0, 6.0, 8.0, 1000.0];
        assert_eq!(median_ratio(&[1.0, 2.0, 3.0, 4.0, 5.0], &reference), 2.0);
        assert_eq!(median_ratio(&[0.0; 5], &reference), 1.0);
    }
}
