//! A surface of any shape, with self-shadowing.

use glam::DVec3;

use super::Accuracy;
use super::brdf::Brdf;
use super::integrate::Nodes;
use super::rows::pictures_of;
use super::shader::{Shader, covered};
use super::tree::LightTree;
use crate::picture::Picture;
use crate::reflectance::BivariateTable;
use crate::shape::SurfacePoint;
use crate::shape::{Camera, Hit, Surface};

/// Fraction of the reflected light whose directions are tested by rays, strongest first.
///
/// The rest is assumed to be blocked in the same proportion.
const RAY_TESTED_SHARE: f64 = 0.995;

/// Largest radius (radians) of the cells into which light that may be blocked is divided.
pub(super) const PENUMBRA: f64 = 0.04;

/// Number of rays along each side of a pixel that determine its coverage.
const COVERAGE: usize = 4;

/// Settings of the picture of a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceSettings {
    /// Number of samples along each side of a pixel.
    pub samples: usize,
    /// Accuracy of each sample.
    pub accuracy: Accuracy,
    /// Whether to render self-shadowing. Interreflections are never rendered.
    pub shadows: bool,
}

impl Default for SurfaceSettings {
    fn default() -> Self {
        Self { samples: 1, accuracy: Accuracy::default(), shadows: true }
    }
}

/// Renders a surface of one material in distant light.
///
/// The colour is radiance on the scale of the light, premultiplied by alpha, which is the coverage;
/// it is black outside. The light is in camera coordinates. `progress` receives a fraction in
/// 0..=1.
pub fn render_surface(
    brdf: &dyn Brdf,
    light: &LightTree,
    surface: &dyn Surface,
    camera: &Camera,
    settings: &SurfaceSettings,
    progress: &(dyn Fn(f64) + Sync),
) -> Picture {
    render_surfaces(&[brdf], light, surface, camera, settings, progress).swap_remove(0)
}

/// Renders a surface of each material, like [`render_surface`], which takes less time for many
/// materials than one after the other.
///
/// # Panics
/// If there is no material, or if there are several and one of them depends on `phi_d`.
pub fn render_surfaces(
    brdfs: &[&dyn Brdf],
    light: &LightTree,
    surface: &dyn Surface,
    camera: &Camera,
    settings: &SurfaceSettings,
    progress: &(dyn Fn(f64) + Sync),
) -> Vec<Picture> {
    let shader = Shader::new(brdfs, light, settings.accuracy);
    let shadows = settings.shadows && !surface.is_convex();
    let samples = settings.samples.max(1);
    let shade = |hit: &Hit, view: DVec3| {
        let point = SurfacePoint { normal: hit.normal, view }.facing();
        if shadows {
            shader.shadowed(&point, |directions| surface.blocked(hit.ray_origin, directions))
        } else {
            shader.radiance(&point)
        }
    };
    let pixel = |x: usize, y: usize| {
        let ray = |s: usize, n: usize| {
            let at = |i: usize, from: usize| from as f64 + (i as f64 + 0.5) / n as f64;
            camera.ray((at(s % n, x), at(s / n, y)))
        };
        let inside = (0..COVERAGE * COVERAGE).filter(|&s| surface.hit(&ray(s, COVERAGE)).is_some()).count();
        let hits = (0..samples * samples).filter_map(|s| {
            let ray = ray(s, samples);
            surface.hit(&ray).map(|hit| (hit, -ray.direction))
        });
        let mut hits: Vec<(Hit, DVec3)> = hits.collect();
        if hits.is_empty() && inside > 0 {
            // All samples miss the surface, but coverage rays hit it: one of these hits represents
            // the pixel.
            let any = (0..COVERAGE * COVERAGE).map(|s| ray(s, COVERAGE));
            hits.extend(any.filter_map(|ray| surface.hit(&ray).map(|hit| (hit, -ray.direction))).take(1));
        }
        if hits.is_empty() {
            return (Vec::new(), 0.0);
        }
        let found: Vec<Vec<DVec3>> = hits.iter().map(|(hit, view)| shade(hit, *view)).collect();
        let coverage = inside as f32 / (COVERAGE * COVERAGE) as f32;
        (covered(&found, coverage), coverage)
    };
    pictures_of(brdfs.len(), camera.size, pixel, progress)
}

impl Nodes {
    /// Removes the light that is blocked.
    ///
    /// The strongest directions, which carry nearly all light that `envelope` reflects, are tested;
    /// the others lose the same fraction.
    pub fn shadow(&mut self, envelope: &BivariateTable, blocked: impl Fn(&[DVec3]) -> Vec<bool>) {
        let strength: Vec<f64> =
            self.nodes.iter().map(|n| envelope.eval(n.theta_h, n.theta_d) * n.weight.abs().max_element()).collect();
        let blocked = |tested: &[usize]| {
            let directions: Vec<DVec3> = tested.iter().map(|&i| self.nodes[i].direction).collect();
            blocked(&directions)
        };
        let shares = open_shares(&strength, blocked);
        self.nodes.iter_mut().zip(shares).for_each(|(node, open)| node.weight *= open);
        self.nodes.retain(|n| n.weight != DVec3::ZERO);
    }
}

/// Returns the fraction of each direction's light that arrives.
///
/// `strength` contains the light reflected from each direction. `blocked` receives the indices of
/// the directions to test, in ascending order. See [`Nodes::shadow`].
pub(super) fn open_shares(strength: &[f64], blocked: impl FnOnce(&[usize]) -> Vec<bool>) -> Vec<f64> {
    let total: f64 = strength.iter().sum();
    let mut order: Vec<usize> = (0..strength.len()).collect();
    order.sort_by(|&a, &b| strength[b].total_cmp(&strength[a]));
    let (mut covered, mut count) = (0.0, 0);
    while count < order.len() && covered < RAY_TESTED_SHARE * total {
        covered += strength[order[count]];
        count += 1;
    }
    let mut tested = order[..count].to_vec();
    tested.sort_unstable();
    let mut open = 0.0;
    let mut shares = vec![1.0; strength.len()];
    for (&i, blocked) in tested.iter().zip(blocked(&tested)) {
        if blocked {
            shares[i] = 0.0;
        } else {
            open += strength[i];
        }
    }
    let left = if covered > 0.0 { open / covered } else { 1.0 };
    order[count..].iter().for_each(|&i| shares[i] = left);
    shares
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::super::{IntegratorSettings, SphereSettings, render_sphere};
    use super::*;
    use crate::shape::{BuiltInShape, Ellipsoid, Projection, Tracer, hit_at};
    use crate::testing::environment_map;

    fn light(f: impl Fn(DVec3) -> f64) -> LightTree {
        LightTree::of_map(&environment_map(128, f))
    }

    fn lobe() -> BivariateTable {
        BivariateTable::from_fn(|h, _| 0.1 + 2.0 / (1.0 + (h / 0.2_f64).powi(2)).powi(2))
    }

    #[test]
    fn ellipsoid_of_equal_axes_matches_the_sphere() {
        let light = light(|d| 2.0 + d.y + 0.5 * d.x);
        let flat = SphereSettings { size: 24, ..SphereSettings::default() };
        let want = render_sphere(&lobe(), &light, &flat, &|_| ());
        let projection = Projection::Orthographic { pixels_per_unit: flat.radius() };
        let camera = Camera::new(projection, (12.0, 12.0), (24, 24)).unwrap();
        let ball = Ellipsoid::sphere(DVec3::new(0.0, 0.0, -3.0), 1.0).unwrap();
        let got = render_surface(&lobe(), &light, &ball, &camera, &SurfaceSettings::default(), &|_| ());
        let alpha = |p: &Picture, at| p.alpha.as_ref().unwrap()[at];
        for at in (0..24).flat_map(|y| (0..24).map(move |x| (x, y))) {
            assert!((alpha(&got, at) - alpha(&want, at)).abs() < 0.1, "{at:?}");
            if alpha(&want, at) == 1.0 {
                assert!((got.rgb[at] - want.rgb[at]).length() < 2e-3 * want.rgb[at].length(), "{at:?}");
            }
        }
    }

    /// A bowl before a camera with `size` x `size` pixels.
    fn bowl(size: usize) -> (Tracer, Camera) {
        let bowl = Tracer::new(BuiltInShape::Bowl.mesh(24).unwrap());
        let (centre, radius) = bowl.bounds();
        let camera = Camera::framing(centre, radius, (size, size), 0.05).unwrap();
        (Tracer::new(bowl.mesh().transformed(&camera.to_world.inverse()).unwrap()), camera)
    }

    /// All materials share the half vectors, whose error is about half a percent.
    #[test]
    fn materials_rendered_together_match_single_renderings() {
        let light = light(|d| 2.0 + d.y + if d.x > 0.8 { 20.0 } else { 0.0 });
        let (bowl, camera) = bowl(16);
        let tables = [lobe(), BivariateTable::from_fn(|_, _| 0.3)];
        let brdfs: Vec<&dyn Brdf> = tables.iter().map(|table| table as &dyn Brdf).collect();
        for accuracy in [Accuracy::Bound(IntegratorSettings::default()), Accuracy::default()] {
            let settings = SurfaceSettings { accuracy, ..SurfaceSettings::default() };
            let together = render_surfaces(&brdfs, &light, &bowl, &camera, &settings, &|_| ());
            for (brdf, got) in brdfs.iter().zip(&together) {
                let want = render_surface(*brdf, &light, &bowl, &camera, &settings, &|_| ());
                assert_eq!(got.alpha, want.alpha);
                let (mut error, mut all) = (0.0, 0.0);
                for (a, b) in got.rgb.as_slice().iter().zip(want.rgb.as_slice()) {
                    error += (*a - *b).length_squared();
                    all += b.length_squared();
                }
                assert!(all > 0.0 && (error / all).sqrt() < 0.02, "{}", (error / all).sqrt());
            }
        }
    }

    #[test]
    fn shadows_match_many_rays() {
        let fine = IntegratorSettings { tolerance: 0.05, ..IntegratorSettings::default() };
        for accuracy in [Accuracy::Bound(fine), Accuracy::default()] {
            check_shadows(accuracy);
        }
    }

    fn check_shadows(accuracy: Accuracy) {
        // The radiance of a white Lambertian surface in uniform light is the cosine-weighted
        // fraction of unblocked directions.
        let white = BivariateTable::from_fn(|_, _| 1.0 / PI);
        let (bowl, world) = bowl(12);
        let even = light(|_| 1.0);
        let settings = SurfaceSettings { accuracy, ..SurfaceSettings::default() };
        let got = render_surface(&white, &even, &bowl, &world, &settings, &|_| ());
        let mut darkest = 1.0_f64;
        for (x, y) in (0..12).flat_map(|y| (0..12).map(move |x| (x, y))) {
            let Some(hit) = hit_at(&bowl, &world, x, y) else { continue };
            let (rings, spokes) = (40, 80);
            let (tangent, other) = hit.normal.any_orthonormal_pair();
            let directions = (0..rings * spokes).map(|i| {
                // Samples are uniform in cosine times solid angle.
                let (s, c) = (((i % rings) as f64 + 0.5) / rings as f64).sqrt().asin().sin_cos();
                let (a, b) = (2.0 * PI * ((i / rings) as f64 + 0.5) / spokes as f64).sin_cos();
                s * (a * tangent + b * other) + c * hit.normal
            });
            let directions: Vec<DVec3> = directions.collect();
            let free = bowl.blocked(hit.ray_origin, &directions).into_iter().filter(|blocked| !blocked);
            let want = free.count() as f64 / (rings * spokes) as f64;
            let alpha = f64::from(got.alpha.as_ref().unwrap()[(x, y)]);
            let value = f64::from(got.rgb[(x, y)].x) / alpha;
            darkest = darkest.min(want);
            assert!((value - want).abs() < 0.02, "{x} {y}: {value} {want}");
        }
        assert!(darkest < 0.7, "{darkest}");
    }
}
