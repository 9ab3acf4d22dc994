//! The sphere that estimates are relit on, and its small pictures.

use glam::{DVec3, Vec3};
use gonio::picture::Plane;
use gonio::reflectance::BivariateTable;
use gonio::render::{Exposure, Relighter};
use gonio::shape::SurfacePoint;
use rayon::prelude::*;

use crate::metrics::{Relight, mean, relight};

/// Pixels of an orthographic picture that show a sphere.
pub(crate) struct TestSphere {
    size: usize,
    /// Index of each pixel in the picture.
    pixels: Vec<usize>,
    /// Surface point at the centre of each pixel.
    pub(crate) points: Vec<SurfacePoint>,
    /// Whether the normal of each point is within 80 degrees of the view, where errors are
    /// measured.
    counted: Vec<bool>,
}

/// Background colour, sRGB.
const BACKGROUND: [u8; 3] = [28, 29, 32];

impl TestSphere {
    /// Builds a sphere that fills a picture of `size` by `size` pixels.
    pub(crate) fn new(size: usize) -> Self {
        let radius = 0.5 * size as f64 - 0.5;
        let (mut pixels, mut points) = (Vec::new(), Vec::new());
        for i in 0..size * size {
            let x = ((i % size) as f64 + 0.5 - 0.5 * size as f64) / radius;
            let y = -((i / size) as f64 + 0.5 - 0.5 * size as f64) / radius;
            let rest = 1.0 - x * x - y * y;
            if rest > 0.003 {
                pixels.push(i);
                points.push(SurfacePoint { normal: DVec3::new(x, y, rest.sqrt()), view: DVec3::Z });
            }
        }
        let limit = 80.0_f64.to_radians().cos();
        let counted = points.iter().map(|p| p.normal.z > limit).collect();
        Self { size, pixels, points, counted }
    }

    /// Returns the values of the pixels that errors are measured over.
    pub(crate) fn counted<T: Copy>(&self, values: &[T]) -> Vec<T> {
        values.iter().zip(&self.counted).filter(|(_, counted)| **counted).map(|(v, _)| *v).collect()
    }

    /// Renders an estimate and the truth in several lights; returns the means of the relight errors
    /// and of their log versions.
    pub(crate) fn mean_errors(
        &self,
        lights: &[Relighter],
        made: &BivariateTable,
        truth: &BivariateTable,
    ) -> (f64, f64) {
        let error =
            |light: &Relighter| relight(&self.counted(&light.render(made)), &self.counted(&light.render(truth)));
        let errors: Vec<Relight> = lights.iter().map(error).collect();
        let over = |part: fn(&Relight) -> f64| mean(&errors.iter().map(part).collect::<Vec<_>>());
        (over(|error| error.relative), over(|error| error.log))
    }

    /// Returns the exposure for a sphere with these values.
    pub(crate) fn exposure(&self, values: &[f64]) -> Exposure {
        let plane = Plane::from_vec(values.len(), 1, values.iter().map(|v| Vec3::splat(*v as f32)).collect());
        Exposure::by_quantile(&plane, |_| true, 0.97, 0.8)
    }

    /// Encodes `scale` times linear RGB values as a PNG file.
    pub(crate) fn png(&self, values: &[Vec3], scale: f64, exposure: Exposure) -> Vec<u8> {
        let mut out: Vec<u8> = BACKGROUND.repeat(self.size * self.size);
        for (&pixel, value) in self.pixels.iter().zip(values) {
            let shown = exposure.apply(*value * scale as f32);
            for (byte, linear) in out[3 * pixel..][..3].iter_mut().zip(shown.to_array()) {
                *byte = (gonio::picture::srgb_encode(linear) * 255.0).round() as u8;
            }
        }
        gonio_io::picture::encode_png_srgb8(self.size, self.size, &out)
    }

    /// Returns for each pixel the index of the nearest of `others`, points of the visible
    /// hemisphere. With it, values at those points can be shown as a picture.
    pub(crate) fn nearest(&self, others: &[SurfacePoint]) -> Vec<usize> {
        let nearest = |p: &SurfacePoint| {
            let closeness = |i: &usize| others[*i].normal.dot(p.normal);
            (0..others.len()).max_by(|a, b| closeness(a).total_cmp(&closeness(b))).unwrap_or(0)
        };
        self.points.par_iter().map(nearest).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sphere_fills_the_picture() {
        let stage = TestSphere::new(64);
        let share = stage.points.len() as f64 / (64.0 * 64.0);
        assert!((share - std::f64::consts::FRAC_PI_4).abs() < 0.05, "{share}");
        assert!(stage.points.iter().all(|p| (p.normal.length() - 1.0).abs() < 1e-9));
        let counted = stage.counted(&vec![1.0; stage.points.len()]).len() as f64;
        let expected = 80.0_f64.to_radians().sin().powi(2);
        assert!((counted / stage.points.len() as f64 - expected).abs() < 0.03);
    }

    #[test]
    fn each_point_is_nearest_to_itself() {
        let stage = TestSphere::new(16);
        assert_eq!(stage.nearest(&stage.points), (0..stage.points.len()).collect::<Vec<_>>());
    }
}
