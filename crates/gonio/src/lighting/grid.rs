//! Light on an octahedral grid: a piecewise constant function in the span of the Haar basis.

use glam::{DVec3, Vec3};

use crate::picture::{Plane, luminance};
use crate::sphere::{Haar, OctahedralMap, direction_of_lat_long};

/// Smallest number of directions along the height of a lat-long picture, for each texel along a
/// side.
const SAMPLED: usize = 4;

/// Radiance on the `side * side` texels of an octahedral map, row-major, row 0 at the top (`v` near
/// 1, the sky).
#[derive(Clone, Debug, PartialEq)]
pub struct LightGrid {
    map: OctahedralMap,
    side: usize,
    texels: Vec<Vec3>,
}

impl LightGrid {
    /// Wraps `side * side` texels.
    ///
    /// # Panics
    /// If there are not `side * side` texels or `side` is not a power of two, at least 2.
    pub fn from_texels(map: OctahedralMap, side: usize, texels: Vec<Vec3>) -> Self {
        assert!(Haar::new(side).is_some(), "the side of a light grid must be a power of two, not {side}");
        assert_eq!(texels.len(), side * side);
        Self { map, side, texels }
    }

    /// Multiplies every texel by a colour.
    pub fn coloured(&self, colour: Vec3) -> Self {
        Self::from_texels(self.map, self.side, self.texels.iter().map(|texel| *texel * colour).collect())
    }

    /// Creates a grey light from its wavelet coefficients (see [`Self::coefficients`]).
    ///
    /// # Panics
    /// If the number of coefficients is not the square of a power of two.
    pub fn from_coefficients(map: OctahedralMap, coefficients: &[f64]) -> Self {
        let side = coefficients.len().isqrt();
        let haar = Haar::new(side).expect("the number of coefficients is the square of a power of two");
        let scale = 1.0 / Self::texel_measure(side).sqrt();
        let mut values: Vec<f32> = coefficients.iter().map(|&l| (l * scale) as f32).collect();
        haar.inverse(&mut values, &mut Vec::new());
        Self::from_texels(map, side, values.into_iter().map(Vec3::splat).collect())
    }

    /// Sets negative values to zero. In single precision, the inverse transform turns zeros into
    /// small values of either sign.
    pub(crate) fn non_negative(mut self) -> Self {
        self.texels.iter_mut().for_each(|texel| *texel = texel.max(Vec3::ZERO));
        self
    }

    /// Divides the texels into those of a finer grid.
    ///
    /// # Panics
    /// If the side is not a power of two, or smaller than that of the grid.
    pub(crate) fn divided(&self, side: usize) -> Self {
        assert!(side >= self.side, "{side} texels per side out of {}", self.side);
        let texel = |t: usize| self.texels[Self::coarser_texel(side, self.side, t)];
        Self::from_texels(self.map, side, (0..side * side).map(texel).collect())
    }

    /// Returns the means over the texels of a coarser grid.
    ///
    /// # Panics
    /// If the side is not a power of two, or larger than that of the grid.
    pub fn reduced(&self, side: usize) -> Self {
        assert!(side <= self.side, "{side} texels per side out of {}", self.side);
        let wide = self.side / side;
        let mut texels = vec![Vec3::ZERO; side * side];
        for (t, texel) in self.texels.iter().enumerate() {
            texels[Self::coarser_texel(self.side, side, t)] += *texel / (wide * wide) as f32;
        }
        Self::from_texels(self.map, side, texels)
    }

    /// Layout of the sphere on the square.
    pub fn map(&self) -> OctahedralMap {
        self.map
    }

    /// Texels along a side.
    pub fn side(&self) -> usize {
        self.side
    }

    /// All texels, row-major from the top.
    pub fn texels(&self) -> &[Vec3] {
        &self.texels
    }

    /// Returns the measure of one texel, of a total of 4 pi: its solid angle on the equal-area map.
    pub(crate) fn texel_measure(side: usize) -> f64 {
        4.0 * std::f64::consts::PI / (side * side) as f64
    }

    /// Centre `(u, v)` of a texel on the square -1..1.
    pub(crate) fn centre_of(side: usize, texel: usize) -> (f64, f64) {
        let at = |i: usize| (2 * i + 1) as f64 / side as f64 - 1.0;
        (at(texel % side), -at(texel / side))
    }

    /// Returns the unit direction of the centre of a texel.
    pub(crate) fn direction_of(map: OctahedralMap, side: usize, texel: usize) -> DVec3 {
        let (u, v) = Self::centre_of(side, texel);
        map.direction(u, v)
    }

    /// Returns the texel of a grid of `coarse` texels per side that contains texel `t` of one with
    /// `side`.
    pub(crate) fn coarser_texel(side: usize, coarse: usize, t: usize) -> usize {
        let wide = side / coarse;
        (t / side / wide) * coarse + t % side / wide
    }

    /// Returns the index of the texel that contains a unit direction.
    pub(crate) fn texel_of(map: OctahedralMap, side: usize, direction: DVec3) -> usize {
        let (u, v) = map.square(direction);
        let cell = |x: f64| ((0.5 * (x + 1.0) * side as f64) as usize).min(side - 1);
        cell(-v) * side + cell(u)
    }

    /// Returns the radiance of the texel that contains a unit direction.
    pub fn at(&self, direction: DVec3) -> Vec3 {
        self.texels[Self::texel_of(self.map, self.side, direction)]
    }

    /// Returns the integral over the square in the measure of `texel_measure`.
    ///
    /// On the equal-area map, this is the integral over the sphere.
    pub fn integral(&self) -> DVec3 {
        self.texels.iter().map(|t| t.as_dvec3()).sum::<DVec3>() * Self::texel_measure(self.side)
    }

    /// Returns the Haar coefficients of the luminance.
    ///
    /// They are `l_m = sum_t L_t h_m(t) sqrt(measure)`, where `h_m` are the orthonormal wavelets of
    /// the grid, so that the basis is orthonormal in the measure of `texel_measure`. Coarse
    /// coefficients do not depend on the side of the grid.
    pub fn coefficients(&self) -> Vec<f64> {
        let mut values: Vec<f32> = self.texels.iter().map(|&t| luminance(t)).collect();
        Haar::new(self.side).expect("checked at construction").forward(&mut values, &mut Vec::new());
        let scale = Self::texel_measure(self.side).sqrt();
        values.into_iter().map(|x| f64::from(x) * scale).collect()
    }

    /// DC coefficient of every light whose integral is one: `1 / sqrt(4 pi)`.
    pub fn normalised_dc() -> f64 {
        (4.0 * std::f64::consts::PI).sqrt().recip()
    }

    /// Returns the Haar coefficients of the luminance, scaled to an integral of one.
    ///
    /// `l[0]` is `normalised_dc`. Returns `None` if the light is black.
    pub fn normalised_coefficients(&self) -> Option<Vec<f64>> {
        let mut l = self.coefficients();
        let scale = Self::normalised_dc() / l[0];
        if !(scale.is_finite() && scale > 0.0) {
            return None;
        }
        l.iter_mut().for_each(|x| *x *= scale);
        l[0] = Self::normalised_dc();
        Some(l)
    }

    /// Returns the light as a lat-long picture of `2 height` by `height`.
    ///
    /// If the texels are not much larger than the pixels, each pixel is the mean over several
    /// directions, so that small lamps keep their energy.
    pub fn to_lat_long(&self, height: usize) -> Plane<Vec3> {
        let samples = (SAMPLED * self.side).div_ceil(height);
        let at = |i: usize, k: usize| i as f64 + (k as f64 + 0.5) / samples as f64;
        Plane::from_fn(2 * height, height, |x, y| {
            let mut sum = Vec3::ZERO;
            for k in 0..samples * samples {
                let (u, v) = (at(x, k % samples) / (2 * height) as f64, at(y, k / samples) / height as f64);
                sum += self.at(direction_of_lat_long(u, v));
            }
            sum / (samples * samples) as f32
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp(side: usize) -> LightGrid {
        let texels = (0..side * side).map(|t| Vec3::splat(1.0 + (t * 7 % 13) as f32)).collect();
        LightGrid::from_texels(OctahedralMap::EqualArea, side, texels)
    }

    #[test]
    fn small_lamps_keep_their_energy_in_lat_long_pictures() {
        for lamp in [20 * 128 + 70, 64 * 128 + 64, 100 * 128 + 3] {
            let texels = (0..128 * 128).map(|t| Vec3::splat(if t == lamp { 1000.0 } else { 0.0 })).collect();
            let light = LightGrid::from_texels(OctahedralMap::EqualArea, 128, texels);
            for height in [64, 128] {
                let picture = light.to_lat_long(height);
                let mut sum = 0.0;
                for y in 0..height {
                    let row: f64 = (0..2 * height).map(|x| f64::from(picture[(x, y)].x)).sum();
                    sum += row * (std::f64::consts::PI * (y as f64 + 0.5) / height as f64).sin();
                }
                let integral = sum * (std::f64::consts::PI / height as f64).powi(2);
                assert!((integral / light.integral().x - 1.0).abs() < 0.15, "{lamp} {height} {integral}");
            }
        }
    }

    #[test]
    fn means_of_divided_texels_are_the_texels() {
        let light = ramp(8);
        let fine = light.divided(32);
        assert_eq!((fine.side(), fine.reduced(8), fine.at(DVec3::Y)), (32, light.clone(), light.at(DVec3::Y)));
        let (all, halved) = (fine.integral(), light.reduced(4).integral());
        assert!((all - light.integral()).length() < 1e-4 && (halved - all).length() < 1e-4);
        // The Haar coefficients of a coarser grid come first.
        let (coarse, some) = (light.reduced(4).coefficients(), light.coefficients());
        assert!(coarse.iter().zip(&some).all(|(a, b)| (a - b).abs() < 1e-5));
    }

    #[test]
    fn rounding_leaves_no_negative_texels() {
        let texels = (0..256).map(|i| Vec3::splat(if i % 3 == 0 { 7.3 * i as f32 } else { 0.0 })).collect();
        let light = LightGrid::from_texels(OctahedralMap::EqualArea, 16, texels);
        let rounded = LightGrid::from_coefficients(light.map(), &light.coefficients());
        assert!(rounded.texels().iter().any(|texel| texel.x < 0.0));
        assert!(rounded.non_negative().texels().iter().all(|texel| texel.x >= 0.0));
    }

    #[test]
    fn coefficients_round_trip() {
        let light = ramp(32);
        let back = LightGrid::from_coefficients(light.map(), &light.coefficients());
        for (a, b) in light.texels().iter().zip(back.texels()) {
            assert!((*a - *b).abs().max_element() < 1e-4);
        }
    }

    #[test]
    fn dc_of_a_normalised_light_is_a_constant() {
        let l = ramp(16).normalised_coefficients().unwrap();
        assert_eq!(l[0], (4.0 * std::f64::consts::PI).sqrt().recip());
        let light = LightGrid::from_coefficients(OctahedralMap::PraunHoppe, &l);
        assert!((light.integral().x - 1.0).abs() < 1e-6);
    }

    #[test]
    fn texel_centres_lie_in_their_texels() {
        for map in [OctahedralMap::EqualArea, OctahedralMap::PraunHoppe] {
            for texel in 0..256 {
                assert_eq!(LightGrid::texel_of(map, 16, LightGrid::direction_of(map, 16, texel)), texel);
            }
        }
        let (_, v) = LightGrid::centre_of(16, 3);
        assert!(v > 0.9, "row 0 is the top");
    }
}
