//! Light of a simulated scene, prefiltered at every scale.

use glam::{DVec3, Vec3};

use super::orbit::{SymmetryLanes, image_of_texel};
use crate::parallel;
use crate::render::pyramid::{LampRule, Pyramid, on_square};

/// Samples along each side of a texel of the finest level.
const SAMPLES: usize = 2;

/// Rule that selects the texels to be treated as lamps.
const LAMPS: LampRule = LampRule { bright: 12.0, most: 1500 };

/// Luminance over all directions, prefiltered, with its images under the symmetries of the disk.
#[derive(Clone, Debug)]
pub struct LightPyramid {
    pub(super) images: Pyramid<SymmetryLanes>,
    /// Direction of each bright texel, and its irradiance on a surface that faces it.
    pub(super) lamps: Vec<(Vec3, f32)>,
}

impl LightPyramid {
    /// Texels along a side of the finest level: 0.8 degrees each, about the resolution of captured
    /// maps.
    pub const FINEST_SIDE: usize = 256;

    /// Builds the pyramid from the luminance by direction.
    pub fn new(luminance: impl Fn(DVec3) -> f64 + Sync) -> Self {
        let side = Self::FINEST_SIDE;
        let step = 1.0 / (side * SAMPLES) as f64;
        let texel = |at: usize| {
            let (x, y) = (at % side, at / side);
            let (mut sum, mut weight) = (0.0, 0.0);
            for i in 0..SAMPLES * SAMPLES {
                let along = |start: usize, i: usize| ((start * SAMPLES + i) as f64 + 0.5) * step;
                let (direction, density) = on_square(along(x, i % SAMPLES), along(y, i / SAMPLES));
                sum += density * luminance(direction);
                weight += density;
            }
            (sum / weight, weight)
        };
        let fine = parallel::map_range(side * side, texel);
        let pyramid = Pyramid::<f32>::of_texels(side, fine, LAMPS);
        Self { images: pyramid.at_images(image_of_texel), lamps: pyramid.lamps().to_vec() }
    }
}

#[cfg(test)]
impl LightPyramid {
    /// Returns the mean luminance of the full light around a direction.
    pub(super) fn towards(&self, direction: DVec3, level: usize) -> f32 {
        use crate::render::pyramid::{Part, Place, half_side};
        self.images.at(Part::All, level, &Place::of(direction.as_vec3(), half_side(Self::FINEST_SIDE, level))).0[0]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::pyramid::whole;
    use crate::sphere::fibonacci_hemisphere;

    #[test]
    fn a_number_is_the_sum_of_its_whole_part_and_its_rest() {
        for i in 0..6000 {
            let x = i as f32 * 0.037;
            let (whole, rest) = whole(x);
            assert!((0.0..=1.0).contains(&rest) && (whole as f32 + rest - x).abs() < 1e-5, "{x} {whole} {rest}");
        }
    }

    #[test]
    fn images_contain_the_light_of_symmetric_directions() {
        use super::super::orbit::image;
        use crate::render::pyramid::{Part, Place, half_side};
        let light = LightPyramid::new(|d| 2.0 + d.y + 0.3 * d.x + 0.5 * d.x * d.z);
        for level in [0, 3, 6] {
            for d in everywhere() {
                let at = Place::of(d.as_vec3(), half_side(LightPyramid::FINEST_SIDE, level));
                let images = light.images.at(Part::All, level, &at).0;
                for (way, got) in images.into_iter().enumerate() {
                    let (x, y) = image(way, (d.x as f32, d.y as f32));
                    let want = light.towards(DVec3::new(f64::from(x), f64::from(y), d.z), level);
                    assert!((got - want).abs() < 1e-5 * want, "{way} {level} {d}: {got} {want}");
                }
            }
        }
    }

    fn everywhere() -> impl Iterator<Item = DVec3> {
        fibonacci_hemisphere(500).flat_map(|n| [n, -n])
    }

    #[test]
    fn smooth_light_is_the_same_at_every_level() {
        let light = |d: DVec3| 2.0 + d.y + 0.5 * d.x * d.z;
        let pyramid = LightPyramid::new(light);
        for (level, bound) in [(0, 3e-3), (2, 8e-3), (4, 0.06)] {
            for d in everywhere() {
                let got = f64::from(pyramid.towards(d, level));
                assert!((got - light(d)).abs() < bound, "{level} {d}: {got} {}", light(d));
            }
        }
    }

    #[test]
    fn a_lamp_keeps_its_power_at_every_level() {
        let lamp = DVec3::new(0.3, 0.5, -0.4).normalize();
        let pyramid = LightPyramid::new(|d| if d.angle_between(lamp) < 0.06 { 1000.0 } else { 0.0 });
        let power = |level: usize| {
            let directions: Vec<DVec3> = fibonacci_hemisphere(400_000).flat_map(|n| [n, -n]).collect();
            let sum: f64 = directions.iter().map(|&d| f64::from(pyramid.towards(d, level))).sum();
            sum / directions.len() as f64
        };
        let want = 1000.0 * 0.5 * (1.0 - 0.06_f64.cos());
        for level in [0, 2, 4, 5] {
            assert!((power(level) / want - 1.0).abs() < 0.12, "{level}: {} {want}", power(level));
        }
    }
}
