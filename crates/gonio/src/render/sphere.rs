//! Pictures of a sphere, and images of points given by their normals, in orthographic projection.

use glam::DVec3;

use super::Accuracy;
use super::brdf::Brdf;
use super::integrate::{IntegratorSettings, nodes};
use super::linear::envelope;
use super::rows::pictures_of;
use super::shader::{Shader, covered};
use super::tree::LightTree;
use crate::parallel;
use crate::picture::{Picture, luminance};
use crate::reflectance::BivariateTable;
use crate::shape::{Points, SurfacePoint};

/// Settings of the picture of a sphere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SphereSettings {
    /// Width and height of the picture in pixels.
    pub size: usize,
    /// Number of samples along each side of a pixel.
    pub samples: usize,
    /// Accuracy of each sample.
    pub accuracy: Accuracy,
}

/// Width in pixels of the empty margin around the sphere.
const MARGIN: f64 = 2.0;

impl Default for SphereSettings {
    fn default() -> Self {
        Self { size: 256, samples: 1, accuracy: Accuracy::default() }
    }
}

impl SphereSettings {
    /// Returns the radius of the sphere in pixels. Its centre is the centre of the picture.
    pub fn radius(&self) -> f64 {
        (0.5 * self.size as f64 - MARGIN).max(1.0)
    }
}

/// Renders a sphere of one material.
///
/// The colour is radiance on the scale of the light, premultiplied by alpha, which is the coverage;
/// it is black outside. `progress` receives a fraction in 0..=1.
pub fn render_sphere(
    brdf: &dyn Brdf,
    light: &LightTree,
    settings: &SphereSettings,
    progress: &(dyn Fn(f64) + Sync),
) -> Picture {
    render_spheres(&[brdf], light, settings, progress).swap_remove(0)
}

/// Renders a sphere of each material, like [`render_sphere`], which takes less time for many
/// materials than one after the other.
///
/// # Panics
/// If there is no material, or if there are several and one of them depends on `phi_d`.
pub fn render_spheres(
    brdfs: &[&dyn Brdf],
    light: &LightTree,
    settings: &SphereSettings,
    progress: &(dyn Fn(f64) + Sync),
) -> Vec<Picture> {
    let (size, samples, radius) = (settings.size, settings.samples.max(1), settings.radius());
    let shader = Shader::new(brdfs, light, settings.accuracy);
    // Coverage is sampled more finely than radiance, since detection of the sphere depends on its
    // rim.
    let fine = 4 * samples;
    let place = |i: usize, n: usize, at: usize| (at as f64 + (i as f64 + 0.5) / n as f64 - 0.5 * size as f64) / radius;
    let pixel = |x: usize, y: usize| {
        let inside =
            (0..fine * fine).filter(|s| place(s % fine, fine, x).hypot(place(s / fine, fine, y)) < 1.0).count();
        if inside == 0 {
            return (Vec::new(), 0.0);
        }
        let sample = |s: usize| {
            let (a, b) = (place(s % samples, samples, x), -place(s / samples, samples, y));
            // A sample outside the sphere, in a pixel that the sphere covers partly, has the rim's
            // normal.
            let r = a.hypot(b).max(1.0);
            let (a, b) = (a / r, b / r);
            let normal = DVec3::new(a, b, (1.0 - a * a - b * b).max(1e-8).sqrt()).normalize();
            let point = SurfacePoint { normal, view: DVec3::Z };
            shader.radiance(&point)
        };
        let found: Vec<Vec<DVec3>> = (0..samples * samples).map(sample).collect();
        let coverage = inside as f32 / (fine * fine) as f32;
        (covered(&found, coverage), coverage)
    };
    pictures_of(brdfs.len(), (size, size), pixel, progress)
}

/// Returns the luminance of every point for each table, `[point][table]`, under a known light.
///
/// Only the part of `light` that is visible from a point contributes.
pub fn images_of_basis<'a>(
    points: impl Into<Points<'a>>,
    tables: &[BivariateTable],
    light: &LightTree,
    settings: &IntegratorSettings,
    progress: &(dyn Fn(f64) + Sync),
) -> Vec<f32> {
    // All tables share one division of the light, that of their common envelope. The tables are
    // scaled to the same albedo for the envelope, so that a sharp one is resolved even where a
    // broad one reflects a thousand times its light.
    let envelope = envelope(tables);
    let observed = points.into();
    let (points, visibility) = (observed.points(), observed.visibility());
    let done = std::sync::atomic::AtomicUsize::new(0);
    let row = |i: usize| {
        let point = &points[i];
        let mut nodes = nodes(point, &envelope, light, settings);
        if let Some(visibility) = visibility {
            nodes.nodes.iter_mut().for_each(|n| n.weight *= f64::from(visibility.share_along(i, n.direction)));
        }
        let row: Vec<f32> = tables.iter().map(|t| luminance(nodes.radiance(point, t).as_vec3())).collect();
        let finished = done.fetch_add(1, std::sync::atomic::Ordering::Relaxed) + 1;
        if finished.is_multiple_of(256) {
            progress(finished as f64 / points.len() as f64);
        }
        row
    };
    parallel::flat_map_range(points.len(), row)
}
