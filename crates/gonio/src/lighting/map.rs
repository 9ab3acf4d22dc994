//! Environment maps: lat-long pictures of radiance.

use glam::{DQuat, DVec3, Vec3};
use thiserror::Error;

use super::LightGrid;
use crate::parallel;
use crate::picture::{Plane, luminance};
use crate::sphere::{OctahedralMap, direction_of_lat_long, lat_long_of_direction, lat_long_solid_angle};

/// Error in an environment map.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum MapError {
    /// The picture is not twice as wide as it is high.
    #[error("a lat-long map must be twice as wide as high, but this image is {0}x{1} pixels")]
    Shape(usize, usize),
    /// Pixels are negative, NaN or infinite.
    #[error("{count} pixels are negative, NaN or infinite, the first at column {column}, row {row}")]
    BadPixels {
        /// Number of such pixels.
        count: usize,
        /// Column of the first.
        column: usize,
        /// Row of the first.
        row: usize,
    },
    /// The map is black.
    #[error("the map is black everywhere")]
    Black,
}

/// Radiance from all directions as a lat-long map, constant within each pixel.
///
/// Row 0 is +y, the centre is -z, and the right half is +x (see [`direction_of_lat_long`]).
#[derive(Clone, Debug, PartialEq)]
pub struct EnvironmentMap {
    radiance: Plane<Vec3>,
}

impl EnvironmentMap {
    /// Wraps a lat-long picture of linear radiance.
    ///
    /// # Errors
    /// If it is not twice as wide as high, has negative or non-finite pixels, or is black.
    pub fn new(radiance: Plane<Vec3>) -> Result<Self, MapError> {
        let (width, height) = radiance.size();
        if width != 2 * height || height == 0 {
            return Err(MapError::Shape(width, height));
        }
        let is_bad = |p: &&Vec3| !(p.is_finite() && p.min_element() >= 0.0);
        let count = radiance.as_slice().iter().filter(is_bad).count();
        if let Some(first) = radiance.as_slice().iter().position(|p| is_bad(&p)) {
            return Err(MapError::BadPixels { count, column: first % width, row: first / width });
        }
        if radiance.as_slice().iter().all(|p| *p == Vec3::ZERO) {
            return Err(MapError::Black);
        }
        Ok(Self { radiance })
    }

    /// Creates a map of `rows` rows with light from single directions, one pixel each.
    ///
    /// Each direction is paired with the irradiance of a surface facing it.
    ///
    /// # Errors
    /// If there is no light.
    pub fn of_directions(lights: &[(DVec3, Vec3)], rows: usize) -> Result<Self, MapError> {
        let (width, height) = (2 * rows, rows);
        let mut map = Plane::from_vec(width, height, vec![Vec3::ZERO; width * height]);
        for (direction, irradiance) in lights {
            let (u, v) = lat_long_of_direction(*direction);
            let (x, y) = (((u * width as f64) as usize).min(width - 1), ((v * height as f64) as usize).min(height - 1));
            map[(x, y)] += *irradiance / lat_long_solid_angle(y, height) as f32;
        }
        Self::new(map)
    }

    /// Returns the picture, `2 h` by `h`.
    pub fn radiance(&self) -> &Plane<Vec3> {
        &self.radiance
    }

    /// Returns the radiance of the pixel that contains a direction.
    pub fn at(&self, direction: DVec3) -> Vec3 {
        let (width, height) = self.radiance.size();
        let (u, v) = lat_long_of_direction(direction);
        self.radiance[(((u * width as f64) as usize).min(width - 1), ((v * height as f64) as usize).min(height - 1))]
    }

    /// Returns the map rotated about the vertical axis: column `x` moves to column `x + columns`.
    pub fn shifted_columns(&self, columns: usize) -> Self {
        let (width, height) = self.radiance.size();
        let columns = columns % width;
        Self { radiance: Plane::from_fn(width, height, |x, y| self.radiance[((x + width - columns) % width, y)]) }
    }

    /// Returns a map of at most `rows` rows; each pixel is the mean of those that it covers.
    pub fn reduced(&self, rows: usize) -> Self {
        let (width, height) = self.radiance.size();
        if height <= rows {
            return self.clone();
        }
        let range = |at: usize, whole: usize, parts: usize| at * whole / parts..(at + 1) * whole / parts;
        let weights: Vec<f32> = (0..height).map(|y| lat_long_solid_angle(y, height) as f32).collect();
        let mean = |x: usize, y: usize| {
            let (mut sum, mut total) = (Vec3::ZERO, 0.0);
            for row in range(y, height, rows) {
                for column in range(x, width, 2 * rows) {
                    sum += weights[row] * self.radiance[(column, row)];
                    total += weights[row];
                }
            }
            sum / total
        };
        Self { radiance: Plane::from_fn(2 * rows, rows, mean) }
    }

    /// Returns the rotated map; each pixel is the mean of four bilinear samples.
    pub fn rotated(&self, turn: DQuat) -> Self {
        let (width, height) = self.radiance.size();
        let (w, h) = (width as f64, height as f64);
        let sample = |direction: DVec3| {
            let (u, v) = lat_long_of_direction(direction);
            let (x, y) = (u * w - 0.5, (v * h - 0.5).clamp(0.0, h - 1.0));
            let (s, t) = ((x - x.floor()) as f32, (y - y.floor()) as f32);
            let (x, y) = (x.floor() as isize, y as usize);
            let column = |x: isize| x.rem_euclid(width as isize) as usize;
            let at = |y: usize| {
                let y = y.min(height - 1);
                self.radiance[(column(x), y)].lerp(self.radiance[(column(x + 1), y)], s)
            };
            at(y).lerp(at(y + 1), t)
        };
        let back = turn.inverse();
        let mean = |x: usize, y: usize| {
            let parts = [(0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75)];
            let direction = |(a, b): (f64, f64)| direction_of_lat_long((x as f64 + a) / w, (y as f64 + b) / h);
            parts.map(|part| sample(back * direction(part))).into_iter().sum::<Vec3>() / 4.0
        };
        Self { radiance: Plane::from_fn(width, height, mean) }
    }

    /// Returns the mean luminance over the sphere.
    pub(crate) fn mean_luminance(&self) -> f64 {
        let (width, height) = self.radiance.size();
        let (mut sum, mut weight) = (0.0, 0.0);
        for y in 0..height {
            let w = (std::f64::consts::PI * (y as f64 + 0.5) / height as f64).sin();
            sum += w * (0..width).map(|x| f64::from(luminance(self.radiance[(x, y)]))).sum::<f64>();
            weight += w * width as f64;
        }
        sum / weight
    }

    /// Returns the map with luminance clipped at `times` the mean over the sphere.
    ///
    /// Clipped pixels keep their colour. The clipped energy of a sun or a lamp is lost.
    pub fn capped(&self, times: f64) -> Self {
        let (width, height) = self.radiance.size();
        let limit = times * self.mean_luminance();
        let cut = |pixel: Vec3| {
            let brightness = f64::from(luminance(pixel));
            if brightness > limit { pixel * (limit / brightness) as f32 } else { pixel }
        };
        Self { radiance: Plane::from_fn(width, height, |x, y| cut(self.radiance[(x, y)])) }
    }

    /// Returns the map with its luminance raised to a power; colours are kept.
    pub fn contrasted(&self, power: f64) -> Self {
        let (width, height) = self.radiance.size();
        let changed = |pixel: Vec3| pixel * f64::from(luminance(pixel)).max(1e-30).powf(power - 1.0) as f32;
        Self { radiance: Plane::from_fn(width, height, |x, y| changed(self.radiance[(x, y)])) }
    }

    /// Returns the mean radiance over each texel of an octahedral grid of `side` by `side`.
    ///
    /// Every pixel is split into sub-pixels that are small compared with a texel. Each adds its
    /// radiance, weighted by its solid angle, to the texel that contains it. Small lamps therefore
    /// keep their flux on any grid.
    pub fn to_grid(&self, map: OctahedralMap, side: usize) -> LightGrid {
        let (width, height) = self.radiance.size();
        // At least a dozen sub-pixels across a texel, so that no texel is without one, and never
        // fewer than six per side of a pixel, for lamps of one pixel.
        let split = (12 * side).div_ceil(height).max(6);
        let (fine_width, fine_height) = (width * split, height * split);
        // Fixed bands, summed in order, so that the result does not depend on the number of
        // threads.
        const BANDS: usize = 16;
        let partial: Vec<Vec<(DVec3, f64)>> = parallel::map_range(BANDS, |band| {
            let mut texels = vec![(DVec3::ZERO, 0.0); side * side];
            for fine_row in band * fine_height / BANDS..(band + 1) * fine_height / BANDS {
                let v = (fine_row as f64 + 0.5) / fine_height as f64;
                let weight = (std::f64::consts::PI * v).sin();
                for column in 0..width {
                    let radiance = self.radiance[(column, fine_row / split)].as_dvec3();
                    for fine in 0..split {
                        let u = (column * split + fine) as f64 + 0.5;
                        let d = direction_of_lat_long(u / fine_width as f64, v);
                        let texel = &mut texels[LightGrid::texel_of(map, side, d)];
                        texel.0 += weight * radiance;
                        texel.1 += weight;
                    }
                }
            }
            texels
        });
        let mut texels = vec![(DVec3::ZERO, 0.0); side * side];
        for band in partial {
            for (sum, part) in texels.iter_mut().zip(band) {
                sum.0 += part.0;
                sum.1 += part.1;
            }
        }
        let values = texels.into_iter().map(|(sum, weight)| (sum / weight.max(f64::MIN_POSITIVE)).as_vec3()).collect();
        LightGrid::from_texels(map, side, values)
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    fn sky() -> EnvironmentMap {
        EnvironmentMap::new(Plane::from_fn(128, 64, |x, y| {
            let lamp = if (x, y) == (40, 20) { 1e4 } else { 0.0 };
            Vec3::new(lamp + (y < 32) as u8 as f32, 0.3 + 0.2 * (x as f32 / 20.0).sin(), 0.5)
        }))
        .unwrap()
    }

    #[test]
    fn contrast_is_a_power_of_the_luminance_and_keeps_colours() {
        let (sky, flat) = (sky(), sky().contrasted(0.5));
        for (x, y) in [(40, 20), (3, 60), (90, 10)] {
            let (before, after) = (sky.radiance()[(x, y)], flat.radiance()[(x, y)]);
            assert!((luminance(after) / luminance(before).sqrt() - 1.0).abs() < 1e-4, "{before} {after}");
            assert!((before / luminance(before) - after / luminance(after)).length() < 1e-4);
        }
    }

    #[test]
    fn cap_clips_only_lamps_and_keeps_their_colour() {
        let (sky, capped) = (sky(), sky().capped(20.0));
        let mean = sky.to_grid(OctahedralMap::EqualArea, 8).integral() / (4.0 * PI);
        let limit = 20.0 * f64::from(luminance(mean.as_vec3()));
        let (lamp, cut) = (sky.radiance()[(40, 20)], capped.radiance()[(40, 20)]);
        assert!((f64::from(luminance(cut)) / limit - 1.0).abs() < 1e-3, "{cut} {limit}");
        assert!((cut / luminance(cut) - lamp / luminance(lamp)).length() < 1e-5);
        for (x, y) in [(0, 0), (39, 20), (40, 50)] {
            assert_eq!(sky.radiance()[(x, y)], capped.radiance()[(x, y)]);
        }
        assert_eq!(sky.capped(f64::INFINITY), sky);
    }

    #[test]
    fn reduced_maps_keep_the_flux() {
        let sky = sky();
        let (got, expected) = (flux(&sky.reduced(16)), flux(&sky));
        assert!(((got - expected) / expected).abs().max_element() < 0.01, "{got} {expected}");
        assert_eq!(sky.reduced(64), sky);
    }

    #[test]
    fn a_rotation_about_the_vertical_shifts_columns() {
        let sky = sky();
        let turned = sky.rotated(DQuat::from_rotation_y(-2.0 * PI * 5.0 / 128.0));
        // The four samples blur a lamp of one pixel, but keep its flux.
        assert!(((flux(&turned) - flux(&sky)) / flux(&sky)).abs().max_element() < 0.02);
        let expected = sky.shifted_columns(5);
        let (a, b) = (turned.radiance()[(10, 40)], expected.radiance()[(10, 40)]);
        assert!((a - b).abs().max_element() < 0.02, "{a} {b}");
        let brightest = |map: &EnvironmentMap| {
            let pixels = map.radiance().as_slice();
            (0..pixels.len()).max_by(|i, j| pixels[*i].x.total_cmp(&pixels[*j].x))
        };
        assert_eq!(brightest(&turned), brightest(&expected));
    }

    /// Integral over the sphere.
    fn flux(map: &EnvironmentMap) -> DVec3 {
        let (w, h) = map.radiance().size();
        (0..w * h)
            .map(|i| {
                let (top, bottom) = (PI * (i / w) as f64 / h as f64, PI * (i / w + 1) as f64 / h as f64);
                map.radiance().as_slice()[i].as_dvec3() * (top.cos() - bottom.cos()) * 2.0 * PI / w as f64
            })
            .sum()
    }

    #[test]
    fn grids_keep_the_flux_of_the_map() {
        let sky = sky();
        for map in [OctahedralMap::EqualArea, OctahedralMap::PraunHoppe] {
            for side in [16, 32, 64, 128] {
                let grid = sky.to_grid(map, side);
                let got: DVec3 = (0..side * side)
                    .map(|t| {
                        let (u, v) = LightGrid::centre_of(side, t);
                        grid.texels()[t].as_dvec3() * map.density(u, v) * 4.0 / (side * side) as f64
                    })
                    .sum();
                let error = ((got - flux(&sky)) / flux(&sky)).abs().max_element();
                assert!(error < 0.02, "{map:?} {side} {error}");
            }
        }
    }

    #[test]
    fn a_constant_map_stays_constant() {
        // Also a map of few pixels on a fine grid.
        let coarse = EnvironmentMap::new(Plane::from_fn(8, 4, |_, _| Vec3::ONE)).unwrap();
        let fine = coarse.to_grid(OctahedralMap::EqualArea, 128);
        assert!(fine.texels().iter().all(|texel| (*texel - Vec3::ONE).abs().max_element() < 1e-6));
        let white = EnvironmentMap::new(Plane::from_fn(64, 32, |_, _| Vec3::ONE)).unwrap();
        for texel in white.to_grid(OctahedralMap::EqualArea, 64).texels() {
            assert!((*texel - Vec3::ONE).abs().max_element() < 1e-6);
        }
    }

    #[test]
    fn turning_moves_columns_to_the_right() {
        let turned = sky().shifted_columns(5);
        assert_eq!(turned.radiance()[(45, 20)].x, 1e4 + 1.0);
        assert_eq!(turned.shifted_columns(123), sky());
    }

    #[test]
    fn rejects_invalid_maps() {
        let plane = |w, h, p| Plane::from_fn(w, h, |_, _| p);
        assert_eq!(EnvironmentMap::new(plane(10, 10, Vec3::ONE)), Err(MapError::Shape(10, 10)));
        assert_eq!(EnvironmentMap::new(plane(4, 2, Vec3::ZERO)), Err(MapError::Black));
        let bad = EnvironmentMap::new(plane(4, 2, Vec3::new(f32::NAN, 0.0, 0.0)));
        assert!(matches!(bad, Err(MapError::BadPixels { count: 8, column: 0, row: 0 })));
    }
}
