//! A matte grey ball.
//!
//! The irradiance is almost a quadratic polynomial of the normal (Ramamoorthi and Hanrahan 2001). A
//! matte ball shows it for all visible normals. The irradiance at the centre of the ball is that of
//! a card that faces the camera. Its mean over the visible surface gives the colour of the light on
//! all visible normals, which may receive light of different colours.

use glam::{DVec3, Vec3};

use super::light::REFLECTANCE_LOG_SD;
use super::patch::{Clipping, MAX_CLIPPED, check_neutral, check_positive, check_reflectance, disk};
use super::{ReferenceError, ReferenceLight};
use crate::picture::{Plane, luminance};
use crate::scene::{Circle, ShadingBasis, is_clipped};
use crate::sphere::fibonacci_hemisphere;
use crate::statistics::median;

/// Smallest number of usable pixels.
const MIN_PIXELS: usize = 100;
/// Radius of the pixels that are used, relative to the outline; pixels at the edge show the
/// background.
const USED_RADIUS: f64 = 0.95;
/// Degree of the polynomials.
const SHADING_DEGREE: usize = 2;
/// Largest residual of the shading, relative to its mean. Light from a single direction leaves 0.08
/// at 60 degrees from the camera, 0.14 at 90 and 0.19 at 110 degrees.
pub(super) const MAX_RESIDUAL: f64 = 0.15;
/// Residual, in multiples of the median one, above which a pixel is ignored, such as dust or a
/// faint highlight. Larger parts of the ball are not ignored, because they shift the first fit and
/// with it the median.
const OUTLIER_FACTOR: f64 = 6.0;
/// Number of normals over which the mean is taken.
const MEAN_NORMALS: usize = 500;

/// Shading of a grey ball.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BallReading {
    /// Radiance at the centre, where the ball faces the camera: linear RGB on the scale of the
    /// photograph.
    pub centre: DVec3,
    /// Mean radiance over the visible surface.
    pub mean: DVec3,
    /// Number of pixels.
    pub pixels: usize,
    /// Number of clipped pixels, which are ignored.
    pub clipped: usize,
    /// Root mean square residual of the luminance from the shading of a matte ball, relative to the
    /// mean luminance.
    pub residual: f64,
}

impl BallReading {
    /// Measures the ball in a photograph.
    ///
    /// `clip` is the radiance at or above which a channel is clipped; without it, the level is
    /// detected in the photograph.
    ///
    /// # Errors
    /// If the ball is not entirely within the photograph, or too few of its pixels are usable. Also
    /// if the ball is not matte, black in a channel, or more coloured than a neutral surface under
    /// captured light.
    pub fn of(rgb: &Plane<Vec3>, circle: &Circle, clip: Option<f32>) -> Result<Self, ReferenceError> {
        disk(rgb.size(), (circle.x, circle.y), circle.radius)?;
        let region = disk(rgb.size(), (circle.x, circle.y), USED_RADIUS * circle.radius)?;
        let inside: Vec<usize> = (0..region.as_slice().len()).filter(|&i| region.as_slice()[i]).collect();
        let pixels: Vec<Vec3> = inside.iter().map(|&i| rgb.as_slice()[i]).collect();
        let level = Clipping::of(rgb, clip).within(&pixels);
        let (mut normals, mut values, mut clipped) = (Vec::new(), Vec::new(), 0);
        for (&i, &pixel) in inside.iter().zip(&pixels) {
            if is_clipped(pixel, level) {
                clipped += 1;
            } else if pixel.is_finite() {
                normals.push(normal(i % rgb.width(), i / rgb.width(), circle));
                values.push(pixel.as_dvec3());
            }
        }
        let share = clipped as f64 / inside.len().max(1) as f64;
        if share > MAX_CLIPPED {
            return Err(ReferenceError::Clipped { share });
        }
        let few = ReferenceError::TooFewPixels { pixels: values.len(), least: MIN_PIXELS };
        if values.len() < MIN_PIXELS {
            return Err(few);
        }
        let basis = ShadingBasis::new(&normals, SHADING_DEGREE);
        let fit = |weights: &[f64]| basis.fit(&values, weights).ok_or_else(|| few.clone());
        let brightness = |value: &DVec3| f64::from(luminance(value.as_vec3()));
        let residuals = |coefficients: &[DVec3]| -> Vec<f64> {
            let shading = basis.values(coefficients);
            values
                .iter()
                .zip(shading)
                .map(|(value, shading)| (brightness(value) - brightness(&shading)).abs())
                .collect()
        };
        let first = residuals(&fit(&vec![1.0; values.len()])?);
        let most = OUTLIER_FACTOR * median(first.iter().copied()).unwrap_or(0.0);
        let weights: Vec<f64> = first.iter().map(|residual| f64::from(u8::from(*residual <= most))).collect();
        let coefficients = fit(&weights)?;
        let over = |normals: &[Vec3]| {
            let shading = ShadingBasis::new(normals, SHADING_DEGREE).values(&coefficients);
            shading.iter().sum::<DVec3>() / normals.len() as f64
        };
        let visible: Vec<Vec3> = fibonacci_hemisphere(MEAN_NORMALS).map(|normal| normal.as_vec3()).collect();
        let (centre, mean) = (over(&[Vec3::Z]), over(&visible));
        check_positive(centre)?;
        check_positive(mean)?;
        let squares = residuals(&coefficients).iter().zip(&weights).map(|(r, weight)| weight * r * r).sum::<f64>();
        let residual = (squares / weights.iter().sum::<f64>()).sqrt() / brightness(&mean);
        if residual.is_nan() || residual > MAX_RESIDUAL {
            return Err(ReferenceError::NotMatte { residual });
        }
        check_neutral(mean)?;
        Ok(Self { centre, mean, pixels: inside.len(), clipped, residual })
    }

    /// Returns the light on the ball, given its diffuse reflectance.
    ///
    /// # Errors
    /// [`ReferenceError::Reflectance`] unless the reflectance is above 0 and at most 1.
    pub fn light(&self, reflectance: f64) -> Result<ReferenceLight, ReferenceError> {
        check_reflectance(reflectance)?;
        let [white, ball] = [self.centre, self.mean].map(|radiance| radiance / reflectance);
        Ok(ReferenceLight { white, ball: Some(ball), log_sd: REFLECTANCE_LOG_SD })
    }
}

/// Returns the normal at the centre of a pixel of a distant ball; y points up.
fn normal(column: usize, row: usize, circle: &Circle) -> Vec3 {
    let x = (column as f64 + 0.5 - circle.x) / circle.radius;
    let y = (circle.y - row as f64 - 0.5) / circle.radius;
    DVec3::new(x, y, (1.0 - x * x - y * y).max(0.0).sqrt()).as_vec3()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::colour::{Chroma, mean_irradiance};
    use crate::lighting::LightGrid;
    use crate::reference::testing::noise;
    use crate::sphere::OctahedralMap;
    use glam::DQuat;

    const CIRCLE: Circle = Circle { x: 60.3, y: 55.8, radius: 40.0 };

    /// A warm lamp from the right above a blue sky.
    fn light() -> LightGrid {
        let side = 32;
        let texel = |t: usize| {
            let direction = LightGrid::direction_of(OctahedralMap::EqualArea, side, t);
            let lamp = if direction.dot(DVec3::new(0.7, 0.5, 0.5).normalize()) > 0.9 { 20.0 } else { 0.0 };
            Vec3::new(1.0, 0.8, 0.5) * lamp + Vec3::new(0.5, 0.8, 1.5) * (1.0 + direction.y as f32)
        };
        LightGrid::from_texels(OctahedralMap::EqualArea, side, (0..side * side).map(texel).collect())
    }

    /// Radiance of a white matte surface of a normal.
    fn white(light: &LightGrid, normal: DVec3) -> DVec3 {
        let sum = |t: usize| {
            let (u, v) = LightGrid::centre_of(light.side(), t);
            let cosine = light.map().direction(u, v).dot(normal).max(0.0);
            light.texels()[t].as_dvec3() * cosine * light.map().density(u, v) * 4.0
        };
        (0..light.texels().len()).map(sum).sum::<DVec3>() / (light.texels().len() as f64 * std::f64::consts::PI)
    }

    /// A ball of a reflectance that depends on the normal, before a dark background.
    fn picture(light: &LightGrid, reflectance: impl Fn(Vec3) -> f32) -> Plane<Vec3> {
        Plane::from_fn(120, 110, |x, y| {
            let inside = (x as f64 + 0.5 - CIRCLE.x).hypot(y as f64 + 0.5 - CIRCLE.y) < CIRCLE.radius;
            let normal = normal(x, y, &CIRCLE);
            let radiance = if inside { white(light, normal.as_dvec3()).as_vec3() } else { Vec3::splat(0.05) };
            radiance * reflectance(normal) * (1.0 + 0.03 * noise(x, y))
        })
    }

    #[test]
    fn measures_the_light_at_the_centre_and_on_the_whole_ball() {
        let light = light();
        let mut grey = picture(&light, |_| 0.18);
        grey[(60, 40)] = Vec3::splat(1e3);
        grey[(61, 60)] = Vec3::splat(f32::NAN);
        let found = BallReading::of(&grey, &CIRCLE, None).unwrap().light(0.18).unwrap();
        let mean = mean_irradiance(&light, DQuat::IDENTITY) / std::f64::consts::PI;
        for (found, truth) in [(found.white, white(&light, DVec3::Z)), (found.ball.unwrap(), mean)] {
            assert!((found / truth - 1.0).abs().max_element() < 0.02, "{found} {truth}");
        }
        // The lamp colours the right side only: the chroma is that of the whole ball.
        assert!(found.chroma().distance(Chroma::of(mean)) < 0.01);
        assert!((found.scale(&light).unwrap().factor - 1.0).abs() < 0.02);
    }

    #[test]
    fn rejects_balls_that_are_not_matte_and_grey() {
        let light = light();
        let of = |reflectance: &dyn Fn(Vec3) -> f32| BallReading::of(&picture(&light, reflectance), &CIRCLE, None);
        let striped = of(&|n| if (6.0 * n.x).sin() > 0.0 { 0.3 } else { 0.1 }).unwrap_err();
        assert!(matches!(striped, ReferenceError::NotMatte { residual, .. } if residual > 0.2), "{striped}");
        assert_eq!(of(&|_| 0.0).unwrap_err(), ReferenceError::Black { channel: "red" });
        let outside = Circle { x: 20.0, ..CIRCLE };
        let grey = picture(&light, |_| 0.18);
        assert!(matches!(BallReading::of(&grey, &outside, None), Err(ReferenceError::Outside { .. })));
        let small = Circle { radius: 5.0, ..CIRCLE };
        assert!(matches!(BallReading::of(&grey, &small, None), Err(ReferenceError::TooFewPixels { .. })));
        let clipped = grey.map(|pixel| pixel.min(Vec3::splat(0.3)));
        assert!(matches!(BallReading::of(&clipped, &CIRCLE, Some(0.3)), Err(ReferenceError::Clipped { .. })));
        let red = grey.map(|pixel| *pixel * Vec3::new(1.0, 0.1, 0.1));
        assert!(matches!(BallReading::of(&red, &CIRCLE, None), Err(ReferenceError::NotNeutral { .. })));
    }
}
